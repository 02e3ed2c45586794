//! The ground's vertical force on each foot, from the balance of moments.

use equipoise_core::body::Side;
use nalgebra::{Vector2, Vector3};

use super::Force;
use crate::motion::BodyState;

/// The ground's vertical forces on the left and right foot, with their points of action, for a centre of pressure and a
/// vertical force.
///
/// Along the line between the ankles each foot presses at a given place, and the balance of moments gives its fraction
/// of the force; if no fraction in [0, 1] balances, both places shift equally. Across that line one foot presses ahead
/// of the centre of pressure and the other behind it, by distances in the inverse ratio of the forces. Both places are
/// given by [`BodyState::feet`] and by `press_m` (from the ankle, world axes, m). A foot in the air carries nothing.
pub fn foot_forces(
    body: &BodyState,
    press_m: [Vector2<f64>; 2],
    cop_m: Vector2<f64>,
    vertical_n: f64,
) -> [Force; 2] {
    let (fraction, at_m) = match body.foot_stands {
        [true, false] => ([1.0, 0.0], [cop_m; 2]),
        [false, true] => ([0.0, 1.0], [cop_m; 2]),
        _ => both_stand(body, press_m, cop_m),
    };
    std::array::from_fn(|k| Force {
        on: Side::BOTH[k].foot(),
        at_m: at_m[k].push(0.0),
        force_n: Vector3::z() * (fraction[k] * vertical_n),
    })
}

/// Fraction and point of action of each foot's force.
fn both_stand(
    body: &BodyState,
    press_m: [Vector2<f64>; 2],
    cop_m: Vector2<f64>,
) -> ([f64; 2], [Vector2<f64>; 2]) {
    let ankle_m = Side::BOTH.map(|side| body.origin_m[side.foot().index()].xy());
    let aside = (ankle_m[0] - ankle_m[1]).normalize();
    let ahead = Vector2::new(aside.y, -aside.x);
    let place_m: [f64; 2] = std::array::from_fn(|k| {
        let left = body.world_from_segment[Side::BOTH[k].foot().index()] * Vector3::y();
        aside.dot(&(ankle_m[k] + press_m[k] + left.xy() * body.feet.aside_m[k]))
    });
    let left = ((aside.dot(&cop_m) - place_m[1]) / (place_m[0] - place_m[1])).clamp(0.0, 1.0);
    let fraction = [left, 1.0 - left];
    let shift_m = aside.dot(&cop_m) - fraction[0] * place_m[0] - fraction[1] * place_m[1];
    let ahead_m = body.feet.ahead_m + 0.5 * ahead.dot(&(press_m[0] - press_m[1]));
    let ahead_m = [2.0 * fraction[1] * ahead_m, -2.0 * fraction[0] * ahead_m];
    let at_m =
        std::array::from_fn(|k| aside * (place_m[k] + shift_m) + ahead * (ahead.dot(&cop_m) + ahead_m[k]));
    (fraction, at_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GRAVITY_M_PER_S2;
    use crate::motion::Worker;
    use crate::person::Person;
    use crate::realism::Realism;
    use crate::truth::Truth;

    /// Root mean square over many people who stand: each foot's distance ahead of the common line, and the left foot's
    /// fraction less that of feet that press under their ankles.
    fn spread(realism: &Realism) -> [f64; 2] {
        let (mut square, mut count) = ([0.0; 2], 0.0);
        for seed in 0..300 {
            let worker = Worker::with_habits(Person::new(seed, 1.77, 72.0), seed, realism.habits(seed));
            for time_s in [0.0, 40.0, 80.0] {
                let truth = Truth::of(&worker, time_s);
                let weight_n = 72.0 * GRAVITY_M_PER_S2;
                let feet = foot_forces(&truth.body, [Vector2::zeros(); 2], truth.com_m.xy(), weight_n);
                let ankle_m = Side::BOTH.map(|side| truth.body.origin_m[side.foot().index()]);
                assert!((ankle_m[0] - ankle_m[1]).x.abs() < 1e-9, "the feet are side by side");
                let under_ankles = (truth.com_m.y - ankle_m[1].y) / (ankle_m[0].y - ankle_m[1].y);
                let off = [feet[0].at_m.x - truth.com_m.x, feet[0].force_n.z / weight_n - under_ankles];
                square = std::array::from_fn(|k| square[k] + off[k] * off[k]);
                count += 1.0;
            }
        }
        square.map(|sum| f64::sqrt(sum / count))
    }

    #[test]
    fn the_pressure_points_spread_as_measured() {
        let [ahead_m, fraction] = spread(&Realism::REALISTIC);
        assert!((0.018..0.022).contains(&ahead_m), "{ahead_m} m from the common line, 20 mm measured");
        // 7 mm sideways under each foot, 0.266 m between the ankles: 0.007/√2/0.266.
        assert!((0.0165..0.021).contains(&fraction), "{fraction}");
        let even = spread(&Realism::IDEAL);
        assert!(even[0] < 1e-9 && even[1] < 1e-9, "{even:?}");
    }

    #[test]
    fn the_forces_sum_to_the_ground_reaction_on_any_feet() {
        let mut worker = Worker::with_habits(Person::new(2, 1.77, 72.0), 2, Realism::SEVERE.habits(2));
        worker.go(1.0, crate::walk::Place { middle_m: Vector2::new(0.3, 0.2), heading_rad: 0.7 });
        for step in 0..80 {
            let body = worker.sample(0.1 * f64::from(step));
            for press_m in [[Vector2::zeros(); 2], [Vector2::new(-0.02, 0.01), Vector2::new(0.1, -0.02)]] {
                for off_m in [Vector2::zeros(), Vector2::new(0.05, 0.1), Vector2::new(-0.1, -0.4)] {
                    let cop_m = body.origin_m[Side::Left.foot().index()].xy() + off_m;
                    let feet = foot_forces(&body, press_m, cop_m, 800.0);
                    assert!(feet.iter().all(|foot| foot.force_n.z >= 0.0), "{feet:?}");
                    let sum_n: f64 = feet.iter().map(|foot| foot.force_n.z).sum();
                    let sum_nm: Vector2<f64> = feet.iter().map(|foot| foot.at_m.xy() * foot.force_n.z).sum();
                    assert!((sum_n - 800.0).abs() < 1e-9 && (sum_nm - cop_m * 800.0).norm() < 1e-9);
                }
            }
        }
    }
}
