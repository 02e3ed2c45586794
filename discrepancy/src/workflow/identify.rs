//! Identifies the subject from the identification span only.

use std::cell::Cell;

use anyhow::bail;
use equipoise_core::cycle::{Identification, Inputs, Memory, Settings, StopRule, Tick, step};
use equipoise_recording::replay::synthetic_ticks;

use crate::constants::{IDENTIFY_DELAY_S, TICK_NS};
use crate::spans::RecordingEvents;

use super::survey::Survey;
use super::{Progress, Reconcile};

/// A subject with a frozen model.
#[derive(Debug)]
pub struct Identified {
    /// Identification is disabled.
    pub worker: Box<Identification>,
    /// Number of held poses used.
    pub poses: u64,
    /// Number of motion samples used.
    pub motion_samples: u64,
    identified_s: Option<f64>,
    last_learnt_s: Option<f64>,
    stored: bool,
}

impl Identified {
    /// The phases of the recording.
    pub fn phases(&self, samples_s: [f64; 2]) -> RecordingEvents {
        RecordingEvents {
            samples_s,
            identified_s: self.identified_s,
            last_learnt_s: self.last_learnt_s,
            brings_worker: self.stored,
        }
    }
}

/// Identifies the subject.
///
/// # Errors
/// No pose could be used.
pub fn identify(
    reconcile: &Reconcile<'_>,
    survey: &Survey,
    progress: &mut dyn FnMut(Progress),
) -> anyhow::Result<Identified> {
    let stored = survey.recorded.first_memory().filter(|memory| memory.identification.identified == 1);
    if let (Some(memory), None) = (stored, reconcile.given.identify) {
        return Ok(Identified {
            worker: frozen(&memory.identification),
            poses: memory.identification.poses_used,
            motion_samples: u64::from(memory.state.motion_samples_used),
            identified_s: None,
            last_learnt_s: None,
            stored: true,
        });
    }
    let result = Pass::new(reconcile, survey).run(progress)?;
    if result.poses + result.motion_samples == 0 {
        let place = match reconcile.given.identify {
            Some(span) => format!("in the identification span {span}"),
            None => "in the recording".to_owned(),
        };
        bail!(
            "no static pose {place}, so the worker cannot be identified; record static poses first (equipoise \
             identify), or give their span with --identify; [static_pose] of the configuration sets the criterion"
        );
    }
    Ok(result)
}

fn frozen(worker: &Identification) -> Box<Identification> {
    let mut worker = Box::new(*worker);
    (worker.identifying, worker.identified) = (0, 1);
    worker
}

struct Pass<'a> {
    reconcile: &'a Reconcile<'a>,
    survey: &'a Survey,
    settings: Settings,
    /// Earliest start and latest end of the identification, s.
    span_s: [f64; 2],
    /// Time at which the current model is used if the identification has not ended by itself, s.
    until_s: f64,
}

/// Results so far.
#[derive(Default)]
struct PassResult {
    count: u64,
    last_learnt_s: Option<f64>,
    identified_s: Option<f64>,
    worker: Option<Box<Identification>>,
    poses: u64,
    motion_samples: u64,
}

impl<'a> Pass<'a> {
    fn new(reconcile: &'a Reconcile<'a>, survey: &'a Survey) -> Pass<'a> {
        let samples_s = survey.samples_s();
        let settings = Settings { start_identifying: true, ..reconcile.settings() };
        let given = &reconcile.given;
        match given.identify {
            Some(span) => {
                // Use the whole span, even if the stop criterion is met earlier.
                let stop = StopRule::PredictedCop { sigma_m: 0.0 };
                let settings = Settings { stop, poses_min: u64::MAX, ..settings };
                let span_s = [span.from_s, span.to_s];
                Pass { reconcile, survey, settings, span_s, until_s: span.to_s }
            }
            None => {
                let others = [given.reference, given.work].into_iter().flatten();
                let end_s = others.map(|span| span.from_s).fold(samples_s[1], f64::min);
                let until_s = given.learn_until_s(samples_s);
                Pass { reconcile, survey, settings, span_s: [samples_s[0], end_s], until_s }
            }
        }
    }

    fn run(&self, progress: &mut dyn FnMut(Progress)) -> anyhow::Result<Identified> {
        let recorded = &self.survey.recorded;
        let mut memory = recorded.initial_memory(&self.settings);
        let mut result = PassResult::default();
        let done = Cell::new(false);
        let end_s = self.span_s[1];
        let samples = self.reconcile.input.samples(self.reconcile.config)?;
        let samples = samples.take_while(|_| !done.get()).filter(|sample| {
            self.survey.covers(sample.time_ns()) && self.survey.seconds(sample.time_ns()) <= end_s
        });
        synthetic_ticks::run(samples, TICK_NS, &recorded.tares_ns, |tick: Tick, inputs: Inputs<'_>| {
            let now_s = self.survey.seconds(tick.due_ns);
            progress(Progress { doing: "identifying the worker", fraction: now_s / end_s.max(1e-9) });
            if memory.identification.identified == 0 {
                memory.identification.identifying = u64::from(now_s >= self.span_s[0] + IDENTIFY_DELAY_S);
            }
            step(&self.settings, &mut memory, tick, inputs);
            self.ingest(&memory, &mut result);
            done.set(result.identified_s.is_some());
            Ok(())
        })?;
        self.end(&memory, &mut result);
        let Some(worker) = result.worker.filter(|worker| worker.has_body()) else {
            bail!("the suit data are too short to determine the worker's segment lengths");
        };
        Ok(Identified {
            worker,
            poses: result.poses,
            motion_samples: result.motion_samples,
            identified_s: result.identified_s,
            last_learnt_s: result.last_learnt_s,
            stored: false,
        })
    }

    fn ingest(&self, memory: &Memory, result: &mut PassResult) {
        let worker = &memory.identification;
        let time_s = self.survey.seconds(memory.state.suit_sample_time_ns);
        let is_first_choice = time_s <= self.until_s || result.worker.is_none();
        let [poses, motion_samples] = [worker.poses_used, u64::from(memory.state.motion_samples_used)];
        if poses + motion_samples != result.count {
            result.count = poses + motion_samples;
            if is_first_choice {
                result.last_learnt_s = Some(time_s);
            }
        }
        if worker.identified == 1 {
            result.identified_s = Some(time_s);
        }
        let over = time_s >= self.until_s && result.worker.is_none();
        if over || worker.identified == 1 {
            self.store(memory, result);
        }
    }

    /// At the end of the samples.
    fn end(&self, memory: &Memory, result: &mut PassResult) {
        if result.worker.is_none() {
            self.store(memory, result);
        }
    }

    fn store(&self, memory: &Memory, result: &mut PassResult) {
        result.worker = Some(frozen(&memory.identification));
        result.poses = memory.identification.poses_used;
        result.motion_samples = u64::from(memory.state.motion_samples_used);
    }
}
