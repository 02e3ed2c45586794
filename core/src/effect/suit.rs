//! Errors of the suit, as the deviation of its output from the truth; columns reverse it.
//!
//! The lag has no column: the loop corrects the time of samples on arrival, so that all later stages use the right
//! time.

use super::geometry::{AXES, Column, Matrix, Moving, chord, cross, leftward, rotated, sum};
use super::{Columns, Observation, Parameter, Place};
use crate::body::Segment;
use crate::math;

/// `suit_lag`: the samples are dated later than the motion that they contain.
pub(super) const LAG: [Parameter; 1] = [Parameter { name: "tau_s", unit: "s", prior_sigma: 0.06 }];

/// A suit's sample time without the lag, ns: earlier by `tau_s`, or later if it is negative. A lag that is NaN changes
/// nothing; one larger than the time itself gives zero.
pub(crate) fn without_lag_ns(sample_time_ns: u64, tau_s: f64) -> u64 {
    let shift_ns = tau_s.abs() * 1e9;
    // The conversion of a float saturates, and maps NaN to zero.
    let shift_ns = (shift_ns + 0.5) as u64;
    if tau_s < 0.0 {
        sample_time_ns.saturating_add(shift_ns)
    } else {
        sample_time_ns.saturating_sub(shift_ns)
    }
}

/// 1-σ: 4° per minute.
pub(super) const HEADING_DRIFT: [Parameter; 1] = [Parameter {
    name: "rate_rad_per_s",
    unit: "rad/s",
    prior_sigma: 4.0 * core::f64::consts::PI / 180.0 / 60.0,
}];

/// `suit_heading_drift`: the whole suit rotates left about the vertical, by gyroscope drift. Column: the suit's part of
/// the prediction is rotated left about the standing feet by rate times time, so it is rotated back.
pub(super) fn heading_drift(o: &Observation) -> Columns {
    let by_suit_m = o.cop_by_suit_m();
    let from_feet_m = [0, 1].map(|axis| by_suit_m[axis] - o.feet_m[axis]);
    let [x, y, _] = o.force_predicted_n;
    let [push_x, push_y] = leftward([x, y]);
    let cop_m = leftward(from_feet_m).map(|part| -part);
    Columns::of(&[Column { cop_m, force_n: [-push_x, -push_y, 0.0] }.times(o.time_s)])
}

pub(super) const SEGMENT_HEADING: [Parameter; 1] =
    [Parameter { name: "psi_rad", unit: "rad", prior_sigma: 12.0 * core::f64::consts::PI / 180.0 }];

/// `segment_heading`: heading error of one segment, about the vertical, too far left if positive; caused by iron near
/// its sensor. Column: the segment's arm, rotated back: `(R_z(−ψ) − 1) arm / ψ` for a ψ (`about_rad`) that may be
/// large, `arm × e_z` for a small one.
pub(super) fn segment_heading(place: Place, about_rad: f64, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(SEGMENT_HEADING.len()) };
    let arm = o.arm(segment);
    let [_, _, up] = AXES;
    let (straight, aside) = chord(about_rad);
    let back = |arm: [f64; 3]| {
        let turned = cross(arm, up);
        sum(turned.map(|part| straight * part), cross(turned, up).map(|part| about_rad * aside * part))
    };
    let moved = |arm: Moving| Moving { at: back(arm.at), acceleration: back(arm.acceleration) };
    let turning_m = turning_m(o, segment, moved, |arm| moved(arm).times(about_rad));
    Columns::of(&[o.of_shift(moved(arm)).plus(Column::of_cop(turning_m))])
}

const MISALIGNMENT_SIGMA_RAD: f64 = 8.0 * core::f64::consts::PI / 180.0;

pub(super) const SEGMENT_MISALIGNMENT: [Parameter; 3] = [
    Parameter { name: "rx_rad", unit: "rad", prior_sigma: MISALIGNMENT_SIGMA_RAD },
    Parameter { name: "ry_rad", unit: "rad", prior_sigma: MISALIGNMENT_SIGMA_RAD },
    Parameter { name: "rz_rad", unit: "rad", prior_sigma: MISALIGNMENT_SIGMA_RAD },
];

/// `segment_misalignment`: one segment's sensor is misaligned or has slipped: the suit reports `R_s exp(δ)` for `R_s`.
/// Columns: the segment's arm ψ_s, rotated back about each of the segment's axes `e`: `−R_s (e × ψ_s)` for a small
/// rotation; for one that may be large (`about_rad`, δ), terms with the sum `R_s (exp(−δ) − 1) ψ_s` (Rodrigues).
pub(super) fn segment_misalignment(place: Place, about_rad: [f64; 3], o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(SEGMENT_MISALIGNMENT.len()) };
    misaligned_by(segment, about_rad, o, |own_m| o.turned(segment, own_m))
}

/// Columns of a small misalignment that is multiplied by a factor, which changes with time: `Δr = f R_s (ψ_s × e)`.
/// Input: mean and second derivative (1/s²) of `f R_s`.
pub(super) fn varying_misalignment(
    segment: Segment,
    [turned, acceleration]: [&Matrix; 2],
    o: &Observation,
) -> Columns {
    let moved = |own_m| Moving { at: rotated(turned, own_m), acceleration: rotated(acceleration, own_m) };
    misaligned_by(segment, [0.0; 3], o, moved)
}

/// Columns of [`segment_misalignment`]; `turned` maps a displacement in the segment's axes to its motion in the world.
fn misaligned_by(
    segment: Segment,
    about_rad: [f64; 3],
    o: &Observation,
    turned: impl Fn([f64; 3]) -> Moving,
) -> Columns {
    // Bones are rigid: in the segment's axes the attached parts do not move.
    let rows = &o.rotation[segment.index()];
    let (straight, aside) = chord(math::sqrt(about_rad.iter().map(|part| part * part).sum()));
    let moved = |arm: Moving, axis: [f64; 3]| {
        let [x, y, z] = arm.at;
        let fixed_m = [0, 1, 2].map(|axis| rows[0][axis] * x + rows[1][axis] * y + rows[2][axis] * z);
        let across = cross(fixed_m, axis);
        turned(sum(across.map(|part| straight * part), cross(across, about_rad).map(|part| aside * part)))
    };
    let arm = o.arm(segment);
    Columns::of(&AXES.map(|axis| {
        let turning_m = turning_m(o, segment, |arm| moved(arm, axis), |arm| moved(arm, about_rad));
        o.of_shift(moved(arm, axis)).plus(Column::of_cop(turning_m))
    }))
}

/// Shift of the CoP by the rotation of the body, m, if every arm from the segment's origin to a distal part is changed
/// by `moved(arm)`; per unit, in addition to a common change of all of them by `all(arm)`.
///
/// `L̇ = Σ m (r − c) × (r̈ − c̈)` with `Δr`, `Δr̈` of every distal centre; a motion of the whole body has no effect.
/// The rotation of segments about their own centres is unchanged.
fn turning_m(
    o: &Observation,
    segment: Segment,
    moved: impl Fn(Moving) -> Moving,
    all: impl Fn(Moving) -> Moving,
) -> [f64; 2] {
    let centres = Segment::ALL.map(|each| o.point_on(each, o.centre_m[each.index()]));
    let still = Moving { at: [0.0; 3], acceleration: [0.0; 3] };
    let mass_fractions = || o.mass_fraction.iter().zip(&centres);
    let middle = mass_fractions()
        .fold(still, |middle, (mass_fraction, centre)| middle.plus(centre.times(*mass_fraction)));
    let mut rate = [0.0; 3];
    let (mut shift, mut shift_of_all) = (still, still);
    for each in Segment::ALL.into_iter().filter(|each| each.is_distal_to(segment)) {
        let mass_fraction = o.mass_fraction[each.index()];
        let arm = o.arm_to(segment, each);
        let (own, other) = (moved(arm), all(arm));
        let from_middle = centres[each.index()].plus(middle.times(-1.0));
        rate = sum(rate, moment(mass_fraction, own.at, sum(from_middle.acceleration, other.acceleration)));
        rate = sum(rate, moment(mass_fraction, from_middle.at, own.acceleration));
        shift = shift.plus(own.times(mass_fraction));
        shift_of_all = shift_of_all.plus(other.times(mass_fraction));
    }
    let [x, y, _] = sum(rate, moment(-1.0, shift.at, shift_of_all.acceleration));
    let specific = o.specific_force_m_per_s2();
    [-y / specific, x / specific]
}

fn moment(mass_fraction: f64, at: [f64; 3], acceleration: [f64; 3]) -> [f64; 3] {
    cross(at, acceleration).map(|part| mass_fraction * part)
}

impl Observation {
    /// Arm from a segment's origin to the point that moves a distal segment's centre when the first one rotates: its
    /// own centre, or the joint at which the distal one is attached.
    fn arm_to(&self, segment: Segment, distal: Segment) -> Moving {
        let mut child = distal;
        if child == segment {
            return self.turned(segment, self.centre_m[segment.index()]);
        }
        while let Some(parent) = child.parent().filter(|parent| *parent != segment) {
            child = parent;
        }
        self.origin(child).plus(self.origin(segment).times(-1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::without_lag_ns;

    #[test]
    fn a_late_suit_is_dated_back_and_an_early_one_forward() {
        assert_eq!(without_lag_ns(1_000_000_000, 0.020), 980_000_000);
        assert_eq!(without_lag_ns(1_000_000_000, -0.020), 1_020_000_000);
        for tau_s in [0.0, 1e-12, f64::NAN] {
            assert_eq!(without_lag_ns(1_000_000_000, tau_s), 1_000_000_000);
        }
        assert_eq!(without_lag_ns(5, 1.0), 0);
        assert_eq!(without_lag_ns(without_lag_ns(7_000_000_000, 0.0137), -0.0137), 7_000_000_000);
    }
}
