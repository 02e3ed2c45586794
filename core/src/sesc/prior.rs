//! Prior of θ before the first pose: the anthropometric table with its spread, a similar subject, or none; and soft
//! constraints that apply to any body ([`soft_constraints`]).
//!
//! The spread of the table is propagated through Eq. 2, which is linear in the centres and, to first order, in the
//! masses: a heavier segment changes φ of itself and of every ancestor.
//!
//! Masses: V. Zatsiorsky and V. Seluyanov, "The mass and inertia characteristics of the main segments of the human
//! body", Biomechanics VIII-B (1983) 1152–1159, give for 100 young men the standard error of each part's mass about its
//! regression on body mass and stature, which is divided by the part's mean mass here. Assumptions: `SPREAD_FACTOR`,
//! because the table is scaled in proportion, without that regression, and workers differ more than students of sports;
//! full correlation of the slices of one part; the correlation between both sides; and the spread of the centres, for
//! which no table in three axes was found.

use super::suit_error::{EffectiveVectors, misalignment_m};
use super::{PARAMETERS, Phi, Reduction};
use crate::body::{Anthropometry, Segment, Skeleton};
use crate::math;

/// Parts of the body, their standard error of mass over their mean mass, kg over kg (Zatsiorsky and Seluyanov,
/// 1983); of paired parts the left one.
const PARTS: [(&[Segment], f64); 10] = [
    (&[Segment::Neck, Segment::Head], 0.322 / 5.018),
    (&[Segment::T8, Segment::LeftShoulder, Segment::RightShoulder], 1.142 / 11.654),
    (&[Segment::L3, Segment::T12], 1.238 / 11.953),
    (&[Segment::Pelvis, Segment::L5], 1.020 / 8.164),
    (&[Segment::LeftUpperArm], 0.178 / 1.980),
    (&[Segment::LeftForearm], 0.101 / 1.177),
    (&[Segment::LeftHand], 0.063 / 0.447),
    (&[Segment::LeftUpperLeg], 0.721 / 10.36),
    (&[Segment::LeftLowerLeg], 0.219 / 3.16),
    (&[Segment::LeftFoot, Segment::LeftToe], 0.101 / 0.997),
];
/// Factor by which workers deviate from a proportional table more than students from their regression.
const SPREAD_FACTOR: f64 = 1.5;
/// Correlation between both sides' deviations from the table.
const SIDE_CORRELATION: f64 = 0.95;
/// Standard deviation of a trunk segment's centre: forward, sideways, up; m.
const TRUNK_CENTRE_SPREAD_M: [f64; 3] = [0.03, 0.015, 0.03];
/// Standard deviation of a limb segment's centre on each axis, m.
const LIMB_CENTRE_SPREAD_M: f64 = 0.015;
/// Standard deviation of the sideways position of the whole body, m: plates are not placed to the millimetre.
const SIDEWAYS_SPREAD_M: f64 = 0.01;
/// Standard deviation of each parameter without a prior, m: the whole body is within a metre.
const UNINFORMED_SIGMA_M: f64 = 1.0;

/// Mean and covariance of θ; only the first `count` entries are used.
#[derive(Debug, Clone, Copy)]
pub struct Prior {
    /// Mean, m.
    pub theta_m: [f64; PARAMETERS],
    /// Covariance, m².
    pub covariance_m2: [[f64; PARAMETERS]; PARAMETERS],
}

/// Prior information from a similar subject's Φ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similar {
    /// Deviation of the similar subject's Φ from the table scaled to that subject's bone lengths, segment axes, m.
    pub deviation_m: [f64; PARAMETERS],
    /// Variance of `deviation_m` by the identification, m².
    pub variance_m2: [f64; PARAMETERS],
    /// Fraction of a deviation that two subjects of such similarity share, in [0, 1].
    pub likeness: f64,
}

impl Prior {
    /// No prior information: zero, with a standard deviation of one metre.
    pub fn none(reduction: &Reduction) -> Prior {
        let mut prior = Prior { theta_m: [0.0; PARAMETERS], covariance_m2: [[0.0; PARAMETERS]; PARAMETERS] };
        for index in 0..reduction.count() {
            prior.covariance_m2[index][index] = UNINFORMED_SIGMA_M * UNINFORMED_SIGMA_M;
        }
        prior
    }

    /// The table's Φ and its spread.
    pub fn table(reduction: &Reduction, skeleton: &Skeleton, body: &Anthropometry) -> Prior {
        let phi = Phi::of(skeleton, body);
        let mut prior =
            Prior { theta_m: reduction.closest_theta(&phi), covariance_m2: [[0.0; PARAMETERS]; PARAMETERS] };
        for (segments, spread) in PARTS {
            let heavier = |mirrored: bool| {
                let mut sum = [0.0; PARAMETERS];
                for &segment in segments {
                    let segment = if mirrored { segment.mirrored() } else { segment };
                    let weight = SPREAD_FACTOR * spread * body.mass_fraction[segment.index()];
                    add(&mut sum, weight, &mass_direction(segment, skeleton, body, &phi));
                }
                sum
            };
            let is_paired = segments.iter().all(|segment| !segments.contains(&segment.mirrored()));
            let other = is_paired.then(|| heavier(true));
            prior.add_sides(reduction, &heavier(false), other.as_ref());
        }
        for segment in Segment::ALL.into_iter().filter(|segment| *segment <= segment.mirrored()) {
            prior.add_centre(reduction, body, segment);
        }
        let mut sideways = [0.0; PARAMETERS];
        sideways[3 * Segment::Pelvis.index() + 1] = SIDEWAYS_SPREAD_M;
        prior.add_square(reduction, &sideways, 1.0);
        prior
    }

    /// The table combined with a subject of similar build: this subject shares the fraction `likeness` of that
    /// subject's deviation, and the rest has the spread of the table.
    pub fn similar(mut self, reduction: &Reduction, similar: &Similar) -> Prior {
        let likeness = similar.likeness.clamp(0.0, 1.0);
        let deviation_m = reduction.pseudo_inverse(&similar.deviation_m);
        // Raw parameters of one group have a common error, so their standard deviations combine, not their variances.
        let sigma_m = reduction.pseudo_inverse_of_sizes(&similar.variance_m2.map(math::sqrt));
        for row in 0..reduction.count() {
            self.theta_m[row] += likeness * deviation_m[row];
            for entry in &mut self.covariance_m2[row] {
                *entry *= 1.0 - likeness * likeness;
            }
            self.covariance_m2[row][row] += likeness * likeness * sigma_m[row] * sigma_m[row];
        }
        self
    }

    /// Adds the spread of a segment's centre, and that of its mirror image.
    fn add_centre(&mut self, reduction: &Reduction, body: &Anthropometry, segment: Segment) {
        for axis in 0..3 {
            let spread_m =
                if segment <= Segment::Head { TRUNK_CENTRE_SPREAD_M[axis] } else { LIMB_CENTRE_SPREAD_M };
            let moved = |of: Segment, sign: f64| {
                let mut raw = [0.0; PARAMETERS];
                raw[3 * of.index() + axis] = sign * spread_m * body.mass_fraction[of.index()];
                raw
            };
            let mirror_sign = if axis == 1 { -1.0 } else { 1.0 };
            let other = (segment.mirrored() != segment).then(|| moved(segment.mirrored(), mirror_sign));
            self.add_sides(reduction, &moved(segment, 1.0), other.as_ref());
        }
    }

    /// Adds a deviation of one part, or of a part and its mirror image, with the correlation [`SIDE_CORRELATION`].
    fn add_sides(
        &mut self,
        reduction: &Reduction,
        one: &[f64; PARAMETERS],
        other: Option<&[f64; PARAMETERS]>,
    ) {
        let Some(other) = other else { return self.add_square(reduction, one, 1.0) };
        let mut both = *one;
        add(&mut both, 1.0, other);
        self.add_square(reduction, &both, SIDE_CORRELATION);
        self.add_square(reduction, one, 1.0 - SIDE_CORRELATION);
        self.add_square(reduction, other, 1.0 - SIDE_CORRELATION);
    }

    /// Adds `weight · v vᵀ` with `v = T⁺ raw`.
    fn add_square(&mut self, reduction: &Reduction, raw: &[f64; PARAMETERS], weight: f64) {
        let direction = reduction.pseudo_inverse(raw);
        for row in 0..reduction.count() {
            for column in 0..reduction.count() {
                self.covariance_m2[row][column] += weight * (direction[row] * direction[column]);
            }
        }
    }
}

fn add(sum: &mut [f64; PARAMETERS], scale: f64, vector: &[f64; PARAMETERS]) {
    for (sum, value) in sum.iter_mut().zip(vector) {
        *sum += scale * value;
    }
}

/// Changes of θ, m, by constant misalignments of the suit's sensors of `sigma_rad` about each axis: they appear as a
/// constant rotation of every φ. Independent of each other, three per segment.
pub fn misalignments_m(
    reduction: &Reduction,
    psi: &EffectiveVectors,
    sigma_rad: f64,
) -> impl Iterator<Item = [f64; PARAMETERS]> {
    Segment::ALL.into_iter().flat_map(move |segment| {
        misalignment_m(psi.0[segment.index()], sigma_rad).map(|moved| {
            let mut raw = [0.0; PARAMETERS];
            raw[3 * segment.index()..][..3].copy_from_slice(&moved);
            reduction.pseudo_inverse(&raw)
        })
    })
}

/// One soft constraint on any body: `h θ = value`, with the 1-σ `sigma_m`.
#[derive(Debug, Clone, Copy)]
pub struct SoftConstraint {
    /// Row over θ.
    pub h: [f64; PARAMETERS],
    /// Expected value, m.
    pub value_m: f64,
    /// 1-σ, m.
    pub sigma_m: f64,
}

/// Long axis of each limb segment, left side, and the axes across it, whose parameters should be zero.
const ACROSS: [(Segment, &[usize]); 7] = [
    (Segment::LeftUpperArm, &[0, 2]),
    (Segment::LeftForearm, &[0, 2]),
    (Segment::LeftHand, &[0, 2]),
    (Segment::LeftUpperLeg, &[0, 1]),
    (Segment::LeftLowerLeg, &[0, 1]),
    // A foot is not a rod: its parameter below the ankle is that of the table.
    (Segment::LeftFoot, &[1]),
    (Segment::LeftToe, &[1]),
];

/// Symmetry of both sides, and centres of limbs near their long axes: what [`super::ReductionKind::Symmetric`] enforces
/// exactly, here within `symmetry_sigma_m` and `long_axis_sigma_m`.
///
/// Omits constraints that the reduction enforces exactly.
pub fn soft_constraints(
    reduction: &Reduction,
    symmetry_sigma_m: f64,
    long_axis_sigma_m: f64,
) -> impl Iterator<Item = SoftConstraint> {
    let pairs = Segment::ALL.into_iter().filter(|segment| *segment < segment.mirrored());
    let symmetric = pairs.flat_map(move |one| {
        (0..3).filter_map(move |axis| {
            let (row, known_m) = reduction.raw_row(one, axis);
            let (other_row, other_known_m) = reduction.raw_row(one.mirrored(), axis);
            // Sides with a common parameter are symmetric already.
            let has_common_parameter = row.iter().zip(&other_row).any(|(a, b)| *a != 0.0 && *b != 0.0);
            let sign = if axis == 1 { -1.0 } else { 1.0 };
            (!has_common_parameter).then(|| SoftConstraint {
                h: core::array::from_fn(|index| row[index] - sign * other_row[index]),
                value_m: sign * other_known_m - known_m,
                sigma_m: symmetry_sigma_m,
            })
        })
    });
    let on_axis = ACROSS.into_iter().flat_map(move |(left, axes)| {
        axes.iter().flat_map(move |&axis| {
            let sides = [left, left.mirrored()].map(|segment| reduction.raw_row(segment, axis));
            // A common parameter of both sides is constrained once.
            let same = sides[0].0.iter().zip(&sides[1].0).all(|(a, b)| a.abs() == b.abs());
            sides.into_iter().take(if same { 1 } else { 2 }).map(move |(h, known_m)| SoftConstraint {
                h,
                value_m: -known_m,
                sigma_m: long_axis_sigma_m,
            })
        })
    });
    symmetric.chain(on_axis).filter(|constraint| constraint.h.iter().any(|entry| *entry != 0.0))
}

/// `dΦ/dμ_s` with the other masses decreasing in proportion, so that the fractions still sum to 1.
fn mass_direction(of: Segment, skeleton: &Skeleton, body: &Anthropometry, phi: &Phi) -> [f64; PARAMETERS] {
    let mut direction = core::array::from_fn(|raw| -phi.0[raw / 3][raw % 3]);
    let mut add = |segment: Segment, vector: [f64; 3]| {
        for (axis, value) in vector.into_iter().enumerate() {
            direction[3 * segment.index() + axis] += value;
        }
    };
    add(of, body.com_m[of.index()]);
    let mut segment = of;
    while let Some(parent) = segment.parent() {
        add(parent, skeleton.offset_m[segment.index()]);
        segment = parent;
    }
    direction
}

#[cfg(test)]
mod tests;
