//! The filter that learns θ: Eq. 5–10 with the identity for dynamics, one scalar measurement at a time.
//!
//! A pose gives two measurements (CoP x and y). Scalar updates need no matrix inverse and, at 69 parameters, a
//! sixteenth of the time of the textbook form. The covariance is updated in Joseph's form,
//! `P⁺ = (I − K h) P (I − K h)ᵀ + K r Kᵀ`, expanded for one row and written to both triangles at once, so it is
//! symmetric by construction and stays positive for any gain.

use bytemuck::{Pod, Zeroable};

use crate::sesc::{PARAMETERS, Prior};

/// State and covariance; only the first `count` rows and columns mean anything.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Filter {
    /// How many parameters, in [0, 69].
    count: u64,
    /// θ, m.
    theta_m: [f64; PARAMETERS],
    /// P, m².
    covariance_m2: [[f64; PARAMETERS]; PARAMETERS],
}

/// What a measurement said that the filter did not expect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Measured less predicted, m.
    pub value_m: f64,
    /// Its predicted variance `h P hᵀ + r`, m².
    pub variance_m2: f64,
}

impl Innovation {
    /// Normalised innovation squared: χ² with one degree of freedom if filter and measurement agree.
    pub fn normalised_square(&self) -> f64 {
        self.value_m * self.value_m / self.variance_m2
    }
}

impl Filter {
    /// Starts (or starts over) from a prior.
    pub fn reset(&mut self, count: usize, prior: &Prior) {
        self.count = count.min(PARAMETERS) as u64;
        self.theta_m = prior.theta_m;
        self.covariance_m2 = prior.covariance_m2;
    }

    /// θ, m; zero beyond `count`.
    pub fn theta_m(&self) -> &[f64; PARAMETERS] {
        &self.theta_m
    }

    /// How many parameters.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// P_jj, m².
    pub fn variance_m2(&self, index: usize) -> f64 {
        self.covariance_m2[index][index]
    }

    /// The largest P_jj, m².
    pub fn variance_max_m2(&self) -> f64 {
        (0..self.count()).map(|index| self.variance_m2(index)).fold(0.0, f64::max)
    }

    /// Row `index` of P, m², `count` entries.
    pub fn covariance_row_m2(&self, index: usize) -> &[f64] {
        &self.covariance_m2[index][..self.count()]
    }

    /// Eq. 7: lets θ wander by `variance_m2` on each parameter.
    pub fn predict(&mut self, variance_m2: f64) {
        for index in 0..self.count() {
            self.covariance_m2[index][index] += variance_m2;
        }
    }

    /// `h θ`, m.
    pub fn project(&self, h: &[f64; PARAMETERS]) -> f64 {
        h[..self.count()].iter().zip(&self.theta_m).map(|(h, theta)| h * theta).sum()
    }

    /// `h P hᵀ`, m²: how unsure the filter is of a measurement along `h`.
    pub fn projected_variance_m2(&self, h: &[f64; PARAMETERS]) -> f64 {
        let spread = self.times_covariance(h);
        h[..self.count()].iter().zip(&spread).map(|(h, spread)| h * spread).sum::<f64>().max(0.0)
    }

    /// Eq. 8–10 for one measurement `z = h θ + noise` with variance `r_m2`.
    ///
    /// A measurement that is not finite, or a variance that is not positive, changes nothing and returns `None`.
    pub fn update(&mut self, h: &[f64; PARAMETERS], z_m: f64, r_m2: f64) -> Option<Innovation> {
        let count = self.count();
        let spread = self.times_covariance(h);
        let projected: f64 = h[..count].iter().zip(&spread).map(|(h, spread)| h * spread).sum();
        let innovation =
            Innovation { value_m: z_m - self.project(h), variance_m2: projected.max(0.0) + r_m2 };
        if !innovation.value_m.is_finite() || !innovation.variance_m2.is_finite() || r_m2 <= 0.0 {
            return None;
        }
        let gain = spread.map(|spread| spread / innovation.variance_m2);
        for row in 0..count {
            self.theta_m[row] += gain[row] * innovation.value_m;
            for column in row..count {
                let joseph =
                    self.covariance_m2[row][column] - gain[row] * spread[column] - spread[row] * gain[column]
                        + gain[row] * innovation.variance_m2 * gain[column];
                self.covariance_m2[row][column] = joseph;
                self.covariance_m2[column][row] = joseph;
            }
        }
        Some(innovation)
    }

    /// Whether every number is finite, every variance positive and every correlation within one; a stored filter is checked before use.
    pub fn is_sound(&self) -> bool {
        self.count() <= PARAMETERS
            && self.theta_m.iter().chain(self.covariance_m2.iter().flatten()).all(|value| value.is_finite())
            && (0..self.count()).all(|row| {
                self.variance_m2(row) > 0.0
                    && (0..row).all(|column| {
                        let (one, other) = (self.covariance_m2[row][column], self.covariance_m2[column][row]);
                        // Rounding in a file may cost the last digits, not more.
                        let bound = self.variance_m2(row) * self.variance_m2(column);
                        (one - other).abs() <= 1e-9 * one.abs().max(1e-12)
                            && one * one <= bound * (1.0 + 1e-9)
                    })
            })
    }

    /// Puts stored values back; the caller checks [`Filter::is_sound`].
    pub fn restore(&mut self, theta_m: &[f64], covariance_m2: &[f64]) -> bool {
        let count = theta_m.len();
        if count > PARAMETERS || covariance_m2.len() != count * count {
            return false;
        }
        *self = Zeroable::zeroed();
        self.count = count as u64;
        self.theta_m[..count].copy_from_slice(theta_m);
        for (row, values) in covariance_m2.chunks_exact(count.max(1)).enumerate() {
            self.covariance_m2[row][..count].copy_from_slice(values);
        }
        self.is_sound()
    }

    fn times_covariance(&self, h: &[f64; PARAMETERS]) -> [f64; PARAMETERS] {
        let count = self.count();
        let mut product = [0.0; PARAMETERS];
        for (row, product) in product[..count].iter_mut().enumerate() {
            *product = self.covariance_m2[row][..count].iter().zip(h).map(|(p, h)| p * h).sum();
        }
        product
    }
}

#[cfg(test)]
mod tests;
