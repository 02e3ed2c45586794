//! The registration of the suit's world, and the lag between the streams.

use equipoise_config::Config;
use equipoise_config::ground::{FrameConfig, GroundConfig};
use equipoise_core::cycle::stored_state::SHIFT_VALID_NS;
use equipoise_core::cycle::{Registration, StoredState};
use equipoise_files::Sha256;
use serde::{Deserialize, Serialize};

use super::boot;

/// `[registration]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegistrationPart {
    /// Boot id of the machine, for `suit_time_ns`.
    boot: String,
    /// SHA-256 of the plates' frames: the registration is relative to the world that they define.
    frames: String,
    /// Rotation about the vertical and its 1-σ, rad.
    station_from_suit_rad: f64,
    station_from_suit_sigma_rad: f64,
    station_from_suit_m: [f64; 2],
    /// Its 1-σ by the stance offset, m.
    station_from_suit_sigma_m: [f64; 2],
    /// CLOCK_MONOTONIC; 0 if the registration was lost and the suit has sent no sample since.
    suit_time_ns: u64,
    suit_counter: u64,
    suit_period_ns: u64,
    /// Lag of the suit's stamps behind the ground's, s; 0 if it was not measured.
    suit_lag_s: f64,
    /// Configured latency of the suit less that of the ground, already subtracted from the stamps, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    latency_ms: Option<f64>,
}

impl RegistrationPart {
    /// The registration, also a lost one before the first suit sample: without it a later start would use the configured
    /// one. `None` without any, or if the start of the machine cannot be determined.
    pub fn of(copy: &StoredState, config: &Config) -> Option<RegistrationPart> {
        let Registration {
            station_from_suit_rad,
            station_from_suit_sigma_rad,
            station_from_suit_m,
            station_from_suit_sigma_m,
            suit_time_ns,
            suit_counter,
            suit_period_ns,
            suit_lag_s,
        } = copy.registration;
        let is_lost = station_from_suit_sigma_rad >= core::f64::consts::PI;
        (suit_time_ns > 0 || is_lost).then_some(RegistrationPart {
            boot: boot()?,
            frames: frames_of(config),
            station_from_suit_rad,
            station_from_suit_sigma_rad,
            station_from_suit_m,
            station_from_suit_sigma_m,
            suit_time_ns,
            suit_counter,
            suit_period_ns,
            suit_lag_s,
            latency_ms: Some(latency_ms(config)),
        })
    }

    /// Whether it was estimated with the configured frames of the ground devices.
    pub fn is_in_frames_of(&self, config: &Config) -> bool {
        self.frames == frames_of(config)
    }

    /// The registration, which the loop compares with the first suit sample.
    ///
    /// # Errors
    /// Why it is no longer valid.
    pub fn registration(&self, config: &Config, now_ns: u64) -> Result<Registration, String> {
        if boot().as_deref() != Some(&self.boot) {
            return Err("the machine was restarted".to_owned());
        }
        if !self.is_in_frames_of(config) {
            return Err("[ground.frame] is another than it was".to_owned());
        }
        if self.suit_time_ns == 0 {
            return Err("it was lost before, and the suit has sent no sample since".to_owned());
        }
        let age_ns = now_ns.saturating_sub(self.suit_time_ns);
        if age_ns > SHIFT_VALID_NS {
            return Err(format!("the worker was last seen {:.0} s ago", age_ns as f64 * 1e-9));
        }
        let &RegistrationPart {
            station_from_suit_rad,
            station_from_suit_sigma_rad,
            station_from_suit_m,
            station_from_suit_sigma_m,
            suit_time_ns,
            suit_counter,
            suit_period_ns,
            ..
        } = self;
        Ok(Registration {
            station_from_suit_rad,
            station_from_suit_sigma_rad,
            station_from_suit_m,
            station_from_suit_sigma_m,
            suit_time_ns,
            suit_counter,
            suit_period_ns,
            suit_lag_s: self.lag_s(config),
        })
    }

    /// The lag of stamps from which the configured latencies were subtracted, s; 0 if it was not measured.
    fn lag_s(&self, config: &Config) -> f64 {
        let set_since_ms = self.latency_ms.map_or(0.0, |before_ms| latency_ms(config) - before_ms);
        if self.suit_lag_s == 0.0 { 0.0 } else { self.suit_lag_s - 1e-3 * set_since_ms }
    }
}

/// Configured latency of the suit less that of the ground, ms.
fn latency_ms(config: &Config) -> f64 {
    config.suit.latency_ms - config.ground.latency_ms
}

fn frames_of(config: &Config) -> String {
    let frames = [Some(&config.ground), config.ground.second.as_deref()];
    // Without the size of the surface, which moves nothing.
    let text = |ground: &GroundConfig| FrameConfig { size_m: None, ..ground.frame.clone() }.to_toml();
    let texts = frames.map(|ground| ground.map(text).unwrap_or_default());
    Sha256::of(texts.join("and").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::super::tests::{config, copy};
    use super::*;
    use crate::realtime::now_ns;

    #[test]
    fn a_registration_is_refused_after_a_reboot_or_a_long_time() {
        let mut part = RegistrationPart::of(&copy(), &config("")).unwrap();
        let moved = config("[ground.frame]\nyaw_deg = 90.0");
        assert!(part.registration(&moved, now_ns()).unwrap_err().contains("[ground.frame]"));
        let drawn = config("[ground.frame]\nsize_m = [0.6, 0.4]");
        assert_eq!(part.registration(&drawn, now_ns()).unwrap().suit_lag_s, -0.04);
        // Less is subtracted from the suit's stamps than from the ground's since then.
        let later = part.registration(&config("latency_ms = 2.0"), now_ns()).unwrap();
        assert!((later.suit_lag_s + 0.038).abs() < 1e-12, "{later:?}");
        part.suit_lag_s = 0.0;
        assert_eq!(part.registration(&config("latency_ms = 2.0"), now_ns()).unwrap().suit_lag_s, 0.0);
        assert!(
            part.registration(&config(""), now_ns() + 2 * SHIFT_VALID_NS).unwrap_err().contains("last seen")
        );
        part.boot.push('x');
        assert!(part.registration(&config(""), now_ns()).unwrap_err().contains("machine"));
    }
}
