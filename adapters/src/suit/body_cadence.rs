//! When the body dimensions of the suit's wearer are published, live and from a capture.

use equipoise_core::message::SuitBody;

/// Interval of repetition, ns.
const INTERVAL_NS: u64 = 1_000_000_000;

/// Schedule of the publication: on change at once, and once a second for late subscribers.
#[derive(Debug, Default)]
pub struct BodyCadence {
    published: Option<SuitBody>,
}

impl BodyCadence {
    /// The body dimensions to publish at `now_ns`, stamped; `None` if they are unchanged and a second has not passed.
    pub fn due(&mut self, body: Option<SuitBody>, now_ns: u64) -> Option<SuitBody> {
        let body = SuitBody { published_ns: now_ns, ..body? };
        let is_recent = self.published.as_ref().is_some_and(|published| {
            published.has_same_dimensions(&body)
                && now_ns.saturating_sub(published.published_ns) < INTERVAL_NS
        });
        if is_recent {
            return None;
        }
        self.published = Some(body);
        self.published
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_build_is_published_at_once_when_it_changes_and_once_a_second() {
        let mut cadence = BodyCadence::default();
        let published = |cadence: &mut BodyCadence, session: u32, now_ns: u64| {
            let body = SuitBody { session, ..SuitBody::zeroed() };
            cadence.due(Some(body), now_ns).map(|body| (body.session, body.published_ns))
        };
        assert_eq!(cadence.due(None, 1), None);
        assert_eq!(published(&mut cadence, 0, 5), Some((0, 5)));
        assert_eq!(published(&mut cadence, 0, 6), None);
        assert_eq!(published(&mut cadence, 1, 7), Some((1, 7)));
        assert_eq!(published(&mut cadence, 1, 7 + INTERVAL_NS - 1), None);
        assert_eq!(published(&mut cadence, 1, 7 + INTERVAL_NS), Some((1, 7 + INTERVAL_NS)));
    }
}
