//! Converts states and suit samples to observations of a person standing on a plate.
//!
//! The centre of mass comes from the suit's own world frame and the table of an average body, not from the daemon's
//! estimate: the daemon may be identifying this subject at the same time, and with a wrong plate frame its estimate
//! absorbs the frame's error; holding the feet to the floor also removes a part of every step.

use std::collections::VecDeque;

use equipoise_adapters::calibration::register::Hold;
use equipoise_adapters::calibration::register::holds::Observation;
use equipoise_core::body::{Anthropometry, SEGMENTS, Segment, Sex, Side, Skeleton};
use equipoise_core::message::{State, SuitSample, Validity};
use nalgebra::Vector3;

/// Suit samples kept until the matching state arrives: one second at 240 Hz.
const BODIES_MAX: usize = 256;
/// The slowest suit sends a sample every 17 ms, so the nearest sample is at most this far away.
const TIME_DIFFERENCE_MAX_NS: u64 = 10_000_000;

/// Position of a person according to a suit sample, in the suit's own world frame.
#[derive(Debug, Clone, Copy)]
struct Body {
    time_ns: u64,
    centre_m: Vector3<f64>,
    heading_rad: f64,
}

/// Matches states with suit samples.
#[derive(Debug)]
pub struct Standing {
    height_m: f64,
    sex: Sex,
    bodies: VecDeque<Body>,
    returned_ns: u64,
}

impl Standing {
    /// For a body of the given stature (m) and sex.
    pub fn new(height_m: f64, sex: Sex) -> Standing {
        Standing { height_m, sex, bodies: VecDeque::new(), returned_ns: 0 }
    }

    /// Ingests a suit sample.
    pub fn suit(&mut self, sample: &SuitSample) {
        let pose = sample.pose();
        let table = Anthropometry::de_leva(&Skeleton::of(&pose), self.height_m, self.sex);
        let centre_m = (0..SEGMENTS)
            .map(|index| pose.point_on(Segment::ALL[index], table.com_m[index]) * table.mass_fraction[index])
            .sum();
        let heading: Vector3<f64> =
            Side::BOTH.map(|side| pose.world_from_segment[side.foot().index()] * Vector3::x()).iter().sum();
        if self.bodies.len() == BODIES_MAX {
            self.bodies.pop_front();
        }
        self.bodies.push_back(Body {
            time_ns: sample.sample_time_ns,
            centre_m,
            heading_rad: heading.y.atan2(heading.x),
        });
    }

    /// The observation that belongs to a state; `None` if it was returned before or no matching suit sample is
    /// available.
    pub fn state(&mut self, state: &State) -> Option<Observation> {
        let time_ns = state.suit_sample_time_ns;
        if time_ns <= self.returned_ns {
            return None;
        }
        // The loop may have corrected the sample's time by a model's lag, so exact equality is not required; the
        // position of a person standing still is the same in the nearest sample.
        let difference_ns = |body: &&Body| body.time_ns.abs_diff(time_ns);
        let body = self
            .bodies
            .iter()
            .min_by_key(difference_ns)
            .filter(|body| difference_ns(body) <= TIME_DIFFERENCE_MAX_NS)?;
        self.returned_ns = time_ns;
        let invalid = state.validity().any_of(Validity::INVALIDATES_COP_MEASURED.and(Validity::SUIT_STALE));
        Some(Observation {
            time_ns,
            stance: state.stance,
            still: state.static_pose == 1 && !invalid,
            values: Hold {
                measured_m: state.cop_measured_m,
                expected_m: [body.centre_m.x, body.centre_m.y],
                heading_rad: body.heading_rad,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::frame::wxyz;
    use nalgebra::UnitQuaternion;

    #[test]
    fn an_upright_body_is_above_its_pelvis_in_a_shifted_world() {
        let mut standing = Standing::new(1.77, Sex::Male);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.5);
        let t_pose = Skeleton::nominal(1.77).t_pose_m();
        let mut sample: SuitSample = Zeroable::zeroed();
        sample.sample_time_ns = 77;
        sample.orientation_wxyz = [wxyz(&turn); SEGMENTS];
        sample.position_m = t_pose.map(|at| (turn * Vector3::from(at)).into());
        standing.suit(&sample);
        let mut state: State = Zeroable::zeroed();
        (state.suit_sample_time_ns, state.static_pose, state.stance) = (77, 1, 3);
        state.segment_origin_m[0] = [0.5, -0.25, 1.0];
        state.cop_measured_m = [0.1, 0.2];
        let standing_sample = standing.state(&state).unwrap();
        assert!(standing_sample.still && standing_sample.stance == 3);
        assert_eq!(standing_sample.values.measured_m, [0.1, 0.2]);
        assert!((standing_sample.values.heading_rad - 0.5).abs() < 1e-9);
        // A model's lag has moved the next state's time back.
        sample.sample_time_ns += 1_000_000_000;
        standing.suit(&sample);
        state.suit_sample_time_ns = sample.sample_time_ns - 8_000_000;
        assert!(standing.state(&state).is_some());
        state.suit_sample_time_ns = sample.sample_time_ns - 500_000_000;
        assert!(standing.state(&state).is_none(), "no suit sample near that time");
        // The centre of mass lies slightly in front of the pelvis, along the body's heading.
        let [x, y] = standing_sample.values.expected_m;
        let forward = (turn.inverse() * (Vector3::new(x, y, 0.0) - turn * Vector3::from(t_pose[0]))).xy();
        assert!(forward.y.abs() < 1e-3 && forward.x.abs() < 0.05, "{forward}");
        assert!(standing.state(&state).is_none(), "returned once");
        state.suit_sample_time_ns = 78;
        assert!(standing.state(&state).is_none(), "no sample after the last state");
    }
}
