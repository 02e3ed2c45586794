//! What the physics of a worker has beside the body and the box: masses worn, forces on the body, a body that is not
//! the one of before, a joint more than a suit knows of. Each may come and go.

use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::Vector3;

use crate::GRAVITY_M_PER_S2;
use crate::colour::joint_rad;
use crate::dynamics::Wrench;
use crate::motion::BodyState;
use crate::random::Coloured;
use crate::schedule::minimum_jerk;

/// What comes or goes takes this long, s.
const RAMP_S: f64 = 0.8;

/// When something is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// From when, s.
    pub from_s: f64,
    /// Until when, s.
    pub to_s: f64,
    /// When its sign turns over, s.
    pub flips_at_s: Option<f64>,
}

impl Span {
    /// From before everything until after it.
    pub const ALWAYS: Span = Span { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY, flips_at_s: None };

    /// How much of it is there at a time, in [−1, 1]; it comes, turns over and goes within a moment.
    pub fn share(&self, time_s: f64) -> f64 {
        let since = |start_s: f64| minimum_jerk((time_s - start_s) / RAMP_S);
        let sign = self.flips_at_s.map_or(1.0, |flips_at_s| 1.0 - 2.0 * since(flips_at_s));
        since(self.from_s) * minimum_jerk((self.to_s - time_s) / RAMP_S) * sign
    }
}

/// A point of the body: on a segment, from its origin in its axes, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Which segment.
    pub segment: Segment,
    /// Where on it, m.
    pub at_m: Vector3<f64>,
}

impl Point {
    /// Where it is in the world, m.
    pub fn in_world_m(&self, body: &BodyState) -> Vector3<f64> {
        let i = self.segment.index();
        body.origin_m[i] + body.world_from_segment[i] * self.at_m
    }
}

/// Something that pulls or pushes at the body.
#[derive(Debug, Clone)]
pub enum Burden {
    /// A point mass, kg.
    Mass(Point, f64),
    /// A force of the surroundings on the body, N, and what it varies by (a share of it).
    Push(Point, Vector3<f64>, Coloured),
    /// A band to a fixed point (m): N/m beyond a length at rest (m).
    Band(Point, Vector3<f64>, f64, f64),
}

impl Burden {
    /// What the ground does more because of it, about the world's origin, from three states `step_s` apart.
    pub fn ground_reaction(&self, [before, now, after]: &[BodyState; 3], step_s: f64) -> Wrench {
        match self {
            Burden::Mass(point, mass_kg) => {
                let [past, here, next] = [before, now, after].map(|body| point.in_world_m(body));
                let acceleration = (next - here * 2.0 + past) / (step_s * step_s);
                Wrench::at(here, (acceleration + Vector3::z() * GRAVITY_M_PER_S2) * *mass_kg)
            }
            Burden::Push(point, force_n, variation) => {
                Wrench::at(point.in_world_m(now), -force_n * (1.0 + variation.at(now.time_s)))
            }
            Burden::Band(point, anchor_m, stiffness_n_per_m, rest_m) => {
                let here = point.in_world_m(now);
                let towards = anchor_m - here;
                let pull_n = stiffness_n_per_m * (towards.norm() - rest_m).max(0.0);
                Wrench::at(here, -towards.normalize() * pull_n)
            }
        }
    }
}

/// How a body differs from the one that the suit measures.
#[derive(Debug, Clone)]
pub enum BodyChange {
    /// A segment's centre of mass lies elsewhere, segment axes, m.
    Centre(Segment, Vector3<f64>),
    /// A segment's centre of mass moves along an axis (m) so many times a second: breath.
    Breath(Segment, Vector3<f64>, f64),
    /// Shoulder blades that glide: as an arm is raised, its shoulder's joint leaves its place by this (trunk's axes, m;
    /// sideways is outwards) at a right angle, and the arm with it.
    ShoulderBlades(Vector3<f64>),
    /// A spine that bends elsewhere than the suit thinks: all above L3 leaves its place by this (pelvis' axes, m) for
    /// each radian between pelvis and trunk.
    SpineShape(Vector3<f64>),
}

impl BodyChange {
    /// The body with a share of the change.
    pub fn on(&self, body: &mut BodyState, share: f64) {
        match *self {
            BodyChange::Centre(segment, by_m) => {
                let i = segment.index();
                body.com_m[i] += body.world_from_segment[i] * by_m * share;
            }
            BodyChange::Breath(segment, by_m, hertz) => {
                let i = segment.index();
                let phase = (core::f64::consts::TAU * hertz * body.time_s).sin();
                body.com_m[i] += body.world_from_segment[i] * by_m * (share * phase);
            }
            BodyChange::ShoulderBlades(by_m) => {
                for (upper, side) in [(Segment::LeftUpperArm, 1.0), (Segment::RightUpperArm, -1.0)] {
                    let trunk = body.world_from_segment[Segment::T8.index()];
                    // Hanging, an arm points down the trunk; in the T-pose its length is the Y axis.
                    let along = body.world_from_segment[upper.index()] * Vector3::new(0.0, side, 0.0);
                    let raised = 1.0 + (trunk.inverse() * along).z;
                    let by_m = trunk * Vector3::new(by_m.x, side * by_m.y, by_m.z) * (share * raised);
                    shift(body, upper.index()..upper.index() + 3, by_m);
                }
            }
            BodyChange::SpineShape(by_m) => {
                let bend_rad: Vector3<f64> = {
                    let [pelvis, trunk] =
                        [Segment::Pelvis, Segment::T8].map(|s| body.world_from_segment[s.index()]);
                    (pelvis.inverse() * trunk).scaled_axis()
                };
                let by_m = body.world_from_segment[0] * by_m * (share * bend_rad.y);
                shift(body, Segment::T12.index()..Segment::RightUpperLeg.index(), by_m);
            }
        }
    }
}

fn shift(body: &mut BodyState, segments: core::ops::Range<usize>, by_m: Vector3<f64>) {
    for i in segments {
        body.origin_m[i] += by_m;
        body.com_m[i] += by_m;
        for (hand, grip_m) in [Segment::LeftHand, Segment::RightHand].into_iter().zip(&mut body.grip_m) {
            if hand.index() == i {
                *grip_m += by_m;
            }
        }
    }
}

/// How a suit's rotations err beside its ordinary noise.
#[derive(Debug, Clone)]
pub enum SuitFault {
    /// The whole suit turns to the left, rad/s since the span's begin.
    HeadingDrift(f64),
    /// One segment is turned to the left, rad.
    Heading(Segment, f64),
    /// One segment's sensor sits crooked, rotation vector in the segment's axes, rad.
    Misalignment(Segment, Vector3<f64>),
    /// One segment is turned to the left by up to an angle (rad) near a point of the room (m), with this reach (m).
    MagneticRegion(Segment, f64, Vector3<f64>, f64),
    /// One segment's sensor turns by a share of the joint's angle.
    Slip(Segment, f64),
}

impl SuitFault {
    /// Rotations of a suit with a share of the fault; `since_s` after its begin.
    pub fn on(
        &self,
        seen: &mut [nalgebra::UnitQuaternion<f64>; SEGMENTS],
        body: &BodyState,
        share: f64,
        since_s: f64,
    ) {
        let turned = |radians: f64| nalgebra::UnitQuaternion::from_scaled_axis(Vector3::z() * radians);
        match *self {
            SuitFault::HeadingDrift(rad_per_s) => {
                for rotation in seen {
                    *rotation = turned(rad_per_s * since_s.max(0.0)) * *rotation;
                }
            }
            SuitFault::Heading(segment, radians) => {
                let rotation = &mut seen[segment.index()];
                *rotation = turned(radians * share) * *rotation;
            }
            SuitFault::Misalignment(segment, radians) => {
                let rotation = &mut seen[segment.index()];
                *rotation *= nalgebra::UnitQuaternion::from_scaled_axis(radians * share);
            }
            SuitFault::MagneticRegion(segment, radians, centre_m, reach_m) => {
                let i = segment.index();
                let away = (body.origin_m[i] - centre_m).norm() / reach_m;
                seen[i] = turned(radians * share * (-0.5 * away * away).exp()) * seen[i];
            }
            SuitFault::Slip(segment, rate) => {
                let i = segment.index();
                let slip = joint_rad(body)[i] * (rate * share);
                seen[i] *= nalgebra::UnitQuaternion::from_scaled_axis(slip);
            }
        }
    }
}
