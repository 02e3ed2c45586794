//! Detects intervals of quiet standing in a stream of samples, each at a position different from the earlier ones.

use super::Hold;

/// Duration of a hold, ns.
const HOLD_NS: u64 = 2_000_000_000;
/// A longer interval between samples is a gap, ns.
const GAP_NS: u64 = 300_000_000;
/// Minimum distance, m, or rotation, rad, that makes another position.
const ELSEWHERE: (f64, f64) = (0.08, 0.35);

/// One sample of a person on a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Sample time, ns.
    pub time_ns: u64,
    /// Stance number: it increments with every step.
    pub stance: u32,
    /// Whether the pose is static.
    pub still: bool,
    /// The quantities that a hold averages.
    pub seen: Hold,
}

/// Collects holds.
#[derive(Debug, Clone, Default)]
pub struct Holds {
    found: Vec<Hold>,
    since_ns: u64,
    newest: Option<Moment>,
    sum: Option<(Hold, f64, [f64; 2])>,
}

/// State of the detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// The subject moves.
    Moving,
    /// Static, at a position that was already used.
    Known,
    /// Static, with the remaining time.
    Holding {
        /// Remaining time, s.
        left_s: f64,
    },
    /// A hold was completed.
    Got(Hold),
}

impl Holds {
    /// The holds so far.
    pub fn found(&self) -> &[Hold] {
        &self.found
    }

    /// Processes the next sample.
    pub fn take(&mut self, moment: Moment) -> Progress {
        let goes_on = self.newest.is_some_and(|newest| {
            newest.still
                && newest.stance == moment.stance
                && moment.time_ns > newest.time_ns
                && moment.time_ns - newest.time_ns < GAP_NS
        });
        self.newest = Some(moment);
        if !moment.still {
            self.sum = None;
            return Progress::Moving;
        }
        if !goes_on || self.sum.is_none() {
            self.since_ns = moment.time_ns;
            self.sum = None;
        }
        let mean = self.add(&moment.seen);
        if self.found.iter().any(|known| is_same_place(known, &mean)) {
            return Progress::Known;
        }
        let held_ns = moment.time_ns - self.since_ns;
        if held_ns < HOLD_NS {
            return Progress::Holding { left_s: (HOLD_NS - held_ns) as f64 * 1e-9 };
        }
        self.found.push(mean);
        Progress::Got(mean)
    }

    /// Adds a sample to the mean and returns the mean.
    fn add(&mut self, seen: &Hold) -> Hold {
        let (mut sum, count, mut looks) = self.sum.unwrap_or((
            Hold { measured_m: [0.0; 2], expected_m: [0.0; 2], heading_rad: 0.0 },
            0.0,
            [0.0; 2],
        ));
        for axis in 0..2 {
            sum.measured_m[axis] += seen.measured_m[axis];
            sum.expected_m[axis] += seen.expected_m[axis];
        }
        looks[0] += seen.heading_rad.cos();
        looks[1] += seen.heading_rad.sin();
        self.sum = Some((sum, count + 1.0, looks));
        let mean = |sum_m: [f64; 2]| sum_m.map(|metres| metres / (count + 1.0));
        Hold {
            measured_m: mean(sum.measured_m),
            expected_m: mean(sum.expected_m),
            heading_rad: looks[1].atan2(looks[0]),
        }
    }
}

fn is_same_place(one: &Hold, other: &Hold) -> bool {
    let apart_m =
        f64::hypot(one.measured_m[0] - other.measured_m[0], one.measured_m[1] - other.measured_m[1]);
    let turned = one.heading_rad - other.heading_rad;
    apart_m < ELSEWHERE.0 && f64::atan2(turned.sin(), turned.cos()).abs() < ELSEWHERE.1
}
