//! A mass carried along by a segment: its weight and its inertia are a force on the body.

use super::geometry::{AXES, Column, GRAVITY_M_PER_S2, Moving};
use super::{Observation, Parameter};
use crate::body::Segment;

/// The parameters of a carried mass with their prior: 1-σ of the mass, kg, and of its first moment on each axis, kg m.
pub(super) const fn parameters(mass_kg: f64, moment_kg_m: f64) -> [Parameter; 4] {
    [
        Parameter { name: "mass_kg", unit: "kg", prior_sigma: mass_kg },
        Parameter { name: "mx_kg_m", unit: "kg m", prior_sigma: moment_kg_m },
        Parameter { name: "my_kg_m", unit: "kg m", prior_sigma: moment_kg_m },
        Parameter { name: "mz_kg_m", unit: "kg m", prior_sigma: moment_kg_m },
    ]
}

/// Columns of one kilogram at a point of a segment, and of one kilogram metre of first moment about it on each of the
/// segment's axes.
///
/// Exact for a point mass. Its moment of inertia (kg m²), which acts only in rotation, is neglected.
pub(super) fn carried(o: &Observation, segment: Segment, point: Moving) -> [Column; 4] {
    let force = |Moving { acceleration: [x, y, z], .. }: Moving| [-x, -y, -z];
    let [x, y, z] = force(point);
    let weight = [x, y, z - GRAVITY_M_PER_S2];
    let [forward, left, up] = AXES.map(|axis| {
        let aside = o.turned(segment, axis);
        o.of_force(point.at, force(aside)).plus(o.of_moved_force(aside.at, weight))
    });
    [o.of_force(point.at, weight), forward, left, up]
}
