//! Body mass from the plate, standing or in motion: `M = ∫F_z dt / ∫(g + C̈_z) dt`. Over some seconds the impulse of
//! the body's own motion vanishes, and with it the error of its compensation.

use bytemuck::{Pod, Zeroable};

use super::Identification;
use crate::GRAVITY_M_PER_S2;
use crate::cycle::settings::Settings;
use crate::math;
use crate::motion::unloaded::{CORRELATION_S, SIGMAS_OF_A_LOAD};

/// Range of readings accepted as a body mass, kg.
const BODY_MASS_KG: core::ops::RangeInclusive<f64> = 25.0..=250.0;
/// Minimum time for an estimate of the mean's error, s.
const SHORTEST_S: f64 = 2.0 * CORRELATION_S;

/// 1-σ of a configured or stored mass, kg: clothing, a meal, bathroom scales.
pub(in crate::cycle) const OTHER_MASS_SIGMA_KG: f64 = 0.5;

/// Sums over snapshots without a load.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Weighing {
    length_s: f64,
    /// ∫F_z dt, N s.
    impulse_n_s: f64,
    /// ∫(g + C̈_z) dt, m/s.
    velocity_m_per_s: f64,
    /// ∫(F_z/(g + C̈_z))² dt, kg² s.
    square_kg2_s: f64,
    /// ∫σ² dt of each snapshot's mass by its motion, kg² s.
    expected_kg2_s: f64,
    /// The mass in use, kg; 0 before.
    in_use_kg: f64,
}

impl Weighing {
    /// A stored mass and its 1-σ, kg: the sums of one independent sample if that is larger than
    /// [`OTHER_MASS_SIGMA_KG`], otherwise none.
    pub(super) fn stored(mass_kg: f64, sigma_kg: f64) -> Weighing {
        if mass_kg <= 0.0 || sigma_kg <= OTHER_MASS_SIGMA_KG {
            return Weighing::zeroed();
        }
        Weighing {
            length_s: CORRELATION_S,
            impulse_n_s: mass_kg * GRAVITY_M_PER_S2 * CORRELATION_S,
            velocity_m_per_s: GRAVITY_M_PER_S2 * CORRELATION_S,
            square_kg2_s: mass_kg * mass_kg * CORRELATION_S,
            expected_kg2_s: sigma_kg * sigma_kg * CORRELATION_S,
            in_use_kg: mass_kg,
        }
    }

    fn mass_kg(&self) -> f64 {
        self.impulse_n_s / self.velocity_m_per_s
    }

    /// 1-σ of the mass, kg: from the spread of the snapshots and the spread expected from their motion; samples within
    /// [`CORRELATION_S`] count as one.
    fn sigma_kg(&self) -> f64 {
        let spread_kg2 = (self.square_kg2_s / self.length_s - self.mass_kg() * self.mass_kg()).max(0.0);
        let expected_kg2 = self.expected_kg2_s / self.length_s;
        math::sqrt((spread_kg2 + expected_kg2) * CORRELATION_S / self.length_s)
    }

    pub(super) fn is_sound(&self) -> bool {
        let sums = [self.length_s, self.velocity_m_per_s, self.square_kg2_s, self.expected_kg2_s];
        sums.iter().all(|sum| sum.is_finite() && *sum >= 0.0)
            && self.impulse_n_s.is_finite()
            && (0.0..1000.0).contains(&self.in_use_kg)
    }
}

impl Identification {
    /// 1-σ of the mass in use if it was weighed, kg, without the error of the device.
    pub(in crate::cycle) fn weighed_sigma_kg(&self) -> Option<f64> {
        let is_weighed = self.mass_kg > 0.0 && self.mass_kg == self.weighing.in_use_kg;
        is_weighed.then(|| self.weighing.sigma_kg())
    }

    /// 1-σ of the weight, N.
    pub(in crate::cycle) fn weight_sigma_n(&self) -> f64 {
        GRAVITY_M_PER_S2 * self.weighed_sigma_kg().unwrap_or(OTHER_MASS_SIGMA_KG)
    }

    /// Discards a mass that was weighed while force and motion belonged to different instants, or with another zero of
    /// the plate. A mass from another source is kept.
    pub(in crate::cycle) fn reset_weighing(&mut self) {
        if self.mass_kg == self.weighing.in_use_kg {
            self.mass_kg = 0.0;
        }
        self.weighing = Zeroable::zeroed();
    }

    /// Ingests the vertical force of a snapshot without a load, N, and the force per kilogram that the motion requires,
    /// m/s². `sigma_n`: σ of the force by the motion. The mass is used as soon as its error, with the plate's, is below
    /// the load threshold, and refined until it is as accurate as [`Settings::force_sigma_n`]. A mass from another
    /// source is kept.
    pub(in crate::cycle) fn weigh(
        &mut self,
        vertical_n: f64,
        specific_force_m_per_s2: f64,
        sigma_n: f64,
        step_s: f64,
        settings: &Settings,
    ) {
        if self.mass_kg <= 0.0 && self.weighing.in_use_kg > 0.0 {
            self.weighing = Zeroable::zeroed();
        }
        let weighing = &mut self.weighing;
        let sigma_in_use_n = GRAVITY_M_PER_S2 * weighing.sigma_kg();
        if self.mass_kg != weighing.in_use_kg
            || (self.mass_kg > 0.0 && sigma_in_use_n < settings.force_sigma_n)
        {
            return;
        }
        let measured_kg = vertical_n / specific_force_m_per_s2;
        if !BODY_MASS_KG.contains(&measured_kg) || !(0.0..CORRELATION_S).contains(&step_s) {
            return;
        }
        let expected_kg = sigma_n / specific_force_m_per_s2;
        weighing.length_s += step_s;
        weighing.impulse_n_s += vertical_n * step_s;
        weighing.velocity_m_per_s += specific_force_m_per_s2 * step_s;
        weighing.square_kg2_s += measured_kg * measured_kg * step_s;
        weighing.expected_kg2_s += expected_kg * expected_kg * step_s;
        let sigma_n = math::hypot([GRAVITY_M_PER_S2 * weighing.sigma_kg(), settings.force_sigma_n]);
        if weighing.length_s >= SHORTEST_S && sigma_n < settings.load_threshold_n / SIGMAS_OF_A_LOAD {
            weighing.in_use_kg = weighing.mass_kg();
            self.mass_kg = weighing.in_use_kg;
        }
    }
}
