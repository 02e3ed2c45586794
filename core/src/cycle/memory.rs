//! Everything of a cycle that changes, as plain old data: a checkpoint is a copy of it.

use bytemuck::{Pod, Zeroable};

use super::alignment::Alignment;
use super::asked::AskedPose;
use super::body_motion::MotionNoise;
use super::build::Build;
use super::identification::{Identification, StanceSigma};
use super::insoles::GroundSigma;
use super::model_terms::ModelTerms;
use super::placing::Placing;
use super::plausibility::Plausibility;
use super::settings::Settings;
use super::skew_watch::SkewWatch;
use super::tare::Tare;
use crate::anchor::Anchor;
use crate::body::JOINTS;
use crate::exposure::{Exposure, Shift};
use crate::message::{State, Validity};
use crate::motion::{Envelope, History, Load, Unloaded};
use crate::overload::LoadPlace;
use crate::static_pose::Window;

/// Grows with every change of layout or meaning of [`Memory`]; a checkpoint of another version is refused.
pub const MEMORY_VERSION: u64 = 11;

/// What the loop remembers from one step to the next. About 933 kB: keep it in a box.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Memory {
    /// [`MEMORY_VERSION`] of who wrote it.
    pub version: u64,
    /// Both streams, waiting for each other.
    pub alignment: Alignment,
    /// What is held against each sample before it is aligned.
    pub(super) plausibility: Plausibility,
    /// Where the feet stand.
    pub anchor: Anchor,
    /// How the suit's world lies on the plate.
    pub(super) placing: Placing,
    /// The last suit samples with the wrench at their times; moments come out of it when their future is known.
    pub history: History,
    /// The last moments.
    pub window: Window,
    /// How far the compensation of inertia can be trusted.
    pub(super) noise: MotionNoise,
    /// Skew between both streams, and the lag by which it is corrected.
    pub skew: SkewWatch,
    /// How well the ground's sample of the moment is known.
    pub(super) ground_sigma: GroundSigma,
    /// Rates at which the vertical force, N/s, and the centre of pressure, m/s, changed in the recent past.
    pub(super) ground_rates: [Envelope; 2],
    /// What the model has beside the body.
    pub(super) terms: ModelTerms,
    /// Whether nothing is carried.
    pub(super) unloaded: Unloaded,
    /// Where the load is in the hands.
    pub(super) load_place: LoadPlace,
    /// Horizontal place of the load, world, m. Means something while one is detected.
    pub(super) load_point_m: [f64; 2],
    /// How far the stance's offset is known at this instant.
    pub(super) stance_sigma: StanceSigma,
    /// Covariance of the horizontal components of each joint's overload, (N m)²: xx, xy, yy. Means something while
    /// torques are published.
    pub torque_covariance_nm2: [[f64; 3]; JOINTS],
    /// The load that was detected.
    pub(super) load: Load,
    /// Time of the newest suit sample in the history.
    pub(super) worked_ns: u64,
    /// The suit's session of that sample.
    pub(super) session: u64,
    /// The suit's own counter of that sample.
    pub(super) suit_counter: u64,
    /// 1 while the anchor's shift is one from before the start, and no suit sample has said yet whether it still holds.
    pub(super) shift_unconfirmed: u64,
    /// Time of the last moment in motion that entered the filter.
    pub(super) motion_learnt_ns: u64,
    /// What the suit says of this worker's build.
    pub build: Build,
    /// This worker.
    pub identification: Identification,
    /// What adds up over this worker's shift.
    pub exposure: Exposure,
    /// What an empty plate shows.
    pub(super) tare: Tare,
    /// What the model file asks for.
    pub(super) asked: AskedPose,
    /// Reasons found with the newest aligned sample: [`Validity`] bits.
    pub(super) found: u64,
    /// When the model was last changed from outside; 0 for never.
    pub(super) model_changed_ns: u64,
    /// 1 once both streams and the worker were there together.
    pub(super) was_ready: u64,
    /// What is known, whether or not it may be used now.
    pub(super) known: State,
    /// The state last told: what is known less what must not be used.
    pub state: State,
}

/// A worker who is put in place whole.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Worker {
    /// Body, mass, what was learnt.
    pub identification: Identification,
    /// What has added up over this worker's shift.
    pub exposure: Exposure,
}

/// With nobody on the plate, noise and drift stay below this, N.
pub const EMPTY_PLATE_N: f64 = 150.0;

impl Memory {
    /// Before the first sample.
    pub fn start(&mut self, settings: &Settings) {
        bytemuck::bytes_of_mut(self).fill(0);
        self.version = MEMORY_VERSION;
        self.identification.start(settings);
        self.found = Validity::MOVING.and(Validity::FEET_OFF_PLATE).0;
    }

    /// Starts over with the streams, keeping only what an empty plate shows: a tare lasts until the next.
    pub fn start_over(&mut self, settings: &Settings) {
        let tare = self.tare;
        self.start(settings);
        self.tare = tare;
    }

    /// Puts another worker in place whole; told to the cycle by [`crate::message::CommandKind::SubjectLoad`].
    pub fn put_in_place(&mut self, worker: &Worker) {
        self.identification = worker.identification;
        self.exposure = worker.exposure;
        // Also while nothing is measured: what is told is never that of the worker before.
        self.tell_exposure();
    }

    /// Goes on with the worker's shift after a gap in which nothing is known.
    pub fn resume_shift(&mut self, shift: &Shift) {
        self.exposure.resume(shift);
        self.tell_exposure();
    }

    /// Whether every index and number is in range. A memory that was stored is checked before it is used: no file
    /// may make the loop panic.
    pub fn is_sound(&self) -> bool {
        self.version == MEMORY_VERSION
            && self.alignment.is_sound()
            && self.plausibility.is_sound()
            && self.anchor.is_sound()
            && self.placing.is_sound()
            && self.history.is_sound()
            && self.window.is_sound()
            && self.noise.is_sound()
            && self.skew.is_sound()
            && self.ground_sigma.is_sound()
            && self.ground_rates.iter().all(Envelope::is_sound)
            && self.terms.is_sound()
            && self.unloaded.is_sound()
            && self.load_place.is_sound()
            && self.load_point_m.iter().all(|value| value.is_finite())
            && self.stance_sigma.is_sound()
            && self.torque_covariance_nm2.iter().flatten().all(|value| value.is_finite())
            && self.load.is_sound()
            && self.build.is_sound()
            && self.identification.is_sound()
            && self.exposure.is_sound()
            && self.tare.is_sound()
            && self.asked.is_sound()
            && self.shift_unconfirmed <= 1
    }

    /// The reasons found with the newest aligned sample.
    pub(super) fn findings(&self) -> Validity {
        Validity(self.found)
    }

    /// Takes what the plate shows now as nothing, unless somebody stands on it or it reports a fault.
    pub(super) fn tare(&mut self) -> bool {
        let Some(shown) = self.alignment.tare(EMPTY_PLATE_N) else { return false };
        self.tare.add(&shown);
        true
    }
}
