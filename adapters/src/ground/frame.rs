//! Transforms a sensor's axes and sign convention to the force on the person in the station's world.

/// Sign convention: the side of the contact on which the measured force acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Measures {
    /// Force on the sensor: negative under load on a sensor whose z points up.
    #[default]
    Action,
    /// Force on the person: positive when standing.
    Reaction,
}

/// Orientation of a sensor's axes when its plate lies on the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SensorAxes {
    /// z points up, as with six-axis sensors under a plate.
    #[default]
    ZUp,
    /// z down and y reversed, as with Kistler and AMTI plates and in C3D files.
    ZDown,
}

/// A force and a moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// N.
    pub force_n: [f64; 3],
    /// About the origin of the frame in which it is expressed, N m.
    pub moment_nm: [f64; 3],
}

impl Wrench {
    fn negated(self) -> Wrench {
        Wrench { force_n: self.force_n.map(|n| -n), moment_nm: self.moment_nm.map(|nm| -nm) }
    }
}

/// Pose of the sensor in the station's world (X forward, Y left, Z up).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GroundFrame {
    /// Whether the sensor's z axis points up or down.
    pub axes: SensorAxes,
    /// The sensor's origin in the world, m.
    pub origin_m: [f64; 3],
    /// Rotation of the sensor's x axis about the world's Z, rad.
    pub yaw_rad: f64,
    /// Height of the walking surface above the sensor's origin, m.
    pub surface_height_m: f64,
}

impl GroundFrame {
    /// Height of the walking surface in the world, m.
    pub fn surface_z_m(&self) -> f64 {
        self.origin_m[2] + self.surface_height_m
    }

    /// Converts a sensor reading to the wrench on the person in the world, about the world's origin.
    pub fn person_from_sensor(&self, sensor: Wrench, measures: Measures) -> Wrench {
        let person = match measures {
            Measures::Action => sensor.negated(),
            Measures::Reaction => sensor,
        };
        let force_n = turned(self.upright(person.force_n), self.yaw_rad);
        let about_sensor_nm = turned(self.upright(person.moment_nm), self.yaw_rad);
        let lever_nm = cross(self.origin_m, force_n);
        Wrench { force_n, moment_nm: core::array::from_fn(|axis| about_sensor_nm[axis] + lever_nm[axis]) }
    }

    /// From the sensor's axes to axes with z up, or back: rotation by 180° about x, or identity.
    fn upright(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self.axes {
            SensorAxes::ZUp => [x, y, z],
            SensorAxes::ZDown => [x, -y, -z],
        }
    }
}

fn turned([x, y, z]: [f64; 3], yaw_rad: f64) -> [f64; 3] {
    let (sin, cos) = yaw_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y, z]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_simulator::devices::load::Mounting;
    use equipoise_simulator::dynamics::Wrench as OnFloor;
    use equipoise_simulator::plate::Plate;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_wrench_under_a_simulated_plate_is_recovered(
            origin_m in proptest::array::uniform3(-3.0..3.0), yaw_rad in -4.0..4.0, reaction: bool, z_down: bool,
            force_n in proptest::array::uniform3(-1e3..1e3), moment_nm in proptest::array::uniform3(-1e2..1e2),
        ) {
            let plate = Plate { origin_m, yaw_rad, surface_height_m: 0.05, ..Plate::default() };
            let on_floor = OnFloor { force_n: force_n.into(), moment_nm: moment_nm.into() };
            let sensor = Mounting { plate, z_down, reaction }.measures(&on_floor);
            let axes = if z_down { SensorAxes::ZDown } else { SensorAxes::ZUp };
            let frame = GroundFrame { axes, origin_m, yaw_rad, surface_height_m: 0.05 };
            let measures = if reaction { Measures::Reaction } else { Measures::Action };
            let sensor = Wrench { force_n: sensor.force_n.into(), moment_nm: sensor.moment_nm.into() };
            let got = frame.person_from_sensor(sensor, measures);
            let want = plate.in_the_station(&on_floor).components();
            for (got, want) in got.force_n.iter().chain(&got.moment_nm).zip(want) {
                prop_assert!((got - want).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_kistler_plate_whose_z_points_down_finds_the_centre_of_pressure_of_its_makers() {
        // Kistler: surface at az0 below the sensor's origin along its z; ax = -(My - Fx az0)/Fz, ay = (Mx + Fy az0)/Fz.
        let (az0, [fx, fy, fz], [mx, my, mz]) = (-0.048, [12.0, -7.0, 700.0], [21.0, -35.0, 1.0]);
        let (ax, ay) = (-(my - fx * az0) / fz, (mx + fy * az0) / fz);
        let frame = GroundFrame { axes: SensorAxes::ZDown, surface_height_m: -az0, ..GroundFrame::default() };
        let on_plate = Wrench { force_n: [fx, fy, fz], moment_nm: [mx, my, mz] };
        let person = frame.person_from_sensor(on_plate, Measures::Action);
        let ([force_x, force_y, force_z], [moment_x, moment_y, _]) = (person.force_n, person.moment_nm);
        let z = frame.surface_z_m();
        assert!(force_z > 699.0);
        let cop = [(z * force_x - moment_y) / force_z, (moment_x + z * force_y) / force_z];
        // y points to the right when z points down.
        assert!((cop[0] - ax).abs() < 1e-12 && (cop[1] + ay).abs() < 1e-12, "{cop:?} {ax} {ay}");
    }
}
