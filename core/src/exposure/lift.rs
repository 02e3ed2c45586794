//! The mass in the hands and how far it is reached for.

/// The load's centre lies about this far from the middle of the grips, 1-σ per axis, m: a box is not all handle.
const GRIP_SIGMA_M: f64 = 0.10;

/// Mass of an external force and its 1-σ, kg: `ΔF_z / (g + a)`, a being the hands' vertical acceleration and
/// `weight_m_per_s2` the sum. Negative if the force holds the worker up.
pub fn lifted_mass_kg(delta_f_n: f64, sigma_n: f64, weight_m_per_s2: f64) -> [f64; 2] {
    [delta_f_n / weight_m_per_s2, sigma_n / weight_m_per_s2]
}

/// Where the load is, horizontally, by two opinions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// By the two centres of pressure: `(C_wt (W + ΔF) − Ĉ_wo W) / ΔF`, m.
    pub by_pressure_m: [f64; 2],
    /// 1-σ of that per axis, m.
    pub pressure_sigma_m: [f64; 2],
    /// Middle of the grips, m.
    pub grip_middle_m: [f64; 2],
}

impl Place {
    /// The mean of both, each weighted by its inverse variance, m.
    ///
    /// A heavy load on a well-known worker is found by the pressure to a centimetre, a light one only by the hands; the
    /// weighted mean goes from one to the other without a jump.
    pub fn fused_m(&self) -> [f64; 2] {
        core::array::from_fn(|axis| {
            let grip = GRIP_SIGMA_M * GRIP_SIGMA_M;
            let pressure = self.pressure_sigma_m[axis] * self.pressure_sigma_m[axis];
            (self.by_pressure_m[axis] * grip + self.grip_middle_m[axis] * pressure) / (grip + pressure)
        })
    }

    /// Horizontal distance from the middle of the ankles: H of the NIOSH lifting equation (Waters et al., 1993), m.
    pub fn reach_m(&self, ankle_middle_m: [f64; 2]) -> f64 {
        let [x, y] = self.fused_m();
        crate::math::hypot([x - ankle_middle_m[0], y - ankle_middle_m[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overload::GRAVITY_M_PER_S2;

    fn place(sigma_m: f64) -> Place {
        Place { by_pressure_m: [0.5, 0.0], pressure_sigma_m: [sigma_m; 2], grip_middle_m: [0.4, 0.0] }
    }

    #[test]
    fn the_surer_opinion_counts_more() {
        assert_eq!(place(0.0).reach_m([0.1, 0.0]), 0.4);
        assert!((place(0.1).reach_m([0.1, 0.0]) - 0.35).abs() < 1e-12, "equally sure: the middle");
        assert!((place(1e6).reach_m([0.1, 0.0]) - 0.3).abs() < 1e-9);
    }

    #[test]
    fn a_kilogram_weighs_what_it_weighs() {
        assert_eq!(lifted_mass_kg(98.1, 9.81, GRAVITY_M_PER_S2), [98.1 / GRAVITY_M_PER_S2, 1.0]);
        assert!(lifted_mass_kg(-20.0, 3.0, GRAVITY_M_PER_S2)[0] < 0.0);
    }
}
