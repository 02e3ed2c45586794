//! Which pose to ask for next, from a library of poses that people can hold (Fortini et al., §III-C, Eq. 11).

pub mod library;
pub mod posture;

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use crate::body::{SEGMENTS, Segment};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::sesc::PARAMETERS;

pub use posture::Posture;

/// How many performed poses Eq. 11 looks back on; older ones give way.
const MEMORY: usize = 64;
/// Most poses a library may have: one bit each remembers which were asked for.
pub const LIBRARY_MAX: usize = 64;

/// A pose as Eq. 11 compares it: one rotation vector per segment, rad.
pub type Coordinates = [f64; PARAMETERS];

/// Poses performed and suggested so far.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Performed {
    coordinates_rad: [Coordinates; MEMORY],
    /// How many poses were performed in all.
    count: u64,
    /// One bit per pose of the library that was already asked for.
    asked: u64,
}

/// The coordinates of a pose: the pelvis against the world without its heading, other segments against their parents.
pub fn coordinates(pose: &Pose<StationWorld>) -> Coordinates {
    let joints = pose.joint_rotations();
    let pelvis = pose.world_from_segment[Segment::Pelvis.index()];
    // Where the worker faces says nothing about the pose.
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
    /// Remembers a performed pose.
    pub fn push(&mut self, coordinates_rad: Coordinates) {
        self.coordinates_rad[self.count as usize % MEMORY] = coordinates_rad;
        self.count += 1;
    }

    /// How many poses were performed.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether every number is finite; a stored memory is checked before use.
    pub fn is_sound(&self) -> bool {
        self.coordinates_rad.iter().flatten().all(|value| value.is_finite())
    }

    /// Eq. 11: the pose farthest from all performed ones, `argmax Σ_j √(Σ_r w_r (x_jr − y_r)²)`, with the variances
    /// of Φ, over their largest, as weights w. Poses already asked for are left out until all were.
    ///
    /// Before any pose was performed it is the first of the library. `None` only for an empty library.
    pub fn suggest(&mut self, library: &[Posture], phi_variance_m2: &[f64; PARAMETERS]) -> Option<usize> {
        let library = &library[..library.len().min(LIBRARY_MAX)];
        let all = if library.len() == LIBRARY_MAX { u64::MAX } else { (1 << library.len()) - 1 };
        if self.asked & all == all {
            self.asked = 0;
        }
        let largest = phi_variance_m2.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
        let weight = phi_variance_m2.map(|variance| variance / largest);
        let performed = &self.coordinates_rad[..(self.count as usize).min(MEMORY)];

        let mut best: Option<(usize, f64)> = None;
        for (index, posture) in library.iter().enumerate().filter(|(index, _)| self.asked & (1 << index) == 0)
        {
            let candidate = coordinates_of(posture);
            let distance: f64 =
                performed.iter().map(|pose| weighted_distance(pose, &candidate, &weight)).sum();
            if best.is_none_or(|(_, farthest)| distance > farthest) {
                best = Some((index, distance));
            }
        }
        let (index, _) = best?;
        self.asked |= 1 << index;
        Some(index)
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
    fn the_farthest_pose_is_asked_for_and_then_not_again() {
        let library = [posture("stand", 0, 0), posture("a little", 20, 0), posture("far", 90, 60)];
        let mut memory = performed(&library[0]);
        let even = [1.0; PARAMETERS];
        let asked: [usize; 4] = core::array::from_fn(|_| memory.suggest(&library, &even).unwrap());
        assert_eq!(asked, [2, 1, 0, 2]);
    }

    #[test]
    fn an_unsure_segment_draws_the_choice() {
        let library = [posture("elbow", 60, 0), posture("knee", 0, 50)];
        let mut variance = [1e-6; PARAMETERS];
        variance[3 * Segment::LeftLowerLeg.index() + 1] = 1.0;
        assert_eq!(performed(&posture("stand", 0, 0)).suggest(&library, &variance), Some(1));
        assert_eq!(performed(&posture("stand", 0, 0)).suggest(&library, &[1.0; PARAMETERS]), Some(0));
    }

    #[test]
    fn no_library_no_suggestion() {
        let mut memory: Performed = Zeroable::zeroed();
        assert_eq!(memory.suggest(&[], &[1.0; PARAMETERS]), None);
    }
}
