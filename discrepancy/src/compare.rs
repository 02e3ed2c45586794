//! Reduces snapshots to blocks: the model's predictions and the plate's measurements, averaged over a fraction of a
//! second.
//!
//! Accelerations are those of a local parabola (Savitzky and Golay); pose and ground are averaged with the weights with
//! which it averages the true second derivative, so that filtering does not appear as an effect. This module does not
//! read files: snapshots are pushed one by one, in any number, and memory stays bounded (one second of snapshots and at
//! most [`Options::blocks_max`] blocks).
//!
//! Layers, lowest first: `worker`, `options`, `masks` → `window` → `point` → `changes`, `mean` → `store` → this file.

mod changes;
mod masks;
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

use crate::block::{Block, Phase};
use crate::constants::{MASK_KEPT_S, POINTS_KEPT_S};
use crate::session::LeftOut;
use changes::Filters;
use masks::{Masks, Reason};
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
    masks: Masks,
    left_out: LeftOut,
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
            masks: Masks::default(),
            left_out: LeftOut::default(),
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
            let has_gap = time_s - last.time_s > self.options.gap_max_s;
            if snapshot.stance != last.stance {
                // In a gap the step may be anywhere.
                for at_s in [if has_gap { last.time_s } else { time_s }, time_s] {
                    self.masks.add(Reason::Step, at_s, self.options.stance_margin_s);
                }
                self.filters = Filters::default();
            }
            if has_gap {
                self.interrupt();
            }
        }
        self.last = Some(Last { time_s, stance: snapshot.stance });
        if !self.worker.stands_on_both_feet(snapshot) {
            self.masks.add(Reason::LiftedFoot, time_s, self.options.stance_margin_s);
        }
        if !self.window.push(time_s, snapshot, &self.worker) {
            self.masks.add(Reason::NoCop, time_s, self.options.half_window_s);
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

    /// All blocks by time, once the last snapshot is pushed, and how many of the work were left out.
    pub fn finish(mut self) -> (Vec<Block>, LeftOut) {
        self.interrupt();
        (self.store.into_blocks(), self.left_out)
    }

    fn add_point(&mut self, point: Point) {
        self.shear |= point.slope_is_measured;
        self.shear_missing |= !point.slope_is_measured;
        if !point.is_moderate() {
            self.masks.add(Reason::Impact, point.time_s, self.options.half_window_s);
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
        self.masks.drop_before(now_s - MASK_KEPT_S);
    }

    /// Keeps a block if no masked interval overlaps its neighbourhood and the predictions cover all lags.
    fn keep_or_drop(&mut self, mean: BlockMean) {
        let [from_s, to_s] = mean.span_s;
        let Some(phase) = self.options.phase_of(mean.span_s) else { return };
        if let Some(reason) = self.masks.reason(mean.span_s) {
            if phase == Phase::Work {
                self.left_out.add(reason);
            }
            return;
        }
        if !self.store.accepts(phase) {
            return;
        }
        let Some(timing) = changes::timing(&self.points, mean.span_s) else { return };
        let mut held = self.still.iter().filter(|(time_s, _)| (from_s..to_s).contains(time_s)).peekable();
        let still = held.peek().is_some() && held.all(|(_, still)| *still);
        self.store.push(mean.block(phase, still, &timing, &self.worker));
    }
}
