//! Predicted overload of a part that is to be handed over: the posture in which a worker holds it at a place, and the
//! torques there, each with its uncertainty.
//!
//! Before the part is in the hands nothing can be measured, so the posture is predicted, too. The model of the posture
//! is a normal distribution over joint angles (`handover/coordinates.rs`), whose means and standard deviations are the
//! comfortable zones of REBA (Hignett & McAtamney, Applied Ergonomics 31 (2000) 201–205). It is conditioned on the
//! hands being at the part and on the centre of pressure being where people keep it: the most probable posture is found
//! by Levenberg and Marquardt's method, and the covariance around it is that of Laplace's approximation. The torques
//! are those of Eq. 15 with the centre of pressure that the part causes.
//!
//! The contacts are unavailable before the handover, too: η is uniform between one hand and the other, the part's centre
//! as far ahead of the grips as that of any load, each with the prior of [`crate::overload::load_position`]; grips and
//! feet have the errors of [`LoadingSigma::of_contacts`].

mod coordinates;
pub mod experience;
pub mod hold;
pub mod measure;
pub mod search;
mod solve;
pub mod worst;

use core::ops::RangeInclusive;

use nalgebra::{UnitQuaternion, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::body::anthropometry::ANKLE_HEIGHT;
use crate::body::{JOINTS, Joint, SEGMENTS, Side, Skeleton};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::overload::load_position::{AHEAD_M, AHEAD_SIGMA_M, EVEN, EVEN_SIGMA};
use crate::overload::{self, FootDeviation, FootLoads, Loading, LoadingSigma, Swing, TorqueLimits};
use crate::sesc::{Phi, centre_of_mass};

use coordinates::{COORDINATES, Coordinates, WRIST};
use experience::LimitRatio;
use solve::Solution;
use worst::{HandFractions, worst};

/// The worker's body.
#[derive(Debug, Clone, Copy)]
pub struct Body {
    /// Bone lengths.
    pub skeleton: Skeleton,
    /// Grip points of the left and right hand, from the wrist, hand's axes, m.
    pub grip_m: [[f64; 3]; 2],
    /// Identified mass distribution.
    pub phi: Phi,
    /// 1-σ of the centre of pressure that it predicts, per axis, m.
    pub cop_sigma_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// τ_max of the joints.
    pub limits: TorqueLimits,
    /// Overloading fatigue of the joints, in [0, 1): it reduces τ_max.
    pub fatigue: [f64; JOINTS],
}

/// Distance between the heels and angle between the feet of people who stand as they like, m and rad (McIlroy & Maki,
/// Clinical Biomechanics 12 (1997) 66–70: 17 cm, 14°).
const FEET_APART_M: f64 = 0.17;
const FEET_TURNED_OUT_RAD: f64 = 14.0 * core::f64::consts::PI / 180.0;

/// The standing feet.
#[derive(Debug, Clone, Copy)]
pub struct FootPlacement {
    /// Left and right ankle, world, m.
    pub ankle_m: [Vector3<f64>; 2],
    /// `world_from_foot`, left and right.
    pub world_from_foot: [UnitQuaternion<f64>; 2],
}

impl FootPlacement {
    /// The feet of segments with these origins (world, m): each foot points from the ankle to its ball.
    pub fn of_segments(origin_m: &[[f64; 3]; SEGMENTS]) -> FootPlacement {
        let [left, right] = Side::BOTH.map(|side| {
            let foot = side.foot().index();
            let [ankle_m, ball_m] = [foot, foot + 1].map(|segment| Vector3::from(origin_m[segment]));
            let ahead = ball_m - ankle_m;
            let heading_rad = math::atan2(ahead.y, ahead.x);
            (ankle_m, UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad))
        });
        FootPlacement { ankle_m: [left.0, right.0], world_from_foot: [left.1, right.1] }
    }

    /// The feet of a person of this stature who stands naturally, facing X, with the middle between the ankles above the origin.
    pub fn natural(height_m: f64) -> FootPlacement {
        let foot = |side: f64| {
            let ankle_m = Vector3::new(0.0, side * 0.5 * FEET_APART_M, ANKLE_HEIGHT * height_m);
            (ankle_m, UnitQuaternion::from_axis_angle(&Vector3::z_axis(), side * 0.5 * FEET_TURNED_OUT_RAD))
        };
        let (left, right) = (foot(1.0), foot(-1.0));
        FootPlacement { ankle_m: [left.0, right.0], world_from_foot: [left.1, right.1] }
    }

    /// The world point of a place relative to the feet: forward and to the left of the middle between the ankles, and
    /// above the floor, m. The floor is below the ankles by their height in [`FootPlacement::natural`].
    pub fn world_m(&self, place_m: Vector3<f64>, height_m: f64) -> Vector3<f64> {
        let middle_m = self.middle_m();
        let floor_m = Vector3::new(middle_m.x, middle_m.y, middle_m.z - ANKLE_HEIGHT * height_m);
        floor_m + self.world_from_feet() * place_m
    }

    /// The place of a world point: the inverse of [`FootPlacement::world_m`], m.
    pub fn place_m(&self, world_m: Vector3<f64>, height_m: f64) -> Vector3<f64> {
        self.world_from_feet().inverse() * (world_m - self.world_m(Vector3::zeros(), height_m))
    }

    /// Angle from the world's X axis, about the vertical, to the direction between both feet's directions, rad.
    pub fn heading_rad(&self) -> f64 {
        let ahead = self.world_from_feet() * Vector3::x();
        math::atan2(ahead.y, ahead.x)
    }

    /// Middle between the ankles, m.
    fn middle_m(&self) -> Vector3<f64> {
        0.5 * (self.ankle_m[0] + self.ankle_m[1])
    }

    /// Rotation about the vertical to the direction between both feet's directions.
    fn world_from_feet(&self) -> UnitQuaternion<f64> {
        let ahead = self.world_from_foot[0] * Vector3::x() + self.world_from_foot[1] * Vector3::x();
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), math::atan2(ahead.y, ahead.x))
    }
}

/// Masses of a part that a person holds in both hands, kg: from the detection limit of a plate to what anybody lifts.
pub const MASS_KG: RangeInclusive<f64> = 0.1..=50.0;
/// Distances between the grips on a part, m: what the arms span in front of the body.
pub const WIDTH_M: RangeInclusive<f64> = 0.0..=1.0;
/// Largest coordinate of a place relative to the feet, m: beyond what anybody reaches.
pub const PLACE_MAX_M: f64 = 3.0;

/// A part held with both hands.
#[derive(Debug, Clone, Copy)]
pub struct Part {
    /// Mass, kg.
    pub mass_kg: f64,
    /// 1-σ of the mass, kg.
    pub mass_sigma_kg: f64,
    /// Distance between the grips, m.
    pub width_m: f64,
    /// Slope of the handles: how far hands that follow them point below the horizontal, rad. `None`: handles that turn
    /// with the hands, which are then in line with the forearms.
    pub slope_rad: Option<f64>,
}

impl Part {
    /// The part with another slope of its handles.
    #[must_use]
    pub fn with_slope(self, slope_rad: Option<f64>) -> Part {
        Part { slope_rad, ..self }
    }
}

/// Largest distance of the hands from the part in a solution, m: beyond it the part is out of reach.
const MISS_MAX_M: f64 = 3.0 * coordinates::HAND_SIGMA_M;
/// Largest deviation of a hand's slope from that of the handles in a solution, σ: beyond it the part is infeasible.
const SLOPE_OFF_MAX_SIGMAS: f64 = 3.0;

/// Remaining fraction of τ_max of a joint with this fatigue.
fn unfatigued(fatigue: f64) -> f64 {
    (1.0 - fatigue).max(f64::EPSILON)
}

/// Why a part cannot be held at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Infeasible {
    /// The hands do not reach the place.
    OutOfReach,
    /// The centre of pressure would be outside the feet.
    OutOfBalance,
}

impl Infeasible {
    /// Public name.
    pub fn name(self) -> &'static str {
        match self {
            Infeasible::OutOfReach => "out_of_reach",
            Infeasible::OutOfBalance => "out_of_balance",
        }
    }
}

/// Predicted posture and overload with a part at a place.
#[derive(Debug, Clone, Copy)]
pub struct Prediction {
    /// The most probable pose.
    pub pose: Pose<StationWorld>,
    /// Limit ratio of each joint while both hands carry the same: overload torque over τ_max, which fatigue reduces.
    pub limit_ratio: [f64; JOINTS],
    /// The joint with the largest of them.
    pub worst: Joint,
    /// The largest limit ratio of a joint: mean over the fractions of the part in the hands ([`worst::worst`]), and 1-σ of
    /// the posture, the body model, the mass and the contacts.
    pub worst_ratio: LimitRatio,
}

/// Predicts how a worker holds a part with the middle between the grips at `at_m` (world, m), and the overload there.
pub fn predict(
    body: &Body,
    feet: &FootPlacement,
    part: &Part,
    at_m: Vector3<f64>,
) -> Result<Prediction, Infeasible> {
    let holding = Holding { body, feet, part, at_m, world_from_feet: feet.world_from_feet() };
    let solution = solve::most_probable(&holding);
    let (pose, grip_m) = holding.pose(&solution.coordinates);
    let miss_m = holding.miss(grip_m).into_iter().map(|miss| miss.norm()).fold(0.0, f64::max);
    if miss_m > MISS_MAX_M {
        return Err(Infeasible::OutOfReach);
    }
    let slope_off = holding.slope_off_rad(&pose).into_iter().fold(0.0, |most: f64, off| most.max(off.abs()));
    if slope_off > SLOPE_OFF_MAX_SIGMAS * coordinates::SLOPE_SIGMA_RAD {
        return Err(Infeasible::OutOfReach);
    }
    let off_m = holding.cop_off_m(&pose, grip_m);
    if math::hypot(off_m) > coordinates::COP_OFF_MAX_SIGMAS * coordinates::COP_SIGMA_M {
        return Err(Infeasible::OutOfBalance);
    }
    let limit_ratio = holding.limit_ratios(&pose, grip_m, &Changed::NONE);
    let sigma = holding.sigmas(&solution, &limit_ratio);
    let ratio = core::array::from_fn(|joint| LimitRatio { value: limit_ratio[joint], sigma: sigma[joint] });
    let hands = HandFractions { eta: [EVEN; 2], sigma: EVEN_SIGMA };
    let (worst, worst_ratio) = worst(&ratio, &hands)
        .map_or((Joint::ALL[0], LimitRatio { value: f64::NAN, sigma: f64::NAN }), |it| (it.joint, it.ratio));
    Ok(Prediction { pose, limit_ratio, worst, worst_ratio })
}

/// Inputs of one prediction.
struct Holding<'a> {
    body: &'a Body,
    feet: &'a FootPlacement,
    part: &'a Part,
    /// Middle between the grips, world, m.
    at_m: Vector3<f64>,
    world_from_feet: UnitQuaternion<f64>,
}

/// Changes of the inputs other than the posture.
struct Changed {
    /// Mass of the part, kg.
    mass_kg: f64,
    /// Centre of mass of the body, world x and y, m.
    cop_m: [f64; 2],
    /// Fraction of the part in the right hand.
    eta: f64,
    /// Distance of the part's centre ahead of the grips, m.
    ahead_m: f64,
}

impl Changed {
    const NONE: Changed = Changed { mass_kg: 0.0, cop_m: [0.0; 2], eta: 0.0, ahead_m: 0.0 };
}

impl Holding<'_> {
    /// The pose of coordinates, and its grip points, world, m.
    fn pose(&self, coordinates: &Coordinates) -> (Pose<StationWorld>, [Vector3<f64>; 2]) {
        let mut coordinates = *coordinates;
        if self.part.slope_rad.is_none() {
            coordinates[WRIST..].fill(0.0);
        }
        let pose = coordinates::pose(&coordinates, &self.body.skeleton, self.feet, self.world_from_feet);
        let grip_m = Side::BOTH.map(|side| pose.point_on(side.hand(), self.body.grip_m[side as usize]));
        (pose, grip_m)
    }

    /// From where each grip should be to where it is, m.
    fn miss(&self, grip_m: [Vector3<f64>; 2]) -> [Vector3<f64>; 2] {
        let aside = self.world_from_feet * Vector3::new(0.0, 0.5 * self.part.width_m, 0.0);
        [grip_m[0] - (self.at_m + aside), grip_m[1] - (self.at_m - aside)]
    }

    /// Slope of each hand minus that of the handles, rad; zero for handles that turn with the hands.
    fn slope_off_rad(&self, pose: &Pose<StationWorld>) -> [f64; 2] {
        let Some(slope_rad) = self.part.slope_rad else { return [0.0; 2] };
        Side::BOTH.map(|side| {
            let outward = if side == Side::Left { Vector3::y() } else { -Vector3::y() };
            let along = pose.world_from_segment[side.hand().index()] * outward;
            math::atan2(-along.z, math::hypot([along.x, along.y])) - slope_rad
        })
    }

    /// Weight of the part, N.
    fn part_n(&self) -> f64 {
        self.part.mass_kg * GRAVITY_M_PER_S2
    }

    /// Centre of pressure with the part, relative to where people keep it, axes of the feet, m.
    fn cop_off_m(&self, pose: &Pose<StationWorld>, grip_m: [Vector3<f64>; 2]) -> [f64; 2] {
        let com = centre_of_mass(pose, &self.body.phi);
        let (body_n, part_n) = (self.body.mass_kg * GRAVITY_M_PER_S2, self.part_n());
        let load = 0.5 * (grip_m[0] + grip_m[1]) + self.ahead(AHEAD_M);
        let cop = (com * body_n + load * part_n) / (body_n + part_n) - self.feet.middle_m();
        let off = self.world_from_feet.inverse() * cop;
        [off.x - coordinates::COP_AHEAD_M, off.y]
    }

    /// Vector of this length away from the person, perpendicular to the line between the grips.
    fn ahead(&self, metres: f64) -> Vector3<f64> {
        self.world_from_feet * Vector3::new(metres, 0.0, 0.0)
    }

    /// Inputs of Eq. 15.
    fn loading(&self, pose: &Pose<StationWorld>, grip_m: [Vector3<f64>; 2], off: &Changed) -> Loading {
        let com = centre_of_mass(pose, &self.body.phi);
        let body_n = self.body.mass_kg * GRAVITY_M_PER_S2;
        let part_n = self.part_n() + off.mass_kg * GRAVITY_M_PER_S2;
        let eta = [1.0 - EVEN - off.eta, EVEN + off.eta];
        let grip_m = grip_m.map(|grip_m| grip_m + self.ahead(AHEAD_M + off.ahead_m));
        let load = grip_m[0] * eta[0] + grip_m[1] * eta[1];
        let alone_m = [com.x + off.cop_m[0], com.y + off.cop_m[1]];
        let with_part = |axis: usize| (alone_m[axis] * body_n + load[axis] * part_n) / (body_n + part_n);
        Loading {
            cop_measured_m: [with_part(0), with_part(1)],
            cop_estimated_m: alone_m,
            vertical_n: body_n + part_n,
            delta_f_n: part_n,
            grip_m,
            eta,
            feet: FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] },
            deviation: FootDeviation::NONE,
            swing: Swing::NONE,
        }
    }

    /// Overload of each joint over its limit.
    fn limit_ratios(
        &self,
        pose: &Pose<StationWorld>,
        grip_m: [Vector3<f64>; 2],
        off: &Changed,
    ) -> [f64; JOINTS] {
        let torque_nm = overload::torque_vectors(pose, &self.loading(pose, grip_m, off));
        let limit_nm = self.limits_nm(pose, &torque_nm);
        core::array::from_fn(|joint| torque_nm[joint].norm() / limit_nm[joint])
    }

    /// Limit of each joint in the direction of its torque, which fatigue reduces, N m.
    fn limits_nm(&self, pose: &Pose<StationWorld>, torque_nm: &[Vector3<f64>; JOINTS]) -> [f64; JOINTS] {
        let limit_nm = self.body.limits.along_nm(pose, &torque_nm.map(Into::into));
        core::array::from_fn(|joint| limit_nm[joint] * unfatigued(self.body.fatigue[joint]))
    }

    /// 1-σ of each joint's limit ratio.
    fn sigmas(&self, solution: &Solution, limit_ratio: &[f64; JOINTS]) -> [f64; JOINTS] {
        let mut slopes = [[0.0; COORDINATES]; JOINTS];
        for index in 0..COORDINATES {
            let mut moved = solution.coordinates;
            moved[index] += solve::STEP;
            let (pose, grip_m) = self.pose(&moved);
            let ratio = self.limit_ratios(&pose, grip_m, &Changed::NONE);
            for joint in 0..JOINTS {
                slopes[joint][index] = (ratio[joint] - limit_ratio[joint]) / solve::STEP;
            }
        }
        let (pose, grip_m) = self.pose(&solution.coordinates);
        let cop_m = self.body.cop_sigma_m;
        let others = [
            Changed { mass_kg: self.part.mass_sigma_kg, ..Changed::NONE },
            Changed { cop_m: [cop_m, 0.0], ..Changed::NONE },
            Changed { cop_m: [0.0, cop_m], ..Changed::NONE },
            Changed { eta: EVEN_SIGMA, ..Changed::NONE },
            Changed { ahead_m: AHEAD_SIGMA_M, ..Changed::NONE },
        ];
        let others = others.map(|off| self.limit_ratios(&pose, grip_m, &off));
        let contacts = self.contact_sigmas(&pose, grip_m);
        core::array::from_fn(|joint| {
            let offs = others.iter().map(|ratio| ratio[joint] - limit_ratio[joint]);
            let square: f64 = offs.chain([contacts[joint]]).map(|off| off * off).sum();
            math::sqrt(square + solution.variance_along(&slopes[joint]))
        })
    }

    /// The part of it that the places of grips and feet have.
    fn contact_sigmas(&self, pose: &Pose<StationWorld>, grip_m: [Vector3<f64>; 2]) -> [f64; JOINTS] {
        let loading = self.loading(pose, grip_m, &Changed::NONE);
        let torques = overload::torques(pose, &loading, &LoadingSigma::of_contacts(loading.delta_f_n));
        let limit_nm = self.limits_nm(pose, &torques.map(|torque| torque.torque_nm));
        core::array::from_fn(|joint| torques[joint].sigma_nm / limit_nm[joint])
    }

    /// Residuals of the posture: the coordinates over their zones, the hands' misses and the balance over their σ.
    fn residuals(&self, coordinates: &Coordinates) -> [f64; solve::RESIDUALS] {
        let (pose, grip_m) = self.pose(coordinates);
        let mut all = [0.0; solve::RESIDUALS];
        all[..COORDINATES].copy_from_slice(&coordinates::off_zone(coordinates));
        let [left, right] = self.miss(grip_m);
        for (at, miss_m) in [(COORDINATES, left), (COORDINATES + 3, right)] {
            for axis in 0..3 {
                all[at + axis] = miss_m[axis] / coordinates::HAND_SIGMA_M;
            }
        }
        for (axis, off_m) in self.cop_off_m(&pose, grip_m).into_iter().enumerate() {
            all[COORDINATES + 6 + axis] = off_m / coordinates::COP_SIGMA_M;
        }
        for (hand, off_rad) in self.slope_off_rad(&pose).into_iter().enumerate() {
            all[COORDINATES + 8 + hand] = off_rad / coordinates::SLOPE_SIGMA_RAD;
        }
        all
    }
}

#[cfg(test)]
mod tests;
