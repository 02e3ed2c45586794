//! Errors of the centre of mass's position: joints that glide, sensors that slip. Such a shift also accelerates, which
//! acts on the plate.

use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::effect::{Columns, Effect, Place, arm_m};

use super::library::{Entry, display_name};
use crate::block::Block;
use crate::constants::{JOINT_GLIDE_M, SLIP};
use crate::linear::norm;
use crate::rows::Rows;

/// A block, and the contribution of its segments to the centre of mass.
#[derive(Debug, Clone)]
pub(super) struct Posture<'a> {
    pub(super) block: &'a Block,
    lever_m: [[f64; 3]; SEGMENTS],
}

impl<'a> Posture<'a> {
    fn of(block: &'a Block) -> Posture<'a> {
        Posture { block, lever_m: Segment::ALL.map(|segment| arm_m(segment, &block.observation)) }
    }

    /// True centre of mass if the suit measures a segment rotated by this, rad, world axes.
    pub(super) fn rotated_back(&self, segment: Segment, turn: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.lever_m[segment.index()];
        let [u, v, w] = turn;
        [w * y - v * z, u * z - w * x, v * x - u * y]
    }

    fn rotation(&self, segment: Segment) -> &[[f64; 3]; 3] {
        &self.block.observation.rotation[segment.index()]
    }

    /// One axis of a segment, in the world.
    fn axis(&self, segment: Segment, axis: usize) -> [f64; 3] {
        self.rotation(segment).map(|row| row[axis])
    }
}

/// Every block of the work with its predecessor and successor.
#[derive(Debug, Clone)]
pub(super) struct Neighbours<'a> {
    pub(super) rows: &'a Rows<'a>,
    blocks: Vec<(Posture<'a>, Option<[Posture<'a>; 2]>)>,
}

impl<'a> Neighbours<'a> {
    pub(super) fn of(rows: &'a Rows<'a>) -> Neighbours<'a> {
        let all = &rows.session.blocks;
        let follows = |a: &Block, b: &Block| {
            let apart_s = b.observation.time_s - a.observation.time_s;
            (0.0..1.5 * rows.session.block_s).contains(&apart_s)
        };
        let mut index = 0;
        let blocks = rows.blocks[rows.work_from..]
            .iter()
            .map(|&block| {
                while index < all.len() && !std::ptr::eq(&all[index], block) {
                    index += 1;
                }
                let (before, after) = (all.get(index.wrapping_sub(1)), all.get(index + 1));
                let both = before
                    .zip(after)
                    .filter(|(before, after)| follows(before, block) && follows(block, after));
                (Posture::of(block), both.map(|(before, after)| [Posture::of(before), Posture::of(after)]))
            })
            .collect();
        Neighbours { rows, blocks }
    }

    /// The blocks of the work.
    pub(super) fn work(&self) -> impl Iterator<Item = &Posture<'a>> {
        self.blocks.iter().map(|(posture, _)| posture)
    }

    /// A term that shifts the centre of mass by vectors in the world's axes, m per unit, because of an error of some
    /// segment.
    pub(super) fn entry<const N: usize>(
        &self,
        of: Segment,
        what: String,
        sigma: [f64; N],
        shift_m: impl Fn(&Posture<'_>) -> [[f64; 3]; N],
    ) -> Entry {
        let step2_s2 = self.rows.session.block_s.powi(2);
        Entry::of(self.rows, what, &sigma, |block| {
            let (posture, both) = &self.blocks[block - self.rows.work_from];
            let here = shift_m(posture);
            let both_shifts = both
                .as_ref()
                .filter(|_| of.is_distal_to(Segment::T8))
                .map(|both| both.each_ref().map(&shift_m));
            let mut columns = Columns::zero(N);
            for k in 0..N {
                let acceleration = both_shifts.map_or([0.0; 3], |[before, after]| {
                    [0, 1, 2].map(|axis| (before[k][axis] - 2.0 * here[k][axis] + after[k][axis]) / step2_s2)
                });
                (columns.cop_m[k], columns.force_n[k]) = of_shift(self.rows, block, here[k], acceleration);
            }
            columns
        })
    }
}

/// Contribution of a shift of the centre of mass (m) that accelerates (m/s²) to centre of pressure and force, as in the
/// catalogue's effects.
fn of_shift(rows: &Rows<'_>, block: usize, at: [f64; 3], acceleration: [f64; 3]) -> ([f64; 2], [f64; 3]) {
    let observation = &rows.blocks[block].observation;
    let leant = rows.on_cop(block, at);
    if !rows.session.has_inertia {
        return (leant, acceleration.map(|part| observation.mass_kg * part));
    }
    let (height_m, specific) =
        (observation.com_m[2] - observation.floor_m, observation.force_predicted_n[2] / observation.mass_kg);
    let cop_m = [0, 1].map(|axis| {
        let lightened =
            (observation.slope[axis] * height_m - observation.turning_m[axis]) * acceleration[2] / specific;
        // Measured shear already contains it.
        let pushed =
            if observation.slope_is_measured { 0.0 } else { height_m * acceleration[axis] / specific };
        leant[axis] + lightened - pushed
    });
    (cop_m, acceleration.map(|part| observation.mass_kg * part))
}

/// Joints that translate as they bend: the suit's model has fixed joint centres, a body's joints glide.
pub(super) fn joints(neighbours: &Neighbours<'_>) -> Vec<Entry> {
    let [shoulder_m, spine_m] = JOINT_GLIDE_M;
    let mut list = Vec::new();
    for side in Side::BOTH {
        let what = format!(
            "a translation of the {} in its joint with the elevation of the arm",
            display_name(upper_arm(side))
        );
        list.push(neighbours.entry(Segment::T8, what, [shoulder_m; 3], |posture| {
            along_trunk(posture, raised(posture, side))
        }));
    }
    let what = "a translation of both arms in their joints with their elevation".to_owned();
    list.push(neighbours.entry(Segment::T8, what, [shoulder_m; 3], |posture| {
        let [left, right] = Side::BOTH.map(|side| raised(posture, side));
        let apart = if Side::BOTH[0] == Side::Left { left - right } else { right - left };
        let mut all = along_trunk(posture, left + right);
        all[1] = along_trunk(posture, apart)[1];
        all
    }));
    for (axis, how) in ["to the side", "forward", "about the vertical"].into_iter().enumerate() {
        let what = format!("a bend of the spine at another place than in the suit's model: {how}");
        list.push(neighbours.entry(Segment::T8, what, [spine_m; 3], |posture| {
            let trunk = [Segment::L5, Segment::L3, Segment::T12, Segment::T8];
            let bend: f64 = trunk.iter().map(|part| posture.block.joint_rad[part.index()][axis]).sum();
            [0, 1, 2].map(|along| posture.axis(Segment::Pelvis, along).map(|part| bend * part))
        }));
    }
    list
}

fn upper_arm(side: Side) -> Segment {
    if side == Side::Left { Segment::LeftUpperArm } else { Segment::RightUpperArm }
}

/// Elevation of an arm: 0 hanging down the trunk, 1 at a right angle, 2 upwards.
fn raised(posture: &Posture<'_>, side: Side) -> f64 {
    // In the T-pose an arm points along the Y axis of its segment, to the left or to the right.
    let outwards = if side == Side::Left { 1.0 } else { -1.0 };
    let (arm, trunk) = (posture.axis(upper_arm(side), 1), posture.axis(Segment::T8, 2));
    1.0 + outwards * (0..3).map(|k| arm[k] * trunk[k]).sum::<f64>()
}

/// Vectors of this length along each axis of the trunk.
fn along_trunk(posture: &Posture<'_>, size: f64) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|along| posture.axis(Segment::T8, along).map(|part| size * part))
}

/// Sensors that slip on a segment.
pub(super) fn slips(neighbours: &Neighbours<'_>) -> Vec<Entry> {
    let segments = Effect::SegmentHeading.places().iter();
    segments
        .filter_map(|place| if let Place::Segment(segment) = *place { Some(segment) } else { None })
        .flat_map(|segment| slips_of(neighbours, segment))
        .collect()
}

fn slips_of(neighbours: &Neighbours<'_>, segment: Segment) -> Vec<Entry> {
    let rows = neighbours.rows;
    let name = display_name(segment);
    let bent = move |posture: &Posture<'_>| posture.block.joint_rad[segment.index()];
    let aside = move |posture: &Posture<'_>, size: f64| {
        [0, 1, 2]
            .map(|along| posture.rotated_back(segment, posture.axis(segment, along).map(|part| size * part)))
    };
    let [per_joint, following, per_minute] = SLIP;
    let mut list = Vec::new();
    for (joint, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let what = format!("a slip of the sensor on the {name} with the joint's rotation about {axis}");
        list.push(
            neighbours.entry(segment, what, [per_joint; 3], |posture| aside(posture, bent(posture)[joint])),
        );
    }
    let what = format!("a slip of the sensor on the {name} with the joint's angle");
    list.push(neighbours.entry(segment, what, [per_joint; 3], |posture| aside(posture, norm(bent(posture)))));
    let what = format!("a sensor on the {name} that follows its joint only in part");
    list.push(neighbours.entry(segment, what, [following], |posture| {
        let rotation = posture.rotation(segment);
        let turn = rotation.map(|row| (0..3).map(|k| row[k] * bent(posture)[k]).sum());
        [posture.rotated_back(segment, turn)]
    }));
    let what = format!("a heading error of the {name} that grows with time");
    list.push(neighbours.entry(segment, what, [per_minute], |posture| {
        let minutes = (posture.block.observation.time_s - rows.session.spans_s.work[0]) / 60.0;
        [posture.rotated_back(segment, [0.0, 0.0, minutes])]
    }));
    list
}
