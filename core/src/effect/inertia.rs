//! `inertia`: effect of the body's own motion on the ground reaction, for models that omit it.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "share", unit: "1", prior_sigma: 1.0 }];

/// Column: the CoM's acceleration times its height, `−h C̈_xy/(g + C̈_z)`, unless measured shear already contains it;
/// the rotation of the body; and the force `M C̈`.
pub(super) fn columns(o: &Observation) -> Columns {
    let [x, y, z] = o.com_acceleration_m_per_s2;
    let specific = super::geometry::GRAVITY_M_PER_S2 + z;
    let height_m = if o.slope_is_measured { 0.0 } else { o.centre_height_m() };
    let [turning_x, turning_y] = o.turning_m;
    let cop_m = [turning_x - height_m * x / specific, turning_y - height_m * y / specific];
    Columns::of(&[Column { cop_m, force_n: [x, y, z].map(|part| o.mass_kg * part) }])
}
