//! What suit and plate say, as samples, without the wires between.

use bytemuck::Zeroable;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::motion::Worker;
use equipoise_simulator::noise::{PlateNoise, Suit, SuitNoise};
use equipoise_simulator::random::Random;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame};
use equipoise_simulator::two_plates::{self, ground_reaction_per_foot, insole_sample};
use nalgebra::Vector2;

/// Simulated time 0, CLOCK_MONOTONIC: a time of 0 ns means "never" to the core.
pub const EPOCH_NS: u64 = 1_000_000_000;
/// 1-σ of every sample's time, ns: there is no network here, and no clock to fit.
const TIME_SIGMA_NS: u64 = 1_000;

/// What the ground is measured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ground {
    /// One plate.
    Plate,
    /// A plate under each foot.
    TwoPlates,
    /// Insoles, which feel no shear.
    Insoles,
}

/// How wrong the accelerations are that a suit sends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerationNoise {
    /// White, standard deviation per axis and sample, m/s².
    pub white_m_per_s2: f64,
    /// For good, standard deviation per axis and segment, m/s²: a sensor that sits crooked lets gravity in.
    pub bias_m_per_s2: f64,
}

impl AccelerationNoise {
    /// No error.
    pub const NONE: AccelerationNoise = AccelerationNoise { white_m_per_s2: 0.0, bias_m_per_s2: 0.0 };
    /// White noise as four recorded frames of a person at rest show it (0.06 between samples), and half a degree of tilt.
    pub const ORDINARY: AccelerationNoise = AccelerationNoise { white_m_per_s2: 0.07, bias_m_per_s2: 0.09 };

    fn on(&self, true_m_per_s2: [f64; 3], seed: u64, segment: usize, number: u32) -> [f64; 3] {
        let mut lasting = Random::numbered(seed, "acceleration bias", segment as u32);
        let mut white = Random::numbered(seed, "acceleration noise", number * 32 + segment as u32);
        true_m_per_s2
            .map(|a| a + self.bias_m_per_s2 * lasting.normal() + self.white_m_per_s2 * white.normal())
    }
}

/// How often and how well the sensors measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    /// Suit samples per second.
    pub suit_hz: u32,
    /// Plate samples per second.
    pub plate_hz: u32,
    /// The suit's errors.
    pub suit_noise: SuitNoise,
    /// The plate's errors, each sample's own.
    pub plate_noise: PlateNoise,
    /// What the ground is measured by.
    pub ground: Ground,
    /// The errors of the accelerations that the suit sends; `None`: it sends none.
    pub accelerations: Option<AccelerationNoise>,
    /// How much too late the suit stamps its samples, ns.
    pub suit_late_ns: u64,
}

impl Rig {
    /// An ordinary suit at 60 Hz on a good plate at 1 kHz.
    pub const ORDINARY: Rig = Rig {
        suit_hz: 60,
        plate_hz: 1000,
        suit_noise: SuitNoise::ORDINARY,
        plate_noise: PlateNoise::ORDINARY,
        ground: Ground::Plate,
        accelerations: None,
        suit_late_ns: 0,
    };
    /// The same without any error.
    pub const PERFECT: Rig =
        Rig { suit_noise: SuitNoise::NONE, plate_noise: PlateNoise::NONE, ..Rig::ORDINARY };
}

/// Time of a sample, CLOCK_MONOTONIC ns.
pub fn sample_time_ns(number: u32, rate_hz: u32) -> u64 {
    EPOCH_NS + u64::from(number) * 1_000_000_000 / u64::from(rate_hz)
}

/// Simulated time of a stamp, s.
pub fn simulated_s(time_ns: u64) -> f64 {
    (time_ns as f64 - EPOCH_NS as f64) * 1e-9
}

/// The suit's sample of that number; errors of the accelerations follow from the seed.
pub fn suit_sample(worker: &Worker, suit: &Suit, rig: &Rig, seed: u64, number: u32) -> SuitSample {
    let streams = Streams { linear_kinematics: rig.accelerations.is_some(), ..Streams::NONE };
    let seen = frame(worker, suit, SuitWorld::default(), streams, 0, (number, f64::from(rig.suit_hz)));
    let time_ns = sample_time_ns(number, rig.suit_hz) + rig.suit_late_ns;
    let mut sample = SuitSample {
        sample_time_ns: time_ns,
        sample_time_sigma_ns: TIME_SIGMA_NS,
        arrival_ns: time_ns,
        published_ns: time_ns,
        sequence: u64::from(number) + 1,
        device_counter: number,
        device_time_ms: seen.time_code_ms,
        position_m: seen.position_m,
        orientation_wxyz: seen.orientation_wxyz,
        ..Zeroable::zeroed()
    };
    if let (Some(motion), Some(noise)) = (seen.motion, rig.accelerations) {
        sample.velocity_m_per_s = motion.map(|[velocity, _]| velocity);
        sample.acceleration_m_per_s2 =
            std::array::from_fn(|segment| noise.on(motion[segment][1], seed, segment, number));
        sample.blocks = SuitBlocks::LinearKinematics as u32;
    }
    sample
}

/// The plate's sample of that number; the same seed gives each number the same noise as the live simulation.
pub fn ground_sample(worker: &Worker, rig: &Rig, seed: u64, number: u32) -> GroundSample {
    let time_s = f64::from(number) / f64::from(rig.plate_hz);
    let on_person = worker.ground_reaction(time_s);
    // The sensor feels the opposite, and its noise with it.
    let felt = Wrench { force_n: -on_person.force_n, moment_nm: -on_person.moment_nm };
    let felt = rig.plate_noise.on(felt, &mut Random::numbered(seed, "plate noise", number));
    let time_ns = sample_time_ns(number, rig.plate_hz);
    if rig.ground != Ground::Plate {
        // Under the ankles, and without noise: the question is what is measured, not how well.
        let feet = ground_reaction_per_foot(worker, time_s, [Vector2::zeros(); 2]);
        let told = match rig.ground {
            Ground::Insoles => insole_sample(worker, time_s, &feet),
            Ground::TwoPlates | Ground::Plate => two_plates::ground_sample(&feet),
        };
        return GroundSample {
            sample_time_ns: time_ns,
            sample_time_sigma_ns: TIME_SIGMA_NS,
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence: u64::from(number) + 1,
            device_counter: number,
            ..told
        };
    }
    GroundSample {
        sample_time_ns: time_ns,
        sample_time_sigma_ns: TIME_SIGMA_NS,
        arrival_ns: time_ns,
        published_ns: time_ns,
        sequence: u64::from(number) + 1,
        device_counter: number,
        force_n: (-felt.force_n).into(),
        moment_nm: (-felt.moment_nm).into(),
        ..Zeroable::zeroed()
    }
}
