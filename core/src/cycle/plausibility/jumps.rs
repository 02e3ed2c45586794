//! Detects jumps in a plate's readings: changes faster than a body loads the plate, or to a CoP that no body reaches so
//! quickly.
//!
//! A jump makes the subsequent readings suspect. One that reverts at once was a glitch. One that does not is a fault of
//! the plate and not a load, which a body takes up slowly: it stays suspect until the reading returns to its previous
//! level, the subject has stepped off, or the plate shows the subject's weight alone at the expected position.

use bytemuck::{Pod, Zeroable};

use crate::cycle::memory::EMPTY_PLATE_N;
use crate::math;
use crate::message::{Component, GroundSample};

/// Maximum rate at which a body loads a plate, N/s: the loading rate of a heel strike in brisk walking (20 body weights
/// per second; Nilsson and Thorstensson 1989, Acta Physiol Scand 136).
const LOADING_RATE_MAX_N_PER_S: f64 = 20e3;
/// Tolerance beyond that rate, as a multiple of the RMS difference of readings the same interval apart.
const JUMP_SIGMAS: f64 = 8.0;
/// Averaging times of the RMS difference, s. The smaller average counts, so that past noise does not mask jumps for
/// long.
const DIFFERENCES_OVER_S: [f64; 2] = [1.0, 10.0];
/// Maximum distance from the CoP at which loads act, m: the span of a stance.
pub(super) const LEVER_MAX_M: f64 = 0.3;
/// Each reading is compared with the previous one, and with one at least this much older, ns: a low-pass filter spreads
/// a jump over some ms. Without a filter, the single step detects smaller jumps, because a body loads the plate less in
/// it.
const JUMP_OVER_NS: u64 = 2_000_000;
/// Over longer gaps the rate is unavailable, ns. Only over those in which a device can start again does `load_after_gap`
/// compare the load with that before.
const JUMP_GAP_MAX_NS: u64 = 100_000_000;
/// Time after a jump at which the reading is checked for its return, ns.
const JUMP_SETTLES_NS: u64 = 25_000_000;
/// Time for which a jump makes the subsequent readings suspect, ns: twice the window of a motion.
pub(super) const JUMP_HOLDS_NS: u64 = 300_000_000;
/// Averaging time of the level of the readings, s; variations by work are faster.
const LEVEL_OVER_S: f64 = 1.0;
/// Minimum duration of a jump that did not revert, until the level is meaningful, ns.
const LEVEL_EVIDENCE_NS: u64 = 2_000_000_000;

/// One reading of a plate.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Reading {
    pub(super) time_ns: u64,
    vertical_n: f64,
    cop_m: [f64; 2],
    /// 1 if a person stands on the plate and the CoP is available.
    stands: u32,
    /// Standard deviation of `time_ns`, µs, rounded up; `u32::MAX` while the device's clock is not known.
    time_sigma_us: u32,
}

impl Reading {
    pub(super) fn of(sample: &GroundSample) -> Reading {
        let cop_m = sample.cop_m().ok().filter(|_| sample.measures(Component::Tilt));
        Reading {
            time_ns: sample.sample_time_ns,
            vertical_n: sample.force_n[2],
            cop_m: cop_m.unwrap_or_default(),
            stands: u32::from(cop_m.is_some()),
            time_sigma_us: u32::try_from(sample.sample_time_sigma_ns.div_ceil(1000)).unwrap_or(u32::MAX),
        }
    }

    /// Time that may have passed since an earlier reading, s: at a stream's start the stamps of a batch of samples lie
    /// closer together than the samples.
    fn span_since_s(&self, earlier: &Reading) -> f64 {
        let stamped_ns = self.time_ns.saturating_sub(earlier.time_ns);
        let sigma_us = u64::from(self.time_sigma_us) + u64::from(earlier.time_sigma_us);
        (stamped_ns + 1000 * sigma_us) as f64 * 1e-9
    }

    /// Difference of two readings: as a force, N, and as the moment of the part that moved, N m.
    pub(super) fn to(&self, other: &Reading) -> [f64; 2] {
        let by_nm = if self.stands + other.stands == 2 {
            self.vertical_n.min(other.vertical_n)
                * math::hypot([0, 1].map(|axis| other.cop_m[axis] - self.cop_m[axis]))
        } else {
            0.0
        };
        [(other.vertical_n - self.vertical_n).abs(), by_nm]
    }
}

/// A detected jump and its state.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Jump {
    /// The last reading before it; a time of 0 for no jump.
    from: Reading,
    /// The level before it.
    level: Reading,
    /// Time of the last detection, ns.
    detected_ns: u64,
    /// Persistent part of the jump, N and N m; 0 before it has settled, and after it reverted.
    by: [f64; 2],
    /// Largest signed change of the vertical force during the jump, N.
    change_n: f64,
}

/// Jump detector of a plate's readings.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct JumpDetector {
    /// Two readings some ms apart; the older one is a reference for comparison.
    readings: [Reading; 2],
    /// The previous reading, the other reference.
    last: Reading,
    /// Mean squares of the differences from the two references, N²: some ms apart, and one sample. Each over a short
    /// and a long time.
    difference_n2: [[f64; 2]; 2],
    /// Slow mean of the readings.
    level: Reading,
    jump: Jump,
    /// Time for which the plate has shown the subject alone, at the subject's position, s.
    agreed_s: f64,
}

impl JumpDetector {
    /// The present reading, or one some ms old; a time of 0 for none since a restart.
    pub(super) fn newest(&self) -> Reading {
        self.readings[1]
    }

    /// Drops the readings for comparison: those that follow are after a gap, or relative to another zero.
    pub(super) fn restart(&mut self) {
        *self = JumpDetector { difference_n2: self.difference_n2, ..Zeroable::zeroed() };
    }

    /// Ingests a reading; returns the time since which the readings are suspect, ns.
    pub(super) fn ingest(&mut self, now: Reading) -> Option<u64> {
        let last = core::mem::replace(&mut self.last, now);
        let step_ns = now.time_ns.saturating_sub(last.time_ns);
        if step_ns > JUMP_GAP_MAX_NS {
            let jump = self.jump;
            self.restart();
            (self.readings, self.last, self.level) = ([now; 2], now, now);
            if jump.from.time_ns == 0 {
                return None;
            }
            // A gap does not end a jump. The level starts again, and with it the evidence.
            self.jump = Jump { detected_ns: now.time_ns, by: [0.0; 2], ..jump };
            return Some(jump.from.time_ns);
        }
        let compared = [self.readings[0], last];
        let newer = self.readings[1];
        if now.time_ns.saturating_sub(newer.time_ns) >= JUMP_OVER_NS {
            self.readings = [newer, now];
        }
        let noise_n = self.difference_n2.map(|[short, long]| JUMP_SIGMAS * math::sqrt(short.min(long)));
        let step_s = step_ns as f64 * 1e-9;
        for (index, then) in compared.iter().enumerate() {
            let span_s = now.span_since_s(then);
            let [by_n, by_nm] = then.to(&now);
            let bound_n = noise_n[index] + LOADING_RATE_MAX_N_PER_S * span_s;
            let clipped_n = by_n.min(bound_n);
            for (mean_n2, over_s) in self.difference_n2[index].iter_mut().zip(DIFFERENCES_OVER_S) {
                *mean_n2 += (clipped_n * clipped_n - *mean_n2) * (step_s / over_s);
            }
            if by_n > bound_n || by_nm > LEVER_MAX_M * bound_n {
                if self.jump.from.time_ns == 0 {
                    self.jump = Jump { from: *then, level: self.level, ..Zeroable::zeroed() };
                }
                (self.jump.detected_ns, self.jump.by) = (now.time_ns, [0.0; 2]);
                // Weight comparisons from before this jump do not apply to the plate after it.
                self.agreed_s = 0.0;
                let change_n = now.vertical_n - self.jump.from.vertical_n;
                if change_n.abs() > self.jump.change_n.abs() {
                    self.jump.change_n = change_n;
                }
            }
        }
        let gain = step_s / LEVEL_OVER_S;
        self.level.vertical_n += gain * (now.vertical_n - self.level.vertical_n);
        if now.stands + self.level.stands == 2 {
            for axis in 0..2 {
                self.level.cop_m[axis] += gain * (now.cop_m[axis] - self.level.cop_m[axis]);
            }
        } else {
            self.level = Reading { vertical_n: self.level.vertical_n, ..now };
        }
        self.update_jump(&now, noise_n[0])
    }

    /// Updates the state of the detected jump; returns the time since which the readings are suspect, ns.
    fn update_jump(&mut self, now: &Reading, noise_n: f64) -> Option<u64> {
        let Jump { from, level, detected_ns, by, change_n } = self.jump;
        if from.time_ns == 0 {
            return None;
        }
        let since_ns = now.time_ns.saturating_sub(detected_ns);
        if since_ns >= JUMP_SETTLES_NS && by == [0.0; 2] {
            let [by_n, by_nm] = from.to(now);
            // Add the change that the body may have caused in the meantime.
            let body_n = noise_n + LOADING_RATE_MAX_N_PER_S * (JUMP_OVER_NS as f64 * 1e-9);
            let lasts = |by: f64, bound: f64| if by > bound { by } else { f64::MIN_POSITIVE };
            self.jump.by = [lasts(by_n, body_n), lasts(by_nm, LEVER_MAX_M * body_n)];
            // Whether it is nearer to the value after the jump than to the one before.
            let stays = (now.vertical_n - from.vertical_n) * change_n > 0.5 * change_n * change_n;
            if stays {
                self.jump.by[0] = by_n;
            }
        }
        let [off_n, off_nm] = level.to(&self.level);
        let is_away = since_ns < LEVEL_EVIDENCE_NS || off_n > 0.5 * by[0] || off_nm > 0.5 * by[1];
        let has_returned = by.iter().all(|by| *by <= f64::MIN_POSITIVE);
        // Stepping on or off the plate may be a single jump.
        let is_step = from.vertical_n < EMPTY_PLATE_N || now.vertical_n < EMPTY_PLATE_N;
        if since_ns > JUMP_HOLDS_NS && (has_returned || !is_away || is_step) {
            self.jump = Zeroable::zeroed();
            return None;
        }
        Some(from.time_ns)
    }

    /// Ingests whether the plate shows the weight of the subject alone, at the expected position, `step_s` after the
    /// previous snapshot. A plate that does so for long enough is accepted again, and so is one without a subject to
    /// compare with.
    pub(super) fn ingest_weight_agreement(&mut self, agrees: Option<bool>, step_s: f64) {
        // The first instant after a gap is one instant, however long the gap was.
        let step_s = step_s.min(0.5 * LEVEL_OVER_S);
        self.agreed_s = if agrees.unwrap_or(true) { self.agreed_s + step_s } else { 0.0 };
        if self.agreed_s >= LEVEL_OVER_S && self.jump.by != [0.0; 2] {
            self.jump = Zeroable::zeroed();
        }
    }

    /// Sets the newest reading.
    #[cfg(test)]
    pub(super) fn set_newest_vertical_n(&mut self, vertical_n: f64) {
        (self.readings[1].time_ns, self.readings[1].vertical_n) = (1, vertical_n);
    }

    pub(super) fn is_sound(&self) -> bool {
        self.difference_n2.iter().flatten().all(|square| *square >= 0.0) && self.agreed_s >= 0.0
    }
}
