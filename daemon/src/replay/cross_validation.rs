//! How well the model holds for data that it was not learnt from: each block of time is judged by the others.
//!
//! For every block the identification runs over the whole input and learns nothing while its 20-sample window holds a
//! sample of the block; then the model is frozen and judged on the block's quasi-static samples alone. The stop rule
//! is off: it would keep late blocks from being learnt.

mod verdict;

use std::collections::VecDeque;

use anyhow::bail;
use equipoise_core::cycle::{Identification, Inputs, Memory, Settings, StopRule, Tick, step};
use equipoise_core::static_pose::WINDOW;

use super::free;
use super::input::Input;
use super::score::Scored;
use crate::config::Config;
use verdict::Judged;
pub use verdict::{Block, CrossValidation};

/// Judges each of `count` equal blocks of time by the others.
///
/// # Errors
/// Fewer than two blocks, or nothing to judge.
pub fn cross_validate(input: &Input, config: &Config, count: usize) -> anyhow::Result<CrossValidation> {
    if !(2..=1000).contains(&count) {
        bail!("--cross-validate {count}: give 2 to 1000 blocks");
    }
    let pass = Pass::new(input, config);
    // The table is what the loop believes while it learns nothing.
    let table = pass.run(&|_| false, None)?;
    let (Some([first_ns, last_ns]), false) = (table.span_ns, table.scored.is_empty()) else {
        bail!(
            "no suit sample is quasi-static and without a load: nothing to judge; see [static_pose] and \
             overload.threshold_n of the configuration"
        );
    };
    let bounds =
        |block: u64| first_ns + ((last_ns + 1 - first_ns) as u128 * u128::from(block) / count as u128) as u64;
    let mut judged = Judged::default();
    let mut blocks = Vec::new();
    for block in 0..count as u64 {
        let span_ns = [bounds(block), bounds(block + 1)];
        let learnt = pass.run(&|seen| seen.is_apart_from(span_ns), None)?;
        let frozen = pass.run(&|_| false, Some(&learnt.worker))?;
        let of_block = Judged::of(&table.scored, &frozen.scored, span_ns);
        blocks.push(of_block.block(span_ns, learnt.worker.poses_used));
        judged.extend(of_block);
    }
    let poses = blocks.iter().map(|block| block.poses_used).sum::<u64>() / count as u64;
    let overall = judged.block([first_ns, last_ns + 1], poses);
    Ok(CrossValidation { blocks, overall, started_ns: input.started_ns() })
}

/// The worker as learnt from all data but those of a span of suit sample times, ns; the end is not part of it.
///
/// # Errors
/// The input holds no sample.
pub fn learn_apart_from(
    input: &Input,
    config: &Config,
    span_ns: [u64; 2],
) -> anyhow::Result<Box<Identification>> {
    Ok(Pass::new(input, config).run(&|seen| seen.is_apart_from(span_ns), None)?.worker)
}

/// Which times the next step may look at.
struct Seen {
    /// The oldest suit sample that can be in the window of stillness.
    oldest_ns: u64,
    due_ns: u64,
}

impl Seen {
    fn is_apart_from(&self, [begin_ns, end_ns]: [u64; 2]) -> bool {
        self.due_ns < begin_ns || self.oldest_ns >= end_ns
    }
}

struct Pass<'a> {
    input: &'a Input,
    config: &'a Config,
    settings: Settings,
}

struct Passed {
    scored: Vec<Scored>,
    worker: Box<Identification>,
    /// First and last suit sample time, ns.
    span_ns: Option<[u64; 2]>,
}

impl<'a> Pass<'a> {
    fn new(input: &'a Input, config: &'a Config) -> Pass<'a> {
        // Learning never ends by itself.
        let stop = StopRule::PredictedCop { sigma_m: 0.0 };
        let settings = Settings { stop, poses_min: u64::MAX, ..config.settings() };
        Pass { input, config, settings }
    }

    /// Runs over the whole input; learns where `learns` says so, or judges a frozen worker.
    fn run(&self, learns: &dyn Fn(&Seen) -> bool, frozen: Option<&Identification>) -> anyhow::Result<Passed> {
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&self.settings);
        if let Some(worker) = frozen {
            memory.identification = *worker;
        }
        let (mut scored, mut span_ns) = (Vec::new(), None);
        let mut recent = Recent::default();
        free::run(
            self.input.samples(self.config)?,
            self.config.period_ns(),
            |tick: Tick, inputs: Inputs<'_>| {
                let before_ns = memory.state.suit_sample_time_ns;
                recent.add(inputs.suit.iter().map(|sample| sample.sample_time_ns), before_ns);
                let seen = Seen { oldest_ns: recent.oldest_ns(), due_ns: tick.due_ns };
                memory.identification.learning = u64::from(learns(&seen));
                let state = step(&self.settings, &mut memory, tick, inputs);
                if state.suit_sample_time_ns != before_ns {
                    let [first_ns, _] = span_ns.unwrap_or([state.suit_sample_time_ns; 2]);
                    span_ns = Some([first_ns, state.suit_sample_time_ns]);
                    scored.extend(Scored::of(state, state));
                }
                Ok(())
            },
        )?;
        Ok(Passed { scored, worker: Box::new(memory.identification), span_ns })
    }
}

/// Suit sample times that are in the window of stillness, or may enter it with the next step.
#[derive(Default)]
struct Recent(VecDeque<u64>);

impl Recent {
    /// Takes new samples in and drops those that the next sample pushes out of the window.
    fn add(&mut self, times_ns: impl Iterator<Item = u64>, processed_ns: u64) {
        self.0.extend(times_ns);
        let processed = self.0.iter().take_while(|time_ns| **time_ns <= processed_ns).count();
        self.0.drain(..processed.saturating_sub(WINDOW - 1));
    }

    fn oldest_ns(&self) -> u64 {
        self.0.front().copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_of_stillness_never_reaches_into_the_block() {
        let mut recent = Recent::default();
        let block = [100, 200];
        let (mut learnt_before, mut learnt_after) = (0, u64::MAX);
        for time_ns in 1..=400 {
            // One sample a tick, worked through in the same step.
            recent.add(std::iter::once(time_ns), time_ns - 1);
            let seen = Seen { oldest_ns: recent.oldest_ns(), due_ns: time_ns };
            if seen.is_apart_from(block) {
                let oldest_in_window = time_ns.saturating_sub(WINDOW as u64 - 1);
                assert!(time_ns < block[0] || oldest_in_window >= block[1], "{time_ns}");
                if time_ns < block[0] {
                    learnt_before = time_ns;
                } else {
                    learnt_after = learnt_after.min(time_ns);
                }
            }
        }
        assert_eq!((learnt_before, learnt_after), (99, 200 + WINDOW as u64 - 1));
    }
}
