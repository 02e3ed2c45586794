//! All numbers that tune a decision, a prior or a threshold of this crate, each with its unit and origin.
//!
//! A number is declared here and nowhere else (`tests/constants.rs`); exceptions are array sizes and the geometry of
//! drawings. Log odds are natural logarithms. Priors of the effects themselves belong to [`equipoise_core::effect`].
//! Origins:
//! - *derived*: follows from the stated quantities; *reference*: the named source;
//! - *prototype*: from the numeric prototype of this workflow (Monte Carlo of a 15-segment body; not in this repository);
//! - *bench*: chosen, and held only as part of the whole by `equipoise-study hidden bench` (docs/discrepancy.md,
//!   "Accuracy") and `.ci/blind-bench`: no run of this value by itself is recorded;
//! - *budget*: chosen, bounds time or memory (docs/discrepancy.md, "Speed and memory"); *display*: chosen, affects only
//!   what a report shows; *chosen*: none of these.

use std::f64::consts::PI;
use std::time::Duration;

use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::effect::Effect;

/// Columns of a block of a Cholesky factor. Unit: 1. Origin: budget.
pub(crate) const FACTOR_COLUMNS: usize = 64;

// Recordings.

/// Period of the loop in the workflow: every suit sample is evaluated. Unit: ns. Origin: chosen.
pub(crate) const TICK_NS: u64 = 4_000_000;
/// Identification starts this late, when earlier samples have left the loop's window. Unit: s. Origin: chosen.
pub(crate) const IDENTIFY_DELAY_S: f64 = 0.15;
/// Samples of a stream, at least. Unit: 1. Origin: chosen.
pub(crate) const SAMPLES_MIN: u64 = 60;
/// Deviation from the expected body weight, at most; beyond, the subjects differ. Unit: 1. Origin: chosen.
pub(crate) const WEIGHT_DEVIATION_MAX: f64 = 0.15;
/// With more vertical force a person stands on the plate. Unit: N. Origin: chosen.
pub(crate) const STANDING_N: f64 = 200.0;

// Snapshots to blocks.

/// Length of a block. Unit: s. Origin: prototype (0.2 to 0.4 s).
pub(crate) const BLOCK_S: f64 = 0.2;
/// Half the window of the local parabola. Unit: s. Origin: bench.
pub(crate) const HALF_WINDOW_S: f64 = 0.1;
/// Nothing is compared within this time of a foot's lift-off or contact. Unit: s. Origin: bench.
pub(crate) const STANCE_MARGIN_S: f64 = 0.4;
/// Farther outside its outline, a foot alone does not support the load. Unit: m. Origin: that of the loop.
pub(crate) const SUPPORT_MARGIN_M: f64 = 0.02;
/// Snapshots farther apart are a gap. Unit: s. Origin: bench.
pub(crate) const SNAPSHOT_GAP_S: f64 = 0.12;
/// Snapshots are kept for a block, half a window on each side of it, and this time. Unit: s. Origin: derived, above the
/// longest gap.
pub(crate) const SNAPSHOT_RESERVE_S: f64 = 0.3;
/// Stored blocks of a recording; a longer one is decimated. Unit: 1. Origin: budget.
pub(crate) const BLOCKS_MAX: usize = 6000;
/// Masked intervals are kept for this time. Unit: s. Origin: derived, above the waiting time of a block.
pub(crate) const MASK_KEPT_S: f64 = 3.0;
/// Predictions are kept for this time. Unit: s. Origin: derived, above block, window, gap and largest lag together.
pub(crate) const POINTS_KEPT_S: f64 = 1.5;
/// No interpolation between predictions farther apart. Unit: s. Origin: bench.
pub(crate) const INTERPOLATION_GAP_S: f64 = 0.25;
/// Step from a time to both sides for a rate. Unit: s. Origin: derived, below the interval of suit samples.
pub(crate) const RATE_STEP_S: f64 = 0.01;
/// Snapshots on each side of a parabola, at least. Unit: 1. Origin: bench (a parabola needs three points).
pub(crate) const WINDOW_SIDE_MIN: usize = 2;
/// Each side covers this fraction of half the window; else values belong to another time. Unit: 1. Origin: bench.
pub(crate) const WINDOW_REACH: f64 = 0.6;
/// Tolerance of sample times at a window's edge. Unit: s. Origin: derived, above the rounding of times.
pub(crate) const TIME_TOLERANCE_S: f64 = 1e-6;
/// The points of a complete block cover this fraction of it. Unit: 1. Origin: bench.
pub(crate) const BLOCK_REACH: f64 = 0.5;
/// With less vertical acceleration the body jumps. Unit: m/s². Origin: bench (a fifth of the weight).
pub(crate) const SPECIFIC_FORCE_MIN_M_PER_S2: f64 = 0.2 * GRAVITY_M_PER_S2;
/// Larger accelerations are impacts, which a parabola cannot represent. Unit: m/s². Origin: bench.
pub(crate) const ACCELERATION_MAX_M_PER_S2: f64 = 6.0;
/// A larger shift of the CoP by rotation is a jump of sample times: the body would fall. Unit: m. Origin: bench.
pub(crate) const TURNING_MAX_M: f64 = 0.3;
/// Model error of each parameter of the chain: gliding joints, a bending spine; 1-σ. Unit: m. Origin: bench.
pub(crate) const CHAIN_ERROR_M: f64 = 0.002;
/// Lags whose change each block stores; negative: the suit is early. Unit: s. Origin: prototype.
pub const LAGS_S: [f64; 13] =
    [-0.12, -0.08, -0.05, -0.03, -0.02, -0.01, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18];
/// Cutoffs of a first-order filter whose change each block stores. Unit: Hz. Origin: prototype; 7 Hz added.
pub const CUTOFFS_HZ: [f64; 8] = [0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5, 7.0];

// Phases of a recording, and the blocks that are used.

/// Shorter phases, and shorter parts of the work, are not analysed. Unit: s. Origin: prototype.
pub(crate) const INTERVAL_MIN_S: f64 = 2.0;
/// Length of the work, at least. Unit: s. Origin: bench.
pub(crate) const WORK_MIN_S: f64 = 10.0;
/// A given span may end this much after the samples. Unit: s. Origin: chosen.
pub(crate) const SPAN_EXCESS_S: f64 = 1.0;
/// Fraction of the recording taken as identification, at most, if identification did not end. Unit: 1. Origin: bench.
pub(crate) const IDENTIFY_FRACTION_MAX: f64 = 0.4;
/// If the recording continues for this time after identification … Unit: s. Origin: bench.
pub(crate) const LONG_S: f64 = 900.0;
/// … its first part counts as clean work. Unit: s. Origin: bench (the prototype's sessions had 150 s).
pub(crate) const DEFAULT_REFERENCE_S: f64 = 180.0;
/// Identification, reference and work blocks that are used, at most. Unit: 1. Origin: budget.
pub(crate) const BLOCKS_USED_MAX: [usize; 3] = [140, 300, 450];
/// Work blocks, at least. Unit: 1. Origin: bench.
pub(crate) const WORK_BLOCKS_MIN: usize = 30;
/// Blocks outside the work, at least, for the fit of the noise. Unit: 1. Origin: bench.
pub(crate) const CLEAN_BLOCKS_MIN: usize = 12;
/// Onset and end of an effect take up to this time. Unit: s. Origin: bench.
pub(crate) const ONSET_S: f64 = 1.2;
/// Blocks of a static pose that are used. Unit: 1. Origin: bench: further ones share their noise.
pub(crate) const BLOCKS_PER_POSE: usize = 2;
/// Two blocks have the same pose below this root sum of squares of joint rotations. Unit: rad. Origin: bench (tremor).
pub(crate) const SAME_POSE_RAD: f64 = 0.12;

// Noise of the centre of pressure (docs/discrepancy.md, "The residual and its noise").

/// Prior medians: orientation random walk over 60 s, 12 s, 2.5 s, soft tissue, white, motion, pose, heading random
/// walk. Unit: rad, rad, rad, rad/rad, m, s, m, rad. Origin: prototype; the first two and the last: bench.
pub(crate) const COP_SIZES: [f64; 8] = [0.0061, 0.0044, 0.00105, 0.03, 0.0004, 0.003, 0.0015, 0.0157];
/// 1-σ of their logarithms. Unit: 1. Origin: prototype; the first and the last: bench.
pub(crate) const COP_SIZES_SIGMA: [f64; 8] = [0.3, 0.4, 0.8, 0.4, 0.6, 0.9, 0.5, 0.35];
/// Bounds of a fitted size below and above its prior median. Unit: prior 1-σ. Origin: bench.
pub(crate) const COP_SIZE_BOUNDS: [f64; 2] = [3.0, 4.0];
/// Factor on the priors' 1-σ without clean work: poses carry little about motion and slow drift. Unit: 1. Origin: bench.
pub(crate) const SIGMA_WITHOUT_REFERENCE: f64 = 0.5;
/// Error of the rotational inertia of each group of segments, and of all inertia while the noise is fitted; 1-σ. Unit:
/// 1. Origin: prototype.
pub(crate) const INERTIA_ERROR: f64 = 0.2;
/// Correlation times of the orientation random walk. Unit: s. Origin: prototype.
pub(crate) const ORIENTATION_S: [f64; 3] = [60.0, 12.0, 2.5];
/// Correlation time of the heading random walk, which gravity does not bound, and of the orientations that act on
/// forces. Unit: s. Origin: prototype (forces); bench.
pub(crate) const HEADING_S: f64 = 40.0;
/// Constant misalignment of a sensor; identification absorbs that of trunk and arms; 1-σ. Unit: rad. Origin: bench.
pub(crate) const MISALIGNMENT_RAD: f64 = 0.015;
/// Heading of the whole suit: 1-σ and correlation time. Unit: rad, s. Origin: bench.
pub(crate) const SUIT_HEADING: (f64, f64) = (0.006, 60.0);
/// Offset of the first stance and increment with each change of stance, 1-σ: of a suit that drifts, of one that does
/// not. Unit: m. Origin: prototype (5 mm); increment: recordings of the simulated suit (a centimetre per foot).
pub(crate) const STANCE_M: [[f64; 2]; 2] = [[0.005, 0.015], [0.002, 0.0]];
/// Error of the height at which the reaction's slope acts; 1-σ. Unit: m. Origin: bench: smoothing and tabulated
/// inertias contribute centimetres.
pub(crate) const SLOPE_HEIGHT_M: f64 = 0.08;
/// Model error that the clean phases do not share: function of the pose, offset with the body, offset in the room; 1-σ.
/// Unit: m. Origin: prototype (a minimum by design, never fitted); second: bench (3 mm there).
pub(crate) const UNSHARED_M: [f64; 3] = [0.002, 0.002, 0.0015];
/// Correlation time of the first two; without steps, since a step is an effect. Unit: s. Origin: bench.
pub(crate) const UNSHARED_S: f64 = 30.0;
/// Correlation time of the third. Unit: s. Origin: prototype.
pub(crate) const ROOM_S: f64 = 60.0;
/// Slow noise of the plate: 1-σ and correlation time. Unit: m, s. Origin: prototype.
pub(crate) const PLATE_NOISE: (f64, f64) = (0.0005, 3.0);
/// White noise, at least; 1-σ. Unit: m. Origin: prototype.
pub(crate) const WHITE_MIN_M: f64 = 2e-4;
/// Soft tissue of pelvis and feet, and of legs, relative to an arm's. Unit: 1. Origin: bench.
pub(crate) const SOFT_TISSUE: [f64; 2] = [0.4, 0.7];
/// Correlation time of errors in motion. Unit: s. Origin: prototype.
pub(crate) const MOTION_S: f64 = 0.35;
/// Weight of the acceleration next to the velocity in errors in motion. Unit: s. Origin: prototype.
pub(crate) const MOTION_PER_ACCELERATION_S: f64 = 0.15;
/// Covariance of the unknown function of the pose: constant fraction; fraction and twice the squared length of each of
/// two squared-exponential parts. Unit: 1; 1, rad². Origin: prototype (lengths 2.5 and 1 rad).
pub(crate) const POSE_KERNEL: (f64, [(f64, f64); 2]) = (0.2, [(0.4, 12.5), (0.4, 2.0)]);
/// Blocks of poses and of clean work in a fit, at most. Unit: 1. Origin: budget.
pub(crate) const FIT_BLOCKS_MAX: [usize; 2] = [70, 150];
/// Steps of the quasi-Newton search, and attempts at each, at most. Unit: 1. Origin: budget (prototype: 14 steps).
pub(crate) const MINIMISER_STEPS: (usize, usize) = (16, 6);
/// The search ends once a step gains less. Unit: log likelihood. Origin: budget.
pub(crate) const MINIMISER_GAIN_MIN: f64 = 0.01;
/// Change of a logarithm in one step, at most, and the factor on a step that gains nothing. Unit: 1. Origin: budget.
pub(crate) const MINIMISER_STEP: (f64, f64) = (1.5, 0.4);
/// Curvature of the log likelihood by the data, for the first step. Unit: 1. Origin: budget.
pub(crate) const INITIAL_CURVATURE: f64 = 10.0;

// Noise of the forces; shear, then vertical.

/// Prior medians: slow noise of the plate, white, fraction of the acceleration, fast fraction of it, orientations.
/// Unit: N, N, 1, 1, 1. Origin: prototype.
pub(crate) const FORCE_SIZES: [[f64; 5]; 2] = [[1.0, 0.5, 0.08, 0.05, 1.0], [1.0, 0.5, 0.05, 0.05, 1.0]];
/// 1-σ of their logarithms. Unit: 1. Origin: prototype.
pub(crate) const FORCE_SIZES_SIGMA: [f64; 5] = [0.8, 0.8, 0.7, 0.7, 0.25];
/// Lower bounds: without them the posterior is overconfident in the newton range. Unit: as the medians. Origin:
/// prototype; the first two: bench.
pub(crate) const FORCE_SIZES_MIN: [[f64; 5]; 2] = [[0.3, 0.2, 0.06, 0.05, 0.7], [0.3, 0.2, 0.03, 0.03, 0.7]];
/// Upper bound of the orientations. Unit: 1. Origin: prototype.
pub(crate) const FORCE_ORIENTATION_MAX: f64 = 2.5;
/// Upper bound of the others, above the logarithm of the prior median. Unit: 1. Origin: bench.
pub(crate) const FORCE_SIZE_EXCESS: f64 = 3.0;
/// Error of the channel's zero and of the weight; 1-σ. Unit: N. Origin: prototype.
pub(crate) const FORCE_ZERO_N: f64 = 1.5;
/// Correlation time of the plate's slow noise. Unit: s. Origin: prototype.
pub(crate) const FORCE_SLOW_S: f64 = 20.0;
/// Constant fraction of the acceleration's error, and correlation time of the rest. Unit: 1, s. Origin: prototype.
pub(crate) const FORCE_GAIN_KERNEL: (f64, f64) = (0.5, 10.0);
/// Orientation random walk and soft tissue. Unit: rad, rad/rad. Origin: prototype (0.7°).
pub(crate) const FORCE_ORIENTATION: (f64, f64) = (0.0122, 0.035);
/// Random walk of the heading over that of the inclination. Unit: 1. Origin: prototype.
pub(crate) const FORCE_HEADING_FACTOR: f64 = 1.5;
/// Variance of the orientations: constant, Matérn, and exponential part with its time. Unit: 1, 1, 1, s. Origin:
/// prototype; constant part (misalignment): bench.
pub(crate) const FORCE_ORIENTATION_KERNEL: (f64, f64, f64, f64) = (0.8, 0.8, 0.2, 3.0);

// Candidates: grids and mixtures.

/// Time constants of a drift; 0 is linear. Unit: s. Origin: prototype.
pub(crate) const DRIFTS_S: [f64; 4] = [0.0, 20.0, 40.0, 90.0];
/// Frequencies of breathing and sway. Unit: Hz. Origin: bench (five of them in the prototype).
pub(crate) const SWAYS_HZ: [f64; 7] = [0.17, 0.2, 0.23, 0.26, 0.29, 0.32, 0.36];
/// Mixture for the heading of a segment: mean, 1-σ, weight; approximates the effect's own prior with heavier tails.
/// Unit: rad, rad, 1. Origin: bench.
pub(crate) const HEADINGS: [(f64, f64, f64); 7] = [
    (0.0, 0.12, 0.5),
    (-0.3, 0.12, 0.13),
    (0.3, 0.12, 0.13),
    (-0.6, 0.12, 0.08),
    (0.6, 0.12, 0.08),
    (-1.1, 0.25, 0.04),
    (1.1, 0.25, 0.04),
];
/// Prior of the factor on a lag or filter of the grid, and of a fitted one; 1-σ. Unit: 1. Origin: prototype.
pub(crate) const SHAPE_FACTOR_SIGMA: [f64; 2] = [0.3, 0.02];
/// Log prior of a mass worn on thigh or forearm, and elsewhere but on back and belt. Unit: log odds. Origin: bench.
pub(crate) const WORN_PLACE_LOG_PRIOR: [f64; 2] = [-1.0, -3.0];
/// Lags tried in parts of the work. Unit: s. Origin: derived: each covers its neighbours in [`LAGS_S`] by its factor.
pub(crate) const PART_LAGS_S: [f64; 4] = [-0.03, -0.01, 0.01, 0.03];
/// Cutoffs tried in parts of the work. Unit: Hz. Origin: derived, as the lags, from [`CUTOFFS_HZ`].
pub(crate) const PART_CUTOFFS_HZ: [f64; 3] = [1.0, 2.0, 4.5];
/// Smallest mass that determines the prior of its first moment. Unit: kg. Origin: prototype.
pub(crate) const MOMENT_MASS_MIN_KG: f64 = 0.02;

// Refinement of shapes and edges.

/// Steps of the golden section. Unit: 1. Origin: budget (a thousandth of the range).
pub(crate) const GOLDEN_STEPS: usize = 14;
/// Linearisations of a rotation about the fitted angle. Unit: 1. Origin: budget.
pub(crate) const ROTATION_STEPS: usize = 4;
/// Range of a refined lag about the fitted one. Unit: s. Origin: prototype.
pub(crate) const LAG_RANGE_S: f64 = 0.03;
/// Smallest refined lag; one of the other sign is another explanation. Unit: s. Origin: prototype.
pub(crate) const LAG_MIN_S: f64 = 5e-4;
/// Range of a refined cutoff about its grid point, as a factor. Unit: 1. Origin: prototype.
pub(crate) const CUTOFF_RANGE: f64 = 1.6;
/// Range of a refined time constant. Unit: s. Origin: prototype.
pub(crate) const DRIFT_RANGE_S: [f64; 2] = [8.0, 150.0];
/// Range of a refined frequency about its grid point. Unit: Hz. Origin: prototype.
pub(crate) const SWAY_RANGE_HZ: f64 = 0.025;
/// Width of a refined effect's prior over that of the catalogue, and its probability. Unit: 1, 1. Origin: chosen: each
/// doubling of the size is half as probable.
pub(crate) const SIZE_TAIL: [(f64, f64); 3] = [(1.0, 4.0 / 7.0), (2.0, 2.0 / 7.0), (4.0, 1.0 / 7.0)];
/// Widest prior of a rotation, 1-σ. Unit: rad. Origin: derived: twice this is a right angle.
pub(crate) const ROTATION_SIGMA_MAX_RAD: f64 = PI / 4.0;
/// Step of the curvature for a shape's 1-σ: of a lag or frequency, and fraction of others. Unit: s or Hz, 1. Origin: bench.
pub(crate) const CURVATURE_STEP: (f64, f64) = (0.002, 0.05);
/// Edges are refined down to this step. Unit: s. Origin: bench (0.4 s in the prototype).
pub(crate) const EDGE_STEP_MIN_S: f64 = 0.3;
/// Smallest factor by which a fitted cutoff is divided. Unit: 1. Origin: derived, far below [`FILTER_FACTOR_MIN`].
pub(crate) const CUTOFF_FACTOR_MIN: f64 = 0.05;

// Parts of the work.

/// Pieces of the even grid of edges. Unit: 1. Origin: bench (30 in the prototype).
pub(crate) const EDGE_PIECES: usize = 24;
/// Additional edges at steps of the residual, at most. Unit: 1. Origin: budget.
pub(crate) const STEPS_MAX: usize = 8;
/// Blocks on each side of a step whose median counts, and ignored ones next to it, since an onset takes time. Unit: 1.
/// Origin: bench.
pub(crate) const STEP_BLOCKS: (usize, usize) = (6, 2);
/// Smallest step: CoP forward and left, vertical force. Unit: m, m, N. Origin: bench (the CoP's: smallest offset of
/// interest).
pub(crate) const STEP_MIN: [f64; 3] = [0.004, 0.004, 3.0];
/// A step replaces edges of the grid within this fraction of a piece. Unit: 1. Origin: bench.
pub(crate) const STEP_REPLACES: f64 = 0.3;
/// Shortest part of a lag or filter, which do not change for an instant. Unit: s. Origin: bench.
pub(crate) const TIMING_PART_MIN_S: f64 = 20.0;
/// Fraction of its evidence that a part pays: with two free edges, a wrong explanation fits a large effect well. Unit:
/// 1. Origin: bench.
pub(crate) const PART_MODEL_ERROR: f64 = 0.12;
/// The same where the effect is certain. Unit: 1. Origin: bench.
pub(crate) const PART_MODEL_ERROR_OF_SAME: f64 = 0.02;

// Explanations.

/// Probability that each of these effects acts in a session in question, before its data are seen. Unit: 1. Origin:
/// judgement, to be changed where the causes at a station are known.
pub(crate) const EFFECT_PRIOR: [(f64, &[Effect]); 4] = [
    (0.15, &[Effect::HandLoad, Effect::WornMass]),
    (0.1, &[Effect::PlateOffset]),
    (0.05, &[Effect::HandContact, Effect::PlateYaw, Effect::PlateDrift, Effect::SuitLag]),
    (0.05, &[Effect::SuitHeadingDrift, Effect::SegmentHeading, Effect::SegmentMisalignment]),
];
/// The same of any other effect. Unit: 1. Origin: judgement.
pub(crate) const OTHER_PRIOR: f64 = 0.03;
/// The same of anything outside the catalogue. Unit: 1. Origin: judgement.
pub(crate) const OUTSIDE_PRIOR: f64 = 0.1;
/// From this probability on the residual is called unexplained. Unit: 1. Origin: more probable than not.
pub(crate) const UNEXPLAINED_PROBABILITY: f64 = 0.5;
/// Factor on the prior of a plate's axes, height, gains or filter, or a clock, in a part of the work. Unit: 1. Origin:
/// judgement.
pub(crate) const CHANGE_PRIOR: f64 = 0.02;
/// Factors on [`MODEL_ERROR`] over which the evidence is averaged. Unit: 1. Origin: chosen: one and a half decades.
pub(crate) const MISFIT_SCALES: [f64; 4] = [0.3, 1.0, 3.0, 10.0];
/// Divisor of the log likelihood of an experiment's response. Unit: 1. Origin: that of one effect, `explanation.rs`.
pub(crate) const EVIDENCE_TEMPER: f64 = 2.0;
/// A name is established from this probability on. Unit: 1. Origin: convention.
pub(crate) const NAMED_PROBABILITY: f64 = 0.95;
/// Names below this probability are no rivals. Unit: 1. Origin: derived: the complement of [`NAMED_PROBABILITY`].
pub(crate) const RIVAL_PROBABILITY_MIN: f64 = 1.0 - NAMED_PROBABILITY;
/// Explanations extended at each size, and their largest deficit to the best. Unit: 1, log posterior. Origin: budget.
pub(crate) const BEAM: (usize, f64) = (3, 7.0);
/// Effects of an explanation, negligible ones included, at most. Unit: 1. Origin: budget.
pub(crate) const MEMBERS_MAX: usize = 6;

// Selection.

/// Log odds of a generic term, at least. Unit: log odds. Origin: bench (clean sessions; 8 in the prototype).
pub(crate) const LOG_ODDS_MIN: f64 = 10.0;
/// Clean sessions that are drawn for the level reached by chance. Unit: 1. Origin: budget (200 in the prototype).
pub(crate) const DRAWS: usize = 100;
/// Quantile of the level reached by chance. Unit: 1. Origin: prototype.
pub(crate) const CHANCE_QUANTILE: f64 = 0.99;
/// Seeds of draws: catalogue, library, experiments; fixed, for equal findings. Unit: 1. Origin: arbitrary.
pub(crate) const SEEDS: [u64; 3] = [0x5eed, 0x0dd5, 0xa5c5];
/// A clear lead, as of a part over the whole. Unit: log odds. Origin: prototype; reference: "strong" in Kass and Raftery,
/// J. Am. Stat. Assoc. 90 (1995), 773–795.
pub(crate) const CLEAR_LEAD: f64 = 3.0;
/// Best hypotheses that are checked in each step. Unit: 1. Origin: prototype.
pub(crate) const CHECKED_MAX: usize = 8;
/// Deviation of a contact, and of any other effect, from its equation: 1-σ as a fraction, in this many pieces of the
/// work. Unit: 1. Origin: prototype; numbers of pieces: bench.
pub(crate) const MODEL_ERROR: [(f64, u32); 2] = [(0.25, 40), (0.03, 12)];
/// The same at onset and end. Unit: 1. Origin: derived: the whole effect is uncertain there.
pub(crate) const MODEL_ERROR_AT_EDGES: f64 = 1.0;

// Plausibility.

/// Largest arm of a mass over its prior 1-σ. Unit: 1. Origin: bench.
pub(crate) const ARMS_MAX: f64 = 2.5;
/// Smallest factor of a filter. Unit: 1. Origin: prototype.
pub(crate) const FILTER_FACTOR_MIN: f64 = 0.3;
/// Smaller rotations of pelvis and legs are soft tissue, whose errors add up where the feet hold the body. Unit: rad.
/// Origin: bench.
pub(crate) const LEG_ROTATION_MIN_RAD: f64 = 8.0 * PI / 180.0;

// Generic terms.

/// Reported generic terms, at most. Unit: 1. Origin: display.
pub(crate) const GENERIC_MAX: usize = 3;
/// Gain of a generic term beyond chance: shapes from the suit's motion are not exact. Unit: log odds. Origin: bench.
pub(crate) const GENERIC_BEYOND_CHANCE: f64 = 2.0;
/// Force at a segment, alone or of a spring; 1-σ. Unit: N. Origin: prototype.
pub(crate) const GENERIC_FORCE_N: f64 = 30.0;
/// Stiffness of a spring at a segment; 1-σ. Unit: N/m. Origin: bench (40 in the prototype).
pub(crate) const GENERIC_STIFFNESS_N_PER_M: f64 = 60.0;
/// Displacement of a shoulder per right angle, and of the spine per radian; 1-σ. Unit: m. Origin: bench.
pub(crate) const JOINT_GLIDE_M: [f64; 2] = [0.002, 0.015];
/// Slip of a sensor per radian of its joint, fraction by which it follows the joint less, heading per minute; 1-σ.
/// Unit: 1, 1, rad/min. Origin: bench; heading: prototype.
pub(crate) const SLIP: [f64; 3] = [0.15, 0.2, 0.1];
/// Heading error in a region; 1-σ. Unit: rad. Origin: prototype.
pub(crate) const REGION_HEADING_RAD: f64 = 0.4;
/// Reach of a region: for arms, which move anywhere, and for other segments. Unit: m. Origin: prototype (0.25 m);
/// others: bench.
pub(crate) const REGION_REACH_M: [&[f64]; 2] = [&[0.15, 0.25, 0.4], &[0.25]];
/// Centres of regions, in the same order; iterations of their search. Unit: 1. Origin: budget (6 in the prototype).
pub(crate) const REGION_CENTRES: ([usize; 2], usize) = ([8, 5], 4);
/// Length over which a field changes by its own magnitude. Unit: m. Origin: bench.
pub(crate) const FIELD_M: f64 = 0.3;
/// Hysteresis, speed, linear map and quadratic map of the CoP; 1-σ. Unit: m, s, 1, 1/m. Origin: prototype; hysteresis:
/// bench.
pub(crate) const COP_MAP: [f64; 4] = [0.01, 0.02, 0.05, 0.5];
/// Vertical force by place: constant, per metre forward and left; 1-σ. Unit: 1, 1/m, 1/m. Origin: prototype.
pub(crate) const FORCE_MAP: [f64; 3] = [0.01, 0.1, 0.1];
/// Recent direction of the CoP: blocks, weight of each over the next, displacement that saturates. Unit: 1, 1, m.
/// Origin: bench.
pub(crate) const HYSTERESIS: (usize, f64, f64) = (12, 0.75, 0.01);

// Verdict, gap and location.

/// Pieces of the work that are compared with noise. Unit: 1. Origin: prototype.
pub(crate) const PIECES: usize = 18;
/// Blocks of a piece, at least. Unit: 1. Origin: prototype (10 rows).
pub(crate) const PIECE_BLOCKS_MIN: usize = 5;
/// Clean sessions stay below: mean square over the clean work's of CoP and force, correlation of neighbours, worst
/// piece. Unit: 1, 1, σ. Origin: bench.
pub(crate) const CLEAN_BOUNDS: ([f64; 2], f64, f64) = ([2.0, 3.0], 0.35, 14.0);
/// Folds of the cross-validation. Unit: 1. Origin: prototype.
pub(crate) const FOLDS: usize = 5;
/// Intervals of a fold: neighbouring blocks share their noise. Unit: 1. Origin: bench.
pub(crate) const INTERVALS_PER_FOLD: usize = 6;
/// Error of an effect's equation, 1-σ as a fraction of its parameters: inertia and filter, any other. Unit: 1. Origin:
/// bench (simulated sessions of known truth).
pub(crate) const PARAMETER_ERROR: [f64; 2] = [0.1, 0.05];
/// An effect that ends this near the end lasts to it. Unit: blocks. Origin: derived: the resolution of edges.
pub(crate) const OPEN_END_BLOCKS: f64 = 2.0;
/// Pieces of the work that are searched for suspicious spans, and blocks of each, at least. Unit: 1. Origin: bench.
pub(crate) const SPAN_PIECES: (usize, usize) = (30, 3);
/// Root mean square over noise of a suspicious piece, whose coloured noise holds few independent values. Unit: 1.
/// Origin: bench.
pub(crate) const SUSPICIOUS: f64 = 2.0;
/// Reported spans, at most. Unit: 1. Origin: display.
pub(crate) const SPANS_MAX: usize = 8;
/// A span belongs to static poses or motion if one exceeds the other by this factor. Unit: 1. Origin: display.
pub(crate) const STATIC_OR_MOVING: f64 = 1.7;
/// A segment goes with a span if it explains this fraction of more than this many blocks. Unit: 1. Origin: display.
pub(crate) const GOES_WITH: (f64, usize) = (0.25, 8);

// Next measurement.

/// Responses that are drawn for each explanation and experiment. Unit: 1. Origin: budget.
pub(crate) const RESPONSES: usize = 32;
/// Turns that may be requested. Unit: °, to the left. Origin: prototype.
pub(crate) const TURNS_DEG: [f64; 3] = [0.0, 90.0, 180.0];
/// Step forward and to the left that may be requested. Unit: m. Origin: chosen.
pub(crate) const STEP_M: f64 = 0.15;
/// Standing that may be requested. Unit: s. Origin: chosen.
pub(crate) const STANDING_S: f64 = 180.0;
/// From the end of the recording to a measurement of the experiment. Unit: s. Origin: chosen.
pub(crate) const UNTIL_EXPERIMENT_S: f64 = 10.0;
/// Smaller expected information does not justify an experiment. Unit: nats. Origin: chosen.
pub(crate) const INFORMATION_MIN: f64 = 0.05;

// Report and model file.

/// Lags of the autocorrelation, computed and drawn. Unit: blocks. Origin: display.
pub(crate) const AUTOCORRELATION_LAGS: usize = 20;
/// Edges of the bins of squared innovations. Unit: σ². Origin: display.
pub(crate) const INNOVATION_BINS: [f64; 7] = [0.0, 0.5, 1.0, 2.0, 4.0, 9.0, f64::INFINITY];
/// Reported windows; pose features per signal; candidates of the evidence plot, at most. Unit: 1. Origin: display.
pub(crate) const SHOWN_MAX: [usize; 3] = [6, 2, 12];
/// White noise leaves 5 of 100 lags out of its bounds; up to twice that counts as white. Unit: 1. Origin: derived.
pub(crate) const WHITE_OUTSIDE_MAX: f64 = 0.10;
/// Remaining gap that counts as noise, and as little more. Unit: noise. Origin: bench's target (1.1); display.
pub(crate) const GAP_IN_WORDS: [f64; 2] = [1.1, 1.5];
/// Intervals of static poses in a drawing, at most, and the longest pause that joins them. Unit: 1, s. Origin: display.
pub(crate) const DRAWN_POSES: (usize, f64) = (300, 5.0);
/// Parts of the trend of a scatter plot, and points of each, at least. Unit: 1. Origin: display.
pub(crate) const TREND: (usize, f64) = (12, 3.0);

// Session report.

/// Length of a column of the strips. Unit: s. Origin: display.
pub(crate) const COLUMN_S: f64 = 1.0;
/// Length of an interval of a series. Unit: s. Origin: display.
pub(crate) const SERIES_INTERVAL_S: f64 = 0.25;
/// Longer times are displayed in minutes. Unit: s. Origin: display.
pub(crate) const MINUTES_FROM_S: f64 = 300.0;
/// Valid torques for a headline or a recommendation, at least. Unit: s. Origin: chosen.
pub(crate) const STATEMENT_TIME_MIN_S: f64 = 5.0;
/// States that wait for the records of their cycles, which a recorder writes later. Unit: 1. Origin: chosen.
pub(crate) const REORDER_BUFFER: usize = 512;
/// Interval of the displayed positions of the body. Unit: s. Origin: display.
pub(crate) const BODY_INTERVAL_S: f64 = 0.2;
/// Displayed positions of the body, at most; beyond it the interval doubles. Unit: 1. Origin: budget: 0.3 MB of the page.
pub(crate) const BODY_POSITIONS_MAX: usize = 240;
/// Time limit of printing; the report of a shift takes seconds. Unit: s. Origin: chosen.
pub(crate) const PRINT_TIMEOUT: Duration = Duration::from_secs(120);
