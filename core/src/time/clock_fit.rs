//! Maps a device's counter to the host's clock, independently of the network's jitter.
//!
//! A datagram can be late but never early. So the true line `host = offset + period · counter` runs *below* all
//! arrivals and touches those with the least delay. [`ClockFit`] stores the earliest arrival of each block of time and
//! fits a support line below them: the edge of their lower convex hull at the middle of the window, which is the line
//! below all points with the least sum of distances. The constant part of the delay is not observable from one side and
//! stays in the offset.

/// Number of blocks stored.
const BLOCKS: usize = 128;
/// Initial block length, short, so that a line exists soon; it doubles whenever all blocks are in use …
const FIRST_BLOCK_NS: f64 = 2e6;
/// … up to this length. With [`BLOCKS`] blocks the window spans 64 s.
const LAST_BLOCK_NS: f64 = 0.5e9;
const WINDOW_NS: f64 = LAST_BLOCK_NS * BLOCKS as f64;
/// Number of newest blocks whose distance from the line is an error of the newest estimates: 4 s.
const RECENT_BLOCKS: usize = 8;
/// Minimum number of samples for an estimate.
const MIN_SAMPLES: u64 = 8;
/// Lower bound of an estimate's σ.
const SIGMA_FLOOR_NS: f64 = 1e3;
/// Larger deviations from the line are no jitter: samples wait, or the counter paused or jumped.
const BREAK_NS: f64 = 50e6;
/// If late arrivals follow another straight line for this long, within [`STEADY_NS`], the counter paused or slowed down:
/// the fit restarts. Samples that wait for a host or network do not: the line remains valid.
const BREAK_LASTS_NS: f64 = 1e9;
/// Jitter of the earliest of the samples within [`EARLIEST_OF_NS`] if none of them waits.
const STEADY_NS: f64 = 10e6;
const EARLIEST_OF_NS: f64 = 100e6;
/// Number of blocks from which a line is accurate enough for its moves to be those of the device.
const SETTLED_BLOCKS: usize = BLOCKS / 4;
/// A larger move of the line makes the time since the previous sample unknown: half a sample of the fastest suit.
const UNEVEN_NS: f64 = 2e6;

/// Time at which a sample was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Estimate {
    /// Time on the host's clock. Never later than the sample's arrival, never earlier than the previous estimate.
    pub host_ns: u64,
    /// 1-σ, without the constant part of the delay; `u64::MAX` if the time since the previous estimate is unknown.
    pub sigma_ns: u64,
}

/// Counter and arrival, relative to the first observation.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    counts: f64,
    ns: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Line {
    offset_ns: f64,
    period_ns: f64,
}

impl Line {
    fn at(self, counts: f64) -> f64 {
        self.offset_ns + self.period_ns * counts
    }

    /// Distance above the line, ns.
    fn excess(self, point: Point) -> f64 {
        point.ns - self.at(point.counts)
    }
}

/// Late samples, the earliest of each [`EARLIEST_OF_NS`] within [`STEADY_NS`] of a straight line through the first.
#[derive(Debug, Clone, Copy)]
struct Late {
    first: Option<Point>,
    /// Bounds of that line's slope, ns per count; not below that of the fit: samples that waited arrive faster.
    period_ns: [f64; 2],
    since_ns: f64,
    /// The earliest sample of the present interval, and the interval's start.
    open: Point,
    open_since_ns: f64,
}

impl Late {
    fn begin(point: Point, line: Line) -> Late {
        Late {
            first: None,
            period_ns: [line.period_ns, f64::INFINITY],
            since_ns: point.ns,
            open: point,
            open_since_ns: point.ns,
        }
    }

    /// Adds the next sample; `None` if no line passes all intervals.
    fn extend(mut self, point: Point, line: Line) -> Option<Late> {
        if point.ns - self.open_since_ns < EARLIEST_OF_NS {
            if line.excess(point) < line.excess(self.open) {
                self.open = point;
            }
            return Some(self);
        }
        let earliest = core::mem::replace(&mut self.open, point);
        self.open_since_ns = point.ns;
        let first = *self.first.get_or_insert(earliest);
        let (counts, span_ns) = (earliest.counts - first.counts, earliest.ns - first.ns);
        if counts > 0.0 {
            self.period_ns[0] = self.period_ns[0].max((span_ns - STEADY_NS) / counts);
            self.period_ns[1] = self.period_ns[1].min((span_ns + STEADY_NS) / counts);
        }
        (self.period_ns[0] <= self.period_ns[1]).then_some(self)
    }
}

/// Recursive fit of one stream.
#[derive(Debug, Clone)]
pub struct ClockFit {
    /// Counter and arrival of the first observation.
    origin: Option<(u64, u64)>,
    newest: Point,
    samples: u64,
    /// Earliest arrivals of the closed blocks, oldest first.
    blocks: [Point; BLOCKS],
    block_count: usize,
    block_ns: f64,
    /// Earliest arrival of the open block, and the start of that block.
    open: Point,
    open_since_ns: f64,
    line: Line,
    /// Median distance of the blocks from the line: half of them may have waited.
    spread_ns: f64,
    late: Option<Late>,
    /// Recent moves of the line at the newest sample.
    moved_ns: f64,
    /// Set by a move of the line by more than [`UNEVEN_NS`], cleared by the next estimate that is later than all before.
    is_uneven: bool,
    epoch: u32,
    /// The last estimate returned; later estimates are not earlier.
    last_estimate_ns: u64,
}

impl Default for ClockFit {
    fn default() -> Self {
        ClockFit::new()
    }
}

impl ClockFit {
    /// A fit without observations.
    pub const fn new() -> ClockFit {
        const ZERO: Point = Point { counts: 0.0, ns: 0.0 };
        ClockFit {
            origin: None,
            newest: ZERO,
            samples: 0,
            blocks: [ZERO; BLOCKS],
            block_count: 0,
            block_ns: FIRST_BLOCK_NS,
            open: ZERO,
            open_since_ns: 0.0,
            line: Line { offset_ns: 0.0, period_ns: 0.0 },
            spread_ns: 0.0,
            late: None,
            moved_ns: 0.0,
            is_uneven: false,
            epoch: 0,
            last_estimate_ns: 0,
        }
    }

    /// Clears the line: the device's counter restarted. Estimates stay monotone.
    pub fn restart(&mut self) {
        let ClockFit { last_estimate_ns, epoch, .. } = *self;
        *self = ClockFit { last_estimate_ns, epoch, is_uneven: last_estimate_ns > 0, ..ClockFit::new() };
    }

    /// Number of times that estimates moved relative to the counter by more than 50 ms, wrapping: a pause of the device
    /// and a change of its delay cannot be distinguished by the arrivals.
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Ingests the arrival of the sample with this counter at `arrival_ns`.
    ///
    /// The caller unwraps the counter. A counter that does not increase is ignored.
    pub fn observe(&mut self, counter: u64, arrival_ns: u64) {
        let Some(point) = self.relative(counter, arrival_ns) else {
            self.begin(counter, arrival_ns);
            return;
        };
        if point.counts <= self.newest.counts {
            return;
        }
        if self.is_broken_by(point) {
            self.begin_epoch(counter, arrival_ns);
            return;
        }
        // An error of a younger line is no move of the device.
        let is_settled = self.newest.ns >= BREAK_LASTS_NS && self.block_count >= SETTLED_BLOCKS;
        self.newest = point;
        self.samples += 1;
        let (before_ns, spread_ns) = (self.line.at(point.counts), self.spread_ns);
        if point.ns - self.open_since_ns >= self.block_ns {
            self.close_block();
            self.open = point;
            self.open_since_ns = point.ns;
            self.fit();
            self.moved_ns *= 1.0 - 1.0 / BLOCKS as f64;
        } else if self.line.excess(point) < self.line.excess(self.open) {
            self.open = point;
        }
        // Between two fits only the offset follows, and at once: no sample may appear to arrive before it was taken.
        // All points lie farther above the line by as much.
        let early_ns = (-self.line.excess(point)).max(0.0);
        self.line.offset_ns -= early_ns;
        self.spread_ns += early_ns;
        if is_settled {
            let by_ns = self.line.at(point.counts) - before_ns;
            self.is_uneven |= by_ns.abs() > UNEVEN_NS.max(3.0 * spread_ns);
            self.moved_ns += by_ns;
            if self.moved_ns.abs() > BREAK_NS {
                self.begin_epoch(counter, arrival_ns);
            }
        }
    }

    fn begin_epoch(&mut self, counter: u64, arrival_ns: u64) {
        self.restart();
        self.epoch = self.epoch.wrapping_add(1);
        self.begin(counter, arrival_ns);
    }

    /// Time at which the sample with this counter was taken; `None` before there are enough observations.
    ///
    /// Call it with increasing counters: an estimate is never earlier than the previous one.
    pub fn estimate(&mut self, counter: u64) -> Option<Estimate> {
        let (first_counter, first_arrival_ns) = self.origin?;
        if self.samples < MIN_SAMPLES {
            // The arrival takes the estimate's place.
            let arrival_ns = first_arrival_ns.saturating_add_signed(self.newest.ns as i64);
            self.last_estimate_ns = self.last_estimate_ns.max(arrival_ns);
            return None;
        }
        let counts = counter.wrapping_sub(first_counter).cast_signed() as f64;
        let since_first_ns = self.line.at(counts) as i64;
        let at_ns = first_arrival_ns.saturating_add_signed(since_first_ns);
        let before_ns = self.last_estimate_ns;
        let host_ns = at_ns.max(before_ns);
        self.last_estimate_ns = host_ns;
        self.is_uneven |= (host_ns - at_ns) as f64 > UNEVEN_NS;
        if self.is_uneven {
            self.is_uneven = host_ns == before_ns;
            return Some(Estimate { host_ns, sigma_ns: u64::MAX });
        }
        let late_ns = if self.late.is_some() { self.line.excess(self.newest) } else { self.recent_late_ns() };
        Some(Estimate { host_ns, sigma_ns: (self.spread_ns + SIGMA_FLOOR_NS).max(late_ns) as u64 })
    }

    /// Smallest distance of the newest closed blocks from the line, ns: large only if all recent samples wait.
    fn recent_late_ns(&self) -> f64 {
        let recent = &self.blocks[self.block_count.saturating_sub(RECENT_BLOCKS)..self.block_count];
        recent.iter().map(|block| self.line.excess(*block)).reduce(f64::min).unwrap_or(0.0)
    }

    /// Host time per count, ns; `None` before there are enough observations.
    pub fn period_ns(&self) -> Option<f64> {
        (self.samples >= MIN_SAMPLES).then_some(self.line.period_ns)
    }

    fn begin(&mut self, counter: u64, arrival_ns: u64) {
        self.origin = Some((counter, arrival_ns));
        self.samples = 1;
    }

    fn relative(&self, counter: u64, arrival_ns: u64) -> Option<Point> {
        let (first_counter, first_arrival_ns) = self.origin?;
        Some(Point {
            counts: counter.wrapping_sub(first_counter).cast_signed() as f64,
            ns: arrival_ns.wrapping_sub(first_arrival_ns).cast_signed() as f64,
        })
    }

    /// Whether the counter no longer matches the line.
    fn is_broken_by(&mut self, point: Point) -> bool {
        // A line fitted to less than this may have such an error itself.
        if self.newest.ns < BREAK_LASTS_NS {
            return false;
        }
        let excess_ns = self.line.excess(point);
        if excess_ns <= BREAK_NS {
            self.late = None;
            // The counter jumped ahead of time; no arrival can be early.
            return excess_ns < -BREAK_NS;
        }
        let line = self.line;
        let extended = self.late.and_then(|late| late.extend(point, line));
        let late = *self.late.insert(extended.unwrap_or_else(|| Late::begin(point, line)));
        point.ns - late.since_ns > BREAK_LASTS_NS
    }

    /// Stores the open block; makes room by merging pairs of blocks or by dropping the oldest.
    fn close_block(&mut self) {
        if self.block_count == BLOCKS && self.block_ns < LAST_BLOCK_NS {
            for pair in 0..BLOCKS / 2 {
                let (a, b) = (self.blocks[2 * pair], self.blocks[2 * pair + 1]);
                self.blocks[pair] = if self.line.excess(b) < self.line.excess(a) { b } else { a };
            }
            self.block_count /= 2;
            self.block_ns *= 2.0;
        }
        let too_old = |block: &Point| self.newest.ns - block.ns > WINDOW_NS;
        let mut outdated = self.blocks[..self.block_count].iter().take_while(|block| too_old(block)).count();
        if self.block_count == BLOCKS {
            outdated = outdated.max(1);
        }
        self.blocks.copy_within(outdated..self.block_count, 0);
        self.block_count -= outdated;
        self.blocks[self.block_count] = self.open;
        self.block_count += 1;
    }

    /// Fits the line below the closed blocks and the open one.
    fn fit(&mut self) {
        let points = || self.blocks[..self.block_count].iter().copied().chain([self.open]);
        let count = (self.block_count + 1) as f64;
        let middle = points().map(|point| point.counts).sum::<f64>() / count;
        let mut hull = [Point::default(); BLOCKS + 1];
        let mut corners = 0;
        for point in points() {
            while corners >= 2 && !turns_up(hull[corners - 2], hull[corners - 1], point) {
                corners -= 1;
            }
            hull[corners] = point;
            corners += 1;
        }
        let Some([from, to]) = hull[..corners].array_windows().find(|[_, to]| to.counts >= middle) else {
            return;
        };
        let period_ns = (to.ns - from.ns) / (to.counts - from.counts);
        let line = Line { offset_ns: from.ns - period_ns * from.counts, period_ns };
        self.line = line;
        let mut distance_ns = [0.0; BLOCKS + 1];
        let distances = &mut distance_ns[..=self.block_count];
        for (distance_ns, point) in distances.iter_mut().zip(points()) {
            *distance_ns = line.excess(point);
        }
        self.spread_ns = *distances.select_nth_unstable_by(self.block_count / 2, f64::total_cmp).1;
    }
}

/// Whether the path a → b → c bends upwards, as the lower hull must.
fn turns_up(a: Point, b: Point, c: Point) -> bool {
    (b.counts - a.counts) * (c.ns - a.ns) > (c.counts - a.counts) * (b.ns - a.ns)
}

#[cfg(test)]
mod tests;
