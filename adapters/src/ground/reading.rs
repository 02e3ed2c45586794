//! What a device's file hands to the receiver: one reading in the sensor's own axes and by the device's own clock.

use super::frame::Wrench;
use super::refusal::GroundRefusal;

/// One reading of a device, before place and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Counts what the device sends, one by one, wrapping: gaps are loss, steps back disorder. `None` if it does not
    /// count; its order is that of its coming, and its file tells loss by [`Taken::lost`].
    pub sequence: Option<u32>,
    /// The device's clock.
    pub tick: Tick,
    /// What the device calls the sample; handed on as it is.
    pub device_counter: u32,
    /// The device's status word; not zero means that the sample must not be used.
    pub status: u32,
    /// What it measured.
    pub load: Load,
}

/// When a reading was taken, by the device. The steps may have any length, as long as all have the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tick {
    /// Counts measurements, sent or not, and wraps at 2³². A step back means that the device was restarted.
    Counter(u32),
    /// The device's time, or a count that never wraps. A step back means that the device was restarted.
    Time(u64),
    /// It says nothing of time and order: readings are counted as they come, lost ones by [`Taken::lost`] included.
    Uncounted,
}

/// What was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// Force and moment about the sensor's origin, in its axes.
    Wrench(Wrench),
    /// The same, of a device that feels only a part of it.
    Part {
        /// About the sensor's origin, in its axes; zero where nothing is measured.
        wrench: Wrench,
        /// What it does not feel: a union of [`Component`](equipoise_core::message::Component) bits.
        not_measured: u32,
    },
    /// What presses on the left and the right sole; insoles feel neither shear nor turning.
    Soles([FootLoad; 2]),
}

/// What presses on one sole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FootLoad {
    /// Force on the foot, N.
    pub vertical_n: f64,
    /// Centre of pressure from the middle of the sole, X to its tip, Y to the left, m; zero without force.
    pub cop_m: [f64; 2],
}

impl Load {
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        match self {
            Load::Wrench(wrench) | Load::Part { wrench, .. } => {
                wrench.force_n.iter().chain(&wrench.moment_nm).all(|x| x.is_finite())
            }
            Load::Soles(feet) => feet
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
            Load::Soles(feet) => feet.iter().all(|foot| {
                foot.vertical_n.abs() <= largest && foot.cop_m.iter().all(|metres| metres.abs() <= 1.0)
            }),
        }
    }
}

/// What a device's file found in the bytes it was given, in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Taken {
    pub(super) found: Vec<Found>,
    pub(super) block_latency_ns: Option<u64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Found {
    Reading(Reading),
    Refused(GroundRefusal),
    Lost(u32),
    Restarted,
    Rebooted,
}

impl Taken {
    /// A sound reading.
    pub fn reading(&mut self, reading: Reading) {
        self.found.push(Found::Reading(reading));
    }

    /// Something that could not be used, counted by reason.
    pub fn refuse(&mut self, reason: GroundRefusal) {
        self.found.push(Found::Refused(reason));
    }

    /// So many readings are missing here: for devices whose loss does not show in [`Reading::sequence`].
    pub fn lost(&mut self, readings: u32) {
        self.found.push(Found::Lost(readings));
    }

    /// The stream begins anew here: whatever sequence comes next is the first.
    pub fn restarted(&mut self) {
        self.found.push(Found::Restarted);
    }

    /// The device's clock begins anew here, in a way that does not show in [`Reading::tick`].
    pub fn rebooted(&mut self) {
        self.found.push(Found::Rebooted);
    }

    /// The device gathers readings for so long before it sends them as a block.
    pub fn block_latency(&mut self, nanoseconds: u64) {
        self.block_latency_ns = Some(nanoseconds);
    }

    /// The readings alone, for tests of a device's file.
    pub fn readings(&self) -> impl Iterator<Item = &Reading> {
        self.found.iter().filter_map(|found| match found {
            Found::Reading(reading) => Some(reading),
            _ => None,
        })
    }

    /// What was refused, for tests of a device's file.
    pub fn refusals(&self) -> impl Iterator<Item = GroundRefusal> {
        self.found.iter().filter_map(|found| match found {
            Found::Refused(reason) => Some(*reason),
            _ => None,
        })
    }
}
