//! Noise of the centre of pressure: one kernel per cause, whose sizes are fitted on the phases that are not in
//! question.

use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::DMatrix;

use super::likelihood::{ChannelLikelihood, SizePrior, blocks_of_fit};
use crate::block::{Block, Phase};
use crate::constants::{
    COP_SIZE_BOUNDS, COP_SIZES, COP_SIZES_SIGMA, HEADING_S, INERTIA_ERROR, MISALIGNMENT_RAD,
    MOTION_PER_ACCELERATION_S, MOTION_S, ORIENTATION_S, PLATE_NOISE, POSE_KERNEL, ROOM_S,
    SIGMA_WITHOUT_REFERENCE, SLOPE_HEIGHT_M, SOFT_TISSUE, STANCE_M, SUIT_HEADING, UNSHARED_M, UNSHARED_S,
    WHITE_MIN_M,
};
use crate::linear::{norm, outer, product, root};
use crate::rows::Rows;

/// Number of fitted sizes.
const COUNT: usize = COP_SIZES.len();
/// Index of the white noise among the sizes.
const WHITE: usize = 4;

/// Logarithms of the fitted sizes, in the order and units of [`COP_SIZES`].
pub(super) type Sizes = [f64; COUNT];

/// Covariance of the centre of pressure over all rows, m².
pub(super) fn covariance_m2(rows: &Rows<'_>, sizes: &Sizes) -> DMatrix<f64> {
    let mut sum = fixed_covariance_m2(rows);
    for part in (0..COUNT).filter(|&part| part != WHITE) {
        let square = (2.0 * sizes[part]).exp();
        sum += square * unit_kernel(rows, part);
    }
    add_white(&mut sum, sizes);
    sum
}

/// The most likely sizes; `None` if the residuals are not finite.
pub(super) fn fit(rows: &Rows<'_>) -> Option<Sizes> {
    let has_reference = rows.blocks.iter().any(|block| block.phase == Phase::Reference);
    let strength = if has_reference { 1.0 } else { SIGMA_WITHOUT_REFERENCE };
    let sigma = COP_SIZES_SIGMA.map(|sigma| sigma * strength);
    let mean = COP_SIZES.map(f64::ln);
    let some = rows.subset(&blocks_of_fit(rows));
    if some.len() == 0 {
        return Some(mean);
    }
    let [below, above] = COP_SIZE_BOUNDS;
    likelihood(&some).most_probable(&SizePrior {
        mean,
        sigma,
        min: std::array::from_fn(|i| mean[i] - below * sigma[i]),
        max: std::array::from_fn(|i| mean[i] + above * sigma[i]),
    })
}

fn likelihood(rows: &Rows<'_>) -> ChannelLikelihood<COUNT> {
    let inertia = cop_columns(rows, 1, |block, _| rows.inertia_m(block));
    let mut fixed = fixed_covariance_m2(rows);
    fixed += INERTIA_ERROR * INERTIA_ERROR * outer(&inertia, &inertia);
    let mut residual = cop_columns(rows, 1, |block, _| rows.cop_residual_m(block));
    if !rows.session.has_inertia {
        residual -= inertia;
    }
    let parts = std::array::from_fn(|part| (part != WHITE).then(|| unit_kernel(rows, part)));
    ChannelLikelihood { fixed, parts, residual, add_white }
}

/// Adds the white part to a covariance.
fn add_white(sum: &mut DMatrix<f64>, sizes: &Sizes) {
    let square_m2 = (2.0 * sizes[WHITE]).exp() + WHITE_MIN_M * WHITE_MIN_M;
    for row in 0..sum.nrows() {
        sum[(row, row)] += square_m2;
    }
}

/// A part of unit size, except the white one.
fn unit_kernel(rows: &Rows<'_>, part: usize) -> DMatrix<f64> {
    match part {
        0..3 => orientation_walk(rows, &[0, 1, 2], ORIENTATION_S[part]),
        3 => soft_tissue(rows),
        5 => motion(rows),
        6 => pose(rows),
        _ => orientation_walk(rows, &[2], HEADING_S),
    }
}

/// All parts whose size is not fitted, m².
fn fixed_covariance_m2(rows: &Rows<'_>) -> DMatrix<f64> {
    let mut sum = parameters_m2(rows);
    sum += turning_m2(rows);
    sum += suit_heading_m2(rows);
    let [pose_m, body_m, room_m] = UNSHARED_M;
    let unshared = scaled_by_pairs(rows, pose(rows), |i, j| matern(rows, i, j, UNSHARED_S));
    sum += pose_m * pose_m * unshared;
    sum += stance_covariance_m2(rows);
    sum += slope_height_m2(rows);
    sum += MISALIGNMENT_RAD * MISALIGNMENT_RAD * misalignment(rows);
    let (plate_m, plate_s) = PLATE_NOISE;
    sum += by_pairs(rows.len(), |i, j| {
        let apart_s = (rows.time_s(i) - rows.time_s(j)).abs();
        let mut along = plate_m * plate_m * (-apart_s / plate_s).exp();
        along += room_m * room_m * (-0.5 * (apart_s / ROOM_S).powi(2)).exp();
        let with_body_m2 = body_m * body_m * matern(rows, i, j, UNSHARED_S);
        let (sin, cos) = feet_rotation(rows, i, j);
        let (c, s) = (with_body_m2 * cos, with_body_m2 * sin);
        [[along + c, s], [-s, along + c]]
    });
    sum
}

/// Stance offsets: a random walk with one step per change of stance.
pub(super) fn stance_covariance_m2(rows: &Rows<'_>) -> DMatrix<f64> {
    let [first_m, step_m] = STANCE_M[usize::from(!rows.session.suit_drifts)];
    let begin = rows.blocks.iter().map(|block| block.stance).min().unwrap_or(0);
    by_pairs(rows.len(), |i, j| {
        let shared = rows.blocks[i].stance.min(rows.blocks[j].stance) - begin;
        let along = first_m * first_m + step_m * step_m * shared as f64;
        [[along, 0.0], [0.0, along]]
    })
}

/// Constant error of the height at which the reaction's slope acts.
fn slope_height_m2(rows: &Rows<'_>) -> DMatrix<f64> {
    let column = cop_columns(rows, 1, |block, _| rows.slope(block).map(|slope| SLOPE_HEIGHT_M * slope));
    outer(&column, &column)
}

/// Uncertainty of the identified parameters of the chain.
fn parameters_m2(rows: &Rows<'_>) -> DMatrix<f64> {
    let size = 3 * SEGMENTS;
    let root = root(&rows.session.prior_covariance_m2, size);
    let on_cop = cop_columns(rows, size, |block, column| {
        let rotation = &rows.blocks[block].observation.rotation[column / 3];
        rows.on_cop(block, [0, 1, 2].map(|axis| rotation[axis][column % 3]))
    });
    let columns = product(&on_cop, &root);
    outer(&columns, &columns)
}

/// Error of the tabulated inertias in the body's rotation.
fn turning_m2(rows: &Rows<'_>) -> DMatrix<f64> {
    let columns = cop_columns(rows, 4, |block, group| {
        rows.blocks[block].turning_by_group_m[group].map(|turning_m| INERTIA_ERROR * turning_m)
    });
    outer(&columns, &columns)
}

/// Heading drift of the whole suit.
fn suit_heading_m2(rows: &Rows<'_>) -> DMatrix<f64> {
    let (sigma_rad, time_s) = SUIT_HEADING;
    let column = cop_columns(rows, 1, |block, _| {
        let seen = &rows.blocks[block].observation;
        let [x, y] = [0, 1].map(|axis| seen.com_m[axis] - seen.feet_m[axis]);
        [-y * sigma_rad, x * sigma_rad]
    });
    scaled_by_pairs(rows, outer(&column, &column), |i, j| matern(rows, i, j, time_s))
}

/// Random walk of the segments' orientations about some of the world's axes.
fn orientation_walk(rows: &Rows<'_>, axes: &[usize], time_s: f64) -> DMatrix<f64> {
    let columns = cop_columns(rows, axes.len() * SEGMENTS, |block, column| {
        let mut turn = [0.0; 3];
        turn[axes[column % axes.len()]] = 1.0;
        rows.effect_of_rotation(block, column / axes.len(), turn).0
    });
    scaled_by_pairs(rows, outer(&columns, &columns), |i, j| matern(rows, i, j, time_s))
}

/// Constant misalignment of the sensors.
fn misalignment(rows: &Rows<'_>) -> DMatrix<f64> {
    let columns = cop_columns(rows, 3 * SEGMENTS, |block, column| {
        rows.effect_of_misalignment(block, column / 3, column % 3).0
    });
    outer(&columns, &columns)
}

/// Soft tissue: each axis of a segment's error is any linear function of its joint's rotation.
fn soft_tissue(rows: &Rows<'_>) -> DMatrix<f64> {
    let columns = cop_columns(rows, 9 * SEGMENTS, |block, column| {
        let (segment, axis, joint) = (column / 9, column / 3 % 3, column % 3);
        let (cop_m, _) = rows.effect_of_soft_tissue(block, segment, [axis, joint]);
        cop_m.map(|moved_m| soft_tissue_scale(segment) * moved_m)
    });
    outer(&columns, &columns)
}

/// Amount of soft tissue between sensor and bone, relative to an arm's: less on pelvis, legs and feet.
pub(super) fn soft_tissue_scale(segment: usize) -> f64 {
    let [pelvis_and_feet, legs] = SOFT_TISSUE;
    match Segment::ALL[segment] {
        Segment::Pelvis | Segment::RightFoot | Segment::LeftFoot | Segment::RightToe | Segment::LeftToe => {
            pelvis_and_feet
        }
        Segment::RightUpperLeg | Segment::LeftUpperLeg | Segment::RightLowerLeg | Segment::LeftLowerLeg => {
            legs
        }
        _ => 1.0,
    }
}

/// Errors that grow with motion, m² per (m/s)².
fn motion(rows: &Rows<'_>) -> DMatrix<f64> {
    let speed: Vec<f64> = rows
        .blocks
        .iter()
        .map(|block| {
            norm(block.com_velocity_m_per_s)
                + MOTION_PER_ACCELERATION_S * norm(block.observation.com_acceleration_m_per_s2)
        })
        .collect();
    by_pairs(rows.len(), |i, j| {
        let apart_s = (rows.time_s(i) - rows.time_s(j)).abs();
        let along = speed[i] * speed[j] * (-apart_s / MOTION_S).exp();
        [[along, 0.0], [0.0, along]]
    })
}

/// An unknown smooth function of the pose that rotates with the feet (Kennedy and O'Hagan's model inadequacy).
fn pose(rows: &Rows<'_>) -> DMatrix<f64> {
    let alike = pose_correlation(&rows.blocks);
    by_pairs(rows.len(), |i, j| {
        let (sin, cos) = feet_rotation(rows, i, j);
        let (c, s) = (alike[(i, j)] * cos, alike[(i, j)] * sin);
        [[c, s], [-s, c]]
    })
}

/// Correlation of an unknown smooth function of the pose between blocks.
pub(crate) fn pose_correlation(blocks: &[&Block]) -> DMatrix<f64> {
    let joints = DMatrix::from_fn(blocks.len(), 3 * SEGMENTS, |block, column| {
        blocks[block].joint_rad[column / 3][column % 3]
    });
    let inner = outer(&joints, &joints);
    let (constant, [(wide, wide_rad2), (narrow, narrow_rad2)]) = POSE_KERNEL;
    DMatrix::from_fn(blocks.len(), blocks.len(), |i, j| {
        let apart_rad2 = (inner[(i, i)] + inner[(j, j)] - 2.0 * inner[(i, j)]).max(0.0);
        constant + wide * (-apart_rad2 / wide_rad2).exp() + narrow * (-apart_rad2 / narrow_rad2).exp()
    })
}

/// Sine and cosine of the feet's rotation from block i to block j.
fn feet_rotation(rows: &Rows<'_>, i: usize, j: usize) -> (f64, f64) {
    (rows.blocks[j].heading_rad - rows.blocks[i].heading_rad).sin_cos()
}

/// Matérn 3/2 over time.
fn matern(rows: &Rows<'_>, i: usize, j: usize, time_s: f64) -> f64 {
    let apart = 3.0_f64.sqrt() * (rows.time_s(i) - rows.time_s(j)).abs() / time_s;
    (1.0 + apart) * (-apart).exp()
}

/// Columns on the centre of pressure, two rows a block.
pub(crate) fn cop_columns(
    rows: &Rows<'_>,
    count: usize,
    of: impl Fn(usize, usize) -> [f64; 2],
) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(2 * rows.len(), count);
    for column in 0..count {
        for block in 0..rows.len() {
            let [x, y] = of(block, column);
            columns[(2 * block, column)] = x;
            columns[(2 * block + 1, column)] = y;
        }
    }
    columns
}

/// A symmetric matrix from the covariance of each pair of blocks, rows: axes of the first block.
fn by_pairs(blocks: usize, of: impl Fn(usize, usize) -> [[f64; 2]; 2]) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(2 * blocks, 2 * blocks);
    for j in 0..blocks {
        for i in j..blocks {
            let pair = of(i, j);
            for (row, values) in pair.iter().enumerate() {
                for (column, &value) in values.iter().enumerate() {
                    matrix[(2 * i + row, 2 * j + column)] = value;
                    matrix[(2 * j + column, 2 * i + row)] = value;
                }
            }
        }
    }
    matrix
}

/// Multiplies each pair of blocks by a factor.
fn scaled_by_pairs(
    rows: &Rows<'_>,
    mut matrix: DMatrix<f64>,
    of: impl Fn(usize, usize) -> f64,
) -> DMatrix<f64> {
    for j in 0..rows.len() {
        for i in j..rows.len() {
            let factor = of(i, j);
            for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let value = matrix[(2 * i + row, 2 * j + column)] * factor;
                matrix[(2 * i + row, 2 * j + column)] = value;
                matrix[(2 * j + column, 2 * i + row)] = value;
            }
        }
    }
    matrix
}
