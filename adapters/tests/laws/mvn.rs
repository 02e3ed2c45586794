//! MVN datagrams: parsed datagrams can be written back.

use equipoise_adapters::wire::mvn::{
    Datagram, HEADER_SIZE, Header, angular_kinematics, centre_of_mass, joint_angles, linear_kinematics, meta,
    pose_euler, pose_quaternion, scale,
};

/// A parsed datagram is written with the same payload, and parses to the same value again.
///
/// Texts (type 12) may contain lines without content; these are not written back.
pub(crate) fn datagram(bytes: &[u8]) {
    let Ok(read) = Datagram::parse(bytes) else { return };
    let header = read.header().copied();
    let Some(written) = encode(&read) else { return };
    let again = Datagram::parse(&written).unwrap();
    if !matches!(read, Datagram::Meta(..)) {
        assert_eq!(written[HEADER_SIZE..], bytes[HEADER_SIZE..], "{read:?}");
    }
    assert_eq!(encode(&again).as_ref(), Some(&written), "{read:?}");
    let (Some(before), Some(after)) = (header, again.header()) else { panic!("no header") };
    let alike = Header { items: after.items, payload_size: after.payload_size, ..before };
    assert_eq!(*after, alike);
}

/// Encodes the datagram; `None` for types without an encoder.
fn encode(datagram: &Datagram<'_>) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    match *datagram {
        Datagram::PoseEuler(header, items) => {
            pose_euler::encode(&header, &items.collect::<Vec<_>>(), &mut out)
        }
        Datagram::PoseQuaternion(header, items) => {
            pose_quaternion::encode(&header, &items.collect::<Vec<_>>(), &mut out)
        }
        Datagram::Meta(header, text) => meta::encode(&header, &text.tags().collect::<Vec<_>>(), &mut out),
        Datagram::Scale(header, body) => {
            let (segments, points) = (body.segments().collect::<Vec<_>>(), body.points().collect::<Vec<_>>());
            scale::encode(&header, &segments, &points, &mut out)
        }
        Datagram::JointAngles(header, items) => {
            joint_angles::encode(&header, &items.collect::<Vec<_>>(), &mut out)
        }
        Datagram::LinearKinematics(header, items) => {
            linear_kinematics::encode(&header, &items.collect::<Vec<_>>(), &mut out)
        }
        Datagram::AngularKinematics(header, items) => {
            angular_kinematics::encode(&header, &items.collect::<Vec<_>>(), &mut out)
        }
        Datagram::CentreOfMass(header, com) => centre_of_mass::encode(&header, &com, &mut out),
        _ => return None,
    }
    .unwrap();
    Some(out)
}
