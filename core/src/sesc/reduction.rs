//! Reduces the number of parameters: `Φ = T θ + Φ_fixed`.
//!
//! The suit interpolates the spine, and hands and toes hardly move separately from forearms and feet, so many of the 69
//! raw parameters are indistinguishable. A group of segments shares one vector, split in the proportions of the
//! anthropometric table; the components that are not free are fixed at the table's values.

use bytemuck::{Pod, Zeroable};

use super::Phi;
use crate::body::{SEGMENTS, Segment};
use crate::frame::{Pose, StationWorld};
use crate::math;

/// Raw parameters: three per segment.
pub const PARAMETERS: usize = 3 * SEGMENTS;

/// Number and choice of the parameters to identify.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReductionKind {
    /// All 69.
    Full,
    /// 42: segments that move together share a vector.
    Merged,
    /// 16: merged, left mirrors right, limbs along their long axes (González et al., 2013).
    Symmetric,
}

/// Segments that share one vector; its free axes; whether the other side mirrors it.
struct Group {
    segments: &'static [Segment],
    axes: &'static [usize],
    mirrored: bool,
}

const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;

const fn group(segments: &'static [Segment], axes: &'static [usize], mirrored: bool) -> Group {
    Group { segments, axes, mirrored }
}

const THORAX: &[Segment] = &[Segment::T12, Segment::T8, Segment::RightShoulder, Segment::LeftShoulder];

const MERGED: [Group; 14] = [
    group(&[Segment::Pelvis], &[X, Y, Z], false),
    group(&[Segment::L5, Segment::L3], &[X, Y, Z], false),
    group(THORAX, &[X, Y, Z], false),
    group(&[Segment::Neck, Segment::Head], &[X, Y, Z], false),
    group(&[Segment::RightUpperArm], &[X, Y, Z], false),
    group(&[Segment::RightForearm, Segment::RightHand], &[X, Y, Z], false),
    group(&[Segment::LeftUpperArm], &[X, Y, Z], false),
    group(&[Segment::LeftForearm, Segment::LeftHand], &[X, Y, Z], false),
    group(&[Segment::RightUpperLeg], &[X, Y, Z], false),
    group(&[Segment::RightLowerLeg], &[X, Y, Z], false),
    group(&[Segment::RightFoot, Segment::RightToe], &[X, Y, Z], false),
    group(&[Segment::LeftUpperLeg], &[X, Y, Z], false),
    group(&[Segment::LeftLowerLeg], &[X, Y, Z], false),
    group(&[Segment::LeftFoot, Segment::LeftToe], &[X, Y, Z], false),
];

// The pelvis keeps its sideways parameter, which absorbs an offset of the plate or a longer leg instead of the limbs.
const SYMMETRIC: [Group; 9] = [
    group(&[Segment::Pelvis], &[X, Y, Z], false),
    group(&[Segment::L5, Segment::L3], &[X, Z], false),
    group(THORAX, &[X, Z], false),
    group(&[Segment::Neck, Segment::Head], &[X, Z], false),
    group(&[Segment::LeftUpperArm], &[Y], true),
    group(&[Segment::LeftForearm, Segment::LeftHand], &[Y], true),
    group(&[Segment::LeftUpperLeg], &[X, Z], true),
    group(&[Segment::LeftLowerLeg], &[X, Z], true),
    group(&[Segment::LeftFoot, Segment::LeftToe], &[X], true),
];

/// No parameter: the raw one is fixed.
const FIXED: u64 = u64::MAX;

/// The matrix T, which has at most one entry per row, and Φ_fixed.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Reduction {
    /// Number of parameters of θ, in [0, 69]; 0 before a body is available.
    pub count: u64,
    /// Index of the θ on which each raw parameter depends, in [0, count) or `FIXED`.
    parameter: [u64; PARAMETERS],
    /// Its factor.
    weight: [f64; PARAMETERS],
    /// The fixed part, m.
    fixed_m: [f64; PARAMETERS],
}

/// Two rows of the measurement: `CoP_axis = offset_m + h · θ`.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    /// The rows of B_red, x and y.
    pub h: [[f64; PARAMETERS]; 2],
    /// The constant part: pelvis and fixed parameters, m.
    pub offset_m: [f64; 2],
}

impl Reduction {
    /// The reduction of a kind, based on a table's Φ.
    pub fn new(kind: ReductionKind, table: &Phi) -> Reduction {
        let mut reduction: Reduction = Zeroable::zeroed();
        reduction.parameter = [FIXED; PARAMETERS];
        match kind {
            ReductionKind::Full => {
                reduction.count = PARAMETERS as u64;
                reduction.parameter = core::array::from_fn(|raw| raw as u64);
                reduction.weight = [1.0; PARAMETERS];
            }
            ReductionKind::Merged => reduction.add_groups(&MERGED, table),
            ReductionKind::Symmetric => reduction.add_groups(&SYMMETRIC, table),
        }
        let theta = reduction.closest_theta(table);
        for raw in 0..PARAMETERS {
            reduction.fixed_m[raw] = table.0[raw / 3][raw % 3] - reduction.free_part(raw, &theta);
        }
        reduction
    }

    fn add_groups(&mut self, groups: &[Group], table: &Phi) {
        for group in groups {
            let size = |segment: &Segment| {
                let [x, y, z] = table.0[segment.index()];
                math::sqrt(x * x + y * y + z * z)
            };
            let sum: f64 = group.segments.iter().map(size).sum();
            for &axis in group.axes {
                for segment in group.segments {
                    let even = 1.0 / group.segments.len() as f64;
                    let fraction = if sum > 0.0 { size(segment) / sum } else { even };
                    self.tie(3 * segment.index() + axis, fraction);
                    if group.mirrored {
                        let sign = if axis == Y { -1.0 } else { 1.0 };
                        self.tie(3 * segment.mirrored().index() + axis, sign * fraction);
                    }
                }
                self.count += 1;
            }
        }
    }

    fn tie(&mut self, raw: usize, weight: f64) {
        self.parameter[raw] = self.count;
        self.weight[raw] = weight;
    }

    fn free_part(&self, raw: usize, theta: &[f64]) -> f64 {
        match self.parameter[raw] {
            FIXED => 0.0,
            parameter => self.weight[raw] * theta[parameter as usize],
        }
    }

    /// Number of parameters of θ.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// Whether indices and numbers are in range; a stored reduction is checked before it is used.
    pub fn is_sound(&self) -> bool {
        self.count() <= PARAMETERS
            && self.parameter.iter().all(|&parameter| parameter == FIXED || parameter < self.count)
            && self.weight.iter().chain(&self.fixed_m).all(|value| value.is_finite())
    }

    /// `T⁺ v`: the least-squares θ of a raw vector.
    pub fn pseudo_inverse(&self, raw_vector: &[f64; PARAMETERS]) -> [f64; PARAMETERS] {
        let (mut dot, mut square) = ([0.0; PARAMETERS], [0.0; PARAMETERS]);
        for (raw, value) in raw_vector.iter().enumerate() {
            if self.parameter[raw] != FIXED {
                let parameter = self.parameter[raw] as usize;
                dot[parameter] += self.weight[raw] * value;
                square[parameter] += self.weight[raw] * self.weight[raw];
            }
        }
        core::array::from_fn(|index| if square[index] > 0.0 { dot[index] / square[index] } else { 0.0 })
    }

    /// Likewise for magnitudes, such as standard deviations: every weight counts as positive.
    pub fn pseudo_inverse_of_sizes(&self, raw_sizes: &[f64; PARAMETERS]) -> [f64; PARAMETERS] {
        let signed =
            core::array::from_fn(|raw| raw_sizes[raw] * if self.weight[raw] < 0.0 { -1.0 } else { 1.0 });
        self.pseudo_inverse(&signed)
    }

    /// One raw parameter as `h θ + constant`: its row of T, and its part of Φ_fixed, m.
    pub fn raw_row(&self, segment: Segment, axis: usize) -> ([f64; PARAMETERS], f64) {
        let (raw, mut row) = (3 * segment.index() + axis, [0.0; PARAMETERS]);
        if self.parameter[raw] != FIXED {
            row[self.parameter[raw] as usize] = self.weight[raw];
        }
        (row, self.fixed_m[raw])
    }

    /// The θ closest to Φ.
    pub fn closest_theta(&self, phi: &Phi) -> [f64; PARAMETERS] {
        self.pseudo_inverse(&core::array::from_fn(|raw| phi.0[raw / 3][raw % 3]))
    }

    /// `Φ = T θ + Φ_fixed`; `theta` must have at least the first `count` entries.
    pub fn phi(&self, theta: &[f64]) -> Phi {
        Phi(core::array::from_fn(|segment| {
            core::array::from_fn(|axis| {
                let raw = 3 * segment + axis;
                self.fixed_m[raw] + self.free_part(raw, theta)
            })
        }))
    }

    /// Variance of each raw parameter from the variances of θ.
    pub fn raw_variance(&self, theta_variance: impl Fn(usize) -> f64) -> [f64; PARAMETERS] {
        core::array::from_fn(|raw| match self.parameter[raw] {
            FIXED => 0.0,
            parameter => self.weight[raw] * self.weight[raw] * theta_variance(parameter as usize),
        })
    }

    /// The rows `B_xy − slope ⊗ B_z` of `C_M = x0 + B(Tθ + Φ_fixed)` for a pose, without forming B (Eq. 3, 6).
    ///
    /// `slope` is the horizontal over the vertical specific force: the line of the ground reaction through the CoM
    /// meets the floor at `C_xy − slope C_z` if the angular momentum is constant. `[0, 0]` for a static body.
    pub fn rows(&self, pose: &Pose<StationWorld>, slope: [f64; 2]) -> Rows {
        let mut rows = self.rows_over(pose, slope, |_| true);
        let pelvis = pose.origin_of(Segment::Pelvis);
        rows.offset_m[0] += pelvis.x - slope[0] * pelvis.z;
        rows.offset_m[1] += pelvis.y - slope[1] * pelvis.z;
        rows
    }

    /// The same rows of `Σ_i R_i φ_i` over some of the segments, without the pelvis' position.
    pub fn rows_over(
        &self,
        pose: &Pose<StationWorld>,
        slope: [f64; 2],
        wanted: impl Fn(Segment) -> bool,
    ) -> Rows {
        let mut rows = Rows { h: [[0.0; PARAMETERS]; 2], offset_m: [0.0; 2] };
        for segment in Segment::ALL.into_iter().filter(|segment| wanted(*segment)) {
            let segment = segment.index();
            let world_from_segment = pose.world_from_segment[segment].to_rotation_matrix();
            for axis in 0..3 {
                let raw = 3 * segment + axis;
                for row in 0..2 {
                    let entry = world_from_segment[(row, axis)] - slope[row] * world_from_segment[(2, axis)];
                    rows.offset_m[row] += entry * self.fixed_m[raw];
                    if self.parameter[raw] != FIXED {
                        rows.h[row][self.parameter[raw] as usize] += entry * self.weight[raw];
                    }
                }
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Anthropometry, Sex, Skeleton};
    use crate::pose_suggestion::{Posture, posture};
    use crate::sesc::centre_of_mass;

    const KINDS: [(ReductionKind, usize); 3] =
        [(ReductionKind::Full, 69), (ReductionKind::Merged, 42), (ReductionKind::Symmetric, 16)];

    fn table() -> Phi {
        let skeleton = Skeleton::nominal(1.77);
        Phi::of(&skeleton, &Anthropometry::de_leva(&skeleton, 1.77, Sex::Male))
    }

    #[test]
    fn every_reduction_holds_the_table_itself() {
        for (kind, count) in KINDS {
            let reduction = Reduction::new(kind, &table());
            assert_eq!(reduction.count(), count);
            assert!(reduction.is_sound());
            let back = reduction.phi(&reduction.closest_theta(&table()));
            for (a, b) in back.0.iter().flatten().zip(table().0.iter().flatten()) {
                assert!((a - b).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn the_rows_are_where_the_push_through_the_centre_of_mass_meets_the_floor() {
        let skeleton = Skeleton::nominal(1.77);
        let mut rotation_deg = [[0; 3]; SEGMENTS];
        for (index, degrees) in rotation_deg.iter_mut().enumerate() {
            *degrees = [index as i16 * 2 - 30, 12 - index as i16, (index as i16 % 4) * 11];
        }
        let pose = posture::pose_of(&Posture { name: "any", rotation_deg }, &skeleton, [0.1, 0.2, 0.9]);
        for (kind, _) in KINDS {
            let reduction = Reduction::new(kind, &table());
            let mut theta = reduction.closest_theta(&table());
            for (index, value) in theta.iter_mut().enumerate() {
                *value += 0.001 * index as f64;
            }
            let centre = centre_of_mass(&pose, &reduction.phi(&theta));
            for slope in [[0.0; 2], [0.3, -0.1]] {
                let rows = reduction.rows(&pose, slope);
                for row in 0..2 {
                    let by_rows: f64 = rows.offset_m[row]
                        + rows.h[row].iter().zip(theta).map(|(h, theta)| h * theta).sum::<f64>();
                    assert!((by_rows - (centre[row] - slope[row] * centre.z)).abs() < 1e-12);
                }
            }
        }
    }
}
