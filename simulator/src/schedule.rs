//! Values over time with smooth transitions between them.

/// A value over time. A transition that is overtaken by another continues beneath it, so the value never jumps.
#[derive(Debug, Clone)]
pub struct Schedule<T> {
    first: T,
    steps: Vec<Step<T>>, // ordered by start
}

#[derive(Debug, Clone)]
struct Step<T> {
    start_s: f64,
    over_s: f64,
    value: T,
}

impl<T: Clone> Schedule<T> {
    /// The value until the first change.
    pub fn starting_with(value: T) -> Schedule<T> {
        Schedule { first: value, steps: Vec::new() }
    }

    /// Moves to `value` from `start_s` on, and reaches it after `over_s`. A start before the previous one's is set to
    /// that.
    pub fn push(&mut self, value: T, start_s: f64, over_s: f64) {
        let start_s = self.steps.last().map_or(start_s, |last| start_s.max(last.start_s));
        self.steps.push(Step { start_s, over_s, value });
    }

    /// The value at a time; `between(from, to, fraction)` interpolates.
    pub fn at(&self, time_s: f64, between: impl Fn(&T, &T, f64) -> T) -> T {
        // A completed transition supersedes all that started before it.
        let settled = self.steps.iter().rposition(|step| step.start_s + step.over_s <= time_s);
        let (mut value, rest) = match settled {
            Some(index) => (self.steps[index].value.clone(), &self.steps[index + 1..]),
            None => (self.first.clone(), &self.steps[..]),
        };
        for step in rest.iter().take_while(|step| step.start_s < time_s) {
            value = between(&value, &step.value, minimum_jerk((time_s - step.start_s) / step.over_s));
        }
        value
    }
}

/// Minimum-jerk movement of Flash and Hogan: 0 to 1 with neither velocity nor acceleration at the ends.
pub fn minimum_jerk(fraction: f64) -> f64 {
    let s = fraction.clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mix(a: &f64, b: &f64, s: f64) -> f64 {
        a + s * (b - a)
    }

    #[test]
    fn values_are_taken_in_time() {
        let mut schedule = Schedule::starting_with(0.0);
        schedule.push(1.0, 2.0, 1.0);
        schedule.push(5.0, 10.0, 2.0);
        for (time, value) in [(0.0, 0.0), (2.0, 0.0), (2.5, 0.5), (3.0, 1.0), (11.0, 3.0), (99.0, 5.0)] {
            assert!((schedule.at(time, mix) - value).abs() < 1e-12, "{time}");
        }
    }

    #[test]
    fn an_interrupted_transition_does_not_jump() {
        let mut schedule = Schedule::starting_with(0.0);
        schedule.push(1.0, 0.0, 2.0);
        schedule.push(-1.0, 1.0, 2.0);
        let at = |t: f64| schedule.at(t, mix);
        let h = 1e-4;
        for step in 1..300 {
            let t = f64::from(step) * 0.01;
            let acceleration = (at(t + h) - 2.0 * at(t) + at(t - h)) / (h * h);
            assert!(acceleration.abs() < 10.0, "{t}: {acceleration}");
        }
    }
}
