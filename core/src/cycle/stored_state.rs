//! The part of the memory that outlives the process: subject, shift, tare, force offset, registration.
//!
//! It is much smaller than a checkpoint, so the loop can copy it often; unlike a checkpoint, later versions can read
//! it, because it is stored by named fields.

use bytemuck::{Pod, Zeroable};

use super::identification::StoredSubject;
use super::memory::{EMPTY_PLATE_N, Memory};
use super::settings::Settings;
use super::skew_monitor::LAG_MAX_S;
use super::tare::Tare;
use crate::GRAVITY_M_PER_S2;
use crate::exposure::Shift;
use crate::math;
use crate::time::NS_PER_S;

/// Maximum gap after which a stored anchor shift is better than the configured position, ns. Each step that the anchor
/// misses may add 5 mm of error (`anchor::STANCE_SIGMA_M`); two steps per second over 20 s add up to 32 mm, and a new
/// registration is accepted within 30 mm.
pub const SHIFT_VALID_NS: u64 = 20 * NS_PER_S;
/// Maximum age at which a stored force offset is better than none, ns: a plate that drifts by 0.01 N/s changes it by
/// 6 N in this time, about the 1-σ with which it is restored.
pub const FORCE_OFFSET_VALID_NS: u64 = 600 * NS_PER_S;
/// Upper bound of a plausible drift of the suit, m.
const SHIFT_MAX_M: f64 = 1e4;

/// Position of the suit world in the station world, and the suit sample to which it belongs.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Registration {
    /// Rotation about the vertical from the suit world to the station world, rad …
    pub station_from_suit_rad: f64,
    /// … its 1-σ beyond the configured uncertainty, rad: π if position and heading were unavailable …
    pub station_from_suit_sigma_rad: f64,
    /// … the shift after the rotation, with the stance offset, m …
    pub station_from_suit_m: [f64; 2],
    /// … and its 1-σ by the stance offset, m; 0 if unavailable.
    pub station_from_suit_sigma_m: [f64; 2],
    /// Time of the suit sample, CLOCK_MONOTONIC; 0 before the first sample: the registration is unavailable then.
    pub suit_time_ns: u64,
    /// The suit's own counter in that sample.
    pub suit_counter: u64,
    /// The suit's measured period, ns.
    pub suit_period_ns: u64,
    /// Delay of the suit's stamps relative to the ground's, with the part that a model subtracts, s; 0 if it was not
    /// measured.
    pub suit_lag_s: f64,
}

/// Estimated difference between the vertical force of the unloaded body and its weight.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct StoredForceOffset {
    /// The offset, N …
    pub mean_n: f64,
    /// … and its 1-σ, N.
    pub sigma_n: f64,
    /// The mass with which it was estimated, kg; 0 without an offset.
    pub mass_kg: f64,
    /// Time of the last instant, CLOCK_MONOTONIC.
    pub time_ns: u64,
}

/// The stored data, copied after one cycle. At most 78 kB.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct StoredState {
    /// The subject.
    pub subject: StoredSubject,
    /// Exposure accumulated over the subject's shift.
    pub shift: Shift,
    /// Readings of the empty plate.
    pub tare: Tare,
    /// Force offset relative to the tare.
    pub force_offset: StoredForceOffset,
    /// Registration of the suit world.
    pub registration: Registration,
}

impl StoredState {
    /// Copies the data to be stored from the memory.
    pub fn copy_from(&mut self, memory: &Memory, settings: &Settings) {
        memory.identification.store(&mut self.subject);
        // The device's error is common to all of a session, and another one at another station.
        if self.subject.mass_sigma_kg > 0.0 {
            let device_kg = memory.ground.device_sigma_n(settings) / GRAVITY_M_PER_S2;
            self.subject.mass_sigma_kg = self.subject.mass_sigma_kg.max(device_kg);
        }
        self.shift = memory.exposure.shift();
        self.tare = memory.align.tare;
        let offset = &memory.ground.force_offset;
        self.force_offset = StoredForceOffset {
            mean_n: offset.mean_n(),
            sigma_n: offset.mean_sigma_n(),
            mass_kg: offset.mass_kg(),
            time_ns: memory.ground.offset_ns(memory.history.released_ns()),
        };
        self.registration = Registration {
            station_from_suit_rad: memory.placement.registration.station_from_suit_rad(),
            station_from_suit_sigma_rad: memory.placement.registration.sigma_rad(),
            station_from_suit_m: memory.station_from_suit_m(),
            station_from_suit_sigma_m: memory.identification.stance_variance_m2().map(math::sqrt),
            suit_time_ns: memory.placement.suit_time_ns,
            suit_counter: memory.placement.suit_counter,
            suit_period_ns: memory.align.alignment.suit_period_ns(),
            suit_lag_s: memory.align.skew.total_lag_s(),
        };
    }
}

impl Memory {
    /// Readings of the empty plate, which are subtracted from all its readings.
    pub fn tare(&self) -> &Tare {
        &self.align.tare
    }

    /// Restores a stored tare. Returns whether it is sound; if not, nothing changes.
    pub fn resume_tare(&mut self, tare: &Tare) -> bool {
        let sound = tare.is_sound();
        if sound {
            self.align.tare = *tare;
            self.ground.force_offset.reset();
        }
        sound
    }

    /// Restores a stored force offset, at least as uncertain as at a first start. Call it after restoring the
    /// subject and the tare. Returns whether it is sound and of the mass in use; if not, nothing changes.
    pub fn resume_force_offset(&mut self, stored: &StoredForceOffset) -> bool {
        let StoredForceOffset { mean_n, sigma_n, mass_kg, time_ns } = *stored;
        let is_usable = mass_kg > 0.0
            && mass_kg == self.identification.mass_kg
            && mean_n.abs() < EMPTY_PLATE_N
            && (0.0..EMPTY_PLATE_N).contains(&sigma_n);
        if is_usable {
            // The zero drifts until the first instant.
            self.ground.resume_offset(mass_kg, mean_n, sigma_n, time_ns);
        }
        is_usable
    }

    /// Restores a stored registration. The first suit sample decides whether it is valid: it is dropped if the suit
    /// restarted in the meantime or the gap is longer than [`SHIFT_VALID_NS`]. Call it after restoring the subject; the σ of
    /// its stance offset is then at least the stored one. Returns whether the registration is sound; if not, or if the
    /// suit does not drift, nothing changes.
    pub fn resume_registration(&mut self, registration: &Registration, settings: &Settings) -> bool {
        let (shift_m, sigma_m) = (registration.station_from_suit_m, registration.station_from_suit_sigma_m);
        let sound = registration.suit_time_ns > 0
            && registration.suit_period_ns > 0
            && registration.station_from_suit_rad.abs() <= core::f64::consts::PI
            && (0.0..=core::f64::consts::PI).contains(&registration.station_from_suit_sigma_rad)
            && registration.suit_lag_s.abs() < LAG_MAX_S
            && shift_m.iter().all(|metres| metres.is_finite() && metres.abs() < SHIFT_MAX_M)
            && sigma_m.iter().all(|metres| (0.0..SHIFT_MAX_M).contains(metres));
        if !sound || !settings.suit_drifts {
            return false;
        }
        self.placement.resume(registration);
        self.identification.widen_stance_offset_to(sigma_m.map(|metres| metres * metres));
        self.align.alignment.expect_suit_period(registration.suit_period_ns);
        // Most of the lag is a property of the devices and survives a restart of the daemon; otherwise the estimator
        // detects the change.
        let model_lag_s = self.prediction.terms.suit_lag_s(&settings.model, 0);
        self.align.skew.resume(registration.suit_lag_s, model_lag_s);
        true
    }

    /// Marks the registration as lost: nothing stored provides it, or the suit is another one.
    pub fn invalidate_registration(&mut self) {
        self.placement.registration.mark_lost(core::f64::consts::PI);
    }
}
