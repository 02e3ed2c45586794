//! Identity and calibration of the suit, as MVN sends them once a second: types 12 and 13.

use equipoise_core::body::{Joint, SEGMENTS, Segment};
use nalgebra::{UnitQuaternion, Vector3};

use super::single;
use crate::kinematics::origins_m;
use crate::person::Person;
use crate::wires::mvn::describe::{Point, meta, null_pose};
use crate::wires::mvn::items::JOINT_POINTS;
use crate::wires::mvn::{Stamp, TooLong};

/// Name and null pose of a person; the null pose's points in separate datagrams.
///
/// # Errors
/// Never for 23 segments; the encoders' own.
pub fn introduction(person: &Person, avatar: u8) -> Result<Vec<Vec<u8>>, TooLong> {
    let stamp = Stamp::of_a_body(0, 0, avatar);
    let tags = [("color", "e96417"), ("name", "Simulated"), ("timeOffset", "0")];
    let mut datagrams = vec![meta(&stamp, &tags)?];
    let height = crate::pose::straight_height_m(person);
    let origin = origins_m(person, Vector3::z() * height, &[UnitQuaternion::identity(); SEGMENTS]);
    let segments: [(&str, [f32; 3]); SEGMENTS] = core::array::from_fn(|i| {
        // MVN writes these two with an inner capital.
        let name = match Segment::ALL[i] {
            Segment::RightForearm => "RightForeArm",
            Segment::LeftForearm => "LeftForeArm",
            segment => segment.name(),
        };
        (name, single(origin[i].into()))
    });
    datagrams.extend(null_pose(&stamp, &segments, &points(person))?);
    Ok(datagrams)
}

/// The points that the joints connect, and those of the soles. MVN sends some 60 more, on skin and bones.
fn points(person: &Person) -> Vec<Point> {
    let mut points = Vec::new();
    for (joint, [at_parent, at_child]) in Joint::ALL.into_iter().zip(JOINT_POINTS) {
        let offset = person.offset_m[joint.segment().index()];
        let name = format!("j{}", joint.name());
        let mut point = |wire: u32, offset_m: Vector3<f64>| {
            points.push(Point {
                segment_id: (wire >> 8) as u16,
                point_id: wire as u16 & 0xff,
                name: name.clone(),
                flags: 0,
                offset_m: single(offset_m.into()),
            });
        };
        point(at_parent, offset);
        point(at_child, Vector3::zeros());
    }
    for (side, foot, toe) in
        [("Right", Segment::RightFoot, Segment::RightToe), ("Left", Segment::LeftFoot, Segment::LeftToe)]
    {
        let (outline, down) = (person.foot_outline_m, -person.ankle_height_m);
        let outward = if side == "Left" { 1.0 } else { -1.0 };
        let ball = person.offset_m[toe.index()];
        let of_foot = [
            ("HeelFoot", [-outline.back, 0.0, down]),
            ("FirstMetatarsal", [ball.x, -outward * outline.half_width, down]),
            ("FifthMetatarsal", [ball.x - 0.02, outward * outline.half_width, down]),
            ("PivotFoot", [ball.x, 0.0, down]),
            ("HeelCenter", [-outline.back, 0.0, 0.5 * down]),
            ("TopOfFoot", [0.5 * ball.x, 0.0, 0.5 * down]),
        ];
        let of_toe = [("Toe", [outline.forward - ball.x, 0.0, down - ball.z])];
        let mut listed = |segment: Segment, first: u16, places: &[(&str, [f64; 3])]| {
            for (number, (name, offset_m)) in (first..).zip(places) {
                points.push(Point {
                    segment_id: segment.index() as u16 + 1,
                    point_id: number,
                    name: format!("p{side}{name}"),
                    flags: 0,
                    offset_m: single(*offset_m),
                });
            }
        };
        listed(foot, 3, &of_foot);
        listed(toe, 2, &of_toe);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_adapters::wire::mvn::Datagram;

    #[test]
    fn the_introduction_names_every_segment_in_the_null_pose() {
        let datagrams = introduction(&Person::nominal(1.77, 72.0), 0).unwrap();
        assert!(matches!(Datagram::parse(&datagrams[0]), Ok(Datagram::Meta(..))));
        let Ok(Datagram::Scale(_, scale)) = Datagram::parse(&datagrams[1]) else { panic!("not a scale") };
        let segments: Vec<_> = scale.segments().collect();
        assert_eq!(segments.len(), SEGMENTS);
        assert!((0.9..1.0).contains(&segments[0].origin_m[2]));
    }

    #[test]
    fn soles_lie_on_the_floor_and_every_point_has_a_number_of_its_own() {
        let person = Person::nominal(1.77, 72.0);
        let points = points(&person);
        let mut numbers: Vec<_> = points.iter().map(|point| (point.segment_id, point.point_id)).collect();
        numbers.sort_unstable();
        assert!(numbers.windows(2).all(|pair| pair[0] != pair[1]), "{numbers:?}");
        let named = |name: &str| points.iter().find(|point| point.name == name).unwrap().offset_m;
        assert_eq!(named("pLeftHeelFoot")[2], -(person.ankle_height_m as f32));
        let toe = person.offset_m[Segment::LeftToe.index()].z as f32 + named("pLeftToe")[2];
        assert!((toe + person.ankle_height_m as f32).abs() < 1e-6);
        assert_eq!(points.len(), 2 * 22 + 2 * 7);
    }
}
