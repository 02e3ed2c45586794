//! Effects declared as indistinguishable by these data (the method's table of confusable effects), for the evaluator.

/// Labels (name with place) that are always interchangeable.
const ALIKE: [&[&str]; 10] = [
    &["plate_offset", "unbalanced_parameters Pelvis"],
    &["plate_yaw", "suit_heading_drift"],
    &["suit_lag", "plate_lowpass", "inertia"],
    &["worn_mass Pelvis", "worn_mass LeftUpperLeg", "worn_mass RightUpperLeg"],
    &["worn_mass T8", "segment_misalignment T8"],
    // A rotation of an upright trunk about the vertical is one about its own axis.
    &["segment_heading T8", "segment_misalignment T8"],
    &["hand_load right", "worn_mass RightForearm"],
    &["hand_load left", "worn_mass LeftForearm"],
    &["hand_load right", "hand_contact right"],
    &["hand_load left", "hand_contact left"],
];

/// Declared explanations of effects outside the catalogue.
const FOR_OUTSIDE: [(&str, &[&str]); 2] = [
    ("outside spine_shape", &["segment_misalignment T8"]),
    (
        "outside tissue_slip",
        &[
            "segment_misalignment T8",
            "segment_misalignment LeftUpperLeg",
            "segment_misalignment RightUpperLeg",
        ],
    ),
];

/// One label for all that have the same columns, so that no data distinguish them: a misaligned sensor is a changed φ of
/// its segment.
pub fn same_columns(label: &str) -> String {
    label.replace("unbalanced_parameters", "segment_misalignment")
}

/// Whether two labels belong to one family; a label belongs to its own.
pub fn are_family(one: &str, other: &str) -> bool {
    one == other
        || ALIKE.iter().any(|alike| alike.contains(&one) && alike.contains(&other))
        || by_rule(one, other)
        || by_rule(other, one)
}

fn by_rule(one: &str, other: &str) -> bool {
    let (name, place) = one.split_once(' ').unwrap_or((one, ""));
    let (other_name, other_place) = other.split_once(' ').unwrap_or((other, ""));
    match (name, other_name) {
        // The vertical force alone cannot distinguish them.
        ("force_gain", "worn_mass") => true,
        // A misaligned sensor is a changed φ of its segment: the same column.
        ("segment_misalignment", "unbalanced_parameters") => place == other_place,
        _ => false,
    }
}

/// Whether a label is declared for an effect outside the catalogue, or has the same column as a declared one.
pub fn is_declared_for(kind: &str, label: &str) -> bool {
    let same = |declared: &&str| by_rule(declared, label);
    let declared = |labels: &[&str]| labels.contains(&label) || labels.iter().any(same);
    FOR_OUTSIDE.iter().any(|(outside, labels)| *outside == kind && declared(labels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_mutual_and_sides_are_kept_apart() {
        assert!(are_family("worn_mass T8", "force_gain") && are_family("force_gain", "worn_mass T8"));
        assert!(are_family("plate_yaw", "suit_heading_drift") && !are_family("plate_yaw", "plate_offset"));
        assert!(are_family("hand_load left", "worn_mass LeftForearm"));
        assert!(!are_family("hand_load left", "worn_mass RightForearm"));
        assert!(are_family("segment_misalignment T8", "unbalanced_parameters T8"));
        assert!(!are_family("segment_misalignment T8", "unbalanced_parameters Pelvis"));
    }
}
