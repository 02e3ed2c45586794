//! How much later than the ground's the suit's sample times are: the part of the delays that no clock fit can see.
//!
//! A clock fit lays each stream's device counter on the host's clock but leaves the constant part of the delay in.
//! If the suit's stamps are late by τ, the pose stamped t is the body's at t − τ. So for a quantity q that the plate
//! measures and the suit's motion predicts,
//!
//! `measured(t) = q(t)`, `predicted(t) = q(t − τ)`, hence `measured − predicted = τ·dq/dt + noise`.
//!
//! **Positive τ: the suit is late**, and `[suit] latency_ms` larger by τ puts it right.
//!
//! # How to feed it
//! One [`SkewEstimator`] per quantity, one [`SkewEstimator::update`] per aligned suit sample; [`joint`] puts them
//! together. Quantities that show τ:
//! - vertical force over mass, `F_z/m − g` (m/s²), against the vertical acceleration of the centre of mass;
//! - centre of pressure x and y (m), against what inertia compensation predicts of it.
//!
//! Both sides must go through the **same** filter: if the suit's acceleration is smoothed over a window, smooth the
//! plate's force over that window too, else the difference of the filters is taken for skew. The slope must come from
//! the smoothed prediction: noise in the slope draws the estimate towards zero. Leave out samples while nobody stands
//! on the plate, or while a load is being taken up or put down. A constant offset between the two sides (a mass that
//! is a little wrong) does no harm: both are high-passed.
//!
//! # How it works
//! Least squares of the high-passed rows with slow forgetting and a prior (σ 50 ms). A row waits until predictions on
//! both sides of it are known, and is then linearised at the newest estimate (`measured(t)` against
//! `predicted(t + τ̂)`), so that a large skew is not underestimated. The σ is that of the scores `slope × residual` as
//! they really scatter, with their correlation from sample to sample, and never below the caller's σ: neither
//! coloured noise nor noise that grows with motion makes it too sure.

use bytemuck::{Pod, Zeroable};

/// What is believed before any motion, s.
const PRIOR_SIGMA_S: f64 = 0.05;
/// An estimate less sure than this is not told, s.
const TOLD_SIGMA_S: f64 = 0.005;
/// Old rows fade with this time constant, so that the skew may drift, s.
const MEMORY_S: f64 = 180.0;
/// Both sides lose their mean over this time constant, s.
const HIGH_PASS_S: f64 = 2.0;
/// How long noise is believed to stay alike before it was seen, s …
const CORRELATION_S: f64 = 0.3;
/// … and how much of rows it takes to believe what is seen instead, s.
const CORRELATION_BELIEF_S: f64 = 5.0;
/// Rows are linearised at most this far from zero skew, s; a row waits as long for its prediction.
const REACH_S: f64 = 0.1;
/// Samples closer than this to the one before are passed over, s: the ring must span twice the reach.
const STEP_MIN_S: f64 = 0.003;
/// After a gap longer than this the rows start anew, s.
const GAP_MAX_S: f64 = 0.1;
/// Samples kept for the rows that wait.
const RING: usize = 80;
/// No quantity is larger, and none is known better, in any unit.
const VALUE_MAX: f64 = 1e9;
const SIGMA_MIN: f64 = 1e-9;
/// Fewer independent rows than this tell nothing.
const ROWS_MIN: f64 = 8.0;

/// One sample as it came.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Sample {
    time_s: f64,
    measured: f64,
    predicted: f64,
    slope_per_s: f64,
    sigma: f64,
}

/// `c0 + c1 τ + c2 τ²`: a sum of products of residuals, for whatever τ they are taken at in the end.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Quadratic {
    c: [f64; 3],
}

impl Quadratic {
    fn at(self, tau_s: f64) -> f64 {
        self.c[0] + tau_s * (self.c[1] + tau_s * self.c[2])
    }

    /// Adds `(a0 − a1 τ)(b0 − b1 τ)`.
    fn add(&mut self, [a0, a1]: [f64; 2], [b0, b1]: [f64; 2]) {
        self.c[0] += a0 * b0;
        self.c[1] -= a0 * b1 + a1 * b0;
        self.c[2] += a1 * b1;
    }
}

/// The skew as one quantity shows it. All zero is the estimator that has seen nothing.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SkewEstimator {
    ring: [Sample; RING],
    /// Samples taken in since the last start; the newest is at `(taken − 1) % RING`.
    taken: u64,
    /// Of these, how many became rows or were passed over.
    rows: u64,
    /// Time since the last sample that was taken in, s.
    pending_s: f64,
    /// Slow means of slope and of `measured − predicted + slope τ̂`.
    mean: [f64; 2],
    /// Rows that entered the means since the last start.
    averaged: f64,
    /// Score of the row before, as `s0 − s1 τ`.
    before: [f64; 2],
    /// Faded sums over the rows, in units of σ: x², x y, x⁴, and the time that they cover, s.
    xx: f64,
    xy: f64,
    xxxx: f64,
    covered_s: f64,
    /// Faded number of rows.
    count: f64,
    /// Sums of squared scores, and of products of neighbouring ones.
    square: Quadratic,
    neighbour: Quadratic,
}

impl SkewEstimator {
    /// Takes in one sample: the quantity measured by the plate and predicted by the suit's motion at one stamp, the
    /// prediction's rate of change, and the 1-σ of their difference (all in the quantity's own unit, per second).
    ///
    /// `dt_s` is the time since the sample before. What is not plausible (NaN, a σ of zero) is passed over; a gap only starts
    /// the waiting rows anew.
    pub fn update(&mut self, measured: f64, predicted: f64, slope_per_s: f64, sigma: f64, dt_s: f64) {
        // Comparisons are false for NaN.
        let is_plausible = |value: &f64| value.abs() < VALUE_MAX;
        let is_sound = [measured, predicted, slope_per_s, dt_s].iter().all(is_plausible);
        if !is_sound || !(SIGMA_MIN..VALUE_MAX).contains(&sigma) || dt_s <= 0.0 {
            return;
        }
        self.pending_s += dt_s;
        if self.pending_s > GAP_MAX_S {
            self.start_rows();
        } else if self.taken > 0 && self.pending_s < STEP_MIN_S {
            return;
        }
        let time_s = if self.taken > 0 { self.newest().time_s + self.pending_s } else { 0.0 };
        self.fade(self.pending_s);
        self.pending_s = 0.0;
        self.ring[self.taken as usize % RING] = Sample { time_s, measured, predicted, slope_per_s, sigma };
        self.taken += 1;
        // Bounded by the ring.
        self.rows = self.rows.max(self.taken.saturating_sub(RING as u64));
        while self.rows < self.taken && self.at(self.rows).time_s + REACH_S <= time_s {
            self.row(*self.at(self.rows));
            self.rows += 1;
        }
    }

    /// How much later than the ground's the suit's sample times are, with its 1-σ, s; `None` until σ < 5 ms.
    pub fn estimate(&self) -> Option<(f64, f64)> {
        told(self.posterior())
    }

    /// Whether every number is in range; a stored estimator is checked before use.
    pub fn is_sound(&self) -> bool {
        let ring = self.ring.iter().flat_map(|sample| {
            [sample.time_s, sample.measured, sample.predicted, sample.slope_per_s, sample.sigma]
        });
        let sums = [self.pending_s, self.averaged, self.xx, self.xy, self.xxxx, self.covered_s, self.count];
        let products = self.square.c.into_iter().chain(self.neighbour.c);
        let mut numbers = ring.chain(self.mean).chain(self.before).chain(sums).chain(products);
        self.rows <= self.taken
            && self.taken < 1 << 48
            && numbers.all(|value| value.is_finite() && value.abs() < 1e100)
            && [self.xx, self.xxxx, self.covered_s, self.count].iter().all(|sum| *sum >= 0.0)
    }

    /// Mean and variance by data and prior, s and s².
    fn posterior(&self) -> [f64; 2] {
        let prior = PRIOR_SIGMA_S * PRIOR_SIGMA_S;
        let Some([tau_s, variance]) = self.by_data() else { return [0.0, prior] };
        [tau_s * prior / (prior + variance), prior * variance / (prior + variance)]
    }

    /// Mean and variance by the rows alone, s and s²; `None` where they are too few.
    fn by_data(&self) -> Option<[f64; 2]> {
        if self.count < ROWS_MIN || self.xx * self.xx <= f64::MIN_POSITIVE {
            return None;
        }
        let tau_s = self.xy / self.xx;
        // The scores of noise as the caller states it have a mean square of x²; no less is believed.
        let square = self.square.at(tau_s).max(self.xx);
        let seen = self.neighbour.at(tau_s) / square;
        let step_s = self.covered_s / self.count;
        let belief = self.covered_s / (self.covered_s + CORRELATION_BELIEF_S);
        let expected = (1.0 - step_s / CORRELATION_S).max(0.0);
        let rho = (belief * seen + (1.0 - belief) * expected).clamp(0.0, 0.998);
        let colour = (1.0 + rho) / (1.0 - rho);
        let independent = self.xx * self.xx / self.xxxx / colour;
        if !(ROWS_MIN..f64::INFINITY).contains(&independent) {
            return None;
        }
        // The residuals are smaller than the noise by what the fit took up.
        let taken_up = independent / (independent - 2.0);
        Some([tau_s, square * colour * taken_up / (self.xx * self.xx)])
    }

    /// One row, linearised at the newest estimate.
    fn row(&mut self, sample: Sample) {
        let shift_s = self.posterior()[0].clamp(-REACH_S, REACH_S);
        let Some([predicted, slope]) = self.prediction_at(sample.time_s + shift_s) else { return };
        let row = [slope, sample.measured - predicted + slope * shift_s];
        let step_s = self.step_s(&sample);
        self.averaged += 1.0;
        let gain = (step_s / HIGH_PASS_S).max(1.0 / self.averaged).min(1.0);
        for (mean, value) in self.mean.iter_mut().zip(row) {
            *mean += gain * (value - *mean);
        }
        let [x, y] = [0, 1].map(|side| (row[side] - self.mean[side]) / sample.sigma);
        let score = [x * y, x * x];
        self.xx += x * x;
        self.xy += x * y;
        self.xxxx += x * x * x * x;
        self.covered_s += step_s;
        self.count += 1.0;
        self.square.add(score, score);
        self.neighbour.add(score, self.before);
        self.before = score;
    }

    /// Prediction and slope at a time within the ring: a cubic through the predictions with their slopes.
    fn prediction_at(&self, time_s: f64) -> Option<[f64; 2]> {
        let oldest = self.taken.saturating_sub(RING as u64);
        let mut later = self.taken.checked_sub(1)?;
        if self.at(later).time_s < time_s {
            return None;
        }
        while later > oldest + 1 && self.at(later - 1).time_s > time_s {
            later -= 1;
        }
        let (from, to) = (self.at(later.checked_sub(1).filter(|index| *index >= oldest)?), self.at(later));
        if from.time_s > time_s {
            return None;
        }
        let span_s = to.time_s - from.time_s;
        if span_s <= 0.0 {
            return None;
        }
        let t = (time_s - from.time_s) / span_s;
        let rise = to.predicted - from.predicted;
        let (a, b) = (from.slope_per_s * span_s - rise, rise - to.slope_per_s * span_s);
        let predicted = from.predicted + t * (rise + (1.0 - t) * ((1.0 - t) * a + t * b));
        Some([predicted, from.slope_per_s + t * (to.slope_per_s - from.slope_per_s)])
    }

    /// Time from the sample before a row's to the row's, s.
    fn step_s(&self, sample: &Sample) -> f64 {
        match self.rows.checked_sub(1) {
            Some(before) if before + RING as u64 >= self.taken => sample.time_s - self.at(before).time_s,
            _ => 0.0,
        }
    }

    fn start_rows(&mut self) {
        (self.taken, self.rows, self.averaged) = (0, 0, 0.0);
        (self.mean, self.before) = ([0.0; 2], [0.0; 2]);
        self.pending_s = self.pending_s.min(MEMORY_S);
    }

    fn fade(&mut self, span_s: f64) {
        let keep = 1.0 - span_s / (span_s + MEMORY_S);
        let sums = [&mut self.xx, &mut self.xy, &mut self.xxxx, &mut self.covered_s, &mut self.count];
        for sum in sums.into_iter().chain(&mut self.square.c).chain(&mut self.neighbour.c) {
            *sum *= keep;
        }
    }

    fn at(&self, index: u64) -> &Sample {
        &self.ring[index as usize % RING]
    }

    fn newest(&self) -> &Sample {
        self.at(self.taken.saturating_sub(1))
    }
}

/// What several quantities say together, as [`SkewEstimator::estimate`].
///
/// Each is weighted by what it knows beyond the prior, which counts once. If they contradict each other by more than
/// their σ, the joint σ grows by as much (the Birge ratio).
pub fn joint(estimators: &[SkewEstimator]) -> Option<(f64, f64)> {
    let known = || estimators.iter().filter_map(SkewEstimator::by_data);
    let (mut weight, mut sum) = (0.0, 0.0);
    for [tau_s, variance] in known() {
        weight += 1.0 / variance;
        sum += tau_s / variance;
    }
    if weight <= 0.0 {
        return None;
    }
    let (mean_s, freedom) = (sum / weight, (known().count() - 1).max(1) as f64);
    let chi_square: f64 = known().map(|[tau_s, v]| (tau_s - mean_s) * (tau_s - mean_s) / v).sum();
    let variance = (chi_square / freedom).max(1.0) / weight;
    let prior = PRIOR_SIGMA_S * PRIOR_SIGMA_S;
    told([mean_s * prior / (prior + variance), prior * variance / (prior + variance)])
}

fn told([skew_s, variance]: [f64; 2]) -> Option<(f64, f64)> {
    let sigma_s = crate::math::sqrt(variance);
    (sigma_s < TOLD_SIGMA_S).then_some((skew_s, sigma_s))
}

#[cfg(test)]
mod tests;
