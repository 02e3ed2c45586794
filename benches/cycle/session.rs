//! A session in simulated time: poses held for identification, then loads held; every step timed.

use std::collections::VecDeque;
use std::hint::black_box;
use std::time::Instant;

use equipoise_benches::dense::{self, ChainMatrix, DenseFilter};
use equipoise_benches::worker::{HEIGHT_M, LOAD_N, MASS_KG, Worker};
use equipoise_core::body::{SEGMENTS, Sex};
use equipoise_core::cycle::{Inputs, Memory, Settings, StopRule, Tick, step};
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{GroundSample, Validity};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_core::pose_suggestion::posture;
use equipoise_core::sesc::{PARAMETERS, ReductionKind};
use equipoise_core::static_pose::WINDOW;
use nalgebra::Vector2;

const TICK_NS: u64 = 1_000_000;
const SUIT_PERIOD_NS: u64 = 16_666_667;
/// Delay from measurement to the loop.
const SUIT_DELAY_NS: u64 = 500_000;
/// A pose is held this long, steps.
const HOLD_STEPS: u64 = 2_000;
/// Gap in the suit's stream between two poses, ms: a jump from pose to pose within one millisecond would be rejected as
/// implausible.
const PAUSE_MS: u64 = 150;
const POSES_LEARNT: u64 = 25;
const POSES_LOADED: u64 = 15;
/// Variance of a pose's measurement for the dense filter, m².
const R_M2: f64 = 5e-5;

/// Work of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Ground samples only.
    Ground,
    /// A suit sample.
    Suit,
    /// A suit sample, and torques.
    Load,
    /// A suit sample, and a pose for the filter.
    Pose,
}

/// One step, timed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turn {
    /// Its work.
    pub(crate) kind: Kind,
    /// `core::cycle::step`, µs.
    pub(crate) ours_us: f64,
    /// The estimator's work alone, densely, µs; 0 if there is none.
    pub(crate) dense_us: f64,
}

/// Worker, cycle and dense estimator.
pub(crate) struct Session {
    worker: Worker,
    settings: Settings,
    memory: Box<Memory>,
    cycle: u64,
    next_suit_ns: u64,
    posed: Option<(u64, Pose<StationWorld>)>,
    dense: Option<Dense>,
}

impl Session {
    /// Before the first step; optionally with the dense version.
    pub(crate) fn new(with_dense: bool) -> Session {
        let settings = Settings {
            sex: Sex::Male,
            mass_kg: Some(MASS_KG),
            reduction: ReductionKind::Full,
            // Never met: identification continues as long as poses are unloaded.
            stop: StopRule::PredictedCop { sigma_m: 0.0 },
            library: LIBRARY,
            ..Settings::for_height(HEIGHT_M)
        };
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        let dense = with_dense.then(Dense::default);
        Session { worker: Worker::new(), settings, memory, cycle: 0, next_suit_ns: 0, posed: None, dense }
    }

    /// Whether all poses were held.
    pub(crate) fn is_over(&self) -> bool {
        self.cycle >= (POSES_LEARNT + POSES_LOADED) * HOLD_STEPS
    }

    /// Panics if the session did not do the work that the figures claim.
    pub(crate) fn check(&self) {
        let (learnt, state) = (self.memory.identification.poses_used, &self.memory.state);
        // Adjacent poses in the library may be too similar to count twice.
        assert!(learnt >= POSES_LEARNT / 2, "only {learnt} poses were learnt");
        let torques =
            !state.validity().any_of(Validity::INVALIDATES_TORQUES) && state.load_hand_distance_m > 0.0;
        assert!(torques, "no torques at the end: {:?}", state.validity());
    }

    /// The next millisecond.
    pub(crate) fn turn(&mut self) -> Turn {
        let (held, load_n) = match self.cycle / HOLD_STEPS {
            held if held < POSES_LEARNT => (held, 0.0),
            held => (held, LOAD_N),
        };
        self.cycle += 1;
        let due_ns = (1_000 + self.cycle + held * PAUSE_MS) * TICK_NS;
        let pose = match self.posed {
            Some((posed, pose)) if posed == held => pose,
            _ => self.worker.pose(held as usize),
        };
        self.posed = Some((held, pose));
        let suit = (due_ns >= self.next_suit_ns + SUIT_DELAY_NS).then(|| {
            self.next_suit_ns = self.next_suit_ns.max(due_ns - SUIT_DELAY_NS - TICK_NS) + SUIT_PERIOD_NS;
            self.worker.suit(&pose, due_ns - SUIT_DELAY_NS)
        });
        let ground: GroundSample = self.worker.ground(&pose, load_n, due_ns);
        let all_learnt = self.cycle == POSES_LEARNT * HOLD_STEPS;
        let command = all_learnt.then_some(CommandKind::IdentifyStop);
        let inputs =
            Inputs { suit: suit.as_slice(), ground: std::slice::from_ref(&ground), body: None, command };

        let before = (self.memory.state.suit_sample_time_ns, self.memory.identification.poses_used);
        let begun = Instant::now();
        black_box(step(&self.settings, &mut self.memory, Tick { cycle: self.cycle, due_ns }, inputs));
        let ours_us = begun.elapsed().as_secs_f64() * 1e6;

        let after = (self.memory.state.suit_sample_time_ns, self.memory.identification.poses_used);
        let kind = match (after.0 != before.0, after.1 != before.1) {
            (false, _) => Kind::Ground,
            (true, true) => Kind::Pose,
            (true, false) if load_n > 0.0 => Kind::Load,
            (true, false) => Kind::Suit,
        };
        let dense_us =
            self.dense.as_mut().map_or(0.0, |dense| dense.time(kind, &pose, &self.worker, &self.memory));
        Turn { kind, ours_us, dense_us }
    }
}

/// The estimator's work with dense matrices.
struct Dense {
    filter: Box<DenseFilter<PARAMETERS>>,
    window: VecDeque<ChainMatrix>,
}

impl Default for Dense {
    fn default() -> Self {
        Dense { filter: Box::new(DenseFilter::new(1e-3)), window: VecDeque::with_capacity(WINDOW + 1) }
    }
}

impl Dense {
    fn time(&mut self, kind: Kind, pose: &Pose<StationWorld>, worker: &Worker, memory: &Memory) -> f64 {
        if kind == Kind::Ground {
            return 0.0;
        }
        let phi = memory.identification.phi();
        let (loading, _) = worker.loading(pose);
        let begun = Instant::now();
        let chain = dense::chain_matrix(pose);
        black_box(dense::centre_of_mass(pose, &chain, &phi));
        black_box(self.spread(&chain));
        if self.window.len() == WINDOW {
            self.window.pop_front();
        }
        self.window.push_back(chain);
        match kind {
            Kind::Pose => self.learn(memory),
            Kind::Load => {
                black_box(dense::torques(pose, &loading));
            }
            Kind::Ground | Kind::Suit => {}
        }
        begun.elapsed().as_secs_f64() * 1e6
    }

    /// Trace of `B P Bᵀ` over x and y, m².
    fn spread(&self, chain: &ChainMatrix) -> f64 {
        let rows = chain.fixed_rows::<2>(0);
        (rows * self.filter.covariance_m2 * rows.transpose()).trace()
    }

    /// Mean rows, Joseph's update, predicted σ over the library.
    fn learn(&mut self, memory: &Memory) {
        let mean = self.window.iter().sum::<ChainMatrix>() / self.window.len() as f64;
        let h = mean.fixed_rows::<2>(0).into_owned();
        self.filter.update_joseph(&h, &Vector2::new(0.02, -0.01), R_M2);
        let skeleton = memory.identification.skeleton();
        let spread = LIBRARY.iter().map(|posture| {
            self.spread(&dense::chain_matrix(&posture::pose_of(posture, &skeleton, [0.0; 3])))
        });
        black_box(spread.sum::<f64>());
    }
}

const _: () = assert!(PARAMETERS == 3 * SEGMENTS, "Φ has three numbers a segment");
