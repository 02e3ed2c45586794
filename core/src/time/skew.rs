//! Skew and drift between the suit's and the ground's sample times, from the vertical motion of the body.
//!
//! A clock fit maps each device counter to the host clock but leaves constant delays in the sample times, and a
//! recording may hold clocks that drift apart. If the suit's stamps are late by τ relative to the ground's, the
//! ground's sample stamped t belongs to the suit's sample stamped t + τ. **Positive τ: the suit is late.**
//!
//! # Model
//! Vertical force over time, `F(t) = c + s·z̈(t + τ) + e(t)`, where z is the height of the centre of mass by the suit's
//! stamps (m) and c, s are unknown: body mass, a constant load and the force's unit do not matter.
//! Both streams pass the same filter: means over cells of `CELL_NS`; the weighted mean of the acceleration over a
//! triangle of half-width h, for the suit by the identity `(z(t+h) − 2z(t) + z(t−h))/h² = ∫ z̈(t+u) (1 − |u|/h)/h du`,
//! which needs no derivative; and a symmetric second difference over ±`SPAN` cells, which removes constants and trends.
//!
//! # Estimate
//! Over each window of [`WINDOW_S`] the profile likelihood of the lag under Gaussian noise of unknown size is
//! `−2 ln L(τ) = N ln(1 − r²(τ))`, with the correlation r and N independent samples (maximum likelihood of a delay
//! with unknown gain: Knapp and Carter 1976). Its minimum is the lag, its curvature gives the variance `2/(−2 ln L)″`.
//! A window counts only if no lag outside the minimum's own valley is within `EVIDENCE` of it.
//! Windows update a Kalman filter with the state (τ, drift).

mod track;

use bytemuck::{Pod, Zeroable};

use crate::math;
use track::Track;

/// Length of a cell, ns.
const CELL_NS: u64 = 20_000_000;
const CELL_S: f64 = CELL_NS as f64 * 1e-9;
/// Half-width of the triangle, cells.
const HALF: u64 = 6;
/// Half-span of the second difference, cells.
const SPAN: u64 = 15;
/// Cells on each side of a filtered one.
const AROUND: u64 = HALF + SPAN;
/// Cells stored of each stream: twice the filter's width and the lags, and over a second for a stream that arrives
/// late.
const RING: usize = 192;
/// Lags from −0.5 to 0.5 s.
const LAGS: usize = 51;
const LAG_MAX: u64 = LAGS as u64 / 2;
/// Cells of a block, and blocks of a window.
const BLOCK: u64 = 64;
const BLOCKS: usize = 4;
/// Length of a window, s.
pub const WINDOW_S: f64 = (BLOCK * BLOCKS as u64) as f64 * CELL_S;
/// Maximum interval between samples for interpolation, ns.
const GAP_MAX_NS: u64 = 120_000_000;
/// Number of blocks that suffice to contradict the track.
const BLOCKS_AGAINST: usize = 2;
/// Independent samples of noise in a block: its length over the integral of the squared autocorrelation (0.246 s) of
/// white noise after the filter.
const INDEPENDENT: f64 = 5.21;
/// Difference of −2 ln L that excludes another lag.
const EVIDENCE: f64 = 12.0;
/// Lower bound of 1 − r²: a correlation of 1 would mean no noise.
const UNEXPLAINED_MIN: f64 = 1e-4;
/// A window this far from the prediction, in σ and in s, contradicts it: the delay has changed.
const CONTRADICTION: (f64, f64) = (4.0, 3.0 * CELL_S);

/// Quantity of a stream: both sides of the model pass the same filter, computed by different sums.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Height of the centre of mass, m.
    Height,
    /// Vertical force, N.
    Force,
}

/// One stream on the grid of cells.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Stream {
    /// Mean of each cell.
    mean: [f64; RING],
    /// Acceleration, or force, averaged over the triangle around each cell.
    smooth: [f64; RING],
    /// The same without constants and trends.
    band: [f64; RING],
    /// The newest sample; a time of 0 before the first.
    newest_ns: u64,
    newest: f64,
    /// Integral over the cell that is being filled.
    partial: f64,
    /// The cell that is being filled, counted from time 0, and the first complete one since the last gap.
    cell: u64,
    first: u64,
}

impl Stream {
    /// Integrates the line from the newest sample to this one into cells: at most seven, because longer gaps restart.
    fn push(&mut self, time_ns: u64, value: f64, kind: Kind) {
        let span_ns = time_ns.saturating_sub(self.newest_ns);
        if self.newest_ns == 0 || span_ns > GAP_MAX_NS {
            self.cell = time_ns / CELL_NS;
            (self.first, self.partial) = (self.cell + 1, 0.0);
        } else if span_ns == 0 {
            return;
        } else {
            let slope = (value - self.newest) / span_ns as f64;
            let mut from_ns = self.newest_ns;
            while from_ns < time_ns {
                let end_ns = (self.cell + 1) * CELL_NS;
                let to_ns = time_ns.min(end_ns);
                let middle_ns = 0.5 * ((from_ns - self.newest_ns) + (to_ns - self.newest_ns)) as f64;
                self.partial += (self.newest + slope * middle_ns) * (to_ns - from_ns) as f64;
                from_ns = to_ns;
                if to_ns == end_ns {
                    self.complete(kind);
                }
            }
        }
        (self.newest_ns, self.newest) = (time_ns, value);
    }

    /// Completes the cell that is being filled, and filters as far as cells are available.
    fn complete(&mut self, kind: Kind) {
        let slot = |cell: u64| (cell % RING as u64) as usize;
        self.mean[slot(self.cell)] = self.partial / CELL_NS as f64;
        (self.partial, self.cell) = (0.0, self.cell + 1);
        let half_s = HALF as f64 * CELL_S;
        let Some(centre) = self.cell.checked_sub(1 + HALF).filter(|centre| *centre >= self.first + HALF)
        else {
            return;
        };
        let mean = |cell: u64| self.mean[slot(cell)];
        self.smooth[slot(centre)] = match kind {
            Kind::Height => {
                (mean(centre - HALF) - 2.0 * mean(centre) + mean(centre + HALF)) / (half_s * half_s)
            }
            Kind::Force => {
                let weighted = |cell: u64| (HALF - centre.abs_diff(cell)) as f64 * mean(cell);
                (centre - HALF..=centre + HALF).map(weighted).sum::<f64>() / (HALF * HALF) as f64
            }
        };
        if centre >= self.first + AROUND + SPAN {
            let [before, here, after] = [2 * SPAN, SPAN, 0].map(|back| self.smooth[slot(centre - back)]);
            self.band[slot(centre - SPAN)] = here - 0.5 * (before + after);
        }
    }

    /// The available filtered cells: from the first, up to but without the second.
    fn range(&self) -> [u64; 2] {
        let end = self.cell.saturating_sub(AROUND);
        [(self.first + AROUND).max(end.saturating_sub(RING as u64)), end]
    }

    fn at(&self, cell: u64) -> f64 {
        self.band[(cell % RING as u64) as usize]
    }

    fn is_sound(&self) -> bool {
        let mut numbers = self.mean.iter().chain(&self.smooth).chain(&self.band);
        numbers.all(|value| value.abs() < 1e100)
            && self.newest.abs() < 1e100
            && self.partial.abs() < 1e100
            && self.newest_ns < u64::MAX / 2
            && self.cell == self.newest_ns / CELL_NS
            && self.first <= self.cell + 1
    }
}

/// Sums over a block: of the suit's filtered values squared and times the ground's, for each lag; of the ground's
/// squared.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Block {
    square: [f64; LAGS],
    product: [f64; LAGS],
    ground_square: f64,
}

/// Result of a window.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Window {
    /// Middle of the window by the ground's stamps, ns.
    time_ns: u64,
    lag_s: f64,
    variance_s2: f64,
}

/// The lag at a time, and its drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skew {
    /// Delay of the suit's stamps relative to the ground's, s.
    pub skew_s: f64,
    /// Its 1-σ, s.
    pub sigma_s: f64,
    /// Rate of change of `skew_s`, s/s.
    pub drift: f64,
    /// Its 1-σ, s/s.
    pub drift_sigma: f64,
}

/// Skew and drift between both streams. All zero is the estimator without samples. About 15 kB.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SkewEstimator {
    suit: Stream,
    ground: Stream,
    /// The next cell of the ground to correlate.
    next: u64,
    /// Cells in the block that is being filled; complete blocks since the last gap.
    cells: u64,
    complete: u64,
    blocks: [Block; BLOCKS],
    track: Track,
    /// A window that awaits a second one that agrees; a time of 0 for none.
    candidate: Window,
}

impl SkewEstimator {
    /// Ingests the height of the centre of mass, m, up to a constant and a scale, at the suit's stamp.
    pub fn push_height(&mut self, time_ns: u64, height_m: f64) {
        self.suit.push(time_ns, height_m, Kind::Height);
        self.correlate();
    }

    /// Ingests the vertical force, N, up to a constant and a scale, at the ground's stamp.
    pub fn push_force(&mut self, time_ns: u64, force_n: f64) {
        self.ground.push(time_ns, force_n, Kind::Force);
        self.correlate();
    }

    /// Ingests that the suit's stamps are earlier by `by_s` from now on; windows with both kinds of stamps are dropped.
    pub fn shift_heights(&mut self, by_s: f64) {
        let mut track = self.track;
        track.state[0] -= by_s;
        *self = SkewEstimator { track, ..Zeroable::zeroed() };
    }

    /// Skew and drift at a time, however large the σ; `None` until two windows agree, and after a contradiction.
    pub fn at(&self, time_ns: u64) -> Option<Skew> {
        if self.track.time_ns == 0 {
            return None;
        }
        let Track { state: [skew_s, drift], covariance: [v00, _, v11], .. } = self.track.predict(time_ns);
        Some(Skew { skew_s, sigma_s: math::sqrt(v00), drift, drift_sigma: math::sqrt(v11) })
    }

    /// The lag of the only window while nothing is tracked, s.
    pub fn tentative_s(&self) -> Option<f64> {
        (self.track.time_ns == 0 && self.candidate.time_ns > 0).then_some(self.candidate.lag_s)
    }

    /// Whether every number is in range; a stored estimator is checked before use.
    pub fn is_sound(&self) -> bool {
        let sums = |block: &Block| {
            block
                .square
                .iter()
                .chain(&block.product)
                .chain([&block.ground_square])
                .all(|sum| sum.abs() < 1e200)
        };
        self.suit.is_sound()
            && self.ground.is_sound()
            && self.next < u64::MAX / 2 / CELL_NS
            && self.cells < BLOCK
            && self.complete < u64::MAX / 2
            && self.blocks.iter().all(sums)
            && self.track.is_sound()
            && self.candidate.lag_s.abs() < 1.0
            && (0.0..1.0).contains(&self.candidate.variance_s2)
    }

    /// Correlates every cell available in both streams; bounded by the ring.
    fn correlate(&mut self) {
        let ([suit_from, suit_end], [ground_from, ground_end]) = (self.suit.range(), self.ground.range());
        let first = ground_from.max(suit_from + LAG_MAX);
        if self.suit.newest_ns == 0 || self.ground.newest_ns == 0 {
            return;
        }
        if self.next < first {
            (self.next, self.cells, self.complete) = (first, 0, 0);
        }
        while self.next < ground_end && self.next + LAG_MAX < suit_end {
            self.add_cell();
        }
    }

    fn add_cell(&mut self) {
        let block = &mut self.blocks[(self.complete % BLOCKS as u64) as usize];
        if self.cells == 0 {
            *block = Zeroable::zeroed();
        }
        let force = self.ground.at(self.next);
        block.ground_square += force * force;
        for lag in 0..LAGS {
            let value = self.suit.at(self.next + lag as u64 - LAG_MAX);
            block.square[lag] += value * value;
            block.product[lag] += value * force;
        }
        (self.next, self.cells) = (self.next + 1, self.cells + 1);
        if self.cells == BLOCK {
            (self.cells, self.complete) = (0, self.complete + 1);
            if self.complete >= BLOCKS_AGAINST as u64 {
                self.evaluate();
            }
        }
    }

    /// The newest blocks as a window; `None` if more than one lag remains possible.
    fn window(&self, blocks: usize) -> Option<Window> {
        let newest = (self.complete.saturating_sub(blocks as u64)..self.complete)
            .map(|block| &self.blocks[(block % BLOCKS as u64) as usize]);
        let sum = |of: &dyn Fn(&Block) -> f64| newest.clone().map(of).sum::<f64>();
        let independent = INDEPENDENT * blocks as f64;
        let ground_square = sum(&|block| block.ground_square);
        let mut explained = [0.0; LAGS];
        for (lag, explained) in explained.iter_mut().enumerate() {
            let [product, square] = [sum(&|block| block.product[lag]), sum(&|block| block.square[lag])];
            let scale = square * ground_square;
            if product > 0.0 && scale > 0.0 {
                *explained = (product * product / scale).min(1.0 - UNEXPLAINED_MIN);
            }
        }
        let best = (1..LAGS - 1).max_by(|a, b| explained[*a].total_cmp(&explained[*b]))?;
        // The valley of the likelihood: as far as it decreases monotonically towards the minimum on both sides.
        let (mut from, mut to) = (best, best);
        while from > 0 && explained[from - 1] <= explained[from] {
            from -= 1;
        }
        while to + 1 < LAGS && explained[to + 1] <= explained[to] {
            to += 1;
        }
        let others = explained[..from].iter().chain(&explained[to + 1..]);
        let second = others.fold(0.0, |largest: f64, value| largest.max(*value));
        let [before, here, after] = [best - 1, best, best + 1].map(|lag| explained[lag]);
        let curvature = 2.0 * here - before - after;
        if curvature <= 0.0 || here < before || here < after {
            return None;
        }
        let vertex_offset = 0.5 * (after - before) / curvature;
        let unexplained = (1.0 - here - 0.25 * (after - before) * vertex_offset).max(UNEXPLAINED_MIN);
        if independent * math::ln((1.0 - second) / unexplained) < EVIDENCE {
            return None;
        }
        Some(Window {
            time_ns: self.next.saturating_sub(BLOCK * blocks as u64 / 2) * CELL_NS,
            lag_s: (best as f64 - LAG_MAX as f64 + vertex_offset) * CELL_S,
            variance_s2: CELL_S * CELL_S * unexplained / (independent * 0.5 * curvature),
        })
    }

    /// Starts, updates or drops the track by the newest windows.
    fn evaluate(&mut self) {
        if self.track.time_ns > 0 && self.is_contradicted_now() {
            return;
        }
        let tracked = self.track.time_ns > 0;
        // Two short windows that agree start a track, and likewise end one.
        let blocks = if tracked { BLOCKS } else { BLOCKS_AGAINST };
        let Some(window) = self.window(blocks).filter(|_| self.complete >= blocks as u64) else { return };
        let before = match (tracked, self.candidate.time_ns) {
            (true, _) => self.track,
            (false, 0) => {
                self.candidate = window;
                return;
            }
            (false, _) => Track::start(&self.candidate),
        };
        let mut track = before.predict(window.time_ns);
        if is_contradicted(&track, &window) {
            if !tracked {
                self.candidate = window;
            }
        } else if window.time_ns.saturating_sub(before.time_ns) >= BLOCK * blocks as u64 * CELL_NS {
            track.update(&window);
            (self.track, self.candidate) = (track, Zeroable::zeroed());
        }
    }

    /// Whether the newest short window contradicts the track. Two consecutive ones without a common sample, which agree
    /// on another lag, end the track: lifting a load changes the force without any motion, but not twice in the same
    /// way. Such a window still fits some lag, but poorly; it counts only if its σ is less than half of the smallest
    /// contradiction.
    fn is_contradicted_now(&mut self) -> bool {
        let sure = |short: &Window| math::sqrt(short.variance_s2) < 0.5 * CONTRADICTION.1;
        let Some(short) = self.window(BLOCKS_AGAINST).filter(sure) else { return false };
        if !is_contradicted(&self.track.predict(short.time_ns), &short) {
            self.candidate = Zeroable::zeroed();
            return false;
        }
        let apart_ns = short.time_ns.saturating_sub(self.candidate.time_ns);
        if self.candidate.time_ns == 0 {
            self.candidate = short;
        } else if apart_ns >= BLOCK * BLOCKS_AGAINST as u64 * CELL_NS {
            if !is_contradicted(&Track::start(&self.candidate).predict(short.time_ns), &short) {
                self.track = Zeroable::zeroed();
            }
            self.candidate = short;
        }
        true
    }
}

fn is_contradicted(predicted: &Track, window: &Window) -> bool {
    let [innovation_s, variance] = predicted.innovation(window);
    let (sigmas, least_s) = CONTRADICTION;
    innovation_s.abs() > least_s && innovation_s * innovation_s > sigmas * sigmas * variance
}

#[cfg(test)]
mod tests;
