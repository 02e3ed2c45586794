//! States of a recording as frames at a fixed rate, as motion formats require.
//!
//! Layers, lowest first: `frame` → `resample`, `free_moment`, `lag` → here

pub(crate) mod frame;
mod free_moment;
mod lag;
pub(crate) mod resample;

use std::ops::RangeInclusive;

use anyhow::{Context, bail};
use bytemuck::Zeroable;
use equipoise_adapters::recording::{Entry, Recording, TimedEntry};
use equipoise_core::cycle::Tare;
use equipoise_core::message::State;

use crate::Progress;
use frame::Frame;
use free_moment::{FreeMoments, TareHistory};
use lag::LagHistory;
use resample::{Grid, Resampler};

/// Where the values come from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'a> {
    /// Recording with states.
    pub(crate) states: &'a Recording,
    /// Recording with the samples from which the states were computed; often the same.
    pub(crate) samples: &'a Recording,
    /// Whether a replay computed the states from the samples without the live loop's memory, so without its lag.
    pub(crate) is_replayed: bool,
    /// Begin and end, s since the start of the recording.
    pub(crate) span_s: Option<[f64; 2]>,
}

impl Source<'_> {
    /// The span, CLOCK_MONOTONIC ns.
    fn span_ns(&self) -> RangeInclusive<u64> {
        let started_ns = self.states.header().started_monotonic_ns;
        let at = |seconds: f64| started_ns.saturating_add((seconds * 1e9) as u64);
        self.span_s.map_or(0..=u64::MAX, |[from_s, to_s]| at(from_s)..=at(to_s))
    }
}

/// The frames of a recording; each iteration reads the file.
#[derive(Debug)]
pub(crate) struct Motion<'a> {
    source: Source<'a>,
    /// Of all instants, so that those of a span have the same values as without it.
    moments: FreeMoments,
    /// Times of the frames.
    pub(crate) grid: Grid,
    /// Data that could not be read.
    pub(crate) rejected: Vec<String>,
}

impl<'a> Motion<'a> {
    /// Determines rate, number of frames and free moments.
    ///
    /// # Errors
    /// The recording has fewer than two instants in the span.
    pub(crate) fn survey(source: Source<'a>, progress: &mut Progress<'_>) -> anyhow::Result<Motion<'a>> {
        let mut survey = Survey::default();
        for timed in source.samples.entries().map_while(Result::ok) {
            survey.ingest_sample(&timed);
        }
        survey.begin_states(source);
        progress.begin("determining the rate");
        let mut entries = source.states.entries();
        while let Some(timed) = entries.next() {
            match timed {
                Ok(timed) => survey.ingest_state(&timed),
                Err(damage) => survey.rejected.push(damage.to_string()),
            }
            progress.update(entries.fraction_read());
        }
        if source.states.truncated() {
            survey.rejected.push(Recording::TRUNCATED.to_owned());
        }
        let Survey { times_ns, ground_ns, tares, rejected, .. } = survey;
        let span_ns = source.span_ns();
        let [first, end] = [
            times_ns.partition_point(|time_ns| time_ns < span_ns.start()),
            times_ns.partition_point(|time_ns| time_ns <= span_ns.end()),
        ];
        let grids = times_ns.get(first..end).and_then(Grid::over).zip(Grid::over(&times_ns));
        let (grid, whole) = grids.with_context(|| {
            let lines: String = rejected.iter().map(|reason| format!("\nrejected: {reason}")).collect();
            format!("fewer than two instants with results{}{lines}", in_span(source.span_s))
        })?;
        let mut moments = FreeMoments::new(&ground_ns, whole.period_ns() / 2);
        progress.begin("free moments");
        let mut entries = source.samples.entries();
        while let Some(Ok(timed)) = entries.next() {
            if let Entry::Ground(sample) = &timed.entry {
                moments.ingest(sample, &tares);
            }
            progress.update(entries.fraction_read());
        }
        Ok(Motion { source, moments, grid, rejected })
    }

    /// Passes every frame to `visit`, in order.
    ///
    /// # Errors
    /// The error of `visit`.
    pub(crate) fn frames(
        &self,
        progress: &mut Progress<'_>,
        visit: &mut dyn FnMut(usize, &Frame) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (mut resampler, mut index, mut instant) = (Resampler::new(self.grid), 0, 0);
        let (mut instants, span_ns) = (Instants::default(), self.source.span_ns());
        let mut entries = self.source.states.entries();
        while let Some(timed) = entries.next() {
            // Damage ends the iteration; the survey has reported it.
            let Ok(timed) = timed else { continue };
            if let Some(state) = instants.next(&timed) {
                let free_moment_nm = self.moments.at(instant);
                instant += 1;
                if span_ns.contains(&state.suit_sample_time_ns) {
                    let frame = Frame::of(state, self.moments.surface_z_m(), free_moment_nm);
                    resampler.push(frame, &mut |frame| {
                        visit(index, frame)?;
                        index += 1;
                        Ok(())
                    })?;
                }
            }
            progress.update(entries.fraction_read());
        }
        if index != self.grid.frames {
            bail!("the recording changed while it was read: {index} of {} frames", self.grid.frames);
        }
        Ok(())
    }

    /// Height of the walking surface, m; NaN without a ground sample.
    pub(crate) fn surface_z_m(&self) -> f64 {
        self.moments.surface_z_m()
    }

    /// Seconds since the start of the recording.
    pub(crate) fn time_s(&self, time_ns: u64) -> f64 {
        (time_ns as f64 - self.source.states.header().started_monotonic_ns as f64) / 1e9
    }
}

fn in_span(span_s: Option<[f64; 2]>) -> String {
    span_s.map_or_else(String::new, |[from, to]| format!(" from {from} to {to} s: choose another --span"))
}

/// Distinguishes new instants from repetitions: the loop publishes each result until the next one.
#[derive(Debug, Default)]
struct Instants {
    last_ns: u64,
}

impl Instants {
    /// The state of an entry if it has a later sample time than all before.
    fn next<'e>(&mut self, timed: &'e TimedEntry) -> Option<&'e State> {
        let Entry::State(state) = &timed.entry else { return None };
        (state.suit_sample_time_ns > self.last_ns).then(|| {
            self.last_ns = state.suit_sample_time_ns;
            &**state
        })
    }
}

/// What one reading of both recordings determines, whatever the span.
#[derive(Default)]
struct Survey {
    instants: Instants,
    times_ns: Vec<u64>,
    /// The same times on the clock of the ground; `None` if the lag is unavailable.
    ground_ns: Vec<Option<u64>>,
    tares: TareHistory,
    lags: LagHistory,
    has_cycles: bool,
    rejected: Vec<String>,
}

impl Survey {
    fn ingest_state(&mut self, timed: &TimedEntry) {
        let Some(state) = self.instants.next(timed) else { return };
        let time_ns = state.suit_sample_time_ns;
        let lag_s = self.lags.at(state);
        self.times_ns.push(time_ns);
        self.ground_ns.push(lag_s.map(|lag_s| time_ns.saturating_add_signed(-(lag_s * 1e9) as i64)));
    }

    fn ingest_sample(&mut self, timed: &TimedEntry) {
        self.has_cycles |= matches!(timed.entry, Entry::Cycle(_));
        self.tares.ingest(timed);
        self.lags.ingest(timed);
    }

    /// Ends the samples. Without cycle records the states were computed by a replay, which begins without a lag, and
    /// without a tare unless there is a checkpoint.
    fn begin_states(&mut self, source: Source<'_>) {
        let is_fresh = source.is_replayed || !self.has_cycles;
        self.tares.begin_with(is_fresh.then(Tare::zeroed));
        self.lags.begin(is_fresh, source.states.header());
    }
}

#[cfg(test)]
mod tests {
    use equipoise_adapters::recording::{Recorder, RecordingHeader};
    use equipoise_core::message::GroundSample;

    use super::*;

    const NS_PER_MS: u64 = 1_000_000;

    /// 4 s of states at 100 Hz and of a plate at 1000 Hz, whose free moment in N m is the time in s. A skew is published
    /// during the first second only, and stays in use.
    fn recording() -> Recording {
        let mut recorder = Recorder::in_memory("a.mcap", &RecordingHeader::default()).unwrap();
        for cycle in 1..=400 {
            let time_ns = cycle * 10 * NS_PER_MS;
            let [suit_skew_s, suit_skew_sigma_s] = if cycle <= 100 { [0.06, 0.004] } else { [0.0; 2] };
            let suit_sample_time_ns = time_ns;
            let times = State { cycle, time_ns, suit_sample_time_ns, ..State::zeroed() };
            recorder.write(time_ns, &State { suit_skew_s, suit_skew_sigma_s, ..times }).unwrap();
        }
        for sequence in 1..=4000 {
            let sample_time_ns = sequence * NS_PER_MS;
            let (force_n, moment_nm) = ([0.0, 0.0, 700.0], [0.0, 0.0, sample_time_ns as f64 * 1e-9]);
            let sample =
                GroundSample { sequence, sample_time_ns, force_n, moment_nm, ..GroundSample::zeroed() };
            recorder.write(sample_time_ns, &sample).unwrap();
        }
        Recording::from_bytes(recorder.into_bytes().unwrap()).unwrap()
    }

    fn free_moments(recording: &Recording, span_s: Option<[f64; 2]>) -> Vec<(u64, f64)> {
        let source = Source { states: recording, samples: recording, is_replayed: false, span_s };
        let (mut ignore, mut found) = (|_: &'static str, _: f64| {}, Vec::new());
        let mut progress = Progress::new(&mut ignore);
        let motion = Motion::survey(source, &mut progress).unwrap();
        let mut visit = |_: usize, frame: &Frame| {
            found.push((frame.time_ns, frame.free_moment_nm));
            Ok(())
        };
        motion.frames(&mut progress, &mut visit).unwrap();
        found
    }

    #[test]
    fn an_instant_has_the_same_value_with_and_without_a_span() {
        let recording = recording();
        let in_span = |(time_ns, _): &(u64, f64)| (2000 * NS_PER_MS..=3000 * NS_PER_MS).contains(time_ns);
        let whole: Vec<_> = free_moments(&recording, None).into_iter().filter(in_span).collect();
        let part = free_moments(&recording, Some([2.0, 3.0]));
        assert_eq!((part.len(), &part), (101, &whole));
        // The lag of the first second is subtracted.
        let (time_ns, moment_nm) = part[50];
        assert!(
            time_ns == 2500 * NS_PER_MS && (moment_nm - 2.44).abs() < 2e-3,
            "{moment_nm} N m at {time_ns} ns"
        );
    }
}
