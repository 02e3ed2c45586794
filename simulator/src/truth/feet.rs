//! The ground's force on each foot, from the balance of moments and the drawn rest ([`crate::feet`]).

use equipoise_core::body::Side;
use nalgebra::{Vector2, Vector3};

use super::Force;
use crate::dynamics::Wrench;
use crate::feet::FeetChange;
use crate::motion::BodyState;

/// No pressure points besides those of the body.
pub const NO_PRESS_M: [Vector2<f64>; 2] = [Vector2::new(0.0, 0.0); 2];

/// Whether the motion is that with the load, or the same motion without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Load {
    /// The hands carry it.
    Carried,
    /// They carry nothing.
    Removed,
}

/// A force and a couple on a segment.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// The force.
    pub force: Force,
    /// The couple, world axes, N m.
    pub couple_nm: Vector3<f64>,
}

/// The ground's wrench, divided between the left and right foot; arguments as those of [`foot_forces`].
///
/// The horizontal force and the moment about the vertical that the forces leave are divided as the vertical force is,
/// with the deviations of [`BodyState::feet`].
pub fn foot_contacts(
    body: &BodyState,
    press_m: [Vector2<f64>; 2],
    ground: &Wrench,
    load: Load,
) -> [Contact; 2] {
    let vertical_n = ground.force_n.z;
    let feet = foot_forces(body, press_m, ground.cop_m(), vertical_n, load);
    let fraction = feet.map(|foot| foot.force_n.z / vertical_n);
    let apart = 4.0 * fraction[0] * fraction[1];
    let divide = |deviation: f64| [fraction[0] + apart * deviation, fraction[1] - apart * deviation];
    let (shear, free_moment) = (divide(body.feet.shear), divide(body.feet.free_moment));
    let force = |k: usize| {
        let level_n = ground.force_n.xy() * shear[k];
        Force { force_n: level_n.push(feet[k].force_n.z), ..feet[k] }
    };
    let forces = [force(0), force(1)];
    let by_forces_nm: f64 = forces.iter().map(|force| force.at_m.cross(&force.force_n).z).sum();
    let free_nm = Vector3::z() * (ground.moment_nm.z - by_forces_nm);
    [0, 1].map(|k: usize| Contact { force: forces[k], couple_nm: free_nm * free_moment[k] })
}

/// The ground's vertical forces on the left and right foot, with their points of action, for a centre of pressure and a
/// vertical force.
///
/// Along the line between the ankles each foot presses at a given place, and the balance of moments gives its fraction
/// of the force; if no fraction in [0, 1] balances, both places shift equally. Across that line one foot presses ahead
/// of the centre of pressure and the other behind it, by distances in the inverse ratio of the forces. Both places are
/// given by [`BodyState::feet`] and by `press_m` (from the ankle, world axes, m). Without the load all of this deviates by
/// [`crate::feet::FeetDivision::change`]. A foot in the air carries nothing.
pub fn foot_forces(
    body: &BodyState,
    press_m: [Vector2<f64>; 2],
    cop_m: Vector2<f64>,
    vertical_n: f64,
    load: Load,
) -> [Force; 2] {
    let change = match load {
        Load::Carried => FeetChange::NONE,
        Load::Removed => body.feet.change.by(body.load_kg),
    };
    let (fraction, at_m) = match body.foot_stands {
        [true, false] => ([1.0, 0.0], [cop_m; 2]),
        [false, true] => ([0.0, 1.0], [cop_m; 2]),
        _ => both_stand(body, press_m, cop_m, &change),
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
    change: &FeetChange,
) -> ([f64; 2], [Vector2<f64>; 2]) {
    let ankle_m = Side::BOTH.map(|side| body.origin_m[side.foot().index()].xy());
    let aside = (ankle_m[0] - ankle_m[1]).normalize();
    let ahead = Vector2::new(aside.y, -aside.x);
    let place_m: [f64; 2] = std::array::from_fn(|k| {
        let left = body.world_from_segment[Side::BOTH[k].foot().index()] * Vector3::y();
        let outward_m = if k == 0 { change.aside_m } else { -change.aside_m };
        aside.dot(&(ankle_m[k] + press_m[k] + left.xy() * body.feet.aside_m[k])) + outward_m
    });
    let left = ((aside.dot(&cop_m) - place_m[1]) / (place_m[0] - place_m[1])).clamp(0.0, 1.0);
    let left = (left + 4.0 * left * (1.0 - left) * change.fraction).clamp(0.0, 1.0);
    let fraction = [left, 1.0 - left];
    let shift_m = aside.dot(&cop_m) - fraction[0] * place_m[0] - fraction[1] * place_m[1];
    let ahead_m = body.feet.ahead_m + change.ahead_m + 0.5 * ahead.dot(&(press_m[0] - press_m[1]));
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
                let feet = foot_forces(&truth.body, NO_PRESS_M, truth.com_m.xy(), weight_n, Load::Carried);
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

    /// Root mean square over many people who stand with a load of this mass: what its removal changes of the left foot's
    /// fraction, and of its distance ahead of the common line, m, at one centre of pressure and force.
    fn change(realism: &Realism, load_kg: f64) -> [f64; 2] {
        let (mut square, mut count) = ([0.0; 2], 0.0);
        for seed in 0..300 {
            let worker = Worker::with_habits(Person::new(seed, 1.77, 72.0), seed, realism.habits(seed));
            for time_s in [0.0, 40.0, 80.0] {
                let body = BodyState { load_kg, ..worker.sample(time_s) };
                let [left_m, right_m] = Side::BOTH.map(|side| body.origin_m[side.foot().index()].xy());
                let cop_m = 0.5 * (left_m + right_m);
                let left = |load: Load| {
                    let [left, _] = foot_forces(&body, NO_PRESS_M, cop_m, 1.0, load);
                    Vector2::new(left.force_n.z, left.at_m.x)
                };
                let off = left(Load::Removed) - left(Load::Carried);
                square = std::array::from_fn(|k| square[k] + off[k] * off[k]);
                count += 1.0;
            }
        }
        square.map(|sum| f64::sqrt(sum / count))
    }

    #[test]
    fn without_the_load_the_feet_divide_the_force_otherwise_in_proportion_to_the_load() {
        let [fraction, ahead_m] = change(&Realism::REALISTIC, 11.3);
        assert!((0.018..0.022).contains(&fraction) && (0.0045..0.0057).contains(&ahead_m), "{ahead_m}");
        let [less, less_m] = change(&Realism::REALISTIC, 2.26);
        assert!((0.19..0.21).contains(&(less / fraction)) && (0.19..0.21).contains(&(less_m / ahead_m)));
        assert_eq!(change(&Realism::REALISTIC, 0.0), [0.0; 2]);
        assert_eq!(change(&Realism::IDEAL, 11.3), [0.0; 2]);
    }

    #[test]
    fn the_parts_of_a_wrench_sum_to_it_on_any_feet() {
        let mut worker = Worker::with_habits(Person::new(2, 1.77, 72.0), 2, Realism::SEVERE.habits(2));
        worker.lift(9.0, 0.2);
        worker.go(1.0, crate::walk::StandingPosition { middle_m: Vector2::new(0.3, 0.2), heading_rad: 0.7 });
        let presses_m = [NO_PRESS_M, [Vector2::new(-0.02, 0.01), Vector2::new(0.1, -0.02)]];
        let offs_m = [[0.0, 0.0], [0.05, 0.1], [-0.1, -0.4]].map(Vector2::from);
        for step in 0..80 {
            let body = worker.sample(0.1 * f64::from(step));
            let ankle_m = body.origin_m[Side::Left.foot().index()].xy();
            for (press_m, off_m) in presses_m.iter().flat_map(|press_m| offs_m.map(|off_m| (*press_m, off_m)))
            {
                let force_n = Vector3::new(30.0, -20.0, 800.0);
                let mut whole = Wrench::at((ankle_m + off_m).push(0.0), force_n);
                whole.moment_nm.z += 7.0;
                for load in [Load::Carried, Load::Removed] {
                    let feet = foot_contacts(&body, press_m, &whole, load);
                    assert!(feet.iter().all(|foot| foot.force.force_n.z >= 0.0), "{feet:?}");
                    let sum_n: Vector3<f64> = feet.iter().map(|foot| foot.force.force_n).sum();
                    let moment_nm =
                        |foot: &Contact| foot.force.at_m.cross(&foot.force.force_n) + foot.couple_nm;
                    let sum_nm: Vector3<f64> = feet.iter().map(moment_nm).sum();
                    let off = [sum_n - whole.force_n, sum_nm - whole.moment_nm];
                    assert!(off.iter().all(|off| off.norm() < 1e-9), "{off:?}");
                }
            }
        }
    }
}
