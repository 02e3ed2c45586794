//! Outline of each foot relative to its segment: contact area with the ground, and position of an insole.

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use crate::body::Side;
use crate::body::anthropometry::ANKLE_HEIGHT;
use crate::frame::Pose;
use crate::math;
use crate::message::SuitBody;
use crate::message::suit_body::FootPoint;

/// Half the width of a foot, heel behind the ankle and toe tip in front of the ball, over stature.
const HALF_WIDTH: f64 = 0.028;
const HEEL_BACK: f64 = 0.04;
const TIP_FORWARD: f64 = 0.05;
/// Ankle to ball for a skeleton in which they coincide, over stature.
const BALL_FORWARD: f64 = 0.10;
/// Minimum length and width of a plausible outline, m.
const LENGTH_MIN_M: f64 = 0.12;
const WIDTH_MIN_M: f64 = 0.03;
/// A ball nearer to the ankle is no separate joint, m.
const BALL_MIN_M: f64 = 0.01;

/// The outline of a sole in the axes of its foot segment (X forward, Y left, Z up, from the ankle), m.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct FootOutline {
    /// The heel's back and the toes' tip.
    pub along_m: [f64; 2],
    /// The right and the left border.
    pub across_m: [f64; 2],
    /// Height of the sole; negative, because the ankle is above it.
    pub sole_z_m: f64,
}

/// Both outlines, left first: the suit's points if available, else fractions of the stature.
pub fn both<W>(pose: &Pose<W>, body: Option<&SuitBody>, height_m: f64) -> [FootOutline; 2] {
    Side::BOTH.map(|side| {
        let nominal = FootOutline::by_stature(pose, side, height_m);
        body.map_or(nominal, |body| nominal.with(body, side))
    })
}

impl FootOutline {
    /// Fractions of the stature, with the ball at the position of the pose.
    pub fn by_stature<W>(pose: &Pose<W>, side: Side, height_m: f64) -> FootOutline {
        let ball_m = pose.offset_in(side.foot(), side.toe()).x.max(BALL_FORWARD * height_m);
        FootOutline {
            along_m: [-HEEL_BACK * height_m, ball_m + TIP_FORWARD * height_m],
            across_m: [-HALF_WIDTH * height_m, HALF_WIDTH * height_m],
            sole_z_m: -ANKLE_HEIGHT * height_m,
        }
    }

    /// Overrides the outline with the suit's foot points; missing or implausible ones change nothing.
    #[must_use]
    pub fn with(mut self, body: &SuitBody, side: Side) -> FootOutline {
        let point = |point: FootPoint| body.foot_point_m(side, point);
        let before = self;
        let (heel, tip) = (point(FootPoint::Heel), point(FootPoint::ToeTip));
        let balls = (point(FootPoint::FirstMetatarsal), point(FootPoint::FifthMetatarsal));
        if let Some(heel) = heel {
            self.along_m[0] = heel.x;
        }
        if let Some(tip) = tip {
            self.along_m[1] = tip.x;
        }
        if let (Some(first), Some(fifth)) = balls {
            self.across_m = [first.y.min(fifth.y), first.y.max(fifth.y)];
        }
        // The ball rests on the ground even if the suit's heel point is on the back of the heel.
        let lowest = [heel, tip, balls.0, balls.1].into_iter().flatten().map(|point| point.z);
        self.sole_z_m = lowest.fold(f64::INFINITY, f64::min);
        if !self.sole_z_m.is_finite() || self.sole_z_m >= 0.0 {
            self.sole_z_m = before.sole_z_m;
        }
        if self.is_plausible() { self } else { before }
    }

    fn is_plausible(&self) -> bool {
        self.along_m[1] - self.along_m[0] > LENGTH_MIN_M && self.across_m[1] - self.across_m[0] > WIDTH_MIN_M
    }

    /// The middle of the sole: origin of the sole's own frame, m.
    pub fn middle_m(&self) -> [f64; 2] {
        [0.5 * (self.along_m[0] + self.along_m[1]), 0.5 * (self.across_m[0] + self.across_m[1])]
    }

    /// The four corners on the floor, world x and y, of a foot that stands flat, m.
    pub fn corners_m<W>(&self, pose: &Pose<W>, side: Side) -> [[f64; 2]; 4] {
        let ankle = pose.origin_of(side.foot());
        let ahead = pose.world_from_segment[side.foot().index()] * Vector3::x();
        let norm = math::hypot([ahead.x, ahead.y]).max(1e-9);
        let (x, y) = (ahead.x / norm, ahead.y / norm);
        let at =
            |forward: f64, left: f64| [ankle.x + forward * x - left * y, ankle.y + forward * y + left * x];
        let ([back, front], [right, left]) = (self.along_m, self.across_m);
        [at(back, left), at(back, right), at(front, left), at(front, right)]
    }

    /// Position on the floor of a point of the sole's own frame, world x and y, m.
    ///
    /// In front of the ball the point belongs to the toes, which stay flat when the heel rises.
    pub fn on_the_floor_m<W>(&self, pose: &Pose<W>, side: Side, [forward, left]: [f64; 2]) -> [f64; 2] {
        let [middle_x, middle_y] = self.middle_m();
        let on_foot = Vector3::new(middle_x + forward, middle_y + left, self.sole_z_m);
        let ball = pose.offset_in(side.foot(), side.toe());
        let point = if ball.x > BALL_MIN_M && on_foot.x > ball.x {
            pose.point_on(side.toe(), (on_foot - ball).into())
        } else {
            pose.point_on(side.foot(), on_foot.into())
        };
        [point.x, point.y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{SEGMENTS, Segment, Skeleton};
    use crate::frame::StationWorld;
    use nalgebra::UnitQuaternion;

    fn standing(turn_rad: f64, at: Vector3<f64>) -> Pose<StationWorld> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad);
        let origin = Skeleton::nominal(1.77).t_pose_m().map(|origin| at + turn * Vector3::from(origin));
        Pose::new(origin, [turn; SEGMENTS])
    }

    fn measured_body() -> SuitBody {
        let mut body: SuitBody = Zeroable::zeroed();
        body.foot_points = [0b1111; 2];
        for (foot, out) in [(0, 1.0), (1, -1.0)] {
            body.foot_point_m[foot] = [
                [-0.06, 0.0, -0.09],
                [0.17, -0.04 * out, -0.1],
                [0.14, 0.055 * out, -0.1],
                [0.24, 0.0, -0.1],
            ];
        }
        body
    }

    #[test]
    fn the_suit_s_points_are_the_outline_and_the_big_toe_is_on_the_inside() {
        let pose = standing(0.0, Vector3::zeros());
        let [left, right] =
            Side::BOTH.map(|side| FootOutline::by_stature(&pose, side, 1.77).with(&measured_body(), side));
        assert_eq!((left.along_m, left.sole_z_m), ([-0.06, 0.24], -0.1));
        assert_eq!((left.across_m, right.across_m), ([-0.04, 0.055], [-0.055, 0.04]));
        assert!((left.middle_m()[0] - 0.09).abs() < 1e-12 && (left.middle_m()[1] - 0.0075).abs() < 1e-12);
    }

    #[test]
    fn implausible_foot_points_are_ignored() {
        let pose = standing(0.0, Vector3::zeros());
        let nominal = FootOutline::by_stature(&pose, Side::Left, 1.77);
        let mut backwards = measured_body();
        backwards.foot_point_m[0][3][0] = -0.3;
        assert_eq!(nominal.with(&backwards, Side::Left), nominal);
        let mut only_heel = measured_body();
        only_heel.foot_points = [FootPoint::Heel as u32; 2];
        let with = nominal.with(&only_heel, Side::Left);
        assert_eq!((with.along_m, with.across_m), ([-0.06, nominal.along_m[1]], nominal.across_m));
    }

    #[test]
    fn a_point_of_the_sole_goes_where_the_foot_goes_and_turns_with_it() {
        let shape = FootOutline::by_stature(&standing(0.0, Vector3::zeros()), Side::Left, 1.77);
        let here = shape.on_the_floor_m(&standing(0.0, Vector3::zeros()), Side::Left, [0.05, -0.02]);
        for (turn, x, y) in [(0.0, 1.0, -2.0), (2.1, 0.3, 0.7), (-1.0, 0.0, 0.0)] {
            let there =
                shape.on_the_floor_m(&standing(turn, Vector3::new(x, y, 0.0)), Side::Left, [0.05, -0.02]);
            let (sine, cosine) = math::sin_cos(turn);
            let expected = [cosine * here[0] - sine * here[1] + x, sine * here[0] + cosine * here[1] + y];
            for axis in 0..2 {
                assert!((there[axis] - expected[axis]).abs() < 1e-12, "{there:?} {expected:?}");
            }
        }
    }

    #[test]
    fn on_the_toes_the_centre_under_them_stays_where_they_are() {
        let mut pose = standing(0.0, Vector3::zeros());
        let shape = FootOutline::by_stature(&pose, Side::Left, 1.77);
        let front = [0.11, 0.0];
        let flat = shape.on_the_floor_m(&pose, Side::Left, front);
        // The heel rises about the ball; the toes stay on the floor.
        let (foot, toe) = (Segment::LeftFoot.index(), Segment::LeftToe.index());
        let rise = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.6);
        pose.origin[foot] = pose.origin[toe] + rise * (pose.origin[foot] - pose.origin[toe]);
        pose.world_from_segment[foot] = rise;
        let risen = shape.on_the_floor_m(&pose, Side::Left, front);
        assert!(
            (flat[0] - risen[0]).abs() < 1e-12 && (flat[1] - risen[1]).abs() < 1e-12,
            "{flat:?} {risen:?}"
        );
    }
}
