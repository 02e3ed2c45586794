//! From a sensor's axes and sign to the force on the person in the station's world.

/// Which side of the contact the sensor's numbers are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Measures {
    /// The force on the sensor: pressing down reads negative on a sensor whose z points up.
    #[default]
    Action,
    /// The force on the person: standing reads positive.
    Reaction,
}

/// A force and a moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// N.
    pub force_n: [f64; 3],
    /// About the origin of the frame it is given in, N m.
    pub moment_nm: [f64; 3],
}

impl Wrench {
    fn negated(self) -> Wrench {
        Wrench { force_n: self.force_n.map(|n| -n), moment_nm: self.moment_nm.map(|nm| -nm) }
    }
}

/// Where the sensor stands in the station's world (X forward, Y left, Z up); its own z axis points up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GroundFrame {
    /// The sensor's origin in the world, m.
    pub origin_m: [f64; 3],
    /// Turn of the sensor about the world's Z, rad.
    pub yaw_rad: f64,
    /// Height of the walking surface above the sensor's origin, m.
    pub surface_height_m: f64,
}

impl GroundFrame {
    /// Height of the walking surface in the world, m.
    pub fn surface_z_m(&self) -> f64 {
        self.origin_m[2] + self.surface_height_m
    }

    /// What the sensor reads, as the wrench on the person in the world, about the world's origin.
    pub fn person_from_sensor(&self, sensor: Wrench, measures: Measures) -> Wrench {
        let person = match measures {
            Measures::Action => sensor.negated(),
            Measures::Reaction => sensor,
        };
        let force_n = turned(person.force_n, self.yaw_rad);
        let about_sensor_nm = turned(person.moment_nm, self.yaw_rad);
        let lever_nm = cross(self.origin_m, force_n);
        Wrench { force_n, moment_nm: core::array::from_fn(|axis| about_sensor_nm[axis] + lever_nm[axis]) }
    }

    /// The inverse: what the sensor would read for a wrench on the person about the world's origin.
    pub fn sensor_from_person(&self, person: Wrench, measures: Measures) -> Wrench {
        let lever_nm = cross(self.origin_m, person.force_n);
        let about_sensor_nm = core::array::from_fn(|axis| person.moment_nm[axis] - lever_nm[axis]);
        let sensor = Wrench {
            force_n: turned(person.force_n, -self.yaw_rad),
            moment_nm: turned(about_sensor_nm, -self.yaw_rad),
        };
        match measures {
            Measures::Action => sensor.negated(),
            Measures::Reaction => sensor,
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
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn there_and_back_is_nothing(
            origin_m in proptest::array::uniform3(-3.0..3.0), yaw_rad in -4.0..4.0, action: bool,
            force_n in proptest::array::uniform3(-1e3..1e3), moment_nm in proptest::array::uniform3(-1e2..1e2),
        ) {
            let frame = GroundFrame { origin_m, yaw_rad, surface_height_m: 0.05 };
            let measures = if action { Measures::Action } else { Measures::Reaction };
            let wrench = Wrench { force_n, moment_nm };
            let back = frame.sensor_from_person(frame.person_from_sensor(wrench, measures), measures);
            for (got, want) in back.force_n.iter().chain(&back.moment_nm).zip(force_n.iter().chain(&moment_nm)) {
                prop_assert!((got - want).abs() < 1e-9);
            }
        }
    }
}
