//! Descriptions of the catalogue's effects for readers on the floor.

/// Description of an effect, with `{}` for its place, and a remedy other than adding it to the model.
const EFFECTS: [(&str, &str, &str); 18] = [
    (
        "hand_load",
        "a load in {}",
        "If the load belongs to the work, the model now includes it. If not, put it down and measure again.",
    ),
    (
        "hand_contact",
        "an external force at {}",
        "Check what the hand touches: a bench, a rail, a rope that holds the load.",
    ),
    (
        "worn_mass",
        "a mass worn on {}",
        "Check what is worn there: a belt, tools, a pack. If it is permanent, identify the worker while wearing it.",
    ),
    (
        "plate_offset",
        "a plate position that differs from the configured one",
        "Measure the position of the plate and correct origin_m in [ground.frame].",
    ),
    (
        "plate_yaw",
        "a plate rotated about the vertical relative to the suit",
        "Measure the rotation of the plate and correct yaw_deg in [ground.frame], or reset the suit's heading.",
    ),
    (
        "plate_gain",
        "a gain error of the centre of pressure",
        "Check the plate's calibration with a weight at its corners.",
    ),
    ("plate_crosstalk", "a plate with crosstalk between its axes", "Check the plate's calibration matrix."),
    (
        "plate_height",
        "a surface height above the sensor that differs from the configured one",
        "Measure the height and correct surface_height_m in [ground.frame].",
    ),
    ("force_gain", "a gain error of the vertical force", "Check the plate with a known weight."),
    ("plate_drift", "a drift of the plate", "Let the plate warm up, and tare the empty plate more often."),
    (
        "plate_lowpass",
        "a low-pass filter in the plate that is not configured",
        "Check the plate's amplifier for a filter and raise its cutoff.",
    ),
    (
        "suit_lag",
        "a lag between suit and plate",
        "Set latency_ms: in [suit] if the suit is late (positive), in [ground] if it is early.",
    ),
    (
        "suit_heading_drift",
        "a heading drift of the suit",
        "Reset the suit's heading, and keep away from steel and motors.",
    ),
    (
        "segment_heading",
        "a heading error of {}, as from a magnetic disturbance",
        "Check for iron, motors or cables near this segment, and calibrate the suit away from them.",
    ),
    (
        "segment_misalignment",
        "a misaligned sensor on {}",
        "Remount the sensor of this segment and calibrate the suit.",
    ),
    (
        "inertia",
        "inertia of the body that the model does not include",
        "Include inertia in the model: [overload] motion.",
    ),
    (
        "periodic_sway",
        "a periodic sway, such as breathing",
        "No repair is needed: the model now includes it.",
    ),
    (
        "unbalanced_parameters",
        "a mass distribution of {} that differs from the identified one",
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
