//! What is really so, for comparing with what the pipeline says.
//!
//! The overload of a joint is the torque that holds the posture with the load less the torque without it, and in motion
//! the torque of the motion with the load less that of the same motion without it ([`in_motion`]). Both are summed
//! directly: every force beyond the joint times its arm. The sign is that of `τ = g(q) − Σ Jᵀ f`: a weight in
//! the hand asks for `(a − o) × m g ẑ` at every joint between the hand and the pelvis.

pub mod in_motion;

use equipoise_core::body::{JOINTS, Joint, SEGMENTS, Segment, Side};
use nalgebra::{Vector2, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::dynamics::{Wrench, ground_reaction};
use crate::kinematics::centre_m;
use crate::motion::{BodyState, DIFFERENCE_S, Worker};
use in_motion::Difference;

/// A force on a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Force {
    /// The segment it acts on.
    pub on: Segment,
    /// Where, world, m.
    pub at_m: Vector3<f64>,
    /// The force, world, N.
    pub force_n: Vector3<f64>,
}

/// Where the ground's force on each foot is thought to act. It matters to the joints of the legs only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FootContact {
    /// Under each foot: as far in front of the ankle as the centre of pressure is in front of the ankles' line.
    UnderEachFoot,
    /// Both feet's shares at the common centre of pressure, as Fortini et al. 2020 have it (Eq. 12–15).
    AtCentreOfPressure,
}

/// The truth at one time. World: X forward, Y left, Z up, the floor at 0.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The time, s.
    pub time_s: f64,
    /// Kinematics, without any sensor's error.
    pub body: BodyState,
    /// What the ground does to the person, with all inertia: force, moment about the world's origin.
    pub ground: Wrench,
    /// Centre of pressure of that wrench, m.
    pub cop_m: Vector2<f64>,
    /// What the ground would do to the person in the same motion without the box.
    pub ground_without_load: Wrench,
    /// Centre of pressure of that, m.
    pub cop_without_load_in_motion_m: Vector2<f64>,
    /// Centre of mass of the body alone, m.
    pub com_m: Vector3<f64>,
    /// Centre of pressure of the body alone if it stood still like this: the projection of its centre of mass, m.
    pub cop_without_load_m: Vector2<f64>,
    /// Centre of pressure of body and box if they stood still like this, m.
    pub cop_with_load_m: Vector2<f64>,
    /// Force of the box on the hands, N (its weight, pointing down), and where it acts, m.
    pub load_force_n: Vector3<f64>,
    /// Force of the box on the hands with its inertia, N; its opposite is what the ground does more.
    pub load_force_in_motion_n: Vector3<f64>,
    /// The box's centre, m.
    pub load_m: Vector3<f64>,
    /// Share of the left and the right foot without and with the load.
    pub foot_share: [[f64; 2]; 2],
    /// Static overload torque per joint, world axes, N m; the ground acts under each foot.
    pub overload_nm: [Vector3<f64>; JOINTS],
    /// The same with both feet's forces at the common centre of pressure; differs in the legs.
    pub overload_at_cop_nm: [Vector3<f64>; JOINTS],
    /// Overload torque with all inertia, world axes, N m: the torques of this motion with the box less those of the
    /// same motion without it; the ground acts at the common centre of pressure of each.
    pub overload_in_motion_nm: [Vector3<f64>; JOINTS],
    /// The same with the ground under each foot; differs in the legs.
    pub overload_in_motion_under_feet_nm: [Vector3<f64>; JOINTS],
}

impl Truth {
    /// What is so for a worker at a time.
    pub fn of(worker: &Worker, time_s: f64) -> Truth {
        let person = worker.person();
        let mut around = worker.around(time_s);
        let body = around[1].clone();
        let ground = ground_reaction(person, &around, DIFFERENCE_S);
        around[1].load_kg = 0.0;
        let ground_without_load = ground_reaction(person, &around, DIFFERENCE_S);
        let com_m = centre_m(&person.segment_mass_kg, &body.com_m);
        let body_n = person.mass_kg * GRAVITY_M_PER_S2;
        let load_n = body.load_kg * GRAVITY_M_PER_S2;
        let load_m = body.load_m();
        let with_load_m = (com_m.xy() * body_n + load_m.xy() * load_n) / (body_n + load_n);
        let down = -Vector3::z();
        let hand_share = body.hand_share();
        let hands: [Force; 2] = std::array::from_fn(|k| Force {
            on: Side::BOTH[k].hand(),
            at_m: body.grip_m[k],
            force_n: down * (hand_share[k] * load_n),
        });
        let overload = |contact| {
            let without = ground_forces(&body.origin_m, com_m.xy(), body_n, contact);
            let with = ground_forces(&body.origin_m, with_load_m, body_n + load_n, contact);
            overload_nm(&body.origin_m, &without, &[with, hands].concat())
        };
        let load_force_in_motion_n = ground_without_load.force_n - ground.force_n;
        let in_motion = Difference {
            origin_m: &body.origin_m,
            grip_m: body.grip_m,
            hand_share,
            load_force_n: load_force_in_motion_n,
            without: ground_without_load,
            with: ground,
        };
        Truth {
            time_s,
            ground,
            ground_without_load,
            cop_without_load_in_motion_m: ground_without_load.cop_m(),
            load_force_in_motion_n,
            overload_in_motion_nm: in_motion.overload_nm(FootContact::AtCentreOfPressure),
            overload_in_motion_under_feet_nm: in_motion.overload_nm(FootContact::UnderEachFoot),
            cop_m: ground.cop_m(),
            com_m,
            cop_without_load_m: com_m.xy(),
            cop_with_load_m: with_load_m,
            load_force_n: down * load_n,
            load_m,
            foot_share: [com_m.xy(), with_load_m].map(|cop| foot_share(&body.origin_m, cop)),
            overload_nm: overload(FootContact::UnderEachFoot),
            overload_at_cop_nm: overload(FootContact::AtCentreOfPressure),
            body,
        }
    }
}

/// Torque that `with` asks of each joint more than `without`, world axes, N m.
pub fn overload_nm(
    origin_m: &[Vector3<f64>; SEGMENTS],
    without: &[Force],
    with: &[Force],
) -> [Vector3<f64>; JOINTS] {
    let (before, after) = (holding_nm(origin_m, without), holding_nm(origin_m, with));
    std::array::from_fn(|j| after[j] - before[j])
}

/// Torque of each joint that holds the forces beyond it, world axes, N m.
fn holding_nm(origin_m: &[Vector3<f64>; SEGMENTS], forces: &[Force]) -> [Vector3<f64>; JOINTS] {
    Joint::ALL.map(|joint| {
        let beyond = forces.iter().filter(|force| force.on.is_distal_to(joint.segment()));
        let centre = origin_m[joint.segment().index()];
        -beyond.map(|force| (force.at_m - centre).cross(&force.force_n)).sum::<Vector3<f64>>()
    })
}

/// The ground's vertical forces on the left and the right foot for a centre of pressure.
pub fn ground_forces(
    origin_m: &[Vector3<f64>; SEGMENTS],
    cop_m: Vector2<f64>,
    vertical_n: f64,
    contact: FootContact,
) -> [Force; 2] {
    let ankle = ankles_m(origin_m);
    let mut forces = foot_forces(ankle, cop_m, vertical_n);
    if contact == FootContact::AtCentreOfPressure {
        forces = forces.map(|force| Force { at_m: cop_m.push(0.0), ..force });
    }
    forces
}

/// The ground's vertical forces on two feet that press at `press_m`, left and right: shared so that they act together at
/// the centre of pressure. What of it lies off the line between both moves both alike.
pub fn foot_forces(press_m: [Vector2<f64>; 2], cop_m: Vector2<f64>, vertical_n: f64) -> [Force; 2] {
    let share = share_between(press_m, cop_m);
    let off_the_line = cop_m - (press_m[0] * share[0] + press_m[1] * share[1]);
    std::array::from_fn(|k| Force {
        on: Side::BOTH[k].foot(),
        at_m: (press_m[k] + off_the_line).push(0.0),
        force_n: Vector3::z() * (share[k] * vertical_n),
    })
}

/// Where the ankles are on the floor: left, right, m.
pub fn ankles_m(origin_m: &[Vector3<f64>; SEGMENTS]) -> [Vector2<f64>; 2] {
    Side::BOTH.map(|side| origin_m[side.foot().index()].xy())
}

/// Share of the left and the right foot: where the centre of pressure is along the line between the ankles.
pub fn foot_share(origin_m: &[Vector3<f64>; SEGMENTS], cop_m: Vector2<f64>) -> [f64; 2] {
    share_between(ankles_m(origin_m), cop_m)
}

fn share_between([left, right]: [Vector2<f64>; 2], cop_m: Vector2<f64>) -> [f64; 2] {
    let line = left - right;
    let left_share = ((cop_m - right).dot(&line) / line.norm_squared()).clamp(0.0, 1.0);
    [left_share, 1.0 - left_share]
}
