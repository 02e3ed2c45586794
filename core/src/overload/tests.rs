//! Properties of the overload torques and their covariance.

extern crate std;

use super::*;
use crate::body::{SEGMENTS, Segment, Skeleton};
use nalgebra::UnitQuaternion;

const NO_SIGMA: LoadingSigma = LoadingSigma::EXACT;

fn t_pose() -> Pose<StationWorld> {
    let origin = Skeleton::nominal(1.77).t_pose_m();
    Pose::new(
        origin.map(|origin| Vector3::from(origin) + Vector3::new(0.0, 0.0, 0.96)),
        [UnitQuaternion::identity(); SEGMENTS],
    )
}

fn loaded(pose: &Pose<StationWorld>, load_n: f64) -> Loading {
    let weight_n = 700.0;
    let body = [0.05, 0.0];
    let grip_m = Side::BOTH.map(|side| pose.origin_of(side.hand()) + Vector3::new(0.3, 0.0, 0.0));
    let load = 0.5 * (grip_m[0] + grip_m[1]);
    let vertical_n = weight_n + load_n;
    let cop = |axis: usize| (body[axis] * weight_n + load[axis] * load_n) / vertical_n;
    let cop_measured_m = [cop(0), cop(1)];
    Loading {
        cop_measured_m,
        cop_estimated_m: body,
        vertical_n,
        delta_f_n: load_n,
        grip_m,
        eta: [0.5; 2],
        feet: FootLoads::Common { zeta: [0.5; 2] },
        deviation: FootDeviation::NONE,
        swing: Swing::NONE,
    }
}

#[test]
fn no_load_no_overload() {
    let pose = t_pose();
    for torque in torques(&pose, &loaded(&pose, 0.0), &NO_SIGMA) {
        assert_eq!((torque.torque_nm, torque.sigma_nm), (Vector3::zeros(), 0.0));
    }
}

#[test]
fn a_wrist_carries_its_share_of_the_load_on_its_arm() {
    let pose = t_pose();
    let torque = torques(&pose, &loaded(&pose, 40.0), &NO_SIGMA);
    let wrist = torque[Joint::named("LeftWrist").unwrap().index()].torque_nm;
    // 20 N at 0.3 m in front of the joint.
    assert!((wrist - Vector3::new(0.0, -6.0, 0.0)).norm() < 1e-12, "{wrist}");
    assert_eq!(torque[Joint::named("C1Head").unwrap().index()].torque_nm, Vector3::zeros());
}

#[test]
fn the_pelvis_is_in_balance() {
    // About any common point, the moments of trunk and both legs on the pelvis must cancel: shift the three joints'
    // torques to the pelvis' origin and add them.
    let pose = t_pose();
    let loading = loaded(&pose, 60.0);
    let torque = torques(&pose, &loading, &NO_SIGMA);
    let at = |name: &str| Joint::named(name).unwrap();
    let arm = |name: &str| pose.origin_of(at(name).segment()) - pose.origin_of(Segment::Pelvis);
    let up = Vector3::new(0.0, 0.0, loading.delta_f_n);
    let spine = torque[at("L5S1").index()].torque_nm + arm("L5S1").cross(&up);
    let legs: Vector3<f64> = ["LeftHip", "RightHip"]
        .map(|name| torque[at(name).index()].torque_nm - arm(name).cross(&(0.5 * up)))
        .iter()
        .sum();
    assert!((spine + legs).norm() < 1e-9, "{spine} {legs}");
}

#[test]
fn the_pelvis_is_in_balance_while_load_and_body_accelerate() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    loading.grip_m[1].y += 0.4;
    loading.feet = FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] };
    loading.swing = Swing { force_n: [7.0, -4.0], body_n: [-30.0, 45.0], surface_z_m: 0.0 };
    let load_m = 0.5 * (loading.grip_m[0] + loading.grip_m[1]);
    let weight_n = loading.weight_n();
    for axis in 0..2 {
        let moment = loading.cop_estimated_m[axis] * weight_n + load_m[axis] * loading.delta_f_n
            - load_m.z * loading.swing.force_n[axis];
        loading.cop_measured_m[axis] = moment / loading.vertical_n;
    }
    let torque = torques(&pose, &loading, &NO_SIGMA);
    let at = |name: &str| Joint::named(name).unwrap();
    let arm = |name: &str| pose.origin_of(at(name).segment()) - pose.origin_of(Segment::Pelvis);
    let [load_x, load_y] = loading.swing.force_n;
    let [body_x, body_y] = loading.swing.body_n;
    let load_n = Vector3::new(load_x, load_y, loading.delta_f_n);
    let body_n = Vector3::new(body_x, body_y, weight_n);
    let feet = loading.foot_reactions(&pose);
    assert!((feet[0].with_n / loading.vertical_n - feet[0].without_n / weight_n).abs() > 0.02, "{feet:?}");
    let spine = torque[at("L5S1").index()].torque_nm + arm("L5S1").cross(&load_n);
    let legs: Vector3<f64> = [("LeftHip", &feet[0]), ("RightHip", &feet[1])]
        .map(|(name, foot)| {
            let with_n = (load_n + body_n) * (foot.with_n / loading.vertical_n);
            let more_n = with_n - body_n * (foot.without_n / weight_n);
            torque[at(name).index()].torque_nm - arm(name).cross(&more_n)
        })
        .iter()
        .sum();
    assert!((spine + legs).norm() < 1e-9, "{spine} {legs}");
}

#[test]
fn the_sigma_of_eta_affects_arms_and_not_legs() {
    let pose = t_pose();
    let loading = loaded(&pose, 60.0);
    let torque = torques(&pose, &loading, &LoadingSigma { eta: 0.1, ..NO_SIGMA });
    let sigma_nm = |name: &str| torque[Joint::named(name).unwrap().index()].sigma_nm;
    // A tenth of 60 N at 0.3 m in front of the wrist.
    assert!((sigma_nm("RightWrist") - 1.8).abs() < 1e-9, "{}", sigma_nm("RightWrist"));
    assert_eq!(sigma_nm("RightHip"), 0.0);
}

/// Root of the sum of both axes' variances of a joint's torque, N m.
fn spread_nm(torque: &[Torque; JOINTS], name: &str) -> f64 {
    let [xx, _, yy] = torque[Joint::named(name).unwrap().index()].covariance_nm2;
    math::sqrt(xx + yy)
}

#[test]
fn the_sigma_of_a_foot_affects_its_leg_alone() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    loading.feet = FootLoads::Fractions { zeta: [0.5; 2], press_m: [[0.0; 2]; 2] };
    let sigma = LoadingSigma { zeta: 0.05, ..NO_SIGMA };
    let spread_nm = |name: &str| spread_nm(&torques(&pose, &loading, &sigma), name);
    assert_eq!((spread_nm("RightWrist"), spread_nm("L5S1")), (0.0, 0.0));
    let mut shifted = loading;
    shifted.feet = FootLoads::Fractions { zeta: [0.45, 0.55], press_m: [[0.0; 2]; 2] };
    let hip = Joint::named("RightHip").unwrap().index();
    let at_hip = |loading| torques(&pose, loading, &NO_SIGMA)[hip].torque_nm;
    let change = (at_hip(&shifted) - at_hip(&loading)).norm();
    assert!((spread_nm("RightHip") - change).abs() < 1e-9, "{change}");
}

#[test]
fn an_error_of_the_position_changes_legs_and_not_arms() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    loading.feet = FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] };
    let sigma = LoadingSigma { position_m: [0.01, 0.0], ..NO_SIGMA };
    let at = |name: &str| spread_nm(&torques(&pose, &loading, &sigma), name);
    // Half of the load's 60 N on each foot, one centimetre sideways.
    assert!((at("LeftKnee") - 0.3).abs() < 1e-9, "{}", at("LeftKnee"));
    assert_eq!((at("RightElbow"), at("L5S1")), (0.0, 0.0));
    // An error of the stance moves the estimate with the body: then only the measured force acts at another point.
    let along = LoadingSigma { cop_estimated_m: [0.01, 0.0], position_by_estimate: [1.0, 0.0], ..NO_SIGMA };
    let knee_nm = spread_nm(&torques(&pose, &loading, &along), "LeftKnee");
    assert!((knee_nm - 0.5 * 760.0 * 0.01).abs() < 1e-9, "{knee_nm}");
}

#[test]
fn an_orientation_error_propagates_to_all_joints_up_to_the_pelvis() {
    let pose = t_pose();
    let sigma = LoadingSigma { orientation_rad: 0.01, ..NO_SIGMA };
    let at = |name: &str| spread_nm(&torques(&pose, &loaded(&pose, 60.0), &sigma), name);
    let length_m = |from: Segment, to: Segment| (pose.origin_of(to) - pose.origin_of(from)).norm();
    let forearm_m = length_m(Segment::RightForearm, Segment::RightHand);
    let upper_arm_m = length_m(Segment::RightUpperArm, Segment::RightForearm);
    let leg_m = math::hypot([
        length_m(Segment::LeftUpperLeg, Segment::LeftLowerLeg),
        length_m(Segment::LeftLowerLeg, Segment::LeftFoot),
    ]);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
    // Half of the load's 60 N, one hundredth of each length across the segment: one horizontal axis of a level arm,
    // both of a vertical leg.
    assert_eq!((at("RightWrist"), at("RightAnkle")), (0.0, 0.0));
    near(at("RightElbow"), 0.3 * forearm_m);
    near(at("RightShoulder"), 0.3 * math::hypot([forearm_m, upper_arm_m]));
    near(at("LeftHip"), 0.3 * leg_m * core::f64::consts::SQRT_2);
}

#[test]
fn a_common_error_of_origins_counts_once_at_every_joint() {
    let (pose, mut origin_m) = (t_pose(), [Vector3::zeros(); SEGMENTS]);
    origin_m[Segment::RightHand.index()] = Vector3::new(0.0, 0.02, 0.0);
    origin_m[Segment::RightForearm.index()] = Vector3::new(0.0, 0.02, 0.0);
    let sigma = LoadingSigma { origin_m, ..NO_SIGMA };
    let at = |name: &str| spread_nm(&torques(&pose, &loaded(&pose, 60.0), &sigma), name);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
    // The forearm moves with the hand; half of the load's 60 N.
    assert_eq!((at("RightWrist"), at("LeftElbow"), at("LeftHip")), (0.0, 0.0, 0.0));
    near(at("RightElbow"), 0.0);
    near(at("RightShoulder"), 30.0 * 0.02);
}

#[test]
fn the_sigma_of_the_grip_counts_along_and_across_the_hand() {
    let pose = t_pose();
    let sigma = LoadingSigma { grip_m: [0.01, 0.02, 0.5], ..NO_SIGMA };
    let torque = torques(&pose, &loaded(&pose, 60.0), &sigma);
    // The hand of a T-pose lies along Y, its palm down; half of the load's 60 N.
    let [xx, xy, yy] = torque[Joint::named("RightWrist").unwrap().index()].covariance_nm2;
    assert!((xx - 0.36).abs() < 1e-9 && xy.abs() < 1e-9 && (yy - 0.09).abs() < 1e-9, "{xx} {xy} {yy}");
}

#[test]
fn the_sigma_of_eta_includes_the_horizontal_force_of_an_accelerated_load() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    loading.grip_m[1].z -= 0.4;
    loading.swing.force_n = [12.0, -5.0];
    let torque = torques(&pose, &loading, &LoadingSigma { eta: 0.1, ..NO_SIGMA });
    loading.eta = [loading.eta[0] - 0.1, loading.eta[1] + 0.1];
    let moved = torques(&pose, &loading, &NO_SIGMA);
    let shoulder = Joint::named("RightShoulder").unwrap().index();
    let off_nm = moved[shoulder].torque_nm - torque[shoulder].torque_nm;
    let [xx, xy, yy] = torque[shoulder].covariance_nm2;
    let expected = [off_nm.x * off_nm.x, off_nm.x * off_nm.y, off_nm.y * off_nm.y];
    for (found, expected) in [xx, xy, yy].into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

#[test]
fn a_hand_with_zero_eta_has_the_sigma_of_a_possible_load() {
    let pose = t_pose();
    let loading = Loading { eta: [1.0, 0.0], ..loaded(&pose, 60.0) };
    let sigma = LoadingSigma { grip_m: [0.01; 3], load_ahead_m: [0.02, 0.0], eta: 0.2, ..NO_SIGMA };
    let at_wrist = |sigma: &LoadingSigma| {
        torques(&pose, &loading, sigma)[Joint::named("RightWrist").unwrap().index()].covariance_nm2
    };
    let only_eta = at_wrist(&LoadingSigma { eta: 0.2, ..NO_SIGMA });
    let own = core::array::from_fn::<f64, 3, _>(|part| at_wrist(&sigma)[part] - only_eta[part]);
    // √3 times 0.2 of 60 N, 10 mm along both axes and 20 mm more along x.
    let expected = [3.0 * 12.0 * 12.0 * 1e-4, 0.0, 3.0 * 12.0 * 12.0 * 5e-4];
    for (found, expected) in own.into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{own:?}");
    }
}

#[test]
fn the_sigma_of_the_heading_rotates_the_torque_and_a_large_one_shortens_it() {
    let (pose, shoulder) = (t_pose(), Joint::named("RightShoulder").unwrap().index());
    let of = |heading_rad: f64| {
        torques(&pose, &loaded(&pose, 60.0), &LoadingSigma { heading_rad, ..NO_SIGMA })[shoulder]
    };
    let [x, y, _] = of(0.0).torque_nm.into();
    let length_nm = x.hypot(y);
    // Along and across the torque.
    let parts = |[xx, xy, yy]: [f64; 3]| {
        let along = (x * x * xx + 2.0 * x * y * xy + y * y * yy) / (length_nm * length_nm);
        [math::sqrt(along), math::sqrt(xx + yy - along)].map(|part_nm| part_nm / length_nm)
    };
    let [along, across] = parts(of(0.01).covariance_nm2);
    assert!(along < 1e-4 && (across - 0.01).abs() < 1e-5, "{along} {across}");
    // A turn by φ changes the length along the torque by 1 − cos φ, on average φ²/2: its root mean square is √3/2 σ².
    let [along, across] = parts(of(0.3).covariance_nm2);
    assert!((along / (0.75_f64.sqrt() * 0.09) - 1.0).abs() < 0.1, "{along}");
    assert!((across / 0.3 - 1.0).abs() < 0.1, "{across}");
}

#[test]
fn the_sigma_of_zeta_follows_from_the_points_of_action_under_the_feet() {
    let pose = t_pose();
    let [left, right] = Side::BOTH.map(|side| pose.origin_of(side.foot()).y);
    let mut loading = loaded(&pose, 60.0);
    loading.feet = FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] };
    loading.cop_measured_m[1] = 0.5 * (left + right);
    assert_eq!(zeta_sigma(&pose, &loading, &NO_SIGMA), 0.0);
    let sigma = LoadingSigma { press_m: [0.0, 1e-5], ..NO_SIGMA };
    // Each foot moves the middle by half of its own error.
    let expected = 1e-5 * core::f64::consts::FRAC_1_SQRT_2 / (left - right).abs();
    let found = zeta_sigma(&pose, &loading, &sigma);
    assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    // One foot ahead of the common line and the other behind it by as much leave ζ unchanged.
    assert_eq!(zeta_sigma(&pose, &loading, &LoadingSigma { press_m: [0.02, 0.0], ..NO_SIGMA }), 0.0);
}

#[test]
fn the_forward_sigma_of_the_feet_is_the_distance_of_each_from_the_common_line() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    let no_press = [[0.0; 2]; 2];
    let sigma = LoadingSigma { press_m: [0.02, 0.0], ..NO_SIGMA };
    for feet in [
        FootLoads::Geometry { press_m: no_press, stands: [true; 2] },
        FootLoads::Fractions { zeta: [0.5; 2], press_m: no_press },
    ] {
        loading.feet = feet;
        // Half of the load's 60 N on each foot, 20 mm ahead of or behind the common line.
        for name in ["LeftAnkle", "RightHip"] {
            let found = spread_nm(&torques(&pose, &loading, &sigma), name);
            assert!((found - 30.0 * 0.02).abs() < 1e-9, "{feet:?} {name}: {found}");
        }
        assert_eq!(spread_nm(&torques(&pose, &loading, &sigma), "L5S1"), 0.0);
    }
    loading.feet = FootLoads::Measured { zeta: [0.5; 2], cop_m: [[0.05, 0.1], [0.05, -0.1]] };
    assert_eq!(spread_nm(&torques(&pose, &loading, &sigma), "LeftAnkle"), 0.0);
}

#[test]
fn a_contradiction_about_the_load_s_place_displaces_measured_feet_too() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    let cop_m = Side::BOTH.map(|side| [loading.cop_measured_m[0], pose.origin_of(side.foot()).y]);
    let sigma = LoadingSigma { contradiction_m: 0.1, ..NO_SIGMA };
    let [by_geometry_nm, measured_nm] = [
        FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] },
        FootLoads::Measured { zeta: [0.5; 2], cop_m },
    ]
    .map(|feet| {
        loading.feet = feet;
        spread_nm(&torques(&pose, &loading, &sigma), "LeftAnkle")
    });
    assert!(by_geometry_nm > 1.0 && measured_nm > 0.5 * by_geometry_nm, "{by_geometry_nm} {measured_nm}");
}

#[test]
fn the_sigma_of_the_division_without_the_load_counts_with_the_body_s_weight_in_legs_alone() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    let cop_m = Side::BOTH.map(|side| [loading.cop_measured_m[0], pose.origin_of(side.foot()).y]);
    for feet in [
        FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] },
        FootLoads::Measured { zeta: [0.5; 2], cop_m },
    ] {
        loading.feet = feet;
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        // Half of 700 N, 5 mm ahead and behind; 2 mm to each side.
        let sigma = LoadingSigma { unloaded_press_m: [0.005, 0.002], ..NO_SIGMA };
        let torque = torques(&pose, &loading, &sigma);
        near(spread_nm(&torque, "LeftAnkle"), 350.0 * math::hypot([0.005, 0.002]));
        assert_eq!(spread_nm(&torque, "L5S1"), 0.0);
        let torque = torques(&pose, &loading, &LoadingSigma { unloaded_zeta: 0.02, ..NO_SIGMA });
        let deviation = FootDeviation { unloaded_zeta: 0.02, ..FootDeviation::NONE };
        let moved = torque_vectors(&pose, &Loading { deviation, ..loading });
        let hip = Joint::named("RightHip").unwrap().index();
        let change_nm = (moved[hip] - torque[hip].torque_nm).norm();
        assert!(change_nm > 0.5, "{change_nm}");
        near(spread_nm(&torque, "RightHip"), change_nm);
        assert_eq!((spread_nm(&torque, "RightWrist"), spread_nm(&torque, "L5S1")), (0.0, 0.0));
    }
}

#[test]
fn the_sigma_of_the_shear_counts_with_the_load_s_swing_times_the_height_of_the_joint() {
    let pose = t_pose();
    let mut loading = loaded(&pose, 60.0);
    loading.feet = FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] };
    loading.swing = Swing { force_n: [12.0, 0.0], body_n: [0.0; 2], surface_z_m: 0.0 };
    let torque = torques(&pose, &loading, &LoadingSigma { shear: 0.1, ..NO_SIGMA });
    for name in ["LeftHip", "RightKnee"] {
        let height_m = pose.origin_of(Joint::named(name).unwrap().segment()).z;
        let found = spread_nm(&torque, name);
        assert!((found - 0.1 * 12.0 * height_m).abs() < 1e-9, "{name}: {found}");
    }
    assert_eq!(spread_nm(&torque, "RightShoulder"), 0.0);
}

#[test]
fn sigma_is_the_spread_of_the_magnitude() {
    let pose = t_pose();
    let loading = loaded(&pose, 60.0);
    let sigma = LoadingSigma { cop_measured_m: 0.0, cop_estimated_m: [1e-7, 0.0], ..NO_SIGMA };
    let base = torques(&pose, &loading, &sigma);
    let mut moved = loading;
    moved.cop_estimated_m[0] += 1e-7;
    let shifted = torques(&pose, &moved, &sigma);
    for joint in Joint::ALL {
        let change = shifted[joint.index()].torque_nm.norm() - base[joint.index()].torque_nm.norm();
        assert!((change.abs() - base[joint.index()].sigma_nm).abs() < 1e-9, "{}", joint.name());
    }
}

#[test]
fn sigma_of_a_length_is_the_spread_of_many_lengths() {
    // Evenly spaced quantiles of a normal error, by its inverse distribution function, on both axes of an ellipse.
    let quantiles: std::vec::Vec<f64> =
        (0..200).map(|index| normal_quantile((f64::from(index) + 0.5) / 200.0)).collect();
    let [along_nm, across_nm] = [2.0, 12.0];
    for length_nm in [0.0, 1.0, 5.0, 12.0, 30.0, 100.0] {
        let squares = quantiles.iter().flat_map(|x| {
            quantiles.iter().map(move |y| {
                let error = math::hypot([length_nm + along_nm * x, across_nm * y]) - length_nm;
                error * error
            })
        });
        let spread_nm = math::sqrt(squares.sum::<f64>() / (200.0 * 200.0));
        let sigma_nm = sigma_of_length([length_nm, 0.0], [along_nm * along_nm, 0.0, across_nm * across_nm]);
        assert!((0.9..1.12).contains(&(sigma_nm / spread_nm)), "{length_nm}: {sigma_nm} for {spread_nm}");
    }
    assert_eq!(sigma_of_length([0.0; 2], [0.0; 3]), 0.0);
}

/// By bisection of the distribution function, which is integrated in steps of 0.001.
fn normal_quantile(probability: f64) -> f64 {
    let (mut value, mut below) = (-6.0_f64, 0.0);
    while below < probability {
        below += 1e-3 * (-0.5 * value * value).exp() / math::sqrt(core::f64::consts::TAU);
        value += 1e-3;
    }
    value
}
