//! Noise of the force channels: the suit's accelerations have a relative error, its orientations rotate them, the plate
//! adds its own noise. All sizes have lower bounds; otherwise the posterior is overconfident in the newton range.

use equipoise_core::body::SEGMENTS;
use faer::Mat;

use super::kernels::{looseness, norm};
use super::likelihood::{Belief, Question, chosen};
use crate::linear::{outer, product, root};
use crate::rows::Rows;

/// Sizes: slow noise of the plate (N), white (N), fraction of the acceleration, fast fraction of it, orientation drift
/// (unit).
const COUNT: usize = 5;
/// Index of the white part.
const WHITE: usize = 1;
/// Prior of shear and of the vertical force.
const BELIEVED: [[f64; COUNT]; 2] = [[1.0, 0.5, 0.08, 0.05, 1.0], [1.0, 0.5, 0.05, 0.05, 1.0]];
/// Prior 1-σ of the logarithms.
const BELIEF_SIGMA: [f64; COUNT] = [0.8, 0.8, 0.7, 0.7, 0.25];
/// Lower bounds, shear and vertical.
const LEAST: [[f64; COUNT]; 2] = [[0.3, 0.2, 0.06, 0.05, 0.7], [0.3, 0.2, 0.03, 0.03, 0.7]];
/// Error of the channel's zero and of the weight, 1-σ, N.
const ZERO_N: f64 = 1.5;
/// Correlation time of the plate's slow noise, s.
const SLOW_S: f64 = 20.0;
/// Orientation drift, rad, and soft tissue, rad per rad.
const ORIENTATION: (f64, f64) = (0.0122, 0.035);

/// Covariance of one force channel over all rows, N².
pub(crate) fn covariance_n2(rows: &Rows<'_>, axis: usize) -> Option<Mat<f64>> {
    let sizes = fit(rows, axis)?;
    let mut sum = fixed_n2(rows, axis);
    for part in (0..COUNT).filter(|&part| part != WHITE) {
        sum += faer::Scale((2.0 * sizes[part]).exp()) * unit_part(rows, axis, part);
    }
    add_white(&mut sum, &sizes);
    Some(sum)
}

fn add_white(sum: &mut Mat<f64>, sizes: &[f64; COUNT]) {
    for row in 0..sum.nrows() {
        sum[(row, row)] += (2.0 * sizes[WHITE]).exp();
    }
}

fn fit(rows: &Rows<'_>, axis: usize) -> Option<[f64; COUNT]> {
    let vertical = usize::from(axis == 2);
    let believed = BELIEVED[vertical].map(f64::ln);
    let some = rows.subset(&chosen(rows));
    if some.len() == 0 {
        return Some(believed);
    }
    let question = Question {
        fixed: fixed_n2(&some, axis),
        parts: std::array::from_fn(|part| (part != WHITE).then(|| unit_part(&some, axis, part))),
        residual: Mat::from_fn(some.len(), 1, |block, _| some.force_residual_n(block, axis)),
        add_white,
    };
    question.likeliest(&Belief {
        mean: believed,
        sigma: BELIEF_SIGMA,
        least: LEAST[vertical].map(f64::ln),
        most: std::array::from_fn(|i| if i == 4 { 2.5_f64.ln() } else { believed[i] + 3.0 }),
    })
}

/// A zero that all rows share, and the error of the identified parameters: each channel has an independent copy of it,
/// so that errors of differentiated motion carry no information about the parameters.
fn fixed_n2(rows: &Rows<'_>, axis: usize) -> Mat<f64> {
    let size = 3 * SEGMENTS;
    let root = root(&rows.session.prior_covariance_m2, size);
    let on_force = Mat::from_fn(rows.len(), size, |block, column| {
        let turned = &rows.blocks[block].observation.rotation_acceleration_per_s2[column / 3];
        rows.session.mass_kg * turned[axis][column % 3]
    });
    let columns = product(on_force.as_ref(), root.as_ref());
    let mut sum = outer(columns.as_ref(), columns.as_ref());
    for j in 0..rows.len() {
        for i in 0..rows.len() {
            sum[(i, j)] += ZERO_N * ZERO_N;
        }
    }
    sum
}

fn unit_part(rows: &Rows<'_>, axis: usize, part: usize) -> Mat<f64> {
    let mass_kg = rows.session.mass_kg;
    let force_n = |i: usize| rows.blocks[i].observation.com_acceleration_m_per_s2.map(|a| mass_kg * a);
    match part {
        0 => by_pairs(rows, |_, _, apart_s| (-apart_s / SLOW_S).exp()),
        2 => by_pairs(rows, |i, j, apart_s| {
            let (a, b) = (force_n(i), force_n(j));
            (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * (0.5 + 0.5 * (-apart_s / 10.0).exp())
        }),
        3 => by_pairs(rows, |i, j, apart_s| norm(force_n(i)) * norm(force_n(j)) * (-apart_s / 0.35).exp()),
        _ => orientation(rows, axis),
    }
}

/// Effect of orientation errors on the accelerations of the segments' masses.
fn orientation(rows: &Rows<'_>, axis: usize) -> Mat<f64> {
    let (wander_rad, soft) = ORIENTATION;
    let columns = Mat::from_fn(rows.len(), 3 * SEGMENTS, |block, column| {
        let mut turn = [0.0; 3];
        turn[column % 3] = if column % 3 == 2 { 1.5 * wander_rad } else { wander_rad };
        rows.turned_by(block, column / 3, turn).1[axis]
    });
    let slow = outer(columns.as_ref(), columns.as_ref());
    let mut sum = by_pairs(rows, |i, j, apart_s| {
        let apart = 3.0_f64.sqrt() * apart_s / 40.0;
        slow[(i, j)] * (0.8 + 0.8 * (1.0 + apart) * (-apart).exp() + 0.2 * (-apart_s / 3.0).exp())
    });
    let skin = Mat::from_fn(rows.len(), 9 * SEGMENTS, |block, column| {
        let (segment, along, joint) = (column / 9, column / 3 % 3, column % 3);
        let size = soft * looseness(segment) * rows.blocks[block].joint_rad[segment][joint];
        size * rows.turned(block, segment, along).1[axis]
    });
    sum += outer(skin.as_ref(), skin.as_ref());
    sum
}

fn by_pairs(rows: &Rows<'_>, of: impl Fn(usize, usize, f64) -> f64) -> Mat<f64> {
    let mut matrix = Mat::zeros(rows.len(), rows.len());
    for j in 0..rows.len() {
        for i in j..rows.len() {
            let value = of(i, j, (rows.time_s(i) - rows.time_s(j)).abs());
            matrix[(i, j)] = value;
            matrix[(j, i)] = value;
        }
    }
    matrix
}
