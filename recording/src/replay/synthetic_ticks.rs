//! Schedule of a replay without recorded cycles: ticks at the configured rate from the first sample on.

use anyhow::bail;
use equipoise_core::cycle::{Inputs, Tick};
use equipoise_core::message::CommandKind;
use equipoise_core::time::NS_PER_S;

use super::samples::Sample;

/// Ticks in gaps longer than this are skipped, ns: no inputs. A wrong time stamp in a capture would otherwise cause
/// days of empty ticks.
const GAP_SKIPPED_NS: u64 = 10 * NS_PER_S;
/// Error of an input without a sample.
pub(super) const NO_SAMPLE: &str = "the file contains no usable sample of suit or ground";

/// Calls `step` for every tick. A sample is passed to the first tick whose due time is at or after its delivery, or to
/// a later one. Tares of the empty plate at `tares_ns`, in order, are repeated: recorded samples are those before the
/// tare.
///
/// The last tick ingests the last sample.
///
/// # Errors
/// There is no sample, or what `step` returns.
pub fn run(
    samples: impl Iterator<Item = Sample>,
    period_ns: u64,
    tares_ns: &[u64],
    mut step: impl FnMut(Tick, Inputs<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut samples = samples.peekable();
    let Some(mut due_ns) = samples.peek().map(Sample::delivered_ns) else {
        bail!(NO_SAMPLE);
    };
    let mut tares_ns = tares_ns.iter().copied().peekable();
    let (mut suit, mut ground, mut cycle) = (Vec::new(), Vec::new(), 0);
    loop {
        suit.clear();
        ground.clear();
        let mut body = None;
        while let Some(sample) = samples.next_if(|sample| sample.delivered_ns() <= due_ns) {
            match sample {
                Sample::Suit(sample) => suit.push(*sample),
                Sample::Ground(sample) => ground.push(*sample),
                // Keep only the newest; each message is complete.
                Sample::Body(newest) => body = Some(*newest),
            }
        }
        cycle += 1;
        let command = tares_ns.next_if(|at_ns| *at_ns <= due_ns).map(|_| CommandKind::Tare);
        let inputs = Inputs { suit: &suit, ground: &ground, body: body.as_ref(), command };
        step(Tick { cycle, due_ns }, inputs)?;
        let Some(next) = samples.peek() else { return Ok(()) };
        let ahead_ns = next.delivered_ns() - due_ns;
        let ticks = if ahead_ns > GAP_SKIPPED_NS { ahead_ns / period_ns } else { 1 };
        due_ns = due_ns.saturating_add(ticks * period_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::GroundSample;

    fn ticks(times_ns: &[u64], period_ns: u64) -> Vec<(u64, u64, usize)> {
        let samples = times_ns.iter().map(|&arrival_ns| {
            Sample::Ground(Box::new(GroundSample { arrival_ns, ..GroundSample::zeroed() }))
        });
        let mut ticks = Vec::new();
        run(samples, period_ns, &[], |tick, inputs| {
            ticks.push((tick.cycle, tick.due_ns, inputs.ground.len()));
            Ok(())
        })
        .unwrap();
        ticks
    }

    #[test]
    fn a_tare_is_repeated_at_the_first_tick_at_or_after_it() {
        let samples = [100, 150].map(|arrival_ns| {
            Sample::Ground(Box::new(GroundSample { arrival_ns, ..GroundSample::zeroed() }))
        });
        let mut tared = Vec::new();
        run(samples.into_iter(), 10, &[105, 120, 900], |tick, inputs| {
            tared.extend(inputs.command.map(|command| (tick.due_ns, command)));
            Ok(())
        })
        .unwrap();
        assert_eq!(tared, [(110, CommandKind::Tare), (120, CommandKind::Tare)]);
    }

    #[test]
    fn a_sample_enters_the_first_tick_at_or_after_it() {
        assert_eq!(ticks(&[100, 110, 111, 115], 10), [(1, 100, 1), (2, 110, 1), (3, 120, 2)]);
    }

    #[test]
    fn a_long_gap_is_skipped_in_whole_ticks() {
        let ticks = ticks(&[5, 5 + 3_600 * NS_PER_S + 1], 1_000_000);
        assert_eq!(
            ticks,
            [(1, 5, 1), (2, 5 + 3_600 * NS_PER_S, 0), (3, 5 + 3_600 * NS_PER_S + 1_000_000, 1)]
        );
    }

    #[test]
    fn nothing_to_replay_is_an_error() {
        assert!(run(std::iter::empty(), 10, &[], |_, _| Ok(())).is_err());
    }
}
