//! `[overload]`: what counts as a load, how well it is known, how it is coloured.

use equipoise_core::cycle::{Accelerations, Motion, Settings};
use serde::{Deserialize, Serialize};

use super::method::{Checked, between};

/// `[overload]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OverloadConfig {
    /// External forces below this are no load, N.
    pub threshold_n: f64,
    /// A load farther than this from the line between the hands is not in the hands, m.
    pub load_distance_max_m: f64,
    /// Reporting of overload while the worker moves.
    pub motion: MotionConfig,
    /// Half the window over which accelerations are taken, ms: results lie that far behind the newest sample.
    pub motion_window_ms: f64,
    /// Where accelerations come from, if the suit sends its own (MVN type 21).
    pub accelerations: AccelerationsConfig,
    /// 1-σ of the measured CoP, mm.
    pub cop_sigma_mm: f64,
    /// 1-σ of vertical force and body weight together, N.
    pub force_sigma_n: f64,
    /// The same of the CoP by insoles alone, mm.
    pub insole_cop_sigma_mm: f64,
    /// The same of the vertical force by insoles alone, N.
    pub insole_force_sigma_n: f64,
    /// A joint's level is left downwards only this far below its bound, per cent of τ_max.
    pub level_margin_percent: f64,
}

impl Default for OverloadConfig {
    fn default() -> Self {
        OverloadConfig {
            threshold_n: 15.0,
            load_distance_max_m: 0.35,
            motion: MotionConfig::Compensated,
            motion_window_ms: 70.0,
            accelerations: AccelerationsConfig::Blend,
            cop_sigma_mm: 1.0,
            force_sigma_n: 2.0,
            insole_cop_sigma_mm: 6.0,
            insole_force_sigma_n: 12.0,
            level_margin_percent: 2.0,
        }
    }
}

/// Reporting of overload while the worker moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionConfig {
    /// The body's own inertia is taken out.
    Compensated,
    /// The paper's static equations.
    Paper,
}

/// Where accelerations come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccelerationsConfig {
    /// The positions alone.
    Positions,
    /// The suit's own.
    Suit,
    /// Quick motion from the suit's own, slow from the positions.
    Blend,
}

impl OverloadConfig {
    pub(super) fn check(&self) -> Checked {
        between("overload.motion_window_ms", self.motion_window_ms, 40.0, 250.0)?;
        between("overload.threshold_n", self.threshold_n, 1.0, 500.0)?;
        between("overload.load_distance_max_m", self.load_distance_max_m, 0.01, 5.0)?;
        between("overload.cop_sigma_mm", self.cop_sigma_mm, 0.0, 100.0)?;
        between("overload.force_sigma_n", self.force_sigma_n, 0.0, 100.0)?;
        between("overload.insole_cop_sigma_mm", self.insole_cop_sigma_mm, 0.0, 100.0)?;
        between("overload.insole_force_sigma_n", self.insole_force_sigma_n, 0.0, 500.0)?;
        between("overload.level_margin_percent", self.level_margin_percent, 0.0, 25.0)
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.load_threshold_n = self.threshold_n;
        settings.load_distance_max_m = self.load_distance_max_m;
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
        settings.level_margin_share = self.level_margin_percent * 1e-2;
    }
}
