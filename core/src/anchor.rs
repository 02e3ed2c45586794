//! Holds the standing feet to the floor, because the suit's own position estimate drifts.
//!
//! The station world is the suit world shifted by an offset. While a foot stands, the offset keeps the foot where it
//! came down; a foot in the air moves freely. So drift does not enter a stance, and each step starts a new stance whose
//! position is only as accurate as the measurement of the step ([`STANCE_SIGMA_M`]).
//!
//! If the distance between two standing feet changes, one of them was dragged, or neither moved and the suit's
//! orientations of the legs are wrong. The lower foot then holds the body, and the position is uncertain by the half of
//! the change that the other foot would give.

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use crate::body::Side;
use crate::frame::{Pose, StationWorld, SuitWorld, Turn};
use crate::math;

/// 1-σ of a stance's position on the floor, m.
pub const STANCE_SIGMA_M: f64 = 0.005;
/// A foot this much higher than the lower one is in the air, m.
pub const LIFTED_M: f64 = 0.04;
/// A foot this far from its standing position, relative to the other foot, has moved, m.
const MOVED_M: f64 = 0.03;

/// Positions of the standing feet.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Anchor {
    /// Position of each standing foot in the station world, m: left, right.
    standing_at_m: [[f64; 2]; 2],
    /// Shift from the suit world to the station world, m.
    station_from_suit_m: [f64; 2],
    /// 1 once a first pose was ingested.
    started: u64,
    /// Feet that stood in the previous pose: bit 0 left, bit 1 right.
    standing: u64,
    /// Increments with every foot that comes down.
    stance: u64,
    /// 1 after a gap in the data: the feet may stand anywhere.
    lost: u64,
    /// Half of the change of the feet's distance that ended the last stance, m; zero after a lifted foot.
    dragged_m: [f64; 2],
    /// 1-σ of the position of this stance relative to the previous one, m.
    stance_sigma_m: [f64; 2],
}

impl Anchor {
    /// The number of the stance: it changes whenever a foot has come down somewhere else.
    pub fn stance(&self) -> u64 {
        self.stance
    }

    /// 1-σ of the position of this stance relative to the previous one, per axis, m.
    pub fn stance_sigma_m(&self) -> [f64; 2] {
        self.stance_sigma_m
    }

    /// Whether both feet stand.
    pub fn both_feet_stand(&self) -> bool {
        self.standing == 0b11
    }

    /// Whether every number is finite; a stored anchor is checked before use.
    pub fn is_sound(&self) -> bool {
        let numbers = self.standing_at_m.iter().flatten().chain(&self.station_from_suit_m);
        numbers.chain(&self.dragged_m).chain(&self.stance_sigma_m).all(|value| value.is_finite())
            && self.standing <= 0b11
            && self.lost <= 1
            && self.stance < 1 << 48
    }

    /// Shift from the suit world to the station world, m.
    pub fn station_from_suit_m(&self) -> [f64; 2] {
        self.station_from_suit_m
    }

    /// Restores a stored shift; the next pose starts a new stance.
    pub fn resume(&mut self, station_from_suit_m: [f64; 2]) {
        *self = Anchor { station_from_suit_m, started: 1, standing: 0b11, lost: 1, ..Zeroable::zeroed() };
    }

    /// Marks the feet's positions as lost after a gap in the data: the next pose starts a new stance.
    pub fn mark_lost(&mut self) {
        self.lost = self.started;
    }

    /// Applies a new registration of the suit world in the station world: rotated about the station's origin, then
    /// moved, m. The suit's samples must be rotated alike from then on.
    pub fn move_world(&mut self, turn: Turn, by_m: [f64; 2]) {
        let moved = |place_m: [f64; 2]| {
            let [x, y] = turn.of(place_m);
            [x + by_m[0], y + by_m[1]]
        };
        self.standing_at_m = self.standing_at_m.map(moved);
        self.station_from_suit_m = moved(self.station_from_suit_m);
    }

    /// The pose in the station world, with the standing feet held.
    pub fn hold(&mut self, pose: &Pose<SuitWorld>) -> Pose<StationWorld> {
        self.transform(pose, true)
    }

    /// Likewise for a suit without drift, such as optical markers in the plate's world: counts steps, shifts nothing.
    pub fn track(&mut self, pose: &Pose<SuitWorld>) -> Pose<StationWorld> {
        self.transform(pose, false)
    }

    fn transform(&mut self, pose: &Pose<SuitWorld>, suit_drifts: bool) -> Pose<StationWorld> {
        let foot = Side::BOTH.map(|side| 0.5 * (pose.origin_of(side.foot()) + pose.origin_of(side.toe())));
        if self.started == 0 {
            *self = Anchor {
                standing_at_m: foot.map(|foot| [foot.x, foot.y]),
                started: 1,
                standing: 0b11,
                ..Zeroable::zeroed()
            };
        }
        if self.lost == 1 {
            let shift = self.station_from_suit_m;
            self.standing_at_m = foot.map(|foot| [foot.x + shift[0], foot.y + shift[1]]);
            self.begin_stance([0.0; 2]);
            self.lost = 0;
        }
        let (stands, dragged_m) = self.standing_feet(&foot);
        if let Some(shift) = self.holding_shift(&foot, stands).filter(|_| suit_drifts) {
            self.station_from_suit_m = shift;
        }
        for side in 0..2 {
            if !stands[side] {
                self.standing_at_m[side] =
                    [foot[side].x + self.station_from_suit_m[0], foot[side].y + self.station_from_suit_m[1]];
            }
        }
        let bits = u64::from(stands[0]) | u64::from(stands[1]) << 1;
        if bits & !self.standing != 0 {
            self.begin_stance(self.dragged_m);
        }
        if bits != 0b11 {
            self.dragged_m = dragged_m;
        }
        self.standing = bits;
        pose.shifted(Vector3::new(self.station_from_suit_m[0], self.station_from_suit_m[1], 0.0))
    }

    fn begin_stance(&mut self, dragged_m: [f64; 2]) {
        self.stance += 1;
        self.stance_sigma_m = dragged_m.map(|dragged_m| math::hypot([STANCE_SIGMA_M, dragged_m]));
    }

    /// A foot in the air, or dragged, does not stand; the lower one always does. Also returns half of the distance by
    /// which a foot was dragged, m.
    fn standing_feet(&self, foot: &[Vector3<f64>; 2]) -> ([bool; 2], [f64; 2]) {
        let lower = if foot[0].z <= foot[1].z { 0 } else { 1 };
        let upper = 1 - lower;
        let lifted = foot[upper].z - foot[lower].z > LIFTED_M;
        // Relative to the standing foot, so that drift common to both cancels.
        let apart = [foot[upper].x - foot[lower].x, foot[upper].y - foot[lower].y];
        let was = [
            self.standing_at_m[upper][0] - self.standing_at_m[lower][0],
            self.standing_at_m[upper][1] - self.standing_at_m[lower][1],
        ];
        let moved = [apart[0] - was[0], apart[1] - was[1]];
        let dragged = moved[0] * moved[0] + moved[1] * moved[1] > MOVED_M * MOVED_M;
        let mut stands = [true; 2];
        stands[upper] = !(lifted || dragged);
        (stands, if lifted || !dragged { [0.0; 2] } else { moved.map(|moved_m| 0.5 * moved_m) })
    }

    fn holding_shift(&self, foot: &[Vector3<f64>; 2], stands: [bool; 2]) -> Option<[f64; 2]> {
        let (mut sum, mut feet) = ([0.0; 2], 0.0);
        for side in (0..2).filter(|&side| stands[side]) {
            sum[0] += self.standing_at_m[side][0] - foot[side].x;
            sum[1] += self.standing_at_m[side][1] - foot[side].y;
            feet += 1.0;
        }
        (feet > 0.0).then(|| sum.map(|sum| sum / feet))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{SEGMENTS, Segment, Skeleton};
    use nalgebra::UnitQuaternion;

    fn standing(pelvis: Vector3<f64>) -> Pose<SuitWorld> {
        let t_pose = Skeleton::nominal(1.77).t_pose_m();
        Pose::new(t_pose.map(|origin| pelvis + Vector3::from(origin)), [UnitQuaternion::identity(); SEGMENTS])
    }

    fn lift(pose: &mut Pose<SuitWorld>, side: Side, by: Vector3<f64>) {
        for segment in [side.foot(), side.toe()] {
            pose.origin[segment.index()] += by;
        }
    }

    #[test]
    fn drift_does_not_move_a_standing_worker() {
        let mut anchor: Anchor = Zeroable::zeroed();
        let start = anchor.hold(&standing(Vector3::new(0.0, 0.0, 0.96)));
        for step in 1..500 {
            let drift = Vector3::new(0.0002 * f64::from(step), -0.0001 * f64::from(step), 0.96);
            let pose = anchor.hold(&standing(drift));
            assert!((pose.origin_of(Segment::Head) - start.origin_of(Segment::Head)).norm() < 1e-12);
        }
        assert_eq!(anchor.stance(), 0);
    }

    #[test]
    fn a_suit_without_drift_is_tracked_to_any_position() {
        let mut anchor: Anchor = Zeroable::zeroed();
        anchor.track(&standing(Vector3::new(0.0, 0.0, 0.96)));
        let moved = anchor.track(&standing(Vector3::new(0.2, -0.1, 0.96)));
        assert!((moved.origin_of(Segment::Pelvis) - Vector3::new(0.2, -0.1, 0.96)).norm() < 1e-12);
        assert!(anchor.both_feet_stand());
    }

    #[test]
    fn a_lean_is_not_drift() {
        let mut anchor: Anchor = Zeroable::zeroed();
        anchor.hold(&standing(Vector3::new(0.0, 0.0, 0.96)));
        let mut pose = standing(Vector3::new(0.0, 0.0, 0.96));
        pose.origin[Segment::Pelvis.index()].x += 0.1;
        let held = anchor.hold(&pose);
        assert!((held.origin_of(Segment::Pelvis).x - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_step_begins_a_stance_at_the_landing_point_of_the_foot() {
        let mut anchor: Anchor = Zeroable::zeroed();
        let pelvis = Vector3::new(0.0, 0.0, 0.96);
        let before = anchor.hold(&standing(pelvis));
        for (forward, up) in [(0.02, 0.02), (0.1, 0.08), (0.2, 0.08), (0.3, 0.05), (0.3, 0.0)] {
            let mut pose = standing(pelvis);
            lift(&mut pose, Side::Left, Vector3::new(forward, 0.0, up));
            anchor.hold(&pose);
        }
        let mut pose = standing(pelvis);
        lift(&mut pose, Side::Left, Vector3::new(0.3, 0.0, 0.0));
        let after = anchor.hold(&pose);
        assert_eq!(anchor.stance(), 1);
        let stepped = after.origin_of(Segment::LeftFoot) - before.origin_of(Segment::LeftFoot);
        assert!((stepped - Vector3::new(0.3, 0.0, 0.0)).norm() < 1e-3, "{stepped}");
        assert!((after.origin_of(Segment::RightFoot) - before.origin_of(Segment::RightFoot)).norm() < 1e-3);
        assert_eq!(anchor.stance_sigma_m(), [STANCE_SIGMA_M; 2]);
    }

    #[test]
    fn feet_that_move_apart_on_the_floor_leave_the_position_uncertain_by_half_of_it() {
        let mut anchor: Anchor = Zeroable::zeroed();
        let pelvis = Vector3::new(0.0, 0.0, 0.96);
        let before = anchor.hold(&standing(pelvis));
        let mut held = anchor.hold(&standing(pelvis));
        for step in 1..=32 {
            let mut pose = standing(pelvis);
            // The left foot is also the higher one.
            lift(&mut pose, Side::Left, Vector3::new(0.0, 0.001 * f64::from(step), 0.001));
            held = anchor.hold(&pose);
        }
        assert_eq!(anchor.stance(), 1);
        let [x, y] = anchor.stance_sigma_m();
        let off_m = (held.origin_of(Segment::Pelvis) - before.origin_of(Segment::Pelvis)).norm();
        assert!((x - STANCE_SIGMA_M).abs() < 1e-3 && (0.015..0.017).contains(&y), "{x} {y}");
        assert!(off_m < 0.002, "the lower foot holds the body: {off_m}");
    }
}
