//! Ground truth, for comparison with the estimates.
//!
//! The overload of a joint is the torque that holds the posture with the load minus the torque without it, and in
//! motion the torque of the motion with the load minus that of the same motion without it ([`in_motion`]). Both are
//! summed directly: every force beyond the joint times its arm. The sign is that of `τ = g(q) − Σ Jᵀ f`: a weight in
//! the hand requires `(a − o) × m g ẑ` at every joint between the hand and the pelvis.

pub mod back;
pub mod feet;
pub mod hold;
pub mod in_motion;

use equipoise_core::body::{JOINTS, Joint, SEGMENTS, Segment, Side};
use nalgebra::{Vector2, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::dynamics::{Wrench, ground_reaction};
use crate::kinematics::centre_m;
use crate::motion::{BodyState, DIFFERENCE_S, Worker};
use crate::person::Person;
use back::BackLoad;
use feet::{Load, NO_PRESS_M, foot_forces};
use in_motion::Difference;

/// A force on a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Force {
    /// The segment it acts on.
    pub on: Segment,
    /// Point of action, world, m.
    pub at_m: Vector3<f64>,
    /// The force, world, N.
    pub force_n: Vector3<f64>,
}

/// The truth at one time. World: X forward, Y left, Z up, the floor at 0.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The time, s.
    pub time_s: f64,
    /// Kinematics, without any sensor's error.
    pub body: BodyState,
    /// Ground reaction on the person, with all inertia: force, moment about the world's origin.
    pub ground: Wrench,
    /// Centre of pressure of that wrench, m.
    pub cop_m: Vector2<f64>,
    /// Ground reaction in the same motion without the box.
    pub ground_without_load: Wrench,
    /// Centre of pressure of that, m.
    pub cop_without_load_in_motion_m: Vector2<f64>,
    /// Centre of mass of the body alone, m.
    pub com_m: Vector3<f64>,
    /// Centre of pressure of the body alone if it were static in this pose: the projection of its centre of mass, m.
    pub cop_without_load_m: Vector2<f64>,
    /// Centre of pressure of body and box if they were static in this pose, m.
    pub cop_with_load_m: Vector2<f64>,
    /// Force of the box on the hands, N (its weight, pointing down).
    pub load_force_n: Vector3<f64>,
    /// Force of the box on the hands with its inertia, N; its opposite is the additional ground reaction.
    pub load_force_in_motion_n: Vector3<f64>,
    /// The box's centre, m.
    pub load_m: Vector3<f64>,
    /// Load fraction of the left and right foot without and with the load.
    pub foot_load_fraction: [[f64; 2]; 2],
    /// Force and moment of the pelvis on everything above L5/S1, the box included.
    pub back: BackLoad,
    /// Static overload torque per joint, world axes, N m; the ground acts under each foot.
    pub overload_nm: [Vector3<f64>; JOINTS],
    /// Overload torque with all inertia, world axes, N m: the torques of this motion with the box minus those of the
    /// same motion without it; the ground acts under each foot.
    pub overload_in_motion_nm: [Vector3<f64>; JOINTS],
}

impl Truth {
    /// Truth for a worker at a time.
    pub fn of(worker: &Worker, time_s: f64) -> Truth {
        let person = worker.person();
        let mut around = worker.around(time_s);
        let body = around[1].clone();
        let ground = ground_reaction(person, &around, DIFFERENCE_S);
        let back = BackLoad::of_states(person, &around, Vector3::zeros());
        around[1].load_kg = 0.0;
        let ground_without_load = ground_reaction(person, &around, DIFFERENCE_S);
        let com_m = centre_m(&person.segment_mass_kg, &body.com_m);
        let body_n = person.mass_kg * GRAVITY_M_PER_S2;
        let load_n = body.load_kg * GRAVITY_M_PER_S2;
        let load_m = body.load_m();
        let with_load_m = (com_m.xy() * body_n + load_m.xy() * load_n) / (body_n + load_n);
        let down = -Vector3::z();
        let (without, with) = (
            foot_forces(&body, NO_PRESS_M, com_m.xy(), body_n, Load::Removed),
            foot_forces(&body, NO_PRESS_M, with_load_m, body_n + load_n, Load::Carried),
        );
        let load_force_in_motion_n = ground_without_load.force_n - ground.force_n;
        let in_motion = Difference {
            body: &body,
            on_hands: &on_hands(&body, load_force_in_motion_n),
            without: ground_without_load,
            with: ground,
        };
        Truth {
            time_s,
            ground,
            ground_without_load,
            cop_without_load_in_motion_m: ground_without_load.cop_m(),
            load_force_in_motion_n,
            overload_in_motion_nm: in_motion.overload_nm(),
            cop_m: ground.cop_m(),
            com_m,
            cop_without_load_m: com_m.xy(),
            cop_with_load_m: with_load_m,
            load_force_n: down * load_n,
            load_m,
            foot_load_fraction: [(without, body_n), (with, body_n + load_n)]
                .map(|(feet, vertical_n)| feet.map(|foot| foot.force_n.z / vertical_n)),
            back,
            overload_nm: static_overload_nm(person, &body),
            body,
        }
    }
}

/// Static overload torque per joint of a body that holds its load, world axes, N m; the ground acts under each foot.
pub fn static_overload_nm(person: &Person, body: &BodyState) -> [Vector3<f64>; JOINTS] {
    let com_m = centre_m(&person.segment_mass_kg, &body.com_m);
    let [body_n, load_n] = [person.mass_kg, body.load_kg].map(|mass_kg| mass_kg * GRAVITY_M_PER_S2);
    let with_load_m = (com_m.xy() * body_n + body.load_m().xy() * load_n) / (body_n + load_n);
    let without = foot_forces(body, NO_PRESS_M, com_m.xy(), body_n, Load::Removed);
    let with = foot_forces(body, NO_PRESS_M, with_load_m, body_n + load_n, Load::Carried);
    let hands = on_hands(body, -Vector3::z() * load_n);
    overload_nm(&body.origin_m, &without, &[with.to_vec(), hands].concat())
}

/// Forces of a load on the hands: its weight (with its inertia), and its squeezing force.
fn on_hands(body: &BodyState, weight_n: Vector3<f64>) -> Vec<Force> {
    let (carried, hand_load_fraction) = (body.load_on_hand_m(), body.hand_load_fraction());
    (0..2)
        .flat_map(|k| {
            let squeeze_n = if k == 0 { body.squeeze_n } else { -body.squeeze_n };
            [(carried[k], weight_n * hand_load_fraction[k]), (body.grip_m[k], squeeze_n)]
                .map(|(at_m, force_n)| Force { on: Side::BOTH[k].hand(), at_m, force_n })
        })
        .collect()
}

/// Torque that `with` requires of each joint in addition to `without`, world axes, N m.
pub fn overload_nm(
    origin_m: &[Vector3<f64>; SEGMENTS],
    without: &[Force],
    with: &[Force],
) -> [Vector3<f64>; JOINTS] {
    let (before, after) = (holding_nm(origin_m, without), holding_nm(origin_m, with));
    std::array::from_fn(|j| after[j] - before[j])
}

/// Torque of each joint that balances the forces beyond it, world axes, N m.
fn holding_nm(origin_m: &[Vector3<f64>; SEGMENTS], forces: &[Force]) -> [Vector3<f64>; JOINTS] {
    Joint::ALL.map(|joint| {
        let beyond = forces.iter().filter(|force| force.on.is_distal_to(joint.segment()));
        let centre = origin_m[joint.segment().index()];
        -beyond.map(|force| (force.at_m - centre).cross(&force.force_n)).sum::<Vector3<f64>>()
    })
}
