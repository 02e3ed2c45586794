//! Less common streams of a suit: angular motion, trackers, ergonomic angles, fingers, props, time of day.

use equipoise_core::body::{SEGMENTS, Segment, Side};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::kinematics::Rotations;
use crate::suit_sender::Streams;
use crate::wire::{More, joint_angles_deg, single};
use crate::wires::mvn::items::{TRACKED_SEGMENTS, Tracker};

/// The magnetic field in the suit's world, in units of its strength: northward and down.
const FIELD: [f64; 3] = [0.5, 0.0, -0.866];
/// Time of day at the suit's clock zero, ms: noon.
const STARTED_AT_MS: u32 = 12 * 3600 * 1000;
/// Phalanges of a finger from the wrist along the hand, parts of the hand's reach to the grip.
const PHALANGES: [f64; 4] = [0.4, 1.4, 2.0, 2.4];

/// Segment origins and rotations at one time.
pub(crate) type SegmentPoses = ([Point3<f64>; SEGMENTS], Rotations);

/// The selected ones of these streams, from three states `step_s` apart.
pub(crate) fn more(
    streams: Streams,
    time_code_ms: u32,
    grip_m: &[Vector3<f64>; 2],
    [before, now, after]: &[SegmentPoses; 3],
    step_s: f64,
) -> More {
    let (origin_m, rotation) = now;
    let angular = angular(&[before.1, now.1, after.1], step_s);
    let free = |i: usize| ((after.0[i] - origin_m[i]) - (origin_m[i] - before.0[i])) / (step_s * step_s);
    let trackers = streams.trackers.then(|| {
        TRACKED_SEGMENTS.map(|id| {
            let i = id as usize - 1;
            let in_sensor = |vector: Vector3<f64>| single((rotation[i].inverse() * vector).into());
            Tracker {
                segment_id: id,
                orientation_wxyz: single(wxyz(rotation[i])),
                free_acceleration: single(free(i).into()),
                measured: Some([
                    in_sensor(free(i) + Vector3::z() * GRAVITY_M_PER_S2),
                    in_sensor(Vector3::from(angular[i][0])),
                ]),
                magnetic: in_sensor(FIELD.into()),
            }
        })
    });
    let markers = || (0..SEGMENTS).map(|i| ((i as u32 + 1) << 8 | 1, origin_m[i].coords.into())).collect();
    let props = (0..streams.props).map(|number| {
        let hand = Segment::RightHand.index();
        let ahead = Vector3::x() * (0.1 * f64::from(number));
        ((origin_m[hand] + rotation[hand] * (grip_m[1] + ahead)).coords.into(), wxyz(rotation[hand]))
    });
    More {
        without_quaternions: streams.without_quaternions,
        euler: streams.euler,
        unity: streams.unity,
        markers_m: if streams.markers { markers() } else { Vec::new() },
        ergonomic_deg: streams.ergonomic.then(|| ergonomic_deg(rotation)),
        angular: streams.angular.then_some(angular),
        trackers: trackers.map_or_else(Vec::new, Vec::from),
        com_motion: None, // requires the model's centres; filled in by the sender
        time_of_day_ms: streams.time_of_day.then_some(STARTED_AT_MS.wrapping_add(time_code_ms)),
        old_sizes: streams.old_sizes,
        props: props.collect(),
        fingers: if streams.fingers { fingers(now, grip_m) } else { Vec::new() },
    }
}

fn wxyz(q: UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

/// Angular velocity (rad/s) and acceleration (rad/s²) in the world, from rotations a step apart.
fn angular([before, now, after]: &[Rotations; 3], step_s: f64) -> [[[f64; 3]; 2]; SEGMENTS] {
    core::array::from_fn(|i| {
        let came = (now[i] * before[i].inverse()).scaled_axis() / step_s;
        let goes = (after[i] * now[i].inverse()).scaled_axis() / step_s;
        [((came + goes) * 0.5).into(), ((goes - came) / step_s).into()]
    })
}

/// The six ergonomic angles, in the axes of the joint angles: rotation of each segment relative to the other.
fn ergonomic_deg(rotation: &Rotations) -> [[f64; 3]; 6] {
    let of = |segment: Segment| rotation[segment.index()];
    // Relative to the vertical a segment has no heading, only an inclination.
    let upright = |segment: Segment| {
        let forward = of(segment) * Vector3::x();
        UnitQuaternion::from_scaled_axis(Vector3::z() * forward.y.atan2(forward.x))
    };
    let pairs = [
        (of(Segment::T8), Segment::Head),
        (of(Segment::T8), Segment::LeftUpperArm),
        (of(Segment::T8), Segment::RightUpperArm),
        (of(Segment::Pelvis), Segment::T8),
        (upright(Segment::Pelvis), Segment::Pelvis),
        (upright(Segment::T8), Segment::T8),
    ];
    pairs.map(|(reference, segment)| {
        let mut relative = [UnitQuaternion::identity(); SEGMENTS];
        // The axes of a joint angle are those of its child; the neck's have no side and no knee.
        relative[Segment::Neck.index()] = reference.inverse() * of(segment);
        joint_angles_deg(&relative)[Segment::Neck.index() - 1]
    })
}

/// Twenty segments a hand, left first: the carpus, three of the thumb, four of each finger, stretched and apart.
fn fingers((origin_m, rotation): &SegmentPoses, grip_m: &[Vector3<f64>; 2]) -> Vec<([f64; 3], [f64; 4])> {
    let mut segments = Vec::new();
    for (side, grip) in [Side::Left, Side::Right].into_iter().zip(grip_m) {
        let hand = if side == Side::Left { Segment::LeftHand } else { Segment::RightHand }.index();
        let mut put = |from_wrist: Vector3<f64>| {
            let place = (origin_m[hand] + rotation[hand] * from_wrist).coords.into();
            segments.push((place, wxyz(rotation[hand])));
        };
        put(Vector3::zeros());
        for finger in 0..5 {
            let across = Vector3::x() * (0.02 * (2.0 - f64::from(finger)));
            let count = if finger == 0 { 3 } else { 4 };
            for along in &PHALANGES[..count] {
                put(grip * *along + across);
            }
        }
    }
    segments
}
