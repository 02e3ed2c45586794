//! The selected blocks as rows: residuals, and the sensitivity of the rows to the modelled errors. However long the
//! recording, at most [`BLOCKS_USED_MAX`] blocks are selected.
//!
//! Rows of the centre of pressure alternate x and y, block by block: identification, clean work, work in question.
//! Effects of the work phase only are therefore zero in all rows before [`Rows::work_from`].

use equipoise_core::body::{SEGMENTS, Segment};
use equipoise_core::effect::{self, Columns, Effect, Place, misaligned, misaligned_by_factor};

use crate::block::{Block, Phase};
use crate::constants::{BLOCKS_PER_POSE, BLOCKS_USED_MAX, ONSET_S, SAME_POSE_RAD};
use crate::session::Session;

/// The rows of a session.
#[derive(Debug, Clone)]
pub(crate) struct Rows<'a> {
    /// The session.
    pub(crate) session: &'a Session,
    /// One per row of a force channel, two rows of the centre of pressure.
    pub(crate) blocks: Vec<&'a Block>,
    /// The first block of the work in question.
    pub(crate) work_from: usize,
    /// Per block and segment: measurement error per rad of orientation error about each of the segment's axes.
    per_misalignment: Vec<[Columns; SEGMENTS]>,
    /// The same per rad of misalignment and rad of each component of the joint's rotation vector.
    per_soft_tissue: Vec<[[Columns; 3]; SEGMENTS]>,
}

impl<'a> Rows<'a> {
    /// Rows of the selected blocks of a session.
    pub(crate) fn of(session: &'a Session) -> Rows<'a> {
        Rows::from_blocks(session, selected(session))
    }

    /// Rows of some blocks, in the order of their phases.
    pub(crate) fn from_blocks(session: &'a Session, blocks: Vec<&'a Block>) -> Rows<'a> {
        let work_from = blocks.iter().position(|block| block.phase == Phase::Work).unwrap_or(blocks.len());
        let of_block = |block: &&Block| Segment::ALL.map(|segment| misaligned(segment, &block.observation));
        let per_misalignment = blocks.iter().map(of_block).collect();
        let per_soft_tissue = blocks.iter().map(|block| soft_tissue(block)).collect();
        Rows { session, blocks, work_from, per_misalignment, per_soft_tissue }
    }

    /// A subset of the blocks, in order.
    pub(crate) fn subset(&self, indices: &[usize]) -> Rows<'a> {
        Rows::from_blocks(self.session, indices.iter().map(|&i| self.blocks[i]).collect())
    }

    /// Number of blocks.
    pub(crate) fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Measured minus predicted centre of pressure of a block, m.
    pub(crate) fn cop_residual_m(&self, block: usize) -> [f64; 2] {
        let seen = &self.blocks[block].observation;
        [0, 1].map(|axis| seen.cop_measured_m[axis] - seen.cop_predicted_m[axis])
    }

    /// Measured minus predicted force of a block on one axis, N.
    pub(crate) fn force_residual_n(&self, block: usize, axis: usize) -> f64 {
        let seen = &self.blocks[block].observation;
        seen.force_measured_n[axis] - seen.force_predicted_n[axis]
    }

    /// The force channels that were measured, as axes.
    pub(crate) fn force_axes(&self) -> &'static [usize] {
        if self.session.has_shear { &[2, 0, 1] } else { &[2] }
    }

    /// Slope of the reaction: shift of the centre of pressure per height of the centre of mass.
    pub(crate) fn slope(&self, block: usize) -> [f64; 2] {
        if self.session.has_inertia { self.blocks[block].observation.slope } else { [0.0; 2] }
    }

    /// Contribution of the body's inertia to the centre of pressure, m; in a model without inertia, which predicts no
    /// slope, by the suit's acceleration.
    pub(crate) fn inertia_m(&self, block: usize) -> [f64; 2] {
        let seen = &self.blocks[block].observation;
        if !self.session.has_inertia {
            return effect::columns(Effect::Inertia, Place::Whole, 0.0, seen).cop_m[0];
        }
        let height_m = seen.com_m[2] - seen.floor_m;
        [0, 1].map(|axis| seen.turning_m[axis] - seen.slope[axis] * height_m)
    }

    /// Force of the body's inertia that the prediction lacks, N: all of it in a model without inertia.
    pub(crate) fn lacking_inertia_n(&self, block: usize) -> [f64; 3] {
        if self.session.has_inertia {
            return [0.0; 3];
        }
        effect::columns(Effect::Inertia, Place::Whole, 0.0, &self.blocks[block].observation).force_n[0]
    }

    /// Time of a block, s.
    pub(crate) fn time_s(&self, block: usize) -> f64 {
        self.blocks[block].observation.time_s
    }

    /// Error of the centre of pressure (m) and of the force (N) per rad of a segment's orientation error about one of
    /// its own axes.
    pub(crate) fn effect_of_misalignment(
        &self,
        block: usize,
        segment: usize,
        axis: usize,
    ) -> ([f64; 2], [f64; 3]) {
        let columns = &self.per_misalignment[block][segment];
        (columns.cop_m[axis], columns.force_n[axis])
    }

    /// The same for an orientation error given as a rotation vector in world axes, rad.
    pub(crate) fn effect_of_rotation(
        &self,
        block: usize,
        segment: usize,
        turn_rad: [f64; 3],
    ) -> ([f64; 2], [f64; 3]) {
        let rotation = &self.blocks[block].observation.rotation[segment];
        let own_rad = [0, 1, 2].map(|axis| (0..3).map(|k| rotation[k][axis] * turn_rad[k]).sum());
        let [x, y, z] = own_rad;
        self.per_misalignment[block][segment].times(&[x, y, z, 0.0])
    }

    /// The same for soft tissue: per rad about one of the segment's axes and rad of a component of its joint's rotation
    /// vector.
    pub(crate) fn effect_of_soft_tissue(
        &self,
        block: usize,
        segment: usize,
        [axis, joint]: [usize; 2],
    ) -> ([f64; 2], [f64; 3]) {
        let columns = &self.per_soft_tissue[block][segment][joint];
        (columns.cop_m[axis], columns.force_n[axis])
    }

    /// Contribution of a vector (m, or m per unit) added to the centre of mass to the centre of pressure.
    pub(crate) fn on_cop(&self, block: usize, vector: [f64; 3]) -> [f64; 2] {
        let slope = self.slope(block);
        [vector[0] - slope[0] * vector[2], vector[1] - slope[1] * vector[2]]
    }
}

fn soft_tissue(block: &Block) -> [[Columns; 3]; SEGMENTS] {
    Segment::ALL.map(|segment| {
        let index = segment.index();
        [0, 1, 2].map(|joint| {
            let bent =
                block.observation.rotation[index].map(|row| row.map(|e| block.joint_rad[index][joint] * e));
            let acceleration = &block.joint_weighted_rotation_acceleration[index][joint];
            misaligned_by_factor(segment, &bent, acceleration, &block.observation)
        })
    })
}

/// The selected blocks: identification, clean work, work in question, each by time.
fn selected(session: &Session) -> Vec<&Block> {
    let of =
        |phase: Phase| session.blocks.iter().filter(move |block| block.phase == phase).collect::<Vec<_>>();
    let [identify_max, reference_max, work_max] = BLOCKS_USED_MAX;
    let mut kept = evenly(few_per_pose(&of(Phase::Identify)), identify_max);
    kept.extend(evenly(of(Phase::Reference), reference_max));
    let [begin_s, _] = session.spans_s.work;
    let mut work = of(Phase::Work);
    work.retain(|block| block.observation.time_s > begin_s + ONSET_S);
    kept.extend(evenly(work, work_max));
    kept
}

/// At most `max` blocks, evenly spaced.
fn evenly(blocks: Vec<&Block>, max: usize) -> Vec<&Block> {
    if blocks.len() <= max {
        return blocks;
    }
    (0..max).map(|i| blocks[i * blocks.len() / max]).collect()
}

/// Keeps a few blocks of every run of static ones; moving blocks are all kept.
fn few_per_pose<'a>(blocks: &[&'a Block]) -> Vec<&'a Block> {
    let mut kept = Vec::new();
    for run in blocks.chunk_by(|a, b| a.still && b.still && a.stance == b.stance && same_pose(a, b)) {
        kept.extend(evenly(run.to_vec(), if run[0].still { BLOCKS_PER_POSE } else { run.len() }));
    }
    kept
}

/// Whether two blocks have the same pose: no joint rotated by more than a tremor would.
fn same_pose(a: &Block, b: &Block) -> bool {
    let turned =
        |(a, b): (&[f64; 3], &[f64; 3])| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let squared: f64 = a.joint_rad.iter().zip(&b.joint_rad).map(turned).sum();
    squared < SAME_POSE_RAD * SAME_POSE_RAD
}
