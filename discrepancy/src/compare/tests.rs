use bytemuck::Zeroable;
use equipoise_core::body::{Anthropometry, SEGMENTS, Segment, Sex, Side, Skeleton, gyration_m2};
use equipoise_core::frame::{Pose, SuitWorld};
use equipoise_core::message::GroundSample;
use equipoise_core::sesc::Phi;
use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::block::{CUTOFFS_HZ, LAGS_S, Phase};
use crate::session::Spans;

const BEGIN_NS: u64 = 5_000_000_000;
const MASS_KG: f64 = 70.0;
const GRAVITY_M_PER_S2: f64 = 9.81;

fn skeleton() -> Skeleton {
    Skeleton::nominal(1.77)
}

fn worker() -> Worker {
    let body = Anthropometry::de_leva(&skeleton(), 1.77, Sex::Male);
    Worker {
        mass_kg: MASS_KG,
        height_m: 1.77,
        phi: Phi::of(&skeleton(), &body),
        feet_hold: true,
        offset_m: [0.0; 2],
        gyration_m2: gyration_m2(&skeleton(), 1.77),
        body,
    }
}

fn spans(identify_s: f64, end_s: f64) -> Spans {
    Spans { identify: [0.0, identify_s], reference: None, work: [identify_s, end_s], found: false }
}

fn options(identify_s: f64, end_s: f64) -> Options {
    Options::new(BEGIN_NS, spans(identify_s, end_s), true)
}

/// A rigid body with its pelvis at an arbitrary point of the suit's world, on a plate that measures the predicted
/// reaction.
fn made(time_s: f64, pelvis_m: [f64; 3], force_n: [f64; 3]) -> Snapshot {
    let pelvis = Vector3::from(pelvis_m);
    let origin = skeleton().t_pose_m().map(|origin| pelvis + Vector3::from(origin));
    let pose = Pose::<SuitWorld>::new(origin, [UnitQuaternion::identity(); SEGMENTS]);
    let mut snapshot = Snapshot::new(
        BEGIN_NS + (time_s * 1e9) as u64,
        &pose,
        &pose.shifted(Vector3::zeros()),
        &worker().body,
    );
    snapshot.both_feet_stand = 1;
    snapshot.has_ground = 1;
    snapshot.ground = GroundSample {
        force_n,
        moment_nm: [0.02 * force_n[2], -0.1 * force_n[2], 0.0],
        ..GroundSample::zeroed()
    };
    snapshot
}

fn standing(time_s: f64) -> Snapshot {
    made(time_s, [0.0, 0.0, 0.95], [0.0, 0.0, MASS_KG * GRAVITY_M_PER_S2])
}

/// Blocks over a duration in seconds at a rate; `change` modifies each snapshot.
fn blocks(options: Options, rate_hz: f64, for_s: f64, change: impl Fn(f64, &mut Snapshot)) -> Vec<Block> {
    let mut comparison = Comparison::new(worker(), options);
    for number in 0..(for_s * rate_hz) as u64 {
        let time_s = number as f64 / rate_hz;
        let mut snapshot = standing(time_s);
        change(time_s, &mut snapshot);
        comparison.push(&snapshot);
    }
    comparison.finish().0
}

/// Moves the body, and the chain's centre with it.
fn shift(snapshot: &mut Snapshot, by_m: [f64; 3]) {
    let ground = snapshot.ground;
    let pelvis = snapshot.origin_m[Segment::Pelvis.index()];
    let time_s = (snapshot.time_ns - BEGIN_NS) as f64 * 1e-9;
    let moved = [0, 1, 2].map(|axis| pelvis[axis] + by_m[axis]);
    *snapshot = made(time_s, moved, ground.force_n);
    snapshot.ground = ground;
}

#[test]
fn a_still_body_is_predicted_where_its_chain_ends_and_measured_where_the_plate_says() {
    let blocks = blocks(options(2.0, 10.0), 60.0, 10.0, |_, _| {});
    assert!(blocks.len() > 40, "{}", blocks.len());
    let mut centre = Vector3::new(0.0, 0.0, 0.95);
    for phi in worker().phi.0 {
        centre += Vector3::from(phi);
    }
    for block in &blocks {
        let seen = &block.observation;
        for axis in 0..2 {
            assert!((seen.cop_predicted_m[axis] - centre[axis]).abs() < 1e-9);
            assert!((seen.cop_measured_m[axis] - [0.1, 0.02][axis]).abs() < 1e-9);
        }
        assert!((seen.force_predicted_n[2] - MASS_KG * GRAVITY_M_PER_S2).abs() < 1e-6);
        assert!(seen.rotation[3][0][0] > 1.0 - 1e-9 && !seen.slope_is_measured && !block.still);
        let expected = if seen.time_s < 2.0 { Phase::Identify } else { Phase::Work };
        assert_eq!(block.phase, expected);
    }
}

#[test]
fn a_thrown_body_accelerates_as_it_was_thrown_whatever_the_anchor_shifts() {
    let blocks = blocks(options(0.0, 6.0), 60.0, 6.0, |time_s, snapshot| {
        shift(snapshot, [0.1 * time_s * time_s, 0.0, 0.0]);
        // The anchor holds the feet although the suit drifts.
        for origin in &mut snapshot.origin_m {
            origin[1] += 0.02 * time_s * time_s;
        }
        snapshot.station_from_suit_m = [0.0, 0.02 * time_s * time_s];
    });
    assert!(!blocks.is_empty());
    for block in &blocks {
        let seen = &block.observation;
        for acceleration in [seen.com_acceleration_m_per_s2, seen.origin_acceleration_m_per_s2[5]] {
            assert!(
                (Vector3::from(acceleration) - Vector3::new(0.2, 0.0, 0.0)).norm() < 1e-6,
                "{acceleration:?}"
            );
        }
        // Without measured shear the slope is the suit's.
        assert!((seen.slope[0] - 0.2 / GRAVITY_M_PER_S2).abs() < 1e-6);
        assert!((block.com_velocity_m_per_s[0] - 0.2 * seen.time_s).abs() < 1e-6);
    }
}

#[test]
fn soft_tissue_accelerates_with_the_joint_and_not_only_with_the_segment() {
    let shank = Segment::RightLowerLeg.index();
    let bend = |time_s: f64| 0.6 + 0.5 * (2.0 * time_s).sin();
    // The bend times the shank's rotation matrix.
    let bent = |time_s: f64| {
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), bend(time_s)).to_rotation_matrix().matrix()
            * bend(time_s)
    };
    let blocks = blocks(options(0.0, 12.0), 60.0, 12.0, |time_s, snapshot| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), bend(time_s));
        snapshot.orientation_wxyz[shank] = [turn.w, turn.i, turn.j, turn.k];
    });
    assert!(blocks.len() > 40, "{}", blocks.len());
    for block in &blocks {
        let (time_s, step_s) = (block.observation.time_s, 1e-3);
        let expected =
            (bent(time_s + step_s) + bent(time_s - step_s) - bent(time_s) * 2.0) / (step_s * step_s);
        let [about_x, about_y, _] = block.joint_weighted_rotation_acceleration[shank];
        for (row, column) in (0..3).flat_map(|row| [0, 1, 2].map(|column| (row, column))) {
            assert!(about_x[row][column].abs() < 1e-9);
            assert!((about_y[row][column] - expected[(row, column)]).abs() < 0.15, "{about_y:?} {expected}");
        }
    }
}

#[test]
fn a_lag_changes_what_moves_by_its_way_and_a_filter_by_its_delay() {
    let speed_m_per_s = 0.3;
    let blocks = blocks(options(0.0, 12.0), 60.0, 12.0, |time_s, snapshot| {
        shift(snapshot, [speed_m_per_s * time_s, 0.0, 0.0]);
        let vertical_n = snapshot.ground.force_n[2];
        snapshot.ground.moment_nm[1] -= speed_m_per_s * time_s * vertical_n;
    });
    let last = blocks.last().unwrap();
    for (change, lag_s) in last.by_lag.iter().zip(LAGS_S) {
        assert!((change.cop_m[0] - speed_m_per_s * lag_s).abs() < 1e-9, "{change:?}");
        assert!(change.cop_m[1].abs() < 1e-9 && change.force_n[2].abs() < 1e-6);
    }
    for (change, cutoff_hz) in last.by_cutoff.iter().zip(CUTOFFS_HZ) {
        let delay_s = 1.0 / (std::f64::consts::TAU * cutoff_hz);
        assert!((change.cop_m[0] + speed_m_per_s * delay_s).abs() < 1e-6, "{cutoff_hz} {change:?}");
    }
}

#[test]
fn between_samples_a_lag_does_not_flatten_motion() {
    let omega_rad_per_s = std::f64::consts::TAU * 1.5;
    let moved = |amplitude_m: f64| {
        blocks(options(0.0, 12.0), 60.0, 12.0, move |time_s, snapshot| {
            let sideways_m = amplitude_m * (omega_rad_per_s * time_s).sin();
            shift(snapshot, [sideways_m, 0.0, 0.0]);
            snapshot.ground.moment_nm[1] -= sideways_m * snapshot.ground.force_n[2];
        })
    };
    // Second differences of measurement and prediction enter with opposite signs.
    let residual_m =
        |block: &Block| 0.5 * (block.observation.cop_measured_m[0] - block.observation.cop_predicted_m[0]);
    let (swaying, standing) = (moved(0.02), moved(0.0));
    let later = LAGS_S.partition_point(|lag_s| *lag_s < 0.0);
    let second_difference = 2.0 * (1.0 - (omega_rad_per_s * LAGS_S[later]).cos());
    let largest_m = swaying.iter().map(|block| residual_m(block).abs()).fold(0.0, f64::max);
    for (block, still) in swaying.iter().zip(&standing) {
        let bent_m = block.by_lag[later].cop_m[0] + block.by_lag[later - 1].cop_m[0];
        let expected_m = second_difference * (residual_m(block) - residual_m(still));
        assert!((bent_m - expected_m).abs() < 0.05 * second_difference * largest_m, "{bent_m} {expected_m}");
    }
}

#[test]
fn measured_shear_is_used_and_delayed_by_lags() {
    let blocks = blocks(options(0.0, 6.0), 60.0, 6.0, |time_s, snapshot| {
        let shear_n = 20.0 * time_s;
        *snapshot = made(time_s, [0.0, 0.0, 0.95], [shear_n, -shear_n, MASS_KG * GRAVITY_M_PER_S2]);
        // The body would fall; but its centre of pressure is where this shear requires.
        let height_m = equipoise_core::sesc::centre_of_mass(&snapshot.pose(), &worker().phi).z;
        snapshot.ground.moment_nm[0] += height_m * shear_n;
        snapshot.ground.moment_nm[1] += height_m * shear_n;
    });
    for block in &blocks {
        let seen = &block.observation;
        let slope = 20.0 * seen.time_s / (MASS_KG * GRAVITY_M_PER_S2);
        assert!(seen.slope_is_measured);
        assert!((seen.slope[0] - slope).abs() < 1e-6 && (seen.slope[1] + slope).abs() < 1e-6);
        let moved = seen.com_m[0] - (seen.com_m[2] - seen.floor_m) * slope;
        assert!((seen.cop_predicted_m[0] - moved).abs() < 1e-6);
        assert!(block.by_lag.iter().all(|change| change.cop_m[0].abs() < 1e-9));
    }
}

#[test]
fn nothing_is_compared_around_a_step_a_lifted_foot_an_empty_plate_or_a_gap() {
    let blocks = blocks(options(0.0, 30.0), 60.0, 30.0, |time_s, snapshot| {
        snapshot.stance = u64::from(time_s >= 5.0);
        if (10.0..10.5).contains(&time_s) {
            snapshot.both_feet_stand = 0;
        }
        if (15.0..15.1).contains(&time_s) {
            snapshot.ground.force_n = [0.0; 3];
        }
        if time_s >= 20.0 {
            snapshot.time_ns += 1_000_000_000;
        }
    });
    let masked = |block: &Block, from_s: f64, to_s: f64| {
        let begin_s = (block.observation.time_s / 0.2).floor() * 0.2;
        let end_s = begin_s + 0.2;
        begin_s < to_s - 1e-9 && end_s > from_s + 1e-9
    };
    for (from_s, to_s) in [(4.6, 5.4), (9.6, 10.85), (14.92, 15.15), (19.95, 21.05)] {
        assert!(blocks.iter().all(|block| !masked(block, from_s, to_s)), "{from_s}");
        // No more blocks are masked than required.
        let near = |block: &&Block| masked(block, from_s - 0.9, to_s + 0.9);
        let near = blocks.iter().filter(near).count();
        assert!(near >= 6, "{from_s}: {near}");
    }
    assert!(blocks.len() > 120, "{}", blocks.len());
}

#[test]
fn nothing_is_compared_around_a_gap_with_a_step() {
    let blocks = blocks(options(0.0, 12.0), 60.0, 10.0, |time_s, snapshot| {
        if time_s >= 5.0 {
            snapshot.stance = 1;
            snapshot.time_ns += 1_000_000_000;
        }
    });
    let between = |from_s: f64, to_s: f64| {
        blocks.iter().filter(|block| (from_s..to_s).contains(&block.observation.time_s)).count()
    };
    assert_eq!(between(4.6, 6.4), 0);
    let around = [between(3.0, 4.4), between(6.6, 10.8)];
    assert!(around[0] >= 6 && around[1] >= 18, "{around:?}");
}

#[test]
fn a_foot_that_seems_lifted_stands_while_the_other_alone_cannot_support_the_load() {
    let [left, right] = Side::BOTH.map(|side| skeleton().t_pose_m()[side.foot().index()]);
    let raised_for = |cop_y_m: f64| {
        let mut comparison = Comparison::new(worker(), options(1.0, 10.0));
        for number in 0..600 {
            let mut snapshot = standing(f64::from(number) / 60.0);
            snapshot.both_feet_stand = 0;
            for segment in [Side::Left.foot(), Side::Left.toe()] {
                snapshot.origin_m[segment.index()][2] += 0.05;
            }
            let vertical_n = snapshot.ground.force_n[2];
            snapshot.ground.moment_nm = [cop_y_m * vertical_n, -0.05 * vertical_n, 0.0];
            comparison.push(&snapshot);
        }
        let (blocks, left_out) = comparison.finish();
        (blocks.len(), left_out)
    };
    let (between, none) = raised_for(0.5 * (left[1] + right[1]));
    assert!(between > 40 && none == LeftOut::default(), "{between} {none:?}");
    let (on_the_right, left_out) = raised_for(right[1]);
    assert!(on_the_right == 0 && left_out.lifted_foot > 35, "{on_the_right} {left_out:?}");
    assert_eq!(LeftOut { lifted_foot: 0, ..left_out }, LeftOut::default());
}

#[test]
fn a_long_stream_is_thinned_evenly_and_the_poses_are_kept() {
    let (end_s, most) = (1200.0, 200);
    let options = Options { blocks_max: most, ..options(8.0, end_s) };
    let mut comparison = Comparison::new(worker(), options);
    for number in 0..(end_s * 25.0) as u64 {
        let time_s = number as f64 / 25.0;
        comparison.push(&standing(time_s));
        comparison.hold(standing(time_s).time_ns, true);
        let held = comparison.points.len() + comparison.still.len() + comparison.waiting.len();
        assert!(held < 120 && comparison.masks.len() < 10, "{held}");
    }
    let (blocks, _) = comparison.finish();
    assert!(blocks.len() <= most, "{}", blocks.len());
    let poses = blocks.iter().filter(|block| block.phase == Phase::Identify).count();
    assert!(poses >= 36, "{poses}");
    let work: Vec<f64> = blocks
        .iter()
        .filter(|block| block.phase == Phase::Work)
        .map(|block| block.observation.time_s)
        .collect();
    let [widest, narrowest] = work.windows(2).fold([0.0, f64::INFINITY], |[widest, narrowest], pair| {
        let step_s: f64 = pair[1] - pair[0];
        [step_s.max(widest), step_s.min(narrowest)]
    });
    assert!(work.len() > most / 3 && widest < narrowest + 0.05, "{} {widest} {narrowest}", work.len());
    assert!(work[work.len() - 1] > 0.97 * end_s && blocks.iter().all(|block| block.still));
}

#[test]
fn the_prior_is_a_covariance_of_all_parameters() {
    use crate::session::PARAMETERS;
    use equipoise_core::cycle::{Identification, Settings};
    let settings = Settings { mass_kg: Some(MASS_KG), ..Settings::for_height(1.77) };
    let mut learnt: Box<Identification> = bytemuck::zeroed_box();
    learnt.start(&settings);
    assert!(Worker::of(&learnt, &settings).is_none(), "segment lengths are unavailable");
    let origin = skeleton().t_pose_m().map(|origin| Vector3::from(origin) + Vector3::new(0.0, 0.0, 0.95));
    let pose = Pose::<SuitWorld>::new(origin, [UnitQuaternion::identity(); SEGMENTS]);
    for _ in 0..20 {
        learnt.update_skeleton(&pose, &settings);
    }
    assert!(Worker::of(&learnt, &settings).is_some());
    let covariance_m2 = prior_covariance_m2(&learnt, &settings);
    let at = |row: usize, column: usize| covariance_m2[row * PARAMETERS + column];
    let matrix = nalgebra::DMatrix::from_fn(PARAMETERS, PARAMETERS, at);
    assert!((&matrix - matrix.transpose()).amax() < 1e-12);
    assert!(matrix.cholesky().is_some(), "not positive definite");
    assert!((0..PARAMETERS).all(|raw| (0.002..0.06).contains(&at(raw, raw).sqrt())));
}
