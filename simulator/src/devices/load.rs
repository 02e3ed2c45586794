//! Load on a device: the same simulated human as measured by plates of any axes and sign, or by insoles.

use equipoise_core::body::Side;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::dynamics::Wrench;
use crate::motion::{BodyState, Worker};
use crate::person::Person;
use crate::plate::Plate;
use crate::two_plates::ground_reaction_per_foot;

/// Inputs of a device at one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadSample {
    /// Simulated time, s.
    pub time_s: f64,
    /// The device's number of the sample.
    pub number: u32,
    /// The device's own time of it, s.
    pub device_s: f64,
    /// Wrench on each plate's sensor, in its axes, about its origin.
    pub plates: Vec<Wrench>,
    /// Load of the left and right sole.
    pub soles: [InsoleLoad; 2],
}

/// Load of one sole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InsoleLoad {
    /// Force along the sole's normal, N.
    pub normal_n: f64,
    /// Point of action from the middle of the sole: X to the tip, Y to the left, m.
    pub cop_m: Vector2<f64>,
    /// Length and width of the sole, m.
    pub size_m: [f64; 2],
}

/// Mounting of a plate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mounting {
    /// Pose of the plate.
    pub plate: Plate,
    /// Its z axis points down and its y axis to the other side, as with Kistler and AMTI.
    pub z_down: bool,
    /// Reports the force on the person instead of the force on the sensor.
    pub reaction: bool,
}

impl Mounting {
    /// Output of the sensor for a wrench `on_person` of the ground on the person, about the origin on the floor.
    pub fn measures(&self, on_person: &Wrench) -> Wrench {
        let wrench = self.plate.sensor_wrench(&self.plate.in_the_station(on_person));
        let sign = if self.reaction { -1.0 } else { 1.0 };
        let half_a_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), core::f64::consts::PI);
        let turn = if self.z_down { half_a_turn } else { UnitQuaternion::identity() };
        Wrench { force_n: turn * wrench.force_n * sign, moment_nm: turn * wrench.moment_nm * sign }
    }

    /// The matching section of a configuration for a device of this kind, with the keys of its connection
    /// ([`Port::config`](super::port::Port::config)).
    pub fn config(&self, source: &str, [keys, sections]: [String; 2]) -> String {
        let Plate { origin_m, yaw_rad, surface_height_m, .. } = self.plate;
        format!(
            "[ground]\nsource = \"{source}\"\n{keys}measures = \"{}\"\n\n[ground.frame]\naxes = \"{}\"\n\
             origin_m = {origin_m:?}\nyaw_deg = {:?}\nsurface_height_m = {surface_height_m:?}\n\n{sections}",
            if self.reaction { "reaction" } else { "action" },
            if self.z_down { "z-down" } else { "z-up" },
            yaw_rad.to_degrees(),
        )
    }
}

/// Devices under a person.
#[derive(Debug, Clone, PartialEq)]
pub enum Ground {
    /// One plate under both feet.
    One(Mounting),
    /// A plate under each foot: left, right.
    Two([Mounting; 2]),
}

/// Part of the ground reaction on each foot, and the resulting load of the soles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnFeet {
    /// On the person, about the origin of the floor: left, right.
    pub wrench: [Wrench; 2],
    /// On the soles: left, right.
    pub soles: [InsoleLoad; 2],
}

impl OnFeet {
    /// Load of a worker's feet at a time, with the pressure point of each foot `press_m` from its ankle.
    pub fn of(worker: &Worker, time_s: f64, press_m: [Vector2<f64>; 2]) -> OnFeet {
        let wrench = ground_reaction_per_foot(worker, time_s, press_m);
        let body = worker.sample(time_s);
        let soles = core::array::from_fn(|k| insole_load(worker.person(), &body, Side::BOTH[k], &wrench[k]));
        OnFeet { wrench, soles }
    }

    /// The sum, on the person, about the origin of the floor.
    pub fn whole(&self) -> Wrench {
        let [left, right] = self.wrench;
        Wrench { force_n: left.force_n + right.force_n, moment_nm: left.moment_nm + right.moment_nm }
    }

    /// Wrenches on the plates under these feet.
    pub fn on(&self, ground: &Ground) -> Vec<Wrench> {
        match ground {
            Ground::One(plate) => vec![plate.measures(&self.whole())],
            Ground::Two(plates) => {
                plates.iter().zip(&self.wrench).map(|(plate, foot)| plate.measures(foot)).collect()
            }
        }
    }
}

/// Load of a sole by a wrench on its foot: force along the sole's normal, and its point of action.
fn insole_load(person: &Person, body: &BodyState, side: Side, on_foot: &Wrench) -> InsoleLoad {
    let (index, extent) = (side.foot().index(), person.foot_outline_m);
    let world_from_foot = body.world_from_segment[index];
    let middle = Vector3::new(0.5 * (extent.forward - extent.back), 0.0, -person.ankle_height_m);
    let middle = body.origin_m[index] + world_from_foot * middle;
    let force_n = world_from_foot.inverse() * on_foot.force_n;
    let moment_nm = world_from_foot.inverse() * (on_foot.moment_nm - middle.cross(&on_foot.force_n));
    let size_m = [extent.back + extent.forward, 2.0 * extent.half_width];
    if force_n.z < 1.0 {
        return InsoleLoad { size_m, ..InsoleLoad::default() };
    }
    let cop_m = Vector2::new(-moment_nm.y, moment_nm.x) / force_n.z;
    InsoleLoad { normal_n: force_n.z, cop_m, size_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Habits;

    fn standing() -> (Worker, OnFeet) {
        let worker = Worker::with_habits(Person::nominal(1.77, 72.0), 1, Habits::ORDINARY);
        let press_m = [Vector2::new(0.05, 0.01), Vector2::new(0.03, -0.005)];
        let feet = OnFeet::of(&worker, 3.0, press_m);
        (worker, feet)
    }

    #[test]
    fn two_plates_feel_together_what_one_would() {
        let (worker, feet) = standing();
        assert!((feet.whole().force_n - worker.ground_reaction(3.0).force_n).norm() < 1e-9);
        let at = |y: f64| Mounting {
            plate: Plate {
                origin_m: [0.1, y, -0.05],
                surface_height_m: 0.05,
                yaw_rad: 0.2,
                ..Plate::default()
            },
            z_down: true,
            reaction: false,
        };
        let reported = feet.on(&Ground::Two([at(0.2), at(-0.2)]));
        // On a sensor whose z axis points down, a load is positive.
        assert!(reported.iter().all(|plate| plate.force_n.z > 100.0));
        let sum: f64 = reported.iter().map(|plate| plate.force_n.z).sum();
        assert!((sum - feet.whole().force_n.z).abs() < 1e-9);
    }

    #[test]
    fn a_plate_of_any_axes_and_sign_has_the_pressure_where_it_is() {
        let (_, feet) = standing();
        let plate =
            Plate { origin_m: [0.1, 0.2, -0.05], yaw_rad: 0.4, surface_height_m: 0.05, ..Plate::default() };
        for (z_down, reaction) in [(false, false), (false, true), (true, false), (true, true)] {
            let reported = Mounting { plate, z_down, reaction }.measures(&feet.whole());
            let ([x, y], h) = ([reported.force_n.x, reported.force_n.y], plate.surface_height_m);
            // The surface is at −h along a z axis that points down, and at +h along one that points up.
            let h = if z_down { -h } else { h };
            let in_plate =
                Vector2::new(h * x - reported.moment_nm.y, h * y + reported.moment_nm.x) / reported.force_n.z;
            let upright = Vector3::new(in_plate.x, if z_down { -in_plate.y } else { in_plate.y }, 0.0);
            let in_world = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.4) * upright;
            let cop = in_world.xy() + Vector2::new(0.1, 0.2);
            assert!((cop - feet.whole().cop_m()).norm() < 1e-9, "{z_down} {reaction} {cop:?}");
        }
    }

    #[test]
    fn soles_feel_where_each_foot_presses() {
        let (worker, feet) = standing();
        for (k, sole) in feet.soles.iter().enumerate() {
            let stance = worker.stance();
            let extent = worker.person().foot_outline_m;
            let middle = stance.ankle_m[k]
                + stance.world_from_foot[k] * Vector3::new(0.5 * (extent.forward - extent.back), 0.0, 0.0);
            let in_world = middle + stance.world_from_foot[k] * sole.cop_m.push(0.0);
            assert!((in_world.xy() - feet.wrench[k].cop_m()).norm() < 1e-3, "{in_world:?}");
            assert!((sole.normal_n - feet.wrench[k].force_n.z).abs() < 0.01);
        }
    }
}
