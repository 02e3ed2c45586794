//! Selects the next pose from a library of feasible poses: by Eq. 11 (Fortini et al., §III-C), or by the information
//! gain of the pose ([`gain`]).

pub mod gain;
pub mod library;
pub mod planner;
pub mod posture;

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use crate::body::{SEGMENTS, Segment};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::sesc::PARAMETERS;

pub use planner::Planner;
pub use posture::Posture;

/// Number of performed poses used in Eq. 11; older ones are dropped.
const MEMORY: usize = 64;
/// Maximum size of a library: one bit per pose records which were suggested.
pub const LIBRARY_MAX: usize = 64;

/// A pose as used in Eq. 11: one rotation vector per segment, rad.
pub type Coordinates = [f64; PARAMETERS];

/// Poses performed so far.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Performed {
    coordinates_rad: [Coordinates; MEMORY],
    /// Total number of poses performed.
    count: u64,
}

/// The coordinates of a pose: the pelvis relative to the world without its heading, other segments relative to their
/// parents.
pub fn coordinates(pose: &Pose<StationWorld>) -> Coordinates {
    let joints = pose.joint_rotations();
    let pelvis = pose.world_from_segment[Segment::Pelvis.index()];
    // The heading of the subject is no part of the pose.
    let (_, _, heading) = pelvis.euler_angles();
    let unturned = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -heading) * pelvis;
    let mut all = [0.0; PARAMETERS];
    for segment in 0..SEGMENTS {
        let rotation = if segment == 0 { unturned } else { joints[segment - 1] };
        all[3 * segment..3 * segment + 3].copy_from_slice(rotation.scaled_axis().as_slice());
    }
    all
}

fn coordinates_of(posture: &Posture) -> Coordinates {
    core::array::from_fn(|index| f64::from(posture.rotation_deg[index / 3][index % 3]).to_radians())
}

impl Performed {
    /// Stores a performed pose.
    pub fn push(&mut self, coordinates_rad: Coordinates) {
        self.coordinates_rad[self.count as usize % MEMORY] = coordinates_rad;
        self.count += 1;
    }

    /// Number of poses performed.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The stored poses, oldest first.
    pub fn poses(&self) -> impl Iterator<Item = &Coordinates> {
        let kept = self.count.min(MEMORY as u64);
        (self.count - kept..self.count).map(|pose| &self.coordinates_rad[pose as usize % MEMORY])
    }

    /// A history of `count` poses with the last ones given, oldest first; those beyond the capacity are skipped.
    pub fn of(count: u64, last: impl Iterator<Item = Coordinates>) -> Performed {
        let mut performed = Performed { count: count.saturating_sub(MEMORY as u64), ..Zeroable::zeroed() };
        last.take(count.min(MEMORY as u64) as usize).for_each(|pose| performed.push(pose));
        performed
    }

    /// Copies the entries in use from another history.
    pub(crate) fn copy_from(&mut self, other: &Performed) {
        let kept = other.count.min(MEMORY as u64) as usize;
        self.coordinates_rad[..kept].copy_from_slice(&other.coordinates_rad[..kept]);
        self.count = other.count;
    }

    /// Whether count and numbers are in range; a stored memory is checked before use. A rotation vector is at most π long.
    pub fn is_sound(&self) -> bool {
        let is_angle = |value: &f64| value.abs() <= core::f64::consts::PI + 1e-9;
        self.count < 1 << 32 && self.coordinates_rad.iter().flatten().all(is_angle)
    }

    /// Eq. 11 for one candidate: its distance from all performed poses, `Σ_j √(Σ_r w_r (x_jr − y_r)²)`, rad, with the
    /// variances of Φ, over their largest, as weights w. The paper selects the largest distance.
    pub fn distance(&self, candidate: &Posture, phi_variance_m2: &[f64; PARAMETERS]) -> f64 {
        let largest = phi_variance_m2.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
        let weight = phi_variance_m2.map(|variance| variance / largest);
        let candidate = coordinates_of(candidate);
        let performed = &self.coordinates_rad[..(self.count as usize).min(MEMORY)];
        performed.iter().map(|pose| weighted_distance(pose, &candidate, &weight)).sum()
    }
}

fn weighted_distance(a: &Coordinates, b: &Coordinates, weight: &[f64; PARAMETERS]) -> f64 {
    let square: f64 = a.iter().zip(b).zip(weight).map(|((a, b), weight)| weight * (a - b) * (a - b)).sum();
    math::sqrt(square)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn posture(name: &'static str, elbow_deg: i16, knee_deg: i16) -> Posture {
        let mut rotation_deg = [[0; 3]; SEGMENTS];
        rotation_deg[Segment::LeftForearm.index()] = [0, 0, elbow_deg];
        rotation_deg[Segment::LeftLowerLeg.index()] = [0, knee_deg, 0];
        Posture { name, rotation_deg }
    }

    fn performed(posture: &Posture) -> Performed {
        let mut memory: Performed = Zeroable::zeroed();
        memory.push(coordinates_of(posture));
        memory
    }

    #[test]
    fn the_distance_grows_with_angles_and_variances() {
        let (stand, elbow, knee) = (posture("stand", 0, 0), posture("elbow", 60, 0), posture("knee", 0, 50));
        let memory = performed(&stand);
        let mut variance = [1.0; PARAMETERS];
        assert_eq!(memory.distance(&stand, &variance), 0.0);
        assert!((memory.distance(&elbow, &variance) - 60f64.to_radians()).abs() < 1e-12);
        assert!(memory.distance(&elbow, &variance) > memory.distance(&knee, &variance));
        variance[3 * Segment::LeftForearm.index() + 2] = 0.01;
        assert!((memory.distance(&elbow, &variance) - 6f64.to_radians()).abs() < 1e-12);
        assert!(memory.distance(&elbow, &variance) < memory.distance(&knee, &variance));
    }

    #[test]
    fn distances_from_all_performed_poses_add_up() {
        let (stand, elbow) = (posture("stand", 0, 0), posture("elbow", 60, 0));
        let mut memory = performed(&stand);
        memory.push(coordinates_of(&stand));
        assert!((memory.distance(&elbow, &[1.0; PARAMETERS]) - 120f64.to_radians()).abs() < 1e-12);
    }
}
