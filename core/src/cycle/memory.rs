//! All mutable state of a cycle as plain old data: a checkpoint is a copy of it.

use bytemuck::{Pod, Zeroable};

use super::align::AlignState;
use super::early::EarlyStage;
use super::ground::GroundState;
use super::identification::Identification;
use super::identify::MotionUpdates;
use super::lag_test::LagTest;
use super::loading::LoadState;
use super::placement::Placement;
use super::pose_request::PoseRequestState;
use super::prediction::PredictionState;
use super::publish::Publication;
use super::reported_body::ReportedBody;
use super::settings::Settings;
use super::skew_monitor::SkewMonitor;
use crate::exposure::{Exposure, Shift};
use crate::message::{EarlyState, State};
use crate::motion::{History, Unloaded};
use crate::static_pose::Window;

/// Increments with every change of layout or meaning of [`Memory`]; a checkpoint of another version is rejected.
pub const MEMORY_VERSION: u64 = 25;

/// The loop's state between two steps. About 1.03 MB: allocate it in a `Box`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Memory {
    /// [`MEMORY_VERSION`] of the writer.
    pub version: u64,
    /// Queues, checks and skew of both streams, and readings of the empty plate.
    pub(super) align: AlignState,
    /// Position and heading of the body on the plate.
    pub(super) placement: Placement,
    /// Body dimensions reported by the suit.
    pub reported_body: ReportedBody,
    /// The last suit samples with the ground wrench at their times; returns a snapshot once its window is complete.
    pub history: History,
    /// Force offset and recent readings of the ground.
    pub(super) ground: GroundState,
    /// The last snapshots, for static pose detection.
    pub window: Window,
    /// State of the pose that the model file requests.
    pub(super) pose_request: PoseRequestState,
    /// Model terms, and errors of the inertia compensation.
    pub(super) prediction: PredictionState,
    /// The subject's identification.
    pub identification: Identification,
    /// Its updates by motion samples.
    pub(super) motion_updates: MotionUpdates,
    /// Detectors of a load, and its position in the hands.
    pub(super) load: LoadState,
    /// Detector of intervals without a load.
    pub(super) unloaded: Unloaded,
    /// Sequential test of the lag between the streams.
    pub(super) lag_test: LagTest,
    /// Exposure accumulated over the subject's shift.
    pub exposure: Exposure,
    /// [`Settings::differentiation`] with which the motion errors were measured.
    pub(super) differentiation: [u64; 2],
    /// [`crate::effect::Model::fingerprint`] of the model in use.
    pub(super) model: u64,
    /// Time of the last external change of the model; 0 for never.
    pub(super) model_changed_ns: u64,
    /// Values of the newest instant.
    pub(super) publication: Publication,
    /// The last published state.
    pub state: State,
    /// The last early state, and its differences from states.
    pub(super) early: EarlyStage,
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
        self.differentiation = settings.differentiation();
        self.model = settings.model.fingerprint();
        self.identification.start(settings);
        self.publication.start();
        self.pose_request.restart(settings);
    }

    /// Replaces the subject as a whole; [`crate::message::CommandKind::SubjectLoad`] informs the cycle.
    pub fn replace_subject(&mut self, subject: &SubjectState) {
        self.move_stance_offset_to_anchor();
        let stance_m2 = self.identification.stance_variance_m2();
        self.identification = subject.identification;
        self.identification.widen_stance_offset_to(stance_m2);
        self.exposure = subject.exposure;
        // Its differences belong to the previous subject's motion.
        self.early = Zeroable::zeroed();
        // The values held between two instants belong to the previous subject.
        self.publication.start();
        // The suit may still send the previous subject's null pose: compare it with the poses again.
        self.reported_body.compare_again();
        // Update the state even if nothing is measured, so that it never shows the previous subject's exposure.
        self.publication.begin_shift(&self.exposure);
    }

    /// Discards what was identified about the subject, except the bone lengths.
    pub fn reset_to_prior(&mut self, settings: &Settings) {
        self.move_stance_offset_to_anchor();
        self.identification.reset_to_prior(settings);
    }

    /// Moves the stance offset from the filter into the anchor, before the filter is reset or replaced: the offset
    /// belongs to the anchor's shift, whose errors accumulate over the steps.
    pub(super) fn move_stance_offset_to_anchor(&mut self) {
        let by_m = self.identification.take_stance_offset();
        if by_m != [0.0; 2] {
            self.placement.displace(by_m);
            // Their content uses the previous place.
            self.history.clear();
            self.window.clear();
        }
    }

    /// Shift from the suit world to the station world, with the stance offset, m.
    pub(super) fn station_from_suit_m(&self) -> [f64; 2] {
        let (shift_m, offset_m) =
            (self.placement.anchor.station_from_suit_m(), self.identification.stance_offset_m());
        [0, 1].map(|axis| shift_m[axis] + offset_m[axis])
    }

    /// Whether a tare in the next cycle is applied: the plate is empty and reports no fault.
    pub fn can_tare(&self) -> bool {
        self.align.alignment.empty_reading(EMPTY_PLATE_N).is_some()
    }

    /// Continues the subject's shift after a gap without data; `ended_ns` as in [`Exposure::resume`].
    pub fn resume_shift(&mut self, shift: &Shift, ended_ns: u64) {
        self.exposure.resume(shift, ended_ns);
        self.publication.begin_shift(&self.exposure);
    }

    /// Whether every index and number is in range. A stored memory is checked before use, so that no file can make the
    /// loop panic.
    pub fn is_sound(&self) -> bool {
        self.version == MEMORY_VERSION
            && self.align.is_sound()
            && self.placement.is_sound()
            && self.reported_body.is_sound()
            && self.history.is_sound()
            && self.ground.is_sound()
            && self.window.is_sound()
            && self.pose_request.is_sound()
            && self.prediction.is_sound()
            && self.identification.is_sound()
            && self.load.is_sound()
            && self.unloaded.is_sound()
            && self.lag_test.is_sound()
            && self.exposure.is_sound()
            && self.publication.is_sound()
            && self.early.is_sound()
    }

    /// The last early state; it is new if its cycle is that of the step.
    pub fn early(&self) -> &EarlyState {
        &self.early.published
    }

    /// The skew between the streams and the lag in use.
    pub fn skew(&self) -> &SkewMonitor {
        &self.align.skew
    }

    /// Number of samples rejected on arrival: impossible, or their time did not advance.
    pub fn rejected_samples(&self) -> u64 {
        self.align.alignment.refused()
    }

    /// Clears the samples that wait for a window, the static pose window and the detector of intervals without a load:
    /// they belong to another body, place or model.
    pub(super) fn clear_windows(&mut self) {
        self.history.clear();
        self.window.clear();
        self.unloaded.clear();
        self.early.clear_pending();
    }
}
