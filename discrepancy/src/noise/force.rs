//! Noise of the force channels: the suit's accelerations have a relative error, its orientations rotate them, the plate
//! adds its own noise.

use equipoise_core::body::SEGMENTS;
use nalgebra::DMatrix;

use super::cop::soft_tissue_scale;
use super::likelihood::{ChannelLikelihood, SizePrior, blocks_of_fit};
use crate::constants::{
    FORCE_GAIN_KERNEL, FORCE_HEADING_FACTOR, FORCE_ORIENTATION, FORCE_ORIENTATION_KERNEL,
    FORCE_ORIENTATION_MAX, FORCE_SIZE_EXCESS, FORCE_SIZES, FORCE_SIZES_MIN, FORCE_SIZES_SIGMA, FORCE_SLOW_S,
    FORCE_ZERO_N, HEADING_S, MOTION_S,
};
use crate::linear::{norm, outer, product, root};
use crate::rows::Rows;

/// Number of fitted sizes, in the order of [`FORCE_SIZES`].
const COUNT: usize = FORCE_SIZES_SIGMA.len();
/// Index of the white part.
const WHITE: usize = 1;
/// Index of the orientations.
const ORIENTATION: usize = 4;

/// Logarithms of the fitted sizes, in the order and units of [`FORCE_SIZES`].
pub(super) type Sizes = [f64; COUNT];

/// Covariance of one force channel over all rows, N².
pub(super) fn covariance_n2(rows: &Rows<'_>, axis: usize, sizes: &Sizes) -> DMatrix<f64> {
    let mut sum = fixed_covariance_n2(rows, axis);
    for part in (0..COUNT).filter(|&part| part != WHITE) {
        sum += (2.0 * sizes[part]).exp() * unit_kernel(rows, axis, part);
    }
    add_white(&mut sum, sizes);
    sum
}

fn add_white(sum: &mut DMatrix<f64>, sizes: &Sizes) {
    for row in 0..sum.nrows() {
        sum[(row, row)] += (2.0 * sizes[WHITE]).exp();
    }
}

/// The most likely sizes; `None` if the residuals are not finite.
pub(super) fn fit(rows: &Rows<'_>, axis: usize) -> Option<Sizes> {
    let vertical = usize::from(axis == 2);
    let mean = FORCE_SIZES[vertical].map(f64::ln);
    let some = rows.subset(&blocks_of_fit(rows));
    if some.len() == 0 {
        return Some(mean);
    }
    let likelihood = ChannelLikelihood {
        fixed: fixed_covariance_n2(&some, axis),
        parts: std::array::from_fn(|part| (part != WHITE).then(|| unit_kernel(&some, axis, part))),
        residual: DMatrix::from_fn(some.len(), 1, |block, _| {
            some.force_residual_n(block, axis) - some.lacking_inertia_n(block)[axis]
        }),
        add_white,
    };
    likelihood.most_probable(&SizePrior {
        mean,
        sigma: FORCE_SIZES_SIGMA,
        min: FORCE_SIZES_MIN[vertical].map(f64::ln),
        max: std::array::from_fn(|i| match i {
            ORIENTATION => FORCE_ORIENTATION_MAX.ln(),
            _ => mean[i] + FORCE_SIZE_EXCESS,
        }),
    })
}

/// A zero that all rows share, and the error of the identified parameters: each channel has an independent copy of it,
/// so that errors of differentiated motion carry no information about the parameters.
fn fixed_covariance_n2(rows: &Rows<'_>, axis: usize) -> DMatrix<f64> {
    let size = 3 * SEGMENTS;
    let root = root(&rows.session.prior_covariance_m2, size);
    let on_force = DMatrix::from_fn(rows.len(), size, |block, column| {
        let turned = &rows.blocks[block].observation.rotation_acceleration_per_s2[column / 3];
        rows.session.mass_kg * turned[axis][column % 3]
    });
    let columns = product(&on_force, &root);
    let mut sum = outer(&columns, &columns);
    for j in 0..rows.len() {
        for i in 0..rows.len() {
            sum[(i, j)] += FORCE_ZERO_N * FORCE_ZERO_N;
        }
    }
    sum
}

fn unit_kernel(rows: &Rows<'_>, axis: usize, part: usize) -> DMatrix<f64> {
    let mass_kg = rows.session.mass_kg;
    let force_n = |i: usize| rows.blocks[i].observation.com_acceleration_m_per_s2.map(|a| mass_kg * a);
    match part {
        0 => by_pairs(rows, |_, _, apart_s| (-apart_s / FORCE_SLOW_S).exp()),
        2 => by_pairs(rows, |i, j, apart_s| {
            let (a, b) = (force_n(i), force_n(j));
            let (constant, time_s) = FORCE_GAIN_KERNEL;
            (a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
                * (constant + (1.0 - constant) * (-apart_s / time_s).exp())
        }),
        3 => {
            by_pairs(rows, |i, j, apart_s| norm(force_n(i)) * norm(force_n(j)) * (-apart_s / MOTION_S).exp())
        }
        _ => orientation(rows, axis),
    }
}

/// Effect of orientation errors on the accelerations of the segments' masses.
fn orientation(rows: &Rows<'_>, axis: usize) -> DMatrix<f64> {
    let (walk_rad, soft_tissue) = FORCE_ORIENTATION;
    let columns = DMatrix::from_fn(rows.len(), 3 * SEGMENTS, |block, column| {
        let mut turn = [0.0; 3];
        turn[column % 3] = if column % 3 == 2 { FORCE_HEADING_FACTOR * walk_rad } else { walk_rad };
        rows.effect_of_rotation(block, column / 3, turn).1[axis]
    });
    let slow = outer(&columns, &columns);
    let mut sum = by_pairs(rows, |i, j, apart_s| {
        let apart = 3.0_f64.sqrt() * apart_s / HEADING_S;
        let (constant, matern, fast, fast_s) = FORCE_ORIENTATION_KERNEL;
        slow[(i, j)] * (constant + matern * (1.0 + apart) * (-apart).exp() + fast * (-apart_s / fast_s).exp())
    });
    let skin = DMatrix::from_fn(rows.len(), 9 * SEGMENTS, |block, column| {
        let (segment, along, joint) = (column / 9, column / 3 % 3, column % 3);
        let (_, force_n) = rows.effect_of_soft_tissue(block, segment, [along, joint]);
        soft_tissue * soft_tissue_scale(segment) * force_n[axis]
    });
    sum += outer(&skin, &skin);
    sum
}

fn by_pairs(rows: &Rows<'_>, of: impl Fn(usize, usize, f64) -> f64) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(rows.len(), rows.len());
    for j in 0..rows.len() {
        for i in j..rows.len() {
            let value = of(i, j, (rows.time_s(i) - rows.time_s(j)).abs());
            matrix[(i, j)] = value;
            matrix[(j, i)] = value;
        }
    }
    matrix
}
