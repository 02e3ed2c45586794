//! What of the loop's memory outlives the process: the worker, the shift, the tare, the registration.
//!
//! Much less than a checkpoint, so that the loop can copy it again and again; and, unlike a checkpoint, understood by
//! later versions, since whoever stores it writes it by its fields.

use bytemuck::{Pod, Zeroable};

use super::identification::KeptWorker;
use super::memory::Memory;
use super::settings::Settings;
use super::skew_watch::LAG_MAX_S;
use super::tare::Tare;
use crate::exposure::Shift;
use crate::message::SuitSample;
use crate::time::NS_PER_S;

/// After a longer gap a shift is no better than the configured place, ns. Each step that the anchor does not see may
/// put the body 5 mm off (`anchor::STANCE_SIGMA_M`); two steps a second over 20 s add up to 32 mm, and a place that is
/// not known at all is believed within 30 mm.
pub const SHIFT_HOLDS_NS: u64 = 20 * NS_PER_S;
/// The suit's counter must tell the length of the gap this well: a share of it …
const COUNTER_TOLERANCE: f64 = 0.2;
/// … and so much, s.
const COUNTER_SLACK_S: f64 = 0.5;
/// No suit has drifted farther, m.
const SHIFT_MAX_M: f64 = 1e4;

/// Where the suit's world lies in the station's, and by which suit sample this was known.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Registration {
    /// Turn about the vertical from the suit's to the station's world, rad …
    pub station_from_suit_rad: f64,
    /// … its 1-σ beyond what was configured, rad: π if place and heading were not known …
    pub station_from_suit_sigma_rad: f64,
    /// … and the shift after it, m.
    pub station_from_suit_m: [f64; 2],
    /// Time of the suit sample, CLOCK_MONOTONIC; 0 before the first: then nothing is known.
    pub suit_time_ns: u64,
    /// The suit's own counter of it.
    pub suit_counter: u64,
    /// The suit's learnt period, ns.
    pub suit_period_ns: u64,
    /// How much later than the ground's the suit's stamps are, s; 0 if that was not known.
    pub suit_lag_s: f64,
}

/// What is kept, copied after one cycle. At most 78 kB.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Kept {
    /// The worker.
    pub worker: KeptWorker,
    /// What has added up over the worker's shift.
    pub shift: Shift,
    /// What an empty plate shows.
    pub tare: Tare,
    /// Where the suit's world lies.
    pub registration: Registration,
}

impl Kept {
    /// Copies what is to be kept.
    pub fn take(&mut self, memory: &Memory) {
        memory.identification.keep(&mut self.worker);
        self.shift = memory.exposure.shift();
        self.tare = memory.tare;
        self.registration = Registration {
            station_from_suit_rad: memory.placing.station_from_suit_rad(),
            station_from_suit_sigma_rad: memory.placing.sigma_rad(),
            station_from_suit_m: memory.anchor.station_from_suit_m(),
            suit_time_ns: memory.worked_ns,
            suit_counter: memory.suit_counter,
            suit_period_ns: memory.alignment.suit_period_ns(),
            suit_lag_s: memory.skew.lag_s(),
        };
    }
}

impl Memory {
    /// Takes a stored tare as what the empty plate shows. Whether it is sound; if not, nothing is changed.
    pub fn resume_tare(&mut self, tare: &Tare) -> bool {
        let sound = tare.is_sound();
        if sound {
            self.tare = *tare;
        }
        sound
    }

    /// Takes up a stored registration. The first suit sample decides whether it holds: if the suit was started anew
    /// meanwhile or the gap is longer than [`SHIFT_HOLDS_NS`], it is dropped. Whether it is sound; if not, or if the
    /// suit does not drift, nothing is changed.
    pub fn resume_registration(&mut self, registration: &Registration, settings: &Settings) -> bool {
        let shift_m = registration.station_from_suit_m;
        let sound = registration.suit_time_ns > 0
            && registration.suit_period_ns > 0
            && registration.station_from_suit_rad.is_finite()
            && (0.0..=core::f64::consts::PI).contains(&registration.station_from_suit_sigma_rad)
            && registration.suit_lag_s.abs() < LAG_MAX_S
            && shift_m.iter().all(|metres| metres.is_finite() && metres.abs() < SHIFT_MAX_M);
        if !sound || !settings.suit_drifts {
            return false;
        }
        self.anchor.resume(shift_m);
        self.placing.resume(registration.station_from_suit_rad, registration.station_from_suit_sigma_rad);
        self.worked_ns = registration.suit_time_ns;
        self.suit_counter = registration.suit_counter;
        self.alignment.expect_suit_period(registration.suit_period_ns);
        // Of the devices' own, most of it, and theirs whoever was started again; if not, the estimator notices.
        self.skew.resume(registration.suit_lag_s);
        self.shift_unconfirmed = 1;
        true
    }

    /// Where the suit's world lies is not known: nothing that was kept says so, or the suit is another.
    pub fn lose_the_place(&mut self) {
        self.placing.lose(core::f64::consts::PI);
    }

    /// Drops a shift from before the start unless this sample shows that the same suit went on, and not too long.
    pub(super) fn confirm_shift(&mut self, suit: &SuitSample, settings: &Settings) {
        if self.shift_unconfirmed == 0 {
            return;
        }
        self.shift_unconfirmed = 0;
        let gap_ns = suit.sample_time_ns.saturating_sub(self.worked_ns);
        let went_on = self.went_on(suit);
        if !went_on || gap_ns > SHIFT_HOLDS_NS {
            self.anchor = Zeroable::zeroed();
            self.worked_ns = 0;
            let heading_sigma_rad =
                if went_on { settings.suit_orientation_sigma_rad() } else { core::f64::consts::PI };
            self.placing.lose(heading_sigma_rad);
        }
    }

    /// Whether the suit's counter went on since the last sample as its time did.
    fn went_on(&self, suit: &SuitSample) -> bool {
        let (gap_s, period_s) = self.since_last_s(suit);
        let counted = u64::from(suit.device_counter).checked_sub(self.suit_counter);
        counted.is_some_and(|counted| {
            (counted as f64 * period_s - gap_s).abs() <= COUNTER_SLACK_S + COUNTER_TOLERANCE * gap_s
        })
    }

    /// Whether the suit was started anew since the last sample: it counts from the beginning, and no farther than it had
    /// time for. A counter that leaps elsewhere is the same suit's.
    pub(super) fn started_anew(&self, suit: &SuitSample) -> bool {
        let (gap_s, period_s) = self.since_last_s(suit);
        let counted_s = f64::from(suit.device_counter) * period_s;
        u64::from(suit.session) != self.session
            && !self.went_on(suit)
            && counted_s <= COUNTER_SLACK_S + (1.0 + COUNTER_TOLERANCE) * gap_s
    }

    /// Time since the last sample, and the suit's period, s.
    fn since_last_s(&self, suit: &SuitSample) -> (f64, f64) {
        let gap_ns = suit.sample_time_ns.saturating_sub(self.worked_ns);
        (gap_ns as f64 * 1e-9, self.alignment.suit_period_ns() as f64 * 1e-9)
    }
}
