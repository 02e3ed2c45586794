//! Cross-validation of the identified model: each block of time is predicted by a model identified from the other
//! blocks.
//!
//! For every block the identification runs over the whole input without the ground samples of that block, so nothing
//! measured by the plate there is used; then the model is frozen and evaluated on the block. The stop rule is disabled,
//! as it would exclude late blocks from the identification. The number of poses can be limited to mutually different
//! ones, as in an identification session.

mod verdict;

use anyhow::bail;
use equipoise_core::body::JOINTS;
use equipoise_core::cycle::{Identification, Inputs, Memory, Settings, StopRule, Tick, step};
use equipoise_core::static_pose::largest_joint_angle;

use super::free;
use super::input::Input;
use super::samples::Sample;
use super::score::{Judge, Scored};
use crate::config::Config;
use verdict::Judged;
pub use verdict::{Block, CrossValidation};

/// Evaluates each of `count` equal blocks of time with a model identified from the others.
///
/// # Errors
/// Fewer than two blocks, or no sample to evaluate.
pub fn cross_validate(
    input: &Input,
    config: &Config,
    count: usize,
    judge: Judge,
    poses_max: Option<usize>,
) -> anyhow::Result<CrossValidation> {
    if !(2..=1000).contains(&count) {
        bail!("--cross-validate {count}: give 2 to 1000 blocks");
    }
    let pass = Pass { poses_max, ..Pass::new(input, config, judge) };
    // Without identification the model is that of the table.
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
        blocks.push(of_block.block(span_ns, learnt.learnt));
        judged.extend(of_block);
    }
    let poses = blocks.iter().map(|block| block.poses_used).sum::<u64>() / count as u64;
    let overall = judged.block([first_ns, last_ns + 1], poses);
    Ok(CrossValidation { judge, blocks, overall, started_ns: input.started_ns() })
}

/// Identifies the subject from all data except those of a span of suit sample times, ns, exclusive of its end.
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

/// Data used for the identification.
#[derive(Clone, Copy)]
enum Learning {
    Never,
    /// All except the ground samples of a span, ns, exclusive of its end.
    ApartFrom([u64; 2]),
}

struct Pass<'a> {
    input: &'a Input,
    config: &'a Config,
    settings: Settings,
    judge: Judge,
    /// Maximum number of poses or motion samples used.
    poses_max: Option<usize>,
}

/// Poses used so far, mutually different.
#[derive(Default)]
struct Diverse {
    learnt: Vec<[[f64; 4]; JOINTS]>,
    count: u64,
}

/// Poses differ if any joint angle differs by more than this, rad.
const UNLIKE_RAD: f64 = 0.35;

impl Diverse {
    /// Whether the newest pose differs from all poses used, and fewer than `most` were used.
    fn wants(&self, memory: &Memory, most: usize) -> bool {
        let unlike = |joints: &[[f64; 4]; JOINTS]| {
            self.learnt.iter().all(|other| largest_joint_angle(other, joints) > UNLIKE_RAD)
        };
        self.learnt.len() < most && memory.window.newest().is_none_or(|held| unlike(&held.joint_wxyz))
    }

    /// Stores the newest pose if the last step used it.
    fn follow(&mut self, memory: &Memory) {
        let count = memory.identification.poses_used + u64::from(memory.state.motion_samples_used);
        if count > self.count {
            self.learnt.extend(memory.window.newest().map(|held| held.joint_wxyz));
        }
        self.count = count;
    }
}

struct Passed {
    /// Number of poses and motion samples used.
    learnt: u64,
    scored: Vec<Scored>,
    worker: Box<Identification>,
    /// First and last suit sample time, ns.
    span_ns: Option<[u64; 2]>,
}

impl<'a> Pass<'a> {
    fn new(input: &'a Input, config: &'a Config, judge: Judge) -> Pass<'a> {
        // Disable the stop rule.
        let stop = StopRule::PredictedCop { sigma_m: 0.0 };
        let settings = Settings { stop, poses_min: u64::MAX, ..config.settings() };
        Pass { input, config, settings, judge, poses_max: None }
    }

    /// Runs over the whole input and identifies the subject, or evaluates a frozen model.
    fn run(&self, learning: Learning, frozen: Option<&Identification>) -> anyhow::Result<Passed> {
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&self.settings);
        if let Some(worker) = frozen {
            memory.identification = *worker;
        }
        let (mut scored, mut span_ns) = (Vec::new(), None);
        let mut diverse = Diverse::default();
        let samples = self.input.samples(self.config)?.filter(|sample| match (learning, sample) {
            (Learning::ApartFrom([begin_ns, end_ns]), Sample::Ground(ground)) => {
                !(begin_ns..end_ns).contains(&ground.sample_time_ns)
            }
            _ => true,
        });
        free::run(samples, self.config.period_ns(), |tick: Tick, inputs: Inputs<'_>| {
            let before_ns = memory.state.suit_sample_time_ns;
            let wanted = self.poses_max.is_none_or(|most| diverse.wants(&memory, most));
            memory.identification.identifying = u64::from(wanted && !matches!(learning, Learning::Never));
            step(&self.settings, &mut memory, tick, inputs);
            diverse.follow(&memory);
            let state = &memory.state;
            if state.suit_sample_time_ns != before_ns {
                let [first_ns, _] = span_ns.unwrap_or([state.suit_sample_time_ns; 2]);
                span_ns = Some([first_ns, state.suit_sample_time_ns]);
                scored.extend(Scored::of(state, state, self.judge));
            }
            Ok(())
        })?;
        Ok(Passed { learnt: diverse.count, scored, worker: Box::new(memory.identification), span_ns })
    }
}
