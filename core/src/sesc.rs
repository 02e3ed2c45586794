//! The statically equivalent serial chain: the CoM as a linear function of the subject's parameters.
//!
//! `C_M = x0 + Σ_i R_i φ_i` (Fortini et al., Eq. 2–4): x0 is the pelvis' origin, R_i the `world_from_segment` rotation
//! of segment i, and φ_i the contribution of segment i and all distal segments, in its own axes, over the whole mass.

pub mod prior;
pub mod reduction;
pub mod suit_error;

use nalgebra::Vector3;

use crate::body::{Anthropometry, SEGMENTS, Segment, Skeleton};
use crate::frame::{Pose, StationWorld};

pub use prior::{Prior, Similar};
pub use reduction::{PARAMETERS, Reduction, ReductionKind};

/// The chain's parameters φ_i, segment axes, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phi(pub [[f64; 3]; SEGMENTS]);

impl Phi {
    /// The parameters of a body with given masses and centres (Eq. 2): `φ_i = μ_i c_i + Σ_children d_k · μ(k and all
    /// distal of it)`, with μ the fractions of the whole mass.
    pub fn of(skeleton: &Skeleton, body: &Anthropometry) -> Phi {
        let distal_mass = distal_mass(&body.mass_fraction);
        let mut phi = [[0.0; 3]; SEGMENTS];
        for segment in Segment::ALL {
            let index = segment.index();
            add_scaled(&mut phi[index], body.mass_fraction[index], body.com_m[index]);
            if let Some(parent) = segment.parent() {
                add_scaled(&mut phi[parent.index()], distal_mass[index], skeleton.offset_m[index]);
            }
        }
        Phi(phi)
    }
}

/// Fraction of the whole mass in each segment and all distal of it.
pub fn distal_mass(mass_fraction: &[f64; SEGMENTS]) -> [f64; SEGMENTS] {
    let mut distal = *mass_fraction;
    for segment in Segment::ALL.into_iter().rev() {
        if let Some(parent) = segment.parent() {
            distal[parent.index()] += distal[segment.index()];
        }
    }
    distal
}

/// Centre of mass (Eq. 3), m.
pub fn centre_of_mass(pose: &Pose<StationWorld>, phi: &Phi) -> Vector3<f64> {
    let mut centre = pose.origin_of(Segment::Pelvis);
    for (rotation, phi) in pose.world_from_segment.iter().zip(phi.0) {
        centre += rotation * Vector3::from(phi);
    }
    centre
}

fn add_scaled(sum: &mut [f64; 3], scale: f64, vector: [f64; 3]) {
    for (sum, value) in sum.iter_mut().zip(vector) {
        *sum += scale * value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Sex;
    use crate::pose_suggestion::{Posture, posture};

    #[test]
    fn the_chain_ends_where_the_segments_have_their_common_centre() {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let mut rotation_deg = [[0; 3]; SEGMENTS];
        for (index, degrees) in rotation_deg.iter_mut().enumerate() {
            *degrees = [index as i16 * 3 - 20, 15 - index as i16, (index as i16 % 5) * 9];
        }
        let pose = posture::pose_of(&Posture { name: "any", rotation_deg }, &skeleton, [0.3, -0.2, 0.95]);

        let mut by_segments = Vector3::zeros();
        for segment in Segment::ALL {
            let centre = pose.point_on(segment, body.com_m[segment.index()]);
            by_segments += centre * body.mass_fraction[segment.index()];
        }
        let by_chain = centre_of_mass(&pose, &Phi::of(&skeleton, &body));
        assert!((by_chain - by_segments).norm() < 1e-12, "{by_chain} {by_segments}");
    }
}
