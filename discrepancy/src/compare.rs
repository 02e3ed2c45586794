//! Reduces snapshots to blocks: the model's predictions and the plate's measurements, averaged over a fraction of a
//! second.
//!
//! Accelerations are those of a local parabola (Savitzky and Golay); pose and ground are averaged with the weights with
//! which it averages the true second derivative, so that filtering does not appear as an effect. This module does not
//! read files: snapshots are pushed one by one, in any number, and memory stays bounded (one second of snapshots and at
//! most [`Options::blocks_max`] blocks).
//!
//! Layers, lowest first: `worker`, `options` → `window` → `point` → `changes`, `mean` → `store` → this file.

mod changes;
mod mean;
mod options;
mod point;
mod store;
mod window;
mod worker;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use equipoise_core::motion::Snapshot;

use crate::block::Block;
use crate::constants::{MASK_KEPT_S, POINTS_KEPT_S};
use changes::Filters;
use mean::BlockMean;
pub use options::Options;
use point::Point;
use store::Store;
use window::Window;
pub use worker::{Worker, prior_covariance_m2};

/// Compares the predictions for a subject with the plate's measurements.
#[derive(Debug)]
pub struct Comparison {
    worker: Worker,
    options: Options,
    window: Window,
    filters: Filters,
    points: VecDeque<Point>,
    /// Static-pose flag of the loop, by time.
    still: VecDeque<(f64, bool)>,
    /// Masked intervals: nothing is compared in them.
    masked_s: VecDeque<[f64; 2]>,
    filling: Option<BlockMean>,
    waiting: VecDeque<BlockMean>,
    store: Store,
    last: Option<Last>,
    shear: bool,
    shear_missing: bool,
}

/// Properties of the previous snapshot.
#[derive(Debug, Clone, Copy)]
struct Last {
    time_s: f64,
    stance: u64,
}

impl Comparison {
    /// A comparison without snapshots.
    pub fn new(worker: Worker, options: Options) -> Comparison {
        Comparison {
            window: Window::new(options.half_window_s, options.block_s),
            filters: Filters::default(),
            points: VecDeque::new(),
            still: VecDeque::new(),
            masked_s: VecDeque::new(),
            filling: None,
            waiting: VecDeque::new(),
            store: Store::new(&options),
            last: None,
            shear: false,
            shear_missing: false,
            worker,
            options,
        }
    }

    /// Ingests the next snapshot; ignores one whose time does not advance.
    pub fn push(&mut self, snapshot: &Snapshot) {
        let time_s = self.options.seconds(snapshot.time_ns);
        if let Some(last) = self.last {
            if time_s <= last.time_s {
                return;
            }
            if time_s - last.time_s > self.options.gap_max_s {
                self.interrupt();
            } else if snapshot.stance != last.stance {
                self.mask(time_s, self.options.stance_margin_s);
                self.filters = Filters::default();
            }
        }
        self.last = Some(Last { time_s, stance: snapshot.stance });
        if snapshot.both_feet_stand != 1 {
            self.mask(time_s, self.options.stance_margin_s);
        }
        if !self.window.push(time_s, snapshot, &self.worker) {
            self.mask(time_s, self.options.half_window_s);
        }
        while let Some(point) = self.window.next(&self.worker, &self.options) {
            self.add_point(point);
        }
        self.release(time_s);
    }

    /// Records whether the pose was static at a time.
    pub fn hold(&mut self, time_ns: u64, still: bool) {
        self.still.push_back((self.options.seconds(time_ns), still));
    }

    /// Whether the horizontal force was measured throughout: otherwise its rows would hold zeros that are not
    /// measurements.
    pub fn has_shear(&self) -> bool {
        self.shear && !self.shear_missing
    }

    /// All blocks by time, once the last snapshot is pushed.
    pub fn finish(mut self) -> Vec<Block> {
        self.interrupt();
        self.store.into_blocks()
    }

    fn add_point(&mut self, point: Point) {
        self.shear |= point.slope_is_measured;
        self.shear_missing |= !point.slope_is_measured;
        if !point.is_moderate() {
            self.mask(point.time_s, self.options.half_window_s);
        }
        let by_cutoff = self.filters.step(&point);
        let number = (point.time_s / self.options.block_s).floor();
        if let Some(full) = self.filling.take_if(|mean| mean.number != number) {
            self.close(full);
        }
        let filling = self.filling.get_or_insert_with(|| BlockMean::new(number, &self.options));
        filling.add(&point, &by_cutoff);
        self.points.push_back(point);
    }

    /// Completes a block while the snapshots that its means require are still in memory.
    fn close(&mut self, mut full: BlockMean) {
        if full.is_complete(&self.options) {
            full.add_snapshots(&self.window);
            self.waiting.push_back(full);
        }
    }

    /// Masks the interval of `margin_s` on both sides of a time.
    fn mask(&mut self, time_s: f64, margin_s: f64) {
        let [from_s, to_s] = [time_s - margin_s, time_s + margin_s];
        match self.masked_s.back_mut() {
            Some(last) if from_s <= last[1] => *last = [last[0].min(from_s), last[1].max(to_s)],
            _ => self.masked_s.push_back([from_s, to_s]),
        }
    }

    /// Handles a time discontinuity: completes pending blocks, since their following samples will not arrive.
    fn interrupt(&mut self) {
        if let Some(full) = self.filling.take() {
            self.close(full);
        }
        while let Some(mean) = self.waiting.pop_front() {
            self.keep_or_drop(mean);
        }
        self.window.clear();
        self.points.clear();
        self.filters = Filters::default();
    }

    /// Releases blocks whose neighbourhood is complete at `now_s`, and drops data that is no longer required.
    fn release(&mut self, now_s: f64) {
        let delay_s = self.options.delay_s();
        while let Some(mean) = self.waiting.pop_front_if(|mean| mean.span_s[1] + delay_s <= now_s) {
            self.keep_or_drop(mean);
        }
        while self.points.pop_front_if(|point| point.time_s < now_s - POINTS_KEPT_S).is_some() {}
        while self.still.pop_front_if(|(time_s, _)| *time_s < now_s - POINTS_KEPT_S).is_some() {}
        while self.masked_s.pop_front_if(|span_s| span_s[1] < now_s - MASK_KEPT_S).is_some() {}
    }

    /// Keeps a block if no masked interval overlaps its neighbourhood and the predictions cover all lags.
    fn keep_or_drop(&mut self, mean: BlockMean) {
        let [from_s, to_s] = mean.span_s;
        let overlaps = |span_s: &[f64; 2]| span_s[0] < to_s && span_s[1] > from_s;
        let Some(phase) = self.options.phase_of(mean.span_s) else { return };
        if self.masked_s.iter().any(overlaps) || !self.store.accepts(phase) {
            return;
        }
        let Some(timing) = changes::timing(&self.points, mean.span_s) else { return };
        let mut held = self.still.iter().filter(|(time_s, _)| (from_s..to_s).contains(time_s)).peekable();
        let still = held.peek().is_some() && held.all(|(_, still)| *still);
        self.store.push(mean.block(phase, still, &timing, &self.worker));
    }
}
