//! Duration of a handover's plan, compared with the prediction at one place.
//!
//! Neither runs in the loop. `cargo bench -p equipoise-benches --bench handover`.

use std::hint::black_box;

use equipoise_benches::rounds::{Contender, compare};
use equipoise_benches::worker::{HEIGHT_M, MASS_KG};
use equipoise_core::body::{Anthropometry, JOINTS, Sex, Side, Skeleton};
use equipoise_core::handover::experience::{Experience, Handover};
use equipoise_core::handover::search::{PlacePrediction, Planning};
use equipoise_core::handover::{Body, FootPlacement, Part};
use equipoise_core::overload::TorqueLimits;
use equipoise_core::sesc::Phi;
use nalgebra::Vector3;

/// Masses of the parts, kg, from light to the heaviest that one person should lift often.
const PARTS_KG: [f64; 5] = [1.0, 3.0, 6.0, 12.0, 23.0];

fn main() {
    let skeleton = Skeleton::nominal(HEIGHT_M);
    let table = Anthropometry::de_leva(&skeleton, HEIGHT_M, Sex::Male);
    let body = Body {
        skeleton,
        grip_m: Side::BOTH.map(|side| table.grip_m(side.hand())),
        phi: Phi::of(&skeleton, &table),
        cop_sigma_m: 0.005,
        mass_kg: MASS_KG,
        limits: TorqueLimits::of(Sex::Male),
        fatigue: [0.0; JOINTS],
    };
    let feet = FootPlacement::natural(HEIGHT_M);
    let mut experience = Experience::default();
    for index in 0..16 {
        let place_m = [0.3 + 0.02 * f64::from(index), 0.2 - 0.02 * f64::from(index), 1.0];
        experience.add(Handover { place_m, excess: 0.05, sigma: 0.1 });
    }
    let parts = PARTS_KG.map(|mass_kg| Part { mass_kg, mass_sigma_kg: 0.1, width_m: 0.35, slope_rad: None });
    let planning =
        |part| Planning { body: &body, height_m: HEIGHT_M, feet: &feet, part, experience: &experience };
    let is_feasible = |place: Option<PlacePrediction>| place.is_some_and(|place| place.predicted.is_ok());
    assert!(parts.iter().all(|part| is_feasible(planning(part).best())), "every part can be held somewhere");

    let (mut all, mut one) = (parts.iter().cycle(), parts.iter().cycle());
    let mut contenders = [
        Contender::new("a prediction at one place", || {
            one.by_ref().take(1).for_each(|part| {
                black_box(planning(part).at(Vector3::new(0.45, 0.1, 1.1), Some(0.5)));
            });
        }),
        Contender::new("a plan: the best place of the region", || {
            all.by_ref().take(1).for_each(|part| {
                black_box(planning(part).best());
            });
        }),
    ];
    let mut criterion = equipoise_benches::criterion();
    if let [_, plan_us] = compare(&mut criterion, "handover", &mut contenders)[..] {
        println!("{:.0} plans a second\n", 1e6 / plan_us);
    }
    criterion.final_summary();
}
