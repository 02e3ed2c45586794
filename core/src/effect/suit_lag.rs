//! `suit_lag`: the suit's samples are dated later than the motion that they contain.
//!
//! No column: the loop corrects the time of samples on arrival, so that all later stages use the right time.

use super::Parameter;

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "tau_s", unit: "s", prior_sigma: 0.06 }];

/// A suit's sample time without the lag, ns: earlier by `tau_s`, or later if it is negative. A lag that is NaN changes
/// nothing; one larger than the time itself gives zero.
pub fn without_lag_ns(sample_time_ns: u64, tau_s: f64) -> u64 {
    let shift_ns = tau_s.abs() * 1e9;
    // The conversion of a float saturates, and maps NaN to zero.
    let shift_ns = (shift_ns + 0.5) as u64;
    if tau_s < 0.0 {
        sample_time_ns.saturating_add(shift_ns)
    } else {
        sample_time_ns.saturating_sub(shift_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::without_lag_ns;

    #[test]
    fn a_late_suit_is_dated_back_and_an_early_one_forward() {
        assert_eq!(without_lag_ns(1_000_000_000, 0.020), 980_000_000);
        assert_eq!(without_lag_ns(1_000_000_000, -0.020), 1_020_000_000);
        for tau_s in [0.0, 1e-12, f64::NAN] {
            assert_eq!(without_lag_ns(1_000_000_000, tau_s), 1_000_000_000);
        }
        assert_eq!(without_lag_ns(5, 1.0), 0);
        assert_eq!(without_lag_ns(without_lag_ns(7_000_000_000, 0.0137), -0.0137), 7_000_000_000);
    }
}
