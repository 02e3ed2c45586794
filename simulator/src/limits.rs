//! Joint and balance limits of poses without strain.

use equipoise_core::body::{Segment, Side};
use nalgebra::{UnitQuaternion, Vector3};

use crate::balance::Balanced;
use crate::stance::Stance;

/// Reason why a pose is unsuitable. Angles in whole degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strain {
    /// A foot has to leave its place; distance in millimetres.
    Reach(i32),
    /// A knee bends too far.
    Knee(i32),
    /// An ankle bends too far: dorsiflexion, or to the side.
    Ankle(i32, i32),
    /// A hip bends too far: flexion, or to the side.
    Hip(i32, i32),
    /// A hand reaches into the floor or into the trunk; height or distance in centimetres.
    Hand(i32),
}

const KNEE_DEG: [f64; 2] = [0.0, 140.0];
const ANKLE_DEG: [f64; 2] = [-25.0, 40.0];
const HIP_DEG: [f64; 2] = [-20.0, 120.0];
const SIDEWAYS_DEG: f64 = 35.0;
const HAND_ABOVE_FLOOR_M: f64 = 0.10;
const HAND_OFF_TRUNK_M: f64 = 0.13;

/// Whether a healthy adult can take this pose.
///
/// # Errors
/// The first [`Strain`] found.
pub fn check(body: &Balanced) -> Result<(), Strain> {
    if body.out_of_reach_m > 0.001 {
        return Err(Strain::Reach((1000.0 * body.out_of_reach_m) as i32));
    }
    for (k, side) in Side::BOTH.into_iter().enumerate() {
        let [upper, lower, foot, _] =
            Stance::leg(side).map(|segment| body.world_from_segment[segment.index()]);
        let knee_deg = body.knee_flexion_rad[k].to_degrees();
        if !inside(knee_deg, KNEE_DEG) {
            return Err(Strain::Knee(knee_deg as i32));
        }
        let [dorsiflexion, aside] = lean_deg(foot, lower);
        if !inside(dorsiflexion, ANKLE_DEG) || aside.abs() > SIDEWAYS_DEG {
            return Err(Strain::Ankle(dorsiflexion as i32, aside as i32));
        }
        let [extension, aside] = lean_deg(body.world_from_segment[Segment::Pelvis.index()], upper);
        if !inside(-extension, HIP_DEG) || aside.abs() > SIDEWAYS_DEG {
            return Err(Strain::Hip(-extension as i32, aside as i32));
        }
        let hand = body.origin_m[side.hand().index()];
        if hand.z < HAND_ABOVE_FLOOR_M {
            return Err(Strain::Hand((100.0 * hand.z) as i32));
        }
        for trunk in [Segment::Pelvis, Segment::L3, Segment::T8, Segment::Head] {
            let distance = (hand - body.origin_m[trunk.index()]).norm();
            if distance < HAND_OFF_TRUNK_M {
                return Err(Strain::Hand((100.0 * distance) as i32));
            }
        }
    }
    Ok(())
}

fn inside(angle_deg: f64, [low, high]: [f64; 2]) -> bool {
    (low..=high).contains(&angle_deg)
}

/// Inclination of the Z axis of `moved` in the axes of `reference`: forward and to the left, degrees.
fn lean_deg(reference: UnitQuaternion<f64>, moved: UnitQuaternion<f64>) -> [f64; 2] {
    let up = reference.inverse() * (moved * Vector3::z());
    [up.x.atan2(up.z).to_degrees(), up.y.atan2(up.x.hypot(up.z)).to_degrees()]
}
