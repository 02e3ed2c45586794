//! Two files of one session, each with its own clock: estimates the offset between the clocks and merges both streams
//! in one time base.

use std::fmt;
use std::str::FromStr;

use anyhow::{Context, bail};
use equipoise_adapters::calibration::stomp::{
    self, Feet, Force, StompOffset, StompSettings, feet_of_heights,
};
use equipoise_config::Config;
use equipoise_core::body::Segment;
use equipoise_core::message::SuitSample;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::time::NS_PER_S;

use super::plate::{PlateFile, PlateSamples};
use crate::replay::input::Input;
use crate::replay::samples::{Sample, Samples, SkippedData};
use crate::replay::with_skipped;

/// A larger difference between the clocks means two different sessions, ns.
const OFFSET_MAX_NS: u64 = 86_400 * NS_PER_S;

/// How the clocks are aligned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Join {
    /// Both files contain absolute times of clocks that agree.
    Clock,
    /// By stomps that both files contain, with a bounded offset.
    Stomp {
        /// Bound of the offset on both sides, ns.
        within_ns: u64,
    },
    /// Explicit offset: added to the suit's times, counted from its first frame, to get the plate's times, counted from
    /// its first row or its recording's start, ns.
    Offset(i64),
}

impl FromStr for Join {
    type Err = String;

    /// `clock`, `stomp`, or `offset=SECONDS`.
    fn from_str(text: &str) -> Result<Join, String> {
        let no = || format!("{text} is none of clock, stomp, offset=SECONDS");
        match text.split_once('=') {
            None if text == "clock" => Ok(Join::Clock),
            None if text == "stomp" => Ok(Join::Stomp { within_ns: OFFSET_MAX_NS }),
            Some(("offset", seconds)) => {
                let seconds: f64 = seconds.parse().map_err(|_| no())?;
                let nanoseconds = seconds * 1e9;
                if nanoseconds.abs() <= OFFSET_MAX_NS as f64 {
                    Ok(Join::Offset(nanoseconds.round() as i64))
                } else {
                    Err(no())
                }
            }
            _ => Err(no()),
        }
    }
}

/// The offset found between the clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joined {
    /// Offset added to the suit's times to get the plate's, ns; both count from their file's first sample, those of a
    /// recording from its start.
    pub offset_ns: i64,
    /// The stomps from which the offset follows, if any.
    pub stomps: Option<StompOffset>,
    how: Join,
    /// Duration that both files cover, s.
    pub common_s: f64,
}

impl fmt::Display for Joined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.offset_ns as f64 / 1e9;
        write!(f, "joined by ")?;
        match (self.how, self.stomps) {
            (_, Some(found)) => {
                let ms = |ns: u64| ns as f64 / 1e6;
                let (sigma_ms, residual_ms) = (ms(found.sigma_ns), ms(found.residual_ns));
                let (stomps, hits, stops) = (found.stomps, found.plate_hits, found.foot_stops);
                write!(f, "{stomps} stomps (of {hits} hits of the plate and {stops} stops of a foot): ")?;
                write!(
                    f,
                    "suit + {seconds:.4} s = plate, 1-sigma {sigma_ms:.1} ms, single stomps {residual_ms:.1} ms off"
                )?;
            }
            (Join::Clock, _) => write!(f, "clock: suit + {seconds:.4} s = plate")?,
            _ => write!(f, "the given offset: suit + {seconds:.4} s = plate")?,
        }
        write!(f, "; {:.3} s in common", self.common_s)
    }
}

/// Properties of both files that determine their alignment.
#[derive(Debug, Default)]
struct Survey {
    suit: Span,
    plate: Span,
    suit_unix_ns: Option<u64>,
    plate_unix_ns: Option<u64>,
    forces: Vec<Force>,
    feet: Vec<Feet>,
    heights_m: Vec<(u64, [f64; 2])>,
}

/// First and last sample time, ns; empty until there is one.
#[derive(Debug, Clone, Copy, Default)]
struct Span(Option<(u64, u64)>);

impl Span {
    fn add(&mut self, time_ns: u64) {
        let (first_ns, last_ns) = self.0.unwrap_or((time_ns, time_ns));
        self.0 = Some((first_ns.min(time_ns), last_ns.max(time_ns)));
    }
}

/// Suit samples of the first file and plate samples of the second, in one time base.
pub(super) struct JoinedSamples<'a> {
    suit: Samples<'a>,
    plate: PlateSamples<'a>,
    suit_later_ns: u64,
    plate_later_ns: u64,
    next_suit: Option<Sample>,
    next_ground: Option<Sample>,
}

/// Determines how both files are aligned.
pub(super) fn find(input: &Input, plate: &PlateFile, config: &Config, how: Join) -> anyhow::Result<Joined> {
    let survey = Survey::of(input, plate, config, matches!(how, Join::Stomp { .. }))?;
    let stomps = match how {
        Join::Stomp { within_ns } => Some(survey.stomps(within_ns)?),
        _ => None,
    };
    let offset_ns = match (how, stomps) {
        (Join::Offset(offset_ns), _) => offset_ns,
        (_, Some(found)) => found.offset_ns,
        _ => survey.clock_offset_ns()?,
    };
    let common_s = survey.common_s(offset_ns);
    if common_s <= 0.0 {
        bail!(
            "with {:.3} s between the clocks the two files have no moment in common: they are of two sessions, or the \
             clocks are wrong; try --join stomp",
            offset_ns as f64 / 1e9
        );
    }
    Ok(Joined { offset_ns, stomps, how, common_s })
}

impl Survey {
    fn of(input: &Input, plate: &PlateFile, config: &Config, feet: bool) -> anyhow::Result<Survey> {
        let mut survey = Survey::default();
        let mut samples = input.samples(config)?;
        for sample in samples.by_ref() {
            let Sample::Suit(suit) = sample else { continue };
            survey.suit.add(suit.sample_time_ns);
            if feet {
                survey.add_feet(&suit);
            }
        }
        survey.suit_unix_ns = samples.wall_clock_ns();
        let mut plates = plate.samples(config)?;
        for ground in plates.by_ref() {
            survey.plate.add(ground.sample_time_ns);
            if feet {
                survey.forces.push(Force { time_ns: ground.sample_time_ns, vertical_n: ground.force_n[2] });
            }
        }
        survey.plate_unix_ns = plates.wall_clock_ns();
        if survey.suit.0.is_none() {
            let what = "the first file has no sample of the suit that can be used";
            bail!("{}", with_skipped(what, &samples.skipped()));
        }
        if survey.plate.0.is_none() {
            let what = "the file given with --with has no sample of the plate that can be used";
            bail!("{}", with_skipped(what, &plates.skipped()));
        }
        Ok(survey)
    }

    fn add_feet(&mut self, suit: &SuitSample) {
        let time_ns = suit.sample_time_ns;
        let feet = [Segment::LeftFoot, Segment::RightFoot].map(Segment::index);
        if suit.has(SuitBlocks::LinearKinematics) {
            self.feet.push(Feet { time_ns, upward_m_per_s: feet.map(|foot| suit.velocity_m_per_s[foot][2]) });
        } else {
            self.heights_m.push((time_ns, feet.map(|foot| suit.position_m[foot][2])));
        }
    }

    fn stomps(&self, within_ns: u64) -> anyhow::Result<StompOffset> {
        let of_heights = feet_of_heights(&self.heights_m);
        let feet = if self.feet.is_empty() { &of_heights } else { &self.feet };
        let settings = StompSettings { offset_max_ns: within_ns, ..StompSettings::default() };
        stomp::estimate(&self.forces, feet, &settings).context(
            "the files cannot be joined by stomps; --within S bounds the offset, --join offset=S gives it",
        )
    }

    fn clock_offset_ns(&self) -> anyhow::Result<i64> {
        let missing = |whose: &str, what: &str| {
            format!("--join clock: the {whose} file does not say when it was; {what}")
        };
        let suit_ns =
            self.suit_unix_ns.with_context(|| missing("suit's", "use --join stomp, or offset=SECONDS"))?;
        let plate_ns = self
            .plate_unix_ns
            .with_context(|| missing("plate's", "add --with-start TIME, or use --join stomp"))?;
        let apart_ns = i128::from(suit_ns) - i128::from(plate_ns);
        if apart_ns.unsigned_abs() > u128::from(OFFSET_MAX_NS) {
            bail!(
                "--join clock: the files begin {:.1} days apart; they are not of one session",
                apart_ns as f64 / 8.64e13
            );
        }
        Ok(apart_ns as i64)
    }

    fn common_s(&self, offset_ns: i64) -> f64 {
        let (Some((suit_from, suit_to)), Some((from, to))) = (self.suit.0, self.plate.0) else { return 0.0 };
        let moved = |ns: u64| i128::from(ns) + i128::from(offset_ns);
        let begin_ns = moved(suit_from).max(i128::from(from));
        let end_ns = moved(suit_to).min(i128::from(to));
        (end_ns - begin_ns) as f64 / 1e9
    }
}

impl<'a> JoinedSamples<'a> {
    pub(super) fn new(
        input: &'a Input,
        plate: &'a PlateFile,
        config: &Config,
        joined: &Joined,
    ) -> anyhow::Result<JoinedSamples<'a>> {
        let forward = |ns: i64| u64::try_from(ns).unwrap_or(0);
        let mut both = JoinedSamples {
            suit: input.samples(config)?,
            plate: plate.samples(config)?,
            // The stream that began first keeps its times.
            suit_later_ns: forward(joined.offset_ns),
            plate_later_ns: forward(joined.offset_ns.saturating_neg()),
            next_suit: None,
            next_ground: None,
        };
        both.next_suit = both.advance_suit();
        both.next_ground = both.advance_plate();
        Ok(both)
    }

    pub(super) fn skipped(&self) -> SkippedData {
        let (mut both, plate) = (self.suit.skipped(), self.plate.skipped());
        both.rejected.extend(plate.rejected);
        both.ignored.extend(plate.ignored);
        both
    }

    fn advance_suit(&mut self) -> Option<Sample> {
        let later_ns = self.suit_later_ns;
        let later = |time_ns: &mut u64| *time_ns = time_ns.saturating_add(later_ns);
        self.suit.find_map(|sample| match sample {
            Sample::Suit(mut suit) => {
                [&mut suit.sample_time_ns, &mut suit.arrival_ns, &mut suit.published_ns]
                    .into_iter()
                    .for_each(later);
                Some(Sample::Suit(suit))
            }
            Sample::Body(mut body) => {
                [&mut body.arrival_ns, &mut body.published_ns].into_iter().for_each(later);
                Some(Sample::Body(body))
            }
            Sample::Ground(_) => None,
        })
    }

    fn advance_plate(&mut self) -> Option<Sample> {
        let later_ns = self.plate_later_ns;
        let mut ground = self.plate.next()?;
        for time_ns in [&mut ground.sample_time_ns, &mut ground.arrival_ns, &mut ground.published_ns] {
            *time_ns = time_ns.saturating_add(later_ns);
        }
        Some(Sample::Ground(Box::new(ground)))
    }
}

impl Iterator for JoinedSamples<'_> {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        let suit_ns = self.next_suit.as_ref().map(Sample::delivered_ns);
        let ground_ns = self.next_ground.as_ref().map(Sample::delivered_ns);
        // At equal times the force goes first, as in a CSV.
        let suit_first = match (suit_ns, ground_ns) {
            (Some(suit_ns), Some(ground_ns)) => suit_ns < ground_ns,
            (suit, _) => suit.is_some(),
        };
        if suit_first {
            let next = self.advance_suit();
            std::mem::replace(&mut self.next_suit, next)
        } else {
            let next = self.advance_plate();
            std::mem::replace(&mut self.next_ground, next)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn join_methods_are_parsed() {
        assert_eq!("clock".parse(), Ok(Join::Clock));
        assert_eq!("offset=-1.25".parse(), Ok(Join::Offset(-1_250_000_000)));
        assert!(matches!("stomp".parse(), Ok(Join::Stomp { .. })));
        for wrong in ["", "offset", "offset=", "offset=nan", "offset=1e9", "clock=1", "stamp"] {
            assert!(wrong.parse::<Join>().is_err(), "{wrong}");
        }
    }
}
