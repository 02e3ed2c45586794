//! Whether the worker is known to carry nothing: then residuals are the model's, and motion may teach it.

use bytemuck::{Pod, Zeroable};

/// The external force is averaged over about this time, s.
const MEAN_OVER_S: f64 = 2.0;
/// The mean must have stayed small for this long, s.
const QUIET_FOR_S: f64 = 2.0;
/// A mean force below this share of the load threshold is none.
const NOTHING_SHARE: f64 = 0.4;

/// Watches the external force over seconds. A force that comes and goes with the motion averages out; a load stays.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Unloaded {
    mean_n: f64,
    quiet_s: f64,
}

impl Unloaded {
    /// Takes in the external vertical force, N, `step_s` after the one before; whether nothing is carried.
    ///
    /// `threshold_n`: from which force on something is a load. `sigma_n`: of the force, in this motion.
    pub fn watch(&mut self, delta_f_n: f64, step_s: f64, threshold_n: f64, sigma_n: f64) -> bool {
        let step_s = step_s.clamp(0.0, MEAN_OVER_S);
        self.mean_n += (delta_f_n - self.mean_n) * step_s / (MEAN_OVER_S + step_s);
        let small = self.mean_n.abs() < NOTHING_SHARE * threshold_n;
        let sudden = delta_f_n.abs() > threshold_n + 3.0 * sigma_n;
        self.quiet_s = if small && !sudden { (self.quiet_s + step_s).min(60.0) } else { 0.0 };
        self.quiet_s >= QUIET_FOR_S
    }

    /// Whether nothing was carried for a while, by the last moment watched.
    pub fn is_quiet(&self) -> bool {
        self.quiet_s >= QUIET_FOR_S
    }

    /// Starts over: nothing is known.
    pub fn forget(&mut self) {
        *self = Zeroable::zeroed();
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.mean_n.is_finite() && (0.0..=60.0).contains(&self.quiet_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(seconds: f64, unloaded: &mut Unloaded, force_n: impl Fn(f64) -> f64) -> bool {
        let mut last = false;
        for step in 0..(seconds * 100.0) as u32 {
            last = unloaded.watch(force_n(f64::from(step) * 0.01), 0.01, 15.0, 5.0);
        }
        last
    }

    #[test]
    fn a_force_that_swings_about_nothing_is_no_load_and_one_that_stays_is() {
        let mut unloaded = Unloaded::zeroed();
        assert!(!watch(1.0, &mut unloaded, |_| 0.0), "two seconds are not over");
        assert!(watch(5.0, &mut unloaded, |time_s| 12.0 * (6.0 * time_s).sin()));
        assert!(!watch(6.0, &mut unloaded, |_| 10.0), "a kilogram in the hand");
        assert!(watch(9.0, &mut unloaded, |_| 0.5));
    }

    #[test]
    fn a_sudden_force_ends_it_at_once() {
        let mut unloaded = Unloaded::zeroed();
        assert!(watch(4.0, &mut unloaded, |_| 0.0));
        assert!(!unloaded.watch(60.0, 0.01, 15.0, 5.0));
        assert!(!watch(1.5, &mut unloaded, |_| 0.0));
    }
}
