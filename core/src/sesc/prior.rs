//! What is believed about θ before the first pose: the anthropometric table with its spread, or nothing.
//!
//! The spread of published tables is pushed through Eq. 2, which is linear in the masses and in the centres: a
//! heavier segment moves φ of itself and of every segment it hangs on. Spreads are those between people of one sex
//! after scaling: about 12 % of a segment's mass and a few centimetres of its centre.

use super::suit_error::{EffectiveVectors, misalignment_m};
use super::{PARAMETERS, Phi, Reduction};
use crate::body::{Anthropometry, Segment, Skeleton};

/// Standard deviation of a segment's mass over its mass.
const MASS_SPREAD: f64 = 0.12;
/// Standard deviation of a trunk segment's centre: forward, sideways, up; m.
const TRUNK_CENTRE_SPREAD_M: [f64; 3] = [0.03, 0.015, 0.03];
/// Standard deviation of a limb segment's centre on each axis, m.
const LIMB_CENTRE_SPREAD_M: f64 = 0.015;
/// Standard deviation of the whole body's lean to one side, m: plates are not placed to the millimetre.
const SIDEWAYS_SPREAD_M: f64 = 0.01;
/// Standard deviation of each parameter when nothing is believed, m: the whole body is within a metre.
const IGNORANCE_M: f64 = 1.0;

/// Mean and covariance of θ; only the first `count` entries mean anything.
#[derive(Debug, Clone, Copy)]
pub struct Prior {
    /// Mean, m.
    pub theta_m: [f64; PARAMETERS],
    /// Covariance, m².
    pub covariance_m2: [[f64; PARAMETERS]; PARAMETERS],
}

impl Prior {
    /// Nothing is believed: zero, give or take a metre.
    pub fn none(reduction: &Reduction) -> Prior {
        let mut prior = Prior { theta_m: [0.0; PARAMETERS], covariance_m2: [[0.0; PARAMETERS]; PARAMETERS] };
        for index in 0..reduction.count() {
            prior.covariance_m2[index][index] = IGNORANCE_M * IGNORANCE_M;
        }
        prior
    }

    /// The table's Φ and its spread.
    pub fn table(reduction: &Reduction, skeleton: &Skeleton, body: &Anthropometry) -> Prior {
        let count = reduction.count();
        let phi = Phi::of(skeleton, body);
        let mut prior = Prior { theta_m: reduction.closest_theta(&phi), ..Prior::none(reduction) };
        prior.covariance_m2 = [[0.0; PARAMETERS]; PARAMETERS];
        for segment in Segment::ALL {
            let direction = reduction.pseudo_inverse(&mass_direction(segment, skeleton, body, &phi));
            let sigma = MASS_SPREAD * body.mass_fraction[segment.index()];
            prior.add_outer(count, &direction, sigma);
            for axis in 0..3 {
                let mut unit = [0.0; PARAMETERS];
                unit[3 * segment.index() + axis] = 1.0;
                let spread =
                    if segment <= Segment::Head { TRUNK_CENTRE_SPREAD_M[axis] } else { LIMB_CENTRE_SPREAD_M };
                let direction = reduction.pseudo_inverse(&unit);
                prior.add_outer(count, &direction, spread * body.mass_fraction[segment.index()]);
            }
        }
        let mut sideways = [0.0; PARAMETERS];
        sideways[3 * Segment::Pelvis.index() + 1] = 1.0;
        prior.add_outer(count, &reduction.pseudo_inverse(&sideways), SIDEWAYS_SPREAD_M);
        prior
    }

    /// Adds what a suit does whose sensors sit on the segments by `sigma_rad` about each axis wrongly: it shows every
    /// φ rotated, for good.
    pub fn add_misalignment(&mut self, reduction: &Reduction, psi: &EffectiveVectors, sigma_rad: f64) {
        for segment in Segment::ALL {
            for moved in misalignment_m(psi.0[segment.index()], sigma_rad) {
                let mut raw = [0.0; PARAMETERS];
                raw[3 * segment.index()..][..3].copy_from_slice(&moved);
                self.add_outer(reduction.count(), &reduction.pseudo_inverse(&raw), 1.0);
            }
        }
    }

    fn add_outer(&mut self, count: usize, direction: &[f64; PARAMETERS], sigma: f64) {
        for row in 0..count {
            for column in 0..count {
                self.covariance_m2[row][column] += sigma * sigma * (direction[row] * direction[column]);
            }
        }
    }
}

/// `dΦ/dμ_s` with the other masses shrinking in proportion, so that the shares stay whole.
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
mod tests {
    use super::*;
    use crate::body::Sex;
    use crate::sesc::ReductionKind;

    #[test]
    fn a_heavier_segment_moves_phi_along_its_direction() {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let phi = Phi::of(&skeleton, &body);
        let more = 1e-6;
        for segment in [Segment::Pelvis, Segment::Head, Segment::LeftForearm, Segment::RightToe] {
            let mut heavier = body;
            heavier.mass_fraction[segment.index()] += more;
            heavier.mass_fraction = heavier.mass_fraction.map(|fraction| fraction / (1.0 + more));
            let moved = Phi::of(&skeleton, &heavier);
            for (raw, slope) in mass_direction(segment, &skeleton, &body, &phi).into_iter().enumerate() {
                let difference = (moved.0[raw / 3][raw % 3] - phi.0[raw / 3][raw % 3]) / more;
                assert!((difference - slope).abs() < 1e-5, "{segment:?} {raw}: {difference} {slope}");
            }
        }
    }

    #[test]
    fn the_covariance_is_symmetric_and_positive_on_its_diagonal() {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let phi = Phi::of(&skeleton, &body);
        for kind in [ReductionKind::Full, ReductionKind::Merged, ReductionKind::Symmetric] {
            let reduction = Reduction::new(kind, &phi);
            let prior = Prior::table(&reduction, &skeleton, &body);
            for row in 0..reduction.count() {
                assert!(prior.covariance_m2[row][row] > 0.0);
                for column in 0..row {
                    assert_eq!(prior.covariance_m2[row][column], prior.covariance_m2[column][row]);
                }
            }
        }
    }
}
