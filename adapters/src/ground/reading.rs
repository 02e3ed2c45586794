//! Interface between device decoders and the receiver: one reading in the sensor's own axes and on the device's own
//! clock.

use super::frame::Wrench;
use super::refusal::GroundRefusal;

/// One reading of a device, before the transformation to world frame and host time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Count of what the device sends, wrapping: gaps are losses, steps back disorder. `None` if the device does not
    /// count; the order is then that of arrival, and the decoder reports losses with [`Decoded::lost`].
    pub sequence: Option<u32>,
    /// The device's clock.
    pub tick: Tick,
    /// The device's own sample number; passed on unchanged.
    pub device_counter: u32,
    /// The device's status word; a sample with a nonzero status must not be used.
    pub status: u32,
    /// The measured quantities.
    pub load: Load,
}

/// Device time of a reading. Ticks may have any length, as long as it is constant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tick {
    /// Count of measurements, sent or not, wrapping at 2³². A step back means that the device was restarted.
    Counter(u32),
    /// The device's time, or a count that never wraps. A step back means that the device was restarted.
    Time(u64),
    /// No time or order: readings are counted on arrival, including those reported by [`Decoded::lost`].
    Uncounted,
}

/// Measured quantities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// Force and moment about the sensor's origin, in its axes.
    Wrench(Wrench),
    /// The same, of a device that measures only some components.
    Part {
        /// About the sensor's origin, in its axes; zero for components that are not measured.
        wrench: Wrench,
        /// Components that are not measured: a union of [`Component`](equipoise_core::message::Component) bits.
        not_measured: u32,
    },
    /// Vertical force on the left and the right sole; insoles measure neither shear nor free moment.
    Insoles([FootLoad; 2]),
}

/// Load on one sole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FootLoad {
    /// Force on the foot, N.
    pub vertical_n: f64,
    /// Centre of pressure from the middle of the sole, X toward the toes, Y to the left, m; zero without force.
    pub cop_m: [f64; 2],
}

impl Load {
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        match self {
            Load::Wrench(wrench) | Load::Part { wrench, .. } => {
                wrench.force_n.iter().chain(&wrench.moment_nm).all(|x| x.is_finite())
            }
            Load::Insoles(feet) => feet
                .iter()
                .all(|foot| foot.vertical_n.is_finite() && foot.cop_m.iter().all(|m| m.is_finite())),
        }
    }

    /// Whether no force (N), moment (N m) or distance (m) is larger than `largest`.
    pub fn is_within(&self, largest: f64) -> bool {
        match self {
            Load::Wrench(wrench) | Load::Part { wrench, .. } => {
                wrench.force_n.iter().chain(&wrench.moment_nm).all(|number| number.abs() <= largest)
            }
            Load::Insoles(feet) => feet.iter().all(|foot| {
                foot.vertical_n.abs() <= largest && foot.cop_m.iter().all(|metres| metres.abs() <= 1.0)
            }),
        }
    }
}

/// Results of a decoder for the bytes it was given, in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Decoded {
    pub(super) events: Vec<DecoderEvent>,
    pub(super) block_latency_ns: Option<u64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum DecoderEvent {
    Reading(Reading),
    Refused(GroundRefusal),
    Lost(u32),
    Restarted,
    Rebooted,
}

impl Decoded {
    /// Adds a valid reading.
    pub fn reading(&mut self, reading: Reading) {
        self.events.push(DecoderEvent::Reading(reading));
    }

    /// Adds unusable input, counted by reason.
    pub fn refuse(&mut self, reason: GroundRefusal) {
        self.events.push(DecoderEvent::Refused(reason));
    }

    /// Reports missing readings at this point, for devices whose loss does not show in [`Reading::sequence`].
    pub fn lost(&mut self, readings: u32) {
        self.events.push(DecoderEvent::Lost(readings));
    }

    /// The stream restarts here: the next sequence number is the first, at any value.
    pub fn restarted(&mut self) {
        self.events.push(DecoderEvent::Restarted);
    }

    /// The device's clock restarts here, in a way that does not show in [`Reading::tick`].
    pub fn rebooted(&mut self) {
        self.events.push(DecoderEvent::Rebooted);
    }

    /// Sets the duration of the blocks in which the device collects readings before it sends them.
    pub fn block_latency(&mut self, nanoseconds: u64) {
        self.block_latency_ns = Some(nanoseconds);
    }

    /// The readings alone, for tests of decoders.
    pub fn readings(&self) -> impl Iterator<Item = &Reading> {
        self.events.iter().filter_map(|event| match event {
            DecoderEvent::Reading(reading) => Some(reading),
            _ => None,
        })
    }

    /// The refusals, for tests of decoders.
    pub fn refusals(&self) -> impl Iterator<Item = GroundRefusal> {
        self.events.iter().filter_map(|event| match event {
            DecoderEvent::Refused(reason) => Some(*reason),
            _ => None,
        })
    }
}
