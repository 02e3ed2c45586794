//! Net moment about L5/S1 and the compression of its disc.
//!
//! **Moment**: the moment that the pelvis exerts on the body above L5/S1, about the horizontal axes: the weight and the
//! inertia of everything above the joint, and the load.
//!
//! - Weight: from the identified chain. `Σ_i R_i φ_i` over the segments distal of L5/S1 is the first moment of their
//!   mass about that joint, over the body mass (Fortini et al., Eq. 2).
//! - Inertia (Newton and Euler): `Σ_i m_i [(c_i − o) × c̈_i] + d/dt(I_i ω_i)` with the masses and radii of gyration of
//!   the anthropometric table ([`crate::motion::UpperInertia`]). Zero in a static pose and with `motion = "paper"`.
//! - Load: Eq. 15 at L5/S1.
//!
//! Its σ combines the covariance of the chain's parameters, the random walk of the suit's orientations, the relative
//! error of the compensated inertia, the position of the joint ([`JOINT_SIGMA_M`] times the vertical force on it), and
//! the load's own σ.
//!
//! **Compression**: one equivalent extensor muscle with a lever of 60 mm balances the moment and compresses the disc,
//! in addition to the joint force along the lumbar axis: `F = M / 0.06 + u · Σ m_i (c̈_i + g ẑ)`, load included (the
//! cantilever model of Chaffin, Andersson & Martin, *Occupational Biomechanics*; levers of 50 to 75 mm in McGill &
//! Norman 1986 and Jorgensen et al. 2001; the figures quoted from memory). Its 1-σ combines that of the moment, 10 % of
//! the lever, and 15 % of the total for effects omitted by the single muscle: antagonistic muscles, lateral bending,
//! intra-abdominal pressure. NIOSH's action limit for this compression is 3400 N (Waters et al., 1993).

use nalgebra::Vector3;

use crate::math;
use crate::overload::sigma_of_length;

/// Lever of the back's extensors about L5/S1, m.
pub const EXTENSOR_LEVER_M: f64 = 0.06;
/// 1-σ of the lever between people, as a fraction.
const LEVER_SIGMA_RATIO: f64 = 0.10;
/// 1-σ of the model error, as a fraction of the compression.
const MODEL_SIGMA_RATIO: f64 = 0.15;

/// 1-σ per axis of the joint's position relative to the body above it, m: measured segments change their length with
/// posture by 3 to 19 mm (soft tissue, shifting sensors), and the null pose places L5/S1 by proportions.
pub const JOINT_SIGMA_M: f64 = 0.010;

/// The body above L5/S1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpperBody {
    /// Moment of its weight and inertia about L5/S1, world X and Y axes, N m.
    pub moment_nm: [f64; 2],
    /// Its variance per axis, without the uncertainty of the joint's position, (N m)².
    pub variance_nm2: [f64; 2],
    /// Force that supports and accelerates it, world axes, N.
    pub force_n: Vector3<f64>,
    /// Unit vector along the lumbar axis, upwards in standing, world axes.
    pub lumbar_axis: Vector3<f64>,
}

/// The load at L5/S1; zeros without one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadAtBack {
    /// Eq. 15 at L5/S1, world axes, N m.
    pub torque_nm: Vector3<f64>,
    /// 1-σ of its magnitude, N m.
    pub torque_sigma_nm: f64,
    /// Force that supports and accelerates it, world axes, N.
    pub force_n: Vector3<f64>,
}

impl LoadAtBack {
    /// No load.
    pub const NONE: LoadAtBack = LoadAtBack {
        torque_nm: Vector3::new(0.0, 0.0, 0.0),
        torque_sigma_nm: 0.0,
        force_n: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// Load of the low back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Back {
    /// Net moment about the horizontal axes, N m.
    pub moment_nm: f64,
    /// Its 1-σ, N m.
    pub moment_sigma_nm: f64,
    /// Compression of the disc, N.
    pub compression_n: f64,
    /// Its 1-σ, N.
    pub compression_sigma_n: f64,
}

/// Horizontal arm from L5/S1 at which the weight of the whole body has the moment of the body above the joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    /// Along one axis, m.
    pub arm_m: f64,
    /// Its variance, m².
    pub variance_m2: f64,
}

impl Arm {
    /// Conditional normal distribution of the arm: a quantity with an error of this variance deviates by `residual_m`,
    /// and its error has the covariance `common_m2` with the arm's.
    #[must_use]
    pub fn conditional(self, residual_m: f64, variance_m2: f64, common_m2: f64) -> Arm {
        let gain = common_m2 / variance_m2.max(f64::MIN_POSITIVE);
        Arm {
            arm_m: self.arm_m + gain * residual_m,
            variance_m2: (self.variance_m2 - gain * common_m2).max(0.0),
        }
    }
}

impl Back {
    /// Combines body and load, whose errors are assumed to be independent.
    pub fn of(body: &UpperBody, load: &LoadAtBack) -> Back {
        let axes_nm = [body.moment_nm[0] + load.torque_nm.x, body.moment_nm[1] + load.torque_nm.y];
        let moment_nm = math::hypot(axes_nm);
        let force_n = body.force_n + load.force_n;
        let by_place_nm = JOINT_SIGMA_M * force_n.z;
        let variance_nm2 = body.variance_nm2.map(|variance| variance + by_place_nm * by_place_nm);
        let body_sigma_nm = sigma_of_length(axes_nm, [variance_nm2[0], 0.0, variance_nm2[1]]);
        let moment_sigma_nm = math::hypot([body_sigma_nm, load.torque_sigma_nm]);

        let muscle_n = moment_nm / EXTENSOR_LEVER_M;
        // A trunk below the horizontal hangs from the joint: the axial force is then negative and relieves the disc.
        let compression_n = (muscle_n + body.lumbar_axis.dot(&force_n)).max(0.0);
        let by_lever_n = LEVER_SIGMA_RATIO * muscle_n;
        let by_model_n = MODEL_SIGMA_RATIO * compression_n;
        let by_moment_n = moment_sigma_nm / EXTENSOR_LEVER_M;
        let compression_sigma_n = math::hypot([math::hypot([by_lever_n, by_model_n]), by_moment_n]);
        Back { moment_nm, moment_sigma_nm, compression_n, compression_sigma_n }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 400 N at an arm, bent forward by 60°.
    fn leaning(arm_m: f64) -> UpperBody {
        let weight_n = 400.0;
        UpperBody {
            moment_nm: [0.0, -weight_n * arm_m],
            variance_nm2: [4.0, 4.0],
            force_n: Vector3::new(0.0, 0.0, weight_n),
            lumbar_axis: Vector3::new(0.75_f64.sqrt(), 0.0, 0.5),
        }
    }

    #[test]
    fn an_upright_back_without_a_load_carries_the_weight_above_it() {
        let body = UpperBody { lumbar_axis: Vector3::z(), ..leaning(0.0) };
        let back = Back::of(&body, &LoadAtBack::NONE);
        assert_eq!((back.moment_nm, back.compression_n), (0.0, 400.0));
        assert!(back.compression_sigma_n > 0.0);
    }

    #[test]
    fn a_load_in_front_adds_to_a_trunk_that_leans_forward() {
        // 100 N at 0.4 m in front: Eq. 15 gives (0, −40, 0).
        let load = LoadAtBack {
            torque_nm: Vector3::new(0.0, -40.0, 0.0),
            torque_sigma_nm: 1.5,
            force_n: Vector3::new(0.0, 0.0, 100.0),
        };
        let back = Back::of(&leaning(0.15), &load);
        assert!((back.moment_nm - 100.0).abs() < 1e-12);
        // Parameters 2 N m, the joint's position 10 mm of 500 N, the load's own σ; errors across the moment count at
        // second order.
        let expected_nm = (2.0f64.powi(2) + 5.0f64.powi(2) + 1.5f64.powi(2)).sqrt();
        assert!((back.moment_sigma_nm / expected_nm - 1.0).abs() < 2e-3);
        assert!((back.compression_n - (100.0 / 0.06 + 250.0)).abs() < 1e-9);
        let behind = LoadAtBack { torque_nm: -load.torque_nm, ..load };
        assert!((Back::of(&leaning(0.15), &behind).moment_nm - 20.0).abs() < 1e-12);
    }

    #[test]
    fn an_arm_takes_its_own_part_of_the_residual() {
        let arm = Arm { arm_m: 0.1, variance_m2: 16e-6 };
        // Total variance 25 mm², of which 16 is the arm's error: a gain of 0.64.
        let given = arm.conditional(0.010, 25e-6, 16e-6);
        assert!(
            (given.arm_m - 0.1064).abs() < 1e-12 && (given.variance_m2 - 5.76e-6).abs() < 1e-15,
            "{given:?}"
        );
        assert_eq!(arm.conditional(0.010, 25e-6, 0.0), arm, "nothing in common");
        let exact = arm.conditional(0.010, 16e-6, 16e-6);
        assert!((exact.arm_m - 0.11).abs() < 1e-12 && exact.variance_m2 < 1e-18, "all of it");
    }

    #[test]
    fn a_trunk_that_is_accelerated_upwards_presses_more_and_one_that_hangs_less() {
        let still = Back::of(&leaning(0.15), &LoadAtBack::NONE);
        let raised = UpperBody { force_n: Vector3::new(0.0, 0.0, 500.0), ..leaning(0.15) };
        let raised = Back::of(&raised, &LoadAtBack::NONE);
        assert!((raised.compression_n - still.compression_n - 50.0).abs() < 1e-9);
        let hanging = UpperBody { lumbar_axis: Vector3::new(0.6, 0.0, -0.8), ..leaning(0.15) };
        let hanging = Back::of(&hanging, &LoadAtBack::NONE);
        assert!((hanging.compression_n - (1000.0 - 320.0)).abs() < 1e-9);
    }

    #[test]
    fn the_sigma_of_the_compression_has_all_its_parts() {
        let body = UpperBody { variance_nm2: [0.0; 2], ..leaning(0.15) };
        let sure = Back::of(&body, &LoadAtBack::NONE);
        let by_place_n = JOINT_SIGMA_M * 400.0 / EXTENSOR_LEVER_M;
        let expected = ((0.1 * 1000.0f64).powi(2) + (0.15 * 1200.0f64).powi(2) + by_place_n.powi(2)).sqrt();
        assert!((sure.compression_sigma_n / expected - 1.0).abs() < 2e-3);
        let unsure = Back::of(&leaning(0.15), &LoadAtBack::NONE);
        assert!(unsure.compression_sigma_n > sure.compression_sigma_n);
    }
}
