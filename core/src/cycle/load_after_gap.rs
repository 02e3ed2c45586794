//! Whether a load may be the effect of a gap in the ground's samples.
//!
//! Without a gap a changed gain is a jump ([`super::plausibility`]). After a gap it resembles a load: a plate with the
//! gain k measures the weight W as `k W`, like a load of `(k − 1) W` at the centre of pressure, which may be near the
//! hands. So a load that differs from that before the gap is doubtful until the weight alone was measured.

use bytemuck::{Pod, Zeroable};

use crate::math;
use crate::motion::unloaded::{CORRELATION_S, SIGMAS_OF_A_LOAD};

/// Averaging time of the load, s: that of a detected load (`motion::unloaded`).
const MEAN_OVER_S: f64 = 1.0;
/// Longer steps are limited to this, s, because the force in a gap is unavailable.
const STEP_MAX_S: f64 = 0.1;

/// External force at one instant of an identified subject.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoadNow {
    /// Stamp of the ground sample, ns; 0 for none.
    pub(super) ground_ns: u64,
    /// Stamp of the first ground sample after the last gap, ns; 0 for none.
    pub(super) resumed_ns: u64,
    /// Vertical external force and its 1-σ, N.
    pub(super) delta_f_n: f64,
    pub(super) sigma_n: f64,
    /// Force above which a load counts, N.
    pub(super) threshold_n: f64,
    /// Weight of one kilogram in the hands, N/kg.
    pub(super) weight_m_per_s2: f64,
    /// Whether a load is detected.
    pub(super) is_loaded: bool,
}

impl LoadNow {
    /// Mass in the hands and its 1-σ, kg.
    fn mass_kg(&self) -> [f64; 2] {
        [self.delta_f_n, self.sigma_n].map(|force_n| force_n / self.weight_m_per_s2)
    }
}

/// The load before the last gap, and the external force without a load since.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct LoadAfterGap {
    /// Stamp of the last ground sample, ns; 0 before the first.
    ground_ns: u64,
    /// 1 from a gap until the weight alone was measured.
    is_open: u64,
    /// Mean mass in the hands before the gap, kg, and mean square of its 1-σ, kg².
    before_kg: f64,
    before_kg2: f64,
    /// Sums over instants without a load since the gap: of 1/σ², 1/N², and of the external force over σ², 1/N.
    /// Instants within [`CORRELATION_S`] count as one.
    information_per_n2: f64,
    force_per_n: f64,
}

impl LoadAfterGap {
    /// The state with another subject, whose load before the gap is zero.
    pub(super) fn for_another_subject(&self) -> LoadAfterGap {
        LoadAfterGap { ground_ns: self.ground_ns, is_open: self.is_open, ..Zeroable::zeroed() }
    }

    /// Ingests the external force of an instant; returns whether its load is doubtful.
    pub(super) fn is_doubtful(&mut self, now: &LoadNow) -> bool {
        let last_ns = core::mem::replace(&mut self.ground_ns, now.ground_ns);
        let step_s = (now.ground_ns.saturating_sub(last_ns) as f64 * 1e-9).min(STEP_MAX_S);
        if last_ns > 0 && now.resumed_ns > last_ns {
            (self.is_open, self.information_per_n2, self.force_per_n) = (1, 0.0, 0.0);
        }
        let is_another = self.is_another(now);
        if self.is_open == 0 {
            self.update_mean(now, if is_another { 1.0 } else { step_s / MEAN_OVER_S });
            return false;
        }
        if !now.is_loaded {
            self.weigh(now, step_s);
        }
        now.is_loaded && is_another
    }

    /// Whether the load differs from that before the gap.
    fn is_another(&self, now: &LoadNow) -> bool {
        let [mass_kg, sigma_kg] = now.mass_kg();
        let limit_kg = SIGMAS_OF_A_LOAD * math::hypot([sigma_kg, math::sqrt(self.before_kg2)]);
        (mass_kg - self.before_kg).abs() > limit_kg.max(now.threshold_n / now.weight_m_per_s2)
    }

    fn update_mean(&mut self, now: &LoadNow, gain: f64) {
        let [mass_kg, sigma_kg] = now.mass_kg();
        self.before_kg += gain * (mass_kg - self.before_kg);
        self.before_kg2 += gain * (sigma_kg * sigma_kg - self.before_kg2);
    }

    /// Ingests the external force without a load. The weight alone was measured once the 1-σ of the mean excludes a
    /// load at the threshold.
    fn weigh(&mut self, now: &LoadNow, step_s: f64) {
        let information_per_n2 = step_s / CORRELATION_S / (now.sigma_n * now.sigma_n).max(1e-6);
        self.information_per_n2 += information_per_n2;
        self.force_per_n += information_per_n2 * now.delta_f_n;
        let sigmas = now.threshold_n * math::sqrt(self.information_per_n2);
        if sigmas >= SIGMAS_OF_A_LOAD {
            let is_weight = self.force_per_n.abs() < now.threshold_n * self.information_per_n2;
            self.is_open = u64::from(!is_weight);
            (self.information_per_n2, self.force_per_n) = (0.0, 0.0);
        }
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let positive = [self.before_kg2, self.information_per_n2];
        positive.iter().all(|value| value.is_finite() && *value >= 0.0)
            && self.before_kg.is_finite()
            && self.force_per_n.is_finite()
            && self.is_open <= 1
    }
}
