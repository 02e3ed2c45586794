//! Mean values with a σ that accounts for the correlation of neighbouring values.

/// Upper bound of the estimated correlation; a higher one would leave no information.
const CORRELATION_MAX: f64 = 0.95;

/// A mean and its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Average {
    /// The mean.
    pub mean: f64,
    /// 1-σ of the mean.
    pub sigma: f64,
    /// Standard deviation of single values.
    pub scatter: f64,
    /// Straight-line change from the first value to the last.
    pub drift: f64,
}

/// The average of values in the order of time; zero for an empty slice.
///
/// σ of the mean is the scatter over √n, multiplied by √((1 + ρ)/(1 − ρ)) for the correlation ρ of neighbours.
pub fn average(values: &[f64]) -> Average {
    let count = values.len() as f64;
    if values.is_empty() {
        return Average::default();
    }
    let mean = values.iter().sum::<f64>() / count;
    let deviations: Vec<f64> = values.iter().map(|value| value - mean).collect();
    let square_sum: f64 = deviations.iter().map(|deviation| deviation * deviation).sum();
    let lag_one_sum: f64 = deviations.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let scatter = if values.len() > 1 { (square_sum / (count - 1.0)).sqrt() } else { 0.0 };
    let correlation =
        if square_sum > 0.0 { (lag_one_sum / square_sum).clamp(0.0, CORRELATION_MAX) } else { 0.0 };
    let middle = 0.5 * (count - 1.0);
    let index_product_sum: f64 =
        deviations.iter().enumerate().map(|(index, deviation)| (index as f64 - middle) * deviation).sum();
    let index_square_sum: f64 = (0..values.len()).map(|index| (index as f64 - middle).powi(2)).sum();
    Average {
        mean,
        sigma: scatter / count.sqrt() * ((1.0 + correlation) / (1.0 - correlation)).sqrt(),
        scatter,
        drift: if index_square_sum > 0.0 {
            index_product_sum / index_square_sum * (count - 1.0)
        } else {
            0.0
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_its_drift_and_equal_values_have_no_scatter() {
        let line: Vec<f64> = (0..11).map(|index| 5.0 + 0.2 * f64::from(index)).collect();
        let averaged = average(&line);
        assert!((averaged.mean - 6.0).abs() < 1e-12 && (averaged.drift - 2.0).abs() < 1e-12);
        assert_eq!(average(&[3.0; 9]), Average { mean: 3.0, ..Average::default() });
        assert_eq!(average(&[]), Average::default());
    }

    #[test]
    fn fourfold_repeated_values_double_sigma() {
        // A deterministic sequence that resembles noise: the logistic map.
        let mut x = 0.3;
        let mut next = || {
            x = 3.99 * x * (1.0 - x);
            x
        };
        let alone: Vec<f64> = (0..400).map(|_| next()).collect();
        let fours: Vec<f64> = alone.iter().take(100).flat_map(|value| [*value; 4]).collect();
        let [one, four] =
            [average(&alone), average(&fours)].map(|averaged| averaged.sigma / averaged.scatter * 20.0);
        assert!((0.9..1.3).contains(&one), "{one}");
        assert!((1.7..3.0).contains(&four), "{four}");
    }
}
