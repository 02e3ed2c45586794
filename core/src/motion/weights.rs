//! Derivatives of sampled motion: the least-squares parabola through samples at irregular times (Savitzky and Golay).

use super::history::CAPACITY;

/// Weights of a window's samples: `derivative = Σ weight · value`.
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    /// Weights of the smoothed value.
    pub value: [f64; CAPACITY],
    /// Weights of the first derivative, 1/s.
    pub first: [f64; CAPACITY],
    /// Weights of the second derivative, 1/s².
    pub second: [f64; CAPACITY],
}

/// The weights for samples at `times_s`, relative to the instant 0, at which the derivatives are taken.
///
/// `None` if the times do not determine a parabola: fewer than three distinct ones. Times beyond the first [`CAPACITY`]
/// are not used.
pub fn weights(times_s: &[f64]) -> Option<Weights> {
    let times_s = &times_s[..times_s.len().min(CAPACITY)];
    let scale_s = times_s.iter().fold(0.0_f64, |largest, time| largest.max(time.abs()));
    if scale_s <= 0.0 {
        return None;
    }
    // Powers of times in [−1, 1], so that the sums have similar magnitudes.
    let mut sums = [0.0; 5];
    for time in times_s {
        let mut power = 1.0;
        for sum in &mut sums {
            *sum += power;
            power *= time / scale_s;
        }
    }
    let [s0, s1, s2, s3, s4] = sums;
    // The rows of the inverse of the normal matrix that give height, slope and curvature.
    let determinant = s0 * (s2 * s4 - s3 * s3) - s1 * (s1 * s4 - s2 * s3) + s2 * (s1 * s3 - s2 * s2);
    if determinant < 1e-9 * s0 * s0 * s0 {
        return None;
    }
    let height = [s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2].map(|minor| minor / determinant);
    let slope = [s2 * s3 - s1 * s4, s0 * s4 - s2 * s2, s1 * s2 - s0 * s3].map(|minor| minor / determinant);
    let curvature =
        [s1 * s3 - s2 * s2, s1 * s2 - s0 * s3, s0 * s2 - s1 * s1].map(|minor| minor / determinant);
    let mut weights = Weights { value: [0.0; CAPACITY], first: [0.0; CAPACITY], second: [0.0; CAPACITY] };
    for (index, time) in times_s.iter().enumerate() {
        let x = time / scale_s;
        weights.value[index] = height[0] + x * (height[1] + x * height[2]);
        weights.first[index] = (slope[0] + x * (slope[1] + x * slope[2])) / scale_s;
        weights.second[index] =
            2.0 * (curvature[0] + x * (curvature[1] + x * curvature[2])) / (scale_s * scale_s);
    }
    Some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_differentiated_exactly_at_uneven_times() {
        let times = [-0.11, -0.07, -0.05, 0.0, 0.02, 0.06, 0.09];
        let weights = weights(&times).unwrap();
        let [mut smooth, mut first, mut second] = [0.0; 3];
        for (index, time) in times.iter().enumerate() {
            let value = 3.0 - 2.0 * time + 7.0 * time * time;
            smooth += weights.value[index] * value;
            first += weights.first[index] * value;
            second += weights.second[index] * value;
        }
        assert!((smooth - 3.0).abs() < 1e-12, "{smooth}");
        assert!((first + 2.0).abs() < 1e-11 && (second - 14.0).abs() < 1e-9, "{first} {second}");
    }

    #[test]
    fn seven_even_samples_have_the_weights_of_savitzky_and_golay() {
        // Savitzky and Golay 1964, second derivative, quadratic, 7 points: (5 0 −3 −4 −3 0 5)/42 per sample².
        let times = core::array::from_fn::<_, 7, _>(|index| index as f64 - 3.0);
        let weights = weights(&times).unwrap();
        for (weight, known) in weights.second.iter().zip([5.0, 0.0, -3.0, -4.0, -3.0, 0.0, 5.0]) {
            assert!((weight - known / 42.0).abs() < 1e-12);
        }
    }

    #[test]
    fn two_times_carry_no_parabola() {
        assert!(weights(&[-0.1, 0.1]).is_none());
        assert!(weights(&[-0.1, 0.1, 0.1, -0.1]).is_none());
        assert!(weights(&[0.0; 5]).is_none());
        assert!(weights(&[]).is_none());
    }
}
