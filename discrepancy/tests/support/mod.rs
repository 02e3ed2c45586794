//! Simple sessions: a body of the table in the poses of the library, on a plate with coloured noise.

use equipoise_core::body::{Anthropometry, SEGMENTS, Segment, Sex, Side, Skeleton};
use equipoise_core::effect::{Effect, Observation, PARAMETERS_MAX, Place, Term};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_core::sesc::Phi;
use equipoise_discrepancy::block::{Block, CUTOFFS_HZ, Change, LAGS_S, Phase};
use equipoise_discrepancy::session::{LeftOut, PARAMETERS, Session, Spans};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Length of a block, s.
const BLOCK_S: f64 = 0.4;
/// Duration of a static pose, s.
const HELD_S: f64 = 2.4;
const MOVED_S: f64 = 1.6;
const MASS_KG: f64 = 75.0;
const GRAVITY: f64 = 9.81;
/// Step of the numerical derivatives, s.
const STEP_S: f64 = 0.04;

/// End of identification, of clean work, and of the work in question, s.
pub(crate) const IDENTIFY_S: f64 = 120.0;
pub(crate) const REFERENCE_S: f64 = 200.0;
pub(crate) const END_S: f64 = 300.0;

/// A session without errors of the subject, on a plate with noise.
pub(crate) fn clean(seed: u64) -> Session {
    let mut blocks = Vec::new();
    let mut noise = Noise::new(seed);
    let count = (END_S / BLOCK_S) as usize;
    for index in 0..count {
        let time_s = (index as f64 + 0.5) * BLOCK_S;
        let (phase, order) = match time_s {
            t if t < IDENTIFY_S => (Phase::Identify, 0),
            t if t < REFERENCE_S => (Phase::Reference, 1),
            _ => (Phase::Work, 2),
        };
        let walk = Walk { seed: seed.wrapping_mul(31).wrapping_add(order) };
        let mut block = walk.block(time_s, phase);
        if phase == Phase::Identify && !block.still {
            continue;
        }
        noise.add(&mut block);
        blocks.push(block);
    }
    let mut prior_covariance_m2 = vec![0.0; PARAMETERS * PARAMETERS];
    for i in 0..PARAMETERS {
        prior_covariance_m2[i * PARAMETERS + i] = 0.01 * 0.01;
    }
    Session {
        blocks,
        mass_kg: MASS_KG,
        prior_covariance_m2,
        has_shear: true,
        has_inertia: true,
        suit_drifts: true,
        block_s: BLOCK_S,
        spans_s: Spans {
            identify: [0.0, IDENTIFY_S],
            reference: Some([IDENTIFY_S, REFERENCE_S]),
            work: [REFERENCE_S, END_S],
            found: false,
        },
        length_s: END_S,
        left_out: LeftOut::default(),
    }
}

/// Adds an effect to the measurements of an interval.
pub(crate) fn hide(session: &mut Session, effect: Effect, place: Place, value: &[f64], span_s: [f64; 2]) {
    let mut all = [0.0; PARAMETERS_MAX];
    all[..value.len()].copy_from_slice(value);
    let term = Term { effect, place, shape: 0.0, value: all, span_s };
    for block in &mut session.blocks {
        let (cop_m, force_n) = term.columns(&block.observation).times(&term.value);
        let seen = &mut block.observation;
        seen.cop_measured_m.iter_mut().zip(cop_m).for_each(|(measured, part)| *measured += part);
        seen.force_measured_n.iter_mut().zip(force_n).for_each(|(measured, part)| *measured += part);
    }
}

/// Reproducible pseudo-random numbers.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mixed = (self.0 ^ (self.0 >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((mixed ^ (mixed >> 32)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Slow and white noise of the plate.
struct Noise {
    random: Random,
    slow: [f64; 5],
}

impl Noise {
    fn new(seed: u64) -> Noise {
        Noise { random: Random(seed ^ 0xabcd_ef01), slow: [0.0; 5] }
    }

    fn add(&mut self, block: &mut Block) {
        let sizes = [0.0012, 0.0012, 0.8, 0.8, 0.8];
        let keep = (-BLOCK_S / 6.0_f64).exp();
        let seen = &mut block.observation;
        let mut values: Vec<&mut f64> =
            seen.cop_measured_m.iter_mut().chain(seen.force_measured_n.iter_mut()).collect();
        for ((value, slow), size) in values.iter_mut().zip(&mut self.slow).zip(sizes) {
            *slow = keep * *slow + (1.0 - keep * keep).sqrt() * size * self.random.normal();
            **value += *slow + 0.4 * size * self.random.normal();
        }
    }
}

/// Motion between poses of the library.
struct Walk {
    seed: u64,
}

type Rotations = [UnitQuaternion<f64>; SEGMENTS];

impl Walk {
    fn rotations(&self, time_s: f64) -> Rotations {
        let period_s = HELD_S + MOVED_S;
        let number = (time_s / period_s).floor();
        let moved = ((time_s - number * period_s - HELD_S) / MOVED_S).clamp(0.0, 1.0);
        let fraction = moved * moved * moved * (10.0 - 15.0 * moved + 6.0 * moved * moved);
        let (from, to) = (self.pose(number as u64), self.pose(number as u64 + 1));
        let mut world = [UnitQuaternion::identity(); SEGMENTS];
        for segment in Segment::ALL {
            let index = segment.index();
            let own = from[index].slerp(&to[index], fraction);
            world[index] = segment.parent().map_or(own, |parent| world[parent.index()] * own);
        }
        world
    }

    fn pose(&self, number: u64) -> Rotations {
        let mut random = Random(self.seed.wrapping_add(number.wrapping_mul(7919)));
        random.uniform();
        let posture = &LIBRARY[(random.uniform() * LIBRARY.len() as f64) as usize % LIBRARY.len()];
        posture.rotation_deg.map(|degrees| {
            let vector = degrees.map(|degree| (f64::from(degree) + 4.0 * random.normal()).to_radians());
            UnitQuaternion::from_scaled_axis(Vector3::from(vector))
        })
    }

    fn origins(rotations: &Rotations, skeleton: &Skeleton) -> [Vector3<f64>; SEGMENTS] {
        let mut origin = [Vector3::zeros(); SEGMENTS];
        for segment in Segment::ALL {
            if let Some(parent) = segment.parent() {
                let along = Vector3::from(skeleton.offset_m[segment.index()]);
                origin[segment.index()] = origin[parent.index()] + rotations[parent.index()] * along;
            }
        }
        let feet = (origin[Segment::RightFoot.index()] + origin[Segment::LeftFoot.index()]) * 0.5;
        origin.map(|origin| origin - feet + Vector3::z() * 0.08)
    }

    fn block(&self, time_s: f64, phase: Phase) -> Block {
        let skeleton = Skeleton::nominal(1.75);
        let rotations = [-1.0, 0.0, 1.0].map(|step| self.rotations(time_s + step * STEP_S));
        let origins = [0, 1, 2].map(|i| Walk::origins(&rotations[i], &skeleton));
        let motion = Motion { rotations, origins };
        let body = Anthropometry::de_leva(&skeleton, 1.75, Sex::Male);
        let phi = Phi::of(&skeleton, &body);
        let com = [0, 1, 2].map(|i| motion.com(i, &phi));
        let joint_rad = [0, 1, 2].map(|i| joint_angles(&motion.rotations[i]));
        let bent = |s: usize, joint: usize| {
            let at = |i: usize| motion.matrix(i, s) * joint_rad[i][s][joint];
            rows((at(0) - at(1) * 2.0 + at(2)) / (STEP_S * STEP_S))
        };
        let none = Change { cop_m: [0.0; 2], force_n: [0.0; 3] };
        let pause_s = time_s % (HELD_S + MOVED_S);
        Block {
            phase,
            stance: 1,
            still: pause_s > 0.2 && pause_s < HELD_S - 0.2,
            observation: observation(time_s, &motion, com, &phi, &body),
            com_velocity_m_per_s: ((com[2] - com[0]) / (2.0 * STEP_S)).into(),
            turning_by_group_m: [[0.0; 2]; 4],
            joint_rad: joint_rad[1],
            joint_weighted_rotation_acceleration: std::array::from_fn(|s| {
                [0, 1, 2].map(|joint| bent(s, joint))
            }),
            heading_rad: 0.0,
            by_lag: [none; LAGS_S.len()],
            by_cutoff: [none; CUTOFFS_HZ.len()],
        }
    }
}

/// The body at an instant, and one step before and after it.
struct Motion {
    rotations: [Rotations; 3],
    origins: [[Vector3<f64>; SEGMENTS]; 3],
}

impl Motion {
    fn matrix(&self, i: usize, s: usize) -> Matrix3<f64> {
        self.rotations[i][s].to_rotation_matrix().into_inner()
    }

    fn com(&self, i: usize, phi: &Phi) -> Vector3<f64> {
        (0..SEGMENTS).fold(self.origins[i][0], |sum, s| sum + self.rotations[i][s] * Vector3::from(phi.0[s]))
    }

    fn rotation_acceleration(&self, s: usize) -> [[f64; 3]; 3] {
        rows((self.matrix(0, s) - self.matrix(1, s) * 2.0 + self.matrix(2, s)) / (STEP_S * STEP_S))
    }
}

fn rows(m: Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]))
}

fn acceleration([a, b, c]: [Vector3<f64>; 3]) -> Vector3<f64> {
    (a - b * 2.0 + c) / (STEP_S * STEP_S)
}

/// Rotation vector of each segment relative to its parent.
fn joint_angles(rotations: &Rotations) -> [[f64; 3]; SEGMENTS] {
    Segment::ALL.map(|segment| -> [f64; 3] {
        let turned = |segment: Segment| rotations[segment.index()];
        let parent = segment.parent().map_or(UnitQuaternion::identity(), turned);
        (parent.inverse() * turned(segment)).scaled_axis().into()
    })
}

/// Measurement of the motion without noise; `com` at the three instants.
fn observation(
    time_s: f64,
    motion: &Motion,
    com: [Vector3<f64>; 3],
    phi: &Phi,
    body: &Anthropometry,
) -> Observation {
    let (centre, acceleration_of_com) = (com[1], acceleration(com));
    let vertical = GRAVITY + acceleration_of_com.z;
    let slope = [acceleration_of_com.x / vertical, acceleration_of_com.y / vertical];
    let cop = [centre.x - slope[0] * centre.z, centre.y - slope[1] * centre.z];
    let force = [MASS_KG * acceleration_of_com.x, MASS_KG * acceleration_of_com.y, MASS_KG * vertical];
    Observation {
        time_s,
        mass_kg: MASS_KG,
        floor_m: 0.0,
        feet_m: [0.0; 2],
        feet_hold: true,
        origin_m: motion.origins[1].map(Into::into),
        origin_acceleration_m_per_s2: std::array::from_fn(|s| {
            acceleration([0, 1, 2].map(|i| motion.origins[i][s])).into()
        }),
        rotation: std::array::from_fn(|s| rows(motion.matrix(1, s))),
        rotation_acceleration_per_s2: std::array::from_fn(|s| motion.rotation_acceleration(s)),
        phi_m: phi.0,
        grip_m: Side::BOTH.map(|side| [0.0, if side == Side::Left { 0.08 } else { -0.08 }, 0.0]),
        centre_m: body.com_m,
        // This model omits the body's rotation.
        mass_fraction: [0.0; SEGMENTS],
        com_m: centre.into(),
        com_acceleration_m_per_s2: acceleration_of_com.into(),
        turning_m: [0.0; 2],
        slope,
        slope_is_measured: true,
        cop_predicted_m: cop,
        force_predicted_n: force,
        cop_measured_m: cop,
        force_measured_n: force,
    }
}
