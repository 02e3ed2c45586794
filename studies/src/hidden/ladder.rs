//! Possible hidden effects, their places and sizes: nominal detectable sizes and the rungs around them.

use equipoise_simulator::burden::Span;
use equipoise_simulator::random::Random;

use super::effects::{self, Circumstances, Drawn, pick};
use super::truth::Hidden;

/// Hidden sizes, relative to the nominal detectable size.
pub const RUNGS: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Single effects of the catalogue, by name and place.
pub const CATALOGUE: [&str; 26] = [
    "hand_load right",
    "hand_load left",
    "hand_load both",
    "hand_contact",
    "worn_mass Pelvis",
    "worn_mass T8",
    "worn_mass forearm",
    "worn_mass thigh",
    "plate_offset",
    "plate_yaw",
    "plate_gain",
    "plate_crosstalk",
    "plate_height",
    "force_gain",
    "plate_drift linear",
    "plate_drift settling",
    "plate_lowpass",
    "suit_lag",
    "suit_heading_drift",
    "segment_heading T8",
    "segment_heading arm",
    "segment_misalignment T8",
    "segment_misalignment limb",
    "inertia",
    "periodic_sway",
    "unbalanced_parameters",
];
/// Nominal detectable size of each, in an everyday unit, as measured by `hidden detectable` and rounded. For a low pass
/// a larger size is a lower cutoff.
pub const NOMINAL: [(&str, f64, &str); 25] = [
    ("hand_load right", 0.25, "kg"),
    ("hand_load left", 0.25, "kg"),
    ("hand_load both", 0.25, "kg"),
    ("hand_contact", 10.0, "N"),
    ("worn_mass Pelvis", 2.0, "kg"),
    ("worn_mass T8", 0.5, "kg"),
    ("worn_mass forearm", 0.5, "kg"),
    ("worn_mass thigh", 1.5, "kg"),
    ("plate_offset", 30.0, "mm"),
    ("plate_yaw", 4.0, "deg"),
    ("plate_gain", 8.0, "%"),
    ("plate_crosstalk", 4.0, "%"),
    ("plate_height", 80.0, "mm"),
    ("force_gain", 1.0, "%"),
    ("plate_drift linear", 32.0, "mm/min"),
    ("plate_drift settling", 40.0, "mm"),
    ("plate_lowpass", 3.0, "Hz"),
    ("suit_lag", 10.0, "ms"),
    ("suit_heading_drift", 4.0, "deg/min"),
    ("segment_heading T8", 12.0, "deg"),
    ("segment_heading arm", 20.0, "deg (forearm: twice)"),
    ("segment_misalignment T8", 12.0, "deg"),
    ("segment_misalignment limb", 12.0, "deg (upper arm: half more)"),
    ("periodic_sway", 4.0, "mm"),
    ("unbalanced_parameters", 10.0, "mm of phi"),
];
/// The nominal detectable size of one of the catalogue's kinds; 1 where there is none.
pub fn nominal(kind: &str) -> f64 {
    NOMINAL.iter().find(|(name, ..)| *name == kind).map_or(1.0, |(_, size, _)| *size)
}

/// Effects outside the catalogue.
pub const OUTSIDE: [&str; 7] = [
    "outside shoulder_blades",
    "outside spine_shape",
    "outside magnetic_region",
    "outside tissue_slip",
    "outside hysteresis",
    "outside load_cell",
    "outside elastic_band",
];
/// Pairs have one of each: one on the body, and one of a sensor.
const OF_A_PAIR: [&[&str]; 2] = [
    &[
        "hand_load right",
        "hand_load both",
        "hand_contact",
        "worn_mass T8",
        "worn_mass forearm",
        "worn_mass Pelvis",
    ],
    &[
        "plate_yaw",
        "plate_gain",
        "plate_crosstalk",
        "plate_drift linear",
        "suit_lag",
        "plate_lowpass",
        "segment_heading arm",
    ],
];
/// Effects that may be present during identification.
const FROM_THE_BEGINNING: [&str; 9] = [
    "plate_offset",
    "plate_yaw",
    "plate_gain",
    "plate_crosstalk",
    "plate_height",
    "force_gain",
    "plate_lowpass",
    "suit_lag",
    "segment_misalignment T8",
];
/// Effects whose sign may flip within the work.
const MAY_FLIP: [&str; 6] = [
    "plate_offset",
    "plate_yaw",
    "plate_crosstalk",
    "segment_heading T8",
    "segment_heading arm",
    "segment_misalignment T8",
];

/// All 40 kinds, each drawn once before any is drawn twice.
pub fn deck() -> Vec<&'static str> {
    let rest = ["pair", "pair", "pair", "clean", "clean", "clean", "clean coloured"];
    CATALOGUE.into_iter().chain(OUTSIDE).chain(rest).collect()
}

/// Draws the parameters of a kind.
pub fn draw(kind: &str, size: f64, random: &mut Random, at: &Circumstances) -> Drawn {
    let mut drawn = Drawn::default();
    if kind.starts_with("clean") {
        return drawn;
    }
    if kind == "pair" {
        for choices in OF_A_PAIR {
            // Each of a pair must be detectable by itself.
            hide(pick(random, choices), size.max(1.0), random, at, &mut drawn);
        }
    } else {
        hide(kind, size, random, at, &mut drawn);
    }
    drawn
}

/// Its time span: mostly the whole work.
fn span_of(kind: &str, random: &mut Random, at: &Circumstances) -> (Span, bool) {
    let [start_s, end_s] = at.spans.work;
    let whole = Span { from_s: start_s, to_s: f64::INFINITY, flips_at_s: None };
    let choice = random.unit();
    let draw = random.unit();
    if kind == "inertia" {
        return (Span::ALWAYS, true);
    }
    if choice < 0.15 && FROM_THE_BEGINNING.contains(&kind) {
        return (Span::ALWAYS, true);
    }
    let may_come_and_go = !kind.contains("drift");
    if (0.15..0.30).contains(&choice) && may_come_and_go {
        let length_s = end_s - start_s;
        let from_s = start_s + (0.15 + 0.25 * draw) * length_s;
        // Half of these end before the end of the work.
        let to_s = if draw < 0.5 { from_s + 0.45 * length_s } else { f64::INFINITY };
        return (Span { from_s, to_s, flips_at_s: None }, false);
    }
    if choice > 0.90 && MAY_FLIP.contains(&kind) {
        return (Span { flips_at_s: Some(0.5 * (start_s + end_s)), ..whole }, false);
    }
    (whole, false)
}

fn hide(kind: &str, size: f64, random: &mut Random, at: &Circumstances, drawn: &mut Drawn) {
    let (span, from_beginning) = span_of(kind, random, at);
    let published = effects::put(kind, size, random, at, span, drawn);
    let name = kind.split_once(' ').map_or(kind, |(name, _)| name).to_owned();
    let description = if published.description.is_empty() { kind.to_owned() } else { published.description };
    drawn.effects.push(Hidden {
        name,
        place: published.place.map(|(what, place)| (what.to_owned(), place)).into_iter().collect(),
        parameters: published.parameters.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        span_s: [span.from_s.max(0.0), span.to_s.min(at.length_s)],
        flips_at_s: span.flips_at_s,
        // Inertia is either missing or not: it has no rungs.
        size: if kind == "inertia" { 1.0 } else { size },
        from_beginning,
        description,
    });
}
