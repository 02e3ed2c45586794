//! The worst joint's limit ratio, with the error of its selection.
//!
//! The largest of several uncertain ratios is on average larger than the ratio of the joint whose estimate is largest.
//! The 1-σ of η, the fraction of the load in the right hand, is 0.1 to 0.29, and one arm carries what the other does not.
//! The ratios of an arm's joints are proportional to the fraction in its hand; those of the other joints do not depend on
//! it. Mean and variance of the largest ratio therefore follow from the distribution of η.

use super::experience::LimitRatio;
use crate::body::{JOINTS, Joint, Side};
use crate::math;
use crate::overload::load_position::{EVEN, EVEN_SIGMA};

/// Points of the quadrature over η in [0, 1]: an interval is 0.4 σ of a well measured η.
const POINTS: usize = 25;
/// Smallest fraction by which a ratio is divided: the ratio at a smaller fraction is mostly error.
const ETA_MIN: f64 = 0.05;

/// The worst joint and its limit ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worst {
    /// The joint with the largest estimated ratio.
    pub joint: Joint,
    /// Mean and 1-σ of the largest ratio.
    pub ratio: LimitRatio,
}

/// The hand load fractions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandFractions {
    /// η, left and right.
    pub eta: [f64; 2],
    /// 1-σ; the errors of the two hands are equal and opposite.
    pub sigma: f64,
}

/// The hand (left 0, right 1) that alone is distal of a joint.
fn hand_of(joint: Joint) -> Option<usize> {
    match Side::BOTH.map(|side| side.hand().is_distal_to(joint.segment())) {
        [true, false] => Some(0),
        [false, true] => Some(1),
        _ => None,
    }
}

/// The worst of joints with these ratios; `None` without a finite ratio.
pub fn worst(ratio: &[LimitRatio; JOINTS], hands: &HandFractions) -> Option<Worst> {
    let finite = || Joint::ALL.into_iter().filter(|joint| ratio[joint.index()].value.is_finite());
    let joint = finite().max_by(|a, b| ratio[a.index()].value.total_cmp(&ratio[b.index()].value))?;
    let sigma = hands.sigma.min(EVEN_SIGMA);
    if sigma.is_nan() || sigma <= 0.0 {
        return Some(Worst { joint, ratio: ratio[joint.index()] });
    }
    // For the joints of the left arm, of the right arm, and the others: the largest ratio, and its variance without the
    // part due to η.
    let mut group = [(0.0, 0.0); 3];
    for joint in finite() {
        let (hand, LimitRatio { value, sigma: all }) = (hand_of(joint), ratio[joint.index()]);
        let slope = hand.map_or(0.0, |hand| value / hands.eta[hand].max(ETA_MIN));
        let largest = &mut group[hand.unwrap_or(2)];
        if value > largest.0 {
            *largest = (value, (all * all - slope * slope * sigma * sigma).max(0.0));
        }
    }
    let (mut weight, mut sum, mut square, mut rest) = (0.0, 0.0, 0.0, 0.0);
    for point in 0..POINTS {
        let right = (point as f64 + 0.5) / POINTS as f64;
        let scale = [(1.0 - right) / hands.eta[0].max(ETA_MIN), right / hands.eta[1].max(ETA_MIN), 1.0];
        let scaled = [0, 1, 2].map(|index: usize| (group[index].0 * scale[index], group[index].1));
        let largest = scaled.into_iter().fold(scaled[2], |a, b| if b.0 > a.0 { b } else { a });
        let here = density(right, hands.eta[1], sigma);
        weight += here;
        sum += here * largest.0;
        square += here * largest.0 * largest.0;
        rest += here * largest.1;
    }
    let mean = sum / weight;
    let variance = (square / weight - mean * mean).max(0.0) + rest / weight;
    Some(Worst { joint, ratio: LimitRatio { value: mean, sigma: math::sqrt(variance) } })
}

/// Density of η up to a constant factor: uniform in [0, 1] times the likelihood of the measurement. The estimate is the
/// product of that likelihood and a normal distribution with mean and variance of the uniform one; division by the normal
/// distribution leaves the likelihood.
fn density(right: f64, eta: f64, sigma: f64) -> f64 {
    let [by_both, by_prior] = [(right - eta) / sigma, (right - EVEN) / EVEN_SIGMA];
    math::exp(0.5 * (by_prior * by_prior - by_both * by_both))
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVEN_HANDS: [f64; 2] = [0.5, 0.5];

    /// Ratios of these joints, with this 1-σ; zero for the others.
    fn ratios(of: &[(&str, f64)], sigma: f64) -> [LimitRatio; JOINTS] {
        Joint::ALL.map(|joint| {
            let value = of.iter().find(|(name, _)| *name == joint.name()).map_or(0.0, |(_, value)| *value);
            LimitRatio { value, sigma }
        })
    }

    #[test]
    fn without_a_measured_fraction_the_larger_of_two_equal_arms_exceeds_either() {
        let wrists = ratios(&[("LeftWrist", 0.6), ("RightWrist", 0.6)], 0.4);
        let found = worst(&wrists, &HandFractions { eta: EVEN_HANDS, sigma: EVEN_SIGMA }).unwrap();
        // The larger of η and 1 − η, uniform: mean 3/4, variance 1/48; each over 1/2, times 0.6. The rest of the variance
        // is 0.4² − (0.6/0.5)² σ².
        assert!((found.ratio.value - 0.9).abs() < 2e-3, "{found:?}");
        let variance = 1.44 / 48.0 + 0.16 - 1.44 * EVEN_SIGMA * EVEN_SIGMA;
        assert!((found.ratio.sigma - variance.sqrt()).abs() < 4e-3, "{found:?} {variance}");
    }

    #[test]
    fn a_measured_fraction_and_a_joint_of_the_trunk_leave_little_to_select() {
        let wrists = ratios(&[("LeftWrist", 0.3), ("RightWrist", 0.9)], 0.1);
        let found = worst(&wrists, &HandFractions { eta: [0.25, 0.75], sigma: 0.03 }).unwrap();
        assert_eq!(found.joint.name(), "RightWrist");
        assert!(
            (found.ratio.value - 0.9).abs() < 0.005 && (found.ratio.sigma - 0.1).abs() < 0.01,
            "{found:?}"
        );
        let back = ratios(&[("LeftWrist", 0.3), ("RightWrist", 0.3), ("L5S1", 0.8)], 0.1);
        let found = worst(&back, &HandFractions { eta: EVEN_HANDS, sigma: 0.2 }).unwrap();
        assert_eq!(found.joint.name(), "L5S1");
        let off = [found.ratio.value - 0.8, found.ratio.sigma - 0.1];
        assert!(off.iter().all(|off| off.abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn an_exact_fraction_selects_the_largest_estimate_and_no_limit_no_joint() {
        let wrists = ratios(&[("LeftWrist", 0.6), ("RightWrist", 0.7)], 0.2);
        let found = worst(&wrists, &HandFractions { eta: EVEN_HANDS, sigma: 0.0 }).unwrap();
        assert_eq!((found.joint.name(), found.ratio), ("RightWrist", LimitRatio { value: 0.7, sigma: 0.2 }));
        let none = [LimitRatio { value: f64::NAN, sigma: f64::NAN }; JOINTS];
        assert_eq!(worst(&none, &HandFractions { eta: EVEN_HANDS, sigma: 0.2 }), None);
    }
}
