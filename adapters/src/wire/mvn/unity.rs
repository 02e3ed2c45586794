//! Type 05: segment poses for Unity3D (MVN protocol, "Segment position and orientation, Unity3D").
//!
//! Items as in type 02, but in Unity's world (**left-handed**, X right, Y up, Z forward; m) and in a different order;
//! only the pelvis is expressed in the world, every other segment in its parent's frame.
//!
//! Not verified with a real datagram. The specification defines handedness, up axis, order and reference frames; that X
//! points to the right and that ids are redundant to the order are assumptions.

use super::Malformed;
use super::SegmentPose;
use super::header::{DatagramType, Header, Oversized, frame};
use super::items::Item;
use crate::wire::reader::Reader;
use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// The segments in the order of transmission (MVN protocol, table 3), as indices of MVN's own order.
const ORDER: [usize; SEGMENTS] =
    [0, 15, 16, 17, 18, 19, 20, 21, 22, 1, 2, 3, 4, 11, 12, 13, 14, 7, 8, 9, 10, 5, 6];

/// One body of 23 segments. Decoded on demand, as each segment requires the whole chain.
#[derive(Debug, Clone, Copy)]
pub struct UnityBody<'a> {
    reader: Reader<'a>,
}

impl<'a> UnityBody<'a> {
    pub(super) fn parse(header: &Header, payload: &'a [u8]) -> Result<Self, Malformed> {
        let items = usize::from(header.items);
        // Props may follow the body; they are expressed in the world and skipped.
        if items < SEGMENTS || payload.len() != items * SegmentPose::SIZE {
            return Err(Malformed::Items {
                datagram_type: header.datagram_type,
                items: header.items,
                payload: payload.len(),
            });
        }
        Ok(UnityBody { reader: Reader::new(payload) })
    }

    /// The items as transmitted: left-handed, Y up, all except the pelvis relative to their parents.
    pub fn items(&self) -> impl Iterator<Item = SegmentPose> + use<'a> {
        let mut reader = self.reader;
        core::iter::from_fn(move || SegmentPose::read(&mut reader))
    }

    /// Converts the body to the frame and order of type 02: Z up, right-handed, every segment in the world.
    ///
    /// Numbers that are not finite stay so; quaternions without unit norm also distort other segments.
    pub fn to_z_up(&self) -> [SegmentPose; SEGMENTS] {
        let mut body =
            [SegmentPose { segment_id: 0, position_m: [0.0; 3], orientation_wxyz: [0.0; 4] }; SEGMENTS];
        for (place, item) in ORDER.into_iter().zip(self.items()) {
            body[place] = right_handed(&item, place);
        }
        // Parents precede their children in MVN's order.
        for segment in &Segment::ALL[1..] {
            if let Some(parent) = segment.parent() {
                let child = body[segment.index()];
                let placed = isometry(&body[parent.index()]) * isometry(&child);
                body[segment.index()] = pose(child.segment_id, &placed);
            }
        }
        body
    }
}

/// Unity's axes are right, up and forward; MVN's forward, left and up. Vectors are permuted; rotations also change
/// sign, as the two worlds are mirror images.
fn right_handed(item: &SegmentPose, place: usize) -> SegmentPose {
    let [right, up, forward] = item.position_m;
    let [w, x, y, z] = item.orientation_wxyz;
    SegmentPose {
        segment_id: place as u32 + 1,
        position_m: [forward, -right, up],
        orientation_wxyz: [w, -z, x, -y],
    }
}

fn left_handed(pose: &SegmentPose) -> SegmentPose {
    let [forward, left, up] = pose.position_m;
    let [w, x, y, z] = pose.orientation_wxyz;
    SegmentPose { position_m: [-left, up, forward], orientation_wxyz: [w, y, -z, -x], ..*pose }
}

fn isometry(pose: &SegmentPose) -> Isometry3<f32> {
    let [w, x, y, z] = pose.orientation_wxyz;
    let turn = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Translation3::from(pose.position_m), turn)
}

fn pose(segment_id: u32, isometry: &Isometry3<f32>) -> SegmentPose {
    let turn = isometry.rotation;
    SegmentPose {
        segment_id,
        position_m: isometry.translation.vector.into(),
        orientation_wxyz: [turn.w, turn.i, turn.j, turn.k],
    }
}

/// Replaces the contents of `out` with one datagram of type 05; `body` as in type 02, in MVN's order.
///
/// # Errors
/// Never; the signature is that of the other types.
pub fn encode(header: &Header, body: &[SegmentPose; SEGMENTS], out: &mut Vec<u8>) -> Result<(), Oversized> {
    frame(header, DatagramType::UNITY, SEGMENTS, out, |out| {
        for (index, place) in ORDER.into_iter().enumerate() {
            let world_from_segment = isometry(&body[place]);
            let local = match Segment::ALL[place].parent() {
                Some(parent) => isometry(&body[parent.index()]).inv_mul(&world_from_segment),
                None => world_from_segment,
            };
            left_handed(&pose(index as u32 + 1, &local)).write(out);
        }
    })
}

// bytes    object (each of 23 items, in ORDER)
// 0–3      segment_id u32, the item's number from 1
// 4–15     position_m 3 × f32: right, up, forward
// 16–31    orientation_wxyz 4 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    fn body(seeds: &[[f32; 7]]) -> [SegmentPose; SEGMENTS] {
        core::array::from_fn(|place| {
            let [x, y, z, a, b, c, d] = seeds[place];
            let norm = (a * a + b * b + c * c + d * d).sqrt();
            SegmentPose {
                segment_id: place as u32 + 1,
                position_m: [x, y, z],
                orientation_wxyz: [a, b, c, d].map(|part| part / norm),
            }
        })
    }

    fn read(bytes: &[u8]) -> UnityBody<'_> {
        match Datagram::parse(bytes) {
            Ok(Datagram::Unity(_, body)) => body,
            other => panic!("{other:?}"),
        }
    }

    proptest! {
        #[test]
        fn a_body_comes_back_to_its_place_in_the_world(
            seeds in proptest::collection::vec(proptest::array::uniform7(-2f32..2.0), SEGMENTS..=SEGMENTS)
        ) {
            prop_assume!(seeds.iter().all(|seed| seed[3..].iter().map(|part| part * part).sum::<f32>() > 0.1));
            let written = body(&seeds);
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 32 * SEGMENTS);
            for (read, written) in read(&bytes).to_z_up().iter().zip(&written) {
                prop_assert_eq!(read.segment_id, written.segment_id);
                for axis in 0..3 {
                    prop_assert!((read.position_m[axis] - written.position_m[axis]).abs() < 1e-4);
                }
                let dot: f32 = read.orientation_wxyz.iter().zip(written.orientation_wxyz).map(|(a, b)| a * b).sum();
                prop_assert!(dot.abs() > 1.0 - 1e-4);
            }
        }
    }

    #[test]
    fn the_wire_is_left_handed_and_has_an_order_of_its_own() {
        let mut standing = body(&[[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]; SEGMENTS]);
        // The pelvis is rotated by 90° to the left; the left thigh begins 0.1 m to its left, therefore behind it.
        let half = core::f32::consts::FRAC_1_SQRT_2;
        standing[0].orientation_wxyz = [half, 0.0, 0.0, half];
        standing[19].position_m = [-0.1, 0.0, 1.0];
        let mut bytes = Vec::new();
        encode(&Header::new(1, 4, 0), &standing, &mut bytes).unwrap();
        let items: Vec<SegmentPose> = read(&bytes).items().collect();
        let near = |got: &[f32], want: &[f32]| got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near(&items[0].position_m, &[0.0, 1.0, 0.0]), "up is Y: {:?}", items[0]);
        // Seen from above, a left-handed rotation about Y has the opposite direction.
        assert!(near(&items[0].orientation_wxyz, &[half, 0.0, -half, 0.0]), "{:?}", items[0]);
        // The left thigh is the sixth item, and its own left is Unity's −X.
        assert!(near(&items[5].position_m, &[-0.1, 0.0, 0.0]), "{:?}", items[5]);
        let ids: Vec<u32> = items.iter().map(|item| item.segment_id).collect();
        assert_eq!(ids, (1..=23).collect::<Vec<u32>>());
    }

    #[test]
    fn the_order_names_every_segment_once_and_parents_come_first() {
        let mut sorted = ORDER;
        sorted.sort_unstable();
        assert_eq!(sorted, core::array::from_fn(|place| place));
        let names = ORDER.map(|place| Segment::ALL[place].name());
        assert_eq!(
            (names[1], names[8], names[9], names[13]),
            ("RightUpperLeg", "LeftToe", "L5", "LeftShoulder")
        );
        assert_eq!((names[17], names[21], names[22]), ("RightShoulder", "Neck", "Head"));
        for segment in &Segment::ALL[1..] {
            assert!(segment.parent().is_some_and(|parent| parent.index() < segment.index()), "{segment:?}");
        }
    }

    #[test]
    fn less_than_a_body_is_refused() {
        let mut bytes = Vec::new();
        encode(&Header::new(1, 4, 0), &body(&[[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]; SEGMENTS]), &mut bytes)
            .unwrap();
        bytes[11] = 22;
        bytes.truncate(24 + 22 * 32);
        bytes[22..24].copy_from_slice(&(22u16 * 32).to_be_bytes());
        assert!(matches!(Datagram::parse(&bytes), Err(Malformed::Items { items: 22, .. })));
    }
}
