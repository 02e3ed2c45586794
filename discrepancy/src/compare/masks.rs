//! Intervals in which nothing is compared, by reason.

use std::collections::VecDeque;

use crate::session::LeftOut;

/// Why nothing is compared in an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    /// A foot is in the air.
    LiftedFoot,
    /// A foot has come down somewhere else.
    Step,
    /// The plate has no centre of pressure.
    NoCop,
    /// The acceleration is that of an impact or a jump.
    Impact,
}

/// Masked intervals of each reason, by time, s.
#[derive(Debug, Default)]
pub(super) struct Masks {
    spans_s: VecDeque<(Reason, [f64; 2])>,
}

impl Masks {
    /// Masks the interval of `margin_s` on both sides of a time.
    pub(super) fn add(&mut self, reason: Reason, time_s: f64, margin_s: f64) {
        let [from_s, to_s] = [time_s - margin_s, time_s + margin_s];
        let last = self.spans_s.iter_mut().rev().find(|(other, _)| *other == reason);
        match last {
            Some((_, last_s)) if from_s <= last_s[1] => {
                *last_s = [last_s[0].min(from_s), last_s[1].max(to_s)];
            }
            _ => self.spans_s.push_back((reason, [from_s, to_s])),
        }
    }

    /// Why nothing is compared in an interval; `None` if it is not masked.
    pub(super) fn reason(&self, [from_s, to_s]: [f64; 2]) -> Option<Reason> {
        let overlaps = |span_s: &[f64; 2]| span_s[0] < to_s && span_s[1] > from_s;
        self.spans_s.iter().find(|(_, span_s)| overlaps(span_s)).map(|(reason, _)| *reason)
    }

    /// Drops what ended before a time, s.
    pub(super) fn drop_before(&mut self, time_s: f64) {
        self.spans_s.retain(|(_, span_s)| span_s[1] >= time_s);
    }

    /// Number of intervals.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.spans_s.len()
    }
}

impl LeftOut {
    /// Counts a block.
    pub(super) fn add(&mut self, reason: Reason) {
        *match reason {
            Reason::LiftedFoot => &mut self.lifted_foot,
            Reason::Step => &mut self.step,
            Reason::NoCop => &mut self.no_cop,
            Reason::Impact => &mut self.impact,
        } += 1;
    }
}
