//! Validity flags: why a value is invalid, as named bits, and the set of flags that invalidates each value.

/// A set of invalid reasons. Empty: all values of the message are valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Validity(pub u64);

macro_rules! reasons {
    ($($(#[$doc:meta])* $NAME:ident = $bit:literal, $name:literal;)*) => {
        impl Validity {
            $($(#[$doc])* pub const $NAME: Validity = Validity(1 << $bit);)*
            /// All flags with their public names, lowest bit first.
            pub const NAMES: &'static [(Validity, &'static str)] = &[$((Validity::$NAME, $name)),*];
        }
    };
}

reasons! {
    /// No suit sample for more than two sample periods.
    SUIT_STALE = 0, "suit_stale";
    /// No ground sample for more than two sample periods.
    GROUND_STALE = 1, "ground_stale";
    /// The subject's mass distribution is not identified.
    NOT_IDENTIFIED = 2, "not_identified";
    /// The motion exceeds what the equations in use cover.
    MOVING = 3, "moving";
    /// The vertical force is too small, or the feet are beyond the plate.
    FEET_OFF_PLATE = 4, "feet_off_plate";
    /// The external force is below the load threshold: no load is assumed.
    BELOW_LOAD_THRESHOLD = 5, "below_load_threshold";
    /// The model changed within the last second.
    MODEL_CHANGED = 6, "model_changed";
    /// Device time is not tied to host time, or the lag between the streams contradicts the data.
    CLOCK_UNSYNCHRONISED = 7, "clock_unsynchronised";
    /// The load's position, by the two centres of pressure, is far from the hands.
    LOAD_NOT_AT_HANDS = 8, "load_not_at_hands";
    /// The subject's mass is neither configured nor measured.
    MASS_UNKNOWN = 9, "mass_unknown";
    /// The segment lengths are unavailable, and with them the centre of mass.
    BODY_UNKNOWN = 10, "body_unknown";
    /// The plate reports a fault.
    PLATE_FAULT = 11, "plate_fault";
    /// The ground devices provide no centre of pressure in the world, and the position of the feet is unavailable.
    COP_NOT_MEASURED = 12, "cop_not_measured";
    /// Quick motion raised the detection limit: the external force is below it, but a load cannot be excluded.
    LOAD_BELOW_DETECTION_LIMIT = 13, "load_below_detection_limit";
    /// The subject's position on the plate is unavailable: the suit's registration is lost.
    POSITION_UNKNOWN = 14, "position_unknown";
    /// The ground's readings are implausible for a body or a working device: jumps, repetitions, or traction.
    GROUND_IMPLAUSIBLE = 15, "ground_implausible";
    /// The suit's poses are implausible for a body or a working suit: repetitions, jumps, or separated joints.
    SUIT_IMPLAUSIBLE = 16, "suit_implausible";
    /// The ground force is less than the body weight: a foot off the plate, a supporting hand, or a changed gain of a
    /// device.
    WEIGHT_MISSING = 17, "weight_missing";
}

impl Validity {
    /// Implausible samples of either sensor.
    pub const IMPLAUSIBLE: Validity = Validity::GROUND_IMPLAUSIBLE.and(Validity::SUIT_IMPLAUSIBLE);
    /// Flags that invalidate the pose of the suit and what is computed from it alone.
    pub const INVALIDATES_POSE: Validity = Validity::SUIT_STALE.and(Validity::SUIT_IMPLAUSIBLE);
    /// Flags that invalidate the centre of mass computed by the suit's software. With an unknown body it may be the previous
    /// subject's.
    pub const INVALIDATES_SUIT_COM: Validity =
        Validity::INVALIDATES_POSE.and(Validity::POSITION_UNKNOWN).and(Validity::BODY_UNKNOWN);
    /// Flags that invalidate the measured centre of pressure.
    pub const INVALIDATES_COP_MEASURED: Validity =
        Validity::INVALIDATES_GROUND_FORCE.and(Validity::FEET_OFF_PLATE).and(Validity::COP_NOT_MEASURED);
    /// Flags that invalidate the measured ground reaction.
    pub const INVALIDATES_GROUND_FORCE: Validity =
        Validity::GROUND_STALE.and(Validity::PLATE_FAULT).and(Validity::GROUND_IMPLAUSIBLE);
    /// Flags that invalidate the estimated centre of mass.
    pub const INVALIDATES_COM: Validity =
        Validity::INVALIDATES_POSE.and(Validity::BODY_UNKNOWN).and(Validity::POSITION_UNKNOWN);
    /// Flags that invalidate the estimated centre of pressure.
    pub const INVALIDATES_COP_ESTIMATED: Validity =
        Validity::INVALIDATES_COM.and(Validity::MOVING).and(Validity::CLOCK_UNSYNCHRONISED);
    /// Flags that invalidate the external force.
    pub const INVALIDATES_DELTA_F: Validity = Validity::INVALIDATES_COP_MEASURED
        .and(Validity::MASS_UNKNOWN)
        .and(Validity::BODY_UNKNOWN)
        .and(Validity::MOVING)
        .and(Validity::SUIT_IMPLAUSIBLE)
        .and(Validity::CLOCK_UNSYNCHRONISED);
    /// Flags that invalidate the residual (measured minus predicted), with or without a load.
    pub const INVALIDATES_RESIDUAL: Validity = Validity::INVALIDATES_COP_MEASURED
        .and(Validity::INVALIDATES_COP_ESTIMATED)
        .and(Validity::INVALIDATES_DELTA_F)
        .and(Validity::NOT_IDENTIFIED)
        .and(Validity::MODEL_CHANGED)
        .and(Validity::CLOCK_UNSYNCHRONISED);
    /// Flags that invalidate the mass in the hands.
    pub const INVALIDATES_LIFTED_MASS: Validity =
        Validity::INVALIDATES_DELTA_F.and(Validity::BELOW_LOAD_THRESHOLD).and(Validity::WEIGHT_MISSING);
    /// Flags that invalidate moment and compression of the low back, which exist without a load, too.
    pub const INVALIDATES_LOW_BACK: Validity =
        Validity(Validity::INVALIDATES_TORQUES.0 & !Validity::BELOW_LOAD_THRESHOLD.0);
    /// Flags that invalidate the overload torques: all.
    pub const INVALIDATES_TORQUES: Validity = Validity::INVALIDATES_COP_MEASURED
        .and(Validity::INVALIDATES_COP_ESTIMATED)
        .and(Validity::INVALIDATES_DELTA_F)
        .and(Validity::NOT_IDENTIFIED)
        .and(Validity::MOVING)
        .and(Validity::BELOW_LOAD_THRESHOLD)
        .and(Validity::LOAD_BELOW_DETECTION_LIMIT)
        .and(Validity::MODEL_CHANGED)
        .and(Validity::CLOCK_UNSYNCHRONISED)
        .and(Validity::WEIGHT_MISSING)
        .and(Validity::LOAD_NOT_AT_HANDS);
    /// Flags that invalidate the distance of the load from the hands. A large distance raises `LOAD_NOT_AT_HANDS`.
    pub const INVALIDATES_LOAD_HAND_DISTANCE: Validity =
        Validity(Validity::INVALIDATES_TORQUES.0 & !Validity::LOAD_NOT_AT_HANDS.0);

    /// The sets above with their public names, for other languages.
    pub const FLAG_SETS: &'static [(Validity, &'static str)] = &[
        (Validity::INVALIDATES_GROUND_FORCE, "ground_force"),
        (Validity::INVALIDATES_COP_MEASURED, "cop_measured"),
        (Validity::INVALIDATES_COM, "com"),
        (Validity::INVALIDATES_COP_ESTIMATED, "cop_estimated"),
        (Validity::INVALIDATES_DELTA_F, "delta_f"),
        (Validity::INVALIDATES_RESIDUAL, "residual"),
        (Validity::INVALIDATES_LIFTED_MASS, "lifted_mass"),
        (Validity::INVALIDATES_LOW_BACK, "low_back"),
        (Validity::INVALIDATES_TORQUES, "torques"),
    ];

    /// Union of both sets.
    #[must_use]
    pub const fn and(self, other: Validity) -> Validity {
        Validity(self.0 | other.0)
    }

    /// Raises `reason` if `holds`.
    pub fn raise(&mut self, reason: Validity, holds: bool) {
        if holds {
            self.0 |= reason.0;
        }
    }

    /// Whether any flag of `invalidating` is raised.
    pub const fn any_of(self, invalidating: Validity) -> bool {
        self.0 & invalidating.0 != 0
    }

    /// Public names of the raised flags, lowest bit first.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.iter().filter(move |(reason, _)| self.any_of(*reason)).map(|(_, name)| *name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_distinct_bits_with_distinct_names() {
        for (index, (reason, name)) in Validity::NAMES.iter().enumerate() {
            assert_eq!(reason.0.count_ones(), 1);
            for (other, other_name) in &Validity::NAMES[..index] {
                assert_ne!(reason, other);
                assert_ne!(name, other_name);
            }
        }
    }

    #[test]
    fn every_flag_invalidates_the_torques() {
        let all = Validity::NAMES.iter().fold(Validity::default(), |sum, (reason, _)| sum.and(*reason));
        assert_eq!(Validity::INVALIDATES_TORQUES, all);
    }
}
