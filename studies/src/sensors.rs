//! Samples of suit and plate, without the network between.

use bytemuck::Zeroable;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::motion::Worker;
use equipoise_simulator::noise::{Insoles, PlateNoise, Suit, SuitNoise, ZeroDrift};
use equipoise_simulator::random::Random;
use equipoise_simulator::realism::Realism;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame};
use equipoise_simulator::two_plates::{self, PLATE_NOISE, ground_reaction_per_foot, insole_sample};
use nalgebra::{Vector2, Vector3};

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
    /// The errors of each plate, independent for each sample.
    pub plate_noise: PlateNoise,
    /// Drift of the zero of the first plate and the second from time 0 on.
    pub plate_zero: [ZeroDrift; 2],
    /// The insoles' errors.
    pub insoles: Insoles,
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
        plate_zero: [ZeroDrift::NONE; 2],
        insoles: Insoles::NONE,
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
            plate_zero: [0, 1].map(|plate| realism.zero_drift(seed, plate)),
            insoles: Insoles::new(seed),
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

/// The ground device's sample of that number; the same seed gives each number of a plate the same noise as the live
/// simulation.
pub fn ground_sample(worker: &Worker, rig: &Rig, seed: u64, number: u32) -> GroundSample {
    let time_s = f64::from(number) / f64::from(rig.plate_hz);
    let time_ns = rig.ground_stamp_ns(number);
    let feet = || ground_reaction_per_foot(worker, time_s, [Vector2::zeros(); 2]);
    let plate = |which: usize, centre_m: Vector3<f64>, on_person: Wrench| {
        let mut random = Random::numbered(seed, PLATE_NOISE[which], number);
        measured(&on_person, centre_m, rig.plate_zero[which].at(time_s), rig.plate_noise, &mut random)
    };
    let published = match rig.ground {
        Ground::Plate => {
            let Wrench { force_n, moment_nm } = plate(0, Vector3::zeros(), worker.ground_reaction(time_s));
            GroundSample { force_n: force_n.into(), moment_nm: moment_nm.into(), ..Zeroable::zeroed() }
        }
        Ground::TwoPlates => {
            let feet = feet();
            two_plates::ground_sample(&[0, 1].map(|foot| {
                // The middle of each plate is below the ankle.
                let [x, y, _] = worker.stance().ankle_m[foot].into();
                plate(foot, Vector3::new(x, y, 0.0), feet[foot])
            }))
        }
        Ground::Insoles => rig.insoles.on(insole_sample(worker, time_s, &feet()), time_s),
    };
    GroundSample {
        sample_time_ns: time_ns,
        sample_time_sigma_ns: TIME_SIGMA_NS,
        arrival_ns: time_ns,
        published_ns: time_ns,
        sequence: u64::from(number) + 1,
        device_counter: number,
        ..published
    }
}

/// Wrench on the person as a plate measures it whose sensor is at `centre_m`, about the world's origin.
fn measured(
    on_person: &Wrench,
    centre_m: Vector3<f64>,
    zero: Wrench,
    noise: PlateNoise,
    random: &mut Random,
) -> Wrench {
    let about_centre_nm = on_person.moment_nm - centre_m.cross(&on_person.force_n);
    // The sensor measures the opposite, including its noise.
    let measured =
        Wrench { force_n: zero.force_n - on_person.force_n, moment_nm: zero.moment_nm - about_centre_nm };
    let measured = noise.on(measured, random);
    Wrench { force_n: -measured.force_n, moment_nm: -measured.moment_nm - centre_m.cross(&measured.force_n) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subject::Subject;

    /// Errors on one foot.
    struct FootErrors {
        vertical_n: f64,
        cop_m: [f64; 2],
    }

    /// Errors of a ground device on a foot during a second from this time on, at 1 kHz.
    fn errors(ground: Ground, foot: usize, from_s: f64) -> Vec<FootErrors> {
        let subject = Subject::random(6);
        let worker = Worker::with_habits(subject.person(), subject.seed, subject.habits());
        let rigs = [Rig { ground, ..subject.rig() }, Rig { ground, ..Rig::PERFECT }];
        let first = (from_s * f64::from(Rig::PERFECT.plate_hz)) as u32;
        let numbers = first..first + Rig::PERFECT.plate_hz;
        numbers
            .map(|number| {
                let [seen, exact] = rigs.map(|rig| ground_sample(&worker, &rig, subject.seed, number));
                let cop_m = [0, 1].map(|axis| seen.foot_cop_m[foot][axis] - exact.foot_cop_m[foot][axis]);
                FootErrors { vertical_n: seen.foot_vertical_n[foot] - exact.foot_vertical_n[foot], cop_m }
            })
            .collect()
    }

    fn mean_and_deviation(values: impl Iterator<Item = f64>) -> [f64; 2] {
        let values: Vec<f64> = values.collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let middle = mean(&values);
        let squares: Vec<f64> = values.iter().map(|value| (value - middle).powi(2)).collect();
        [middle, mean(&squares).sqrt()]
    }

    #[test]
    fn each_of_two_plates_has_noise_and_zero_drift_of_its_own() {
        let early = [0, 1].map(|foot| errors(Ground::TwoPlates, foot, 0.0));
        let drifts_n = [0, 1].map(|foot: usize| {
            let late = errors(Ground::TwoPlates, foot, 200.0);
            let [[before_n, deviation_n], [after_n, _]] =
                [&early[foot], &late].map(|all| mean_and_deviation(all.iter().map(|error| error.vertical_n)));
            assert!((0.9..1.1).contains(&deviation_n), "{deviation_n} N");
            for axis in 0..2 {
                // 0.3 N m over some 350 N.
                let [_, deviation_m] = mean_and_deviation(early[foot].iter().map(|error| error.cop_m[axis]));
                assert!((0.000_4..0.002).contains(&deviation_m), "{deviation_m} m");
            }
            after_n - before_n
        });
        // At most 0.005 N/s in each of four sensors.
        assert!(drifts_n.iter().all(|drift_n| (0.1..4.0).contains(&drift_n.abs())), "{drifts_n:?}");
        assert!((drifts_n[0] - drifts_n[1]).abs() > 0.1, "{drifts_n:?}");
        let products = early[0].iter().zip(&early[1]).map(|(left, right)| left.vertical_n * right.vertical_n);
        let [covariance_n2, _] = mean_and_deviation(products);
        assert!(covariance_n2.abs() < 0.15, "{covariance_n2}");
    }

    #[test]
    fn insoles_have_an_error_of_force_and_of_the_centre_of_pressure() {
        for foot in 0..2 {
            for FootErrors { vertical_n, cop_m } in errors(Ground::Insoles, foot, 10.0) {
                assert!((0.1..60.0).contains(&vertical_n.abs()), "{vertical_n} N");
                assert!((0.000_1..0.03).contains(&cop_m[0].hypot(cop_m[1])), "{cop_m:?}");
            }
        }
    }
}
