//! Recommendations for the design of the job, each with its basis.

use equipoise_core::body::Joint;
use equipoise_core::overload::Level;
use equipoise_view::words;

use crate::constants::STATEMENT_TIME_MIN_S;
use crate::report::document::{Section, Text, strong};

use super::document::length;
use super::exposure::Peak;
use super::gather::Facts;

/// Changes of the job, derived from the largest loads of the session.
pub(super) fn recommendations(facts: &Facts) -> Section {
    let mut section = Section::new("Recommendations");
    // Low-back values are also valid without a load, torques are not; the dose may precede the recording.
    let has_torques = facts.exposure.valid_s >= STATEMENT_TIME_MIN_S;
    if !has_torques {
        section.paragraph(format!(
            "Torques were reported for {}, too short for a recommendation on joints. See data quality for the reasons.",
            length(facts.exposure.valid_s)
        ));
    }
    let joints = if has_torques { joints(facts) } else { Vec::new() };
    let all: Vec<Text> =
        joints.into_iter().chain(lifts(facts)).chain(compression(facts)).chain(risk(facts)).collect();
    if all.is_empty() && has_torques {
        section.paragraph("No joint, lift or low-back load exceeded the limits below.");
    }
    section.list(all);
    section.note(
        "Basis. Joints: high above 0.6 of the limit (Table I of the paper); the torque of a load is proportional to its mass \
         in the same motion. Lifts: frequency-independent limit of the revised NIOSH equation (Waters, Putz-Anderson & Garg \
         1994). L5/S1: NIOSH's action limit of 3400 N. Dose: LiFFT (Gallagher 2017). They are models of a population: a \
         qualified person decides.",
    );
    section
}

/// The three joints with the highest peaks that were high or overloaded for half a second.
fn joints(facts: &Facts) -> Vec<Text> {
    let mut high: Vec<(Joint, Peak, f64)> = Joint::ALL
        .into_iter()
        .filter_map(|joint| {
            let exposure = &facts.exposure.joints[joint.index()];
            let high_s = exposure.at(Level::Red) + exposure.at(Level::AboveMax);
            Some((joint, exposure.peak?, high_s)).filter(|_| high_s >= 0.5)
        })
        .collect();
    high.sort_by(|(_, a, _), (_, b, _)| b.limit_ratio.total_cmp(&a.limit_ratio));
    high.truncate(3);
    high.into_iter()
        .map(|(joint, peak, high_s)| {
            let text = strong(capital(words::joint(joint))).plain(format!(
                ": high or overloaded for {}, at most {} of its limit",
                length(high_s),
                peak.percent()
            ));
            match peak.load {
                Some([mass_kg, reach_m]) => text.plain(format!(
                    ", with {mass_kg:.1} kg at {reach_m:.2} m. Reduce the load to {:.1} kg in the same motion, or bring it \
                     closer.",
                    mass_kg * 0.6 / peak.limit_ratio
                )),
                None => text.plain(". Reduce the load, or bring it closer."),
            }
        })
        .collect()
}

/// The lifts above their recommended weight limit.
fn lifts(facts: &Facts) -> Option<Text> {
    let lifts = &facts.lifts.lifts;
    let excesses = lifts.iter().enumerate().filter_map(|(number, lift)| Some((number + 1, lift.excess()?)));
    let above: Vec<(usize, f64)> = excesses.filter(|(_, excess)| *excess > 1.0).collect();
    let (number, excess) = above.iter().copied().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let limit_kg = lifts[number - 1].limit_kg?;
    let most = if limit_kg > 0.0 {
        format!("{excess:.1} times its limit of {limit_kg:.1} kg")
    } else {
        "beyond the reach, height or twisting for which the equation accepts any mass".to_owned()
    };
    Some(strong("Lifts").plain(format!(
        ": {} of {} exceed the recommended weight limit; lift {number} most, {most}. Reduce mass, reach or twisting, or start \
         nearer to knuckle height.",
        above.len(),
        lifts.len()
    )))
}

/// The compression against NIOSH's action limit; within 2 σ of it, the limit may be exceeded.
fn compression(facts: &Facts) -> Option<Text> {
    let [peak_n, sigma_n, time_s] = facts.back.peak?;
    let margin_n = peak_n - 3400.0;
    let text = |what: &str| {
        strong("L5/S1")
            .plain(format!(": compression of {peak_n:.0} ± {sigma_n:.0} N at t = {time_s:.1} s {what}"))
    };
    if margin_n > 2.0 * sigma_n {
        Some(text("exceeds 3400 N. Reduce the load, bend less, or bring it closer."))
    } else if margin_n > -2.0 * sigma_n {
        Some(text("may exceed 3400 N: the uncertainty does not decide."))
    } else {
        None
    }
}

/// The dose, if the largest probability of a high-risk job of a worker is at least 50 %.
fn risk(facts: &Facts) -> Option<Text> {
    let doses = facts.periods.iter().filter_map(|period| period.back.dose);
    let probability = doses.map(|[_, probability]| probability).max_by(f64::total_cmp)?;
    (probability >= 0.5).then(|| {
        strong("Dose").plain(format!(
            ": a shift of this dose is a high-risk job with a probability of {:.0} %. Reduce the number of lifts, or rotate \
             workers.",
            100.0 * probability
        ))
    })
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
