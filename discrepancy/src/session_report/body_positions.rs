//! Positions of the body over time, reduced to a bounded number for drawing.

use equipoise_core::body::{JOINTS, Joint, SEGMENTS};
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use equipoise_view::levels::severity;
use equipoise_view::words;

use crate::constants::{BODY_INTERVAL_S, BODY_POSITIONS_MAX};

/// The body at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPosition {
    /// Time since the start of the recording, s.
    pub time_s: f64,
    /// Segment origins, world, m.
    pub origin_m: [[f64; 3]; SEGMENTS],
    /// The joint closest to its limit, its limit ratio and the 1-σ of the ratio; `None` while torques are invalid.
    pub worst: Option<(Joint, [f64; 2])>,
    /// Level of each joint; `Level::None` while torques are invalid.
    pub levels: [Level; JOINTS],
    /// Mass of the load and its 1-σ, kg; `None` while it is invalid.
    pub load_kg: Option<[f64; 2]>,
    /// The first reason why torques are withheld, faults first.
    pub withheld: Option<&'static str>,
}

impl BodyPosition {
    /// `None` while the pose is invalid.
    fn of(state: &State, time_s: f64, worst: Option<(Joint, [f64; 2])>) -> Option<BodyPosition> {
        let origin_m = *state.segment_origin_m()?;
        let is_valid = !state.validity().any_of(Validity::INVALIDATES_TORQUES);
        let level = |number: u32| Level::from_number(number).filter(|_| is_valid).unwrap_or(Level::None);
        let load_kg = [state.lifted_mass_kg, state.lifted_mass_sigma_kg];
        origin_m.iter().flatten().all(|value| value.is_finite()).then(|| BodyPosition {
            time_s,
            origin_m,
            worst,
            levels: state.joint_level.map(level),
            load_kg: state.unless(Validity::INVALIDATES_LIFTED_MASS, load_kg).filter(|[kg, _]| *kg > 0.0),
            withheld: words::reasons(state).first().map(|reason| reason.name),
        })
    }

    /// The highest level of all joints.
    pub fn highest_level(&self) -> Level {
        self.levels.into_iter().max_by_key(|level| severity(*level)).unwrap_or(Level::None)
    }

    fn limit_ratio(&self) -> Option<f64> {
        limit_ratio(self.worst)
    }
}

/// Positions by time: of each interval the one at which a joint was closest to its limit, or else the first one.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyPositions {
    positions: Vec<BodyPosition>,
    interval_s: f64,
}

impl Default for BodyPositions {
    fn default() -> BodyPositions {
        BodyPositions { positions: Vec::new(), interval_s: BODY_INTERVAL_S }
    }
}

impl BodyPositions {
    /// Adds one state.
    pub fn ingest(&mut self, state: &State, time_s: f64) {
        let (interval_s, worst) = (self.interval_s, worst(state));
        match self.positions.last_mut().filter(|last| is_same(last.time_s, time_s, interval_s)) {
            Some(last) if limit_ratio(worst) <= last.limit_ratio() => {}
            Some(last) => *last = BodyPosition::of(state, time_s, worst).unwrap_or(*last),
            None => self.positions.extend(BodyPosition::of(state, time_s, worst)),
        }
        while self.positions.len() > BODY_POSITIONS_MAX {
            self.widen();
        }
    }

    /// Doubles the interval.
    fn widen(&mut self) {
        self.interval_s *= 2.0;
        let interval_s = self.interval_s;
        self.positions.dedup_by(|next, kept| {
            let is_same = is_same(next.time_s, kept.time_s, interval_s);
            if is_same && next.limit_ratio() > kept.limit_ratio() {
                *kept = *next;
            }
            is_same
        });
    }

    /// The positions, by time.
    pub fn positions(&self) -> &[BodyPosition] {
        &self.positions
    }

    /// Length of an interval, s.
    pub fn interval_s(&self) -> f64 {
        self.interval_s
    }

    /// Index of the position at which a joint was closest to its limit; 0 without a valid torque.
    pub fn worst(&self) -> usize {
        let ratios =
            self.positions.iter().enumerate().filter_map(|(index, at)| Some((index, at.limit_ratio()?)));
        ratios.max_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(index, _)| index)
    }
}

/// The joint closest to its limit, its limit ratio and the 1-σ of the ratio.
fn worst(state: &State) -> Option<(Joint, [f64; 2])> {
    let number = state.unless(Validity::INVALIDATES_TORQUES, state.worst_joint)?;
    let joint = *Joint::ALL.get(number as usize)?;
    let limit_nm = state.torque_limit_nm[joint.index()];
    let torque_nm = [words::torque_nm(state, joint), state.torque_sigma_nm[joint.index()]];
    (limit_nm > 0.0).then(|| (joint, torque_nm.map(|torque_nm| torque_nm / limit_nm)))
}

fn limit_ratio(worst: Option<(Joint, [f64; 2])>) -> Option<f64> {
    worst.map(|(_, [limit_ratio, _])| limit_ratio)
}

/// Whether two times are in the same interval.
fn is_same(a_s: f64, b_s: f64, interval_s: f64) -> bool {
    (a_s / interval_s).floor() == (b_s / interval_s).floor()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn state(torque_nm: f64) -> State {
        let mut state = State { suit_sample_time_ns: 1, worst_joint: 3, ..State::zeroed() };
        (state.torque_nm[3], state.torque_limit_nm[3]) = ([0.0, torque_nm, 0.0], 100.0);
        (state.torque_sigma_nm[3], state.joint_level[3]) = (5.0, Level::Red as u32);
        state
    }

    #[test]
    fn the_number_is_bounded_and_the_highest_load_remains() {
        let mut body = BodyPositions::default();
        for sample in 0..100_000 {
            // One sample in 1000 s has the highest load.
            let torque_nm = if sample == 43_217 { 90.0 } else { f64::from(sample % 80) };
            body.ingest(&state(torque_nm), f64::from(sample) / 100.0);
        }
        let count = body.positions().len();
        assert!((BODY_POSITIONS_MAX / 2..=BODY_POSITIONS_MAX).contains(&count), "{count}");
        assert!(body.positions().windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
        let worst = body.positions()[body.worst()];
        assert_eq!((worst.time_s, worst.worst), (432.17, Some((Joint::ALL[3], [0.9, 0.05]))));
        assert_eq!(worst.highest_level(), Level::Red);
    }

    #[test]
    fn invalid_poses_are_absent_and_invalid_torques_have_a_reason() {
        let mut body = BodyPositions::default();
        let stale = State { valid: Validity::SUIT_STALE.0, ..state(90.0) };
        let moving = State { valid: Validity::MOVING.0, lifted_mass_kg: 4.0, ..state(90.0) };
        for (time_s, state) in
            [(0.0, stale), (1.0, moving), (2.0, State { suit_sample_time_ns: 0, ..moving })]
        {
            body.ingest(&state, time_s);
        }
        let [position] = body.positions() else { panic!("{body:?}") };
        assert_eq!((position.time_s, position.worst, position.load_kg), (1.0, None, None));
        assert_eq!((position.highest_level(), position.withheld), (Level::None, Some("moving")));
    }
}
