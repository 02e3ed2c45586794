//! Ties a device's counter to the host's clock, without letting the network's jitter in.
//!
//! A datagram can be late but never early. So the true line `host = offset + period · counter` runs *below* all
//! arrivals and touches those that were delayed least. [`ClockFit`] keeps the earliest arrival of each block of time
//! and lays a support line under them: the edge of their lower convex hull at the middle of the window, which is the
//! line below all points with the least sum of distances. The constant part of the delay cannot be seen from one side
//! and stays in the offset.

/// How many blocks are kept.
const BLOCKS: usize = 128;
/// A block begins this short, so that a line exists at once, and doubles whenever the blocks fill up …
const FIRST_BLOCK_NS: f64 = 2e6;
/// … until it is this long. With [`BLOCKS`] of them the window spans 64 s.
const LAST_BLOCK_NS: f64 = 0.5e9;
const WINDOW_NS: f64 = LAST_BLOCK_NS * BLOCKS as f64;
/// Fewer samples than this make no estimate.
const MIN_SAMPLES: u64 = 8;
/// No estimate claims to be better than this.
const SIGMA_FLOOR_NS: f64 = 1e3;
/// Off the line by more than this is no jitter: the counter paused or leapt.
const BREAK_NS: f64 = 50e6;
/// A counter that stays behind the line for so long has paused: the line starts anew.
const BREAK_LASTS_NS: f64 = 1e9;

/// When a sample was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Estimate {
    /// On the host's clock. Never later than the sample's arrival, never earlier than the estimate before.
    pub host_ns: u64,
    /// 1-σ, without the constant part of the delay.
    pub sigma_ns: u64,
}

/// Counter and arrival, both from the first observation on.
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

    /// How much later than the line.
    fn excess(self, point: Point) -> f64 {
        point.ns - self.at(point.counts)
    }
}

/// The running fit of one stream.
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
    /// Earliest arrival of the open block, and when that block began.
    open: Point,
    open_since_ns: f64,
    line: Line,
    /// Mean distance of the blocks from the line.
    spread_ns: f64,
    /// Since when every sample has been off the line.
    off_since_ns: Option<f64>,
    /// The last estimate given; later ones are not earlier.
    given_ns: u64,
}

impl Default for ClockFit {
    fn default() -> Self {
        ClockFit::new()
    }
}

impl ClockFit {
    /// A fit that knows nothing yet.
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
            off_since_ns: None,
            given_ns: 0,
        }
    }

    /// Forgets the line: the device's counter started anew. Estimates stay monotone.
    pub fn restart(&mut self) {
        *self = ClockFit { given_ns: self.given_ns, ..ClockFit::new() };
    }

    /// Takes in that the sample with this counter arrived at `arrival_ns`.
    ///
    /// The caller unwraps the counter. A counter that does not grow is ignored.
    pub fn observe(&mut self, counter: u64, arrival_ns: u64) {
        let Some(point) = self.relative(counter, arrival_ns) else {
            self.begin(counter, arrival_ns);
            return;
        };
        if point.counts <= self.newest.counts {
            return;
        }
        if self.is_broken_by(point) {
            self.restart();
            self.begin(counter, arrival_ns);
            return;
        }
        self.newest = point;
        self.samples += 1;
        if point.ns - self.open_since_ns >= self.block_ns {
            self.close_block();
            self.open = point;
            self.open_since_ns = point.ns;
            self.fit();
        } else if self.line.excess(point) < self.line.excess(self.open) {
            self.open = point;
        }
        // Between two fits only the offset follows, and at once: no sample may seem to arrive before it was taken.
        self.line.offset_ns += self.line.excess(point).min(0.0);
    }

    /// When the sample with this counter was taken; `None` before there are a few observations.
    ///
    /// Ask for counters in rising order: an estimate is never earlier than the one before.
    pub fn estimate(&mut self, counter: u64) -> Option<Estimate> {
        let (first_counter, first_arrival_ns) = self.origin?;
        if self.samples < MIN_SAMPLES {
            return None;
        }
        let counts = counter.wrapping_sub(first_counter).cast_signed() as f64;
        let since_first_ns = self.line.at(counts) as i64;
        let host_ns = first_arrival_ns.saturating_add_signed(since_first_ns).max(self.given_ns);
        self.given_ns = host_ns;
        let excess_ns = self.line.excess(self.newest);
        let off_ns = if self.off_since_ns.is_some() { excess_ns } else { 0.0 };
        Some(Estimate { host_ns, sigma_ns: (self.spread_ns + SIGMA_FLOOR_NS).max(off_ns) as u64 })
    }

    /// Host time from one count to the next, ns; `None` before there are a few observations.
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

    /// Whether the counter is no longer the one the line was laid for.
    fn is_broken_by(&mut self, point: Point) -> bool {
        // A line over less than this may be that wrong by itself.
        if self.newest.ns < BREAK_LASTS_NS {
            return false;
        }
        let excess_ns = self.line.excess(point);
        if excess_ns <= BREAK_NS {
            self.off_since_ns = None;
            // The counter leapt ahead of time; nothing can arrive early.
            return excess_ns < -BREAK_NS;
        }
        point.ns - *self.off_since_ns.get_or_insert(point.ns) > BREAK_LASTS_NS
    }

    /// Files the open block, making room by pairing blocks or by forgetting the oldest.
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
        let mut forget = self.blocks[..self.block_count].iter().take_while(|block| too_old(block)).count();
        if self.block_count == BLOCKS {
            forget = forget.max(1);
        }
        self.blocks.copy_within(forget..self.block_count, 0);
        self.block_count -= forget;
        self.blocks[self.block_count] = self.open;
        self.block_count += 1;
    }

    /// Lays the line under the closed blocks and the open one.
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
        self.spread_ns = points().map(|point| line.excess(point)).sum::<f64>() / count;
        self.line = line;
    }
}

/// Whether the way a → b → c bends upwards, as the lower hull must.
fn turns_up(a: Point, b: Point, c: Point) -> bool {
    (b.counts - a.counts) * (c.ns - a.ns) > (c.counts - a.counts) * (b.ns - a.ns)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    const PERIOD_NS: f64 = 1e9 / 240.0;
    const START_NS: u64 = 77_000_000_000_000;

    /// Exponential delays from a fixed seed.
    struct Jitter {
        state: u64,
        mean_ns: f64,
    }

    impl Jitter {
        fn next_ns(&mut self) -> f64 {
            self.state =
                self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let uniform = ((self.state >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
            -self.mean_ns * uniform.ln()
        }
    }

    /// Feeds `seconds` of a stream that is `drift` too slow; yields (error, σ) of every estimate, ns.
    fn run(seconds: u64, drift: f64, mean_jitter_ns: f64) -> std::vec::Vec<(f64, f64)> {
        let mut fit = ClockFit::new();
        let mut jitter = Jitter { state: 42, mean_ns: mean_jitter_ns };
        let (mut last_arrival, mut last_estimate) = (0, 0);
        let mut results = std::vec::Vec::new();
        for index in 0..seconds * 240 {
            let taken_ns = START_NS + (index as f64 * PERIOD_NS * (1.0 + drift)) as u64;
            let arrival_ns = (taken_ns + jitter.next_ns() as u64).max(last_arrival);
            last_arrival = arrival_ns;
            fit.observe(1000 + index, arrival_ns);
            if let Some(estimate) = fit.estimate(1000 + index) {
                assert!(estimate.host_ns <= arrival_ns, "a sample is not taken after it arrived");
                assert!(estimate.host_ns >= last_estimate, "time does not run backwards");
                last_estimate = estimate.host_ns;
                let error = estimate.host_ns as f64 - taken_ns as f64;
                results.push((error, estimate.sigma_ns as f64));
            }
        }
        results
    }

    #[test]
    fn jitter_does_not_enter_and_drift_is_followed() {
        for drift in [0.0, 50e-6, -50e-6] {
            let settled = run(90, drift, 1e6).split_off(30 * 240);
            let worst = settled.iter().fold(0.0f64, |worst, (error, _)| worst.max(error.abs()));
            assert!(worst < 60e3, "drift {drift}: {worst} ns, although the mean delay is 1 ms");
        }
    }

    #[test]
    fn sigma_is_honest() {
        for mean_jitter_ns in [50e3, 1e6, 5e6] {
            let results = run(60, 20e-6, mean_jitter_ns);
            let within = results.iter().filter(|(error, sigma)| error.abs() <= 3.0 * sigma).count();
            assert!(within as f64 > 0.95 * results.len() as f64, "{within} of {} within 3 σ", results.len());
            let (_, last_sigma) = results[results.len() - 1];
            assert!(last_sigma < 0.1 * mean_jitter_ns + 2e3, "{last_sigma} of {mean_jitter_ns}");
        }
    }

    #[test]
    fn a_few_samples_are_enough_and_fewer_are_not() {
        let mut fit = ClockFit::new();
        assert_eq!(fit.estimate(0), None);
        for index in 0..MIN_SAMPLES {
            assert_eq!(fit.estimate(index), None);
            fit.observe(index, START_NS + index * 4_000_000);
        }
        let estimate = fit.estimate(MIN_SAMPLES - 1).unwrap();
        assert!(estimate.host_ns.abs_diff(START_NS + (MIN_SAMPLES - 1) * 4_000_000) < 10, "{estimate:?}");
        assert!((fit.period_ns().unwrap() - 4e6).abs() < 1.0);
    }

    #[test]
    fn a_counter_that_paused_or_leapt_gets_a_new_line() {
        // Ten seconds of silence in which the device did not count; then a leap of 1000 counts in no time.
        for (silence_ns, leap) in [(10_000_000_000, 0), (0, 1000)] {
            let mut fit = ClockFit::new();
            for index in 0..2400u64 {
                let (pause, leapt) = if index < 1200 { (0, 0) } else { (silence_ns, leap) };
                let arrival_ns = START_NS + index * 4_000_000 + pause;
                fit.observe(index + leapt, arrival_ns);
                let Some(estimate) = fit.estimate(index + leapt) else { continue };
                let error = arrival_ns.abs_diff(estimate.host_ns);
                assert!(error < 1000 || error <= estimate.sigma_ns + 1000, "{index}: {error} {estimate:?}");
            }
            assert!(fit.estimate(2400 + leap).unwrap().sigma_ns < 2000);
        }
    }

    #[test]
    fn equal_and_falling_counters_are_ignored() {
        let mut fit = ClockFit::new();
        for index in 0..20 {
            fit.observe(index, START_NS + index * 1_000_000);
            fit.observe(index, 0);
            fit.observe(0, u64::MAX);
        }
        assert!(fit.estimate(19).unwrap().host_ns.abs_diff(START_NS + 19_000_000) < 10);
    }
}
