//! The sequence of steps from a session to a finding.

use equipoise_core::effect;

use crate::answer::Left;
use crate::block::Phase;
use crate::candidate;
use crate::finding::Finding;
use crate::floor::{Floor, stances_m};
use crate::generic::{self, Generics};
use crate::gram::Gram;
use crate::holdout::held_out;
use crate::noise::Noise;
use crate::options::{Options, ReconcileError};
use crate::picture::Picture;
use crate::refine::tie_moments;
use crate::rows::Rows;
use crate::select::select;
use crate::session::Session;
use crate::trials::by_chance;
use crate::verdict::Rest;
use crate::windows::Windows;
use crate::{answer, drawing};

/// Minimum number of work blocks.
const WORK_MIN: usize = 30;
/// Minimum number of blocks outside the work for the noise fit.
const CLEAN_MIN: usize = 12;
/// The threshold is the level that chance does not exceed in this many of a hundred clean sessions.
const CHANCE_OF_100: f64 = 99.0;

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
    let mut gram = Gram::of(&rows, &noise, candidate::all(&rows));
    tie_moments(&mut gram);
    let threshold = options.least_log_odds.max(by_chance(&gram, options.draws, CHANCE_OF_100));
    progress(0.6);
    let windows = Windows::of(&gram);
    progress(0.7);
    let selection = select(&mut gram, &windows, threshold);
    progress(0.8);
    let generics: Generics = generic::look(&gram, &selection, threshold);
    let rest = Rest::of(&gram, &selection.terms());
    let stances_m = stances_m(&gram, &rest.after);
    let mut held = held_out(&gram, &selection.terms(), &stances_m)
        .ok_or(ReconcileError::NoNoise { channel: "plate" })?;
    progress(0.9);
    let floor = Floor::of(&gram, &stances_m);
    held.take_off_expected(&floor.mean);
    let answer = answer::assemble(&gram, &selection, &generics, Left { held: &held, rest, floor }, threshold);
    let picture = drawing::draw(&gram, &selection, &held, &answer, threshold);
    progress(1.0);
    Ok(Outcome { finding: answer.finding, terms: answer.terms, picture })
}

/// Rejects sessions that do not permit an inference.
fn check(session: &Session) -> Result<(), ReconcileError> {
    let in_work = session.blocks.iter().filter(|block| block.phase == Phase::Work).count();
    let clean = session.blocks.len() - in_work;
    if in_work < WORK_MIN {
        let [from_s, to_s] = session.spans_s.work;
        let block_s = session.block_s;
        return Err(ReconcileError::TooLittleWork {
            found: in_work,
            needed: WORK_MIN,
            block_s,
            from_s,
            to_s,
        });
    }
    if clean < CLEAN_MIN {
        return Err(ReconcileError::NothingToCompareWith { found: clean, needed: CLEAN_MIN });
    }
    let not_finite = session.blocks.iter().find(|block| !block.is_finite());
    not_finite.map_or(Ok(()), |block| Err(ReconcileError::NotANumber { time_s: block.observation.time_s }))
}

impl crate::block::Block {
    /// Whether all values used are finite.
    fn is_finite(&self) -> bool {
        let seen = &self.observation;
        let vectors =
            [seen.com_m, seen.com_acceleration_m_per_s2, seen.force_predicted_n, seen.force_measured_n];
        let pairs = [seen.cop_predicted_m, seen.cop_measured_m, seen.turning_m, seen.slope];
        vectors.iter().flatten().chain(pairs.iter().flatten()).all(|value| value.is_finite())
    }
}
