//! Sample times of the forces in a frame: QTM stamps camera frames, and a plate samples faster.

use crate::ground::reading::Decoded;
use crate::ground::refusal::GroundRefusal;
use crate::wire::qtm::{Frame, PlateForce};

const NS_PER_US: u64 = 1000;
/// A longer gap, in frames, is no loss: QTM was stopped and resumed. QTM does not report its frame period.
const LOST_MAX: u64 = 10_000;

/// A force and its sample time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Due {
    pub(super) force: PlateForce,
    pub(super) time_ns: u64,
    pub(super) counter: u32,
}

/// Distributes the forces of a frame over its interval, and counts missing frames.
#[derive(Debug, Clone)]
pub(super) struct Pace {
    divisor: u32,
    newest: Option<Stamp>,
    /// Interval between sent frames; available from the second frame on.
    interval_us: Option<u64>,
    /// The first frame's forces, until the interval is available.
    held: Option<(Stamp, u32, Vec<PlateForce>)>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp {
    timestamp_us: u64,
    number: u32,
}

impl Pace {
    pub(super) fn new(divisor: u32) -> Pace {
        Pace { divisor: divisor.max(1), newest: None, interval_us: None, held: None }
    }

    /// Discards all stamps, for a new connection or measurement.
    pub(super) fn reset(&mut self) {
        *self = Pace::new(self.divisor);
    }

    /// The forces whose times are determined, oldest first. `first` is the number of this frame's first force.
    pub(super) fn frame(
        &mut self,
        frame: &Frame<'_>,
        first: u32,
        forces: Vec<PlateForce>,
        decoded: &mut Decoded,
    ) -> Vec<Due> {
        let stamp = Stamp { timestamp_us: frame.timestamp_us, number: frame.number };
        match self.newest {
            Some(newest) if newest.timestamp_us == stamp.timestamp_us => {
                decoded.refuse(GroundRefusal::Duplicate);
                return Vec::new();
            }
            // Time decreased: another measurement.
            Some(newest) if newest.timestamp_us > stamp.timestamp_us => self.reset(),
            Some(newest) => self.follow(newest, stamp, forces.len(), decoded),
            None => {}
        }
        self.newest = Some(stamp);
        let mut due = Vec::new();
        if forces.len() > 1 && self.interval_us.is_none() {
            if let Some((_, _, never_timed)) = self.held.replace((stamp, first, forces)) {
                decoded.lost(u32::try_from(never_timed.len()).unwrap_or(u32::MAX));
            }
            return due;
        }
        if let Some((stamp, first, forces)) = self.held.take() {
            self.spread(stamp, first, &forces, &mut due);
        }
        self.spread(stamp, first, &forces, &mut due);
        if let (Some(interval_us), 2..) = (self.interval_us, forces.len()) {
            decoded.block_latency(interval_us.saturating_mul(NS_PER_US));
        }
        due
    }

    fn follow(&mut self, newest: Stamp, stamp: Stamp, forces: usize, decoded: &mut Decoded) {
        let elapsed_us = stamp.timestamp_us - newest.timestamp_us;
        let steps = u64::from(stamp.number.wrapping_sub(newest.number)) / u64::from(self.divisor);
        let lost = match (stamp.number == newest.number, self.interval_us) {
            // In preview QTM does not count frames, so the loss follows from the time.
            (true, Some(interval_us)) => {
                (elapsed_us.saturating_add(interval_us / 2) / interval_us.max(1)).saturating_sub(1)
            }
            (true, None) => 0,
            (false, _) => steps.saturating_sub(1),
        };
        if lost > LOST_MAX {
            return;
        }
        self.interval_us = Some((elapsed_us / (lost + 1)).max(1));
        if lost > 0 {
            decoded.lost(u32::try_from(lost.saturating_mul(forces as u64)).unwrap_or(u32::MAX));
        }
    }

    fn spread(&self, stamp: Stamp, first: u32, forces: &[PlateForce], due: &mut Vec<Due>) {
        let interval_ns = self.interval_us.unwrap_or(0).saturating_mul(NS_PER_US);
        due.extend(forces.iter().zip(0_u32..).map(|(force, index)| {
            Due {
                force: *force,
                time_ns: stamp
                    .timestamp_us
                    .saturating_mul(NS_PER_US)
                    .saturating_add(interval_ns / forces.len() as u64 * u64::from(index)),
                counter: first.wrapping_add(index),
            }
        }));
    }
}
