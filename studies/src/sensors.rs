//! Samples of suit and plate, without the network between.

use bytemuck::Zeroable;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::motion::Worker;
use equipoise_simulator::noise::{PlateNoise, Suit, SuitNoise, ZeroDrift};
use equipoise_simulator::random::Random;
use equipoise_simulator::realism::Realism;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame};
use equipoise_simulator::two_plates::{self, ground_reaction_per_foot, insole_sample};
use nalgebra::Vector2;

/// Simulated time 0, CLOCK_MONOTONIC: a time of 0 ns means "never" to the core.
pub const EPOCH_NS: u64 = 1_000_000_000;
/// 1-σ of every sample's time, ns: there is no network here, and no clock to fit.
const TIME_SIGMA_NS: u64 = 1_000;

/// Ground device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ground {
    /// One plate.
    Plate,
    /// A plate under each foot.
    TwoPlates,
    /// Insoles, which measure no shear.
    Insoles,
}

/// Errors of the accelerations that a suit sends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerationNoise {
    /// White, standard deviation per axis and sample, m/s².
    pub white_m_per_s2: f64,
    /// Constant, standard deviation per axis and segment, m/s²: a misaligned sensor measures a component of gravity.
    pub bias_m_per_s2: f64,
}

impl AccelerationNoise {
    /// No error.
    pub const NONE: AccelerationNoise = AccelerationNoise { white_m_per_s2: 0.0, bias_m_per_s2: 0.0 };
    /// White noise as in four recorded frames of a person at rest (0.06 between samples), and half a degree of tilt.
    pub const ORDINARY: AccelerationNoise = AccelerationNoise { white_m_per_s2: 0.07, bias_m_per_s2: 0.09 };

    fn on(&self, true_m_per_s2: [f64; 3], seed: u64, segment: usize, number: u32) -> [f64; 3] {
        let mut lasting = Random::numbered(seed, "acceleration bias", segment as u32);
        let mut white = Random::numbered(seed, "acceleration noise", number * 32 + segment as u32);
        true_m_per_s2
            .map(|a| a + self.bias_m_per_s2 * lasting.normal() + self.white_m_per_s2 * white.normal())
    }
}

/// Rates and errors of the sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    /// Suit samples per second.
    pub suit_hz: u32,
    /// Plate samples per second.
    pub plate_hz: u32,
    /// The suit's errors.
    pub suit_noise: SuitNoise,
    /// White noise of the suit's positions per axis and sample, m.
    pub suit_white_m: f64,
    /// The plate's errors, independent for each sample.
    pub plate_noise: PlateNoise,
    /// Drift of the plate's zero from time 0 on.
    pub plate_zero: ZeroDrift,
    /// The ground device.
    pub ground: Ground,
    /// The errors of the accelerations that the suit sends; `None` if it sends none.
    pub accelerations: Option<AccelerationNoise>,
    /// The suit's world in the station's.
    pub suit_world: SuitWorld,
    /// Delay of the suit's stamps, ns.
    pub suit_late_ns: u64,
    /// Delay of the ground's stamps at time 0, s; negative: too early.
    pub ground_late_s: f64,
    /// Rate of the ground's clock relative to the suit's, ppm; positive if fast.
    pub ground_drift_ppm: f64,
    /// A change of the ground's delay: its time, s, and its size, s.
    pub ground_delay_step: Option<(f64, f64)>,
    /// Deviation of the suit's sample rate from its nominal rate, ppm.
    pub suit_rate_ppm: f64,
}

impl Rig {
    /// An ordinary suit at 60 Hz on a good plate at 1 kHz.
    pub const ORDINARY: Rig = Rig {
        suit_hz: 60,
        plate_hz: 1000,
        suit_noise: SuitNoise::ORDINARY,
        suit_white_m: 0.0,
        plate_noise: PlateNoise::ORDINARY,
        plate_zero: ZeroDrift::NONE,
        ground: Ground::Plate,
        accelerations: None,
        suit_world: SuitWorld { origin_m: [0.0; 3], yaw_rad: 0.0 },
        suit_late_ns: 0,
        ground_late_s: 0.0,
        ground_drift_ppm: 0.0,
        ground_delay_step: None,
        suit_rate_ppm: 0.0,
    };
    /// The same without any error.
    pub const PERFECT: Rig =
        Rig { suit_noise: SuitNoise::NONE, plate_noise: PlateNoise::NONE, ..Rig::ORDINARY };

    /// The ordinary sensors with the phenomena of a station.
    pub fn of(realism: &Realism, seed: u64) -> Rig {
        let clocks = realism.clocks(seed);
        Rig {
            suit_noise: realism.suit_noise(),
            plate_zero: realism.zero_drift(seed),
            ground_late_s: clocks.plate_late_s,
            ground_drift_ppm: clocks.plate_drift_ppm,
            suit_rate_ppm: clocks.suit_rate_ppm,
            ..Rig::ORDINARY
        }
    }

    /// True sample rate of the suit, Hz.
    fn true_suit_hz(&self) -> f64 {
        f64::from(self.suit_hz) * (1.0 + 1e-6 * self.suit_rate_ppm)
    }

    /// Delay of the ground's stamp relative to the sample's true time, s.
    pub fn ground_late_at_s(&self, time_s: f64) -> f64 {
        let step_s = self.ground_delay_step.filter(|(at_s, _)| time_s >= *at_s).map_or(0.0, |(_, by_s)| by_s);
        self.ground_late_s + 1e-6 * self.ground_drift_ppm * time_s + step_s
    }

    /// The suit's stamps minus the ground's of the same time, s: the skew to be estimated.
    pub fn skew_at_s(&self, time_s: f64) -> f64 {
        1e-9 * self.suit_late_ns as f64 - self.ground_late_at_s(time_s)
    }

    /// Number of the suit's newest sample at a time, ns.
    pub fn suit_number_at(&self, now_ns: u64) -> u32 {
        (simulated_s(now_ns) * self.true_suit_hz()) as u32
    }

    /// Stamp of the suit's sample of that number, ns.
    pub fn suit_stamp_ns(&self, number: u32) -> u64 {
        let nominal_ns = sample_time_ns(number, self.suit_hz) - EPOCH_NS;
        let true_ns = (nominal_ns as f64 / (1.0 + 1e-6 * self.suit_rate_ppm)) as u64;
        EPOCH_NS + true_ns + self.suit_late_ns
    }

    /// Stamp of the ground's sample of that number, ns.
    pub fn ground_stamp_ns(&self, number: u32) -> u64 {
        let late_s = self.ground_late_at_s(f64::from(number) / f64::from(self.plate_hz));
        sample_time_ns(number, self.plate_hz).saturating_add_signed((1e9 * late_s).round() as i64)
    }
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
    let seen = frame(worker, suit, rig.suit_world, streams, 0, (number, rig.true_suit_hz()));
    let time_ns = rig.suit_stamp_ns(number);
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
    if rig.suit_white_m > 0.0 {
        let mut white = Random::numbered(seed, "position noise", number);
        sample.position_m.iter_mut().flatten().for_each(|m| *m += rig.suit_white_m * white.normal());
    }
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
    // The sensor measures the opposite, including its noise.
    let zero = rig.plate_zero.at(time_s);
    let felt =
        Wrench { force_n: zero.force_n - on_person.force_n, moment_nm: zero.moment_nm - on_person.moment_nm };
    let felt = rig.plate_noise.on(felt, &mut Random::numbered(seed, "plate noise", number));
    let time_ns = rig.ground_stamp_ns(number);
    if rig.ground != Ground::Plate {
        // Under the ankles, and without noise: these devices are compared by the quantities that they measure, not by
        // accuracy.
        let feet = ground_reaction_per_foot(worker, time_s, [Vector2::zeros(); 2]);
        let published = match rig.ground {
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
            ..published
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
