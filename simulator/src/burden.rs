//! Deviations of the simulated physics from the unmodified body and the box: worn masses, external forces on the body,
//! changed body parameters, a degree of freedom that the suit does not measure. Each may be limited in time.

use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::Vector3;

use crate::GRAVITY_M_PER_S2;
use crate::colour::joint_rad;
use crate::dynamics::Wrench;
use crate::motion::BodyState;
use crate::random::Coloured;
use crate::schedule::minimum_jerk;

/// Duration of an onset or end, s.
const RAMP_S: f64 = 0.8;

/// Time span in which an effect acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Start, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Time at which its sign flips, s.
    pub flips_at_s: Option<f64>,
}

impl Span {
    /// Unlimited in time.
    pub const ALWAYS: Span = Span { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY, flips_at_s: None };

    /// Activation at a time, in [−1, 1]; onset, flip and end are short ramps.
    pub fn activation(&self, time_s: f64) -> f64 {
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
    /// Position on it, m.
    pub at_m: Vector3<f64>,
}

impl Point {
    /// Its position in the world, m.
    pub fn in_world_m(&self, body: &BodyState) -> Vector3<f64> {
        let i = self.segment.index();
        body.origin_m[i] + body.world_from_segment[i] * self.at_m
    }
}

/// An external mass or force on the body.
#[derive(Debug, Clone)]
pub enum Burden {
    /// A point mass, kg.
    Mass(Point, f64),
    /// A force of the surroundings on the body, N, and its relative variation.
    Push(Point, Vector3<f64>, Coloured),
    /// An elastic band to a fixed point (m): N/m beyond its rest length (m).
    Band(Point, Vector3<f64>, f64, f64),
}

impl Burden {
    /// Additional ground reaction caused by it, about the world's origin, from three states `step_s` apart.
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

/// Difference between the body and the one that the suit measures.
#[derive(Debug, Clone)]
pub enum BodyChange {
    /// A displaced centre of mass of a segment, segment axes, m.
    Centre(Segment, Vector3<f64>),
    /// A segment's centre of mass oscillates along an axis (m) at a frequency (Hz): respiration.
    Breath(Segment, Vector3<f64>, f64),
    /// Scapular translation: as an arm is raised, its shoulder joint and the arm are displaced by this at 90° (trunk
    /// axes, m; sideways is outwards).
    ShoulderBlades(Vector3<f64>),
    /// Spine curvature that the suit's model lacks: everything above L3 is displaced by this (pelvis axes, m) for each
    /// radian between pelvis and trunk.
    SpineShape(Vector3<f64>),
}

impl BodyChange {
    /// Applies a fraction of the change to the body.
    pub fn on(&self, body: &mut BodyState, activation: f64) {
        match *self {
            BodyChange::Centre(segment, by_m) => {
                let i = segment.index();
                body.com_m[i] += body.world_from_segment[i] * by_m * activation;
            }
            BodyChange::Breath(segment, by_m, hertz) => {
                let i = segment.index();
                let phase = (core::f64::consts::TAU * hertz * body.time_s).sin();
                body.com_m[i] += body.world_from_segment[i] * by_m * (activation * phase);
            }
            BodyChange::ShoulderBlades(by_m) => {
                for (upper, side) in [(Segment::LeftUpperArm, 1.0), (Segment::RightUpperArm, -1.0)] {
                    let trunk = body.world_from_segment[Segment::T8.index()];
                    // A hanging arm points down the trunk; in the T-pose its length is the Y axis.
                    let along = body.world_from_segment[upper.index()] * Vector3::new(0.0, side, 0.0);
                    let raised = 1.0 + (trunk.inverse() * along).z;
                    let by_m = trunk * Vector3::new(by_m.x, side * by_m.y, by_m.z) * (activation * raised);
                    shift(body, upper.index()..upper.index() + 3, by_m);
                }
            }
            BodyChange::SpineShape(by_m) => {
                let bend_rad: Vector3<f64> = {
                    let [pelvis, trunk] =
                        [Segment::Pelvis, Segment::T8].map(|s| body.world_from_segment[s.index()]);
                    (pelvis.inverse() * trunk).scaled_axis()
                };
                let by_m = body.world_from_segment[0] * by_m * (activation * bend_rad.y);
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

/// Errors of the suit's orientations in addition to its ordinary noise.
#[derive(Debug, Clone)]
pub enum SuitFault {
    /// The whole suit rotates to the left, rad/s since the start of the span.
    HeadingDrift(f64),
    /// One segment is rotated to the left, rad.
    Heading(Segment, f64),
    /// Misalignment of one segment's sensor, rotation vector in segment axes, rad.
    Misalignment(Segment, Vector3<f64>),
    /// One segment is rotated to the left by up to an angle (rad) near a point of the room (m), with this reach (m).
    MagneticRegion(Segment, f64, Vector3<f64>, f64),
    /// One segment's sensor rotates by a fraction of the joint angle.
    Slip(Segment, f64),
}

impl SuitFault {
    /// Rotations of a suit with a fraction of the fault; `since_s` after its start.
    pub fn on(
        &self,
        seen: &mut [nalgebra::UnitQuaternion<f64>; SEGMENTS],
        body: &BodyState,
        activation: f64,
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
                *rotation = turned(radians * activation) * *rotation;
            }
            SuitFault::Misalignment(segment, radians) => {
                let rotation = &mut seen[segment.index()];
                *rotation *= nalgebra::UnitQuaternion::from_scaled_axis(radians * activation);
            }
            SuitFault::MagneticRegion(segment, radians, centre_m, reach_m) => {
                let i = segment.index();
                let away = (body.origin_m[i] - centre_m).norm() / reach_m;
                seen[i] = turned(radians * activation * (-0.5 * away * away).exp()) * seen[i];
            }
            SuitFault::Slip(segment, rate) => {
                let i = segment.index();
                let slip = joint_rad(body)[i] * (rate * activation);
                seen[i] *= nalgebra::UnitQuaternion::from_scaled_axis(slip);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intention::{Arm, Intention};
    use crate::motion::{DIFFERENCE_S, Habits, Worker};
    use crate::noise::{Suit, SuitNoise};
    use crate::person::Person;
    use crate::scene::{Hidden, Scene};
    use nalgebra::UnitQuaternion;

    const HALF: Span = Span { from_s: 10.0, to_s: f64::INFINITY, flips_at_s: None };

    /// Stands still, raises both arms at 2 s; the hidden deviation acts from 10 s on.
    fn scene(hidden: Hidden) -> Scene {
        let mut worker = Worker::with_habits(Person::new(6, 1.77, 72.0), 6, Habits::NONE);
        let level = Arm { elevation_deg: 90.0, forward_deg: 90.0, outward_deg: 0.0, elbow_deg: 20.0 };
        worker.intend(&Intention { trunk_flex_deg: 30.0, ..Intention::STAND.arms(level) }, 2.0, 1.5);
        Scene { worker, suit: Suit::new(SuitNoise::NONE, 6), hidden }
    }

    /// Additional ground reaction once the deviation acts.
    fn more(hidden: Hidden) -> Wrench {
        let scene = scene(hidden);
        let (before, after) = (scene.ground_reaction(9.0), scene.ground_reaction(14.0));
        Wrench { force_n: after.force_n - before.force_n, moment_nm: after.moment_nm - before.moment_nm }
    }

    fn hand(scene: &Scene) -> (Point, Vector3<f64>) {
        let point = Point { segment: Segment::RightHand, at_m: Vector3::new(0.0, -0.08, 0.0) };
        (point, point.in_world_m(&scene.body(14.0)))
    }

    #[test]
    fn a_mass_presses_with_its_weight_where_it_is_and_a_push_with_its_opposite() {
        let (point, at_m) = hand(&scene(Hidden::default()));
        let weight = Wrench::at(at_m, Vector3::z() * (2.0 * GRAVITY_M_PER_S2));
        let mass = Hidden { burdens: vec![(Burden::Mass(point, 2.0), HALF)], ..Hidden::default() };
        let steady = Coloured::new(&mut crate::random::Random::new(1, "steady"), 0.0, 1.0, 20.0);
        let force_n = Vector3::new(0.0, 0.0, -2.0 * GRAVITY_M_PER_S2);
        let push =
            Hidden { burdens: vec![(Burden::Push(point, force_n, steady), HALF)], ..Hidden::default() };
        for found in [more(mass), more(push)] {
            assert!((found.force_n - weight.force_n).norm() < 1e-3, "{found:?}");
            assert!((found.moment_nm - weight.moment_nm).norm() < 1e-3, "{found:?}");
        }
    }

    #[test]
    fn a_mass_that_is_swung_is_carried_with_its_inertia() {
        let (point, _) = hand(&scene(Hidden::default()));
        let scene =
            scene(Hidden { burdens: vec![(Burden::Mass(point, 2.0), Span::ALWAYS)], ..Hidden::default() });
        let without = Scene { hidden: Hidden::default(), ..scene.clone() };
        let time_s = 2.6;
        let h = 4.0 * DIFFERENCE_S;
        let at = |time_s: f64| point.in_world_m(&scene.body(time_s));
        let acceleration = (at(time_s + h) - at(time_s) * 2.0 + at(time_s - h)) / (h * h);
        let found = scene.ground_reaction(time_s).force_n - without.ground_reaction(time_s).force_n;
        let expected = (acceleration + Vector3::z() * GRAVITY_M_PER_S2) * 2.0;
        assert!(acceleration.norm() > 1.0 && (found - expected).norm() < 0.01, "{found:?} {expected:?}");
    }

    #[test]
    fn a_band_pulls_towards_its_anchor() {
        let point = Point { segment: Segment::T8, at_m: Vector3::zeros() };
        let anchor_m = Vector3::new(-3.0, 0.0, 1.3);
        let band =
            Hidden { burdens: vec![(Burden::Band(point, anchor_m, 20.0, 1.0), HALF)], ..Hidden::default() };
        let found = more(band);
        // It pulls the body backwards, so the ground reaction must push forwards.
        assert!(found.force_n.x > 20.0 && found.moment_nm.y > 20.0, "{found:?}");
    }

    #[test]
    fn what_a_suit_does_not_know_of_changes_the_ground_and_not_what_it_sees() {
        let by_m = Vector3::new(0.03, 0.0, 0.0);
        let breath = BodyChange::Breath(Segment::T8, by_m, 0.25);
        for change in [
            BodyChange::Centre(Segment::T8, by_m),
            BodyChange::ShoulderBlades(by_m),
            BodyChange::SpineShape(by_m),
            breath,
        ] {
            let name = format!("{change:?}");
            let hidden = scene(Hidden { changes: vec![(change, HALF)], ..Hidden::default() });
            let clean = scene(Hidden::default());
            let time_s = 13.0;
            let moved = hidden.ground_reaction(time_s).cop_m() - clean.ground_reaction(time_s).cop_m();
            assert!((0.000_5..0.02).contains(&moved.x.abs()), "{name}: {moved:?}");
            let [(seen, turned), (without, straight)] = [&hidden, &clean].map(|scene| scene.seen(time_s));
            assert!(seen.iter().zip(&without).all(|(a, b)| (a - b).norm() < 1e-9), "{name}");
            assert!(turned.iter().zip(&straight).all(|(a, b)| a.angle_to(b) < 1e-9), "{name}");
        }
    }

    #[test]
    fn a_late_suit_shows_what_was_and_a_turning_one_turns_to_the_left() {
        let late = scene(Hidden { suit_lag_s: vec![(0.05, Span::ALWAYS)], ..Hidden::default() });
        let clean = scene(Hidden::default());
        let hand = Segment::LeftHand.index();
        assert!((late.seen(2.6).0[hand] - clean.seen(2.55).0[hand]).norm() < 1e-12);
        let drift = Hidden { suit: vec![(SuitFault::HeadingDrift(0.01), HALF)], ..Hidden::default() };
        let turned = scene(drift).seen(20.0).1[hand];
        let expected = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.1) * clean.seen(20.0).1[hand];
        assert!(turned.angle_to(&expected) < 1e-9);
    }

    #[test]
    fn a_span_comes_turns_over_and_goes() {
        let span = Span { from_s: 10.0, to_s: 30.0, flips_at_s: Some(20.0) };
        for (time_s, activation) in [(9.9, 0.0), (15.0, 1.0), (25.0, -1.0), (30.1, 0.0)] {
            assert!((span.activation(time_s) - activation).abs() < 1e-12, "{time_s}");
        }
        assert!((Span::ALWAYS.activation(0.0) - 1.0).abs() < 1e-12);
    }
}
