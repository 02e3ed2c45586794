use super::*;
use crate::body::{Anthropometry, Segment, Sex};

const HEIGHT_M: f64 = 1.77;

fn body() -> Body {
    let skeleton = Skeleton::nominal(HEIGHT_M);
    let table = Anthropometry::de_leva(&skeleton, HEIGHT_M, Sex::Male);
    Body {
        skeleton,
        grip_m: Side::BOTH.map(|side| table.grip_m(side.hand())),
        phi: Phi::of(&skeleton, &table),
        cop_sigma_m: 0.005,
        mass_kg: 75.0,
        limits: TorqueLimits::of(Sex::Male),
        fatigue: [0.0; JOINTS],
    }
}

const PART: Part = Part { mass_kg: 6.0, mass_sigma_kg: 0.1, width_m: 0.35, slope_rad: None };

fn feet() -> FootPlacement {
    FootPlacement::natural(HEIGHT_M)
}

fn at(x: f64, y: f64, z: f64) -> Result<Prediction, Infeasible> {
    predict(&body(), &feet(), &PART, Vector3::new(x, y, z))
}

#[test]
fn hands_hold_the_part_feet_stay_and_the_body_is_balanced() {
    for (x, y, z) in [(0.35, 0.0, 1.0), (0.5, 0.0, 1.2), (0.4, 0.25, 0.9), (0.35, -0.2, 1.5), (0.4, 0.0, 0.4)]
    {
        let prediction = at(x, y, z).unwrap_or_else(|why| panic!("{x} {y} {z}: {}", why.name()));
        let pose = &prediction.pose;
        let grips = Side::BOTH.map(|side| pose.point_on(side.hand(), body().grip_m[side as usize]));
        assert!((0.5 * (grips[0] + grips[1]) - Vector3::new(x, y, z)).norm() < 0.01, "{grips:?}");
        assert!((0.34..0.36).contains(&(grips[0] - grips[1]).y), "{grips:?}");
        for segment in Segment::ALL {
            let Some(parent) = segment.parent() else { continue };
            let bone_m =
                pose.offset_in(parent, segment) - Vector3::from(body().skeleton.offset_m[segment.index()]);
            assert!(bone_m.norm() < 1e-3, "{segment:?} {bone_m:?}");
        }
        assert_eq!(Side::BOTH.map(|side| pose.origin_of(side.foot())), feet().ankle_m);
        // Segment by segment, not by the parameters of the prediction.
        let table = Anthropometry::de_leva(&body().skeleton, HEIGHT_M, Sex::Male);
        let of_segment = |segment: Segment| {
            pose.point_on(segment, table.com_m[segment.index()]) * table.mass_fraction[segment.index()]
        };
        let com: Vector3<f64> = Segment::ALL.into_iter().map(of_segment).sum();
        let (body_kg, part_kg) = (body().mass_kg, PART.mass_kg);
        let cop = (com * body_kg + Vector3::new(x, y, z) * part_kg) / (body_kg + part_kg);
        assert!((0.0..0.12).contains(&cop.x) && cop.y.abs() < 0.06, "{cop:?}");
    }
}

#[test]
fn turned_and_moved_feet_have_the_same_overload() {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.1);
    let by = Vector3::new(0.7, -1.3, 0.0);
    let feet = feet();
    let moved = FootPlacement {
        ankle_m: feet.ankle_m.map(|ankle| turn * ankle + by),
        world_from_foot: feet.world_from_foot.map(|foot| turn * foot),
    };
    let place = Vector3::new(0.45, 0.1, 1.1);
    let here = predict(&body(), &feet, &PART, place).unwrap();
    let there = predict(&body(), &moved, &PART, turn * place + by).unwrap();
    assert!((here.worst_ratio.value - there.worst_ratio.value).abs() < 1e-4);
    assert!((here.worst_ratio.sigma - there.worst_ratio.sigma).abs() < 1e-3 * here.worst_ratio.sigma);
}

#[test]
fn the_feet_of_a_pose_and_places_relative_to_them_are_the_ones_it_was_made_in() {
    let pose = at(0.4, 0.0, 1.0).unwrap().pose;
    let found = FootPlacement::of_segments(&pose.origin.map(Into::into));
    for (foot, made) in found.world_from_foot.iter().zip(feet().world_from_foot) {
        assert!(foot.angle_to(&made) < 1e-9);
    }
    assert_eq!(found.ankle_m, feet().ankle_m);
    let place = Vector3::new(0.4, 0.1, 1.0);
    assert!((found.world_m(place, HEIGHT_M) - place).norm() < 1e-9);
}

#[test]
fn hands_follow_the_slope_of_the_handles_which_relieves_the_wrists() {
    let place = Vector3::new(0.35, 0.0, 0.9);
    let hold =
        |slope_rad: Option<f64>| predict(&body(), &feet(), &PART.with_slope(slope_rad), place).unwrap();
    let slope_rad = |prediction: &Prediction, segment: Segment| {
        let along = prediction.pose.world_from_segment[segment.index()] * Vector3::y();
        (-along.z).asin()
    };
    let free = hold(None);
    let off_rad = slope_rad(&free, Segment::LeftHand) - slope_rad(&free, Segment::LeftForearm);
    assert!(off_rad.abs() < 1e-6, "{off_rad}");
    let wrist = Joint::named("LeftWrist").unwrap().index();
    let mut before = f64::INFINITY;
    for wanted_rad in search::SLOPES_RAD {
        let prediction = hold(Some(wanted_rad));
        let found_rad = slope_rad(&prediction, Segment::LeftHand);
        assert!((found_rad - wanted_rad).abs() < 0.2, "{wanted_rad} {found_rad}");
        assert!(prediction.limit_ratio[wrist] < before, "{wanted_rad}");
        before = prediction.limit_ratio[wrist];
    }
    assert!(before < 0.7 * hold(Some(0.0)).limit_ratio[wrist]);
    // No wrist and no arm follows handles that point at the body.
    let behind = predict(&body(), &feet(), &PART.with_slope(Some(2.6)), place);
    assert_eq!(behind.err(), Some(Infeasible::OutOfReach));
}

#[test]
fn overload_grows_with_distance_and_mass_and_fatigue() {
    let (near, far) = (at(0.35, 0.0, 1.1).unwrap(), at(0.6, 0.0, 1.1).unwrap());
    for name in ["L5S1", "LeftShoulder", "RightKnee"] {
        let joint = Joint::named(name).unwrap().index();
        assert!(
            far.limit_ratio[joint] > 1.2 * near.limit_ratio[joint],
            "{name}: {} {}",
            far.limit_ratio[joint],
            near.limit_ratio[joint]
        );
    }
    let place = Vector3::new(0.45, 0.0, 1.1);
    let limit_ratio =
        |body: &Body, part: &Part| predict(body, &feet(), part, place).unwrap().worst_ratio.value;
    let usual = limit_ratio(&body(), &PART);
    assert!(limit_ratio(&body(), &Part { mass_kg: 12.0, ..PART }) > 1.8 * usual);
    let mut tired = body();
    tired.fatigue = [0.5; JOINTS];
    assert!((limit_ratio(&tired, &PART) - 2.0 * usual).abs() < 1e-9);
}

#[test]
fn places_out_of_reach_are_refused() {
    assert_eq!(at(1.6, 0.0, 1.0).unwrap_err(), Infeasible::OutOfReach);
    assert_eq!(at(0.3, 0.0, 2.9).unwrap_err(), Infeasible::OutOfReach);
    let heavy = Part { mass_kg: 80.0, ..PART };
    let far = predict(&body(), &feet(), &heavy, Vector3::new(0.6, 0.0, 1.0));
    assert_eq!(far.unwrap_err(), Infeasible::OutOfBalance);
}

#[test]
fn sigma_grows_with_that_of_mass_and_body_model() {
    let place = Vector3::new(0.5, 0.0, 1.1);
    let sigma = |body: &Body, part: &Part| predict(body, &feet(), part, place).unwrap().worst_ratio.sigma;
    let usual = sigma(&body(), &PART);
    assert!(sigma(&body(), &Part { mass_sigma_kg: 2.0, ..PART }) > usual);
    assert!(usual > 0.0);
}

#[test]
fn the_predicted_ratio_includes_all_fractions_of_the_part_in_the_hands() {
    let it = at(0.4, 0.0, 1.0).unwrap();
    assert!(it.worst.name().ends_with("Wrist"), "{}", it.worst.name());
    let even = it.limit_ratio[it.worst.index()];
    // The larger of η and 1 − η, uniform, is 3/4 on average with a variance of 1/48: over 1/2.
    assert!((it.worst_ratio.value / even - 1.5).abs() < 0.02, "{} {even}", it.worst_ratio.value);
    assert!(it.worst_ratio.sigma > 2.0 * (1.0_f64 / 48.0).sqrt() * even, "{}", it.worst_ratio.sigma);
}

#[test]
fn the_places_of_grips_and_load_in_the_hands_are_part_of_sigma() {
    let place = Vector3::new(0.4, 0.0, 1.0);
    let (body, feet) = (body(), feet());
    let holding = Holding {
        body: &body,
        feet: &feet,
        part: &PART,
        at_m: place,
        world_from_feet: feet.world_from_feet(),
    };
    let pose = predict(&body, &feet, &PART, place).unwrap().pose;
    let grip_m = Side::BOTH.map(|side| pose.point_on(side.hand(), body.grip_m[side as usize]));
    let wrist = Joint::named("LeftWrist").unwrap().index();
    let even = holding.limit_ratios(&pose, grip_m, &Changed::NONE)[wrist];
    let farther = Changed { ahead_m: AHEAD_SIGMA_M, ..Changed::NONE };
    let more = holding.limit_ratios(&pose, grip_m, &farther)[wrist] / even;
    // 14 mm more than the distance from the wrist to the grip, some 80 mm, and the 25 mm ahead of it.
    assert!((1.08..1.25).contains(&more), "{more}");
    let by_grip = holding.contact_sigmas(&pose, grip_m)[wrist] / even;
    assert!((0.05..0.2).contains(&by_grip), "{by_grip}");
}

/// The best place of a search is as good as the best of all places.
fn assert_search_is_complete(mass_kg: f64, experience: &experience::Experience) {
    use search::{Planning, REGION_M, places};
    let (feet, body, part) = (feet(), body(), Part { mass_kg, ..PART });
    let planning = Planning { body: &body, height_m: HEIGHT_M, feet: &feet, part: &part, experience };
    let value =
        |place_m| planning.at_best_slope(place_m).predicted.map_or(f64::INFINITY, |(_, ratio)| ratio.value);
    let lowest = places(REGION_M).map(value).fold(f64::INFINITY, f64::min);
    let best = planning.best().unwrap();
    assert!(best.predicted.unwrap().1.value < 1.001 * lowest, "{best:?} {lowest}");
    assert!((feet.place_m(best.position_m, HEIGHT_M) - best.place_m).norm() < 1e-12);
}

#[test]
fn the_search_finds_the_place_of_the_whole_map() {
    assert_search_is_complete(3.0, &experience::Experience::default());
}

#[test]
fn the_search_finds_the_place_of_the_whole_map_after_handovers() {
    let mut experience = experience::Experience::default();
    for (place_m, excess) in [([0.35, 0.0, 1.0], 0.5), ([0.4, 0.2, 1.2], -0.2), ([0.3, -0.2, 0.8], 0.1)] {
        experience.add(experience::Handover { place_m, excess, sigma: 0.0 });
    }
    assert_search_is_complete(6.0, &experience);
}

#[test]
fn a_part_that_is_too_heavy_has_no_place() {
    let part = Part { mass_kg: 500.0, ..PART };
    let (feet, body, experience) = (feet(), body(), experience::Experience::default());
    let planning = search::Planning {
        body: &body,
        height_m: HEIGHT_M,
        feet: &feet,
        part: &part,
        experience: &experience,
    };
    assert!(planning.best().is_none());
}
