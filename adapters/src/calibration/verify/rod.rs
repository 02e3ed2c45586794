//! Height of a plate's surface above its sensor, from a pointed rod that is pressed on one point and tilted around.
//!
//! The line of action passes through the rod's tip for every direction of the force. With the tip at (x, y, z) in the
//! world, `Mx = y Fz − z Fy` and `My = z Fx − x Fz`: linear in all three; z is observable if there is shear.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use super::Block;

/// Minimum force on the rod, N.
pub const PRESS_MIN_N: f64 = 50.0;
/// Largest accepted σ of the height, m.
const SIGMA_MAX_M: f64 = 0.005;
/// Minimum count of blocks with the rod pressed on.
const BLOCKS_MIN: usize = 30;
/// Lower bound of the σ of a moment, N m.
const MOMENT_SIGMA_NM: f64 = 0.05;

/// Position of the rod's tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tip {
    /// World, m: the height is that of the surface.
    pub at_m: [f64; 3],
    /// 1-σ, m.
    pub sigma_m: [f64; 3],
    /// Mean shear, N.
    pub shear_n: f64,
    /// Count of blocks in the estimate.
    pub blocks: usize,
}

/// Why the height is unavailable.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum RodRefusal {
    /// The rod was not pressed on for long enough.
    #[error("the rod was pressed on for {:.1} s only, with {PRESS_MIN_N:.0} N or more; {:.1} s are needed", *blocks as f64 / 10.0, BLOCKS_MIN as f64 / 10.0)]
    NotPressed {
        /// Blocks of 0.1 s.
        blocks: usize,
    },
    /// The rod was not tilted enough.
    #[error(
        "the height is known to {:.0} mm only: lean the rod farther and all around (the shear was {shear_n:.0} N)",
        1e3 * sigma_m
    )]
    NotLeant {
        /// 1-σ, m.
        sigma_m: f64,
        /// Mean shear, N.
        shear_n: f64,
    },
}

/// Estimates the tip from blocks of samples relative to the empty plate.
///
/// # Errors
/// A [`RodRefusal`].
pub fn tip(blocks: &[Block]) -> Result<Tip, RodRefusal> {
    let pressed: Vec<&Block> = blocks.iter().filter(|block| block.force_n[2] >= PRESS_MIN_N).collect();
    if pressed.len() < BLOCKS_MIN {
        return Err(RodRefusal::NotPressed { blocks: pressed.len() });
    }
    let (mut information, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let rows = |block: &Block| {
        let ([fx, fy, fz], [mx, my, _]) = (block.force_n, block.moment_nm);
        [(Vector3::new(0.0, fz, -fy), mx), (Vector3::new(-fz, 0.0, fx), my)]
    };
    for (row, moment) in pressed.iter().flat_map(|block| rows(block)) {
        information += row * row.transpose();
        right += row * moment;
    }
    let shear: f64 = pressed.iter().map(|block| block.force_n[0].hypot(block.force_n[1])).sum();
    let shear_n = shear / pressed.len() as f64;
    let Some(inverse) = information.try_inverse() else {
        return Err(RodRefusal::NotLeant { sigma_m: f64::INFINITY, shear_n });
    };
    let at = inverse * right;
    let square: f64 = pressed
        .iter()
        .flat_map(|block| rows(block))
        .map(|(row, moment)| (moment - row.dot(&at)).powi(2))
        .sum();
    let freedom = 2.0 * pressed.len() as f64 - 3.0;
    let sigma_nm = (square / freedom).sqrt().max(MOMENT_SIGMA_NM);
    let sigma_m = [0, 1, 2].map(|axis| sigma_nm * inverse[(axis, axis)].max(0.0).sqrt());
    if sigma_m[2].is_nan() || sigma_m[2] > SIGMA_MAX_M {
        return Err(RodRefusal::NotLeant { sigma_m: sigma_m[2], shear_n });
    }
    Ok(Tip { at_m: at.into(), sigma_m, shear_n, blocks: pressed.len() })
}
