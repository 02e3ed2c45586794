//! Descriptions of the catalogue's effects for readers on the floor.

/// Description of an effect, with `{}` for its place, and a remedy other than adding it to the model.
const EFFECTS: [(&str, &str, &str); 18] = [
    (
        "hand_load",
        "a load in {}",
        "If the load belongs to the work, the model now knows it. If nothing should be there, put it down and look again.",
    ),
    (
        "hand_contact",
        "a push or a support at {}",
        "Look for what the hand touches: a bench, a rail, a rope that holds the load.",
    ),
    (
        "worn_mass",
        "a mass worn on {}",
        "Look for what is worn there: a belt, tools, a pack. If it stays for good, identify the worker with it on.",
    ),
    (
        "plate_offset",
        "a plate that stands elsewhere than configured",
        "Measure where the plate stands and correct origin_m in [ground.frame].",
    ),
    (
        "plate_yaw",
        "a plate that is turned against the suit",
        "Measure how the plate is turned and correct yaw_deg in [ground.frame], or reset the suit's heading.",
    ),
    (
        "plate_gain",
        "a plate that stretches the centre of pressure",
        "Check the plate's calibration with a weight at its corners.",
    ),
    ("plate_crosstalk", "a plate whose axes leak into each other", "Check the plate's calibration matrix."),
    (
        "plate_height",
        "a surface that lies higher or lower above the sensor than configured",
        "Measure the height and correct surface_height_m in [ground.frame].",
    ),
    ("force_gain", "a plate that stretches the vertical force", "Check the plate with a known weight."),
    (
        "plate_drift",
        "a plate that drifts",
        "Let the plate warm up, and tare it when it is empty, more often.",
    ),
    (
        "plate_lowpass",
        "a plate that is slower than configured",
        "Look for a filter in the plate's amplifier and raise its cutoff.",
    ),
    (
        "suit_lag",
        "a suit that is late or early against the plate",
        "Set latency_ms: in [suit] if the suit is late (positive), in [ground] if it is early.",
    ),
    (
        "suit_heading_drift",
        "a suit that slowly turns about the upright",
        "Reset the suit's heading, and keep away from steel and motors.",
    ),
    (
        "segment_heading",
        "{} shown turned about the upright, as a magnetic disturbance does",
        "Look for iron, motors or cables near this segment, and calibrate the suit away from them.",
    ),
    (
        "segment_misalignment",
        "a sensor that sits crooked on {}",
        "Mount the sensor of this segment again and calibrate the suit.",
    ),
    (
        "inertia",
        "the body's own inertia, which the model leaves out",
        "Let the model take inertia into account: [overload] motion.",
    ),
    ("periodic_sway", "a regular sway, such as breathing", "Nothing needs repair; the model now expects it."),
    (
        "unbalanced_parameters",
        "a mass distribution of {} that is no longer the identified one",
        "Identify the worker again, with the clothes and tools of the work.",
    ),
];

/// An effect in words; an unknown name of a later catalogue is returned as it is.
pub(in crate::report) fn effect(name: &str, place: &str) -> String {
    let known = EFFECTS.iter().find(|(known, ..)| *known == name);
    known.map_or_else(
        || format!("{name} {place}").trim().to_owned(),
        |(_, words, _)| words.replace("{}", place),
    )
}

/// Remedy for an effect.
pub(in crate::report) fn remedy(name: &str) -> Option<&'static str> {
    EFFECTS.iter().find(|(known, ..)| *known == name).map(|&(_, _, remedy)| remedy)
}

#[cfg(test)]
mod tests {
    use equipoise_core::effect::{Effect, Place};

    use super::*;

    #[test]
    fn every_effect_has_words_and_a_remedy_of_its_own() {
        for effect in Effect::ALL {
            let known = EFFECTS.iter().filter(|(name, ..)| *name == effect.name()).count();
            assert_eq!(known, 1, "{}", effect.name());
            let has_place =
                EFFECTS.iter().any(|(name, words, _)| *name == effect.name() && words.contains("{}"));
            assert_eq!(has_place, effect.places() != [Place::Whole], "{}", effect.name());
        }
        for (name, _, remedy) in EFFECTS {
            assert_eq!(EFFECTS.iter().filter(|other| other.2 == remedy).count(), 1, "{name}");
        }
    }
}
