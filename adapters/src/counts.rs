//! What an adapter counts while it works.

use equipoise_core::message::AdapterHealth;
use equipoise_core::message::health::REASONS;

/// Counts since the start of an adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Datagrams or records taken from the wire.
    pub received: u64,
    /// Samples handed on.
    pub published: u64,
    /// Samples the device sent and we never saw.
    pub lost: u64,
    /// What was refused, by reason; the adapter's refusals name the reasons in order.
    pub refused: [u64; REASONS],
}

impl Counts {
    /// One more refusal of a reason. A number beyond the table is not counted; enums of reasons are checked to fit.
    pub(crate) fn refuse(&mut self, reason: usize) {
        if let Some(count) = self.refused.get_mut(reason) {
            *count += 1;
        }
    }
}

/// Which stream an adapter carries, as `AdapterHealth::stream` numbers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// The suit.
    Suit = 1,
    /// The ground.
    Ground = 2,
}

/// Turns counts into the health message, with the rate since the last one.
#[derive(Debug)]
pub(crate) struct HealthReporter {
    stream: Stream,
    last_ns: u64,
    last_published: u64,
}

impl HealthReporter {
    pub(crate) fn new(stream: Stream, now_ns: u64) -> Self {
        HealthReporter { stream, last_ns: now_ns, last_published: 0 }
    }

    pub(crate) fn report(&mut self, counts: &Counts, now_ns: u64) -> AdapterHealth {
        let seconds = now_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        let samples = counts.published.saturating_sub(self.last_published) as f64;
        self.last_ns = now_ns;
        self.last_published = counts.published;
        AdapterHealth {
            time_ns: now_ns,
            received: counts.received,
            published: counts.published,
            lost: counts.lost,
            stream: self.stream as u32,
            process_id: std::process::id(),
            rate_hz: if seconds > 0.0 { samples / seconds } else { 0.0 },
            refused: counts.refused,
            block_latency_ns: 0,
            reserved_tail: 0,
        }
    }
}

/// Declares an enum of reasons with their public names, checked to fit the health message.
macro_rules! refusals {
    ($(#[$doc:meta])* pub enum $Name:ident { $($(#[$reason_doc:meta])* $Reason:ident = $name:literal,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $Name { $($(#[$reason_doc])* $Reason,)* }

        impl $Name {
            /// All reasons in the order of `AdapterHealth::refused`.
            pub const ALL: &'static [$Name] = &[$($Name::$Reason),*];
            /// Their public names, in the same order.
            pub const NAMES: &'static [&'static str] = &[$($name),*];

            /// Place in `AdapterHealth::refused`.
            pub const fn index(self) -> usize {
                self as usize
            }

            /// The public name.
            pub const fn name(self) -> &'static str {
                Self::NAMES[self as usize]
            }
        }

        const _: () = assert!($Name::ALL.len() <= equipoise_core::message::health::REASONS, "the health message has no room");
    };
}
pub(crate) use refusals;
