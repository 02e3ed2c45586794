//! The sequence of steps from a session to a finding; its options and errors.

use equipoise_core::effect;
use thiserror::Error;

use crate::answer::Residuals;
use crate::block::{Block, Change, Phase};
use crate::candidate;
use crate::constants::{CLEAN_BLOCKS_MIN, DRAWS, LOG_ODDS_MIN, WORK_BLOCKS_MIN};
use crate::finding::Finding;
use crate::floor::{Floor, stances_m};
use crate::generic;
use crate::gram::Gram;
use crate::holdout::held_out;
use crate::noise::Noise;
use crate::picture::Picture;
use crate::posterior::same_columns;
use crate::refine::scale_moment_priors;
use crate::rows::Rows;
use crate::select::select;
use crate::session::{LeftOut, Session};
use crate::trials::chance_level;
use crate::verdict::Remainder;
use crate::windows::Windows;
use crate::{answer, drawing};

/// Options of a reconciliation.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Minimum log Bayes factor of a generic term; the level reached by chance on these data may be higher.
    pub least_log_odds: f64,
    /// Number of simulated clean sessions from which the level reached by chance is estimated.
    pub draws: usize,
    /// Effects that are not there, by name with place: an engineer rejected them.
    pub excluded: Vec<String>,
}

impl Default for Options {
    /// Calibrated on clean sessions (docs/discrepancy.md).
    fn default() -> Options {
        Options { least_log_odds: LOG_ODDS_MIN, draws: DRAWS, excluded: Vec::new() }
    }
}

/// Why a session cannot be reconciled.
#[derive(Debug, Error)]
pub enum ReconcileError {
    /// The work phase has too few blocks.
    #[error(
        "only {found} usable blocks of {block_s:.1} s lie in the work in question ({from_s:.1} s to {to_s:.1} s), and \
         {needed} are needed; choose a longer span with --work{left_out}{}",
        .left_out.advice()
    )]
    TooLittleWork {
        /// Blocks found.
        found: usize,
        /// Blocks required.
        needed: usize,
        /// Length of a block, s.
        block_s: f64,
        /// Start of the work, s.
        from_s: f64,
        /// Its end, s.
        to_s: f64,
        /// Blocks left out.
        left_out: LeftOut,
    },
    /// The recording has too few blocks outside the work.
    #[error(
        "only {found} usable blocks lie outside the work in question, and {needed} are needed to fit the noise; give \
         identification poses (--identify) or clean work (--reference)"
    )]
    NothingToCompareWith {
        /// Blocks found.
        found: usize,
        /// Blocks required.
        needed: usize,
    },
    /// A block contains a value that is not finite.
    #[error("a value of the block at {time_s:.1} s is not a number; the recording is damaged there")]
    NotANumber {
        /// Middle of the block, s.
        time_s: f64,
    },
    /// Measured values are constant, or the numbers do not permit a fit.
    #[error(
        "the noise of the {channel} cannot be fitted; its values may be constant. Check the sensor's wiring and channel"
    )]
    NoNoise {
        /// The channel.
        channel: &'static str,
    },
}

/// Result of a reconciliation.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The finding; its `model` is filled in by the writer of the file.
    pub finding: Finding,
    /// Terms to be added to the model, in the order of the finding's effects.
    pub terms: Vec<Fitted>,
    /// Data of the report's figures.
    pub picture: Picture,
}

/// A fitted term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitted {
    /// The term, as the loop runs it; an effect that lasts to the end of the recording has no end.
    pub term: effect::Term,
    /// 1-σ of its values.
    pub sigma: [f64; effect::PARAMETERS_MAX],
    /// 1-σ of its shape if fitted; else 0.
    pub shape_sigma: f64,
    /// Log Bayes factor when it was accepted.
    pub log_odds: f64,
}

/// Locates discrepancies of model and measurement, names what the model lacks, and computes how much the gap shrinks.
///
/// `progress` receives the completed fraction, in \[0, 1\].
pub fn reconcile(
    session: &Session,
    options: &Options,
    progress: &mut dyn FnMut(f64),
) -> Result<Outcome, ReconcileError> {
    check(session)?;
    let rows = Rows::of(session);
    let noise = Noise::fit(&rows)?;
    progress(0.4);
    let mut candidates = candidate::all(&rows);
    candidates.retain(|candidate| !options.excluded.iter().any(|name| same_columns(name, &candidate.name())));
    let mut gram = Gram::of(&rows, &noise, candidates);
    scale_moment_priors(&mut gram);
    let threshold = options.least_log_odds.max(chance_level(&gram, options.draws));
    progress(0.6);
    let windows = Windows::of(&gram);
    progress(0.7);
    let library = generic::library(&gram);
    let selection = select(&mut gram, &windows, &library);
    progress(0.8);
    let generics = generic::search(&gram, &library, &selection.terms(), threshold);
    let rest = Remainder::of(&gram, &selection.terms());
    let stances_m = stances_m(&gram, &rest.after);
    let no_noise = || ReconcileError::NoNoise { channel: "plate" };
    let mut held = held_out(&gram, &selection.terms(), &stances_m).ok_or_else(no_noise)?;
    progress(0.9);
    let floor = Floor::of(&gram, &selection.terms(), &stances_m).ok_or_else(no_noise)?;
    held.subtract_expected(&floor.mean);
    let answer = answer::assemble(&gram, &selection, generics, Residuals { held: &held, rest, floor });
    let picture = drawing::picture(&gram, &selection, &held, &answer, threshold);
    progress(1.0);
    Ok(Outcome { finding: answer.finding, terms: answer.terms, picture })
}

/// Rejects sessions that do not permit an inference.
fn check(session: &Session) -> Result<(), ReconcileError> {
    let in_work = session.blocks.iter().filter(|block| block.phase == Phase::Work).count();
    let clean = session.blocks.len() - in_work;
    if in_work < WORK_BLOCKS_MIN {
        let [from_s, to_s] = session.spans_s.work;
        let block_s = session.block_s;
        return Err(ReconcileError::TooLittleWork {
            found: in_work,
            needed: WORK_BLOCKS_MIN,
            block_s,
            from_s,
            to_s,
            left_out: session.left_out,
        });
    }
    if clean < CLEAN_BLOCKS_MIN {
        return Err(ReconcileError::NothingToCompareWith { found: clean, needed: CLEAN_BLOCKS_MIN });
    }
    let not_finite = session.blocks.iter().find(|block| !block.is_finite());
    not_finite.map_or(Ok(()), |block| Err(ReconcileError::NotANumber { time_s: block.observation.time_s }))
}

impl Block {
    /// Whether all values used are finite.
    fn is_finite(&self) -> bool {
        let seen = &self.observation;
        let single = [seen.floor_m, seen.mass_kg, self.heading_rad];
        let pairs = [seen.feet_m, seen.cop_predicted_m, seen.cop_measured_m, seen.turning_m, seen.slope];
        let vectors = [
            seen.com_m,
            seen.com_acceleration_m_per_s2,
            seen.force_predicted_n,
            seen.force_measured_n,
            self.com_velocity_m_per_s,
        ];
        let bodies = seen.origin_m.iter().chain(&seen.origin_acceleration_m_per_s2).chain(&self.joint_rad);
        let matrices = seen.rotation.iter().chain(&seen.rotation_acceleration_per_s2);
        let bent = self.joint_weighted_rotation_acceleration.iter().flatten();
        let is_finite =
            |change: &Change| change.cop_m.iter().chain(&change.force_n).all(|value| value.is_finite());
        single
            .iter()
            .chain(pairs.iter().chain(&self.turning_by_group_m).flatten())
            .chain(vectors.iter().chain(bodies).chain(matrices.chain(bent).flatten()).flatten())
            .all(|value| value.is_finite())
            && self.by_lag.iter().chain(&self.by_cutoff).all(is_finite)
    }
}
