//! What went wrong on a station, each kind by its name: begun, still so, how often, since when.

use super::layout::{ZeroCopySend, message};

/// How many kinds a message has places for.
pub const KINDS_MAX: usize = 32;

message! {
    /// The station's incidents since the daemon's start, published once a second and whenever one begins or ends.
    as "equipoise/Incidents/1", 832 bytes,
    pub struct Incidents {
        /// When it was published, CLOCK_MONOTONIC.
        pub time_ns: u64,
        /// Which go on now: bit n is kind n.
        pub active: u64,
        /// How often each kind has begun.
        pub begun: [u64; KINDS_MAX],
        /// When each kind last began, CLOCK_MONOTONIC; 0 for never.
        pub last_begun_ns: [u64; KINDS_MAX],
        /// When each kind last ended, CLOCK_MONOTONIC; 0 for never.
        pub last_ended_ns: [u64; KINDS_MAX],
        /// Always zero; fills the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 6],
    }
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $Kind:ident = $number:literal, $name:literal;)*) => {
        /// A kind of incident. Number and name are a contract with journal, status, metrics and other languages.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u32)]
        pub enum Incident {
            $($(#[$doc])* $Kind = $number,)*
        }

        impl Incident {
            /// All kinds, lowest number first.
            pub const ALL: &'static [Incident] = &[$(Incident::$Kind),*];

            /// The public name.
            pub const fn name(self) -> &'static str {
                match self { $(Incident::$Kind => $name,)* }
            }
        }
    };
}

kinds! {
    /// The suit sends nothing.
    SuitSilent = 0, "suit_silent";
    /// The plate sends nothing.
    GroundSilent = 1, "ground_silent";
    /// Suit samples come, but their time does not advance, or is refused.
    SuitStampsStale = 2, "suit_stamps_stale";
    /// Ground samples come, but their time does not advance, or is refused.
    GroundStampsStale = 3, "ground_stamps_stale";
    /// The suit's adapter has ended by itself; it is started again.
    SuitAdapterDown = 4, "suit_adapter_down";
    /// The ground's adapter has ended by itself; it is started again.
    GroundAdapterDown = 5, "ground_adapter_down";
    /// A ring before the loop was full: samples were lost.
    InputOverflow = 6, "input_overflow";
    /// The ring behind the loop was full: states were lost.
    OutputOverflow = 7, "output_overflow";
    /// Device time is not tied to host time, or the host's own clock is not to be trusted.
    ClockTrouble = 8, "clock_trouble";
    /// A cycle was ready only after the next was due.
    DeadlineMissed = 9, "deadline_missed";
    /// The loop stood still for many periods.
    LoopStalled = 10, "loop_stalled";
    /// Real time was asked for and not granted.
    RealTimeRefused = 11, "real_time_refused";
    /// The loop took page faults after its warm-up.
    PageFaults = 12, "page_faults";
    /// A participant of the bus was killed and has been cleared away.
    ParticipantDied = 13, "participant_died";
    /// What is measured is no longer what the model predicts of this worker.
    ModelNoLongerExplains = 14, "model_no_longer_explains";
    /// What was learnt cannot be written to disk.
    NotSaved = 15, "not_saved";
    /// The latency log or a flight record cannot be written.
    LatencyNotLogged = 16, "latency_not_logged";
    /// The configuration was read again and refused; the one before stays in force.
    ReloadRefused = 17, "reload_refused";
    /// Where the worker stands on the plate is not known.
    PlaceUnknown = 18, "place_unknown";
    /// What the ground's devices show no body does, or no working device.
    GroundImplausible = 19, "ground_implausible";
    /// What the suit shows no body does, or no working suit.
    SuitImplausible = 20, "suit_implausible";
    /// The ground carries less than the body weighs, and this lasts.
    WeightMissing = 21, "weight_missing";
    /// The ground carries an external load that is not in the hands, and this lasts.
    LoadElsewhere = 22, "load_elsewhere";
}

impl Incidents {
    /// The kinds that go on now.
    pub fn active(&self) -> impl Iterator<Item = Incident> {
        let active = self.active;
        Incident::ALL.iter().copied().filter(move |kind| active & (1 << *kind as u32) != 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_indices_and_names_are_distinct() {
        for (index, kind) in Incident::ALL.iter().enumerate() {
            assert_eq!(*kind as usize, index);
            assert!(index < KINDS_MAX);
            assert!(kind.name().bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'_'));
            assert!(Incident::ALL[..index].iter().all(|other| other.name() != kind.name()));
        }
    }
}
