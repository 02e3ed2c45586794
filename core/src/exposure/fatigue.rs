//! Overloading fatigue of every joint, V in [0, 1].
//!
//! The model is the charging and discharging capacitor of Lorenzini, Kim, De Momi & Ajoudani, "A new overloading
//! fatigue model for ergonomic risk assessment with application to human-robot collaboration" (ICRA 2019), which
//! applies the muscle fatigue of Peternel et al. (2018) to the overload torques of the joints:
//!
//! `dV/dt = (1 − V) |Δτ_j| / C_j` under load, `dV/dt = −r V` at rest,
//!
//! so over a step with a constant torque, exactly, `1 − V' = (1 − V) e^(−|Δτ_j| Δt / C_j)` and `V' = V e^(−r Δt)`. (The
//! form is quoted from memory.) That paper determines its parameters on each subject; here they follow from the joint's
//! limit:
//!
//! - **C_j**: an overload of 0.3 τ_max, the end of green, held for its endurance time fills V to 0.993 (five time
//!   constants, as in Peternel et al.; from memory). Endurance is `−ln(s)/(s k)` with k = 1/min for a fraction s of the
//!   maximal strength (Ma, Chablat, Bennis & Zhang, 2009; close to Rohmert's curve, 1960): 241 s at s = 0.3, hence C_j
//!   = 14.6 s · τ_max. The limit replaces the strength, which is larger: the error is on the safe side. The model's
//!   rate is linear in s where endurance is not: at 0.1 τ_max it takes half of Ma's time, at 0.6 twice.
//! - **r** = 0.0137/s, half of the fatigue gone in 51 s: the recovery rate of the three-compartment model, 0.00091/s
//!   for joints in general (Frey-Law, Looft & Heitsman, 2012, whose abstract gives 0.00058 to 0.00168), times 15 at
//!   rest (Looft, Herkert & Frey-Law, 2018); 0.00091 and 15 quoted from memory.
//! - **Rest** of a joint while others are loaded: an overload of up to 0.05 τ_max, since static work below 5 % of
//!   strength is sustainable for hours (Jonsson, 1982).
//!
//! While the torques are withheld, V is constant: neither fatigue nor rest is assumed.

use bytemuck::{Pod, Zeroable};

use super::Load;
use crate::body::JOINTS;
use crate::math;

/// Fraction of τ_max at which the endurance is matched.
const MATCHED_EFFORT: f64 = 0.3;
/// Ma's fatigability k, 1/s.
const FATIGABILITY_PER_S: f64 = 1.0 / 60.0;
/// 1 − V after the endurance time.
const LEFT_AT_ENDURANCE: f64 = 1.0 - 0.993;
/// r, 1/s.
pub const RECOVERY_PER_S: f64 = 0.00091 * 15.0;
/// Overloads up to this fraction of τ_max count as rest.
pub const REST_EFFORT: f64 = 0.05;

/// The fatigue of every joint.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Fatigue {
    /// V, in [0, 1].
    pub by_joint: [f64; JOINTS],
}

/// Time for which a fraction of the maximal strength can be held, s (Ma et al. 2009).
fn endurance_s(effort: f64) -> f64 {
    -math::ln(effort) / (effort * FATIGABILITY_PER_S)
}

/// C_j over τ_max, s.
pub fn capacity_s() -> f64 {
    -MATCHED_EFFORT * endurance_s(MATCHED_EFFORT) / math::ln(LEFT_AT_ENDURANCE)
}

impl Fatigue {
    /// Advances by one time step under a load.
    pub(super) fn advance(&mut self, load: &Load, limit_nm: &[f64; JOINTS], step_s: f64) {
        let rested = math::exp(-RECOVERY_PER_S * step_s);
        match load {
            Load::Unknown => {}
            Load::None => self.by_joint.iter_mut().for_each(|fatigue| *fatigue *= rested),
            Load::Known { torque_nm, .. } => {
                let per_capacity = step_s / capacity_s();
                for ((fatigue, torque_nm), limit_nm) in self.by_joint.iter_mut().zip(torque_nm).zip(limit_nm)
                {
                    let effort = torque_nm / limit_nm;
                    *fatigue = if effort <= REST_EFFORT {
                        *fatigue * rested
                    } else {
                        1.0 - (1.0 - *fatigue) * math::exp(-effort * per_capacity)
                    };
                }
            }
        }
    }

    /// Whether every value is in [0, 1].
    pub fn is_sound(&self) -> bool {
        self.by_joint.iter().all(|fatigue| (0.0..=1.0).contains(fatigue))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exposure::Carried;

    const LIMIT_NM: [f64; JOINTS] = [100.0; JOINTS];

    fn carrying(torque_nm: f64) -> Load {
        let carried = Carried { mass_kg: [0.0, 0.5], distance_m: 0.0 };
        Load::Known { torque_nm: [torque_nm; JOINTS], carried }
    }

    fn after(load: Load, from: f64, seconds: f64, steps: u32) -> f64 {
        let mut fatigue = Fatigue { by_joint: [from; JOINTS] };
        for _ in 0..steps {
            fatigue.advance(&load, &LIMIT_NM, seconds / f64::from(steps));
        }
        assert!(fatigue.is_sound());
        fatigue.by_joint[0]
    }

    #[test]
    fn a_green_load_held_for_its_endurance_time_is_full_fatigue() {
        assert!((endurance_s(0.3) - 240.8).abs() < 0.1, "{}", endurance_s(0.3));
        assert!((capacity_s() - 14.56).abs() < 0.01, "{}", capacity_s());
        assert!((after(carrying(30.0), 0.0, endurance_s(0.3), 1) - 0.993).abs() < 1e-12);
    }

    #[test]
    fn steps_compose() {
        for load in [Load::None, carrying(2.0), carrying(30.0), carrying(300.0)] {
            let (once, often) = (after(load, 0.4, 20.0, 1), after(load, 0.4, 20.0, 2000));
            assert!((once - often).abs() < 1e-12, "{once} {often}");
        }
    }

    #[test]
    fn more_torque_tires_more_and_rest_restores() {
        let tired = after(carrying(30.0), 0.0, 30.0, 1);
        assert!(after(carrying(60.0), 0.0, 30.0, 1) > tired);
        assert!((after(Load::None, tired, 50.78, 1) - 0.5 * tired).abs() < 1e-4);
        assert!(after(carrying(4.9), tired, 10.0, 1) < tired, "next to nothing is rest");
        assert!(after(carrying(5.1), tired, 10.0, 1) > tired);
    }

    #[test]
    fn an_unavailable_load_changes_nothing() {
        assert_eq!(after(Load::Unknown, 0.4, 3600.0, 10), 0.4);
    }

    #[test]
    fn fatigue_stays_in_its_range_whatever_is_carried() {
        assert_eq!(after(carrying(1e12), 0.2, 1.0, 3), 1.0);
        assert!(after(Load::None, 1.0, 1e9, 1) >= 0.0);
    }
}
