//! Values of one instant, as motion formats hold them.

use equipoise_core::body::{JOINTS, SEGMENTS};
use equipoise_core::message::{State, Validity};

use crate::table::rules::Exported;

/// Values of one instant in the station's world (X forward, Y left, Z up). A component is NaN where the state's flags
/// invalidate it: NaN survives interpolation, and each format replaces it by its own mark of an invalid value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Frame {
    /// Time, CLOCK_MONOTONIC ns.
    pub(crate) time_ns: u64,
    /// Segment origins (proximal joint centres) in MVN order, m.
    pub(crate) origin_m: [[f64; 3]; SEGMENTS],
    /// Estimated centre of mass of the unloaded body, m.
    pub(crate) com_m: [f64; 3],
    /// Measured centre of pressure on the walking surface, m.
    pub(crate) cop_m: [f64; 3],
    /// Ground reaction force on the person, N.
    pub(crate) force_n: [f64; 3],
    /// Moment of the ground reaction on the person about the vertical through the centre of pressure, N m.
    pub(crate) free_moment_nm: f64,
    /// Overload torque of each joint, N m.
    pub(crate) torque_nm: [[f64; 3]; JOINTS],
    /// 1-σ of the magnitude of each overload torque, N m.
    pub(crate) torque_sigma_nm: [f64; JOINTS],
}

impl Frame {
    /// A frame in which every value is invalid.
    pub(super) fn invalid(time_ns: u64) -> Frame {
        Frame {
            time_ns,
            origin_m: [[f64::NAN; 3]; SEGMENTS],
            com_m: [f64::NAN; 3],
            cop_m: [f64::NAN; 3],
            force_n: [f64::NAN; 3],
            free_moment_nm: f64::NAN,
            torque_nm: [[f64::NAN; 3]; JOINTS],
            torque_sigma_nm: [f64::NAN; JOINTS],
        }
    }

    /// Values of a state, at the sample time that its results refer to. `surface_z_m`: height of the walking surface, m;
    /// NaN if it is unavailable.
    pub(super) fn of(state: &State, surface_z_m: f64, free_moment_nm: f64) -> Frame {
        let valid = |field: &str, index: usize| state.is_available(field, index);
        // Points and forces share one world in these formats, so the body's position in it must be known.
        let is_placed = !state.validity().any_of(Validity::POSITION_UNKNOWN);
        let has_torques = valid("torque_nm", 0);
        let [x, y] = masked(valid("cop_measured_m", 0), state.cop_measured_m);
        Frame {
            time_ns: state.suit_sample_time_ns,
            origin_m: state.segment_origin_m.map(|at| masked(is_placed && valid("segment_origin_m", 0), at)),
            com_m: masked(valid("com_m", 0), state.com_m),
            cop_m: masked(!(x + y + surface_z_m).is_nan(), [x, y, surface_z_m]),
            force_n: std::array::from_fn(|axis| match valid("ground_force_n", axis) {
                true => state.ground_force_n[axis],
                false => f64::NAN,
            }),
            free_moment_nm,
            torque_nm: state.torque_nm.map(|torque| masked(has_torques, torque)),
            torque_sigma_nm: masked(has_torques, state.torque_sigma_nm),
        }
    }

    /// The frame at `time_ns` on the line between two others; a value that is invalid in either is invalid.
    pub(super) fn between(&self, later: &Frame, time_ns: u64) -> Frame {
        let fraction = (time_ns - self.time_ns) as f64 / (later.time_ns - self.time_ns).max(1) as f64;
        Frame {
            time_ns,
            origin_m: std::array::from_fn(|i| blend(self.origin_m[i], later.origin_m[i], fraction)),
            com_m: blend(self.com_m, later.com_m, fraction),
            cop_m: blend(self.cop_m, later.cop_m, fraction),
            force_n: blend(self.force_n, later.force_n, fraction),
            free_moment_nm: blend([self.free_moment_nm], [later.free_moment_nm], fraction)[0],
            torque_nm: std::array::from_fn(|i| blend(self.torque_nm[i], later.torque_nm[i], fraction)),
            torque_sigma_nm: blend(self.torque_sigma_nm, later.torque_sigma_nm, fraction),
        }
    }

    /// Whether force and centre of pressure are valid.
    pub(crate) fn has_force(&self) -> bool {
        self.force_n.iter().chain(&self.cop_m).all(|value| value.is_finite())
    }

    /// Whether the overload torques are valid.
    pub(crate) fn has_torques(&self) -> bool {
        self.torque_nm.as_flattened().iter().chain(&self.torque_sigma_nm).all(|value| value.is_finite())
    }

    /// Moment of the ground reaction about `(0, 0, surface)` of the station's world, N m.
    pub(crate) fn moment_nm(&self) -> [f64; 3] {
        let ([x, y, _], [fx, fy, fz]) = (self.cop_m, self.force_n);
        [y * fz, -x * fz, x * fy - y * fx + self.free_moment_nm]
    }
}

fn masked<const N: usize>(is_valid: bool, values: [f64; N]) -> [f64; N] {
    if is_valid { values } else { [f64::NAN; N] }
}

fn blend<const N: usize>(from: [f64; N], to: [f64; N], fraction: f64) -> [f64; N] {
    std::array::from_fn(|index| from[index] + fraction * (to[index] - from[index]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn state() -> State {
        State { suit_sample_time_ns: 5, unavailable: 0, ..State::zeroed() }
    }

    #[test]
    fn invalid_values_are_nan_and_stay_so_when_interpolated() {
        let valid = Frame { time_ns: 10, ..Frame::of(&state(), 0.02, 1.0) };
        let stale = State { valid: Validity::GROUND_STALE.0, suit_sample_time_ns: 20, ..state() };
        let frame = valid.between(&Frame::of(&stale, 0.02, 1.0), 15);
        assert!(frame.force_n.iter().chain(&frame.cop_m).all(|value| value.is_nan()));
        assert!(frame.torque_nm[3][1].is_nan() && frame.torque_sigma_nm[3].is_nan());
        assert_eq!((frame.origin_m[4], frame.free_moment_nm), ([0.0; 3], 1.0));
        for reason in [Validity::SUIT_STALE, Validity::SUIT_IMPLAUSIBLE, Validity::POSITION_UNKNOWN] {
            let hidden = Frame::of(&State { valid: reason.0, ..state() }, 0.0, 0.0);
            assert!(hidden.origin_m[0][0].is_nan(), "{reason:?}");
        }
        assert!(Frame::of(&state(), f64::NAN, 0.0).cop_m[0].is_nan(), "no surface, no point of application");
    }

    #[test]
    fn the_moment_is_that_of_the_force_at_its_point() {
        let mut state = state();
        (state.cop_measured_m, state.ground_force_n) = ([0.2, -0.1], [10.0, -20.0, 700.0]);
        let frame = Frame::of(&state, 0.05, 3.0);
        // (x, y, 0) × F + (0, 0, T).
        assert_eq!(frame.moment_nm(), [-70.0, -140.0, 0.2 * -20.0 + 0.1 * 10.0 + 3.0]);
        assert!(frame.has_force() && frame.has_torques());
    }

    #[test]
    fn a_frame_between_two_is_on_the_line() {
        let mut later = Frame { time_ns: 30, ..Frame::of(&state(), 0.0, 4.0) };
        later.com_m = [3.0, 0.0, 1.0];
        let frame = Frame { time_ns: 10, ..Frame::of(&state(), 0.0, 2.0) }.between(&later, 15);
        assert_eq!((frame.time_ns, frame.com_m, frame.free_moment_nm), (15, [0.75, 0.0, 0.25], 2.5));
    }
}
