//! Sections on lifts, dose and fatigue, and low back.

use equipoise_core::body::Joint;
use equipoise_view::words;

use crate::report::document::{Section, Table, Text};

use super::{Facts, length, or_none, over_time, several};

/// All lifts that ended in the recording.
pub(in crate::session_report) fn lifts(facts: &Facts) -> Section {
    let mut section = Section::new("Lifts");
    let found = &facts.lifts;
    section.paragraph(match found.lifts.len() {
        0 => "No lift ended in this recording.".to_owned(),
        1 => "One lift ended in this recording.".to_owned(),
        count => format!("{count} lifts ended in this recording."),
    });
    if found.before > 0 {
        section.paragraph(format!("{} lifts were counted before it began.", found.before));
    }
    if facts.periods.len() > 1 {
        section.paragraph(
            "The lifts are of all workers and shifts, by time; a lift in progress at their change is not counted.",
        );
    }
    if found.under_way() {
        section.paragraph("A load was carried at the end of the recording; that lift is not counted.");
    }
    let head = [
        ">no.",
        ">from, s",
        ">to, s",
        ">mass, kg",
        ">reach, m",
        ">largest reach, m",
        ">weight limit, kg",
        ">index",
    ];
    let mut table = Table::new(&head);
    for (number, lift) in found.lifts.iter().enumerate() {
        let mass = lift.mass_kg.zip(lift.mass_sigma_kg);
        table.rows.push(vec![
            (number + 1).to_string().into(),
            format!("{:.1}", lift.from_s).into(),
            format!("{:.1}", lift.to_s).into(),
            or_none(mass, |(mass_kg, sigma_kg)| format!("{mass_kg:.2} ± {sigma_kg:.2}")),
            or_none(lift.reach_m, |reach_m| format!("{reach_m:.3}")),
            or_none(lift.reach_max_m, |reach_m| format!("{reach_m:.3}")),
            or_none(lift.limit_kg, |limit_kg| format!("{limit_kg:.1}")),
            or_none(lift.index(), |index| format!("{index:.2}")),
        ]);
    }
    section.table(table);
    let title = "Mass in the hands";
    section
        .figures(over_time(facts, "lifted", title, "mass, kg", &facts.back.lifted_kg).into_iter().collect());
    section.note(
        "A lift is at least half a second with a detected load, and ends with half a second without one. Mass and reach are \
         means over the time in which they were valid, σ is that of one state; - : never valid. Reach is from the middle \
         of the ankles. Weight limit: the lower of those at the first and last valid instant, by the NIOSH lifting equation \
         without its frequency, for both hands and good grips, at the height of the wrists; 0: outside its range. \
         Index: mass over limit.",
    );
    section
}

/// Cumulative dose and fatigue.
pub(in crate::session_report) fn dose(facts: &Facts) -> Section {
    let mut section = Section::new("Dose and fatigue");
    if let Some(note) = several(facts) {
        section.paragraph(note);
    }
    match facts.back.dose {
        Some([damage, probability]) => section.paragraph(format!(
            "Cumulative damage of the low back after LiFFT (Gallagher 2017): {damage:.3e}, where 1 is failure. A day of \
             this dose is a high-risk job with a probability of {:.1} %.",
            100.0 * probability
        )),
        None => section.paragraph(
            "No lift with a valid low-back load ended, so dose and risk are unavailable: see data quality for the reasons.",
        ),
    }
    if facts.back.valid_s <= 0.0 && facts.back.dose.is_some() {
        section.paragraph("All of it precedes this recording, in which the low-back load was never valid.");
    }
    let title = "Damage of the low back";
    let figure = over_time(facts, "damage", title, "damage", &facts.back.damage);
    section.figures(figure.filter(|_| facts.back.dose.is_some()).into_iter().collect());
    let mut tired: Vec<Joint> = Joint::ALL.to_vec();
    tired.retain(|joint| facts.exposure.joints[joint.index()].fatigue_max > 0.0);
    tired.sort_by(|a, b| {
        let of = |joint: &Joint| facts.exposure.joints[joint.index()].fatigue_max;
        of(b).total_cmp(&of(a))
    });
    let mut table = Table::new(&["joint", ">largest fatigue", ">at the end"]);
    for joint in &tired {
        let exposure = &facts.exposure.joints[joint.index()];
        let percent = |fraction: f64| Text::from(format!("{:.2} %", 100.0 * fraction));
        table.rows.push(vec![
            words::joint(*joint).into(),
            percent(exposure.fatigue_max),
            percent(exposure.fatigue),
        ]);
    }
    if tired.is_empty() {
        section.paragraph(if facts.exposure.valid_s > 0.0 {
            "No joint fatigue accumulated."
        } else {
            "No torque was valid, so joint fatigue is unavailable."
        });
    }
    section.table(table);
    section.note(
        "Both are population-average models and include only the time in which torques were valid. They continue over \
         a restart of the daemon within a shift, so a recording may begin with values above zero.",
    );
    section
}

/// Load of the low back.
pub(in crate::session_report) fn back(facts: &Facts) -> Section {
    let mut section = Section::new("Low back");
    let found = &facts.back;
    if let Some(note) = several(facts) {
        section.paragraph(note);
    }
    match (found.peak, found.mean_n()) {
        (Some([peak_n, sigma_n, time_s]), Some([mean_n, _])) => section.paragraph(format!(
            "Compression of the L5/S1 disc was reported for {}: {mean_n:.0} N on average, at most {peak_n:.0} ± {sigma_n:.0} \
             N at t = {time_s:.1} s.",
            length(found.valid_s)
        )),
        _ => section.paragraph("Compression of the low back was never valid."),
    }
    let force =
        over_time(facts, "compression", "Compression of L5/S1", "compression, N", &found.compression_n);
    let moment = over_time(facts, "moment", "Net moment at L5/S1", "moment, N m", &found.moment_nm);
    section.figures(force.into_iter().chain(moment).collect());
    section
}
