//! Derivatives at the newest snapshot, from it and the snapshots before it.
//!
//! A least-squares cubic over the last samples, differentiated at its end. A parabola would return the acceleration of
//! the window's middle, which lags by half its length; the cubic's error is of second order in the length, at the price
//! of more noise ([`super::weights`]: Savitzky and Golay).

use nalgebra::Vector3;

use super::accelerations::{self, Accelerations};
use super::history::{CAPACITY, History, Motion};
use super::inertia::{Inertia, MassDistribution};
use super::weights::Weights;
use crate::body::Side;
use crate::frame::rotation;

/// Degree of the polynomial.
const DEGREE: usize = 3;
/// Minimum number of samples: one more than the polynomial has coefficients.
const SAMPLES_MIN: usize = DEGREE + 2;

/// Motion at the newest snapshot.
#[derive(Debug, Clone, Copy)]
pub struct CausalMotion {
    /// Accelerations of the body.
    pub inertia: Inertia,
    /// Velocity of the point `grip_m` of the left and the right hand, m/s.
    pub hand_velocity_m_per_s: [[f64; 3]; 2],
    /// Duration of the window, ns: less than requested if the history stores less.
    pub span_ns: u64,
}

/// Motion at the newest snapshot by the samples of the last `span_ns`; `None` if they do not fill it. `grip_m`: a point
/// on each hand in its axes, m.
pub fn causal_motion(
    history: &History,
    span_ns: u64,
    accelerations: Accelerations,
    masses: &MassDistribution<'_>,
    grip_m: [Vector3<f64>; 2],
) -> Option<CausalMotion> {
    let (first, count) = history.last_samples(span_ns, SAMPLES_MIN)?;
    let snapshot = |position: usize| history.at(first + position as u64);
    let newest = snapshot(count - 1);
    let mut times_s = [0.0; CAPACITY];
    for (position, time_s) in times_s[..count].iter_mut().enumerate() {
        *time_s = -(newest.time_ns.saturating_sub(snapshot(position).time_ns) as f64) * 1e-9;
    }
    let weights = end_weights(&times_s[..count])?;
    let (mut motion, mut hand_velocity) = (Motion::zeroed(), [Vector3::zeros(); 2]);
    for position in 0..count {
        let (at, weight) = (snapshot(position), weights.first[position]);
        motion.add(at, weight, weights.second[position]);
        let [x, y] = at.station_from_suit_m;
        for side in Side::BOTH {
            let (hand, index) = (side.hand().index(), side as usize);
            // The anchor's shifts are no motion.
            let origin = Vector3::from(at.origin_m[hand]) - Vector3::new(x, y, 0.0);
            hand_velocity[index] += weight * (origin + rotation(at.orientation_wxyz[hand]) * grip_m[index]);
        }
    }
    let window = accelerations::Window { times_s: &times_s, count, weights: &weights };
    let is_by_suit =
        accelerations::apply_suit_accelerations(&mut motion, accelerations, newest, &window, snapshot);
    let time_sigma_ns = (0..count).map(|position| snapshot(position).time_sigma_ns).max().unwrap_or(0);
    Some(CausalMotion {
        inertia: Inertia { is_by_suit, time_sigma_ns, ..Inertia::of(newest, &motion, masses) },
        hand_velocity_m_per_s: hand_velocity.map(Into::into),
        span_ns: if count + 1 == CAPACITY { (-times_s[0] * 1e9) as u64 } else { span_ns },
    })
}

/// Weight of the wrench at `age` before the newest sample, as a fraction of the window in [0, 1], in the second
/// derivative's kernel: the cubic's second derivative at its end is the mean of the true one with the weights
/// `(1 − u²)² (1 + 7 u)`, u = 1 − 2 age; the parabola's in its middle has `(1 − u²)²`.
pub fn end_kernel(age: f64) -> f64 {
    let u = 1.0 - 2.0 * age;
    let bell = 1.0 - u * u;
    bell * bell * (1.0 + 7.0 * u)
}

/// Weights of a least-squares cubic at samples of `times_s` for its value and derivatives at time 0, by orthogonal
/// polynomials (Forsythe 1957). `None` if the times do not determine a cubic.
fn end_weights(times_s: &[f64]) -> Option<Weights> {
    let scale_s = times_s.iter().fold(0.0_f64, |largest, time| largest.max(time.abs()));
    if scale_s <= 0.0 || times_s.len() > CAPACITY {
        return None;
    }
    let mut weights = Weights { value: [0.0; CAPACITY], first: [0.0; CAPACITY], second: [0.0; CAPACITY] };
    let count = times_s.len() as f64;
    // Values of two successive polynomials at the samples, and their value and derivatives at 0.
    let (mut before, mut now) = ([0.0; CAPACITY], [1.0; CAPACITY]);
    let (mut before_at_0, mut now_at_0) = ([0.0; 3], [1.0, 0.0, 0.0]);
    let mut norm_before = 1.0;
    for degree in 0..=DEGREE {
        let sum = |of: fn(f64, f64) -> f64| -> f64 {
            times_s.iter().zip(&now).map(|(time, value)| of(time / scale_s, *value)).sum()
        };
        let norm = sum(|_, value| value * value);
        if norm < 1e-9 * count {
            return None;
        }
        for (index, value) in now[..times_s.len()].iter().enumerate() {
            weights.value[index] += now_at_0[0] * value / norm;
            weights.first[index] += now_at_0[1] * value / (norm * scale_s);
            weights.second[index] += now_at_0[2] * value / (norm * scale_s * scale_s);
        }
        let centre = sum(|x, value| x * value * value) / norm;
        let ratio = if degree == 0 { 0.0 } else { norm / norm_before };
        let [value, first, second] = now_at_0;
        let next_at_0 = [
            -centre * value - ratio * before_at_0[0],
            value - centre * first - ratio * before_at_0[1],
            2.0 * first - centre * second - ratio * before_at_0[2],
        ];
        for (index, time_s) in times_s.iter().enumerate() {
            let next = (time_s / scale_s - centre) * now[index] - ratio * before[index];
            (before[index], now[index]) = (now[index], next);
        }
        (before_at_0, now_at_0, norm_before) = (now_at_0, next_at_0, norm);
    }
    Some(weights)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::boxed::Box;

    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::body::{Anthropometry, SEGMENTS, Sex, Skeleton, gyration_m2};
    use crate::frame::{Pose, SuitWorld};
    use crate::motion::Snapshot;

    #[test]
    fn a_cubic_is_differentiated_exactly_at_its_end() {
        let times = [-0.14, -0.12, -0.105, -0.07, -0.052, -0.03, 0.0];
        let weights = end_weights(&times).unwrap();
        let [mut value, mut first, mut second] = [0.0; 3];
        for (index, time) in times.iter().enumerate() {
            let at = 3.0 - 2.0 * time + 7.0 * time * time + 90.0 * time * time * time;
            value += weights.value[index] * at;
            first += weights.first[index] * at;
            second += weights.second[index] * at;
        }
        assert!((value - 3.0).abs() < 1e-12 && (first + 2.0).abs() < 1e-10, "{value} {first}");
        assert!((second - 14.0).abs() < 1e-8, "{second}");
    }

    /// A body that oscillates forward at 1 Hz: the acceleration at the newest sample, not at the window's middle, with its
    /// sign; by positions, and blended with the suit's accelerations.
    #[test]
    fn the_acceleration_is_that_of_the_newest_sample() {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let gyration_m2 = gyration_m2(&skeleton, 1.77);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        let (omega, amplitude_m, span_ns) = (core::f64::consts::TAU, 0.05, 140_000_000);
        for (how, error_max) in [(Accelerations::Positions, 0.12), (Accelerations::Blend, 0.03)] {
            let mut history: Box<History> = bytemuck::zeroed_box();
            let (mut worst, mut of_middle) = (0.0_f64, 0.0_f64);
            for index in 1..=120u64 {
                let time_ns = index * 1_000_000_000 / 60;
                let time_s = time_ns as f64 * 1e-9;
                let by_m = amplitude_m * (omega * time_s).sin();
                let rest = skeleton.t_pose_m();
                let origin = rest.map(|origin| Vector3::from(origin) + Vector3::new(by_m, 0.0, 0.95));
                let pose = Pose::<SuitWorld>::new(origin, [UnitQuaternion::identity(); SEGMENTS]);
                let shifted = pose.shifted(Vector3::new(if index > 60 { 0.3 } else { 0.0 }, 0.0, 0.0));
                let acceleration = |at_s: f64| -amplitude_m * omega * omega * (omega * at_s).sin();
                let mut snapshot = Snapshot::new(time_ns, &pose, &shifted, &body);
                snapshot.has_acceleration = u64::from(how == Accelerations::Blend);
                // With a constant error, as of a tilted sensor.
                snapshot.acceleration_m_per_s2 = [[acceleration(time_s) + 0.2, 0.0, 0.0]; SEGMENTS];
                history.push(snapshot);
                let grip_m = [Vector3::zeros(); 2];
                let Some(motion) = causal_motion(&history, span_ns, how, &masses, grip_m) else {
                    assert!(index < 11, "no motion at sample {index}");
                    continue;
                };
                assert_eq!(motion.inertia.is_by_suit, how == Accelerations::Blend);
                let found = motion.inertia.acceleration_m_per_s2[0];
                worst = worst.max((found - acceleration(time_s)).abs());
                of_middle = of_middle.max((found - acceleration(time_s - 0.07)).abs());
                let velocity = amplitude_m * omega * (omega * time_s).cos();
                let hand = motion.hand_velocity_m_per_s[0][0];
                assert!((hand - velocity).abs() < 0.03 * amplitude_m * omega, "{hand} {velocity} m/s");
            }
            let largest = amplitude_m * omega * omega;
            assert!(worst < error_max * largest, "{how:?}: {worst} of {largest} m/s²");
            assert!(of_middle > 0.3 * largest, "{how:?}: {of_middle} m/s²");
        }
    }

    #[test]
    fn a_gap_or_a_start_within_the_window_gives_no_motion() {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let gyration_m2 = gyration_m2(&skeleton, 1.77);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        let origin = skeleton.t_pose_m().map(Vector3::from);
        let pose = Pose::<SuitWorld>::new(origin, [UnitQuaternion::identity(); SEGMENTS]);
        let mut history: Box<History> = bytemuck::zeroed_box();
        let mut found = |time_ms: u64| {
            history.push(Snapshot::new(time_ms * 1_000_000, &pose, &pose.shifted(Vector3::zeros()), &body));
            let grip_m = [Vector3::zeros(); 2];
            causal_motion(&history, 140_000_000, Accelerations::Positions, &masses, grip_m).is_some()
        };
        assert!((1..=15).all(|index| !found(index * 10)), "the window is not filled");
        assert!((16..40).all(|index| found(index * 10)));
        assert!((0..=14).all(|index| !found(600 + index * 10)), "a gap of 0.2 s");
        assert!(found(760));
    }

    #[test]
    fn too_few_times_carry_no_cubic() {
        assert!(end_weights(&[-0.1, -0.05, 0.0]).is_none());
        assert!(end_weights(&[-0.1, -0.1, -0.05, 0.0]).is_none());
        assert!(end_weights(&[0.0; 6]).is_none());
    }

    #[test]
    fn the_kernel_weighs_the_acceleration_as_the_cubic_does() {
        // x = t⁵ over the window [−1, 0] by many samples: the second derivative at the end by the weights is the mean of
        // 20 t³ by the kernel.
        let times: [f64; CAPACITY] = core::array::from_fn(|index| index as f64 / 63.0 - 1.0);
        let weights = end_weights(&times).unwrap();
        let by_weights: f64 = (0..CAPACITY).map(|index| weights.second[index] * times[index].powi(5)).sum();
        let (mut sum, mut total) = (0.0, 0.0);
        for index in 0..10_000 {
            let age = (f64::from(index) + 0.5) / 10_000.0;
            sum += end_kernel(age) * -20.0 * age * age * age;
            total += end_kernel(age);
        }
        assert!((by_weights - sum / total).abs() < 0.05 * by_weights.abs(), "{by_weights} {}", sum / total);
        // Its mean age is zero: no lag.
        let mean: f64 = (0..1000).map(|i| f64::from(i) * 1e-3 + 5e-4).map(|age| age * end_kernel(age)).sum();
        assert!(mean.abs() < 1e-3, "{mean}");
    }
}
