//! The banner of the page and of the terminal's screen, with hysteresis: a sensor that is silent for less than a second
//! does not replace it. Only words are held; values are withheld by the state itself, from its first invalid cycle on.

use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use serde::Serialize;

use crate::words::{self, Instruction, Reason};

/// A fault is displayed once it was raised for so long, and until it was clear for as long. Radio links lose up to half
/// a second (`SILENT_AFTER_NS` of supervision); a second more is no loss to a person who reads.
const HOLD_NS: u64 = 1_000_000_000;

/// The faults that replace the banner.
const FAULTS: [Validity; 3] = [Validity::SUIT_STALE, Validity::GROUND_STALE, Validity::PLATE_FAULT];

/// What is displayed above the values.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Headline {
    /// Name of the phase, as in the JSON's `phase`.
    pub phase_name: &'static str,
    /// The phase in words.
    pub phase: &'static str,
    /// The one thing to do now.
    pub instruction: Instruction,
    /// Why values are withheld, faults first.
    pub reasons: Vec<Reason>,
}

impl Headline {
    /// Of one state alone. `pose` is the name of the suggested pose, if there is one.
    pub fn of(state: &State, pose: Option<&str>) -> Headline {
        Headline {
            phase_name: Phase::from_number(state.phase).map_or("unknown", Phase::name),
            phase: words::phase(state),
            instruction: words::instruction(state, pose),
            reasons: words::reasons(state),
        }
    }
}

/// The headline of a sequence of states.
#[derive(Debug, Default)]
pub struct Banner {
    /// For each fault and for any of them, how long it was raised less how long it was clear, from 0 to [`HOLD_NS`].
    raised_ns: [u64; FAULTS.len() + 1],
    displayed: [bool; FAULTS.len() + 1],
    updated_ns: Option<u64>,
    headline: Option<Headline>,
}

impl Banner {
    /// Ingests the newest state. The headline stays as it was while a fault is raised and not yet displayed, or clear and
    /// still displayed, except from one fault to the next.
    pub fn update(&mut self, state: &State, pose: Option<&str>) -> &Headline {
        let is_any_raised = FAULTS.iter().any(|fault| state.validity().any_of(*fault));
        let mut raised = [is_any_raised; FAULTS.len() + 1];
        for (raised, fault) in raised.iter_mut().zip(FAULTS) {
            *raised = state.validity().any_of(fault);
        }
        // The first state is displayed at once, and so is the first after a longer silence.
        let step_ns = self
            .updated_ns
            .map_or(HOLD_NS, |updated_ns| state.time_ns.saturating_sub(updated_ns))
            .min(HOLD_NS);
        self.updated_ns = Some(state.time_ns);
        for (index, raised) in raised.into_iter().enumerate() {
            let level_ns = &mut self.raised_ns[index];
            *level_ns =
                if raised { (*level_ns + step_ns).min(HOLD_NS) } else { level_ns.saturating_sub(step_ns) };
            match *level_ns {
                0 => self.displayed[index] = false,
                HOLD_NS => self.displayed[index] = true,
                _ => {}
            }
        }
        let is_fault_displayed = is_any_raised && self.displayed[FAULTS.len()];
        let held = self.headline.take().filter(|_| self.displayed != raised && !is_fault_displayed);
        self.headline.insert(held.unwrap_or_else(|| Headline::of(state, pose)))
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    const STEP_NS: u64 = 50_000_000;

    struct Bench {
        banner: Banner,
        state: State,
    }

    impl Bench {
        fn new() -> Bench {
            let state = State { phase: Phase::Monitoring as u32, time_ns: 5_000_000_000, ..State::zeroed() };
            Bench { banner: Banner::default(), state }
        }

        /// So long with these reasons; whether the headline was an alarm at each step.
        fn alarms(&mut self, ms: u64, valid: Validity) -> Vec<bool> {
            self.state.valid = valid.0;
            let silent = valid.any_of(Validity::GROUND_STALE);
            self.state.phase = if silent { Phase::Degraded } else { Phase::Monitoring } as u32;
            let steps = ms * 1_000_000 / STEP_NS;
            let step = |_| {
                self.state.time_ns += STEP_NS;
                let headline = self.banner.update(&self.state, None);
                let alarm = headline.instruction.key == "reason.ground_stale";
                assert_eq!(alarm, headline.phase_name == "degraded");
                assert_eq!(alarm, headline.reasons.iter().any(|reason| reason.fault));
                alarm
            };
            (0..steps).map(step).collect()
        }
    }

    const FINE: Validity = Validity(0);

    #[test]
    fn gaps_of_less_than_a_second_do_not_change_it_however_many() {
        let mut bench = Bench::new();
        bench.alarms(100, FINE);
        for _ in 0..100 {
            let gap = bench.alarms(350, Validity::GROUND_STALE);
            let fine = bench.alarms(400, FINE);
            assert!(!gap.contains(&true) && !fine.contains(&true));
        }
    }

    #[test]
    fn a_second_of_silence_is_an_alarm_until_a_second_without_it() {
        let mut bench = Bench::new();
        bench.alarms(100, FINE);
        let silent = bench.alarms(2000, Validity::GROUND_STALE);
        assert_eq!(silent.iter().position(|alarm| *alarm), Some(19), "after 20 steps of 50 ms");
        assert!(!bench.alarms(500, FINE).contains(&false), "no flicker on the way back");
        assert_eq!(bench.alarms(2000, FINE).iter().position(|alarm| !alarm), Some(9));
    }

    #[test]
    fn a_sensor_that_is_silent_more_often_than_not_is_an_alarm_at_last() {
        let mut bench = Bench::new();
        bench.alarms(100, FINE);
        let mut alarms = Vec::new();
        for _ in 0..20 {
            alarms.extend(bench.alarms(400, Validity::GROUND_STALE));
            alarms.extend(bench.alarms(200, FINE));
        }
        let first = alarms.iter().position(|alarm| *alarm).expect("an alarm");
        assert!(alarms[first..].iter().all(|alarm| *alarm), "and it stays one");
    }

    #[test]
    fn faults_of_less_than_a_second_in_turn_are_an_alarm() {
        let mut bench = Bench::new();
        bench.alarms(100, FINE);
        bench.state.phase = Phase::Degraded as u32;
        let mut keys = Vec::new();
        for step in 0..80 {
            let fault = if step / 10 % 2 == 0 { Validity::GROUND_STALE } else { Validity::SUIT_STALE };
            bench.state.valid = fault.0;
            bench.state.time_ns += STEP_NS;
            keys.push(bench.banner.update(&bench.state, None).instruction.key.clone());
        }
        assert!(keys[..19].iter().all(|key| !key.ends_with("_stale")), "{keys:?}");
        let expected = ["reason.suit_stale", "reason.ground_stale", "reason.suit_stale"];
        assert_eq!([19, 25, 35].map(|step: usize| keys[step].as_str()), expected);
    }

    #[test]
    fn what_is_first_seen_is_displayed_as_it_is() {
        assert_eq!(Bench::new().alarms(50, Validity::GROUND_STALE), [true]);
        let mut bench = Bench::new();
        bench.alarms(100, FINE);
        bench.state.time_ns += 10 * HOLD_NS;
        assert_eq!(bench.alarms(50, Validity::GROUND_STALE), [true], "after a pause of all states");
    }
}
