//! Whether more measurements of the same kind would still improve the estimate.

use bytemuck::{Pod, Zeroable};

/// Weight of a static pose in motion samples: about its duration, at ten samples per second.
pub(super) const ROWS_PER_POSE: f64 = 20.0;
/// Progress is evaluated over this many samples: six poses, or 12 s of motion …
const ROWS_PER_EVALUATION: f64 = 6.0 * ROWS_PER_POSE;
/// … and has ended if they lower the predicted σ by less than this fraction.
const GAIN_MIN: f64 = 0.1;

/// Predicted σ at the last evaluation.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Progress {
    rows: f64,
    sigma_m: f64,
}

impl Progress {
    /// Ingests the σ after this many more samples, m; returns whether the samples since the last evaluation improved it
    /// little.
    pub(super) fn is_settled(&mut self, rows: f64, sigma_m: f64) -> bool {
        self.rows += rows;
        if self.rows < ROWS_PER_EVALUATION {
            return false;
        }
        let settled = self.sigma_m > 0.0 && sigma_m > (1.0 - GAIN_MIN) * self.sigma_m;
        *self = Progress { rows: 0.0, sigma_m };
        settled
    }

    /// Whether there was at least one evaluation: the counterpart of `poses_min` for motion.
    pub(super) fn has_evaluated(&self) -> bool {
        self.sigma_m > 0.0
    }

    pub(super) fn is_sound(&self) -> bool {
        (0.0..=ROWS_PER_EVALUATION).contains(&self.rows) && self.sigma_m.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_settles_when_more_rows_improve_little_and_not_before() {
        let rows_until = |sigma_m: &dyn Fn(f64) -> f64| {
            let mut progress = Progress::zeroed();
            (1..10_000).map(f64::from).find(|rows| progress.is_settled(1.0, sigma_m(*rows)))
        };
        // By averaging alone, 120 of n samples lower σ by less than 10 % from n = 632 on.
        let averaging = rows_until(&|rows| 0.01 / rows.sqrt()).unwrap();
        assert!((632.0..=720.0).contains(&averaging), "{averaging}");
        assert_eq!(rows_until(&|_| 0.004), Some(240.0));
    }
}
