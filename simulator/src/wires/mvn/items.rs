//! Types with one item per segment or joint: 01, 02, 03, 05, 20, 21, 22, 23; and 24, which is one item.

use super::{ONLY_DATAGRAM, Stamp, TooLong, floats};

/// The 22 joints of type 20, in order: points of parent and child, `256 * segment + place in the segment's list`.
pub const JOINT_POINTS: [[u32; 2]; 22] = [
    [0x0102, 0x0201],
    [0x0202, 0x0301],
    [0x0302, 0x0401],
    [0x0402, 0x0501],
    [0x0502, 0x0601],
    [0x0602, 0x0701],
    [0x0503, 0x0801],
    [0x0802, 0x0901],
    [0x0902, 0x0A01],
    [0x0A02, 0x0B01],
    [0x0504, 0x0C01],
    [0x0C02, 0x0D01],
    [0x0D02, 0x0E01],
    [0x0E02, 0x0F01],
    [0x0103, 0x1001],
    [0x1002, 0x1101],
    [0x1102, 0x1201],
    [0x1202, 0x1301],
    [0x0104, 0x1401],
    [0x1402, 0x1501],
    [0x1502, 0x1601],
    [0x1602, 0x1701],
];

/// The six ergonomic angles that may follow: head, left and right upper arm to T8, pelvis to T8, the vertical to pelvis
/// and to T8. The fourth and the last have the same points.
pub const ERGONOMIC_POINTS: [[u32; 2]; 6] = [
    [0x0500, 0x0700],
    [0x0500, 0x0D00],
    [0x0500, 0x0900],
    [0x0100, 0x0500],
    [0x0100, 0x0100],
    [0x0100, 0x0500],
];

/// Segments with a tracker in a full suit: shoulder blades and toes have none of their own but for the shoulders.
pub const TRACKED_SEGMENTS: [u32; 17] = [1, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 20, 21, 22];

/// Segment ids in the order of type 05.
pub const UNITY_ORDER: [usize; 23] =
    [1, 16, 17, 18, 19, 20, 21, 22, 23, 2, 3, 4, 5, 12, 13, 14, 15, 8, 9, 10, 11, 6, 7];

/// A segment's pose: id, place, and three angles or a quaternion (scalar first).
pub type Pose<const N: usize> = (u32, [f32; 3], [f32; N]);

fn listed<Item>(
    stamp: &Stamp,
    kind: &[u8; 2],
    items: &[Item],
    put: impl Fn(&mut Vec<u8>, &Item),
) -> Result<Vec<u8>, TooLong> {
    let mut payload = Vec::new();
    for item in items {
        put(&mut payload, item);
    }
    stamp.datagram(kind, ONLY_DATAGRAM, items.len(), &payload)
}

fn posed<const N: usize>(stamp: &Stamp, kind: &[u8; 2], poses: &[Pose<N>]) -> Result<Vec<u8>, TooLong> {
    listed(stamp, kind, poses, |out, (id, place, turn)| {
        out.extend_from_slice(&id.to_be_bytes());
        floats(out, place);
        floats(out, turn);
    })
}

/// Type 01: centimetres and degrees (`R = Rz Ry Rx`), Y up.
///
/// # Errors
/// [`TooLong`].
pub fn pose_euler(stamp: &Stamp, poses: &[Pose<3>]) -> Result<Vec<u8>, TooLong> {
    posed(stamp, b"01", poses)
}

/// Type 02: metres and a quaternion, Z up.
///
/// # Errors
/// [`TooLong`].
pub fn pose_quaternion(stamp: &Stamp, poses: &[Pose<4>]) -> Result<Vec<u8>, TooLong> {
    posed(stamp, b"02", poses)
}

/// Type 05, for Unity: as 02, but Y up and left-handed; the pelvis in the world, all others from their parents.
///
/// # Errors
/// [`TooLong`].
pub fn pose_unity(stamp: &Stamp, poses: &[Pose<4>]) -> Result<Vec<u8>, TooLong> {
    posed(stamp, b"05", poses)
}

/// Type 03, the virtual markers: point and its place in centimetres, Y up.
///
/// # Errors
/// [`TooLong`].
pub fn markers(stamp: &Stamp, points: &[(u32, [f32; 3])]) -> Result<Vec<u8>, TooLong> {
    listed(stamp, b"03", points, |out, (point, place_cm)| {
        out.extend_from_slice(&point.to_be_bytes());
        floats(out, place_cm);
    })
}

/// Type 20: points of parent and child, abduction, axial rotation and flexion in degrees.
///
/// # Errors
/// [`TooLong`].
pub fn joint_angles(stamp: &Stamp, joints: &[([u32; 2], [f32; 3])]) -> Result<Vec<u8>, TooLong> {
    listed(stamp, b"20", joints, |out, ([parent, child], angle_deg)| {
        out.extend_from_slice(&parent.to_be_bytes());
        out.extend_from_slice(&child.to_be_bytes());
        floats(out, angle_deg);
    })
}

/// Type 21: place (m), velocity (m/s) and acceleration (m/s²) of the origins.
///
/// # Errors
/// [`TooLong`].
pub fn linear_kinematics(stamp: &Stamp, segments: &[(u32, [[f32; 3]; 3])]) -> Result<Vec<u8>, TooLong> {
    listed(stamp, b"21", segments, |out, (id, motion)| {
        out.extend_from_slice(&id.to_be_bytes());
        floats(out, motion.as_flattened());
    })
}

/// A segment's rotation: id, orientation, and angular velocity (rad/s) and acceleration (rad/s²).
pub type SegmentRotation = (u32, [f32; 4], [[f32; 3]; 2]);

/// Type 22: orientation, angular velocity (rad/s) and acceleration (rad/s²), in the world.
///
/// # Errors
/// [`TooLong`].
pub fn angular_kinematics(stamp: &Stamp, segments: &[SegmentRotation]) -> Result<Vec<u8>, TooLong> {
    listed(stamp, b"22", segments, |out, (id, orientation, motion)| {
        out.extend_from_slice(&id.to_be_bytes());
        floats(out, orientation);
        floats(out, motion.as_flattened());
    })
}

/// Data of a tracker.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracker {
    /// Its segment.
    pub segment_id: u32,
    /// Its orientation in the world, scalar first.
    pub orientation_wxyz: [f32; 4],
    /// Acceleration without gravity, world, m/s².
    pub free_acceleration: [f32; 3],
    /// Measured acceleration (m/s²) and angular velocity (rad/s), sensor's axes; older versions do not send them.
    pub measured: Option<[[f32; 3]; 2]>,
    /// Magnetic field, arbitrary units, sensor's axes.
    pub magnetic: [f32; 3],
}

/// Type 23: 68 bytes a tracker, or 44 from older versions.
///
/// # Errors
/// [`TooLong`].
pub fn trackers(stamp: &Stamp, trackers: &[Tracker]) -> Result<Vec<u8>, TooLong> {
    listed(stamp, b"23", trackers, |out, tracker| {
        out.extend_from_slice(&tracker.segment_id.to_be_bytes());
        floats(out, &tracker.orientation_wxyz);
        floats(out, &tracker.free_acceleration);
        floats(out, tracker.measured.as_ref().map_or(&[], |measured| measured.as_flattened()));
        floats(out, &tracker.magnetic);
    })
}

/// Type 24: the centre of mass by MVN's model, m; with its velocity and acceleration from newer versions.
///
/// # Errors
/// [`TooLong`].
pub fn centre_of_mass(
    stamp: &Stamp,
    position_m: [f32; 3],
    motion: Option<[[f32; 3]; 2]>,
) -> Result<Vec<u8>, TooLong> {
    listed(stamp, b"24", &[(position_m, motion)], |out, (position_m, motion)| {
        floats(out, position_m);
        floats(out, motion.as_ref().map_or(&[], |motion| motion.as_flattened()));
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_have_the_sizes_of_the_specification() {
        let stamp = Stamp::of_a_body(1, 16, 0);
        let lengths = [
            pose_euler(&stamp, &[(1, [0.0; 3], [0.0; 3]); 23]),
            pose_quaternion(&stamp, &[(1, [0.0; 3], [0.0; 4]); 63]),
            pose_unity(&stamp, &[(1, [0.0; 3], [0.0; 4]); 23]),
            markers(&stamp, &[(1, [0.0; 3]); 10]),
            joint_angles(&stamp, &[([1; 2], [0.0; 3]); 28]),
            linear_kinematics(&stamp, &[(1, [[0.0; 3]; 3]); 63]),
            angular_kinematics(&stamp, &[(1, [0.0; 4], [[0.0; 3]; 2]); 63]),
            trackers(&stamp, &[Tracker::default(); 17]),
            trackers(&stamp, &[Tracker { measured: Some([[0.0; 3]; 2]), ..Tracker::default() }; 17]),
            centre_of_mass(&stamp, [0.0; 3], None),
            centre_of_mass(&stamp, [0.0; 3], Some([[0.0; 3]; 2])),
        ]
        .map(|datagram| datagram.unwrap().len());
        assert_eq!(lengths, [668, 2040, 760, 184, 584, 2544, 2796, 772, 1180, 36, 60]);
    }

    #[test]
    fn every_segment_has_its_place_in_unitys_order() {
        let mut order = UNITY_ORDER;
        order.sort_unstable();
        assert!(order.iter().zip(1..).all(|(is, id)| *is == id));
    }
}
