//! How well the model holds for data that it was not learnt from: each block of time is judged by the others.
//!
//! For every block the identification runs over the whole input with the ground's samples of that block left out, so
//! nothing of what the plate says there can be learnt; then the model is frozen and judged on the block. The stop rule
//! is off: it would keep late blocks from being learnt.

mod verdict;

use anyhow::bail;
use equipoise_core::cycle::{Identification, Inputs, Memory, Settings, StopRule, Tick, step};

use super::free;
use super::input::Input;
use super::samples::Sample;
use super::score::{Judge, Scored};
use crate::config::Config;
use verdict::Judged;
pub use verdict::{Block, CrossValidation};

/// Judges each of `count` equal blocks of time by the others.
///
/// # Errors
/// Fewer than two blocks, or nothing to judge.
pub fn cross_validate(
    input: &Input,
    config: &Config,
    count: usize,
    judge: Judge,
) -> anyhow::Result<CrossValidation> {
    if !(2..=1000).contains(&count) {
        bail!("--cross-validate {count}: give 2 to 1000 blocks");
    }
    let pass = Pass::new(input, config, judge);
    // The table is what the loop believes while it learns nothing.
    let table = pass.run(Learning::Never, None)?;
    let (Some([first_ns, last_ns]), false) = (table.span_ns, table.scored.is_empty()) else {
        bail!(
            "no suit sample is {judge}: nothing to judge; see [static_pose] and overload.threshold_n of the \
             configuration"
        );
    };
    let bounds =
        |block: u64| first_ns + ((last_ns + 1 - first_ns) as u128 * u128::from(block) / count as u128) as u64;
    let mut judged = Judged::default();
    let mut blocks = Vec::new();
    for block in 0..count as u64 {
        let span_ns = [bounds(block), bounds(block + 1)];
        let learnt = pass.run(Learning::ApartFrom(span_ns), None)?;
        let frozen = pass.run(Learning::Never, Some(&learnt.worker))?;
        let of_block = Judged::of(&table.scored, &frozen.scored, span_ns);
        blocks.push(of_block.block(span_ns, learnt.worker.poses_used));
        judged.extend(of_block);
    }
    let poses = blocks.iter().map(|block| block.poses_used).sum::<u64>() / count as u64;
    let overall = judged.block([first_ns, last_ns + 1], poses);
    Ok(CrossValidation { judge, blocks, overall, started_ns: input.started_ns() })
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
    Ok(Pass::new(input, config, Judge::QuasiStatic).run(Learning::ApartFrom(span_ns), None)?.worker)
}

/// What may be learnt from.
#[derive(Clone, Copy)]
enum Learning {
    Never,
    /// All but the ground's samples of a span, ns; its end is not part of it.
    ApartFrom([u64; 2]),
}

struct Pass<'a> {
    input: &'a Input,
    config: &'a Config,
    settings: Settings,
    judge: Judge,
}

struct Passed {
    scored: Vec<Scored>,
    worker: Box<Identification>,
    /// First and last suit sample time, ns.
    span_ns: Option<[u64; 2]>,
}

impl<'a> Pass<'a> {
    fn new(input: &'a Input, config: &'a Config, judge: Judge) -> Pass<'a> {
        // Learning never ends by itself.
        let stop = StopRule::PredictedCop { sigma_m: 0.0 };
        let settings = Settings { stop, poses_min: u64::MAX, ..config.settings() };
        Pass { input, config, settings, judge }
    }

    /// Runs over the whole input and learns, or judges a frozen worker.
    fn run(&self, learning: Learning, frozen: Option<&Identification>) -> anyhow::Result<Passed> {
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&self.settings);
        if let Some(worker) = frozen {
            memory.identification = *worker;
        }
        let (mut scored, mut span_ns) = (Vec::new(), None);
        let samples = self.input.samples(self.config)?.filter(|sample| match (learning, sample) {
            (Learning::ApartFrom([begin_ns, end_ns]), Sample::Ground(ground)) => {
                !(begin_ns..end_ns).contains(&ground.sample_time_ns)
            }
            _ => true,
        });
        free::run(samples, self.config.period_ns(), |tick: Tick, inputs: Inputs<'_>| {
            let before_ns = memory.state.suit_sample_time_ns;
            memory.identification.learning = u64::from(!matches!(learning, Learning::Never));
            let state = step(&self.settings, &mut memory, tick, inputs);
            if state.suit_sample_time_ns != before_ns {
                let [first_ns, _] = span_ns.unwrap_or([state.suit_sample_time_ns; 2]);
                span_ns = Some([first_ns, state.suit_sample_time_ns]);
                scored.extend(Scored::of(state, state, self.judge));
            }
            Ok(())
        })?;
        Ok(Passed { scored, worker: Box::new(memory.identification), span_ns })
    }
}
