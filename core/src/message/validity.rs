//! Why a value must not be used: named bits, and which of them invalidate which value.

/// A set of reasons. Empty means that every value of the message may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Validity(pub u64);

macro_rules! reasons {
    ($($(#[$doc:meta])* $NAME:ident = $bit:literal, $name:literal;)*) => {
        impl Validity {
            $($(#[$doc])* pub const $NAME: Validity = Validity(1 << $bit);)*
            /// Every reason with its public name, lowest bit first.
            pub const NAMES: &'static [(Validity, &'static str)] = &[$((Validity::$NAME, $name)),*];
        }
    };
}

reasons! {
    /// No suit sample for more than two sample periods.
    SUIT_STALE = 0, "suit_stale";
    /// No ground sample for more than two sample periods.
    GROUND_STALE = 1, "ground_stale";
    /// The worker's mass distribution is not identified yet.
    NOT_IDENTIFIED = 2, "not_identified";
    /// The worker moves faster than the equations in use allow.
    MOVING = 3, "moving";
    /// Too little force on the ground, or the feet are off the plate.
    FEET_OFF_PLATE = 4, "feet_off_plate";
    /// The external force is too small to tell where it acts.
    BELOW_LOAD_THRESHOLD = 5, "below_load_threshold";
    /// The model was changed within the last second.
    MODEL_CHANGED = 6, "model_changed";
    /// Device time is not yet tied to host time.
    CLOCK_UNSYNCHRONISED = 7, "clock_unsynchronised";
    /// The load found from the two centres of pressure is far from the hands.
    LOAD_NOT_AT_HANDS = 8, "load_not_at_hands";
    /// The worker's mass is neither configured nor measured yet.
    MASS_UNKNOWN = 9, "mass_unknown";
    /// The worker's bones are not known yet, and so no centre of mass.
    BODY_UNKNOWN = 10, "body_unknown";
    /// The plate reports a fault.
    PLATE_FAULT = 11, "plate_fault";
    /// The ground's devices tell no centre of pressure in the world, and where the feet stand is not known either.
    COP_NOT_MEASURED = 12, "cop_not_measured";
    /// The external force is below the detection limit in quick motion, where a load is possible: it is unknown whether
    /// something is carried.
    LOAD_MAY_HIDE = 13, "load_may_hide";
    /// Where the worker stands on the plate is not known: the suit was restarted, or was silent for long.
    PLACE_UNKNOWN = 14, "place_unknown";
    /// What the ground's devices show no body does, or no working device: a reading that leaps, repeats, or pulls.
    GROUND_IMPLAUSIBLE = 15, "ground_implausible";
    /// What the suit shows no body does, or no working suit: poses that repeat, leap, or come apart at the joints.
    SUIT_IMPLAUSIBLE = 16, "suit_implausible";
    /// The ground carries less than the body weighs: a foot off the plate, a hand that leans on something, or a device
    /// whose gain is another than before.
    WEIGHT_MISSING = 17, "weight_missing";
}

impl Validity {
    /// What no body does, or no working sensor.
    pub const IMPLAUSIBLE: Validity = Validity::GROUND_IMPLAUSIBLE.and(Validity::SUIT_IMPLAUSIBLE);
    /// What spoils the measured centre of pressure.
    pub const SPOILS_COP_MEASURED: Validity =
        Validity::SPOILS_GROUND_FORCE.and(Validity::FEET_OFF_PLATE).and(Validity::COP_NOT_MEASURED);
    /// What spoils the measured ground reaction.
    pub const SPOILS_GROUND_FORCE: Validity =
        Validity::GROUND_STALE.and(Validity::PLATE_FAULT).and(Validity::GROUND_IMPLAUSIBLE);
    /// What spoils the estimated centre of mass.
    pub const SPOILS_COM: Validity = Validity::SUIT_STALE
        .and(Validity::SUIT_IMPLAUSIBLE)
        .and(Validity::BODY_UNKNOWN)
        .and(Validity::PLACE_UNKNOWN);
    /// What spoils the estimated centre of pressure.
    pub const SPOILS_COP_ESTIMATED: Validity = Validity::SPOILS_COM.and(Validity::MOVING);
    /// What spoils the external force.
    pub const SPOILS_DELTA_F: Validity =
        Validity::SPOILS_COP_MEASURED.and(Validity::MASS_UNKNOWN).and(Validity::MOVING);
    /// What spoils the comparison of what is measured with what the model predicts, load or not.
    pub const SPOILS_RESIDUAL: Validity = Validity::SPOILS_COP_MEASURED
        .and(Validity::SPOILS_COP_ESTIMATED)
        .and(Validity::SPOILS_DELTA_F)
        .and(Validity::NOT_IDENTIFIED)
        .and(Validity::MODEL_CHANGED)
        .and(Validity::CLOCK_UNSYNCHRONISED);
    /// What spoils the mass in the hands.
    pub const SPOILS_LIFTED_MASS: Validity = Validity::SPOILS_DELTA_F
        .and(Validity::BELOW_LOAD_THRESHOLD)
        .and(Validity::WEIGHT_MISSING)
        .and(Validity::SUIT_IMPLAUSIBLE)
        .and(Validity::CLOCK_UNSYNCHRONISED);
    /// What spoils moment and compression of the low back: they exist without a load, too.
    pub const SPOILS_BACK: Validity =
        Validity(Validity::SPOILS_TORQUES.0 & !Validity::BELOW_LOAD_THRESHOLD.0);
    /// What spoils the overload torques: all of it.
    pub const SPOILS_TORQUES: Validity = Validity::SPOILS_COP_MEASURED
        .and(Validity::SPOILS_COP_ESTIMATED)
        .and(Validity::SPOILS_DELTA_F)
        .and(Validity::NOT_IDENTIFIED)
        .and(Validity::MOVING)
        .and(Validity::BELOW_LOAD_THRESHOLD)
        .and(Validity::LOAD_MAY_HIDE)
        .and(Validity::MODEL_CHANGED)
        .and(Validity::CLOCK_UNSYNCHRONISED)
        .and(Validity::WEIGHT_MISSING)
        .and(Validity::LOAD_NOT_AT_HANDS);

    /// The sets above by name, for other languages.
    pub const SPOILERS: &'static [(Validity, &'static str)] = &[
        (Validity::SPOILS_GROUND_FORCE, "ground_force"),
        (Validity::SPOILS_COP_MEASURED, "cop_measured"),
        (Validity::SPOILS_COM, "com"),
        (Validity::SPOILS_COP_ESTIMATED, "cop_estimated"),
        (Validity::SPOILS_DELTA_F, "delta_f"),
        (Validity::SPOILS_RESIDUAL, "residual"),
        (Validity::SPOILS_LIFTED_MASS, "lifted_mass"),
        (Validity::SPOILS_BACK, "back"),
        (Validity::SPOILS_TORQUES, "torques"),
    ];

    /// Both sets together.
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

    /// Whether any reason of `spoilers` is raised.
    pub const fn any_of(self, spoilers: Validity) -> bool {
        self.0 & spoilers.0 != 0
    }

    /// The public names of the raised reasons, lowest bit first.
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
        assert_eq!(Validity::SPOILS_TORQUES, all);
    }
}
