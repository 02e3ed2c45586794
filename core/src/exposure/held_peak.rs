//! The largest value that a quantity exceeded for a total time: a peak that does not depend on a single sample.

use bytemuck::{Pod, Zeroable};

/// Total time for which a value must be reached to count as a peak, s: half a period of a motion of 5 Hz, above which
/// people hardly move a load, and five times a fault of 20 ms (20 samples of a plate at 1 kHz), which spans at most two
/// samples of a suit. A swing at 1 Hz loses 1 − cos(π · 1 Hz · 0.1 s) = 5 % of its amplitude.
pub const PEAK_SPAN_S: f64 = 0.1;
/// Samples stored: [`PEAK_SPAN_S`] at 240 Hz needs 24. With shorter steps the span is that of this many samples.
const CAPACITY: usize = 32;

/// The largest values with the duration of each, in descending order; unused entries are zero.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct HeldPeak {
    value: [f64; CAPACITY],
    time_s: [f64; CAPACITY],
}

impl HeldPeak {
    /// Adds a positive value with the duration `step_s`; others count as 0.
    pub fn add(&mut self, value: f64, step_s: f64) {
        let place = (0..CAPACITY).find(|&place| self.time_s[place] == 0.0 || self.value[place] < value);
        let Some(place) = place.filter(|_| value > 0.0 && step_s > 0.0) else { return };
        self.value.copy_within(place..CAPACITY - 1, place + 1);
        self.time_s.copy_within(place..CAPACITY - 1, place + 1);
        (self.value[place], self.time_s[place]) = (value, step_s);
        // Entries beyond the span cannot become relevant again.
        let used = self.used();
        self.value[used..].fill(0.0);
        self.time_s[used..].fill(0.0);
    }

    /// The largest value that was reached for [`PEAK_SPAN_S`] in total; 0 if none was.
    pub fn value(&self) -> f64 {
        let used = self.used();
        let total_s: f64 = self.time_s[..used].iter().sum();
        let is_full = used == CAPACITY && self.time_s[CAPACITY - 1] > 0.0;
        if total_s >= PEAK_SPAN_S || is_full { self.value[used - 1] } else { 0.0 }
    }

    /// Number of entries that fill the span.
    fn used(&self) -> usize {
        let mut total_s = 0.0;
        let full = self.time_s.iter().position(|time_s| {
            total_s += time_s;
            total_s >= PEAK_SPAN_S
        });
        full.map_or(CAPACITY, |last| last + 1)
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.value.iter().chain(&self.time_s).all(|value| value.is_finite() && *value >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peak_of(samples: impl IntoIterator<Item = (f64, f64)>) -> f64 {
        let mut peak: HeldPeak = Zeroable::zeroed();
        for (value, step_s) in samples {
            peak.add(value, step_s);
            assert!(peak.is_sound());
        }
        peak.value()
    }

    #[test]
    fn it_is_the_value_that_was_exceeded_for_the_span() {
        // In any order and with any steps: sorted in descending order, the span of 0.1 s ends within the third value.
        let samples = [(3.0, 0.5), (9.0, 0.04), (5.0, 0.03), (4.0, 0.2), (7.0, 0.05)];
        assert_eq!(peak_of(samples), 5.0);
        assert_eq!(peak_of(samples.into_iter().rev()), 5.0);
        let rising = (0..5000).map(|index| (f64::from(index), 0.004));
        assert_eq!(peak_of(rising), 4975.0);
    }

    #[test]
    fn a_short_fault_changes_nothing_and_a_held_peak_does() {
        for hz in [30, 60, 100, 240] {
            let step_s = 1.0 / f64::from(hz);
            let lift = (0..2 * hz).map(|_| (50.0, step_s));
            let fault = (0..(hz / 50).max(1)).map(|_| (100.0, step_s));
            assert_eq!(peak_of(lift.clone().chain(fault)), 50.0, "{hz} Hz");
            let held = (0..hz / 5).map(|_| (70.0, step_s));
            assert_eq!(peak_of(lift.chain(held)), 70.0, "{hz} Hz");
        }
    }

    #[test]
    fn a_value_never_held_counts_as_zero() {
        assert_eq!(peak_of([]), 0.0);
        assert_eq!(peak_of([(9.0, 0.05)]), 0.0);
        assert_eq!(peak_of([(-4.0, 1.0), (f64::NAN, 1.0), (3.0, 0.0)]), 0.0);
        // Faster than any suit: the number of samples is limited by the capacity.
        assert_eq!(peak_of((0..64).map(|index| (f64::from(index), 0.001))), 32.0);
    }
}
