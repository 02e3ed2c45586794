//! What suit and plate say, as samples, without the wires between.

use bytemuck::Zeroable;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::motion::Worker;
use equipoise_simulator::noise::{PlateNoise, Suit, SuitNoise};
use equipoise_simulator::random::Random;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame};

/// Simulated time 0, CLOCK_MONOTONIC: a time of 0 ns means "never" to the core.
pub const EPOCH_NS: u64 = 1_000_000_000;
/// 1-σ of every sample's time, ns: there is no network here, and no clock to fit.
const TIME_SIGMA_NS: u64 = 1_000;
/// What the suit sends beside the pose. The core takes neither the suit's joint angles nor its centre of mass.
const STREAMS: Streams = Streams { joint_angles: false, linear_kinematics: true, centre_of_mass: false };

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

/// The suit's sample of that number.
pub fn suit_sample(worker: &Worker, suit: &Suit, rig: &Rig, number: u32) -> SuitSample {
    let seen = frame(worker, suit, SuitWorld::default(), STREAMS, 0, (number, f64::from(rig.suit_hz)));
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
    if let Some(motion) = seen.motion {
        sample.velocity_m_per_s = motion.map(|[velocity, _]| velocity);
        sample.acceleration_m_per_s2 = motion.map(|[_, acceleration]| acceleration);
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
