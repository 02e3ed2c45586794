//! A force plate: its pose, its measured wrench, its counts.

use nalgebra::{UnitQuaternion, Vector3};

use crate::dynamics::Wrench;
use crate::wires::ati_rdt::Record;

/// A plate's pose in the station's world and the scale of its counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plate {
    /// The sensor's origin in the station's world, m.
    pub origin_m: [f64; 3],
    /// Rotation of the sensor's axes about Z, rad.
    pub yaw_rad: f64,
    /// Height of the walking surface above the sensor's origin, m.
    pub surface_height_m: f64,
    /// Counts per newton and per newton metre.
    pub counts_per_unit: [f64; 2],
}

impl Default for Plate {
    fn default() -> Plate {
        Plate { origin_m: [0.0; 3], yaw_rad: 0.0, surface_height_m: 0.0, counts_per_unit: [1e6; 2] }
    }
}

impl Plate {
    /// Height of the walking surface in the station's world, m.
    pub fn surface_z_m(&self) -> f64 {
        self.origin_m[2] + self.surface_height_m
    }

    /// Converts a wrench about the origin on the simulated floor to one about the station's origin: the floor is the
    /// plate's surface.
    pub fn in_the_station(&self, on_person: &Wrench) -> Wrench {
        let up = Vector3::z() * self.surface_z_m();
        Wrench { moment_nm: on_person.moment_nm + up.cross(&on_person.force_n), ..*on_person }
    }

    /// Wrench on the sensor for a wrench `on_person` of the ground on the person (about the station's origin): the
    /// opposite ("action"), about the sensor's origin, in the sensor's axes.
    pub fn sensor_wrench(&self, on_person: &Wrench) -> Wrench {
        let about_sensor = on_person.moment_nm - Vector3::from(self.origin_m).cross(&on_person.force_n);
        let plate_from_world = UnitQuaternion::from_scaled_axis(Vector3::z() * -self.yaw_rad);
        Wrench { force_n: plate_from_world * -on_person.force_n, moment_nm: plate_from_world * -about_sensor }
    }

    /// The record of a sensor wrench; beyond the range of 32 bits it saturates, like a sensor.
    pub fn record(&self, wrench: &Wrench, ft_sequence: u32, status: u32) -> Record {
        let counts = |value: Vector3<f64>, per_unit: f64| {
            let rounded = value.map(|number| (number * per_unit).round());
            [rounded.x as i32, rounded.y as i32, rounded.z as i32]
        };
        let [per_newton, per_newton_metre] = self.counts_per_unit;
        Record {
            rdt_sequence: 0, // the server numbers its records
            ft_sequence,
            status,
            force_counts: counts(wrench.force_n, per_newton),
            torque_counts: counts(wrench.moment_nm, per_newton_metre),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sensor_feels_a_weight_downwards_where_it_stands() {
        let plate =
            Plate { origin_m: [0.3, -0.1, 0.02], yaw_rad: 0.5, surface_height_m: 0.04, ..Plate::default() };
        let on_person =
            Wrench::at(Vector3::new(0.35, -0.05, plate.surface_z_m()), Vector3::new(5.0, 8.0, 700.0));
        let wrench = plate.sensor_wrench(&on_person);
        assert!(wrench.force_n.z < -699.0);
        // The height of the surface above the sensor couples the shear: x = (h Fx − My)/Fz, y = (h Fy + Mx)/Fz.
        let (f, m, h) = (wrench.force_n, wrench.moment_nm, plate.surface_height_m);
        let in_plate = Vector3::new((h * f.x - m.y) / f.z, (h * f.y + m.x) / f.z, 0.0);
        let in_world = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.5) * in_plate;
        assert!((in_world.xy() - nalgebra::Vector2::new(0.05, 0.05)).norm() < 1e-12);
        assert_eq!(plate.record(&wrench, 7, 0).force_counts[2], -700_000_000);
    }

    #[test]
    fn the_centre_of_pressure_survives_the_way_into_the_sensor() {
        let plate =
            Plate { origin_m: [0.2, 0.1, -0.03], yaw_rad: -0.3, surface_height_m: 0.05, ..Plate::default() };
        let on_floor = Wrench::at(Vector3::new(0.07, -0.03, 0.0), Vector3::new(-20.0, 10.0, 650.0));
        let in_station = plate.in_the_station(&on_floor);
        let at_surface = Wrench::at(Vector3::new(0.07, -0.03, 0.02), on_floor.force_n);
        assert!((in_station.moment_nm - at_surface.moment_nm).norm() < 1e-12);
    }
}
