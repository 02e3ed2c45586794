//! A quantity over time, reduced to the minimum and maximum of each interval for drawing.

use crate::constants::SERIES_INTERVAL_S;

/// Points by time: s, and the quantity's unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    intervals: Vec<Interval>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Interval {
    number: i64,
    lowest: [f64; 2],
    highest: [f64; 2],
}

impl Series {
    /// Adds a value; non-finite values are ignored.
    pub fn push(&mut self, time_s: f64, value: f64) {
        if !value.is_finite() {
            return;
        }
        let (number, point) = ((time_s / SERIES_INTERVAL_S).floor() as i64, [time_s, value]);
        match self.intervals.last_mut() {
            Some(last) if last.number == number => {
                if value < last.lowest[1] {
                    last.lowest = point;
                }
                if value > last.highest[1] {
                    last.highest = point;
                }
            }
            _ => self.intervals.push(Interval { number, lowest: point, highest: point }),
        }
    }

    /// The reduced points, by time.
    pub fn points(&self) -> Vec<[f64; 2]> {
        let mut points = Vec::with_capacity(2 * self.intervals.len());
        for interval in &self.intervals {
            let (low, high) = (interval.lowest, interval.highest);
            points.extend(if low[0] <= high[0] { [low, high] } else { [high, low] });
            points.dedup();
        }
        points
    }

    /// Time of the maximum, s, and its value.
    pub fn highest(&self) -> Option<[f64; 2]> {
        self.intervals.iter().map(|interval| interval.highest).max_by(|a, b| a[1].total_cmp(&b[1]))
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.intervals.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_are_preserved_and_missing_data_leave_a_gap() {
        let mut series = Series::default();
        for (time_s, value) in [(0.0, 1.0), (0.1, 9.0), (0.2, -3.0), (0.24, 2.0), (7.0, 4.0), (7.1, f64::NAN)]
        {
            series.push(time_s, value);
        }
        assert_eq!(series.points(), [[0.1, 9.0], [0.2, -3.0], [7.0, 4.0]]);
        assert_eq!(series.highest(), Some([0.1, 9.0]));
        assert!(Series::default().is_empty() && Series::default().highest().is_none());
    }
}
