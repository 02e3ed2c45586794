//! Sessions and workers side by side.

use equipoise_config::Config;
use equipoise_core::body::Joint;
use equipoise_core::message::Validity;
use equipoise_core::overload::Level;
use equipoise_view::words;

use crate::report::document::{Section, Table, Text, code, strong};

use super::document::{fraction_percent, length};
use super::exposure::Peak;
use super::gather::{Facts, Source};
use super::lifts::Lift;
use super::period::Period;
use super::sections::{begin, software};

/// Flags that invalidate the mass of a load that is in the hands.
const INVALIDATES_LOAD: Validity =
    Validity(Validity::INVALIDATES_LIFTED_MASS.0 & !Validity::BELOW_LOAD_THRESHOLD.0);
/// Levels in the order of their severity.
const LEVELS: [Level; 5] = [Level::Green, Level::Undecided, Level::Orange, Level::Red, Level::AboveMax];

/// One worker in one shift of one session.
pub(super) struct Column<'a> {
    /// Its number, and the worker's pseudonym.
    pub(super) label: String,
    facts: &'a Facts,
    period: &'a Period,
}

impl Column<'_> {
    /// The joint with the largest limit ratio, and its peak.
    pub(super) fn highest_peak(&self) -> Option<(Joint, Peak)> {
        self.period.exposure.highest_peak()
    }
}

/// A column for each worker and shift of each session.
pub(super) fn columns(sessions: &[Facts]) -> Vec<Column<'_>> {
    let mut columns = Vec::new();
    for (session, facts) in sessions.iter().enumerate() {
        for (part, period) in facts.periods.iter().enumerate() {
            let number = match facts.periods.len() {
                1 => (session + 1).to_string(),
                _ => format!("{}.{}", session + 1, part + 1),
            };
            let label = format!("{number}: {}", period.subject.as_deref().unwrap_or("unnamed"));
            columns.push(Column { label, facts, period });
        }
    }
    columns
}

/// Whether all columns have the model and the settings of the first one.
pub(super) fn is_comparable(columns: &[Column<'_>]) -> bool {
    columns.iter().all(|column| differences(&columns[0], column).is_empty())
}

/// All quantities, a column for each worker and shift.
pub(super) fn comparison(columns: &[Column<'_>]) -> Section {
    let mut section = Section::new("Comparison");
    if !is_comparable(columns) {
        section.paragraph(strong("Not all columns can be compared with the first one.").plain(
            " Where the row \"comparable\" says no, differences may result from the model or the settings rather than from \
             the work. With --config all states are computed again with one configuration.",
        ));
    }
    let mut rows = Rows { columns, table: table("quantity", columns) };
    origin(&mut rows);
    lifts(&mut rows);
    joints(&mut rows);
    back(&mut rows);
    section.table(rows.table);
    section.note(
        "± is 1-σ; that of a mean is the mean of the σ, since errors within a session do not average out. Numbers of lifts \
         and times are counts of states, without error. The σ of the lifting index is that of the mass alone. Dose, risk and \
         fatigue are models of a population and have no σ. A share of a limit refers to the limit of that worker. Highest \
         level: of all joints at each instant.",
    );
    section.head("Peak of each joint");
    section.table(peaks(columns));
    section
}

fn table(first: &str, columns: &[Column<'_>]) -> Table {
    let labels = columns.iter().map(|column| column.label.as_str());
    Table::new(&std::iter::once(first).chain(labels).collect::<Vec<_>>())
}

/// A table under construction.
struct Rows<'a> {
    columns: &'a [Column<'a>],
    table: Table,
}

impl Rows<'_> {
    fn add(&mut self, name: &str, cell: impl Fn(&Column<'_>) -> Text) {
        self.table
            .rows
            .push(std::iter::once(Text::from(name)).chain(self.columns.iter().map(cell)).collect());
    }
}

fn origin(rows: &mut Rows<'_>) {
    let columns = rows.columns;
    rows.add("recording", |column| code(column.facts.name.as_str()));
    rows.add("station", |column| code(column.facts.config.station.as_str()));
    rows.add("start of the recording", |column| begin(column.facts).into());
    rows.add("time", |column| {
        let [from_s, to_s] = column.period.span_s.unwrap_or_default();
        format!("{}, from t = {from_s:.1} s", length(to_s - from_s)).into()
    });
    rows.add("states", |column| {
        let how = if column.facts.source == Source::Recorded { "recorded" } else { "computed" };
        format!("{how} by {}", software(release(column.facts))).into()
    });
    rows.add("comparable", |column| {
        let differences = differences(&columns[0], column);
        match differences.is_empty() {
            true if std::ptr::eq(column.period, columns[0].period) => "reference".into(),
            true => "yes".into(),
            false => strong("no").plain(format!(": {}", differences.join("; "))),
        }
    });
    rows.add("torques reported", |column| {
        let (valid_s, observed_s) = (column.period.exposure.valid_s, column.period.quality.observed_s);
        format!("{}, {} of the time", length(valid_s), fraction_percent(valid_s, observed_s)).into()
    });
}

fn lifts(rows: &mut Rows<'_>) {
    rows.add("lifts", |column| match column.period.lifts.before {
        0 => column.period.lifts.lifts.len().to_string().into(),
        before => format!("{}; {before} counted before", column.period.lifts.lifts.len()).into(),
    });
    rows.add("mass of a lift, mean", |column| {
        let masses = masses(column);
        let mean = |value: usize| masses.iter().map(|mass| mass[value]).sum::<f64>() / masses.len() as f64;
        match masses.is_empty() {
            false => format!("{:.2} ± {:.2} kg", mean(0), mean(1)).into(),
            true => no_lift(column, "no valid mass", INVALIDATES_LOAD),
        }
    });
    rows.add("mass of a lift, largest", |column| {
        match masses(column).into_iter().max_by(|a, b| a[0].total_cmp(&b[0])) {
            Some([mass_kg, sigma_kg]) => format!("{mass_kg:.2} ± {sigma_kg:.2} kg").into(),
            None => no_lift(column, "no valid mass", INVALIDATES_LOAD),
        }
    });
    rows.add("lifts above the weight limit", |column| {
        let lifts = &column.period.lifts.lifts;
        let excesses: Vec<f64> = lifts.iter().filter_map(Lift::excess).collect();
        let above = excesses.iter().filter(|excess| **excess > 1.0).count();
        match excesses.is_empty() {
            false => format!("{above} of {}", excesses.len()).into(),
            true => no_lift(column, "no valid load position", Validity::INVALIDATES_LOW_BACK),
        }
    });
    rows.add("largest lifting index", |column| {
        let lifts = column.period.lifts.lifts.iter();
        let indices =
            lifts.filter_map(|lift| Some((lift.index()?, lift.mass_sigma_kg? / lift.limit_kg?, lift.from_s)));
        match indices.max_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((index, sigma, from_s)) => format!("{index:.2} ± {sigma:.2}, at t = {from_s:.1} s").into(),
            None if column.period.lifts.lifts.is_empty() => "no completed lift".into(),
            None => "no lift with a valid mass within the range of the equation".into(),
        }
    });
}

fn joints(rows: &mut Rows<'_>) {
    rows.add("closest to its limit for the longest time", |column| {
        let exposure = &column.period.exposure;
        match exposure.worst() {
            Some(joint) => {
                let joint_exposure = &exposure.joints[joint.index()];
                let peak =
                    joint_exposure.peak.map_or_else(|| "its limit is unavailable".to_owned(), of_limit);
                let worst_s = length(joint_exposure.worst_s);
                format!("{}, for {worst_s}; {peak}", words::joint(joint)).into()
            }
            None => no_torque(column),
        }
    });
    rows.add("highest peak", |column| match column.highest_peak() {
        Some((joint, peak)) => format!("{}, {}", words::joint(joint), of_limit(peak)).into(),
        None => no_torque(column),
    });
    for level in LEVELS {
        rows.add(&format!("highest level {}", words::level(level as u32)), |column| {
            let exposure = &column.period.exposure;
            let level_s = exposure.highest_level_s[level as usize];
            match exposure.valid_s > 0.0 {
                true => {
                    format!("{}, {}", length(level_s), fraction_percent(level_s, exposure.valid_s)).into()
                }
                false => no_torque(column),
            }
        });
    }
    rows.add("largest fatigue", |column| {
        let joints = &column.period.exposure.joints;
        let fatigue = |joint: &Joint| joints[joint.index()].fatigue_max;
        match Joint::ALL.into_iter().max_by(|a, b| fatigue(a).total_cmp(&fatigue(b))) {
            Some(joint) if fatigue(&joint) > 0.0 => {
                format!("{:.1} %, {}", 100.0 * fatigue(&joint), words::joint(joint)).into()
            }
            _ if column.period.exposure.valid_s > 0.0 => "none".into(),
            _ => no_torque(column),
        }
    });
}

fn back(rows: &mut Rows<'_>) {
    let invalid =
        |column: &Column<'_>| because(column, "no valid compression", Validity::INVALIDATES_LOW_BACK);
    rows.add("L5/S1 compression, mean", |column| match column.period.back.mean_n() {
        Some([mean_n, sigma_n]) => format!("{mean_n:.0} ± {sigma_n:.0} N").into(),
        None => invalid(column),
    });
    rows.add("L5/S1 compression, largest", |column| match column.period.back.peak {
        Some([peak_n, sigma_n, time_s]) => {
            format!("{peak_n:.0} ± {sigma_n:.0} N, at t = {time_s:.1} s").into()
        }
        None => invalid(column),
    });
    let no_dose = |column: &Column<'_>| {
        no_lift(column, "no lift with a valid low-back load", Validity::INVALIDATES_LOW_BACK)
    };
    rows.add("L5/S1 dose of the shift, at the end", |column| match column.period.back.dose {
        Some([damage, _]) => format!("{damage:.2e}").into(),
        None => no_dose(column),
    });
    rows.add("L5/S1 dose of this time", |column| match column.period.back.added_damage() {
        Some(damage) => format!("{damage:.2e}").into(),
        None => no_dose(column),
    });
    rows.add("risk of the shift's dose", |column| match column.period.back.dose {
        Some([_, probability]) => format!("{:.1} %", 100.0 * probability).into(),
        None => no_dose(column),
    });
}

/// A row for each joint with a peak, the closest to its limit first.
fn peaks(columns: &[Column<'_>]) -> Table {
    let peak = |column: &Column<'_>, joint: Joint| column.period.exposure.joints[joint.index()].peak;
    let mut joints: Vec<(Joint, f64)> = Joint::ALL
        .into_iter()
        .filter_map(|joint| {
            let ratios = columns.iter().filter_map(|column| Some(peak(column, joint)?.limit_ratio));
            Some((joint, ratios.max_by(f64::total_cmp)?))
        })
        .collect();
    joints.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    let mut rows = Rows { columns, table: table("joint", columns) };
    for (joint, _) in joints {
        rows.add(words::joint(joint), |column| {
            let exposure = &column.period.exposure.joints[joint.index()];
            let high_s = exposure.at(Level::Red) + exposure.at(Level::AboveMax);
            match exposure.peak {
                Some(peak) if high_s > 0.0 => {
                    format!("{}; high or overloaded for {}", of_limit(peak), length(high_s)).into()
                }
                Some(peak) => of_limit(peak).into(),
                None => no_torque(column),
            }
        });
    }
    rows.table
}

fn of_limit(peak: Peak) -> String {
    format!("{} of its limit", peak.percent())
}

/// Mass and 1-σ of each lift that has one, kg.
fn masses(column: &Column<'_>) -> Vec<[f64; 2]> {
    let lifts = column.period.lifts.lifts.iter();
    lifts.filter_map(|lift| Some([lift.mass_kg?, lift.mass_sigma_kg?])).collect()
}

fn no_lift(column: &Column<'_>, what: &str, invalidating: Validity) -> Text {
    match column.period.lifts.lifts.is_empty() {
        true => "no completed lift".into(),
        false => because(column, what, invalidating),
    }
}

fn no_torque(column: &Column<'_>) -> Text {
    because(column, "no valid torque", Validity::INVALIDATES_TORQUES)
}

/// An absent value, with the flag that invalidated it for the longest time.
fn because(column: &Column<'_>, what: &str, invalidating: Validity) -> Text {
    let quality = &column.period.quality;
    match quality.longest_of(invalidating) {
        Some((flag, raised_s)) => {
            let fraction = fraction_percent(raised_s, quality.observed_s);
            Text::from(format!("{what}; mostly ")).code(flag).plain(format!(", {fraction} of the time"))
        }
        None => what.into(),
    }
}

/// Release that computed the states.
fn release(facts: &Facts) -> &str {
    match facts.source {
        Source::Recorded => &facts.header.software_version,
        Source::Replayed => env!("CARGO_PKG_VERSION"),
    }
}

/// Reasons why the values of a column cannot be compared with those of the first one.
fn differences(first: &Column<'_>, other: &Column<'_>) -> Vec<String> {
    let (one, two) = (first.facts, other.facts);
    let mut differences = settings_differences(&one.config, &two.config);
    if release(one) != release(two) {
        differences.push("another release of Equipoise".to_owned());
    }
    if !std::ptr::eq(first.period, other.period) && one.reloads + two.reloads > 0 {
        differences.push("settings were changed during a recording".to_owned());
    }
    // The configuration describes the configured subject only, no other one that was loaded.
    let is_configured = |column: &Column<'_>| {
        column.period.subject.as_ref().is_some_and(|id| *id == column.facts.config.subject.id)
    };
    let (a, b) = (&one.config.subject, &two.config.subject);
    let is_same_body = a.height_m == b.height_m && a.sex == b.sex && a.tau_max_nm == b.tau_max_nm;
    if a.id == b.id && is_configured(first) && is_configured(other) && !is_same_body {
        differences.push("another stature, sex or torque limit of the same worker".to_owned());
    }
    differences
}

fn settings_differences(one: &Config, two: &Config) -> Vec<String> {
    let parts = [
        ("another model file", one.model_toml() != two.model_toml()),
        ("[identification] differs", one.identification != two.identification),
        ("[static_pose] differs", one.static_pose != two.static_pose),
        ("[overload] differs", one.overload != two.overload),
    ];
    parts.into_iter().filter(|(_, differs)| *differs).map(|(what, _)| what.to_owned()).collect()
}
