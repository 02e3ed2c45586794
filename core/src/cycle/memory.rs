//! All mutable state of a cycle as plain old data: a checkpoint is a copy of it.

use bytemuck::{Pod, Zeroable};

use super::alignment::Alignment;
use super::body_motion::MotionNoise;
use super::identification::{Identification, StanceSigma};
use super::insoles::GroundSigma;
use super::lag_test::LagTest;
use super::model_terms::ModelTerms;
use super::plausibility::Plausibility;
use super::pose_request::PoseRequestState;
use super::registration::RegistrationEstimator;
use super::reported_body::ReportedBody;
use super::settings::Settings;
use super::skew_monitor::SkewMonitor;
use super::tare::Tare;
use crate::anchor::Anchor;
use crate::exposure::{Exposure, Shift};
use crate::message::{State, Validity};
use crate::motion::{Envelope, ForceOffset, History, Load, Unloaded};
use crate::overload::LoadPosition;
use crate::static_pose::Window;

/// Increments with every change of layout or meaning of [`Memory`]; a checkpoint of another version is rejected.
pub const MEMORY_VERSION: u64 = 14;

/// The loop's state between two steps. About 933 kB: allocate it in a `Box`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Memory {
    /// [`MEMORY_VERSION`] of the writer.
    pub version: u64,
    /// Queues that pair the samples of both streams.
    pub alignment: Alignment,
    /// State of the plausibility checks of samples before alignment.
    pub(super) plausibility: Plausibility,
    /// Positions of the standing feet.
    pub anchor: Anchor,
    /// Registration of the suit world on the plate.
    pub(super) registration: RegistrationEstimator,
    /// The last suit samples with the ground wrench at their times; returns a snapshot once its window is complete.
    pub history: History,
    /// The last snapshots, for static pose detection.
    pub window: Window,
    /// Estimated errors of the inertia compensation.
    pub(super) noise: MotionNoise,
    /// Skew between the streams, and the lag used to correct it.
    pub skew: SkewMonitor,
    /// Sequential test of that lag.
    pub(super) lag_test: LagTest,
    /// Standard deviations of the snapshot's ground sample.
    pub(super) ground_sigma: GroundSigma,
    /// Recent rates of change of the vertical force, N/s, and of the CoP, m/s.
    pub(super) ground_rates: [Envelope; 2],
    /// Model terms besides the body.
    pub(super) terms: ModelTerms,
    /// Difference between the vertical force of the unloaded body and its weight.
    pub(super) force_offset: ForceOffset,
    /// Detector of intervals without a load.
    pub(super) unloaded: Unloaded,
    /// Position of the load in the hands.
    pub(super) load_position: LoadPosition,
    /// Horizontal position of the load, world, m. Valid while a load is detected.
    pub(super) load_point_m: [f64; 2],
    /// 1-σ of it in the hands, world x and y, m.
    pub(super) load_point_sigma_m: [f64; 2],
    /// Uncertainty of the stance offset at this instant.
    pub(super) stance_sigma: StanceSigma,
    /// State of the load detector.
    pub(super) load: Load,
    /// Time of the newest suit sample in the history.
    pub(super) processed_ns: u64,
    /// The suit's session in that sample.
    pub(super) session: u64,
    /// The suit's own counter in that sample.
    pub(super) suit_counter: u64,
    /// 1 while the anchor's shift stems from before the start and no suit sample has confirmed it.
    pub(super) shift_unconfirmed: u64,
    /// Time of the last motion sample that updated the filter.
    pub(super) motion_update_ns: u64,
    /// Body dimensions reported by the suit.
    pub reported_body: ReportedBody,
    /// The subject's identification.
    pub identification: Identification,
    /// Exposure accumulated over the subject's shift.
    pub exposure: Exposure,
    /// Readings of the empty plate.
    pub(super) tare: Tare,
    /// State of the pose that the model file requests.
    pub(super) pose_request: PoseRequestState,
    /// Invalid reasons of the newest aligned sample: [`Validity`] bits.
    pub(super) invalid: u64,
    /// Time of the last external change of the model; 0 for never.
    pub(super) model_changed_ns: u64,
    /// 1 once both streams and the subject were ready together.
    pub(super) was_ready: u64,
    /// All estimates, whether valid or not.
    pub(super) estimate: State,
    /// The last published state: the estimates without the invalid values.
    pub state: State,
}

/// The data replaced when another subject is loaded.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SubjectState {
    /// Body, mass, identification results.
    pub identification: Identification,
    /// Exposure accumulated over the subject's shift.
    pub exposure: Exposure,
}

/// Maximum noise and drift of an empty plate, N.
pub const EMPTY_PLATE_N: f64 = 150.0;

impl Memory {
    /// Initialises the memory before the first sample.
    pub fn start(&mut self, settings: &Settings) {
        bytemuck::bytes_of_mut(self).fill(0);
        self.version = MEMORY_VERSION;
        self.identification.start(settings);
        self.invalid = Validity::MOVING.and(Validity::FEET_OFF_PLATE).0;
    }

    /// Restarts from the streams and keeps only the tare, which stays valid until the next one.
    pub fn restart_keeping_tare(&mut self, settings: &Settings) {
        let tare = self.tare;
        self.start(settings);
        self.tare = tare;
    }

    /// Replaces the subject as a whole; [`crate::message::CommandKind::SubjectLoad`] informs the cycle.
    pub fn replace_subject(&mut self, subject: &SubjectState) {
        self.identification = subject.identification;
        self.exposure = subject.exposure;
        // Update the state even if nothing is measured, so that it never shows the previous subject's exposure.
        self.publish_exposure();
    }

    /// Continues the subject's shift after a gap without data.
    pub fn resume_shift(&mut self, shift: &Shift) {
        self.exposure.resume(shift);
        self.publish_exposure();
    }

    /// Whether every index and number is in range. A stored memory is checked before use, so that no file can make the
    /// loop panic.
    pub fn is_sound(&self) -> bool {
        self.version == MEMORY_VERSION
            && self.alignment.is_sound()
            && self.plausibility.is_sound()
            && self.anchor.is_sound()
            && self.registration.is_sound()
            && self.history.is_sound()
            && self.window.is_sound()
            && self.noise.is_sound()
            && self.skew.is_sound()
            && self.lag_test.is_sound()
            && self.ground_sigma.is_sound()
            && self.ground_rates.iter().all(Envelope::is_sound)
            && self.terms.is_sound()
            && self.force_offset.is_sound()
            && self.unloaded.is_sound()
            && self.load_position.is_sound()
            && self.load_point_m.iter().chain(&self.load_point_sigma_m).all(|value| value.is_finite())
            && self.stance_sigma.is_sound()
            && self.load.is_sound()
            && self.reported_body.is_sound()
            && self.identification.is_sound()
            && self.exposure.is_sound()
            && self.tare.is_sound()
            && self.pose_request.is_sound()
            && self.shift_unconfirmed <= 1
    }

    /// The invalid reasons of the newest aligned sample.
    pub(super) fn invalid_reasons(&self) -> Validity {
        Validity(self.invalid)
    }

    /// Tares the plate with its present readings, unless a person stands on it or it reports a fault.
    pub(super) fn tare(&mut self) -> bool {
        let Some(tare) = self.alignment.tare(EMPTY_PLATE_N) else { return false };
        self.tare.add(&tare);
        self.force_offset.reset();
        true
    }
}
