//! `[overload]`: detection of a load, measurement uncertainties, levels.

use equipoise_core::cycle::{Accelerations, Motion, Settings};
use serde::{Deserialize, Serialize};

use super::method::{Checked, between};

/// Default of `motion_window_ms`.
const HALF_WINDOW_MS: f64 = 70.0;

/// `[overload]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OverloadConfig {
    /// Load threshold of the external force, N.
    pub threshold_n: f64,
    /// Maximum distance of a load from the line between the hands, m.
    #[serde(alias = "load_distance_max_m")]
    pub load_hand_distance_max_m: f64,
    /// Overload reporting during motion.
    pub motion: MotionConfig,
    /// Half the window of the accelerations, ms: the delay of the results behind the newest sample.
    pub motion_window_ms: f64,
    /// Source of accelerations, if the suit sends them (MVN type 21).
    pub accelerations: AccelerationsConfig,
    /// 1-σ of the measured CoP, mm.
    pub cop_sigma_mm: f64,
    /// 1-σ of vertical force and body weight combined, N.
    pub force_sigma_n: f64,
    /// 1-σ of the CoP measured by insoles only, mm.
    pub insole_cop_sigma_mm: f64,
    /// 1-σ of the vertical force measured by insoles only, N.
    pub insole_force_sigma_n: f64,
    /// Hysteresis: a joint's level decreases only this far below its bound, per cent of τ_max.
    pub level_margin_percent: f64,
}

impl Default for OverloadConfig {
    fn default() -> Self {
        OverloadConfig {
            threshold_n: 15.0,
            load_hand_distance_max_m: 0.35,
            motion: MotionConfig::Compensated,
            motion_window_ms: HALF_WINDOW_MS,
            accelerations: AccelerationsConfig::Blend,
            cop_sigma_mm: 1.0,
            force_sigma_n: 2.0,
            insole_cop_sigma_mm: 6.0,
            insole_force_sigma_n: 12.0,
            level_margin_percent: 2.0,
        }
    }
}

/// Overload reporting during motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionConfig {
    /// The body's own inertia is removed.
    Compensated,
    /// The paper's static equations.
    Paper,
}

/// Source of accelerations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccelerationsConfig {
    /// Positions only.
    Positions,
    /// The suit's accelerations.
    Suit,
    /// High frequencies from the suit's accelerations, low ones from the positions.
    Blend,
}

impl OverloadConfig {
    pub(super) fn check(&self) -> Checked {
        between("overload.motion_window_ms", self.motion_window_ms, 40.0, 250.0)?;
        between("overload.threshold_n", self.threshold_n, 1.0, 500.0)?;
        between("overload.load_hand_distance_max_m", self.load_hand_distance_max_m, 0.01, 5.0)?;
        // Zero would be an exact measurement: every residual is significant then, and the filter divides by its variance.
        between("overload.cop_sigma_mm", self.cop_sigma_mm, 0.1, 100.0)?;
        between("overload.force_sigma_n", self.force_sigma_n, 0.1, 100.0)?;
        between("overload.insole_cop_sigma_mm", self.insole_cop_sigma_mm, 0.1, 100.0)?;
        between("overload.insole_force_sigma_n", self.insole_force_sigma_n, 0.1, 500.0)?;
        between("overload.level_margin_percent", self.level_margin_percent, 0.0, 25.0)
    }

    /// Half the motion window in use, ms. The paper's equations use that of a model's terms, which is the default.
    pub(super) fn half_window_ms(&self) -> f64 {
        match self.motion {
            MotionConfig::Compensated => self.motion_window_ms,
            MotionConfig::Paper => HALF_WINDOW_MS,
        }
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.load_threshold_n = self.threshold_n;
        settings.load_distance_max_m = self.load_hand_distance_max_m;
        settings.motion = match self.motion {
            MotionConfig::Compensated => {
                Motion::Compensated { half_window_ns: (self.motion_window_ms * 1e6) as u64 }
            }
            MotionConfig::Paper => Motion::Paper,
        };
        settings.cop_sigma_m = self.cop_sigma_mm * 1e-3;
        settings.force_sigma_n = self.force_sigma_n;
        settings.insole_cop_sigma_m = self.insole_cop_sigma_mm * 1e-3;
        settings.insole_force_sigma_n = self.insole_force_sigma_n;
        settings.accelerations = match self.accelerations {
            AccelerationsConfig::Positions => Accelerations::Positions,
            AccelerationsConfig::Suit => Accelerations::Suit,
            AccelerationsConfig::Blend => Accelerations::Blend,
        };
        settings.level_margin_fraction = self.level_margin_percent * 1e-2;
    }
}
