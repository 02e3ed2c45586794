//! Estimates the offset between the clocks of suit and plate from stomps: the foot stops when it hits the plate.
//!
//! The same event is compared in both streams: half of the foot's momentum is dissipated. In the suit's data this is
//! where the foot's downward speed has fallen to half; on the plate, where half of the impulse of the force's first
//! peak has passed. Rebound or adhesion of the foot, and the body weight that follows, shift the two by some
//! milliseconds, which is included in σ ([`CONTACT_SIGMA_NS`]).
//!
//! Every pair of a hit and a stop proposes an offset; the one with the most consistent pairs is selected. If another is
//! equally consistent, no result is returned: stomps at a regular beat also fit when shifted by one beat.

mod events;
#[cfg(test)]
mod tests;

use thiserror::Error;

use events::{foot_stops, plate_hits};

/// 1-σ of the effect of shoe, floor and weight on the offset, ns; it is common to all stomps of a session, so it does
/// not decrease with their count (tested by `a_foot_on_many_grounds`).
pub const CONTACT_SIGMA_NS: f64 = 4e6;
/// Assumed scatter of a single stomp if there is no second one to estimate it from, ns.
const ONE_STOMP_SIGMA_NS: f64 = 5e6;
/// Pairs are consistent within this plus one sampling interval of each stream, ns.
const TOLERANCE_NS: u64 = 15_000_000;
/// More events than this in one stream are walking, not stomping.
const EVENTS_MAX: usize = 1000;

/// One sample of the plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Force {
    /// On the plate's clock, ns.
    pub time_ns: u64,
    /// Vertical force on the person, N.
    pub vertical_n: f64,
}

/// One sample of both feet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feet {
    /// On the suit's clock, ns.
    pub time_ns: u64,
    /// Upward velocity of the left and the right foot, m/s.
    pub upward_m_per_s: [f64; 2],
}

/// Detection thresholds of a stomp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StompSettings {
    /// The offset is searched within ± this, ns.
    pub offset_max_ns: u64,
    /// Minimum rise of the force within 60 ms, N.
    pub rise_min_n: f64,
    /// Minimum downward speed of the foot, m/s.
    pub speed_min_m_per_s: f64,
}

impl Default for StompSettings {
    fn default() -> Self {
        StompSettings { offset_max_ns: 2_000_000_000, rise_min_n: 250.0, speed_min_m_per_s: 0.6 }
    }
}

/// The estimated offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StompOffset {
    /// Offset to add to the suit's time to obtain the plate's, ns.
    pub offset_ns: i64,
    /// 1-σ of it: scatter over stomps, sampling, and [`CONTACT_SIGMA_NS`].
    pub sigma_ns: u64,
    /// Root mean square deviation of single stomps from the offset, ns; 0 for one stomp.
    pub residual_ns: u64,
    /// Count of stomps detected in both streams.
    pub stomps: usize,
    /// Count of hits on the plate, matched or not.
    pub plate_hits: usize,
    /// Count of foot stops in the suit's data, matched or not.
    pub foot_stops: usize,
}

/// Why there is no offset.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum StompRefusal {
    /// No stomp in the plate's data.
    #[error(
        "the plate measured no stomp: the force rose by {largest_n:.0} N at most within 60 ms, {needed_n:.0} N are needed; \
         stand on the plate, lift one foot and stamp it down, three times at an irregular beat"
    )]
    NoHit {
        /// The largest rise, N.
        largest_n: f64,
        /// The detection threshold, N.
        needed_n: f64,
    },
    /// No stop of a foot in the suit's data.
    #[error(
        "the suit measured no stomp: a foot came down at {fastest_m_per_s:.2} m/s at most, or did not stop short; \
         {needed_m_per_s:.2} m/s are needed"
    )]
    NoStop {
        /// The largest downward speed, m/s.
        fastest_m_per_s: f64,
        /// The detection threshold, m/s.
        needed_m_per_s: f64,
    },
    /// Hits and stops are farther apart than the offset may be.
    #[error(
        "no hit of the plate is within {:.1} s of a stop of a foot (the nearest are {:.3} s apart); the clocks differ \
         by more, or these are not the same stomps",
        *offset_max_ns as f64 / 1e9, *nearest_ns as f64 / 1e9
    )]
    TooFarApart {
        /// The smallest distance of any hit and any stop, ns.
        nearest_ns: u64,
        /// The largest offset allowed, ns.
        offset_max_ns: u64,
    },
    /// Two offsets explain the stomps equally well.
    #[error(
        "two offsets explain {stomps} stomps each: {:.3} s and {:.3} s; stamp again, three times at an irregular beat",
        *one_ns as f64 / 1e9, *other_ns as f64 / 1e9
    )]
    Ambiguous {
        /// One of them, ns.
        one_ns: i64,
        /// The other, ns.
        other_ns: i64,
        /// Count of stomps that each explains.
        stomps: usize,
    },
    /// Most hits on the plate have no matching stop in the suit's data.
    #[error(
        "only {stomps} of {plate_hits} hits of the plate are stomps of the suit; no other person may step on the \
         plate, and nothing may be dropped on it"
    )]
    MostlyUnseen {
        /// Hits that fit a stop.
        stomps: usize,
        /// All hits.
        plate_hits: usize,
    },
    /// Too many events: the subject walks.
    #[error("{found} hits or stops are no stomps but walking; give the part of the session with the stomps")]
    TooMany {
        /// Count of events in one stream.
        found: usize,
    },
}

/// Vertical velocities of the feet from their heights (left and right, m), by central differences.
///
/// Skips heights that are not finite and times that do not increase.
pub fn feet_of_heights(heights_m: &[(u64, [f64; 2])]) -> Vec<Feet> {
    let mut sound: Vec<(u64, [f64; 2])> = Vec::with_capacity(heights_m.len());
    for &(time_ns, feet_m) in heights_m {
        let increases = sound.last().is_none_or(|(before_ns, _)| *before_ns < time_ns);
        if increases && feet_m.iter().all(|metres| metres.is_finite()) {
            sound.push((time_ns, feet_m));
        }
    }
    let between = |window: &[(u64, [f64; 2])]| {
        let [(from_ns, from_m), (time_ns, _), (to_ns, to_m)] = window else {
            unreachable!("windows of three")
        };
        let seconds = (to_ns - from_ns) as f64 * 1e-9;
        Feet {
            time_ns: *time_ns,
            upward_m_per_s: std::array::from_fn(|foot| (to_m[foot] - from_m[foot]) / seconds),
        }
    };
    sound.windows(3).map(between).collect()
}

/// Estimates the offset to add to the suit's times so that its stomps match those of the plate.
///
/// Skips samples that are not finite and times that do not increase; a stomp in a gap of either stream is not used.
///
/// # Errors
/// A [`StompRefusal`]: there is no stomp, or more than one way to match them.
pub fn estimate(
    plate: &[Force],
    feet: &[Feet],
    settings: &StompSettings,
) -> Result<StompOffset, StompRefusal> {
    let hits = plate_hits(plate, settings.rise_min_n);
    let stops = foot_stops(feet, settings.speed_min_m_per_s);
    if hits.times_ns.is_empty() {
        return Err(StompRefusal::NoHit { largest_n: hits.largest, needed_n: settings.rise_min_n });
    }
    if stops.times_ns.is_empty() {
        let needed_m_per_s = settings.speed_min_m_per_s;
        return Err(StompRefusal::NoStop { fastest_m_per_s: stops.largest, needed_m_per_s });
    }
    let most = hits.times_ns.len().max(stops.times_ns.len());
    if most > EVENTS_MAX {
        return Err(StompRefusal::TooMany { found: most });
    }
    let mut proposals_ns = Vec::with_capacity(hits.times_ns.len() * stops.times_ns.len());
    // Saturates at the largest representable offset.
    let offset_ns = |hit_ns: u64, stop_ns: u64| {
        let apart_ns = i64::try_from(hit_ns.abs_diff(stop_ns)).unwrap_or(i64::MAX);
        if hit_ns < stop_ns { -apart_ns } else { apart_ns }
    };
    for hit_ns in &hits.times_ns {
        proposals_ns.extend(stops.times_ns.iter().map(|stop_ns| offset_ns(*hit_ns, *stop_ns)));
    }
    let nearest_ns = proposals_ns.iter().map(|ns: &i64| ns.unsigned_abs()).min().unwrap_or(u64::MAX);
    proposals_ns.retain(|ns| ns.unsigned_abs() <= settings.offset_max_ns);
    proposals_ns.sort_unstable();
    let width_ns = 2 * TOLERANCE_NS + hits.interval_ns + stops.interval_ns;
    let Some(best) = fullest(&proposals_ns, width_ns, None) else {
        return Err(StompRefusal::TooFarApart { nearest_ns, offset_max_ns: settings.offset_max_ns });
    };
    if let Some(other) = fullest(&proposals_ns, width_ns, Some(best))
        && other.len() >= best.len()
    {
        let (one_ns, other_ns) = (middle(best), middle(other));
        return Err(StompRefusal::Ambiguous { one_ns, other_ns, stomps: best.len() });
    }
    let (stomps, plate_hits) = (best.len(), hits.times_ns.len());
    if stomps * 2 < plate_hits {
        return Err(StompRefusal::MostlyUnseen { stomps, plate_hits });
    }
    let offset_ns = middle(best);
    let square_sum: f64 = best.iter().map(|ns| ((ns - offset_ns) as f64).powi(2)).sum();
    let count = stomps as f64;
    let scatter_ns = if stomps > 1 { (square_sum / (count - 1.0)).sqrt() } else { ONE_STOMP_SIGMA_NS };
    // Uniformly distributed error within one sampling interval of each stream.
    let sampling_ns =
        ((hits.interval_ns as f64).powi(2) + (stops.interval_ns as f64).powi(2)).sqrt() / 12f64.sqrt();
    let random_ns = scatter_ns.max(sampling_ns) / count.sqrt();
    Ok(StompOffset {
        offset_ns,
        sigma_ns: random_ns.hypot(CONTACT_SIGMA_NS).ceil() as u64,
        residual_ns: (square_sum / count).sqrt().round() as u64,
        stomps,
        plate_hits,
        foot_stops: stops.times_ns.len(),
    })
}

/// The largest set of proposals within `width_ns`, among those that are farther than this from `taken`.
///
/// Events of one stream are farther apart than the width, so that no event is in two of the set's pairs.
fn fullest<'a>(sorted_ns: &'a [i64], width_ns: u64, taken: Option<&[i64]>) -> Option<&'a [i64]> {
    let free = |window: &[i64]| match (window, taken) {
        ([first, .., last] | [first @ last], Some([from, .., to] | [from @ to])) => {
            *first > to.saturating_add_unsigned(width_ns) || *last < from.saturating_sub_unsigned(width_ns)
        }
        _ => true,
    };
    let mut best: Option<&[i64]> = None;
    let mut begin = 0;
    for end in 1..=sorted_ns.len() {
        while sorted_ns[end - 1].abs_diff(sorted_ns[begin]) > width_ns {
            begin += 1;
        }
        let window = &sorted_ns[begin..end];
        let spread = |window: &[i64]| window[window.len() - 1].abs_diff(window[0]);
        let better = best.is_none_or(|best| {
            window.len() > best.len() || (window.len() == best.len() && spread(window) < spread(best))
        });
        if better && free(window) {
            best = Some(window);
        }
    }
    best
}

/// The mean, ns.
fn middle(proposals_ns: &[i64]) -> i64 {
    let sum: i128 = proposals_ns.iter().map(|ns| i128::from(*ns)).sum();
    (sum / proposals_ns.len().max(1) as i128) as i64
}
