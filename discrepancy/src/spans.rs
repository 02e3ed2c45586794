//! Phases of a recording: as given by the user, else as determined from the recording.

use std::fmt;
use std::str::FromStr;

use crate::constants::{
    DEFAULT_REFERENCE_S, IDENTIFY_FRACTION_MAX, INTERVAL_MIN_S, LONG_S, SPAN_EXCESS_S, WORK_MIN_S,
};
use crate::session::Spans;

/// A span as on the command line: `12:90.5`, seconds since the recording's start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Start, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
}

impl Span {
    fn pair(self) -> [f64; 2] {
        [self.from_s, self.to_s]
    }
}

impl FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Span, String> {
        let wrong = || format!("\"{text}\" is not a span; give two times in seconds, as in 12:90.5");
        let (from, to) = text.split_once(':').ok_or_else(wrong)?;
        let time_s = |text: &str| text.trim().parse::<f64>().ok().filter(|time_s| time_s.is_finite());
        let (Some(from_s), Some(to_s)) = (time_s(from), time_s(to)) else { return Err(wrong()) };
        if from_s < 0.0 {
            return Err(format!(
                "\"{text}\" begins before the recording; its time 0 is the recording's begin"
            ));
        }
        if to_s <= from_s {
            return Err(format!("\"{text}\" ends before it begins; write the earlier time first"));
        }
        Ok(Span { from_s, to_s })
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.from_s, self.to_s)
    }
}

/// Spans given by the user.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Given {
    /// Identification poses.
    pub identify: Option<Span>,
    /// Work declared clean.
    pub reference: Option<Span>,
    /// Work in question.
    pub work: Option<Span>,
}

/// Events in the recording, s since its start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordingEvents {
    /// Start and end of the samples.
    pub samples_s: [f64; 2],
    /// Time at which the subject was reported as identified.
    pub identified_s: Option<f64>,
    /// Time of the last pose or motion sample used by identification.
    pub last_learnt_s: Option<f64>,
    /// Whether the recording contains a subject identified before its start.
    pub brings_worker: bool,
}

/// Reasons why spans are unusable.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpanError {
    /// A span is outside the recording.
    #[error(
        "{option} {span} lies outside the recording, which lasts from {from_s:.1} s to {to_s:.1} s; choose times within it"
    )]
    Outside {
        /// The option.
        option: &'static str,
        /// The kind of span.
        span: Span,
        /// Start of the samples, s.
        from_s: f64,
        /// End of the samples, s.
        to_s: f64,
    },
    /// Two spans overlap.
    #[error("{first} and {second} overlap; each time belongs to one span only")]
    Overlap {
        /// One of them, with its times.
        first: String,
        /// The other.
        second: String,
    },
    /// A phase is too short.
    #[error("{what} lasts {length_s:.1} s; at least {least_s} s are needed")]
    Short {
        /// The phase.
        what: &'static str,
        /// Its length, s.
        length_s: f64,
        /// The required length, s.
        least_s: f64,
    },
}

/// The phases, and a description of how they were determined.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedSpans {
    /// The phases.
    pub spans_s: Spans,
    /// A sentence for the user.
    pub description: String,
}

impl Given {
    /// Checks that the user's spans lie in the recording and do not overlap.
    ///
    /// # Errors
    /// [`SpanError`], which names the option.
    pub fn check(&self, [from_s, to_s]: [f64; 2]) -> Result<(), SpanError> {
        let given = [("--identify", self.identify), ("--reference", self.reference), ("--work", self.work)];
        let given: Vec<(&str, Span)> =
            given.into_iter().filter_map(|(option, span)| Some((option, span?))).collect();
        for &(option, span) in &given {
            if span.from_s >= to_s || span.to_s <= from_s || span.to_s > to_s + SPAN_EXCESS_S {
                return Err(SpanError::Outside { option, span, from_s, to_s });
            }
            let length_s = span.to_s - span.from_s;
            if length_s < INTERVAL_MIN_S {
                return Err(SpanError::Short { what: option, length_s, least_s: INTERVAL_MIN_S });
            }
        }
        for (index, (option, span)) in given.iter().enumerate() {
            for (other_option, other) in &given[..index] {
                if span.from_s < other.to_s && other.from_s < span.to_s {
                    return Err(SpanError::Overlap {
                        first: format!("{other_option} {other}"),
                        second: format!("{option} {span}"),
                    });
                }
            }
        }
        Ok(())
    }

    /// End of identification where it is not given and identification does not end by itself, s.
    pub fn learn_until_s(&self, [from_s, to_s]: [f64; 2]) -> f64 {
        let next =
            [self.reference, self.work].into_iter().flatten().map(|span| span.from_s).fold(to_s, f64::min);
        next.min(from_s + IDENTIFY_FRACTION_MAX * (to_s - from_s)).max(from_s)
    }

    /// Fills in the spans that were not given.
    ///
    /// # Errors
    /// [`SpanError`]: as [`Given::check`], and if too little time is left for the work.
    pub fn resolve(&self, events: &RecordingEvents) -> Result<ResolvedSpans, SpanError> {
        let [from_s, to_s] = events.samples_s;
        self.check(events.samples_s)?;
        let others = [self.reference, self.work].into_iter().flatten();
        let first_other_s = others.map(|span| span.from_s).fold(to_s, f64::min);
        let (identify, how) = match (self.identify, events.identified_s) {
            (Some(span), _) => (span.pair(), "as given"),
            (None, _) if events.brings_worker => {
                ([from_s; 2], "none: the worker was identified before the recording began")
            }
            (None, Some(end_s)) => ([from_s, end_s.min(first_other_s)], "until the worker was identified"),
            (None, None) => {
                let end_s = events.last_learnt_s.unwrap_or(from_s).min(self.learn_until_s(events.samples_s));
                ([from_s, end_s], "until the last pose used; identification did not converge")
            }
        };
        let rest_s = identify[1].max(from_s);
        let long = self.work.is_none() && to_s - rest_s >= LONG_S;
        let (reference, reference_how) = match self.reference {
            Some(span) => (Some(span.pair()), "as given"),
            None if long => {
                (Some([rest_s, rest_s + DEFAULT_REFERENCE_S]), "the first minutes of a long recording")
            }
            None => (None, "none"),
        };
        let work = match self.work {
            Some(span) => span.pair(),
            None => self.longest_rest(identify, reference, events.samples_s),
        };
        let [length_s, least_s] =
            [work[1] - work[0], if self.work.is_some() { INTERVAL_MIN_S } else { WORK_MIN_S }];
        if length_s < least_s {
            return Err(SpanError::Short { what: "the work", length_s, least_s });
        }
        let found = self.identify.is_none() || self.work.is_none();
        let spans_s = Spans { identify, reference, work, found };
        let description = format!(
            "identification {} ({how}); clean work {} ({reference_how}); work in question {} ({})",
            seconds(identify),
            reference.map_or_else(|| "–".to_owned(), seconds),
            seconds(work),
            if self.work.is_some() { "as given" } else { "the remainder" },
        );
        Ok(ResolvedSpans { spans_s, description })
    }

    /// The longest interval of the recording that is neither identification nor reference.
    fn longest_rest(
        &self,
        identify: [f64; 2],
        reference: Option<[f64; 2]>,
        [from_s, to_s]: [f64; 2],
    ) -> [f64; 2] {
        let mut taken: Vec<[f64; 2]> = [Some(identify), reference].into_iter().flatten().collect();
        taken.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let (mut longest, mut free_from_s) = ([from_s; 2], from_s);
        for [begin_s, end_s] in taken.into_iter().chain([[to_s; 2]]) {
            if begin_s - free_from_s > longest[1] - longest[0] {
                longest = [free_from_s, begin_s];
            }
            free_from_s = free_from_s.max(end_s);
        }
        longest
    }
}

fn seconds([from_s, to_s]: [f64; 2]) -> String {
    format!("{from_s:.1} s – {to_s:.1} s")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLES_S: [f64; 2] = [0.5, 300.0];

    fn span(text: &str) -> Option<Span> {
        Some(text.parse().unwrap())
    }

    fn events(identified_s: Option<f64>, last_learnt_s: Option<f64>) -> RecordingEvents {
        RecordingEvents { samples_s: SAMPLES_S, identified_s, last_learnt_s, brings_worker: false }
    }

    #[test]
    fn a_span_is_two_times_in_order() {
        assert_eq!("12:90.5".parse(), Ok(Span { from_s: 12.0, to_s: 90.5 }));
        for wrong in ["12", "12:", "a:b", "20:10", "5:5", "-3:4", "1:inf", "1:2:3"] {
            assert!(wrong.parse::<Span>().unwrap_err().contains(wrong), "{wrong}");
        }
    }

    #[test]
    fn missing_spans_are_found_and_described() {
        let resolved = Given::default().resolve(&events(Some(80.0), Some(79.0))).unwrap();
        let spans_s = Spans { identify: [0.5, 80.0], reference: None, work: [80.0, 300.0], found: true };
        assert_eq!(resolved.spans_s, spans_s);
        assert!(
            resolved.description.contains("0.5 s – 80.0 s (until the worker was identified)"),
            "{}",
            resolved.description
        );
        // Identification did not converge: the result of the first part is used.
        let resolved = Given::default().resolve(&events(None, Some(250.0))).unwrap();
        assert!((resolved.spans_s.identify[1] - 120.3).abs() < 1e-9, "{:?}", resolved.spans_s);
    }

    #[test]
    fn what_is_given_is_taken_and_the_rest_is_work() {
        let given = Given { identify: span("200:280"), reference: span("150:200"), work: None };
        let resolved = given.resolve(&events(None, None)).unwrap();
        assert_eq!(resolved.spans_s.work, [0.5, 150.0]);
        let given = Given { work: span("100:130"), ..Given::default() };
        let resolved = given.resolve(&events(Some(140.0), None)).unwrap();
        assert_eq!((resolved.spans_s.identify, resolved.spans_s.work), ([0.5, 100.0], [100.0, 130.0]));
    }

    #[test]
    fn a_long_recording_has_a_reference_and_a_worker_who_was_known_no_poses() {
        let long = RecordingEvents { samples_s: [0.0, 7200.0], ..events(Some(90.0), None) };
        let spans_s = Given::default().resolve(&long).unwrap().spans_s;
        assert_eq!((spans_s.reference, spans_s.work), (Some([90.0, 270.0]), [270.0, 7200.0]));
        let known = RecordingEvents { brings_worker: true, ..events(None, None) };
        let spans_s = Given::default().resolve(&known).unwrap().spans_s;
        assert_eq!((spans_s.identify, spans_s.work), ([0.5; 2], SAMPLES_S));
    }

    #[test]
    fn spans_that_cannot_be_are_refused_by_name() {
        let refused = |given: Given| given.resolve(&events(Some(80.0), None)).unwrap_err().to_string();
        let text = refused(Given { work: span("290:400"), ..Given::default() });
        assert!(text.contains("--work 290:400 lies outside") && text.contains("300.0 s"), "{text}");
        let text = refused(Given { identify: span("0:60"), work: span("50:200"), ..Given::default() });
        assert!(text.contains("--identify 0:60 and --work 50:200 overlap"), "{text}");
        let text = refused(Given { reference: span("100:101"), ..Given::default() });
        assert!(text.contains("--reference lasts 1.0 s"), "{text}");
        let text = refused(Given { identify: span("0:295"), ..Given::default() });
        assert!(text.contains("the work lasts 5.0 s; at least 10 s"), "{text}");
    }
}
