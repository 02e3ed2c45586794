//! Detects intervals of quiet standing in a stream of samples, each at a position different from the earlier ones.

use super::Hold;

/// Duration of a hold, ns.
const HOLD_NS: u64 = 2_000_000_000;
/// A longer interval between samples is a gap, ns.
const GAP_NS: u64 = 300_000_000;
/// Distance, m, or rotation, rad, from which a position counts as another one.
const STEP_M: f64 = 0.08;
const STEP_RAD: f64 = 0.35;

/// One sample of a person on a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Sample time, ns.
    pub time_ns: u64,
    /// Stance number: it increments with every step.
    pub stance: u32,
    /// Whether the pose is static.
    pub still: bool,
    /// The quantities that a hold averages.
    pub values: Hold,
}

/// Collects holds.
#[derive(Debug, Clone, Default)]
pub struct Holds {
    completed: Vec<Hold>,
    since_ns: u64,
    newest: Option<Observation>,
    sum: Option<(Hold, f64, [f64; 2])>,
}

/// State of the detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// The subject moves.
    Moving,
    /// Static, at a position that was already used.
    AlreadyUsed,
    /// Static, with the remaining time.
    Holding {
        /// Remaining time, s.
        remaining_s: f64,
    },
    /// A hold was completed.
    Completed(Hold),
}

impl Holds {
    /// The holds so far.
    pub fn completed(&self) -> &[Hold] {
        &self.completed
    }

    /// Processes the next sample.
    pub fn ingest(&mut self, observation: Observation) -> Progress {
        let continues = self.newest.is_some_and(|newest| {
            newest.still
                && newest.stance == observation.stance
                && observation.time_ns > newest.time_ns
                && observation.time_ns - newest.time_ns < GAP_NS
        });
        self.newest = Some(observation);
        if !observation.still {
            self.sum = None;
            return Progress::Moving;
        }
        if !continues || self.sum.is_none() {
            self.since_ns = observation.time_ns;
            self.sum = None;
        }
        let mean = self.add(&observation.values);
        if self.completed.iter().any(|earlier| is_same_position(earlier, &mean)) {
            return Progress::AlreadyUsed;
        }
        let held_ns = observation.time_ns - self.since_ns;
        if held_ns < HOLD_NS {
            return Progress::Holding { remaining_s: (HOLD_NS - held_ns) as f64 * 1e-9 };
        }
        self.completed.push(mean);
        Progress::Completed(mean)
    }

    /// Adds a sample to the mean and returns the mean.
    fn add(&mut self, values: &Hold) -> Hold {
        let (mut sum, count, mut directions) = self.sum.unwrap_or((
            Hold { measured_m: [0.0; 2], expected_m: [0.0; 2], heading_rad: 0.0 },
            0.0,
            [0.0; 2],
        ));
        for axis in 0..2 {
            sum.measured_m[axis] += values.measured_m[axis];
            sum.expected_m[axis] += values.expected_m[axis];
        }
        directions[0] += values.heading_rad.cos();
        directions[1] += values.heading_rad.sin();
        self.sum = Some((sum, count + 1.0, directions));
        let mean = |sum_m: [f64; 2]| sum_m.map(|metres| metres / (count + 1.0));
        Hold {
            measured_m: mean(sum.measured_m),
            expected_m: mean(sum.expected_m),
            heading_rad: directions[1].atan2(directions[0]),
        }
    }
}

fn is_same_position(one: &Hold, other: &Hold) -> bool {
    let apart_m =
        f64::hypot(one.measured_m[0] - other.measured_m[0], one.measured_m[1] - other.measured_m[1]);
    let turned = one.heading_rad - other.heading_rad;
    apart_m < STEP_M && f64::atan2(turned.sin(), turned.cos()).abs() < STEP_RAD
}
