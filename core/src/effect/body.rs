//! Deviations of the body from the identified subject, and motion of it that the model or the suit omits.

use super::geometry::{AXES, Column};
use super::{Columns, Observation, Parameter, Place};
use crate::GRAVITY_M_PER_S2;
use crate::math;

pub(super) const INERTIA: [Parameter; 1] = [Parameter { name: "share", unit: "1", prior_sigma: 1.0 }];

/// `inertia`: effect of the body's own motion on the ground reaction, for models that omit it. Column: the CoM's
/// acceleration times its height, `−h C̈_xy/(g + C̈_z)`, unless measured shear already contains it; the rotation of the
/// body; and the force `M C̈`.
pub(super) fn inertia(o: &Observation) -> Columns {
    let [x, y, z] = o.com_acceleration_m_per_s2;
    let specific = GRAVITY_M_PER_S2 + z;
    let height_m = if o.slope_is_measured { 0.0 } else { o.centre_height_m() };
    let [turning_x, turning_y] = o.turning_m;
    let cop_m = [turning_x - height_m * x / specific, turning_y - height_m * y / specific];
    Columns::of(&[Column { cop_m, force_n: [x, y, z].map(|part| o.mass_kg * part) }])
}

pub(super) const PERIODIC_SWAY: [Parameter; 4] = [
    Parameter { name: "sine_x_m", unit: "m", prior_sigma: 0.002 },
    Parameter { name: "cosine_x_m", unit: "m", prior_sigma: 0.002 },
    Parameter { name: "sine_y_m", unit: "m", prior_sigma: 0.002 },
    Parameter { name: "cosine_y_m", unit: "m", prior_sigma: 0.002 },
];

/// `periodic_sway`: breathing or sway that the suit does not measure. Columns: sine and cosine at the shape's
/// frequency, Hz, forward and then sideways.
pub(super) fn periodic_sway(frequency_hz: f64, o: &Observation) -> Columns {
    let (sine, cosine) = math::sin_cos(core::f64::consts::TAU * frequency_hz * o.time_s);
    Columns::of(&[[sine, 0.0], [cosine, 0.0], [0.0, sine], [0.0, cosine]].map(Column::of_cop))
}

pub(super) const UNBALANCED_PARAMETERS: [Parameter; 3] = [
    Parameter { name: "dx_m", unit: "m", prior_sigma: 0.03 },
    Parameter { name: "dy_m", unit: "m", prior_sigma: 0.03 },
    Parameter { name: "dz_m", unit: "m", prior_sigma: 0.03 },
];

/// `unbalanced_parameters`: one segment's φ differs from the identified one. Columns: a metre of φ along each of the
/// segment's axes, `R_s`.
pub(super) fn unbalanced_parameters(place: Place, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(UNBALANCED_PARAMETERS.len()) };
    Columns::of(&AXES.map(|axis| o.of_shift(o.turned(segment, axis))))
}
