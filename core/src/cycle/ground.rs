//! Stage `measure_ground`: wrench and centre of pressure at an instant, their uncertainty, and whether they may be used.

use bytemuck::{Pod, Zeroable};

use super::differentiate::Instant;
use super::identification::{Identification, OTHER_MASS_SIGMA_KG};
use super::insoles::GroundSigma;
use super::loading::Overload;
use super::residual::Residual;
use super::settings::{Motion, Settings};
use super::streams::Streams;
use crate::GRAVITY_M_PER_S2;
use crate::math;
use crate::message::ground::NoCop;
use crate::message::{Component, GroundDevice, GroundSample, Validity};
use crate::motion::unloaded::zero_limit_n;
use crate::motion::{Envelope, ForceOffset};

/// Maximum interval between snapshots for a rate of change, s: two samples of the slowest suit, 30 Hz.
const RATE_STEP_MAX_S: f64 = 0.07;

/// Wrench and centre of pressure of one sample.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Reading {
    /// Force on the person, N.
    pub(super) force_n: [f64; 3],
    /// Centre of pressure, world x and y, m; zero without one.
    pub(super) cop_m: [f64; 2],
    /// Devices of the sample: `GroundDevice` bits.
    pub(super) devices: u64,
    /// 1 if the devices do not measure shear.
    lacks_shear: u64,
}

impl Reading {
    /// Whether the devices measure the horizontal force.
    pub(super) fn measures_shear(&self) -> bool {
        self.lacks_shear == 0
    }

    /// Change of the vertical force, N, and distance between the centres of pressure, m.
    fn since(&self, before: &Reading) -> [f64; 2] {
        let apart_m = math::hypot([0, 1].map(|axis| self.cop_m[axis] - before.cop_m[axis]));
        [(self.force_n[2] - before.force_n[2]).abs(), apart_m]
    }
}

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct GroundState {
    /// Difference between the vertical force of the unloaded body and its weight.
    pub(super) force_offset: ForceOffset,
    /// Recent rates of change of the vertical force, N/s, and of the CoP, m/s.
    rates: [Envelope; 2],
    /// The last sample.
    last: Reading,
    /// 1 if the next sample may be compared with it.
    last_is_usable: u64,
    /// 1 while the load at the last instant may be another gain after a gap.
    gain_is_doubtful: u64,
    /// Time of a restored force offset until the first instant, ns; 0 for none.
    restored_ns: u64,
}

/// The ground at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ground {
    /// The sample of the instant, or the last one before it while the ground is silent.
    pub(super) reading: Reading,
    /// CoP of a person on a plausible and working device, m.
    pub(super) standing_m: Option<[f64; 2]>,
    /// Standard deviations.
    pub(super) sigma: GroundSigma,
    /// Difference between the vertical force of the unloaded body and its weight, N.
    pub(super) offset_n: f64,
    /// Recent rate of change of the vertical force, N/s.
    pub(super) rate_n_per_s: f64,
    /// Stamp of the first sample after the last gap, ns; 0 for none.
    pub(super) resumed_ns: u64,
    /// Whether the device may have another gain since then.
    pub(super) gain_is_doubtful: bool,
    /// Validity flags raised by the stage.
    pub(super) invalid: Validity,
}

impl Ground {
    /// Whether suit or ground is implausible.
    pub(super) fn is_suspect(&self) -> bool {
        self.invalid.any_of(Validity::IMPLAUSIBLE)
    }

    /// Whether the ground is implausible.
    pub(super) fn is_implausible(&self) -> bool {
        self.invalid.any_of(Validity::GROUND_IMPLAUSIBLE)
    }

    /// Vertical force of the unloaded body in a motion that needs this force per kilogram, m/s², with the force offset,
    /// N.
    pub(super) fn unloaded_force_n(&self, subject: &Identification, specific_force_m_per_s2: f64) -> f64 {
        subject.mass_kg * specific_force_m_per_s2 + self.offset_n
    }
}

/// The ground alone, while the suit is silent.
#[derive(Debug, Clone, Copy)]
pub(super) struct GroundAlone {
    /// The newest sample.
    pub(super) reading: Reading,
    /// 1-σ of its CoP per axis, m.
    pub(super) cop_sigma_m: f64,
    /// Vertical force minus the weight of the body at rest, N.
    pub(super) delta_f_n: f64,
    /// Validity flags raised by the stage.
    pub(super) invalid: Validity,
}

/// Evaluates the ground sample of an instant.
pub(super) fn measure_ground(
    settings: &Settings,
    state: &mut GroundState,
    instant: &Instant,
    subject: &Identification,
    streams: &Streams,
) -> Ground {
    let (snapshot, step_s) = (&instant.snapshot, instant.step_s);
    let since_s = match core::mem::take(&mut state.restored_ns) {
        0 => step_s,
        restored_ns => snapshot.time_ns.saturating_sub(restored_ns) as f64 * 1e-9,
    };
    state.force_offset.predict(since_s);
    state.force_offset.apply_mass(subject.mass_kg, subject.weight_sigma_n());
    let mut sigma = GroundSigma::of(snapshot.ground(), &state.force_offset, settings);
    let is_comparable = step_s > 0.0 && step_s < RATE_STEP_MAX_S && state.last_is_usable == 1;
    let before = is_comparable.then_some(state.last);
    let mut invalid = Validity::default();
    // A snapshot's time may lie between two samples.
    let half_ns = settings.half_window_ns();
    let around_ns = half_ns.max(streams.ground_period_ns);
    let standing =
        snapshot.ground().and_then(|ground| state.ingest(ground, around_ns, streams, &mut invalid));
    raise_feet_off(standing, &mut invalid);
    let [from_ns, to_ns] = [snapshot.time_ns.saturating_sub(half_ns), snapshot.time_ns + half_ns];
    invalid.raise(Validity::SUIT_IMPLAUSIBLE, streams.suit_suspect.overlaps(from_ns, to_ns));
    let standing_m = standing.filter(|_| !invalid.any_of(Validity::IMPLAUSIBLE));
    // σ of the sample's time, and of the lag between the streams, times the recent rate of change.
    let rates = match (before, standing_m) {
        (Some(before), Some(_)) => state.last.since(&before).map(|change| change / step_s),
        _ => [0.0; 2],
    };
    let mut recent = rates;
    for (recent, (envelope, rate)) in recent.iter_mut().zip(state.rates.iter_mut().zip(rates)) {
        *recent = envelope.update(rate, step_s);
    }
    let time_sigma_s = math::hypot([snapshot.time_sigma_ns as f64 * 1e-9, streams.lag_sigma_s]);
    sigma.add_time_error(time_sigma_s, recent);
    // The plate may have recovered since, but this snapshot has no ground sample, and the last values belong to an
    // earlier one.
    invalid.raise(Validity::GROUND_STALE, snapshot.ground().is_none());
    state.note_usability(invalid);
    let (reading, offset_n) = (state.last, state.force_offset.mean_n());
    Ground {
        reading,
        standing_m,
        sigma,
        offset_n,
        rate_n_per_s: state.rates[0].height(),
        resumed_ns: streams.ground_resumed_ns,
        gain_is_doubtful: state.gain_is_doubtful == 1,
        invalid,
    }
}

/// Evaluates the newest ground sample while the suit is silent.
pub(super) fn measure_ground_alone(
    settings: &Settings,
    state: &mut GroundState,
    sample: &GroundSample,
    subject: &Identification,
    streams: &Streams,
) -> GroundAlone {
    let mut invalid = Validity::MOVING;
    let standing = state.ingest(sample, 0, streams, &mut invalid);
    raise_feet_off(standing, &mut invalid);
    state.note_usability(invalid);
    let unloaded_n = subject.mass_kg * GRAVITY_M_PER_S2 + state.force_offset.mean_n();
    GroundAlone {
        reading: state.last,
        // There is no suit sample, so a time error does not contribute.
        cop_sigma_m: GroundSigma::of(Some(sample), &state.force_offset, settings).cop_m,
        delta_f_n: sample.force_n[2] - unloaded_n,
        invalid,
    }
}

fn raise_feet_off(standing: Option<[f64; 2]>, invalid: &mut Validity) {
    let is_off = standing.is_none() && !invalid.any_of(Validity::COP_NOT_MEASURED);
    invalid.raise(Validity::FEET_OFF_PLATE, is_off);
}

impl GroundState {
    /// Ingests a sample; no CoP if nothing stands on the plate or the plate is faulty. `around_ns`: half the interval
    /// of samples that it represents.
    fn ingest(
        &mut self,
        ground: &GroundSample,
        around_ns: u64,
        streams: &Streams,
        invalid: &mut Validity,
    ) -> Option<[f64; 2]> {
        let cop = ground.cop_m();
        invalid.raise(Validity::PLATE_FAULT, matches!(cop, Err(NoCop::DeviceStatus(_))));
        let [from_ns, to_ns] =
            [ground.sample_time_ns.saturating_sub(around_ns), ground.sample_time_ns + around_ns];
        invalid.raise(Validity::GROUND_IMPLAUSIBLE, streams.ground_suspect.overlaps(from_ns, to_ns));
        invalid.raise(Validity::COP_NOT_MEASURED, matches!(cop, Err(NoCop::NotMeasured)));
        self.last = Reading {
            force_n: ground.force_n,
            cop_m: cop.unwrap_or_default(),
            devices: u64::from(ground.devices),
            lacks_shear: u64::from(!ground.measures(Component::Shear)),
        };
        cop.ok()
    }

    /// Resets the force offset after a tare by `zero_n`, N. Returns whether the offset explains the tare, up to a rest
    /// that it can track: the rest arose on the empty plate, or is part of the mass if that was weighed.
    pub(super) fn reset_offset(&mut self, settings: &Settings, zero_n: f64) -> bool {
        let rest_n = zero_n - self.force_offset.mean_n();
        let sigma_n = self.force_offset.sigma_n(settings.force_sigma_n).max(settings.force_sigma_n);
        self.force_offset.reset();
        rest_n.abs() < zero_limit_n(sigma_n, settings.load_threshold_n)
    }

    /// Continues with a stored force offset and its 1-σ, N, of this mass, kg: at least as uncertain as with a mass from
    /// another source.
    pub(super) fn resume_offset(&mut self, mass_kg: f64, mean_n: f64, sigma_n: f64, time_ns: u64) {
        self.restored_ns = time_ns;
        let sigma_n = sigma_n.max(GRAVITY_M_PER_S2 * OTHER_MASS_SIGMA_KG);
        self.force_offset.resume(mass_kg, mean_n, sigma_n);
    }

    /// Time of the force offset, ns, of which the newest instant has the time `newest_ns`.
    pub(super) fn offset_ns(&self, newest_ns: u64) -> u64 {
        if self.restored_ns > 0 { self.restored_ns } else { newest_ns }
    }

    /// Makes the force offset as uncertain as with a mass from another source: the terms of another model may explain
    /// what it has absorbed.
    pub(super) fn widen_offset(&mut self) {
        self.force_offset.widen(GRAVITY_M_PER_S2 * OTHER_MASS_SIGMA_KG);
    }

    /// Updates the force offset while no load is carried.
    pub(super) fn update_from_residual(
        &mut self,
        settings: &Settings,
        instant: &Instant,
        residual: &Residual,
    ) {
        if settings.motion != Motion::Paper && !instant.snapshot.ground.is_by_insoles_alone() {
            self.force_offset.update(residual.delta_f_n, instant.step_s, residual.sigma);
        }
    }

    /// 1-σ of the vertical force by the devices of the last sample, N.
    pub(super) fn device_sigma_n(&self, settings: &Settings) -> f64 {
        match GroundDevice::are_insoles_alone(self.last.devices as u32) {
            true => settings.insole_force_sigma_n,
            false => settings.force_sigma_n,
        }
    }

    /// Ingests the load of an instant: while it is implausible, so is the shear of the same device.
    pub(super) fn ingest_load(&mut self, overload: Option<&Overload>) {
        let is_implausible = |overload: &Overload| overload.invalid.any_of(Validity::GROUND_IMPLAUSIBLE);
        self.gain_is_doubtful = u64::from(overload.is_some_and(is_implausible));
    }

    fn note_usability(&mut self, invalid: Validity) {
        let unusable = Validity::INVALIDATES_COP_MEASURED.and(Validity::IMPLAUSIBLE);
        self.last_is_usable = u64::from(!invalid.any_of(unusable));
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.force_offset.is_sound()
            && self.rates.iter().all(Envelope::is_sound)
            && self.last.force_n.iter().chain(&self.last.cop_m).all(|value| value.is_finite())
            && self.last_is_usable <= 1
            && self.gain_is_doubtful <= 1
    }
}
