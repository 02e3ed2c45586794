//! Kalman filter that estimates θ: Eq. 5–10 with the identity as dynamics, one scalar measurement at a time.
//!
//! A pose gives two measurements (CoP x and y). Scalar updates need no matrix inverse. With the optimal gain `K = P hᵀ
//! / s`, `s = h P hᵀ + r`, Joseph's form `(I − K h) P (I − K h)ᵀ + K r Kᵀ` simplifies to `P − w wᵀ` with `w = P hᵀ /
//! √s`: one multiplication and one subtraction per entry. Both triangles are stored and updated by whole rows: `wᵢ wⱼ`
//! and `wⱼ wᵢ` round equally, so P is symmetric to the last bit, and rows are contiguous in memory whereas half of a
//! column is not. Times and ratios: `docs/realtime.md`.
//!
//! Rounding dominates where a difference nearly cancels: every variance is therefore increased by the possible rounding
//! error, and never falls below `r / s` of its previous value, the smallest that a measurement can leave. Tests verify
//! that P stays positive definite, and close to Bierman's factored filter, over measurements whose scales differ by
//! many decades.

use bytemuck::{Pod, Zeroable};

use crate::math;
use crate::sesc::{PARAMETERS, Prior};

/// Number of states in addition to θ that do not describe the subject: the stance offset on the floor, x and y.
pub const NUISANCE: usize = 2;
/// Maximum number of states of a filter.
pub const STATES: usize = PARAMETERS + NUISANCE;

/// Bound of the rounding error of a row of P in one update, as a fraction of its variance: 71 entries, each off by up
/// to two units in the last place of √(P_ii P_jj) in either direction, add up to √71 times that.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Upper bound of a parameter's variance, m²: without a prior 1, inflated at most a hundredfold; the same again for process
/// noise.
const VARIANCE_MAX_M2: f64 = 200.0;
/// Maximum error of a parameter in units of its 1-σ.
const SIGMAS_MAX: f64 = 6.0;

/// State and covariance: `count` parameters θ, then [`NUISANCE`] states that are exactly zero until
/// [`Filter::reset_state`] gives them a variance. Rows and columns beyond are unused.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Filter {
    /// Number of parameters, in [0, 69].
    count: u64,
    /// θ and the nuisance states, m.
    theta_m: [f64; STATES],
    /// P, m².
    covariance_m2: [[f64; STATES]; STATES],
}

/// Difference between a measurement and its prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Measured minus predicted, m.
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
    /// Initialises from a prior of θ, with the nuisance states exactly zero.
    pub fn reset(&mut self, count: usize, prior: &Prior) {
        *self = Zeroable::zeroed();
        let count = count.min(PARAMETERS);
        self.count = count as u64;
        self.theta_m[..count].copy_from_slice(&prior.theta_m[..count]);
        for (row, values) in prior.covariance_m2[..count].iter().enumerate() {
            self.covariance_m2[row][..count].copy_from_slice(&values[..count]);
        }
    }

    /// Adds `v vᵀ` to θ's covariance: θ has an additional error along v whose 1-σ is the length of v, m.
    pub fn widen(&mut self, along_m: &[f64; PARAMETERS]) {
        let count = self.count();
        for (row, own) in self.covariance_m2[..count].iter_mut().zip(along_m) {
            for (entry, other) in row[..count].iter_mut().zip(along_m) {
                *entry += own * other;
            }
        }
    }

    /// Eq. 7 for one state: adds a process variance.
    pub fn add_process_noise(&mut self, index: usize, variance_m2: f64) {
        self.covariance_m2[index][index] += variance_m2;
    }

    /// Resets a state to zero with the variance `variance_m2`, independent of all others.
    pub fn reset_state(&mut self, index: usize, variance_m2: f64) {
        self.theta_m[index] = 0.0;
        self.covariance_m2[index] = [0.0; STATES];
        for row in &mut self.covariance_m2 {
            row[index] = 0.0;
        }
        self.covariance_m2[index][index] = variance_m2;
    }

    /// Sets a state to zero and returns its value, m, by which the caller moves the origin. The covariance is kept.
    pub fn take_state(&mut self, index: usize) -> f64 {
        core::mem::take(&mut self.theta_m[index])
    }

    /// θ, m: the first `count` entries, followed by the nuisance states.
    pub fn theta_m(&self) -> &[f64; STATES] {
        &self.theta_m
    }

    /// Number of parameters of θ.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// Number of states: θ and the nuisance states.
    fn states(&self) -> usize {
        self.count() + NUISANCE
    }

    /// P_jj, m².
    pub fn variance_m2(&self, index: usize) -> f64 {
        self.covariance_m2[index][index]
    }

    /// The largest P_jj of θ, m².
    pub fn variance_max_m2(&self) -> f64 {
        (0..self.count()).map(|index| self.variance_m2(index)).fold(0.0, f64::max)
    }

    /// Row `index` of θ's covariance, m², `count` entries.
    pub fn covariance_row_m2(&self, index: usize) -> &[f64] {
        &self.covariance_m2[index][..self.count()]
    }

    /// Eq. 7: adds the process variance `variance_m2` to each parameter.
    pub fn predict(&mut self, variance_m2: f64) {
        for index in 0..self.count() {
            self.covariance_m2[index][index] += variance_m2;
        }
    }

    /// `h θ`, m.
    pub fn project(&self, h: &[f64; STATES]) -> f64 {
        self.dot(h, &self.theta_m)
    }

    /// `h P hᵀ`, m²: variance of a predicted measurement along `h`.
    pub fn projected_variance_m2(&self, h: &[f64; STATES]) -> f64 {
        self.dot(h, &self.times_covariance(h)).max(0.0)
    }

    /// `h P hᵀ`, the covariance of `h θ` with a nuisance state, and that state's variance, m².
    pub fn projected_with_nuisance_m2(&self, h: &[f64; STATES], nuisance: usize) -> [f64; 3] {
        let (spread, own) = (self.times_covariance(h), self.count() + nuisance);
        [self.dot(h, &spread).max(0.0), spread[own], self.covariance_m2[own][own]]
    }

    /// `P hᵀ` for known nuisance states: θ's part of `P_θθ h − P_θs P_ss⁻¹ P_sθ h`, m²; zero beyond `count`.
    ///
    /// The part of θ that is indistinguishable from a stance's offset cannot be estimated in that stance. This is the
    /// rest.
    pub fn spread_given_nuisance_m2(&self, h: &[f64; PARAMETERS]) -> [f64; STATES] {
        let count = self.count();
        let mut row = [0.0; STATES];
        row[..count].copy_from_slice(&h[..count]);
        let mut spread = self.times_covariance(&row);
        let [x, y] = [0, 1].map(|axis| &self.covariance_m2[count + axis]);
        let [from_x, from_y] = self.nuisance_gain([spread[count], spread[count + 1]]);
        for ((spread, x), y) in spread[..count].iter_mut().zip(x).zip(y) {
            *spread -= from_x * x + from_y * y;
        }
        spread[count..].fill(0.0);
        spread
    }

    /// Mean variance of `h θ + s` over rows of both axes, m², s being the axis' nuisance state. `weight` is the mean of
    /// `h hᵀ` over all rows; `mean_row` the sum of h over the rows of one axis, over the number of all rows.
    pub fn mean_variance_m2(
        &self,
        weight: &[[f64; PARAMETERS]; PARAMETERS],
        mean_row: &[[f64; PARAMETERS]; 2],
    ) -> f64 {
        let count = self.count();
        let dot = |a: &[f64], b: &[f64]| a[..count].iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let of_theta: f64 =
            weight[..count].iter().zip(&self.covariance_m2).map(|(weight, row)| dot(weight, row)).sum();
        let with_nuisance: f64 = (0..2)
            .map(|axis| {
                let nuisance = &self.covariance_m2[count + axis];
                2.0 * dot(&mean_row[axis], nuisance) + 0.5 * nuisance[count + axis]
            })
            .sum();
        (of_theta + with_nuisance).max(0.0)
    }

    /// `P_ss⁻¹ v` of the two nuisance states; zero if their variances are zero.
    fn nuisance_gain(&self, [at_x, at_y]: [f64; 2]) -> [f64; 2] {
        let count = self.count();
        let (xx, xy) = (self.covariance_m2[count][count], self.covariance_m2[count][count + 1]);
        let yy = self.covariance_m2[count + 1][count + 1];
        let determinant = xx * yy - xy * xy;
        if determinant > 0.0 {
            [(yy * at_x - xy * at_y) / determinant, (xx * at_y - xy * at_x) / determinant]
        } else {
            [0.0; 2]
        }
    }

    /// The covariance of `h1 θ` and `h2 θ`, m²: `[h1 P h1ᵀ, h1 P h2ᵀ, h2 P h2ᵀ]`.
    pub fn covariance_of(&self, h1: &[f64; STATES], h2: &[f64; STATES]) -> [f64; 3] {
        let (spread1, spread2) = (self.times_covariance(h1), self.times_covariance(h2));
        [self.dot(h1, &spread1).max(0.0), self.dot(h2, &spread1), self.dot(h2, &spread2).max(0.0)]
    }

    /// Multiplies θ's covariance by `factor`, at least 1, and keeps every correlation, which reduces the weight of past
    /// measurements. Any other factor changes nothing.
    pub fn inflate(&mut self, factor: f64) {
        if !factor.is_finite() || factor < 1.0 {
            return;
        }
        let (count, states, root) = (self.count(), self.states(), math::sqrt(factor));
        for (index, row) in self.covariance_m2[..states].iter_mut().enumerate() {
            let [of_theta, of_nuisance] = if index < count { [factor, root] } else { [root, 1.0] };
            let (parameters, nuisance) = row[..states].split_at_mut(count);
            parameters.iter_mut().for_each(|entry| *entry *= of_theta);
            nuisance.iter_mut().for_each(|entry| *entry *= of_nuisance);
        }
    }

    /// Eq. 8–10 for one measurement `z = h θ + noise` with variance `r_m2`.
    ///
    /// A measurement that is not finite, or a variance that is not positive, changes nothing and returns `None`.
    pub fn update(&mut self, h: &[f64; STATES], z_m: f64, r_m2: f64) -> Option<Innovation> {
        let spread = self.times_covariance(h);
        let projected = self.dot(h, &spread).max(0.0);
        let innovation = Innovation { value_m: z_m - self.project(h), variance_m2: projected + r_m2 };
        if !innovation.value_m.is_finite() || !innovation.variance_m2.is_finite() || r_m2 <= 0.0 {
            return None;
        }
        let scale = 1.0 / math::sqrt(innovation.variance_m2);
        let (mut w, states) = (spread, self.states());
        for (w, theta) in w[..states].iter_mut().zip(&mut self.theta_m) {
            *w *= scale;
            *theta += innovation.value_m * scale * *w;
        }
        self.subtract_square(&w, r_m2 / innovation.variance_m2);
        Some(innovation)
    }

    /// `P − w wᵀ`, with every variance at least `kept` of its previous value and increased by [`ROUNDING`].
    fn subtract_square(&mut self, w: &[f64; STATES], kept: f64) {
        let count = self.states();
        for (index, row) in self.covariance_m2[..count].iter_mut().enumerate() {
            let (own, before) = (w[index], row[index]);
            for (entry, other) in row[..count].iter_mut().zip(w) {
                *entry -= own * other;
            }
            row[index] = (row[index] + ROUNDING * before).max(kept * before);
        }
    }

    /// Eq. 8–10 for the nuisance states alone (Schmidt's filter): θ and its covariance are kept, but included in the
    /// innovation's variance and in the cross-covariance.
    pub fn update_nuisance(&mut self, h: &[f64; STATES], z_m: f64, r_m2: f64) {
        let count = self.count();
        let spread = self.times_covariance(h);
        let innovation_m = z_m - self.project(h);
        let variance_m2 = self.dot(h, &spread).max(0.0) + r_m2;
        // False for NaN.
        if !(innovation_m.abs() < f64::MAX && variance_m2 < f64::MAX && r_m2 > 0.0) {
            return;
        }
        let gain = [0, 1].map(|nuisance| spread[count + nuisance] / variance_m2);
        for (nuisance, gain) in gain.into_iter().enumerate() {
            let own = count + nuisance;
            self.theta_m[own] += gain * innovation_m;
            for (other, value) in spread[..count].iter().enumerate() {
                self.covariance_m2[own][other] -= gain * value;
                self.covariance_m2[other][own] = self.covariance_m2[own][other];
            }
            for (other, value) in spread[count..count + NUISANCE].iter().enumerate() {
                self.covariance_m2[own][count + other] -= gain * value;
            }
        }
        let mean = 0.5 * (self.covariance_m2[count][count + 1] + self.covariance_m2[count + 1][count]);
        self.covariance_m2[count][count + 1] = mean;
        self.covariance_m2[count + 1][count] = mean;
    }

    /// Whether every number is finite, every variance of θ positive (of a nuisance state: not negative) and every
    /// correlation within one; a stored filter is checked before use.
    pub fn is_sound(&self) -> bool {
        self.count() <= PARAMETERS
            && self.theta_m.iter().chain(self.covariance_m2.iter().flatten()).all(|value| value.is_finite())
            && (0..self.states()).all(|row| {
                let variance_m2 = self.variance_m2(row);
                (variance_m2 > 0.0 || (row >= self.count() && variance_m2 == 0.0))
                    && (0..row).all(|column| {
                        let (one, other) = (self.covariance_m2[row][column], self.covariance_m2[column][row]);
                        // A file may lose the last digits to rounding, but not more.
                        let bound = self.variance_m2(row) * self.variance_m2(column);
                        (one - other).abs() <= 1e-9 * one.abs().max(1e-12)
                            && one * one <= bound * (1.0 + 1e-9)
                    })
            })
    }

    /// Whether θ and its variances are possible for a body of this stature, m: a parameter is a sum of fractions of the mass
    /// times lengths within the body (Eq. 2), so its true value is below the stature.
    pub fn is_within_reach(&self, height_m: f64) -> bool {
        (0..self.count()).all(|index| {
            let variance_m2 = self.variance_m2(index);
            variance_m2 <= VARIANCE_MAX_M2
                && self.theta_m[index].abs() <= height_m + SIGMAS_MAX * math::sqrt(variance_m2)
        })
    }

    /// Restores stored values of θ, with the nuisance states exactly zero. Returns whether they are sound.
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
        if !self.is_sound() {
            return false;
        }
        // Restores exact symmetry, which a file may have lost and updates do not restore.
        for row in 1..count {
            let (above, rest) = self.covariance_m2.split_at_mut(row);
            for (entry, mirrored) in rest[0][..row].iter_mut().zip(above) {
                *entry = mirrored[row];
            }
        }
        true
    }

    /// Copies the rows in use from another filter.
    pub(crate) fn copy_from(&mut self, other: &Filter) {
        self.count = other.count;
        self.theta_m = other.theta_m;
        let states = other.states();
        self.covariance_m2[..states].copy_from_slice(&other.covariance_m2[..states]);
    }

    /// `P hᵀ`, zero beyond the states in use.
    ///
    /// P is symmetric, so the sum runs over rows: sums along a row would be sequential, whereas adding rows to each
    /// other fills vector registers. Four rows at a time, so that the partial sum is read and written once for all
    /// four.
    pub fn times_covariance(&self, h: &[f64; STATES]) -> [f64; STATES] {
        let count = self.states();
        let mut sum = [0.0; STATES];
        let (fours, rest) = self.covariance_m2[..count].as_chunks::<4>();
        let (h_fours, h_rest) = h[..count].as_chunks::<4>();
        for (rows, h) in fours.iter().zip(h_fours) {
            let [a, b, c, d] = rows.each_ref().map(|row| &row[..count]);
            for (column, sum) in sum[..count].iter_mut().enumerate() {
                *sum += (a[column] * h[0] + b[column] * h[1]) + (c[column] * h[2] + d[column] * h[3]);
            }
        }
        for (row, h) in rest.iter().zip(h_rest) {
            for (sum, entry) in sum[..count].iter_mut().zip(row) {
                *sum += entry * h;
            }
        }
        sum
    }

    /// `a · b` over the states in use, in four independent sums: in a single sum each addition would wait for the
    /// previous one.
    fn dot(&self, a: &[f64; STATES], b: &[f64; STATES]) -> f64 {
        let count = self.states();
        let ((a, a_rest), (b, b_rest)) = (a[..count].as_chunks::<4>(), b[..count].as_chunks::<4>());
        let mut sums = [0.0; 4];
        for (a, b) in a.iter().zip(b) {
            for lane in 0..4 {
                sums[lane] += a[lane] * b[lane];
            }
        }
        let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
    }
}

#[cfg(test)]
mod tests;
