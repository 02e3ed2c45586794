//! Type 01: segment poses as Euler angles (MVN protocol, "Segment position and orientation, Euler").
//!
//! Centimetres, degrees and **Y up**: X left, Y up, Z forward. Rotations are about the fixed axes X, then Y, then Z.

use super::SegmentPose;
use super::header::{DatagramType, Header, Oversized};
use super::items::{self, Item};
use crate::wire::reader::{Reader, write_f32s};
use equipoise_core::frame::wxyz;
use nalgebra::{Quaternion, UnitQuaternion};

/// One segment's pose, as transmitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerPose {
    /// MVN segment id, from 1: index plus one for the 23 of the body.
    pub segment_id: u32,
    /// Segment origin: left, up, forward; cm.
    pub position_cm_y_up: [f32; 3],
    /// `R = Rz(rz)·Ry(ry)·Rx(rx)` in the Y-up world; degrees.
    pub rotation_deg_y_up: [f32; 3],
}

impl EulerPose {
    /// Converts the pose to the units and frame of type 02: metres, Z up, quaternion.
    ///
    /// X, Y, Z of the Y-up world are Y, Z, X of the Z-up world. This is a rotation, so vectors and the vector parts of
    /// quaternions are permuted equally.
    pub fn to_z_up(&self) -> SegmentPose {
        let [rx, ry, rz] = self.rotation_deg_y_up.map(|angle| f64::from(angle).to_radians());
        let turn = UnitQuaternion::from_euler_angles(rx, ry, rz);
        let y_up = SegmentPose {
            segment_id: self.segment_id,
            position_m: self.position_cm_y_up.map(|cm| cm / 100.0),
            orientation_wxyz: wxyz(&turn).map(|part| part as f32),
        };
        y_up.y_up_to_z_up()
    }

    /// Converts a pose of type 02 to the units and frame of type 01.
    pub fn from_z_up(pose: &SegmentPose) -> EulerPose {
        let [forward, left, up] = pose.position_m;
        let [w, z, x, y] = pose.orientation_wxyz.map(f64::from);
        let (rx, ry, rz) = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).euler_angles();
        EulerPose {
            segment_id: pose.segment_id,
            position_cm_y_up: [left, up, forward].map(|m| m * 100.0),
            rotation_deg_y_up: [rx, ry, rz].map(|angle| angle.to_degrees() as f32),
        }
    }
}

impl Item for EulerPose {
    const DATAGRAM_TYPE: DatagramType = DatagramType::POSE_EULER;
    const SIZE: usize = 28;

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(EulerPose {
            segment_id: reader.u32()?,
            position_cm_y_up: reader.f32s()?,
            rotation_deg_y_up: reader.f32s()?,
        })
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.segment_id.to_be_bytes());
        write_f32s(&self.position_cm_y_up, out);
        write_f32s(&self.rotation_deg_y_up, out);
    }
}

/// Replaces the contents of `out` with one datagram of type 01; order as in type 02.
///
/// # Errors
/// [`Oversized`] for more than 255 items.
pub fn encode(header: &Header, items: &[EulerPose], out: &mut Vec<u8>) -> Result<(), Oversized> {
    items::encode(header, items, out)
}

// bytes    object (each item)
// 0–3      segment_id u32
// 4–15     position_cm_y_up 3 × f32
// 16–27    rotation_deg_y_up 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec((any::<u32>(), proptest::array::uniform6(-1e3f32..1e3)), 1..64)) {
            let written: Vec<_> = values.into_iter().map(|(id, v)| EulerPose { segment_id: id, position_cm_y_up: [v[0], v[1], v[2]], rotation_deg_y_up: [v[3], v[4], v[5]] }).collect();
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 28 * written.len());
            let Ok(Datagram::PoseEuler(header, items)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!((header.sample_counter, header.avatar, items.len()), (7, 1, written.len()));
            prop_assert_eq!(items.collect::<Vec<_>>(), written);
        }
    }

    #[test]
    fn a_turn_to_the_left_is_about_the_axis_that_points_up() {
        let turned = EulerPose {
            segment_id: 1,
            position_cm_y_up: [10.0, 100.0, 30.0],
            rotation_deg_y_up: [0.0, 90.0, 0.0],
        };
        let pose = turned.to_z_up();
        assert_eq!(pose.position_m, [0.3, 0.1, 1.0]);
        let half = core::f32::consts::FRAC_1_SQRT_2;
        for (got, want) in pose.orientation_wxyz.iter().zip([half, 0.0, 0.0, half]) {
            assert!((got - want).abs() < 1e-6, "{pose:?}");
        }
    }

    proptest! {
        #[test]
        fn to_z_up_undoes_from_z_up(q in proptest::array::uniform4(-1f32..1.0)) {
            let norm = q.iter().map(|part| part * part).sum::<f32>().sqrt();
            prop_assume!(norm > 0.1);
            let pose = SegmentPose { segment_id: 5, position_m: [0.1, -0.2, 1.3], orientation_wxyz: q.map(|part| part / norm) };
            let back = EulerPose::from_z_up(&pose).to_z_up();
            let dot: f32 = pose.orientation_wxyz.iter().zip(back.orientation_wxyz).map(|(a, b)| a * b).sum();
            prop_assert!(dot.abs() > 1.0 - 1e-5, "{pose:?} {back:?}");
        }
    }
}
