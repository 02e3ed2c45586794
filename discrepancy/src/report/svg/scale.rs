//! Ranges of axes and positions of their ticks.

/// The range of an axis; `from < to`, both finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
}

impl Scale {
    /// Covers all finite values, with a margin at each end.
    pub fn covering(values: impl IntoIterator<Item = f64>) -> Scale {
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.into_iter().filter(|value| value.is_finite()) {
            from = from.min(value);
            to = to.max(value);
        }
        if from > to {
            return Scale { from: -1.0, to: 1.0 };
        }
        let room = 0.04 * (to - from).max(1e-9 * from.abs().max(1e-3));
        Scale { from: from - room, to: to + room }
    }

    /// Exactly this range; a wider one if it is empty.
    pub fn exactly(from: f64, to: f64) -> Scale {
        if from < to && (to - from).is_finite() { Scale { from, to } } else { Scale::covering([from, to]) }
    }

    /// Relative position of a value between the ends, in \[0, 1\]; values outside are clamped.
    pub(in crate::report) fn fraction(self, value: f64) -> f64 {
        ((value - self.from) / (self.to - self.from)).clamp(0.0, 1.0)
    }

    /// At most `most` round values (6 or more) within the range, equally spaced: 1, 2 or 5 times a power of ten.
    pub(in crate::report) fn ticks(self, most: usize) -> Ticks {
        let rough = (self.to - self.from) / most.max(1) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0, 20.0]
            .map(|times| times * power)
            .into_iter()
            .find(|step| (self.to / step).floor() - (self.from / step).ceil() < most as f64)
            .unwrap_or(20.0 * power);
        let (first, last) = ((self.from / step).ceil() as i64, (self.to / step).floor() as i64);
        let decimals = (-(step * 1.0001).log10().floor()).max(0.0) as usize;
        Ticks { values: (first..=last).map(|n| n as f64 * step).collect(), decimals }
    }
}

/// The ticks of an axis.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::report) struct Ticks {
    pub(in crate::report) values: Vec<f64>,
    /// Decimals that all of them require.
    pub(in crate::report) decimals: usize,
}

impl Ticks {
    /// A tick's label.
    pub(in crate::report) fn label(&self, value: f64) -> String {
        let decimals = self.decimals;
        format!("{:.decimals$}", value + 0.0).replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_inside_and_neither_few_nor_many() {
        let mut from = -7.3e-4;
        for n in 0..400 {
            from *= 1.09;
            let scale = Scale::exactly(from, from + 1.7f64.powi(n % 23) * from.abs());
            for most in [6, 8] {
                let ticks = scale.ticks(most);
                assert!((2..=most).contains(&ticks.values.len()), "{scale:?} {ticks:?}");
                let step = ticks.values[1] - ticks.values[0];
                for (value, next) in ticks.values.iter().zip(&ticks.values[1..]) {
                    assert!((next - value - step).abs() < 1e-9 * step.abs().max(value.abs()));
                }
                let mantissa = step / 10f64.powf((step * 1.0001).log10().floor());
                assert!([1.0, 2.0, 5.0].iter().any(|m| (mantissa - m).abs() < 1e-3), "{mantissa}");
                assert!(
                    ticks
                        .values
                        .iter()
                        .all(|&v| scale.from <= v + 1e-9 * step && v <= scale.to + 1e-9 * step)
                );
            }
        }
    }

    #[test]
    fn labels_differ_and_read_back_as_their_values() {
        for (from, to) in [(0.0, 1.0), (-0.021, 0.013), (0.0, 3600.0), (-31.0, 4.0), (5.0, 5.3)] {
            let ticks = Scale::exactly(from, to).ticks(6);
            let labels: Vec<String> = ticks.values.iter().map(|&value| ticks.label(value)).collect();
            for (label, value) in labels.iter().zip(&ticks.values) {
                let read: f64 = label.replace('−', "-").parse().unwrap();
                assert!((read - value).abs() < 1e-9, "{label} for {value}");
            }
            assert!(labels.windows(2).all(|pair| pair[0] != pair[1]), "{labels:?}");
        }
    }

    #[test]
    fn a_range_of_nothing_or_of_one_value_is_still_a_range() {
        for values in [vec![], vec![3.0], vec![0.0, 0.0], vec![f64::NAN, f64::INFINITY]] {
            let scale = Scale::covering(values.clone());
            assert!(scale.from < scale.to && scale.from.is_finite() && scale.to.is_finite(), "{values:?}");
        }
        assert!(Scale::exactly(2.0, 2.0).from < 2.0);
    }
}
