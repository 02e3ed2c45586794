//! Checks for makers whose plates have z down and report the force on the plate, which is positive under a load.

use super::{Axes, GroundConfig, Measures};
use crate::method::Checked;

/// Checks axes and sense; `plates` is the name in messages.
pub(super) fn check(ground: &GroundConfig, plates: &str) -> Checked {
    if ground.frame.axes != Axes::ZDown {
        let what = format!("must be \"z-down\" for {plates}, which have z down: say so under [ground.frame]");
        return Err(("ground.frame.axes", what));
    }
    if ground.measures != Measures::Action {
        let what = format!("must be \"action\" for {plates}, which report the force on the plate");
        return Err(("ground.measures", what));
    }
    Ok(())
}

/// As [`check`], for Kistler's eight channels, whose centre of pressure depends on the height of the surface.
pub(super) fn check_kistler(ground: &GroundConfig) -> Checked {
    check(ground, "Kistler's plates")?;
    if ground.frame.surface_height_m <= 0.0 {
        let what = "must be given for Kistler's plates: how far the sensors lie below the surface, -az0 of the plate's \
                    sheet (0.048 for az0 = -0.048), and what lies on the plate";
        return Err(("ground.frame.surface_height_m", what.to_owned()));
    }
    Ok(())
}
