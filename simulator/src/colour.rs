//! Pose- and time-dependent sensor errors, which make residuals coloured and cause false detections in clean data.

use equipoise_core::body::{SEGMENTS, Segment, Side};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::dynamics::Wrench;
use crate::kinematics::{Rotations, relative_to_parents};
use crate::motion::BodyState;
use crate::random::{Coloured, Random};

/// Sizes of a suit's coloured errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuitColours {
    /// Standard deviation of each element of the map from a joint's angle (rad) to the rotation of the sensor on the
    /// soft tissue (rad); half of it for the legs, a third for pelvis and feet, where there is more bone.
    pub soft_tissue: f64,
    /// Standard deviation of each segment's slow rotation about the vertical, rad.
    pub heading_rad: f64,
    /// Range of its correlation time, s.
    pub heading_tau_s: [f64; 2],
    /// Standard deviation per axis of each sample's own error, rad.
    pub white_rad: f64,
}

impl SuitColours {
    /// About 3 % of a joint's angle, 1° of heading over half a minute, hundredths of a degree from sample to sample.
    pub const ORDINARY: SuitColours = SuitColours {
        soft_tissue: 0.03,
        heading_rad: 0.0175,
        heading_tau_s: [25.0, 60.0],
        white_rad: 0.00035,
    };

    /// All errors scaled by a factor.
    #[must_use]
    pub fn times(self, factor: f64) -> SuitColours {
        SuitColours {
            soft_tissue: self.soft_tissue * factor,
            heading_rad: self.heading_rad * factor,
            white_rad: self.white_rad * factor,
            ..self
        }
    }
}

/// The coloured errors of one suit.
#[derive(Debug, Clone)]
pub struct SuitColour {
    tissue: [Matrix3<f64>; SEGMENTS],
    heading: Vec<Coloured>,
    white_rad: f64,
    seed: u64,
}

impl SuitColour {
    /// The errors of a seed, over a duration.
    pub fn new(colours: SuitColours, seed: u64, length_s: f64) -> SuitColour {
        let mut random = Random::new(seed, "suit's colour");
        let tissue = std::array::from_fn(|i| {
            let sigma = colours.soft_tissue * looseness(Segment::ALL[i]);
            Matrix3::from_fn(|_, _| sigma * random.normal())
        });
        let [shortest_s, longest_s] = colours.heading_tau_s;
        let heading = (0..SEGMENTS)
            .map(|_| {
                let tau_s = random.between(shortest_s, longest_s);
                Coloured::new(&mut random, colours.heading_rad, tau_s, length_s)
            })
            .collect();
        SuitColour { tissue, heading, white_rad: colours.white_rad, seed }
    }

    /// Continues the errors to a later end; what was before stays the same. Once: a second time would repeat the first.
    pub fn extend(&mut self, length_s: f64) {
        for (number, heading) in (0..).zip(&mut self.heading) {
            heading.extend(&mut Random::numbered(self.seed, "suit's colour, continued", number), length_s);
        }
    }

    /// Rotations with these errors; the joints' angles are the body's own.
    pub fn on(&self, seen: Rotations, body: &BodyState) -> Rotations {
        let joint_rad = joint_rad(body);
        // A random stream for each tenth of a millisecond: the errors of samples are independent.
        let moment = (body.time_s.max(0.0) * 1e4).round() as u32;
        let mut random = Random::numbered(self.seed, "suit's white", moment);
        std::array::from_fn(|i| {
            let slip = self.tissue[i] * joint_rad[i];
            let white = Vector3::from_fn(|_, _| self.white_rad * random.normal());
            let turn = Vector3::z() * self.heading[i].at(body.time_s);
            UnitQuaternion::from_scaled_axis(turn) * seen[i] * UnitQuaternion::from_scaled_axis(slip + white)
        })
    }
}

/// Each segment's rotation relative to its parent, rad; of the pelvis relative to the feet.
pub fn joint_rad(body: &BodyState) -> [Vector3<f64>; SEGMENTS] {
    let mut turns = relative_to_parents(&body.world_from_segment);
    let [left, right] = Side::BOTH.map(|side| body.world_from_segment[side.foot().index()]);
    turns[0] = left.slerp(&right, 0.5).inverse() * turns[0];
    turns.map(|turn| turn.scaled_axis())
}

fn looseness(segment: Segment) -> f64 {
    let index = segment.index();
    if index < Segment::RightUpperLeg.index() {
        return if segment == Segment::Pelvis { 0.3 } else { 1.0 };
    }
    let of_a_foot = Side::BOTH.iter().any(|side| [side.foot(), side.toe()].contains(&segment));
    if of_a_foot { 0.3 } else { 0.5 }
}

/// The coloured errors of a plate.
#[derive(Debug, Clone)]
pub struct PlateColour {
    pressure_m: [Coloured; 2],
    force_n: [Coloured; 3],
}

impl PlateColour {
    /// The errors of a seed, over a duration, scaled by a factor: 0.4 mm over 3 s, 0.8 N over 20 s at factor 1.
    pub fn new(factor: f64, seed: u64, length_s: f64) -> PlateColour {
        let mut random = Random::new(seed, "plate's colour");
        let mut noise = |sigma: f64, tau_s: f64| Coloured::new(&mut random, factor * sigma, tau_s, length_s);
        PlateColour {
            pressure_m: [0.000_4; 2].map(|sigma| noise(sigma, 3.0)),
            force_n: [0.5, 0.5, 0.8].map(|sigma| noise(sigma, 20.0)),
        }
    }

    /// Continues the errors to a later end; what was before stays the same. Once: a second time would repeat the first.
    pub fn extend(&mut self, seed: u64, length_s: f64) {
        for (number, noise) in (0..).zip(self.pressure_m.iter_mut().chain(&mut self.force_n)) {
            noise.extend(&mut Random::numbered(seed, "plate's colour, continued", number), length_s);
        }
    }

    /// A wrench with these errors; the centre of pressure shifts by its own error, not by the force's.
    #[must_use]
    pub fn on(&self, wrench: Wrench, time_s: f64) -> Wrench {
        let [x_m, y_m] = [0, 1].map(|axis: usize| self.pressure_m[axis].at(time_s));
        let more_n = Vector3::from_fn(|axis, _| self.force_n[axis].at(time_s));
        let centre_m = wrench.cop_m().push(0.0);
        let moment_nm = wrench.moment_nm + centre_m.cross(&more_n);
        let force_n = wrench.force_n + more_n;
        Wrench { force_n, moment_nm: moment_nm + Vector3::new(x_m, y_m, 0.0).cross(&force_n) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Habits, Worker};
    use crate::noise::{Suit, SuitNoise};
    use crate::person::Person;
    use crate::repertoire::REPERTOIRE;

    #[test]
    fn a_coloured_suit_errs_by_degrees_and_more_where_joints_are_bent() {
        let mut worker = Worker::with_habits(Person::new(2, 1.77, 72.0), 2, Habits::NONE);
        // The T-pose, where all joints are straight, and then a deep squat.
        worker.intend(&REPERTOIRE[1].1, 0.0, 0.1);
        let squat = REPERTOIRE.iter().find(|(name, _)| *name == "deep squat, arms forward").unwrap();
        worker.intend(&squat.1, 1.0, 1.5);
        let suit = Suit::new(SuitNoise::NONE, 2).with_colour(SuitColour::new(
            SuitColours { heading_rad: 0.0, ..SuitColours::ORDINARY },
            2,
            10.0,
        ));
        let off_deg = |time_s: f64| {
            let body = worker.sample(time_s);
            let (_, seen) = suit.see(worker.person(), &body);
            let sum: f64 = (0..SEGMENTS).map(|i| seen[i].angle_to(&body.world_from_segment[i])).sum();
            sum.to_degrees() / SEGMENTS as f64
        };
        let (straight, bent) = (off_deg(0.5), off_deg(4.0));
        assert!(bent > 3.0 * straight && (0.1..4.0).contains(&bent), "{straight} {bent}");
    }

    #[test]
    fn a_plate_s_colour_moves_pressure_by_less_than_millimetres() {
        let colour = PlateColour::new(1.0, 7, 30.0);
        let still = Wrench::at(Vector3::new(0.04, -0.01, 0.0), Vector3::new(0.0, 0.0, 700.0));
        let mut largest_m = 0.0_f64;
        for step in 0..300 {
            let moved = colour.on(still, 0.1 * f64::from(step));
            largest_m = largest_m.max((moved.cop_m() - still.cop_m()).norm());
            assert!((moved.force_n.z - 700.0).abs() < 5.0);
        }
        assert!((0.000_2..0.004).contains(&largest_m), "{largest_m}");
    }
}
