//! Lag and drift over time, estimated from windows.

use bytemuck::{Pod, Zeroable};

use super::Window;

/// 1-σ of the drift between two clocks before it is measured: quartz clocks and recordings have up to 1000 ppm.
const DRIFT_SIGMA: f64 = 500e-6;
/// Random walk of the drift, 1/s: 10 ppm in one minute.
const DRIFT_WALK: f64 = 10e-6 * 10e-6 / 60.0;
/// Random walk of the lag, s²/s: 1 ms in one minute.
const LAG_WALK: f64 = 1e-3 * 1e-3 / 60.0;
/// Weight of a new window in the mean of the normalised innovation squared.
const NIS_GAIN: f64 = 0.1;

/// Kalman filter of lag (s) and drift (s/s).
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Track {
    /// Time of the state, ns; 0 while nothing is tracked.
    pub(super) time_ns: u64,
    pub(super) state: [f64; 2],
    /// Variance of the lag, covariance, variance of the drift.
    pub(super) covariance: [f64; 3],
    /// Mean of the normalised innovation squared; a value above 1 scales the variance of a window.
    nis: f64,
}

impl Track {
    pub(super) fn start(window: &Window) -> Track {
        Track {
            time_ns: window.time_ns,
            state: [window.lag_s, 0.0],
            covariance: [window.variance_s2, 0.0, DRIFT_SIGMA * DRIFT_SIGMA],
            nis: 1.0,
        }
    }

    pub(super) fn predict(&self, time_ns: u64) -> Track {
        let step_s = (time_ns as f64 - self.time_ns as f64) * 1e-9;
        let ([lag_s, drift], [v00, v01, v11]) = (self.state, self.covariance);
        let walk = DRIFT_WALK * step_s.abs();
        let lag_walk = LAG_WALK * step_s.abs() + walk * step_s * step_s / 3.0;
        Track {
            time_ns,
            state: [lag_s + drift * step_s, drift],
            covariance: [
                v00 + step_s * (2.0 * v01 + step_s * v11) + lag_walk,
                v01 + step_s * (v11 + 0.5 * walk),
                v11 + walk,
            ],
            nis: self.nis,
        }
    }

    /// Innovation and its variance at the track's own time.
    pub(super) fn innovation(&self, window: &Window) -> [f64; 2] {
        [window.lag_s - self.state[0], self.covariance[0] + window.variance_s2 * self.nis.max(1.0)]
    }

    pub(super) fn update(&mut self, window: &Window) {
        let [v00, v01, v11] = self.covariance;
        let [innovation, _] = self.innovation(window);
        let as_stated = innovation * innovation / (v00 + window.variance_s2);
        self.nis += NIS_GAIN * (as_stated - self.nis);
        let [_, variance] = self.innovation(window);
        let gain = [v00 / variance, v01 / variance];
        self.state = [0, 1].map(|part| self.state[part] + gain[part] * innovation);
        self.covariance = [v00 - gain[0] * v00, v01 - gain[0] * v01, v11 - gain[1] * v01];
    }

    pub(super) fn is_sound(&self) -> bool {
        let [v00, v01, v11] = self.covariance;
        self.state.iter().all(|value| value.abs() < 1e6)
            && (0.0..1e6).contains(&self.nis)
            && v00 >= 0.0
            && v11 >= 0.0
            && v01 * v01 <= v00 * v11 * (1.0 + 1e-9)
            && v00 + v11 < 1e6
            && (self.time_ns == 0 || v00 > 0.0)
    }
}
