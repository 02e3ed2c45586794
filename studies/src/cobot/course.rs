//! The handovers of one worker in turn: at a fixed place, at places from which the controller learns, and the assisted one.

use equipoise_core::handover::experience::LimitRatio;
use equipoise_simulator::cobot::trial::FIXED_M;
use equipoise_simulator::reach::LEVEL_RAD;

use super::planner::{Planner, Presentation};

/// The baseline: handles that turn with the hands.
pub const FIXED: Presentation = Presentation { at_m: FIXED_M, slope_rad: None };
/// The same with the fixed handles of a level box.
pub const LEVEL: Presentation = Presentation { at_m: FIXED_M, slope_rad: Some(LEVEL_RAD) };
/// Handovers between the baseline and the assisted one, from which the controller learns.
pub const LEARNING: usize = 3;
/// Number of attempts at each handover: without a measurement the next place is tried.
const TRIES: usize = 4;

/// What a handover is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The overload at the fixed place.
    Baseline,
    /// The same with fixed handles, for comparison; not added to the experience.
    Level,
    /// Where the corrected limit ratio less its σ is lowest.
    Learning,
    /// Where the corrected limit ratio is lowest; at the fixed place unless that is better by more than σ.
    Assisted,
}

/// The handovers of one worker.
#[derive(Debug, Clone)]
pub struct Course {
    planner: Planner,
    /// `None` at the end.
    purpose: Option<Purpose>,
    has_baseline: bool,
    learned: usize,
    failed: usize,
}

impl Course {
    /// Before the first handover.
    pub fn new(planner: Planner) -> Course {
        let purpose = Some(Purpose::Baseline);
        Course { planner, purpose, has_baseline: false, learned: 0, failed: 0 }
    }

    /// The next handover and its presentation; `None` at the end, or if none is left.
    pub fn next(&self) -> Option<(Purpose, Presentation)> {
        let purpose = self.purpose?;
        let part = match purpose {
            Purpose::Baseline => FIXED,
            Purpose::Level => LEVEL,
            Purpose::Learning => self.planner.best(1.0)?.part,
            Purpose::Assisted if self.has_baseline => {
                self.planner.better_than(FIXED).map_or(FIXED, |better| better.part)
            }
            Purpose::Assisted => self.planner.best(0.0)?.part,
        };
        Some((purpose, part))
    }

    /// Ends the handover at a place with the measured limit ratio. `None`: no valid torque was published, because the arm did not
    /// arrive, the worker did not reach the part, or a state was invalid; the place is not used again.
    pub fn end(&mut self, part: Presentation, measured: Option<LimitRatio>) {
        let Some(purpose) = self.purpose else { return };
        match measured {
            _ if purpose == Purpose::Level => {}
            Some(measured) => self.planner.observe(part, measured),
            None if purpose == Purpose::Baseline => {}
            None => self.planner.exclude(part),
        }
        self.has_baseline |= purpose == Purpose::Baseline && measured.is_some();
        self.learned += usize::from(purpose == Purpose::Learning && measured.is_some());
        self.failed = if measured.is_some() { 0 } else { self.failed + 1 };
        let is_over = measured.is_some() || self.failed == TRIES;
        let next = match purpose {
            Purpose::Baseline if is_over => Some(Purpose::Level),
            Purpose::Level if is_over => Some(Purpose::Learning),
            Purpose::Learning if self.learned == LEARNING || self.failed == TRIES => Some(Purpose::Assisted),
            Purpose::Assisted if is_over => None,
            same => Some(same),
        };
        if next != self.purpose {
            (self.purpose, self.failed) = (next, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::planner::tests::planner;
    use super::*;

    const fn measured(value: f64) -> Option<LimitRatio> {
        Some(LimitRatio { value, sigma: 0.02 })
    }

    #[test]
    fn the_handovers_follow_each_other_and_places_without_a_measurement_are_not_repeated() {
        let mut course = Course::new(planner());
        assert_eq!(course.next(), Some((Purpose::Baseline, FIXED)));
        course.end(FIXED, None);
        assert_eq!(course.next(), Some((Purpose::Baseline, FIXED)));
        course.end(FIXED, measured(0.5));
        assert_eq!(course.next(), Some((Purpose::Level, LEVEL)));
        course.end(LEVEL, measured(0.7));
        let mut refused = None;
        for _ in 0..LEARNING {
            let (purpose, at_m) = course.next().unwrap();
            assert_eq!(purpose, Purpose::Learning);
            course.end(at_m, None);
            let (purpose, other_m) = course.next().unwrap();
            assert!(purpose == Purpose::Learning && other_m != at_m);
            course.end(other_m, measured(0.4));
            refused = Some(at_m);
        }
        let (purpose, at_m) = course.next().unwrap();
        assert!(purpose == Purpose::Assisted && Some(at_m) != refused);
        course.end(at_m, measured(0.3));
        assert_eq!(course.next(), None);
    }
}
