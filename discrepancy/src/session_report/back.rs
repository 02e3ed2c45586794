//! Load and cumulative dose of the low back.

use equipoise_core::message::{State, Validity};
use equipoise_view::words;

use super::series::Series;

/// Low back, dose and load over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Back {
    /// Compression of the L5/S1 disc while valid, N.
    pub compression_n: Series,
    /// Net moment at L5/S1 while valid, N m.
    pub moment_nm: Series,
    /// Mass in the hands while valid, kg.
    pub lifted_kg: Series,
    /// Cumulative damage of the low back.
    pub damage: Series,
    /// Duration of valid compression, s.
    pub valid_s: f64,
    /// Largest compression, its 1-σ and its time: N, N, s.
    pub peak: Option<[f64; 3]>,
    /// Integrals of the compression and of its 1-σ over the valid time, N s.
    integral_n_s: [f64; 2],
    /// Damage of the first state.
    damage_before: Option<f64>,
    /// Final damage (1 is failure) and probability of a high-risk job; `None` before a lift has added damage.
    pub dose: Option<[f64; 2]>,
}

impl Back {
    /// Adds one state, which represents `step_s`.
    pub fn ingest(&mut self, state: &State, time_s: f64, step_s: f64) {
        if let Some(newtons) = state.unless(Validity::INVALIDATES_LOW_BACK, state.l5s1_compression_n) {
            self.compression_n.push(time_s, newtons);
            self.moment_nm.push(time_s, state.l5s1_moment_nm);
            self.valid_s += step_s;
            let [compression_n_s, sigma_n_s] = &mut self.integral_n_s;
            *compression_n_s += newtons * step_s;
            *sigma_n_s += state.l5s1_compression_sigma_n * step_s;
            if self.peak.is_none_or(|[peak_n, ..]| newtons > peak_n) {
                self.peak = Some([newtons, state.l5s1_compression_sigma_n, time_s]);
            }
        }
        if let Some(mass_kg) = state.unless(Validity::INVALIDATES_LIFTED_MASS, state.lifted_mass_kg) {
            self.lifted_kg.push(time_s, mass_kg);
        }
        self.damage_before.get_or_insert(state.dose_damage);
        self.damage.push(time_s, state.dose_damage);
        self.dose = words::assessed_dose(state);
    }

    /// Mean compression while valid, N, and the mean of its 1-σ: the errors of one session do not average out.
    pub fn mean_n(&self) -> Option<[f64; 2]> {
        (self.valid_s > 0.0).then(|| self.integral_n_s.map(|integral_n_s| integral_n_s / self.valid_s))
    }

    /// Damage since the first state; `None` as long as there is no dose.
    pub fn added_damage(&self) -> Option<f64> {
        // A lift from before the period may have been removed (`subject undo-lift`).
        Some((self.dose?[0] - self.damage_before?).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn only_valid_values_count() {
        let mut back = Back::default();
        back.ingest(&State { valid: Validity::NOT_IDENTIFIED.0, ..State::zeroed() }, 0.5, 0.5);
        assert_eq!(back.dose, None, "an unknown risk is not zero");
        let carried = State { valid: Validity::NOT_IDENTIFIED.0, dose_damage: 1e-4, ..State::zeroed() };
        back.ingest(&carried, 0.6, 0.5);
        assert_eq!(back.dose, Some([1e-4, 0.0]), "damage from before the recording");
        assert_eq!(back.added_damage(), Some(1e-4), "of the second state");
        let state = State { l5s1_compression_n: 2000.0, l5s1_compression_sigma_n: 200.0, ..State::zeroed() };
        back.ingest(&state, 1.0, 0.5);
        back.ingest(&State { l5s1_compression_n: 1000.0, ..state }, 2.0, 0.5);
        back.ingest(&State { l5s1_compression_n: 9000.0, valid: Validity::MOVING.0, ..state }, 3.0, 0.5);
        assert_eq!((back.peak, back.mean_n()), (Some([2000.0, 200.0, 1.0]), Some([1500.0, 200.0])));
        assert_eq!(back.compression_n.points().len(), 2);
        // Without a load the low-back values remain valid.
        back.ingest(&State { valid: Validity::BELOW_LOAD_THRESHOLD.0, ..state }, 4.0, 0.5);
        assert_eq!((back.dose, back.valid_s), (None, 1.5), "valid values without a lift give no risk");
    }
}
