//! Kernels of the centre of pressure: one shape per cause.

use equipoise_core::body::{SEGMENTS, Segment};
use faer::Mat;

use crate::linear::{outer, product, root};
use crate::rows::Rows;

/// Number of fitted sizes.
pub(crate) const COUNT: usize = 8;
/// Index of the white noise among the sizes.
pub(crate) const WHITE: usize = 4;

/// Logarithms of the fitted sizes: orientation drift over 60 s, 12 s and 2.5 s (rad), soft tissue (rad per rad), white
/// noise (m), error in motion (s), unknown function of the pose (m), additional heading drift (rad).
pub(crate) type Sizes = [f64; COUNT];

/// Correlation times of orientation drift, s.
const WANDER_S: [f64; 3] = [60.0, 12.0, 2.5];
/// Headings drift more than inclinations, since gravity does not bound them; correlation time, s.
const HEADING_S: f64 = 40.0;
/// Misalignment of the sensors from the start, 1-σ, rad: of trunk and arms the identified parameters have absorbed it,
/// of moving segments and of the legs they have not.
const CROOKED_RAD: f64 = 0.015;
/// Heading of the whole suit: 1-σ, rad, and correlation time, s.
const WHOLE_HEADING: (f64, f64) = (0.006, 60.0);
/// Offset of the first stance and increment with each change of stance, 1-σ, m: of a suit that drifts and of one that
/// does not. Recordings of the simulated suit show a centimetre for each foot placed elsewhere.
const STANCE_M: [[f64; 2]; 2] = [[0.005, 0.015], [0.002, 0.0]];
/// Height at which the reaction's slope acts: 1-σ of its error, m. Smoothing and tabulated inertias contribute
/// centimetres.
const LEVER_M: f64 = 0.08;
/// Present model error that was absent in the clean phases: function of the pose, offset with the body, offset in the
/// room, 1-σ, m. A minimum by design, never fitted.
const NOT_SHARED_M: [f64; 3] = [0.002, 0.002, 0.0015];
/// The part that is not shared changes over this time, s, without steps: a step is an effect.
const NOT_SHARED_S: f64 = 30.0;
/// Slow noise of the plate: 1-σ, m, and correlation time, s.
const PLATE: (f64, f64) = (0.0005, 3.0);
/// Relative error of the rotational inertia of each group of segments.
const TURNING_SHARE: f64 = 0.2;
/// Lower bound of the white noise, 1-σ, m.
const WHITE_FLOOR_M: f64 = 2e-4;

/// The sum of all parts with these sizes, m².
pub(crate) fn covariance_m2(rows: &Rows<'_>, sizes: &Sizes) -> Mat<f64> {
    let mut sum = fixed_m2(rows);
    for part in (0..COUNT).filter(|&part| part != WHITE) {
        let square = (2.0 * sizes[part]).exp();
        sum += faer::Scale(square) * unit_part(rows, part);
    }
    add_white(&mut sum, sizes);
    sum
}

/// Adds the white part to a covariance.
pub(crate) fn add_white(sum: &mut Mat<f64>, sizes: &Sizes) {
    let square_m2 = (2.0 * sizes[WHITE]).exp() + WHITE_FLOOR_M * WHITE_FLOOR_M;
    for row in 0..sum.nrows() {
        sum[(row, row)] += square_m2;
    }
}

/// A part of unit size; not for the white one.
pub(crate) fn unit_part(rows: &Rows<'_>, part: usize) -> Mat<f64> {
    match part {
        0..3 => wander(rows, &[0, 1, 2], WANDER_S[part]),
        3 => soft_tissue(rows),
        5 => motion(rows),
        6 => pose(rows),
        _ => wander(rows, &[2], HEADING_S),
    }
}

/// All parts whose size is not fitted, m².
pub(crate) fn fixed_m2(rows: &Rows<'_>) -> Mat<f64> {
    let mut sum = parameters_m2(rows);
    sum += turning_m2(rows);
    sum += whole_heading_m2(rows);
    let [pose_m, body_m, room_m] = NOT_SHARED_M;
    let not_shared = times(rows, pose(rows), |i, j| matern(rows, i, j, NOT_SHARED_S));
    sum += faer::Scale(pose_m * pose_m) * not_shared;
    sum += stance_m2(rows);
    sum += lever_m2(rows);
    sum += faer::Scale(CROOKED_RAD * CROOKED_RAD) * crooked(rows);
    sum += by_pairs(rows.len(), |i, j| {
        let apart_s = (rows.time_s(i) - rows.time_s(j)).abs();
        let mut along = PLATE.0 * PLATE.0 * (-apart_s / PLATE.1).exp();
        along += room_m * room_m * (-0.5 * (apart_s / 60.0).powi(2)).exp();
        let with_body_m2 = body_m * body_m * matern(rows, i, j, NOT_SHARED_S);
        let (sin, cos) = turned(rows, i, j);
        let (c, s) = (with_body_m2 * cos, with_body_m2 * sin);
        [[along + c, s], [-s, along + c]]
    });
    sum
}

/// Stance offsets: a random walk with one step per change of stance.
pub(crate) fn stance_m2(rows: &Rows<'_>) -> Mat<f64> {
    let [first_m, step_m] = STANCE_M[usize::from(!rows.session.suit_drifts)];
    let begin = rows.blocks.iter().map(|block| block.stance).min().unwrap_or(0);
    by_pairs(rows.len(), |i, j| {
        let shared = rows.blocks[i].stance.min(rows.blocks[j].stance) - begin;
        let along = first_m * first_m + step_m * step_m * shared as f64;
        [[along, 0.0], [0.0, along]]
    })
}

/// The lever of horizontal forces has a constant error.
fn lever_m2(rows: &Rows<'_>) -> Mat<f64> {
    let column = features(rows, 1, |block, _| rows.slope(block).map(|slope| LEVER_M * slope));
    outer(column.as_ref(), column.as_ref())
}

/// Uncertainty of the identified parameters of the chain.
fn parameters_m2(rows: &Rows<'_>) -> Mat<f64> {
    let size = 3 * SEGMENTS;
    let root = root(&rows.session.prior_covariance_m2, size);
    let on_cop = features(rows, size, |block, column| {
        let rotation = &rows.blocks[block].observation.rotation[column / 3];
        rows.on_cop(block, [0, 1, 2].map(|axis| rotation[axis][column % 3]))
    });
    let columns = product(on_cop.as_ref(), root.as_ref());
    outer(columns.as_ref(), columns.as_ref())
}

/// Error of the tabulated inertias in the body's rotation.
fn turning_m2(rows: &Rows<'_>) -> Mat<f64> {
    let columns = features(rows, 4, |block, group| {
        rows.blocks[block].turning_by_group_m[group].map(|turning_m| TURNING_SHARE * turning_m)
    });
    outer(columns.as_ref(), columns.as_ref())
}

/// Drift of the suit's north.
fn whole_heading_m2(rows: &Rows<'_>) -> Mat<f64> {
    let (sigma_rad, time_s) = WHOLE_HEADING;
    let column = features(rows, 1, |block, _| {
        let seen = &rows.blocks[block].observation;
        let [x, y] = [0, 1].map(|axis| seen.com_m[axis] - seen.feet_m[axis]);
        [-y * sigma_rad, x * sigma_rad]
    });
    times(rows, outer(column.as_ref(), column.as_ref()), |i, j| matern(rows, i, j, time_s))
}

/// Orientation drift of the segments about some of the world's axes.
fn wander(rows: &Rows<'_>, axes: &[usize], time_s: f64) -> Mat<f64> {
    let columns = features(rows, axes.len() * SEGMENTS, |block, column| {
        let mut turn = [0.0; 3];
        turn[axes[column % axes.len()]] = 1.0;
        rows.turned_by(block, column / axes.len(), turn).0
    });
    times(rows, outer(columns.as_ref(), columns.as_ref()), |i, j| matern(rows, i, j, time_s))
}

/// Constant misalignment of the sensors.
fn crooked(rows: &Rows<'_>) -> Mat<f64> {
    let columns = features(rows, 3 * SEGMENTS, |block, column| rows.turned(block, column / 3, column % 3).0);
    outer(columns.as_ref(), columns.as_ref())
}

/// Soft tissue: each axis of a segment's error is any linear function of its joint's rotation.
fn soft_tissue(rows: &Rows<'_>) -> Mat<f64> {
    let columns = features(rows, 9 * SEGMENTS, |block, column| {
        let (segment, axis, joint) = (column / 9, column / 3 % 3, column % 3);
        let size = looseness(segment) * rows.blocks[block].joint_rad[segment][joint];
        rows.turned(block, segment, axis).0.map(|moved| moved * size)
    });
    outer(columns.as_ref(), columns.as_ref())
}

/// Amount of soft tissue between sensor and bone, relative to an arm's: less on pelvis, legs and feet.
pub(super) fn looseness(segment: usize) -> f64 {
    match Segment::ALL[segment] {
        Segment::Pelvis | Segment::RightFoot | Segment::LeftFoot | Segment::RightToe | Segment::LeftToe => {
            0.4
        }
        Segment::RightUpperLeg | Segment::LeftUpperLeg | Segment::RightLowerLeg | Segment::LeftLowerLeg => {
            0.7
        }
        _ => 1.0,
    }
}

/// Errors that grow with motion, correlation time a third of a second; m² per (m/s)².
fn motion(rows: &Rows<'_>) -> Mat<f64> {
    let speed: Vec<f64> = rows
        .blocks
        .iter()
        .map(|block| {
            norm(block.com_velocity_m_per_s) + 0.15 * norm(block.observation.com_acceleration_m_per_s2)
        })
        .collect();
    by_pairs(rows.len(), |i, j| {
        let apart_s = (rows.time_s(i) - rows.time_s(j)).abs();
        let along = speed[i] * speed[j] * (-apart_s / 0.35).exp();
        [[along, 0.0], [0.0, along]]
    })
}

/// An unknown smooth function of the pose that rotates with the feet (Kennedy and O'Hagan's model inadequacy).
fn pose(rows: &Rows<'_>) -> Mat<f64> {
    let joints = Mat::from_fn(rows.len(), 3 * SEGMENTS, |block, column| {
        rows.blocks[block].joint_rad[column / 3][column % 3]
    });
    let inner = outer(joints.as_ref(), joints.as_ref());
    by_pairs(rows.len(), |i, j| {
        let apart_rad2 = (inner[(i, i)] + inner[(j, j)] - 2.0 * inner[(i, j)]).max(0.0);
        let alike = 0.2 + 0.4 * (-apart_rad2 / 12.5).exp() + 0.4 * (-apart_rad2 / 2.0).exp();
        let (sin, cos) = turned(rows, i, j);
        [[alike * cos, alike * sin], [-alike * sin, alike * cos]]
    })
}

/// Sine and cosine of the feet's rotation from block i to block j.
fn turned(rows: &Rows<'_>, i: usize, j: usize) -> (f64, f64) {
    (rows.blocks[j].heading_rad - rows.blocks[i].heading_rad).sin_cos()
}

/// Matérn 3/2 over time.
fn matern(rows: &Rows<'_>, i: usize, j: usize, time_s: f64) -> f64 {
    let apart = 3.0_f64.sqrt() * (rows.time_s(i) - rows.time_s(j)).abs() / time_s;
    (1.0 + apart) * (-apart).exp()
}

/// Columns on the centre of pressure, two rows a block.
pub(crate) fn features(rows: &Rows<'_>, count: usize, of: impl Fn(usize, usize) -> [f64; 2]) -> Mat<f64> {
    let mut columns = Mat::zeros(2 * rows.len(), count);
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
fn by_pairs(blocks: usize, of: impl Fn(usize, usize) -> [[f64; 2]; 2]) -> Mat<f64> {
    let mut matrix = Mat::zeros(2 * blocks, 2 * blocks);
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
fn times(rows: &Rows<'_>, mut matrix: Mat<f64>, of: impl Fn(usize, usize) -> f64) -> Mat<f64> {
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

/// Length of a vector.
pub(crate) fn norm(vector: [f64; 3]) -> f64 {
    vector.iter().map(|value| value * value).sum::<f64>().sqrt()
}
