//! The mass in the hands.

/// Mass of an external force and its 1-σ, kg: `ΔF_z / (g + a)`, a being the hands' vertical acceleration and
/// `specific_force_m_per_s2` the sum. Negative if the force supports the subject.
pub fn lifted_mass_kg(delta_f_n: f64, sigma_n: f64, specific_force_m_per_s2: f64) -> [f64; 2] {
    [delta_f_n / specific_force_m_per_s2, sigma_n / specific_force_m_per_s2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GRAVITY_M_PER_S2;

    #[test]
    fn mass_is_force_over_specific_force() {
        assert_eq!(lifted_mass_kg(98.1, 9.81, GRAVITY_M_PER_S2), [98.1 / GRAVITY_M_PER_S2, 1.0]);
        assert!(lifted_mass_kg(-20.0, 3.0, GRAVITY_M_PER_S2)[0] < 0.0);
    }
}
