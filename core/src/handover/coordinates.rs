//! Coordinates of a posture with standing feet: pelvis, trunk and arms; the legs follow by inverse kinematics.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::FootPlacement;
use crate::body::{SEGMENTS, Segment, Side, Skeleton};
use crate::frame::{Pose, StationWorld};
use crate::math;

/// Number of coordinates.
pub(super) const COORDINATES: usize = 17;

/// Pelvis relative to the middle between the ankles, forward and to the left, m; shortening of the legs by flexed knees,
/// as a fraction of their length; tilt of the pelvis forward; flexion of the spine forward, to the right and twist to
/// the left; then for each arm the rotation vector of the upper arm from hanging down (trunk's axes) and the flexion of
/// the elbow; then the deviation of each wrist toward the little finger. Angles in rad.
pub(super) type Coordinates = [f64; COORDINATES];

const DEGREE: f64 = core::f64::consts::PI / 180.0;
/// Index of the first coordinate of the left and right arm.
const ARM: [usize; 2] = [7, 11];
/// Middle of the lowest-scored zone of each coordinate.
pub(super) const MEAN: Coordinates =
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ELBOW_RAD, 0.0, 0.0, 0.0, ELBOW_RAD, 0.0, 0.0];
/// 1-σ of each coordinate: the width of its comfortable zone.
///
/// REBA (Hignett & McAtamney 2000): trunk to 20°, upper arm to 20°, elbow 60 to 100°, knees to 60°, which shortens the
/// legs by 13 %; lateral flexion and torsion of the trunk to 10° (EN 1005-4). The pelvis has no zone: its wide σ leaves
/// it to the balance.
const SIGMA: Coordinates = [
    PELVIS_SIGMA_M,
    PELVIS_SIGMA_M,
    0.134,
    TRUNK_RAD,
    TRUNK_RAD,
    10.0 * DEGREE,
    10.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    20.0 * DEGREE,
    WRIST_RAD,
    WRIST_RAD,
];
/// REBA's wrist to 15°.
const WRIST_RAD: f64 = 15.0 * DEGREE;
/// Index of the wrists: the last coordinates.
pub(super) const WRIST: usize = 15;
/// 1-σ of the difference between the slopes of a hand and of its handle, rad: assumed.
pub(super) const SLOPE_SIGMA_RAD: f64 = 10.0 * DEGREE;
const PELVIS_SIGMA_M: f64 = 0.2;
const TRUNK_RAD: f64 = 20.0 * DEGREE;
/// 1-σ of an inclination backwards: that of upright people.
const BACKWARDS_RAD: f64 = 5.0 * DEGREE;
/// 1-σ of the difference between the tilt of the pelvis and the flexion of the spine: a trunk that bends forward does
/// so about evenly in both (Esola et al., Spine 21 (1996) 71–78: lumbar over hip motion 1.9, 0.9, 0.4 in thirds).
const RHYTHM_SIGMA_RAD: f64 = 10.0 * DEGREE;
const ELBOW_RAD: f64 = 80.0 * DEGREE;

/// The centre of pressure of standing people is this far ahead of the ankles, m (Winter, Gait & Posture 3 (1995)
/// 193–214: 4 to 6 cm) …
pub(super) const COP_AHEAD_M: f64 = 0.05;
/// … with this 1-σ while they hold something, m: a third of the way from there to the toes.
pub(super) const COP_SIGMA_M: f64 = 0.03;
/// Farther than this from there, in σ, people step or fall.
pub(super) const COP_OFF_MAX_SIGMAS: f64 = 3.0;
/// 1-σ of the hands' places on the part, m: about the breadth of a finger, as that of the point of action on a hand.
pub(super) const HAND_SIGMA_M: f64 = 0.01;

/// Below the lower of the heights that both legs allow by at most half of this, m.
const ROUNDING_M: f64 = 0.005;

/// Segments of the spine, which share its bend evenly.
const SPINE: [Segment; 4] = [Segment::L5, Segment::L3, Segment::T12, Segment::T8];

/// Distance of each coordinate from the middle of its zone, in σ.
pub(super) fn off_zone(coordinates: &Coordinates) -> Coordinates {
    let mut off = core::array::from_fn(|index| (coordinates[index] - MEAN[index]) / SIGMA[index]);
    let [_, _, _, tilt_rad, flexion_rad, ..] = *coordinates;
    let inclination_rad = tilt_rad + flexion_rad;
    // Backwards there is no comfortable zone (ISO 11226).
    off[3] = inclination_rad / if inclination_rad < 0.0 { BACKWARDS_RAD } else { TRUNK_RAD };
    off[4] = (tilt_rad - flexion_rad) / RHYTHM_SIGMA_RAD;
    off
}

/// The pose of coordinates over standing feet.
pub(super) fn pose(
    coordinates: &Coordinates,
    skeleton: &Skeleton,
    feet: &FootPlacement,
    world_from_feet: UnitQuaternion<f64>,
) -> Pose<StationWorld> {
    let [ahead_m, aside_m, shorter, tilt_rad, flexion_rad, right_rad, left_rad, ..] = *coordinates;
    let mut rotation = [world_from_feet; SEGMENTS];
    let turn = |[x, y, z]: [f64; 3]| UnitQuaternion::from_scaled_axis(Vector3::new(x, y, z));
    rotation[0] = world_from_feet * turn([0.0, tilt_rad, 0.0]);
    let bend = turn([right_rad, flexion_rad, left_rad].map(|angle| angle / SPINE.len() as f64));
    for segment in Segment::ALL {
        let Some(parent) = segment.parent() else { continue };
        let bends = SPINE.contains(&segment);
        rotation[segment.index()] = rotation[parent.index()] * if bends { bend } else { turn([0.0; 3]) };
    }
    for (side, at) in Side::BOTH.into_iter().zip(ARM) {
        let sign = if side == Side::Left { 1.0 } else { -1.0 };
        let [x, y, z, elbow_rad] = [0, 1, 2, 3].map(|index| coordinates[at + index]);
        let hand = side.hand().index();
        // T-pose to hanging down: the arm's Y axis points down.
        let hanging = turn([-sign * core::f64::consts::FRAC_PI_2, 0.0, 0.0]);
        let upper_arm = rotation[hand - 3] * turn([x, y, z]) * hanging;
        rotation[hand - 2] = upper_arm;
        rotation[hand - 1] = upper_arm * turn([0.0, 0.0, -sign * elbow_rad]);
        // The thumb is up, so deviation toward the little finger lowers the hand.
        rotation[hand] = rotation[hand - 1] * turn([0.0, 0.0, sign * coordinates[WRIST + side as usize]]);
    }
    let from_pelvis_m = skeleton.origins_m(&rotation);
    let middle_m = feet.middle_m();
    let pelvis_xy = middle_m + world_from_feet * Vector3::new(ahead_m, aside_m, 0.0);
    let height_m = |foot: usize| {
        let hip_m = from_pelvis_m[Side::BOTH[foot].foot().index() - 2];
        let [upper_m, lower_m] = leg_m(skeleton, Side::BOTH[foot]);
        let straight_m = upper_m + lower_m;
        let leg_m = lower_of(straight_m, straight_m * (1.0 - shorter));
        let ankle_m = feet.ankle_m[foot];
        let level = [pelvis_xy.x + hip_m.x - ankle_m.x, pelvis_xy.y + hip_m.y - ankle_m.y];
        let rest = leg_m * leg_m - level[0] * level[0] - level[1] * level[1];
        ankle_m.z + math::sqrt(rest.max(0.0)) - hip_m.z
    };
    let pelvis_m = Vector3::new(pelvis_xy.x, pelvis_xy.y, lower_of(height_m(0), height_m(1)));
    let mut origin = from_pelvis_m.map(|from_pelvis| from_pelvis + pelvis_m);
    for (foot, side) in Side::BOTH.into_iter().enumerate() {
        let ankle = side.foot().index();
        let forward = feet.world_from_foot[foot] * Vector3::x();
        let [upper, lower] =
            leg_rotations(origin[ankle - 2], feet.ankle_m[foot], leg_m(skeleton, side), forward);
        (rotation[ankle - 2], rotation[ankle - 1]) = (upper, lower);
        (rotation[ankle], rotation[ankle + 1]) = (feet.world_from_foot[foot], feet.world_from_foot[foot]);
        origin[ankle - 1] = origin[ankle - 2] + upper * Vector3::from(skeleton.offset_m[ankle - 1]);
        origin[ankle] = feet.ankle_m[foot];
        origin[ankle + 1] = origin[ankle] + rotation[ankle] * Vector3::from(skeleton.offset_m[ankle + 1]);
    }
    Pose::new(origin, rotation)
}

/// The lower of two heights, rounded off where they meet, and never above it: in a symmetric posture the derivative
/// exists.
fn lower_of(a_m: f64, b_m: f64) -> f64 {
    0.5 * (a_m + b_m - math::hypot([a_m - b_m, ROUNDING_M]))
}

/// Lengths of upper and lower leg, m.
fn leg_m(skeleton: &Skeleton, side: Side) -> [f64; 2] {
    let foot = side.foot().index();
    [foot - 1, foot].map(|index| Vector3::from(skeleton.offset_m[index]).norm())
}

/// Rotations of upper and lower leg from the hip to the ankle, with the knee in the direction `forward`.
fn leg_rotations(
    hip_m: Vector3<f64>,
    ankle_m: Vector3<f64>,
    [upper_m, lower_m]: [f64; 2],
    forward: Vector3<f64>,
) -> [UnitQuaternion<f64>; 2] {
    let down = ankle_m - hip_m;
    let length_m = down.norm().max(1e-6);
    let down = down / length_m;
    let ahead = (forward - down * forward.dot(&down)).normalize();
    let left = ahead.cross(&down);
    // Angle at the hip and at the ankle by the law of cosines, zero for a leg that is too short.
    let angle = |near_m: f64, far_m: f64| {
        let cosine = (near_m * near_m + length_m * length_m - far_m * far_m) / (2.0 * near_m * length_m);
        math::acos(cosine.clamp(-1.0, 1.0))
    };
    let along = |angle_rad: f64| {
        let (sine, cosine) = math::sin_cos(angle_rad);
        let up = -(down * cosine + ahead * sine);
        let axes = Matrix3::from_columns(&[left.cross(&up), left, up]);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
    };
    [along(angle(upper_m, lower_m)), along(-angle(lower_m, upper_m))]
}
