//! The blocks that are worked on, as rows: residuals, and how the errors that are modelled act on them.
//!
//! Rows of the centre of pressure alternate x and y, block by block: identification, clean work, work in question. What
//! acts in the work only is then zero in all rows before [`Rows::work_from`].

use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::effect::Observation;

use crate::block::{Block, Phase};
use crate::session::Session;
use crate::thin::thin;

/// The rows of a session.
#[derive(Debug, Clone)]
pub(crate) struct Rows<'a> {
    /// Where they come from.
    pub(crate) session: &'a Session,
    /// One per row of a force channel, two rows of the centre of pressure.
    pub(crate) blocks: Vec<&'a Block>,
    /// The first block of the work in question.
    pub(crate) work_from: usize,
    /// Per block, how a small turn of each segment moves its share of the centre of mass.
    pub(crate) lever_m: Vec<[[f64; 3]; SEGMENTS]>,
}

impl<'a> Rows<'a> {
    /// Of a whole session, thinned.
    pub(crate) fn of(session: &'a Session) -> Rows<'a> {
        Rows::from_blocks(session, thin(session))
    }

    /// Of some blocks, in the order of their phases.
    pub(crate) fn from_blocks(session: &'a Session, blocks: Vec<&'a Block>) -> Rows<'a> {
        let work_from = blocks.iter().position(|block| block.phase == Phase::Work).unwrap_or(blocks.len());
        let lever_m = blocks.iter().map(|block| levers_m(&block.observation)).collect();
        Rows { session, blocks, work_from, lever_m }
    }

    /// Only some of them, in order.
    pub(crate) fn subset(&self, indices: &[usize]) -> Rows<'a> {
        Rows::from_blocks(self.session, indices.iter().map(|&i| self.blocks[i]).collect())
    }

    /// Number of blocks.
    pub(crate) fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Measured less predicted centre of pressure of a block, m.
    pub(crate) fn cop_residual_m(&self, block: usize) -> [f64; 2] {
        let seen = &self.blocks[block].observation;
        [0, 1].map(|axis| seen.cop_measured_m[axis] - seen.cop_predicted_m[axis])
    }

    /// Measured less predicted force of a block on one axis, N.
    pub(crate) fn force_residual_n(&self, block: usize, axis: usize) -> f64 {
        let seen = &self.blocks[block].observation;
        seen.force_measured_n[axis] - seen.force_predicted_n[axis]
    }

    /// The force channels that were measured, as axes.
    pub(crate) fn force_axes(&self) -> &'static [usize] {
        if self.session.has_shear { &[2, 0, 1] } else { &[2] }
    }

    /// How high forces act: by how much the centre of pressure moves per height of the centre of mass.
    pub(crate) fn slope(&self, block: usize) -> [f64; 2] {
        if self.session.has_inertia { self.blocks[block].observation.slope } else { [0.0; 2] }
    }

    /// What the inertia of the body adds to the centre of pressure, m.
    pub(crate) fn inertia_m(&self, block: usize) -> [f64; 2] {
        let seen = &self.blocks[block].observation;
        let height_m = seen.com_m[2] - seen.floor_m;
        [0, 1].map(|axis| seen.turning_m[axis] - seen.slope[axis] * height_m)
    }

    /// Time of a block, s.
    pub(crate) fn time_s(&self, block: usize) -> f64 {
        self.blocks[block].observation.time_s
    }

    /// What a vector (m, or m per unit) added to the centre of mass adds to the centre of pressure.
    pub(crate) fn on_cop(&self, block: usize, vector: [f64; 3]) -> [f64; 2] {
        let slope = self.slope(block);
        [vector[0] - slope[0] * vector[2], vector[1] - slope[1] * vector[2]]
    }
}

/// What turns with each segment of the centre of mass, world axes, m: its share φ, and of pelvis and legs also the half of
/// what it puts between the feet and the pelvis, since the suit hangs the body on its feet.
pub(crate) fn levers_m(seen: &Observation) -> [[f64; 3]; SEGMENTS] {
    let mut lever_m: [[f64; 3]; SEGMENTS] = std::array::from_fn(|segment| {
        let rotation = seen.rotation[segment];
        std::array::from_fn(|axis| (0..3).map(|k| rotation[axis][k] * seen.phi_m[segment][k]).sum())
    });
    for side in Side::BOTH.into_iter().filter(|_| seen.feet_hold) {
        let foot = side.foot();
        let Some(lower) = foot.parent() else { continue };
        let Some(upper) = lower.parent() else { continue };
        for (segment, end) in [(Segment::Pelvis, upper), (upper, lower), (lower, foot)] {
            let (from, to) = (seen.origin_m[segment.index()], seen.origin_m[end.index()]);
            for axis in 0..3 {
                lever_m[segment.index()][axis] -= 0.5 * (to[axis] - from[axis]);
            }
        }
    }
    lever_m
}

/// `turn × vector`.
pub(crate) fn cross(turn: [f64; 3], vector: [f64; 3]) -> [f64; 3] {
    [
        turn[1] * vector[2] - turn[2] * vector[1],
        turn[2] * vector[0] - turn[0] * vector[2],
        turn[0] * vector[1] - turn[1] * vector[0],
    ]
}
