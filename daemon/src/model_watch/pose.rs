//! Finds the limb whose pose correlates with the residual.

use std::fmt;

use equipoise_core::body::Segment;
use nalgebra::{Matrix3, Vector3};

/// Minimum fraction of the variance that a limb's pose must explain.
const EXPLAINED_MIN: f64 = 0.5;
/// A limb that moves less than this is ignored, m.
const MOVED_MIN_M: f64 = 0.03;

/// A part of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limb {
    /// From the pelvis to T8.
    Trunk,
    /// From the right shoulder to the hand.
    RightArm,
    /// From the left shoulder to the hand.
    LeftArm,
    /// From the feet to the pelvis.
    Legs,
}

impl Limb {
    const ALL: [Limb; 4] = [Limb::Trunk, Limb::RightArm, Limb::LeftArm, Limb::Legs];
}

impl fmt::Display for Limb {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Limb::Trunk => "trunk",
            Limb::RightArm => "right arm",
            Limb::LeftArm => "left arm",
            Limb::Legs => "legs",
        })
    }
}

/// Vector from one end of each limb to the other, in the order of the limbs, m.
pub(super) type Features = [[f64; 3]; 4];

/// The limb vectors of a pose.
pub(super) fn features(origin_m: impl Fn(Segment) -> [f64; 3]) -> Features {
    let between = |from: [f64; 3], to: [f64; 3]| std::array::from_fn(|axis| to[axis] - from[axis]);
    let feet = [Segment::LeftFoot, Segment::RightFoot].map(&origin_m);
    let middle = std::array::from_fn(|axis| 0.5 * (feet[0][axis] + feet[1][axis]));
    [
        between(origin_m(Segment::Pelvis), origin_m(Segment::T8)),
        between(origin_m(Segment::RightUpperArm), origin_m(Segment::RightHand)),
        between(origin_m(Segment::LeftUpperArm), origin_m(Segment::LeftHand)),
        between(middle, origin_m(Segment::Pelvis)),
    ]
}

/// The limb whose pose explains most of the variance of `residual` in a linear model; `None` if none explains half of
/// it.
pub(super) fn correlated_limb(residual: &[f64], poses: &[Features]) -> Option<Limb> {
    let explained = Limb::ALL.into_iter().enumerate().filter_map(|(index, limb)| {
        let pose: Vec<[f64; 3]> = poses.iter().map(|pose| pose[index]).collect();
        Some((limb, explained_fraction(residual, &pose)?))
    });
    let (limb, explained_fraction) = explained.max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    (explained_fraction >= EXPLAINED_MIN).then_some(limb)
}

/// Fraction of the variance of `residual` explained by three coordinates (adjusted R²).
fn explained_fraction(residual: &[f64], pose: &[[f64; 3]]) -> Option<f64> {
    let count = residual.len() as f64;
    if residual.len() < 8 {
        return None;
    }
    let deviation = residual.iter().sum::<f64>() / count;
    let pose_mean = pose.iter().map(|at| Vector3::from(*at)).sum::<Vector3<f64>>() / count;
    let rows = || residual.iter().zip(pose).map(|(y, at)| (y - deviation, Vector3::from(*at) - pose_mean));
    let moved_m2 = rows().map(|(_, x)| x.norm_squared()).sum::<f64>() / count;
    if moved_m2 < MOVED_MIN_M * MOVED_MIN_M {
        return None;
    }
    // Ridge of (1 mm)², so that coordinates with little variation explain nothing.
    let ridge = Matrix3::identity() * (1e-6 * count);
    let normal = rows().map(|(_, x)| x * x.transpose()).sum::<Matrix3<f64>>() + ridge;
    let slope = normal.cholesky()?.solve(&rows().map(|(y, x)| x * y).sum::<Vector3<f64>>());
    let total: f64 = rows().map(|(y, _)| y * y).sum();
    let remaining: f64 = rows().map(|(y, x)| (y - x.dot(&slope)).powi(2)).sum();
    let adjusted = (count - 1.0) / (count - 4.0);
    (total > 0.0).then(|| 1.0 - adjusted * remaining / total)
}
