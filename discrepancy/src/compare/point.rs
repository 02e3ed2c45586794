//! One snapshot, smoothed and differentiated: predictions of the model and measurements of the plate.

use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::motion::inertia::momentum_rate_by_segment;
use equipoise_core::motion::{MassDistribution, Motion};
use nalgebra::Vector3;

use super::options::Options;
use super::window::{Neighbourhood, Window};
use super::worker::Worker;
use crate::block::Change;
use crate::constants::{ACCELERATION_MAX_M_PER_S2, SPECIFIC_FORCE_MIN_M_PER_S2, TURNING_MAX_M};

/// Predictions and measurements at one snapshot.
#[derive(Debug)]
pub(super) struct Point {
    /// Time since the recording's start, s.
    pub(super) time_s: f64,
    /// Number of the stance.
    pub(super) stance: u64,
    /// Whether the model includes the body's inertia.
    pub(super) has_inertia: bool,
    /// Window and weights, for averages over the snapshots themselves.
    pub(super) neighbourhood: Box<Neighbourhood>,
    /// Height of the walking surface, m.
    pub(super) floor_m: f64,
    /// Middle between the standing feet, m.
    pub(super) feet_m: [f64; 2],
    /// Centre of mass by the chain, its velocity and acceleration.
    pub(super) com_m: Vector3<f64>,
    pub(super) com_velocity_m_per_s: Vector3<f64>,
    pub(super) com_acceleration_m_per_s2: Vector3<f64>,
    /// Shift of the centre of pressure by the rotation of trunk, right arm, left arm, legs, m.
    pub(super) turning_by_group_m: [[f64; 2]; 4],
    /// Horizontal over vertical force, as used in the prediction.
    pub(super) slope: [f64; 2],
    pub(super) slope_is_measured: bool,
    /// Predictions by the loop's equations.
    pub(super) cop_predicted_m: [f64; 2],
    pub(super) force_predicted_n: [f64; 3],
    /// Measurements of the plate, averaged as the accelerations are.
    pub(super) cop_measured_m: [f64; 2],
    pub(super) force_measured_n: [f64; 3],
}

/// Sums over a window.
struct Sums {
    com_m: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    motion: Motion,
    force_n: [f64; 3],
    cop_nm: [f64; 2],
    has_shear: bool,
}

impl Point {
    /// The point at a snapshot's number, from the window around it; `None` if the window lacks plate data or the plate
    /// was unloaded.
    pub(super) fn of(
        window: &Window,
        number: usize,
        neighbourhood: Neighbourhood,
        worker: &Worker,
        options: &Options,
    ) -> Option<Point> {
        let sums = Sums::over(window, &neighbourhood)?;
        let sample = window.at(number);
        let [_, _, vertical_n] = sums.force_n;
        let specific_force = GRAVITY_M_PER_S2 + sums.acceleration.z;
        if vertical_n <= 0.0 || specific_force < SPECIFIC_FORCE_MIN_M_PER_S2 {
            return None;
        }
        let has_shear = sums.has_shear && sample.ground?.has_shear;
        let slope_by_suit = [sums.acceleration.x / specific_force, sums.acceleration.y / specific_force];
        // As in the loop: divided by the force that the body requires, so that a load's weight does not reduce the
        // slope.
        let by_shear = [0, 1].map(|axis| sums.force_n[axis] / (worker.mass_kg * specific_force));
        let slope_is_measured = has_shear && options.has_inertia;
        let slope = match (options.has_inertia, has_shear) {
            (false, _) => [0.0; 2],
            (true, true) => by_shear,
            (true, false) => slope_by_suit,
        };
        let masses = MassDistribution { body: &worker.body, gyration_m2: &worker.gyration_m2 };
        let rates = momentum_rate_by_segment(&sample.snapshot, &sums.motion, &masses);
        let turning_by_group_m = turning_by_group_m(&rates, specific_force);
        let mut point = Point {
            time_s: sample.time_s,
            stance: sample.snapshot.stance,
            has_inertia: options.has_inertia,
            floor_m: sample.snapshot.ground.surface_z_m,
            feet_m: feet_m(&sample.snapshot.origin_m),
            com_m: sums.com_m,
            com_velocity_m_per_s: sums.velocity,
            com_acceleration_m_per_s2: sums.acceleration,
            turning_by_group_m,
            slope,
            slope_is_measured,
            cop_predicted_m: [0.0; 2],
            force_predicted_n: [0.0, 0.0, worker.mass_kg * GRAVITY_M_PER_S2],
            cop_measured_m: sums.cop_nm.map(|moment_nm| moment_nm / vertical_n),
            force_measured_n: sums.force_n,
            neighbourhood: Box::new(neighbourhood),
        };
        if options.has_inertia {
            let [x, y, _] = sums.acceleration.into();
            point.force_predicted_n = [x, y, specific_force].map(|force| worker.mass_kg * force);
        }
        let turning_m = if options.has_inertia { point.turning_m() } else { [0.0; 2] };
        point.cop_predicted_m = [0, 1].map(|axis| {
            worker.offset_m[axis] + point.com_m[axis] - (point.com_m.z - point.floor_m) * slope[axis]
                + turning_m[axis]
        });
        Some(point)
    }

    /// Shift of the centre of pressure by the change of the whole body's angular momentum, m.
    pub(super) fn turning_m(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.turning_by_group_m.iter().map(|group| group[axis]).sum())
    }

    /// Centre of pressure, m, and force, N, as predicted from the suit: without the part of measured shear, which has
    /// the plate's timing.
    pub(super) fn predicted_motion(&self) -> Change {
        if !self.has_inertia {
            return Change { cop_m: [self.com_m.x, self.com_m.y], force_n: [0.0; 3] };
        }
        Change { cop_m: self.without_shear(self.cop_predicted_m), force_n: self.force_predicted_n }
    }

    /// The same as measured. Without inertia the prediction is that of a still body, and the measurement is not used.
    pub(super) fn measured_motion(&self) -> Change {
        if !self.has_inertia {
            return self.predicted_motion();
        }
        Change { cop_m: self.without_shear(self.cop_measured_m), force_n: self.force_measured_n }
    }

    fn without_shear(&self, cop_m: [f64; 2]) -> [f64; 2] {
        let height_m = if self.slope_is_measured { self.com_m.z - self.floor_m } else { 0.0 };
        [0, 1].map(|axis| cop_m[axis] + height_m * self.slope[axis])
    }

    /// Whether the motion is moderate: no jump, no impact.
    pub(super) fn is_moderate(&self) -> bool {
        self.com_acceleration_m_per_s2.norm() < ACCELERATION_MAX_M_PER_S2
            && self.turning_m().iter().all(|shift_m| shift_m.abs() < TURNING_MAX_M)
    }
}

impl Sums {
    fn over(window: &Window, neighbourhood: &Neighbourhood) -> Option<Sums> {
        let mut sums = Sums {
            com_m: Vector3::zeros(),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            motion: Motion::zeroed(),
            force_n: [0.0; 3],
            cop_nm: [0.0; 2],
            has_shear: true,
        };
        let weights = &neighbourhood.weights;
        for place in 0..neighbourhood.count {
            let sample = window.at(neighbourhood.first + place);
            let ground = sample.ground?;
            let (value, first, second) = (weights.value[place], weights.first[place], weights.second[place]);
            let [x, y] = sample.snapshot.station_from_suit_m;
            sums.com_m += value * (sample.centre_m + Vector3::new(x, y, 0.0));
            sums.velocity += first * sample.centre_m;
            sums.acceleration += second * sample.centre_m;
            sums.motion.add(&sample.snapshot, first, second);
            sums.has_shear &= ground.has_shear;
            for (sum, force_n) in sums.force_n.iter_mut().zip(ground.force_n) {
                *sum += value * force_n;
            }
            for (sum, moment_nm) in sums.cop_nm.iter_mut().zip(ground.cop_nm) {
                *sum += value * moment_nm;
            }
        }
        Some(sums)
    }
}

/// Trunk, right arm, left arm, legs.
fn group_of(segment: Segment) -> usize {
    match segment {
        Segment::RightShoulder | Segment::RightUpperArm | Segment::RightForearm | Segment::RightHand => 1,
        Segment::LeftShoulder | Segment::LeftUpperArm | Segment::LeftForearm | Segment::LeftHand => 2,
        _ if segment <= Segment::Head => 0,
        _ => 3,
    }
}

/// `(−L̇_y, L̇_x)/(M (g + C̈_z))` of each group, m.
fn turning_by_group_m(rates: &[[f64; 3]; SEGMENTS], specific_force_m_per_s2: f64) -> [[f64; 2]; 4] {
    let mut groups = [[0.0; 2]; 4];
    for segment in Segment::ALL {
        let [x, y, _] = rates[segment.index()];
        let group = &mut groups[group_of(segment)];
        group[0] -= y / specific_force_m_per_s2;
        group[1] += x / specific_force_m_per_s2;
    }
    groups
}

/// The middle between the feet, each at the middle of ankle and ball, as in the anchor, m.
fn feet_m(origin_m: &[[f64; 3]; SEGMENTS]) -> [f64; 2] {
    let ends = Side::BOTH.map(|side| [side.foot(), side.toe()]);
    [0, 1].map(|axis| ends.iter().flatten().map(|end| 0.25 * origin_m[end.index()][axis]).sum())
}
