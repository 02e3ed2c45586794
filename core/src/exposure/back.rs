//! Net moment about L5/S1 and the compression of its disc.
//!
//! **Moment**: what the back's muscles must hold against the weight of everything above L5/S1 and against the load.
//! The body's part follows from the identified chain: `Σ_i R_i φ_i` over the segments distal of L5/S1 is the first
//! moment of their mass about that joint, over the body mass (Fortini et al., Eq. 2), so this worker's own trunk
//! counts, not a table's. The load's part is Eq. 15 at L5/S1. Gravity only: no inertia of trunk and arms.
//!
//! **Compression**: one equivalent extensor muscle on a lever of 60 mm balances the moment and presses on the disc, and
//! so do the weights along the lumbar axis: `F = M / 0.06 + (W_above + ΔF) cos(inclination)` (the cantilever model of
//! Chaffin, Andersson & Martin, *Occupational Biomechanics*; levers of 50 to 75 mm in McGill & Norman 1986 and
//! Jorgensen et al. 2001; the figures quoted from memory). Its 1-σ has the moment's, 10 % of the lever, and 15 % of the
//! whole for what one muscle leaves out: muscles that work against each other, sideways bending, the pressure of the
//! belly. NIOSH's action limit for this compression is 3400 N (Waters et al., 1993).

use nalgebra::Vector3;

use crate::math;
use crate::overload::sigma_of_magnitude;

/// Lever of the back's extensors about L5/S1, m.
pub const EXTENSOR_LEVER_M: f64 = 0.06;
/// 1-σ of the lever between people, as a share.
const LEVER_SIGMA_SHARE: f64 = 0.10;
/// 1-σ of what the model leaves out, as a share of the compression.
const MODEL_SIGMA_SHARE: f64 = 0.15;

/// The body above L5/S1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpperBody {
    /// First moment of its weight about L5/S1, horizontal, N m: weight times arm, x and y.
    pub weight_arm_nm: [f64; 2],
    /// Variance of that per axis, (N m)².
    pub variance_nm2: [f64; 2],
    /// Its weight, N.
    pub weight_n: f64,
    /// Cosine of the lumbar axis' inclination: 1 upright, 0 level.
    pub upright: f64,
}

/// The load at L5/S1; zeros without one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadAtBack {
    /// Eq. 15 at L5/S1, world axes, N m.
    pub torque_nm: Vector3<f64>,
    /// 1-σ of its magnitude, N m.
    pub torque_sigma_nm: f64,
    /// ΔF, N.
    pub delta_f_n: f64,
}

impl LoadAtBack {
    /// Nothing is carried.
    pub const NONE: LoadAtBack =
        LoadAtBack { torque_nm: Vector3::new(0.0, 0.0, 0.0), torque_sigma_nm: 0.0, delta_f_n: 0.0 };
}

/// What the low back bears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Back {
    /// Net moment about the horizontal axes, N m.
    pub moment_nm: f64,
    /// 1-σ of it, N m.
    pub moment_sigma_nm: f64,
    /// Compression of the disc, N.
    pub compression_n: f64,
    /// 1-σ of it, N.
    pub compression_sigma_n: f64,
}

/// Two axes, each with a doubt of its own.
fn independent([x, y]: [f64; 2]) -> [[f64; 2]; 2] {
    [[math::sqrt(x), 0.0], [0.0, math::sqrt(y)]]
}

impl Back {
    /// Body and load together. Their errors are taken to be independent.
    pub fn of(body: &UpperBody, load: &LoadAtBack) -> Back {
        // r × W ẑ = (r_y W, −r_x W, 0): the torque back as an arm times a weight.
        let arm_nm = [body.weight_arm_nm[0] - load.torque_nm.y, body.weight_arm_nm[1] + load.torque_nm.x];
        let moment_nm = math::hypot(arm_nm);
        let body_sigma_nm = sigma_of_magnitude(arm_nm, &independent(body.variance_nm2));
        let moment_sigma_nm = math::hypot([body_sigma_nm, load.torque_sigma_nm]);

        let muscle_n = moment_nm / EXTENSOR_LEVER_M;
        let weights_n = (body.weight_n + load.delta_f_n).max(0.0) * body.upright.max(0.0);
        let compression_n = muscle_n + weights_n;
        let by_lever_n = LEVER_SIGMA_SHARE * muscle_n;
        let by_model_n = MODEL_SIGMA_SHARE * compression_n;
        let by_moment_n = moment_sigma_nm / EXTENSOR_LEVER_M;
        let compression_sigma_n = math::hypot([math::hypot([by_lever_n, by_model_n]), by_moment_n]);
        Back { moment_nm, moment_sigma_nm, compression_n, compression_sigma_n }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaning(arm_m: f64) -> UpperBody {
        let weight_n = 400.0;
        UpperBody { weight_arm_nm: [weight_n * arm_m, 0.0], variance_nm2: [4.0, 4.0], weight_n, upright: 0.5 }
    }

    #[test]
    fn an_upright_back_without_a_load_bears_the_weight_above_it() {
        let body = UpperBody { upright: 1.0, ..leaning(0.0) };
        let back = Back::of(&body, &LoadAtBack::NONE);
        assert_eq!((back.moment_nm, back.compression_n), (0.0, 400.0));
        assert!(back.compression_sigma_n > 0.0);
    }

    #[test]
    fn a_load_in_front_adds_to_a_trunk_that_leans_forward() {
        // 100 N at 0.4 m in front: Eq. 15 gives (0, −40, 0).
        let load =
            LoadAtBack { torque_nm: Vector3::new(0.0, -40.0, 0.0), torque_sigma_nm: 1.5, delta_f_n: 100.0 };
        let back = Back::of(&leaning(0.15), &load);
        assert!((back.moment_nm - 100.0).abs() < 1e-12);
        assert!((back.moment_sigma_nm - 2.5).abs() < 1e-12);
        assert!((back.compression_n - (100.0 / 0.06 + 250.0)).abs() < 1e-9);
        let behind = LoadAtBack { torque_nm: -load.torque_nm, ..load };
        assert!((Back::of(&leaning(0.15), &behind).moment_nm - 20.0).abs() < 1e-12);
    }

    #[test]
    fn the_sigma_of_the_compression_has_all_its_parts() {
        let body = UpperBody { variance_nm2: [0.0; 2], ..leaning(0.15) };
        let sure = Back::of(&body, &LoadAtBack::NONE);
        let expected = ((0.1 * 1000.0f64).powi(2) + (0.15 * 1200.0f64).powi(2)).sqrt();
        assert!((sure.compression_sigma_n - expected).abs() < 1e-9);
        let unsure = Back::of(&leaning(0.15), &LoadAtBack::NONE);
        assert!(unsure.compression_sigma_n > sure.compression_sigma_n);
    }
}
