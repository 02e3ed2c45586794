//! Cross-validation of the identified model: each block of time is predicted by a model identified from the other
//! blocks.
//!
//! For every block the identification runs over the whole input without the ground samples of that block, so nothing
//! measured by the plate there is used; then the model is frozen and evaluated on the block. The stop rule is disabled,
//! as it would exclude late blocks from the identification. The number of poses can be limited to mutually different
//! ones, as in an identification session.

mod verdict;

use anyhow::bail;
use equipoise_config::Config;
use equipoise_core::body::JOINTS;
use equipoise_core::cycle::{Identification, Inputs, Memory, Settings, StopRule, Tick, step};
use equipoise_core::static_pose::largest_joint_angle;

use super::input::Input;
use super::samples::Sample;
use super::score::{SampleSelection, Scored};
use super::survey::Survey;
use super::synthetic_ticks;
use verdict::ErrorSamples;
pub use verdict::{Block, CrossValidation};

/// Evaluates each of `count` equal blocks of time with a model identified from the others.
///
/// # Errors
/// Fewer than two blocks, or no sample to evaluate.
pub fn cross_validate(
    input: &Input,
    config: &Config,
    count: usize,
    selection: SampleSelection,
    poses_max: Option<usize>,
) -> anyhow::Result<CrossValidation> {
    if !(2..=1000).contains(&count) {
        bail!("--cross-validate {count}: give 2 to 1000 blocks");
    }
    let pass = Pass { poses_max, ..Pass::new(input, config, selection) };
    // Without identification the model is that of the table.
    let table = pass.run(Training::Never, None)?;
    let (Some([first_ns, last_ns]), false) = (table.span_ns, table.scored.is_empty()) else {
        bail!(
            "no suit sample is {selection}: nothing to evaluate; see [static_pose] and overload.threshold_n of the \
             configuration"
        );
    };
    let bounds =
        |block: u64| first_ns + ((last_ns + 1 - first_ns) as u128 * u128::from(block) / count as u128) as u64;
    let mut errors = ErrorSamples::default();
    let mut blocks = Vec::new();
    for block in 0..count as u64 {
        let span_ns = [bounds(block), bounds(block + 1)];
        let trained = pass.run(Training::Without(span_ns), None)?;
        let frozen = pass.run(Training::Never, Some(&trained.worker))?;
        let of_block = ErrorSamples::of(&table.scored, &frozen.scored, span_ns);
        blocks.push(of_block.block(span_ns, trained.poses_used));
        errors.extend(of_block);
    }
    let poses = blocks.iter().map(|block| block.poses_used).sum::<u64>() / count as u64;
    let overall = errors.block([first_ns, last_ns + 1], poses);
    Ok(CrossValidation { selection, blocks, overall, started_ns: input.started_ns() })
}

/// Identifies the subject from all data except those of a span of suit sample times, ns, exclusive of its end.
///
/// # Errors
/// The input holds no sample.
pub fn identify_without(
    input: &Input,
    config: &Config,
    span_ns: [u64; 2],
) -> anyhow::Result<Box<Identification>> {
    Ok(Pass::new(input, config, SampleSelection::QuasiStatic).run(Training::Without(span_ns), None)?.worker)
}

/// Data used for the identification.
#[derive(Clone, Copy)]
enum Training {
    Never,
    /// All except the ground samples of a span, ns, exclusive of its end.
    Without([u64; 2]),
}

struct Pass<'a> {
    input: &'a Input,
    config: &'a Config,
    survey: Survey,
    settings: Settings,
    selection: SampleSelection,
    /// Maximum number of poses or motion samples used.
    poses_max: Option<usize>,
}

/// Poses used so far, mutually different.
#[derive(Default)]
struct Diverse {
    joint_angles: Vec<[[f64; 4]; JOINTS]>,
    count: u64,
}

/// Poses differ if any joint angle differs by more than this, rad.
const DIFFERENCE_MIN_RAD: f64 = 0.35;

impl Diverse {
    /// Whether the newest pose differs from all poses used, and fewer than `most` were used.
    fn accepts(&self, memory: &Memory, most: usize) -> bool {
        let is_different = |joints: &[[f64; 4]; JOINTS]| {
            self.joint_angles.iter().all(|other| largest_joint_angle(other, joints) > DIFFERENCE_MIN_RAD)
        };
        self.joint_angles.len() < most
            && memory.window.newest().is_none_or(|held| is_different(&held.joint_wxyz))
    }

    /// Stores the newest pose if the last step used it.
    fn update(&mut self, memory: &Memory) {
        let count = memory.identification.poses_used + u64::from(memory.state.motion_samples_used);
        if count > self.count {
            self.joint_angles.extend(memory.window.newest().map(|held| held.joint_wxyz));
        }
        self.count = count;
    }
}

struct PassResult {
    /// Number of poses and motion samples used.
    poses_used: u64,
    scored: Vec<Scored>,
    worker: Box<Identification>,
    /// First and last suit sample time, ns.
    span_ns: Option<[u64; 2]>,
}

impl<'a> Pass<'a> {
    fn new(input: &'a Input, config: &'a Config, selection: SampleSelection) -> Pass<'a> {
        // Disable the stop rule.
        let stop = StopRule::PredictedCop { sigma_m: 0.0 };
        let settings = Settings { stop, poses_min: u64::MAX, ..config.settings() };
        Pass { input, config, survey: input.survey(), settings, selection, poses_max: None }
    }

    /// Runs over the whole input and identifies the subject, or evaluates a frozen model.
    fn run(&self, training: Training, frozen: Option<&Identification>) -> anyhow::Result<PassResult> {
        let mut memory = self.survey.initial_memory(&self.settings);
        if let Some(worker) = frozen {
            memory.identification = *worker;
        }
        let (mut scored, mut span_ns) = (Vec::new(), None);
        let mut diverse = Diverse::default();
        let samples = self.input.samples(self.config)?.filter(|sample| match (training, sample) {
            (Training::Without([begin_ns, end_ns]), Sample::Ground(ground)) => {
                !(begin_ns..end_ns).contains(&ground.sample_time_ns)
            }
            _ => true,
        });
        let (period_ns, tares_ns) = (self.config.period_ns(), &self.survey.tares_ns);
        synthetic_ticks::run(samples, period_ns, tares_ns, |tick: Tick, inputs: Inputs<'_>| {
            let before_ns = memory.state.suit_sample_time_ns;
            let accepted = self.poses_max.is_none_or(|most| diverse.accepts(&memory, most));
            memory.identification.identifying = u64::from(accepted && !matches!(training, Training::Never));
            step(&self.settings, &mut memory, tick, inputs);
            diverse.update(&memory);
            let state = &memory.state;
            if state.suit_sample_time_ns != before_ns {
                let [first_ns, _] = span_ns.unwrap_or([state.suit_sample_time_ns; 2]);
                span_ns = Some([first_ns, state.suit_sample_time_ns]);
                scored.extend(Scored::of(state, state, self.selection));
            }
            Ok(())
        })?;
        Ok(PassResult { poses_used: diverse.count, scored, worker: Box::new(memory.identification), span_ns })
    }
}
