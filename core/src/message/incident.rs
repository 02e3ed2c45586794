//! Incidents: named faults of a station, with count, begin and end.

use super::layout::{ZeroCopySend, message};

/// Maximum number of kinds in a message.
pub const KINDS_MAX: usize = 32;

message! {
    /// Incidents of the station since the daemon's start; published once per second, and when one begins or ends.
    as "equipoise/Incidents/1", 832 bytes,
    pub struct Incidents {
        /// Time of publication, CLOCK_MONOTONIC ns.
        pub time_ns: u64,
        /// Active incidents: bit n is kind n.
        pub active: u64,
        /// Number of occurrences of each kind.
        pub begun: [u64; KINDS_MAX],
        /// Last begin of each kind, CLOCK_MONOTONIC ns; 0 for never.
        pub last_begun_ns: [u64; KINDS_MAX],
        /// Last end of each kind, CLOCK_MONOTONIC ns; 0 for never.
        pub last_ended_ns: [u64; KINDS_MAX],
        /// Always zero; pads the message to a multiple of 64 bytes.
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

            /// Public name.
            pub const fn name(self) -> &'static str {
                match self { $(Incident::$Kind => $name,)* }
            }
        }
    };
}

kinds! {
    /// The suit sends no data.
    SuitSilent = 0, "suit_silent";
    /// The plate sends no data.
    GroundSilent = 1, "ground_silent";
    /// Suit samples arrive, but their times do not advance or are rejected.
    SuitStampsStale = 2, "suit_stamps_stale";
    /// Ground samples arrive, but their times do not advance or are rejected.
    GroundStampsStale = 3, "ground_stamps_stale";
    /// The suit's adapter ended unexpectedly; it is restarted.
    SuitAdapterDown = 4, "suit_adapter_down";
    /// The ground's adapter ended unexpectedly; it is restarted.
    GroundAdapterDown = 5, "ground_adapter_down";
    /// A ring before the loop was full: samples were lost.
    InputOverflow = 6, "input_overflow";
    /// The ring after the loop was full: states were lost.
    OutputOverflow = 7, "output_overflow";
    /// Device time is not tied to host time, or the host's clock is unreliable.
    ClockFault = 8, "clock_fault";
    /// A state was complete only after the next cycle's due time.
    DeadlineMissed = 9, "deadline_missed";
    /// The loop did not run for many periods.
    LoopStalled = 10, "loop_stalled";
    /// The requested real-time scheduling was not granted.
    RealTimeRefused = 11, "real_time_refused";
    /// The loop had page faults after its warm-up.
    PageFaults = 12, "page_faults";
    /// A participant of the bus was killed, and its resources were removed.
    ParticipantDied = 13, "participant_died";
    /// The measurements of this subject no longer agree with the model's predictions.
    ModelMismatch = 14, "model_mismatch";
    /// The state cannot be written to disk.
    NotSaved = 15, "not_saved";
    /// The latency log or a flight record cannot be written.
    LatencyNotLogged = 16, "latency_not_logged";
    /// A reloaded configuration was rejected; the previous one stays active.
    ReloadRefused = 17, "reload_refused";
    /// The subject's position on the plate is unavailable.
    PositionUnknown = 18, "position_unknown";
    /// The ground's readings are implausible for a body or a working device.
    GroundImplausible = 19, "ground_implausible";
    /// The suit's poses are implausible for a body or a working suit.
    SuitImplausible = 20, "suit_implausible";
    /// The ground force has been less than the body weight for a long time.
    WeightMissing = 21, "weight_missing";
    /// An external load has been far from the hands for a long time.
    LoadNotAtHands = 22, "load_not_at_hands";
}

impl Incidents {
    /// The active kinds.
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
