//! Detects the events of a stomp in both streams: impacts on the plate (vertical force, N) and stops of a foot (upward
//! velocity, m/s).
//!
//! The time of an event (ns, on the clock of its stream) is that at which half of the foot's momentum is dissipated, so
//! that events of both streams are comparable: half of the impulse of the force's first peak has passed, and the
//! downward speed has fallen to half.

use super::{Feet, Force};

/// Maximum duration of the force's rise, and of the interval from there to its first peak, ns.
const RISE_NS: u64 = 60_000_000;
/// Maximum duration of the deceleration of a foot, ns: two samples at 30 Hz.
const STOP_NS: u64 = 80_000_000;
/// The first peak has passed once the force has fallen by this fraction of its rise.
const PEAK_DROP: f64 = 0.1;
/// The baseline of the force is its median over this interval before the event, ns.
const BASELINE_NS: u64 = 1_000_000_000;
/// The subject stands on the other foot if the force is at least this fraction of the baseline.
const STANCE_FORCE_MIN: f64 = 0.3;
/// Minimum fraction of the whole rise that is due to the landing of the foot.
const LANDING_RISE_MIN: f64 = 0.3;
/// Maximum fraction of the downward speed that remains when the foot has stopped.
const STOPPED_SPEED_MAX: f64 = 0.3;
/// Dead time after an event, which covers the other foot and a rebound, ns.
const DEAD_TIME_NS: u64 = 250_000_000;
/// A longer interval between two samples is a gap, ns.
const GAP_NS: u64 = 40_000_000;

/// Events of one stream.
#[derive(Debug, Default)]
pub(super) struct Events {
    /// Times, ns, increasing.
    pub(super) times_ns: Vec<u64>,
    /// The largest rise (N) or downward speed (m/s), whether or not it was an event.
    pub(super) largest: f64,
    /// Median sampling interval, without gaps, ns.
    pub(super) interval_ns: u64,
}

impl Events {
    /// Adds an event, unless it is within the dead time of the previous one.
    fn add(&mut self, time_ns: u64) {
        if self.times_ns.last().is_none_or(|last_ns| time_ns.saturating_sub(*last_ns) >= DEAD_TIME_NS) {
            self.times_ns.push(time_ns);
        }
    }
}

/// One finite quantity over increasing times.
struct Stream {
    /// Time (ns) and value (N or m/s).
    points: Vec<(u64, f64)>,
}

impl Stream {
    /// The stream without samples that are not finite or whose time does not increase.
    fn of(readings: impl Iterator<Item = (u64, f64)>) -> Stream {
        let mut points: Vec<(u64, f64)> = Vec::new();
        for (time_ns, value) in readings {
            if value.is_finite() && points.last().is_none_or(|(before_ns, _)| *before_ns < time_ns) {
                points.push((time_ns, value));
            }
        }
        Stream { points }
    }

    /// Median sampling interval without gaps, ns; 0 if there are only gaps.
    fn interval_ns(&self) -> u64 {
        let mut intervals: Vec<u64> = self.points.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        intervals.retain(|interval_ns| *interval_ns <= GAP_NS);
        let middle = intervals.len() / 2;
        if intervals.is_empty() { 0 } else { *intervals.select_nth_unstable(middle).1 }
    }

    /// Whether there is a gap between two indices.
    fn has_gap(&self, from: usize, to: usize) -> bool {
        self.points[from..=to].windows(2).any(|pair| pair[1].0 - pair[0].0 > GAP_NS)
    }
}

/// Detects impacts on the plate: rises of the vertical force by at least `rise_min_n` within [`RISE_NS`].
pub(super) fn plate_hits(plate: &[Force], rise_min_n: f64) -> Events {
    let stream = Stream::of(plate.iter().map(|force| (force.time_ns, force.vertical_n)));
    let mut hits = Events { interval_ns: stream.interval_ns(), ..Events::default() };
    let points = &stream.points;
    let (mut window, mut at) = (0, 0);
    while at < points.len() {
        while points[at].0 - points[window].0 > RISE_NS {
            window += 1;
        }
        // The last of equal minima: the force rises from there.
        let low = (window..=at).rev().min_by(|a, b| points[*a].1.total_cmp(&points[*b].1)).unwrap_or(at);
        let rise_n = points[at].1 - points[low].1;
        hits.largest = hits.largest.max(rise_n);
        if rise_n < rise_min_n {
            at += 1;
            continue;
        }
        let peak = first_peak(points, low, at);
        let landing = landing(points, low, peak);
        let over = after_peak(points, landing, peak);
        if !stream.has_gap(low, over) {
            hits.largest = hits.largest.max(points[peak].1 - points[low].1);
            // Mean of two contact models: a rebounding foot is at rest at the peak, an adhering one after it.
            let rebound_ns = half_impulse_ns(&points[landing..=peak]);
            let adhesion_ns = half_impulse_ns(&points[landing..=over]);
            hits.add(u64::midpoint(rebound_ns, adhesion_ns));
        }
        let passed_ns = points[peak].0.saturating_add(DEAD_TIME_NS);
        at += points[at..].partition_point(|(time_ns, _)| *time_ns < passed_ns);
        window = at.min(points.len().saturating_sub(1));
    }
    hits
}

/// Index of the first maximum of the force at or after `from`; `low`: index of the minimum before it.
fn first_peak(points: &[(u64, f64)], low: usize, from: usize) -> usize {
    let mut peak = from;
    for at in from + 1..points.len() {
        let (time_ns, force_n) = points[at];
        let passed = points[peak].1 - force_n > PEAK_DROP * (points[peak].1 - points[low].1);
        if passed || time_ns - points[from].0 > RISE_NS {
            break;
        }
        if force_n > points[peak].1 {
            peak = at;
        }
    }
    peak
}

/// Index at which the peak is over: the force has fallen to half of its rise or, if the body weight remains, the time
/// after the peak equals the duration of the rise.
fn after_peak(points: &[(u64, f64)], low: usize, peak: usize) -> usize {
    let ((low_ns, low_n), (peak_ns, peak_n)) = (points[low], points[peak]);
    let over = |(time_ns, force_n): &(u64, f64)| {
        *force_n <= f64::midpoint(low_n, peak_n) || time_ns - peak_ns >= peak_ns - low_ns
    };
    points[peak..].iter().position(over).map_or(points.len() - 1, |later| peak + later)
}

/// Index at which the impact begins, between the minimum `low` and the peak.
///
/// Swinging a leg down unloads the plate under the other foot. The force then rises twice: back to the baseline while
/// the leg falls freely, and from there when the foot lands; only the second rise is the impact. Without preceding
/// stance (a leap, a step onto the plate) the whole rise is the impact.
fn landing(points: &[(u64, f64)], low: usize, peak: usize) -> usize {
    let since_ns = points[low].0.saturating_sub(BASELINE_NS);
    let first = points[..low].partition_point(|(time_ns, _)| *time_ns < since_ns);
    let mut before: Vec<f64> = points[first..low].iter().map(|(_, force_n)| *force_n).collect();
    let middle = before.len() / 2;
    if before.is_empty() {
        return low;
    }
    let baseline_n = *before.select_nth_unstable_by(middle, f64::total_cmp).1;
    let (low_n, peak_n) = (points[low].1, points[peak].1);
    if low_n < STANCE_FORCE_MIN * baseline_n || peak_n - baseline_n < LANDING_RISE_MIN * (peak_n - low_n) {
        return low;
    }
    (low..peak).rev().find(|index| points[*index].1 <= baseline_n).unwrap_or(low)
}

/// Time at which half of the impulse above the first force has passed, ns; requires at least two points.
fn half_impulse_ns(points: &[(u64, f64)]) -> u64 {
    let base_n = points[0].1;
    // Trapezoidal rule, N ns.
    let step = |pair: &[(u64, f64)]| {
        let interval_ns = (pair[1].0 - pair[0].0) as f64;
        (pair[0].1 + pair[1].1 - 2.0 * base_n) / 2.0 * interval_ns
    };
    let half = points.windows(2).map(step).sum::<f64>() / 2.0;
    let mut passed = 0.0;
    for pair in points.windows(2) {
        let next = passed + step(pair);
        if next >= half {
            let ([a_n, b_n], span) =
                ([pair[0].1 - base_n, pair[1].1 - base_n], (pair[1].0 - pair[0].0) as f64);
            // The force is linear within a step, so the impulse is quadratic in time.
            let (slope, wanted) = ((b_n - a_n) / span, half - passed);
            let root = (a_n * a_n + 2.0 * slope * wanted).max(0.0).sqrt();
            let since = if a_n + root > 0.0 { 2.0 * wanted / (a_n + root) } else { 0.0 };
            return pair[0].0 + since.clamp(0.0, span).round() as u64;
        }
        passed = next;
    }
    points[points.len() - 1].0
}

/// Detects stops of either foot after a downward speed of at least `speed_min_m_per_s`.
pub(super) fn foot_stops(feet: &[Feet], speed_min_m_per_s: f64) -> Events {
    let mut stops = Events::default();
    let mut times_ns = Vec::new();
    for foot in 0..2 {
        let stream = Stream::of(feet.iter().map(|feet| (feet.time_ns, feet.upward_m_per_s[foot])));
        stops.interval_ns = stops.interval_ns.max(stream.interval_ns());
        let fastest = stream.points.iter().map(|(_, upward)| -upward).fold(0.0, f64::max);
        stops.largest = stops.largest.max(fastest);
        times_ns.extend(stops_of(&stream, speed_min_m_per_s));
    }
    times_ns.sort_unstable();
    for time_ns in times_ns {
        stops.add(time_ns);
    }
    stops
}

/// Times at which one foot has lost half of its highest downward speed, ns: by linear interpolation, for descents that
/// end within [`STOP_NS`].
fn stops_of(stream: &Stream, speed_min_m_per_s: f64) -> Vec<u64> {
    let points = &stream.points;
    let mut stops = Vec::new();
    let mut at = 0;
    while at < points.len() {
        let (time_ns, upward) = points[at];
        let falls = upward <= -speed_min_m_per_s;
        // The highest downward speed of this descent.
        if !falls || points.get(at + 1).is_some_and(|(_, next)| *next <= upward) {
            at += 1;
            continue;
        }
        let until = at + points[at..].partition_point(|(later_ns, _)| later_ns - time_ns <= STOP_NS);
        let stopped = (at..until).find(|index| points[*index].1 >= STOPPED_SPEED_MAX * upward);
        let half = (at + 1..until).find(|index| points[*index].1 >= upward / 2.0);
        if let (Some(stopped), Some(half)) = (stopped, half)
            && !stream.has_gap(at, stopped)
        {
            let [(from_ns, from), (to_ns, to)] = [points[half - 1], points[half]];
            let fraction = (upward / 2.0 - from) / (to - from);
            stops.push(from_ns + ((to_ns - from_ns) as f64 * fraction.clamp(0.0, 1.0)).round() as u64);
            at = stopped;
        } else {
            at += 1;
        }
    }
    stops
}
