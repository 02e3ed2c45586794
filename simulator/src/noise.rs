//! Sensor errors added to the truth: a suit's misalignment and drift, a plate's noise and zero drift, insoles' gain.

use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::message::GroundSample;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::colour::{SuitColour, joint_rad};
use crate::dynamics::Wrench;
use crate::feet::DRAWN_HZ;
use crate::kinematics::{Rotations, chain_m};
use crate::motion::BodyState;
use crate::person::Person;
use crate::random::{BandLimitedNoise, Random};

/// Error sizes of a suit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuitNoise {
    /// Standard deviation per axis of each segment's constant misalignment, rad.
    pub misalignment_rad: f64,
    /// Standard deviation per axis of each segment's slow orientation drift, rad.
    pub orientation_drift_rad: f64,
    /// Standard deviation per axis of the slow drift of the whole body's position, m.
    pub drift_m: [f64; 3],
    /// Soft tissue: standard deviation of each element of the map from a joint's rotation vector (rad) to the change of
    /// the bone that ends in that joint, m/rad. Doubled in the spine, whose joints share the bend of the trunk, and
    /// halved in the arms. 0 in the null pose: the reported bones change length with the posture.
    pub soft_tissue_m_per_rad: f64,
}

impl SuitNoise {
    /// About 0.7° per axis, centimetres of drift over minutes.
    pub const ORDINARY: SuitNoise = SuitNoise {
        misalignment_rad: 0.010,
        orientation_drift_rad: 0.005,
        drift_m: [0.03, 0.03, 0.005],
        soft_tissue_m_per_rad: 0.0,
    };
    /// The same on a body with soft tissue. Over recordings of people who lift, bones as measured change by 3 to 19 mm
    /// in most segments and by up to 60 mm at thigh and trunk; a test checks this size.
    pub const REALISTIC: SuitNoise = SuitNoise { soft_tissue_m_per_rad: 0.008, ..SuitNoise::ORDINARY };
    /// A suit without error.
    pub const NONE: SuitNoise = SuitNoise {
        misalignment_rad: 0.0,
        orientation_drift_rad: 0.0,
        drift_m: [0.0; 3],
        soft_tissue_m_per_rad: 0.0,
    };
}

/// A suit with errors.
#[derive(Debug, Clone)]
pub struct Suit {
    misalignment: Rotations,
    orientation_drift: [[BandLimitedNoise; 3]; SEGMENTS],
    drift: [BandLimitedNoise; 3],
    /// Change of the bone to each segment's origin, parent's axes, per rotation of its joint, m/rad.
    soft_tissue: [Matrix3<f64>; SEGMENTS],
    colour: Option<SuitColour>,
}

impl Suit {
    /// A suit with the errors of a seed.
    pub fn new(noise: SuitNoise, seed: u64) -> Suit {
        let mut random = Random::new(seed, "suit");
        let misalignment = std::array::from_fn(|_| {
            UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| {
                noise.misalignment_rad * random.normal()
            }))
        });
        let orientation_drift = std::array::from_fn(|_| {
            std::array::from_fn(|_| {
                BandLimitedNoise::new(&mut random, noise.orientation_drift_rad, 0.005, 0.05)
            })
        });
        let drift = noise.drift_m.map(|sigma| BandLimitedNoise::new(&mut random, sigma, 0.001, 0.01));
        let soft_tissue = soft_tissue(noise.soft_tissue_m_per_rad, seed);
        Suit { misalignment, orientation_drift, drift, soft_tissue, colour: None }
    }

    /// The same with errors that depend on pose and time.
    #[must_use]
    pub fn with_colour(self, colour: SuitColour) -> Suit {
        Suit { colour: Some(colour), ..self }
    }

    /// Segment origins (m) and `world_from_segment` as the suit reports them.
    ///
    /// Like a real suit, computes positions from the measured orientations along the segments and ties the feet to the
    /// floor, with the true lengths plus the soft-tissue changes.
    pub fn see(&self, person: &Person, body: &BodyState) -> ([Vector3<f64>; SEGMENTS], Rotations) {
        let t = body.time_s;
        let seen: Rotations = std::array::from_fn(|i| {
            let orientation_drift = Vector3::from_fn(|axis, _| self.orientation_drift[i][axis].at(t));
            body.world_from_segment[i]
                * UnitQuaternion::from_scaled_axis(orientation_drift)
                * self.misalignment[i]
        });
        let seen = match &self.colour {
            Some(colour) => colour.on(seen, body),
            None => seen,
        };
        self.place(person, body, seen)
    }

    /// Positions for the suit's measured rotations.
    pub fn place(
        &self,
        person: &Person,
        body: &BodyState,
        seen: Rotations,
    ) -> ([Vector3<f64>; SEGMENTS], Rotations) {
        let t = body.time_s;
        let bend = joint_rad(body);
        let bone_m = std::array::from_fn(|i| person.offset_m[i] + self.soft_tissue[i] * bend[i]);
        let hanging = chain_m(&bone_m, Vector3::zeros(), &seen);
        let feet = |origin: &[Vector3<f64>; SEGMENTS]| {
            Side::BOTH.map(|side| origin[side.foot().index()]).iter().sum::<Vector3<f64>>() * 0.5
        };
        let drift = Vector3::from_fn(|axis, _| self.drift[axis].at(t));
        let shift = feet(&body.origin_m) - feet(&hanging) + drift;
        (hanging.map(|origin| origin + shift), seen)
    }
}

/// Maps from a joint's rotation vector to the change of the bone that ends in the joint. One side mirrors the other.
fn soft_tissue(sigma_m_per_rad: f64, seed: u64) -> [Matrix3<f64>; SEGMENTS] {
    // A rotation vector mirrors with the opposite sign of a position.
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    Segment::ALL.map(|segment| {
        let first = segment.index().min(segment.mirrored().index());
        let mut random = Random::numbered(seed, "soft tissue", first as u32);
        let sigma = match segment {
            Segment::Pelvis => 0.0,
            Segment::L5 | Segment::L3 | Segment::T12 | Segment::T8 => 2.0 * sigma_m_per_rad,
            arm if arm > Segment::Head && arm < Segment::RightUpperLeg => 0.5 * sigma_m_per_rad,
            _ => sigma_m_per_rad,
        };
        let map = Matrix3::from_fn(|_, _| sigma * random.normal());
        if segment.index() == first { map } else { -(mirror * map * mirror) }
    })
}

/// Noise of a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateNoise {
    /// Standard deviation of each force component, white, N.
    pub force_n: f64,
    /// Standard deviation of each moment component about the sensor's origin, white, N m.
    pub moment_nm: f64,
}

impl PlateNoise {
    /// A good plate.
    pub const ORDINARY: PlateNoise = PlateNoise { force_n: 1.0, moment_nm: 0.3 };
    /// A plate without error.
    pub const NONE: PlateNoise = PlateNoise { force_n: 0.0, moment_nm: 0.0 };

    /// A wrench with the noise of one sample.
    #[must_use]
    pub fn on(&self, wrench: Wrench, random: &mut Random) -> Wrench {
        let mut white = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.normal());
        Wrench {
            force_n: wrench.force_n + white(self.force_n),
            moment_nm: wrench.moment_nm + white(self.moment_nm),
        }
    }
}

/// Drift of the charge amplifiers of a piezoelectric plate since they were last reset: data sheets of such plates allow
/// 0.01 N/s in each force component. Each component's four sensors, below the corners, drift at constant rates of their
/// own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZeroDrift {
    corner_n_per_s: [[f64; 3]; 4],
}

impl ZeroDrift {
    /// A plate without drift.
    pub const NONE: ZeroDrift = ZeroDrift { corner_n_per_s: [[0.0; 3]; 4] };
    /// Sensors from the plate's centre, m, forward and sideways: a plate of 600 by 400 mm.
    const CORNERS_M: [[f64; 2]; 4] = [[0.12, 0.2], [0.12, -0.2], [-0.12, -0.2], [-0.12, 0.2]];
    /// Uniform rates of four sensors within ± this add up to the standard deviation of a uniform one within ± 0.01 N/s.
    const CORNER_N_PER_S: f64 = 0.005;

    /// One of the plates of the station with this seed, its rates multiplied by a factor.
    pub fn new(factor: f64, seed: u64, plate: u32) -> ZeroDrift {
        let mut random = Random::numbered(seed, "plate zero", plate);
        let mut rate = || factor * random.between(-ZeroDrift::CORNER_N_PER_S, ZeroDrift::CORNER_N_PER_S);
        ZeroDrift { corner_n_per_s: std::array::from_fn(|_| std::array::from_fn(|_| rate())) }
    }

    /// Output of the unloaded plate this long after its reset, about its centre.
    pub fn at(&self, time_s: f64) -> Wrench {
        let mut wrench = Wrench { force_n: Vector3::zeros(), moment_nm: Vector3::zeros() };
        for ([x, y], rate) in ZeroDrift::CORNERS_M.into_iter().zip(self.corner_n_per_s) {
            let force_n = Vector3::from(rate) * time_s;
            wrench.force_n += force_n;
            wrench.moment_nm += Vector3::new(x, y, 0.0).cross(&force_n);
        }
        wrench
    }
}

/// A pair of insoles with errors, independent left and right.
///
/// Each measures force with a constant gain error. Moticon's Insole3 deviates from force plates by −4 to +6 % in peaks,
/// valleys and impulses of walking and running (Cramer et al., *Sensors* 22, 2022, 2203). Each foot's centre of pressure
/// is off by an error that changes as the foot presses other cells: 6.6 ± 3 mm sideways and 15 ± 6 mm forward in walking,
/// which includes the place of the insole on the floor (Morin et al., *Sensors* 22, 2022, 5628).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Insoles {
    gain: [f64; 2],
    /// Error of each foot's centre of pressure, insole's axes, m.
    cop: [[BandLimitedNoise; 2]; 2],
}

impl Insoles {
    /// Insoles without error.
    pub const NONE: Insoles = Insoles { gain: [1.0; 2], cop: [[BandLimitedNoise::NONE; 2]; 2] };
    /// Standard deviation of a gain: the middle of the deviations above.
    const GAIN_SIGMA: f64 = 0.04;
    /// Standard deviation of the error of a centre of pressure along each axis, m: the sideways one above, which depends
    /// less on the insole's place.
    const COP_SIGMA_M: f64 = 0.006;

    /// The insoles with this seed.
    pub fn new(seed: u64) -> Insoles {
        let mut random = Random::new(seed, "insole gain");
        let gain = [0, 1].map(|_: usize| 1.0 + Insoles::GAIN_SIGMA * random.normal());
        let mut random = Random::new(seed, "insole centre of pressure");
        let [slowest_hz, fastest_hz] = DRAWN_HZ;
        let cop = std::array::from_fn(|_| {
            std::array::from_fn(|_| {
                BandLimitedNoise::new(&mut random, Insoles::COP_SIGMA_M, slowest_hz, fastest_hz)
            })
        });
        Insoles { gain, cop }
    }

    /// Adds the errors at a time to an exact sample of insoles.
    #[must_use]
    pub fn on(&self, exact: GroundSample, time_s: f64) -> GroundSample {
        let vertical_n = [0, 1].map(|foot| self.gain[foot] * exact.foot_vertical_n[foot]);
        let foot_cop_m = [0, 1].map(|foot: usize| {
            [0, 1].map(|axis: usize| exact.foot_cop_m[foot][axis] + self.cop[foot][axis].at(time_s))
        });
        let force_n = [0.0, 0.0, vertical_n[0] + vertical_n[1]];
        GroundSample { foot_vertical_n: vertical_n, foot_cop_m, force_n, ..exact }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intention::Intention;
    use crate::motion::{Habits, Worker};

    /// Change of the length of every bone from standing to a deep squat with a bent trunk, m.
    fn changes_m(noise: SuitNoise, seed: u64) -> Vec<f64> {
        let mut worker = Worker::with_habits(Person::new(seed, 1.75, 75.0), seed, Habits::NONE);
        let low = Intention {
            pelvis_drop: 0.35,
            pelvis_deg: [35.0, 0.0, 0.0],
            trunk_flex_deg: 40.0,
            ..Intention::STAND
        };
        worker.intend(&low, 1.0, 1.0);
        let suit = Suit::new(noise, seed);
        let [standing, squat] = [0.5, 3.0].map(|time_s| {
            let (origin_m, _) = suit.see(worker.person(), &worker.sample(time_s));
            Segment::ALL.map(|segment| {
                let parent = segment.parent().unwrap_or(segment);
                (origin_m[segment.index()] - origin_m[parent.index()]).norm()
            })
        });
        (1..SEGMENTS).map(|i| (squat[i] - standing[i]).abs()).collect()
    }

    #[test]
    fn soft_tissue_changes_bones_by_as_much_as_recordings_show() {
        let mut largest: Vec<f64> = (1..=40)
            .map(|seed| changes_m(SuitNoise::REALISTIC, seed).into_iter().fold(0.0, f64::max))
            .collect();
        largest.sort_by(f64::total_cmp);
        assert!((0.010..0.030).contains(&largest[20]), "median of the largest change: {} m", largest[20]);
        assert!((0.025..0.070).contains(&largest[39]), "largest change of all: {} m", largest[39]);
        for rigid in [SuitNoise::ORDINARY, SuitNoise::NONE] {
            assert!(changes_m(rigid, 3).into_iter().all(|change| change < 1e-9));
        }
    }

    #[test]
    fn insoles_err_by_their_gain_and_a_slow_error_of_each_foot_s_centre() {
        use bytemuck::Zeroable;
        let exact = GroundSample {
            foot_vertical_n: [400.0, 300.0],
            force_n: [0.0, 0.0, 700.0],
            foot_cop_m: [[0.03, -0.01], [-0.02, 0.0]],
            ..GroundSample::zeroed()
        };
        assert_eq!(Insoles::NONE.on(exact, 3.0), exact);
        let (mut square_m2, mut square, mut product, count) = (0.0, 0.0, 0.0, 400.0);
        for seed in 0..400 {
            let [now, soon, later] = [20.0, 20.1, 50.0].map(|time_s| Insoles::new(seed).on(exact, time_s));
            assert_eq!(now.foot_vertical_n, later.foot_vertical_n);
            assert_eq!(now.force_n[2], now.foot_vertical_n[0] + now.foot_vertical_n[1]);
            let gains = [now.foot_vertical_n[0] / 400.0 - 1.0, now.foot_vertical_n[1] / 300.0 - 1.0];
            square += (gains[0] * gains[0] + gains[1] * gains[1]) / (2.0 * count);
            product += gains[0] * gains[1] / count;
            for foot in 0..2 {
                for axis in 0..2 {
                    let error_m =
                        |sample: &GroundSample| sample.foot_cop_m[foot][axis] - exact.foot_cop_m[foot][axis];
                    square_m2 += error_m(&now).powi(2) / (4.0 * count);
                    assert!((error_m(&now) - error_m(&soon)).abs() < 0.003, "{seed}");
                }
            }
        }
        assert!(
            (0.036..0.044).contains(&square.sqrt()) && product.abs() < 0.2 * square,
            "{square} {product}"
        );
        assert!((0.0055..0.0065).contains(&square_m2.sqrt()), "{square_m2}");
    }
}
