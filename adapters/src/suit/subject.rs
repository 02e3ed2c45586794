//! What the suit says about its wearer now and then: a name, the clock's offset, the null pose.

use crate::wire::mvn::{Meta, Scale};
use equipoise_core::body::SEGMENTS;
use std::collections::BTreeMap;

/// More points than any body has (about 123): the rest is not kept.
const MAX_POINTS: usize = 512;

/// The last that was said, merged over datagrams.
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
}

impl SuitSubject {
    pub(super) fn take_meta(&mut self, meta: Meta<'_>) {
        if let Some(name) = meta.name() {
            self.name = Some(name.to_owned());
        }
        self.time_offset_ms = meta.time_offset_ms().or(self.time_offset_ms);
    }

    /// `false`, and nothing is changed, if a number is not finite.
    pub(super) fn take_scale(&mut self, scale: &Scale<'_>) -> bool {
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
        if count == SEGMENTS {
            self.null_pose.origins_m = Some(origins_m);
        }
        let points = &mut self.null_pose.points;
        for point in scale.points() {
            let key = (point.segment_id, point.point_id);
            if points.len() < MAX_POINTS || points.contains_key(&key) {
                points.insert(key, (point.name.to_owned(), point.offset_m.map(f64::from)));
            }
        }
        true
    }
}
