//! Experiments that can be requested of a standing subject, as the model would observe them.

use equipoise_config::model_file::Ask;
use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::cycle::POSE_REQUESTS_MAX;
use equipoise_core::effect::Observation;
use equipoise_core::pose_suggestion::library::LIBRARY;
use nalgebra::{UnitQuaternion, Vector3};

use crate::block::{Block, CUTOFFS_HZ, Change, LAGS_S, Phase, joint_rad};
use crate::constants::{STANDING_S, STEP_M, TURNS_DEG, UNTIL_EXPERIMENT_S};
use crate::linear::norm;
use crate::rows::Rows;

/// A request and its measurements.
#[derive(Debug, Clone)]
pub(super) struct Experiment {
    /// The request; evidence and names are filled in later.
    pub(super) ask: Ask,
    /// Its measurements, as indices into [`Choice::blocks`].
    pub(super) measurements: Vec<usize>,
}

/// The experiments that can be requested.
#[derive(Debug)]
pub(super) struct Choice {
    /// Every measurement, as a block that follows the recording. Its measured values are not used.
    pub(super) blocks: Vec<Block>,
    /// Every experiment with at most one pose.
    pub(super) single: Vec<Experiment>,
}

/// An empty request, to be filled in.
pub(super) fn empty() -> Ask {
    Ask {
        between: Default::default(),
        poses: Vec::new(),
        turn_deg: 0.0,
        step_m: [0.0; 2],
        still_s: 0.0,
        fast: false,
        separation_sigma: 0.0,
        information_nats: 0.0,
        decides: 0.0,
    }
}

impl Choice {
    /// After a recording with work; none if it is empty.
    pub(super) fn after(rows: &Rows<'_>) -> Option<Choice> {
        let last = *rows.blocks.last()?;
        let mut choice = Choice { blocks: Vec::new(), single: Vec::new() };
        let offset_m = offset_m(rows, rows.len() - 1);
        let stand = |rotation: &_, turn_deg, step_m| standing(last, offset_m, rotation, turn_deg, step_m);
        let straight = LIBRARY[0].world_from_segment();
        let step_m = [STEP_M, STEP_M];
        choice.add(Ask { step_m, ..empty() }, vec![stand(&straight, 0.0, step_m)]);
        let mut later = stand(&straight, 0.0, [0.0; 2]);
        later.observation.time_s += STANDING_S;
        choice.add(Ask { still_s: STANDING_S, ..empty() }, vec![later]);
        choice.add(Ask { fast: true, ..empty() }, fastest(rows));
        for posture in LIBRARY {
            for turn_deg in TURNS_DEG {
                let poses = vec![posture.name.to_owned()];
                let block = stand(&posture.world_from_segment(), turn_deg, [0.0; 2]);
                choice.add(Ask { poses, turn_deg, ..empty() }, vec![block]);
            }
        }
        Some(choice)
    }

    fn add(&mut self, ask: Ask, blocks: Vec<Block>) {
        let measurements = (self.blocks.len()..).take(blocks.len()).collect();
        self.blocks.extend(blocks);
        self.single.push(Experiment { ask, measurements });
    }

    /// An experiment with each further pose of the library in addition; none if it is not one of poses, or complete.
    pub(super) fn with_another_pose(&self, experiment: &Experiment) -> Vec<Experiment> {
        let ask = &experiment.ask;
        if ask.poses.is_empty() || ask.poses.len() >= POSE_REQUESTS_MAX {
            return Vec::new();
        }
        let is_further = |other: &&Experiment| {
            let is_held = other.ask.poses.iter().any(|pose| ask.poses.contains(pose));
            !other.ask.poses.is_empty() && !is_held && other.ask.turn_deg == ask.turn_deg
        };
        let extended = |other: &Experiment| {
            let mut longer = experiment.clone();
            longer.ask.poses.extend(other.ask.poses.iter().cloned());
            longer.measurements.extend(&other.measurements);
            longer
        };
        self.single.iter().filter(is_further).map(extended).collect()
    }
}

/// The blocks of the work with the largest accelerations, repeated.
fn fastest(rows: &Rows<'_>) -> Vec<Block> {
    let acceleration = |&block: &usize| norm(rows.blocks[block].observation.com_acceleration_m_per_s2);
    let mut blocks: Vec<usize> = (rows.work_from..rows.len()).collect();
    blocks.sort_by(|a, b| acceleration(b).total_cmp(&acceleration(a)));
    blocks.truncate(POSE_REQUESTS_MAX);
    let first_s = blocks.iter().map(|&block| rows.time_s(block)).fold(f64::INFINITY, f64::min);
    let repeated = |block: usize| {
        let mut repeated = rows.blocks[block].clone();
        repeated.observation.time_s += rows.time_s(rows.len() - 1) + UNTIL_EXPERIMENT_S - first_s;
        repeated.stance = rows.blocks[rows.len() - 1].stance;
        repeated
    };
    blocks.into_iter().map(repeated).collect()
}

/// Part of the predicted centre of pressure that is not the body's: the identified offset between suit and plate, m.
fn offset_m(rows: &Rows<'_>, block: usize) -> [f64; 2] {
    let seen = &rows.blocks[block].observation;
    let inertia_m = if rows.session.has_inertia { rows.inertia_m(block) } else { [0.0; 2] };
    [0, 1].map(|axis| seen.cop_predicted_m[axis] - seen.com_m[axis] - inertia_m[axis])
}

/// A static subject of this skeleton in a pose, turned by an angle from the present heading about the feet, and displaced
/// forward and to the left from the present position.
fn standing(
    last: &Block,
    offset_m: [f64; 2],
    rotation: &[UnitQuaternion<f64>; SEGMENTS],
    turn_deg: f64,
    step_m: [f64; 2],
) -> Block {
    let like = &last.observation;
    let heading_rad = last.heading_rad + turn_deg.to_radians();
    // A turn or a step moves each foot at least once.
    let moves = if turn_deg != 0.0 || step_m != [0.0; 2] { Side::BOTH.len() as u64 } else { 0 };
    let about_vertical = |angle_rad: f64| UnitQuaternion::from_scaled_axis(Vector3::z() * angle_rad);
    let turn = about_vertical(heading_rad);
    let step_m = about_vertical(last.heading_rad) * Vector3::new(step_m[0], step_m[1], 0.0);
    let rotation = rotation.map(|own| turn * own);
    let origin = origins_in_pose(like, &rotation, step_m);
    let ankles_before_m = between_ankles_m(&|segment| Vector3::from(like.origin_m[segment.index()]));
    let from_ankles_m = Vector3::new(like.feet_m[0], like.feet_m[1], ankles_before_m.z) - ankles_before_m;
    let feet_m = between_ankles_m(&|segment| origin[segment.index()])
        + about_vertical(turn_deg.to_radians()) * from_ankles_m;
    let com = Segment::ALL
        .iter()
        .map(|segment| rotation[segment.index()] * Vector3::from(like.phi_m[segment.index()]))
        .fold(origin[0], |sum, part| sum + part);
    let cop_m = [com.x + offset_m[0], com.y + offset_m[1]];
    let force_n = [0.0, 0.0, like.mass_kg * 9.81];
    let observation = Observation {
        time_s: like.time_s + UNTIL_EXPERIMENT_S,
        feet_m: [feet_m.x, feet_m.y],
        origin_m: origin.map(Into::into),
        origin_acceleration_m_per_s2: [[0.0; 3]; SEGMENTS],
        rotation: rotation.map(|own| {
            let matrix = own.to_rotation_matrix();
            [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
        }),
        rotation_acceleration_per_s2: [[[0.0; 3]; 3]; SEGMENTS],
        com_m: com.into(),
        com_acceleration_m_per_s2: [0.0; 3],
        turning_m: [0.0; 2],
        slope: [0.0; 2],
        cop_predicted_m: cop_m,
        force_predicted_n: force_n,
        cop_measured_m: cop_m,
        force_measured_n: force_n,
        ..*like
    };
    Block {
        phase: Phase::Work,
        stance: last.stance + moves,
        still: true,
        observation,
        com_velocity_m_per_s: [0.0; 3],
        turning_by_group_m: [[0.0; 2]; 4],
        joint_rad: joint_rad(&rotation, heading_rad),
        joint_weighted_rotation_acceleration: [[[[0.0; 3]; 3]; 3]; SEGMENTS],
        heading_rad,
        by_lag: [Change::NONE; LAGS_S.len()],
        by_cutoff: [Change::NONE; CUTOFFS_HZ.len()],
    }
}

/// Midpoint between the ankles, in the frame of `origin`, m.
fn between_ankles_m(origin: &dyn Fn(Segment) -> Vector3<f64>) -> Vector3<f64> {
    Side::BOTH.iter().map(|side| origin(side.foot())).sum::<Vector3<f64>>() * 0.5
}

/// Segment origins in a pose, with the middle between the feet in its place, plus a step.
fn origins_in_pose(
    like: &Observation,
    rotation: &[UnitQuaternion<f64>; SEGMENTS],
    step_m: Vector3<f64>,
) -> [Vector3<f64>; SEGMENTS] {
    let seen = |segment: Segment| Vector3::from(like.origin_m[segment.index()]);
    let mut origin = [Vector3::zeros(); SEGMENTS];
    for segment in Segment::ALL {
        let Some(parent) = segment.parent() else { continue };
        let rows = like.rotation[parent.index()];
        let along = seen(segment) - seen(parent);
        let own = Vector3::from_fn(|k, _| (0..3).map(|axis| rows[axis][k] * along[axis]).sum::<f64>());
        origin[segment.index()] = origin[parent.index()] + rotation[parent.index()] * own;
    }
    let shift = between_ankles_m(&seen) - between_ankles_m(&|segment| origin[segment.index()]) + step_m;
    origin.map(|origin| origin + shift)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::clean;

    #[test]
    fn a_pose_is_predicted_with_the_offset_between_suit_and_plate() {
        let session = clean(5);
        let mut shifted = session.clone();
        let offset_m = [0.03, -0.02];
        for block in &mut shifted.blocks {
            let seen = &mut block.observation;
            seen.cop_predicted_m = [0, 1].map(|axis| seen.cop_predicted_m[axis] + offset_m[axis]);
            seen.cop_measured_m = [0, 1].map(|axis| seen.cop_measured_m[axis] + offset_m[axis]);
        }
        let choices = [&session, &shifted].map(|session| Choice::after(&Rows::of(session)).unwrap());
        assert_eq!(choices[0].blocks.len(), choices[1].blocks.len());
        for (block, with_offset) in choices[0].blocks.iter().zip(&choices[1].blocks) {
            let seen = [block, with_offset].map(|block| block.observation.cop_predicted_m);
            let off_m = |axis: usize| seen[1][axis] - seen[0][axis] - offset_m[axis];
            assert!((0..2).all(|axis| off_m(axis).abs() < 1e-12), "{seen:?}");
        }
    }
}
