//! A rigid person who deviates from the table, and a bench that feeds the cycle with simulated sensor data.

extern crate std;
use std::boxed::Box;
use std::sync::OnceLock;
use std::vec::Vec;

use bytemuck::Zeroable;
use nalgebra::Vector3;

use crate::GRAVITY_M_PER_S2;
use crate::body::{Anthropometry, SEGMENTS, Segment, Sex, Skeleton};
use crate::cycle::*;
use crate::frame::{Pose, StationWorld, wxyz};
use crate::kalman::STATES;
use crate::message::Component;
use crate::message::state::Phase;
use crate::message::suit::SuitBlocks;
use crate::pose_suggestion::{Posture, posture};
use crate::sesc::{Phi, centre_of_mass};

pub(in crate::cycle) const HEIGHT_M: f64 = 1.77;
pub(in crate::cycle) const MASS_KG: f64 = 72.0;
pub(in crate::cycle) const SUIT_PERIOD_NS: u64 = 10_000_000;
pub(in crate::cycle) const TICK_NS: u64 = 1_000_000;
/// Prime, so that each phase of the suit's period of ten cycles is checked.
const SOUND_EVERY_CYCLES: u64 = 17;

/// Trunk pitch and roll, and both arms; the legs stay straight and upright.
pub(in crate::cycle) fn stand(
    pitch: i16,
    roll: i16,
    left_arm: [i16; 3],
    right_arm: [i16; 3],
    elbow: i16,
) -> Posture {
    let mut rotation_deg = [[0; 3]; SEGMENTS];
    rotation_deg[Segment::Pelvis.index()] = [roll, pitch, 0];
    rotation_deg[Segment::RightUpperLeg.index()] = [-roll, -pitch, 0];
    rotation_deg[Segment::LeftUpperLeg.index()] = [-roll, -pitch, 0];
    rotation_deg[Segment::LeftUpperArm.index()] = left_arm;
    rotation_deg[Segment::RightUpperArm.index()] = right_arm;
    rotation_deg[Segment::LeftForearm.index()] = [0, 0, -elbow];
    rotation_deg[Segment::RightForearm.index()] = [0, 0, elbow];
    Posture { name: "stand", rotation_deg }
}

pub(in crate::cycle) fn postures() -> Vec<Posture> {
    let mut all = Vec::new();
    for (index, pitch) in [0, 15, 30, 45, -10].into_iter().enumerate() {
        for (other, left) in [[-80, 0, 0], [0, 0, 0], [0, 0, -80], [60, 0, 0]].into_iter().enumerate() {
            let right = [[80, 0, 0], [0, 0, 80], [0, 0, 0]][(index + other) % 3];
            all.push(stand(pitch, 5 * other as i16 - 8, left, right, 30 * ((index + 2 * other) % 4) as i16));
        }
    }
    all
}

pub(in crate::cycle) struct Person {
    pub(in crate::cycle) skeleton: Skeleton,
    pub(in crate::cycle) body: Anthropometry,
    pub(in crate::cycle) phi: Phi,
}

impl Person {
    /// Heavier trunk and lighter legs than in the table, and an asymmetric pelvis.
    pub(in crate::cycle) fn real() -> Person {
        let skeleton = Skeleton::nominal(HEIGHT_M);
        let mut body = Anthropometry::de_leva(&skeleton, HEIGHT_M, Sex::Male);
        for segment in Segment::ALL {
            body.mass_fraction[segment.index()] *= if segment <= Segment::Head { 1.12 } else { 0.9 };
        }
        body.com_m[Segment::T8.index()][0] += 0.07;
        body.com_m[Segment::Pelvis.index()][1] += 0.015;
        let sum: f64 = body.mass_fraction.iter().sum();
        body.mass_fraction = body.mass_fraction.map(|fraction| fraction / sum);
        Person { phi: Phi::of(&skeleton, &body), skeleton, body }
    }

    /// The posture with the feet at their fixed position.
    pub(in crate::cycle) fn pose(&self, posture: &Posture) -> Pose<StationWorld> {
        let loose = posture::pose_of(posture, &self.skeleton, [0.0; 3]);
        let foot = 0.5 * (loose.origin_of(Segment::LeftFoot) + loose.origin_of(Segment::RightFoot));
        let pelvis = Vector3::new(0.0, 0.0, 0.1) - foot;
        posture::pose_of(posture, &self.skeleton, pelvis.into())
    }
}

fn mix<const N: usize>(from: [f64; N], to: [f64; N], fraction: f64) -> [f64; N] {
    core::array::from_fn(|part| from[part] + fraction * (to[part] - from[part]))
}

/// Interpolation between two postures, rounded to a degree.
fn between(from: &Posture, to: &Posture, fraction: f64) -> Posture {
    let mut posture = *to;
    for (to_deg, from_deg) in
        posture.rotation_deg.iter_mut().flatten().zip(from.rotation_deg.iter().flatten())
    {
        *to_deg = (f64::from(*from_deg) + fraction * f64::from(*to_deg - *from_deg)).round() as i16;
    }
    posture
}

#[derive(Clone)]
pub(in crate::cycle) struct Bench {
    pub(in crate::cycle) settings: Settings,
    pub(in crate::cycle) memory: Box<Memory>,
    pub(in crate::cycle) now_ns: u64,
    pub(in crate::cycle) cycle: u64,
    pub(in crate::cycle) suit_sequence: u64,
    pub(in crate::cycle) ground_silent: bool,
    pub(in crate::cycle) suit_silent: bool,
    /// Drift of the suit world, m forward.
    pub(in crate::cycle) suit_drift_m: f64,
    /// Point of action under each foot, if each stands on its own plate, m.
    pub(in crate::cycle) feet_m: Option<[[f64; 2]; 2]>,
    /// Shear in messages of devices that declare it unmeasured, N.
    pub(in crate::cycle) unmeasured_shear_n: Option<[f64; 2]>,
    /// Body message of the suit in every cycle.
    pub(in crate::cycle) suit_body: Option<SuitBody>,
    /// The last posture; weight of the load, N, times its position, N m, and offset of the plate, m.
    pub(in crate::cycle) last_input: Option<(Posture, [f64; 4])>,
    /// Duration of the transition between poses or loads, ms.
    pub(in crate::cycle) takes_ms: f64,
    /// Number of restarts of the suit.
    pub(in crate::cycle) suit_session: u32,
    /// Time at which the suit's counter was zero, ns.
    pub(in crate::cycle) suit_started_ns: u64,
    /// Disturbances of the sensors.
    pub(in crate::cycle) disturbance: Disturbance,
}

/// Disturbances of the sensors; by default none.
#[derive(Clone, Copy, Default)]
pub(in crate::cycle) struct Disturbance {
    /// Constant shear, N.
    pub(in crate::cycle) shear_n: [f64; 2],
    /// Force that pushes the person forward at a height of 1.2 m, N.
    pub(in crate::cycle) push_n: f64,
    /// Fraction of the weight under the right foot, which is next to the plate.
    pub(in crate::cycle) outside: f64,
    /// Reading of the empty plate, N.
    pub(in crate::cycle) zero_n: f64,
    /// Gain of the plate minus one.
    pub(in crate::cycle) gain_error: f64,
    /// `GroundDevice` bits.
    pub(in crate::cycle) devices: u32,
    /// 1-σ of the ground's sample times, ns.
    pub(in crate::cycle) time_sigma_ns: u64,
    /// 1-σ of the suit's sample times, ns.
    pub(in crate::cycle) suit_time_sigma_ns: u64,
    /// Clock epochs of suit and ground.
    pub(in crate::cycle) clock_epoch: [u32; 2],
}

impl Disturbance {
    fn of(self, ground: GroundSample) -> GroundSample {
        let Disturbance { shear_n, push_n, outside, zero_n, devices, time_sigma_ns, clock_epoch, .. } = self;
        let ([fx, fy, fz], [mx, my, mz], on_plate) = (ground.force_n, ground.moment_nm, 1.0 - outside);
        let amplified = |wrench: [f64; 3]| wrench.map(|value| (1.0 + self.gain_error) * value);
        // Only the left foot is on the plate, which shifts the reaction to the left.
        let lateral_nm = 0.2 * outside * on_plate * fz;
        let unlike = 1.0 + 1e-9 * (ground.sequence % 2) as f64;
        GroundSample {
            // Exactly repeated values other than zero count as implausible.
            force_n: amplified([
                fx + shear_n[0] * unlike - push_n,
                fy + shear_n[1] * unlike,
                on_plate * fz + zero_n * unlike,
            ]),
            moment_nm: amplified([on_plate * mx + lateral_nm, on_plate * my - 1.2 * push_n, mz]),
            devices,
            sample_time_sigma_ns: time_sigma_ns,
            clock_epoch: clock_epoch[1],
            ..ground
        }
    }
}

impl Bench {
    pub(in crate::cycle) fn new(change: impl FnOnce(&mut Settings)) -> Bench {
        let library: &'static [Posture] = Box::leak(postures().into_boxed_slice());
        let mut settings =
            Settings { sex: Sex::Male, mass_kg: Some(MASS_KG), library, ..Settings::for_height(HEIGHT_M) };
        change(&mut settings);
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        Bench {
            settings,
            memory,
            now_ns: NS_PER_S,
            cycle: 0,
            suit_sequence: 0,
            ground_silent: false,
            suit_silent: false,
            suit_drift_m: 0.0,
            feet_m: None,
            unmeasured_shear_n: None,
            suit_body: None,
            last_input: None,
            takes_ms: 100.0,
            suit_session: 0,
            suit_started_ns: 0,
            disturbance: Disturbance::default(),
        }
    }

    /// A bench with the usual settings after the identification of [`Person::real`], computed once for all tests.
    pub(in crate::cycle) fn identified() -> Bench {
        static IDENTIFIED: OnceLock<Bench> = OnceLock::new();
        let identified = IDENTIFIED.get_or_init(|| {
            let mut bench = Bench::new(|_| {});
            bench.identify(&Person::real());
            bench
        });
        identified.clone()
    }

    /// Adds the readings of two plates: the weight is distributed along the line between the feet.
    fn with_feet(&self, ground: GroundSample) -> GroundSample {
        let (Some([left, right]), Ok(cop_m)) = (self.feet_m, ground.cop_m()) else { return ground };
        let along = [right[0] - left[0], right[1] - left[1]];
        let square = along[0] * along[0] + along[1] * along[1];
        let fraction = ((cop_m[0] - left[0]) * along[0] + (cop_m[1] - left[1]) * along[1]) / square;
        let off = [0, 1].map(|axis| cop_m[axis] - left[axis] - fraction * along[axis]);
        GroundSample {
            per_foot: 1,
            foot_vertical_n: [(1.0 - fraction) * ground.force_n[2], fraction * ground.force_n[2]],
            foot_cop_m: [left, right].map(|foot| [foot[0] + off[0], foot[1] + off[1]]),
            ..ground
        }
    }

    pub(in crate::cycle) fn hold(
        &mut self,
        person: &Person,
        posture: &Posture,
        load: Option<(f64, Vector3<f64>)>,
        milliseconds: u64,
    ) {
        self.hold_on(person, posture, load, 0.0, milliseconds);
    }

    /// On a plate whose readings are shifted forward, m.
    pub(in crate::cycle) fn hold_on_a_shifted_plate(
        &mut self,
        person: &Person,
        posture: &Posture,
        off_m: f64,
        milliseconds: u64,
    ) {
        self.hold_on(person, posture, None, off_m, milliseconds);
    }

    fn hold_on(
        &mut self,
        person: &Person,
        posture: &Posture,
        load: Option<(f64, Vector3<f64>)>,
        off_m: f64,
        milliseconds: u64,
    ) {
        let (load_n, at) = load.map_or((0.0, Vector3::zeros()), |(kg, at)| (kg * GRAVITY_M_PER_S2, at));
        let before = self.last_input.unwrap_or((*posture, [load_n, at.x * load_n, at.y * load_n, off_m]));
        let after = (*posture, [load_n, at.x * load_n, at.y * load_n, off_m]);
        for millisecond in 1..=milliseconds {
            self.now_ns += TICK_NS;
            self.cycle += 1;
            // A leap of the body or the force would be rejected.
            let fraction = (millisecond as f64 / self.takes_ms).min(1.0);
            let input = (between(&before.0, posture, fraction), mix(before.1, after.1, fraction));
            self.last_input = Some(input);
            let (posture, [load_n, load_x_nm, load_y_nm, off_m]) = input;
            let pose = person.pose(&posture);
            let centre = centre_of_mass(&pose, &person.phi);
            let weight_n = MASS_KG * GRAVITY_M_PER_S2;
            // No sensor repeats a value to the last bit.
            let unlike = (self.now_ns / SUIT_PERIOD_NS + self.cycle % 2) as f64 % 2.0;
            let vertical_n = weight_n + load_n + 1e-11 * unlike;
            let moment = [
                centre.y * weight_n + load_y_nm + 1e-12 * unlike,
                -centre.x * weight_n - load_x_nm + 1e-12 * unlike - off_m * vertical_n,
                0.0,
            ];
            let ground = GroundSample {
                sample_time_ns: self.now_ns - self.settings.ground_latency_ns,
                sequence: self.cycle,
                force_n: [0.0, 0.0, vertical_n],
                moment_nm: moment,
                ..Zeroable::zeroed()
            };
            let mut ground = self.with_feet(self.disturbance.of(ground));
            if let Some([x, y]) = self.unmeasured_shear_n {
                (ground.force_n[0], ground.force_n[1]) = (x, y);
                ground.not_measured = Component::Shear as u32;
            }
            let mut suit: SuitSample = Zeroable::zeroed();
            suit.sample_time_ns = self.now_ns - 500_000 - self.settings.suit_latency_ns;
            suit.session = self.suit_session;
            suit.sample_time_sigma_ns = self.disturbance.suit_time_sigma_ns;
            suit.clock_epoch = self.disturbance.clock_epoch[0];
            (suit.blocks, suit.com_m) = (SuitBlocks::CentreOfMass as u32, centre.into());
            suit.device_counter = ((self.now_ns - self.suit_started_ns) / SUIT_PERIOD_NS) as u32;
            suit.position_m = pose.origin.map(|at| [at.x + self.suit_drift_m + 1e-12 * unlike, at.y, at.z]);
            suit.orientation_wxyz = pose.world_from_segment.map(|rotation| wxyz(&rotation));
            let has_suit = self.now_ns.is_multiple_of(SUIT_PERIOD_NS) && !self.suit_silent;
            self.suit_sequence += u64::from(has_suit);
            let suit_body =
                self.suit_body.map(|suit_body| SuitBody { published_ns: self.now_ns, ..suit_body });
            let inputs = Inputs {
                suit: if has_suit { core::slice::from_ref(&suit) } else { &[] },
                ground: if self.ground_silent { &[] } else { core::slice::from_ref(&ground) },
                body: suit_body.as_ref(),
                command: None,
            };
            step(&self.settings, &mut self.memory, Tick { cycle: self.cycle, due_ns: self.now_ns }, inputs);
            // A checkpoint may be taken after any cycle, and the daemon cannot restart from one that is not sound. The
            // check takes ten times as long as a cycle.
            if self.cycle.is_multiple_of(SOUND_EVERY_CYCLES) {
                assert!(self.memory.is_sound(), "cycle {}", self.cycle);
            }
        }
    }

    pub(in crate::cycle) fn state(&self) -> &State {
        &self.memory.state
    }

    pub(in crate::cycle) fn command(&mut self, command: CommandKind) {
        self.cycle += 1;
        self.now_ns += TICK_NS;
        let inputs = Inputs { command: Some(command), ..Inputs::default() };
        step(&self.settings, &mut self.memory, Tick { cycle: self.cycle, due_ns: self.now_ns }, inputs);
    }

    /// Measures the stance offset, m, almost exactly.
    pub(in crate::cycle) fn set_stance_offset(&mut self, offset_m: [f64; 2]) {
        let filter = &mut self.memory.identification.filter;
        for (axis, offset_m) in offset_m.into_iter().enumerate() {
            let mut h = [0.0; STATES];
            h[filter.count() + axis] = 1.0;
            filter.update(&h, offset_m, 1e-12);
        }
    }

    pub(in crate::cycle) fn identify(&mut self, person: &Person) {
        for posture in postures() {
            // Poses leap here, and the plate is suspect for 0.3 s after a leap.
            self.hold(person, &posture, None, 700);
        }
    }

    pub(in crate::cycle) fn phase(&self) -> Phase {
        Phase::from_number(self.state().phase).unwrap()
    }
}
