//! Recommended weight limit of the revised NIOSH lifting equation (Waters, Putz-Anderson & Garg 1994, section 1.3),
//! without its frequency: `FIRWL = 23 kg · HM · VM · DM · AM`. The coupling multiplier is 1 (good grips). The numbers are
//! the equation's, in metres.

use equipoise_core::body::{Segment, Side};
use equipoise_core::message::{State, Validity};

/// Position of a load relative to the feet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasp {
    /// H: horizontal distance of the load from the middle of the ankles, m.
    pub reach_m: f64,
    /// V: height of the wrists above the walking surface, m.
    pub height_m: f64,
    /// A: angle between the feet and the hands, about the vertical, degrees.
    pub asymmetry_deg: f64,
}

impl Grasp {
    /// The grasp of a state with valid torques; `surface_z_m` is the height of the walking surface in the world, m.
    pub fn of(state: &State, surface_z_m: f64) -> Option<Grasp> {
        let reach_m = state.unless(Validity::INVALIDATES_TORQUES, state.reach_m)?;
        let origin_m = state.segment_origin_m()?;
        let middle = |of: fn(Side) -> Segment| {
            let [a, b] = Side::BOTH.map(|side| origin_m[of(side).index()]);
            [0, 1, 2].map(|axis| 0.5 * (a[axis] + b[axis]))
        };
        let (ankles, toes, hands) = (middle(Side::foot), middle(Side::toe), middle(Side::hand));
        let [ahead, towards] = [toes, hands].map(|point| [point[0] - ankles[0], point[1] - ankles[1]]);
        let cross = ahead[0] * towards[1] - ahead[1] * towards[0];
        let along = ahead[0] * towards[0] + ahead[1] * towards[1];
        let asymmetry_deg = cross.abs().atan2(along).to_degrees();
        Some(Grasp { reach_m, height_m: hands[2] - surface_z_m, asymmetry_deg })
    }

    /// HM · VM · AM: 0 beyond the limits of the equation.
    fn multiplier(&self) -> f64 {
        let Grasp { reach_m, height_m, asymmetry_deg } = *self;
        if reach_m > 0.63 || height_m > 1.75 || asymmetry_deg > 135.0 {
            return 0.0;
        }
        let horizontal = 0.25 / reach_m.max(0.25);
        let vertical = 1.0 - 0.3 * (height_m.max(0.0) - 0.75).abs();
        horizontal * vertical * (1.0 - 0.0032 * asymmetry_deg)
    }
}

/// The lower limit of the two ends of a lift, kg.
pub fn weight_limit_kg(ends: [Grasp; 2]) -> f64 {
    let travel_m = (ends[1].height_m - ends[0].height_m).abs();
    let distance = match travel_m {
        too_far if too_far > 1.75 => 0.0,
        _ => 0.82 + 0.045 / travel_m.max(0.25),
    };
    let [from, to] = ends.map(|grasp| grasp.multiplier());
    23.0 * distance * from.min(to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const INCH_M: f64 = 0.0254;
    const POUND_KG: f64 = 0.453_592;

    fn grasp(inches: [f64; 2], asymmetry_deg: f64) -> Grasp {
        let [reach_m, height_m] = inches.map(|length| length * INCH_M);
        Grasp { reach_m, height_m, asymmetry_deg }
    }

    /// An example of the Applications Manual. It rounds its multipliers upward to two digits (14.5 lb = 51 lb · 0.44 · 0.75
    /// · 0.86, where HM is 0.435 and VM 0.745), and its 10 in and 51 lb exceed the metric 25 cm and 23 kg by 1.6 and 0.6 %.
    #[test]
    fn the_limit_is_that_of_the_applications_manual() {
        // Example 1, loading punch press stock: 14.5 lb at the destination, whose coupling is 1.
        let punch_press = [grasp([23.0, 15.0], 0.0), grasp([23.0, 63.0], 0.0)];
        // By the multipliers in inches: HM 10/16, VM 1 − 0.0075 · |24 − 30|, AM 1 − 0.0032 · 45; no travel.
        let turned = [grasp([16.0, 24.0], 45.0); 2];
        for (ends, pounds) in [(punch_press, 14.5), (turned, 51.0 * 0.625 * 0.955 * 0.856)] {
            let limit_lb = weight_limit_kg(ends) / POUND_KG;
            assert!((limit_lb - pounds).abs() < 0.05 * pounds, "{limit_lb} lb instead of {pounds}");
        }
    }

    #[test]
    fn close_loads_at_knuckle_height_have_the_load_constant_and_distant_ones_no_limit() {
        let best = Grasp { reach_m: 0.2, height_m: 0.75, asymmetry_deg: 0.0 };
        assert!((weight_limit_kg([best; 2]) - 23.0).abs() < 1e-9);
        for beyond in [
            Grasp { reach_m: 0.64, ..best },
            Grasp { height_m: 1.76, ..best },
            Grasp { asymmetry_deg: 136.0, ..best },
        ] {
            assert_eq!(weight_limit_kg([best, beyond]), 0.0, "{beyond:?}");
        }
    }

    #[test]
    fn a_grasp_is_relative_to_the_feet() {
        let mut state = State { reach_m: 0.4, suit_sample_time_ns: 1, ..State::zeroed() };
        for (side, y) in Side::BOTH.into_iter().zip([0.1, -0.1]) {
            state.segment_origin_m[side.foot().index()] = [2.0, y, 0.1];
            state.segment_origin_m[side.toe().index()] = [2.2, y, 0.0];
            // To the side: 90 degrees.
            state.segment_origin_m[side.hand().index()] = [2.0, 0.5 + y, 0.9];
        }
        let grasp = Grasp::of(&state, 0.2).unwrap();
        assert!((grasp.asymmetry_deg - 90.0).abs() < 1e-9 && (grasp.height_m - 0.7).abs() < 1e-12);
        state.valid = Validity::MOVING.0;
        assert_eq!(Grasp::of(&state, 0.2), None);
    }
}
