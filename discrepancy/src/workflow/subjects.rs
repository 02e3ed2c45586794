//! The part of a recording with one subject: a model is that of one body.

use std::ops::Range;

use anyhow::bail;
use equipoise_recording::replay::input::Input;
use equipoise_recording::replay::survey::SubjectChange;

use crate::spans::Span;

use super::Reconcile;
use super::survey::Survey;

/// The part that contains the given spans, CLOCK_MONOTONIC ns; `None` if the recording has one subject.
///
/// # Errors
/// There are several subjects and no such part, or the configuration is of another subject.
pub(super) fn part_ns(reconcile: &Reconcile<'_>, survey: &Survey) -> anyhow::Result<Option<Range<u64>>> {
    let Input::Recording(recording) = reconcile.input else { return Ok(None) };
    let changes = survey.recorded.subject_changes(recording.header());
    let Some(last) = changes.last() else { return Ok(None) };
    let changes_s: Vec<f64> = changes.iter().map(|change| survey.seconds(change.at_ns)).collect();
    let given = &reconcile.given;
    let spans = [given.identify, given.reference, given.work].into_iter().flatten();
    let parts_of = |span: Span| {
        let first = changes_s.partition_point(|change_s| *change_s <= span.from_s);
        [first, changes_s.partition_point(|change_s| *change_s < span.to_s)]
    };
    let mut parts: Vec<usize> = spans.flat_map(parts_of).collect();
    parts.dedup();
    let [part] = parts[..] else {
        let until = |(change, time_s): (&SubjectChange, &f64)| {
            format!("{} until {time_s:.1} s, ", change.subjects[0])
        };
        let list: String = changes.iter().zip(&changes_s).map(until).collect();
        bail!(
            "the recording is of several workers, and a model is of one: {list}then {}; give --identify, --reference or \
             --work within the time of one of them",
            last.subjects[1]
        );
    };
    let (begin_ns, subject) = match part {
        0 => (0, &changes[0].subjects[0]),
        _ => (changes[part - 1].at_ns, &changes[part - 1].subjects[1]),
    };
    let configured = &reconcile.config.subject.id;
    if subject != configured {
        bail!(
            "the worker of the given spans is {subject}, and the configuration is {configured}'s; give a configuration of \
             {subject} with --config"
        );
    }
    Ok(Some(begin_ns..changes.get(part).map_or(u64::MAX, |next| next.at_ns)))
}
