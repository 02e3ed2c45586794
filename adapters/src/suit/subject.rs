//! Properties of the wearer that the suit reports occasionally: name, clock offset, null pose.

use crate::wire::mvn::{Meta, Scale};
use bytemuck::Zeroable;
use equipoise_core::body::{SEGMENTS, Side};
use equipoise_core::message::SuitBody;
use equipoise_core::message::suit_body::FOOT_POINTS;
use std::collections::BTreeMap;

/// Limit of stored points; a body has about 123.
const MAX_POINTS: usize = 512;

/// MVN's names of the points of the left and the right foot, in the order of `SuitBody::foot_point_m`.
const FOOT_POINT_NAMES: [[&str; FOOT_POINTS]; 2] = [
    ["pLeftHeelFoot", "pLeftFirstMetatarsal", "pLeftFifthMetatarsal", "pLeftToe"],
    ["pRightHeelFoot", "pRightFirstMetatarsal", "pRightFifthMetatarsal", "pRightToe"],
];

/// The latest values, merged over datagrams.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SuitSubject {
    /// The character's name in MVN.
    pub name: Option<String>,
    /// UTC minus the sender's local time, ms.
    pub time_offset_ms: Option<i64>,
    /// The body's dimensions.
    pub null_pose: NullPose,
}

/// Origins of the segments in the T pose, and points on them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NullPose {
    /// Segment origins in MVN order; X forward, Y left, Z up; m. `None` until they were sent.
    pub origins_m: Option<[[f64; 3]; SEGMENTS]>,
    /// Points by (MVN segment id, point id): name and offset from the segment's origin, m.
    pub points: BTreeMap<(u16, u16), (String, [f64; 3])>,
    /// The suit's session of the report.
    session: u32,
    /// Kernel receive stamp of the datagram that last changed it, CLOCK_MONOTONIC ns.
    changed_ns: u64,
    /// The same of the last report, whether or not it changed anything.
    said_ns: u64,
}

impl NullPose {
    /// As a message of a character; `None` until the segments were received. The publisher sets `published_ns`.
    pub(crate) fn to_body(&self, avatar: u8) -> Option<SuitBody> {
        let origin_m = self.origins_m?;
        let mut body = SuitBody {
            arrival_ns: self.changed_ns,
            avatar: u32::from(avatar),
            session: self.session,
            origin_m,
            ..SuitBody::zeroed()
        };
        for ((segment_id, _), (name, offset_m)) in &self.points {
            let Some(from_m) = origin_m.get(usize::from(*segment_id).wrapping_sub(1)) else { continue };
            for (side, names) in Side::BOTH.into_iter().zip(FOOT_POINT_NAMES) {
                if let Some(place) = names.iter().position(|known| known == name) {
                    // The toe's tip is given relative to the toes' origin. In the null pose all axes are parallel to
                    // the world's.
                    let (foot, ankle_m) = (side as usize, origin_m[side.foot().index()]);
                    body.foot_points[foot] |= 1 << place;
                    body.foot_point_m[foot][place] =
                        std::array::from_fn(|axis| from_m[axis] + offset_m[axis] - ankle_m[axis]);
                }
            }
        }
        Some(body)
    }

    /// The suit was restarted after `ended_ns`, the arrival of its last sample: later reports belong to the new
    /// session, as the software may send the body before its first sample.
    pub(super) fn begin_session(&mut self, session: u32, ended_ns: u64) {
        if self.said_ns > ended_ns {
            self.session = session;
        }
    }
}

impl SuitSubject {
    pub(super) fn take_meta(&mut self, meta: Meta<'_>) {
        if let Some(name) = meta.name() {
            self.name = Some(name.to_owned());
        }
        self.time_offset_ms = meta.time_offset_ms().or(self.time_offset_ms);
    }

    /// Returns `false`, without any change, if a number is not finite.
    pub(super) fn take_scale(&mut self, scale: &Scale<'_>, session: u32, arrival_ns: u64) -> bool {
        let numbers = scale.segments().map(|segment| segment.origin_m);
        if numbers
            .chain(scale.points().map(|point| point.offset_m))
            .flatten()
            .any(|number| !number.is_finite())
        {
            return false;
        }
        let mut origins_m = [[0.0; 3]; SEGMENTS];
        let mut count = 0;
        for (origin, segment) in origins_m.iter_mut().zip(scale.segments()) {
            *origin = segment.origin_m.map(f64::from);
            count += 1;
        }
        let null_pose = &mut self.null_pose;
        let mut changed = null_pose.session != session;
        if count == SEGMENTS && null_pose.origins_m != Some(origins_m) {
            if null_pose.origins_m.is_some() {
                // Another body: its points will follow.
                null_pose.points.clear();
            }
            null_pose.origins_m = Some(origins_m);
            changed = true;
        }
        let points = &mut null_pose.points;
        for point in scale.points() {
            let key = (point.segment_id, point.point_id);
            let offset_m = point.offset_m.map(f64::from);
            let has_room = points.len() < MAX_POINTS;
            match points.get_mut(&key) {
                Some((name, known_m)) => {
                    changed |= name != point.name || *known_m != offset_m;
                    (*name, *known_m) = (point.name.to_owned(), offset_m);
                }
                None if has_room => {
                    points.insert(key, (point.name.to_owned(), offset_m));
                    changed = true;
                }
                None => {}
            }
        }
        (null_pose.session, null_pose.said_ns) = (session, arrival_ns);
        if changed {
            null_pose.changed_ns = arrival_ns;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::scale::{self, NullPoseSegment, SegmentPoint};
    use crate::wire::mvn::{Datagram, Header};
    use equipoise_core::body::{Segment, Skeleton};
    use equipoise_core::message::suit_body::FootPoint;

    fn hear(subject: &mut SuitSubject, bytes: &[u8], session: u32, arrival_ns: u64) {
        let Ok(Datagram::Scale(_, scale)) = Datagram::parse(bytes) else { panic!("not a scale") };
        assert!(subject.take_scale(&scale, session, arrival_ns));
    }

    fn segments(height_m: f64) -> Vec<u8> {
        let origin_m = Skeleton::nominal(height_m).t_pose_m();
        let segments: Vec<_> = Segment::ALL
            .iter()
            .zip(origin_m)
            .map(|(segment, [x, y, z])| NullPoseSegment {
                name: segment.name(),
                origin_m: [x as f32, y as f32, (z + 0.95) as f32],
            })
            .collect();
        let mut bytes = Vec::new();
        scale::encode(&Header::new(0, 0, 0), &segments, &[], &mut bytes).unwrap();
        bytes
    }

    fn points() -> Vec<u8> {
        let point = |segment_id, point_id, name, offset_m| SegmentPoint {
            segment_id,
            point_id,
            name,
            flags: 0,
            offset_m,
        };
        let points = [
            point(22, 4, "pLeftHeelFoot", [-0.06, 0.0, -0.09]),
            point(23, 2, "pLeftToe", [0.06, 0.0, -0.01]),
            point(18, 5, "pRightFifthMetatarsal", [0.13, -0.05, -0.09]),
            point(1, 1, "jL5S1", [0.0, 0.0, 0.1]),
        ];
        let mut bytes = Vec::new();
        scale::encode(&Header::new(0, 0, 0), &[], &points, &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn the_null_pose_becomes_a_body_with_the_points_of_the_feet_as_they_were_sent() {
        let mut subject = SuitSubject::default();
        hear(&mut subject, &points(), 0, 10);
        assert_eq!(subject.null_pose.to_body(0), None, "points alone are no body");
        hear(&mut subject, &segments(1.77), 0, 20);
        hear(&mut subject, &points(), 0, 30);
        let body = subject.null_pose.to_body(3).unwrap();
        assert!(body.is_plausible());
        assert_eq!((body.avatar, body.session, body.arrival_ns), (3, 0, 20), "whole with its segments");
        assert_eq!(body.foot_points, [0b1001, 0b0100]);
        // The tip is received relative to the toes' origin, and stored relative to the foot's.
        let ball = body.skeleton().offset_m[Segment::LeftToe.index()];
        let tip = body.foot_point_m(Side::Left, FootPoint::ToeTip).unwrap();
        assert!((tip.x - ball[0] - 0.06).abs() < 1e-6 && (tip.z - ball[2] + 0.01).abs() < 1e-6, "{tip}");
        hear(&mut subject, &segments(1.77), 0, 40);
        assert_eq!(subject.null_pose.to_body(3), Some(body), "said again, nothing is new");
        hear(&mut subject, &segments(1.60), 0, 50);
        let other = subject.null_pose.to_body(3).unwrap();
        assert_eq!(
            (other.foot_points, other.arrival_ns),
            ([0, 0], 50),
            "another body's points are not known yet"
        );
    }

    #[test]
    fn what_was_said_after_the_last_sample_belongs_to_the_session_that_follows() {
        let mut subject = SuitSubject::default();
        hear(&mut subject, &segments(1.77), 0, 1_000);
        subject.null_pose.begin_session(1, 2_000);
        assert_eq!(subject.null_pose.to_body(0).unwrap().session, 0, "it is of the session that has ended");
        hear(&mut subject, &segments(1.77), 1, 3_000);
        subject.null_pose.begin_session(2, 2_500);
        assert_eq!(subject.null_pose.to_body(0).unwrap().session, 2, "said just before the first sample");
    }
}
