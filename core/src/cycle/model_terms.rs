//! Model terms besides the body ([`crate::effect`]), applied to the current snapshot.
//!
//! The terms are subtracted in every comparison of measurement and prediction: in the published values and in every
//! innovation, so that terms and φ do not both absorb one error.

use bytemuck::{Pod, Zeroable};

use super::body_motion::BodyMotion;
use super::differentiate::Instant;
use super::ground::Ground;
use super::identification::Identification;
use super::settings::{Motion, Settings};
use crate::GRAVITY_M_PER_S2;
use crate::body::{SEGMENTS, Side};
use crate::effect::plate_lowpass::LowPass;
use crate::effect::{Effect, Model, Observation};
use crate::frame::{Pose, StationWorld};
use crate::motion::{History, Inertia};
use crate::static_pose::{PoseStatistics, SPAN_NS};

/// After a longer gap the plate's filter has settled, s.
const SETTLED_S: f64 = 0.5;

/// Snapshots of a static pose window at 240 Hz.
const RECENT: usize = 74;

/// State of the terms over the last snapshots.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct ModelTerms {
    /// Time of the station's first snapshot; 0 before it.
    first_snapshot_ns: u64,
    /// Changes at the last snapshots: CoP, m, vertical force, N.
    recent: [[f64; 3]; RECENT],
    /// Their times, ns; 0 for none.
    recent_ns: [u64; RECENT],
    /// Index of the next entry, in [0, RECENT).
    next: u64,
    /// Time of the first of the consecutive snapshots for which the terms were available, ns; 0 for none.
    applied_since_ns: u64,
    /// The plate's filter, applied to the predictions of the same three quantities.
    filter: [LowPass; 3],
}

impl ModelTerms {
    /// Restarts with another model; the station's first snapshot stays the same.
    pub(super) fn restart(&mut self) {
        *self = ModelTerms { first_snapshot_ns: self.first_snapshot_ns, ..Zeroable::zeroed() };
    }

    /// Whether every index and number is in range; stored ones are checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.recent.iter().flatten().copied().all(f64::is_finite)
            && self.next < RECENT as u64
            && self.filter.iter().all(LowPass::is_sound)
    }

    /// Time since the origin of the model's spans, s; 0 before it.
    fn since_origin_s(&self, model: &Model, time_ns: u64) -> f64 {
        let first_ns = (self.first_snapshot_ns > 0).then_some(self.first_snapshot_ns);
        let origin_ns = model.origin_ns.or(first_ns);
        origin_ns.map_or(0.0, |origin_ns| time_ns.saturating_sub(origin_ns) as f64 * 1e-9)
    }

    /// Lag of the suit at a time, s.
    pub(super) fn suit_lag_s(&self, model: &Model, time_ns: u64) -> f64 {
        let lags =
            model.at(self.since_origin_s(model, time_ns)).filter(|term| term.effect == Effect::SuitLag);
        lags.map(|term| term.shape).sum()
    }

    /// Cutoff of the plate's filter at a time, Hz.
    fn cutoff_hz(model: &Model, time_s: f64) -> Option<f64> {
        model.at(time_s).find(|term| term.effect == Effect::PlateLowpass).map(|term| term.shape)
    }

    /// A low pass of the plate delays and smooths the measurement relative to the suit's prediction; the difference is
    /// one more term.
    fn filter(
        &mut self,
        model: &Model,
        o: &Observation,
        step_s: f64,
        (cop_m, force_n): (&mut [f64; 2], &mut [f64; 3]),
    ) {
        let Some(cutoff_hz) = ModelTerms::cutoff_hz(model, o.time_s) else {
            self.filter.iter_mut().for_each(LowPass::reset);
            return;
        };
        if step_s > SETTLED_S {
            self.filter.iter_mut().for_each(LowPass::reset);
        }
        // Measured shear has passed the same filter, so the prediction by the suit is used.
        let by_suit_m = o.cop_by_suit_m();
        for (axis, by_suit_m) in by_suit_m.into_iter().enumerate() {
            let predicted_m = by_suit_m + cop_m[axis];
            cop_m[axis] += self.filter[axis].step(cutoff_hz, step_s, predicted_m) - predicted_m;
        }
        let predicted_n = o.force_predicted_n[2] + force_n[2];
        force_n[2] += self.filter[2].step(cutoff_hz, step_s, predicted_n) - predicted_n;
    }

    /// A full static pose window without the contribution of the terms; `None` while that is unavailable for part of
    /// the window.
    pub(super) fn subtract_from(&self, statistics: &PoseStatistics, model: &Model) -> Option<PoseStatistics> {
        if model.is_empty() {
            return Some(*statistics);
        }
        let newest = (self.next as usize + RECENT - 1) % RECENT;
        let since_ns = self.recent_ns[newest].saturating_sub(SPAN_NS);
        if self.applied_since_ns == 0 || self.applied_since_ns > since_ns {
            return None;
        }
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for (change, time_ns) in self.recent.iter().zip(self.recent_ns) {
            if time_ns >= since_ns && time_ns > 0 {
                sum.iter_mut().zip(change).for_each(|(sum, change)| *sum += change);
                count += 1.0;
            }
        }
        let [x_m, y_m, vertical_n] = sum.map(|sum| sum / count);
        let mut without = *statistics;
        without.cop_m[0] -= x_m;
        without.cop_m[1] -= y_m;
        without.vertical_n -= vertical_n;
        Some(without)
    }
}

impl ModelTerms {
    /// Data of this snapshot for the terms, as far as available before the ground's shear is evaluated; the slope is 0
    /// until then.
    pub(super) fn observe(
        &mut self,
        settings: &Settings,
        instant: &Instant,
        ground: &Ground,
        subject: &Identification,
        history: &History,
    ) -> Option<Observation> {
        let Instant { snapshot, pose, inertia, .. } = instant;
        if self.first_snapshot_ns == 0 {
            self.first_snapshot_ns = snapshot.time_ns.max(1);
        }
        let sample = snapshot.ground()?;
        if settings.model.is_empty() || !subject.has_body() {
            return None;
        }
        let moderate = inertia.filter(Inertia::is_moderate);
        let inertia = moderate.unwrap_or(Inertia::REST);
        let specific = inertia.specific_force_m_per_s2().unwrap_or(GRAVITY_M_PER_S2);
        let table = subject.anthropometry();
        let (origin_acceleration, rotation_acceleration) = accelerations(settings, history);
        // Before weighing, the mass is that of the measured vertical force.
        let mass_kg = if subject.mass_kg > 0.0 { subject.mass_kg } else { sample.force_n[2] / specific };
        let feet = Side::BOTH.map(|side| pose.origin_of(side.foot()) + pose.origin_of(side.toe()));
        Some(Observation {
            time_s: self.since_origin_s(&settings.model, snapshot.time_ns),
            mass_kg,
            floor_m: sample.surface_z_m,
            feet_m: [0, 1].map(|axis| 0.25 * (feet[0][axis] + feet[1][axis])),
            feet_hold: settings.suit_drifts,
            origin_m: snapshot.origin_m,
            origin_acceleration_m_per_s2: origin_acceleration,
            rotation: rotations(pose),
            rotation_acceleration_per_s2: rotation_acceleration,
            phi_m: subject.phi().0,
            grip_m: Side::BOTH.map(|side| table.grip_m(side.hand())),
            centre_m: table.com_m,
            mass_fraction: if moderate.is_some() { table.mass_fraction } else { [0.0; SEGMENTS] },
            com_m: crate::sesc::centre_of_mass(pose, &subject.phi()).into(),
            com_acceleration_m_per_s2: inertia.acceleration_m_per_s2,
            turning_m: inertia.turning_shift_m(specific),
            slope: [0.0; 2],
            slope_is_measured: false,
            cop_predicted_m: [0.0; 2],
            force_predicted_n: [0.0, 0.0, mass_kg * specific],
            cop_measured_m: ground.reading.cop_m,
            force_measured_n: sample.force_n,
        })
    }

    /// Change of the force, N, which needs no slope and on which the slope depends.
    pub(super) fn force_n(settings: &Settings, o: &mut Observation) -> [f64; 3] {
        predict_force(o, settings);
        let (_, force_n) = settings.model.change(o);
        force_n
    }

    /// Change of CoP, m, and force, N, of this snapshot's prediction, which is that of `body`.
    pub(super) fn apply(
        &mut self,
        settings: &Settings,
        observation: Option<&mut Observation>,
        instant: &Instant,
        body: &BodyMotion,
        subject: &Identification,
    ) -> ([f64; 2], [f64; 3]) {
        let (mut cop_m, mut force_n) = ([0.0; 2], [0.0; 3]);
        if let Some(o) = observation {
            o.slope = body.slope;
            o.slope_is_measured = body.slope_is_measured;
            let rows = subject.reduction.rows(&instant.pose, body.slope);
            let static_m = subject.predict_cop_m(&rows);
            o.cop_predicted_m = [0, 1].map(|axis| static_m[axis] + body.cop_beyond_rows_m(axis));
            (cop_m, force_n) = settings.model.change(o);
            self.filter(&settings.model, o, instant.step_s, (&mut cop_m, &mut force_n));
            if self.applied_since_ns == 0 {
                self.applied_since_ns = instant.snapshot.time_ns;
            }
        } else {
            self.applied_since_ns = 0;
            self.filter.iter_mut().for_each(LowPass::reset);
        }
        let next = self.next as usize % RECENT;
        self.recent[next] = [cop_m[0], cop_m[1], force_n[2]];
        self.recent_ns[next] = instant.snapshot.time_ns;
        self.next = (self.next + 1) % RECENT as u64;
        (cop_m, force_n)
    }
}

/// Second derivatives of origins, m/s², and rotations, 1/s², at the snapshot; zero without a window.
fn accelerations(
    settings: &Settings,
    history: &History,
) -> ([[f64; 3]; SEGMENTS], [[[f64; 3]; 3]; SEGMENTS]) {
    let (mut origin, mut rotation) = ([[0.0; 3]; SEGMENTS], [[[0.0; 3]; 3]; SEGMENTS]);
    history.differentiate_twice(settings.half_window_ns(), |weight, near| {
        // The anchor's shifts are no motion.
        let [x, y] = near.station_from_suit_m;
        for (sums, at) in origin.iter_mut().zip(&near.origin_m) {
            for (sum, value) in sums.iter_mut().zip([at[0] - x, at[1] - y, at[2]]) {
                *sum += weight * value;
            }
        }
        let near = rotations(&near.pose());
        for (sum, value) in rotation.iter_mut().flatten().flatten().zip(near.iter().flatten().flatten()) {
            *sum += weight * value;
        }
    });
    (origin, rotation)
}

/// Force that the model predicts from the suit's motion; static for the paper's equations.
fn predict_force(o: &mut Observation, settings: &Settings) {
    if settings.motion == Motion::Paper {
        o.force_predicted_n = [0.0, 0.0, o.mass_kg * GRAVITY_M_PER_S2];
    } else {
        let [x, y, _] = o.com_acceleration_m_per_s2;
        o.force_predicted_n = [o.mass_kg * x, o.mass_kg * y, o.force_predicted_n[2]];
    }
}

/// `world_from_segment` as matrices, row by row.
fn rotations(pose: &Pose<StationWorld>) -> [[[f64; 3]; 3]; SEGMENTS] {
    pose.world_from_segment.map(|rotation| {
        let matrix = rotation.to_rotation_matrix();
        core::array::from_fn(|row| core::array::from_fn(|column| matrix[(row, column)]))
    })
}
