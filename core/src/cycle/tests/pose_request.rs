//! Poses that a model file requests are suggested after identification, each until it was held or skipped.

use super::bench::*;
use super::*;
use crate::body::Segment;
use crate::pose_suggestion::Posture;

/// One of the upright postures of the bench.
const WANTED: usize = 3;
const NONE: u32 = u32::MAX;

fn turned(posture: &Posture, by_deg: i16) -> Posture {
    let mut posture = *posture;
    assert_eq!(posture.rotation_deg[Segment::Pelvis.index()][1], 0, "upright");
    posture.rotation_deg[Segment::Pelvis.index()] = [0, 0, by_deg];
    for leg in [Segment::RightUpperLeg, Segment::LeftUpperLeg] {
        posture.rotation_deg[leg.index()] = [0; 3];
    }
    posture
}

/// An identified subject for whom the model file requests a pose.
fn identified(turn_rad: f64) -> (Person, Bench) {
    let mut bench =
        Bench::new(|settings| settings.pose_requests[0] = Some(PoseRequest { pose: WANTED, turn_rad }));
    let person = Person::real();
    bench.hold(&person, &postures()[0], None, 500);
    assert_ne!(bench.state().suggested_pose, WANTED as u32, "identification suggests its own poses");
    bench.identify(&person);
    bench.command(CommandKind::IdentifyStop);
    bench.hold(&person, &postures()[8], None, 500);
    assert_eq!(bench.state().suggested_pose, WANTED as u32);
    assert!(bench.state().pose_mismatch_rad > POSE_REACHED_RAD);
    (person, bench)
}

#[test]
fn a_requested_pose_is_suggested_until_it_was_held() {
    let (person, mut bench) = identified(0.0);
    let before = bench.memory.identification.poses_used;
    bench.hold(&person, &postures()[10], None, 1000);
    assert_eq!(bench.state().suggested_pose, WANTED as u32, "another pose does not count");
    bench.hold(&person, &postures()[WANTED], None, 1000);
    assert_eq!((bench.state().suggested_pose, bench.state().pose_mismatch_rad), (NONE, 0.0));
    bench.hold(&person, &postures()[8], None, 1000);
    assert_eq!(bench.state().suggested_pose, NONE, "once is enough");
    assert_eq!(bench.memory.identification.poses_used, before, "a requested pose does not update the filter");
    assert!(bench.memory.is_sound());
}

#[test]
fn another_model_s_request_is_suggested_after_a_reload_and_the_same_one_is_not_again() {
    let (person, mut bench) = identified(0.0);
    bench.hold(&person, &postures()[WANTED], None, 1000);
    bench.command(CommandKind::Reload);
    bench.hold(&person, &postures()[8], None, 1500);
    assert_eq!(bench.state().suggested_pose, NONE, "it was held");
    bench.settings.pose_requests[0] = Some(PoseRequest { pose: 5, turn_rad: 0.0 });
    bench.command(CommandKind::Reload);
    bench.hold(&person, &postures()[8], None, 1500);
    assert_eq!(bench.state().suggested_pose, 5);
}

#[test]
fn several_poses_are_requested_in_their_order() {
    let (person, mut bench) = identified(0.0);
    bench.settings.pose_requests[1] = Some(PoseRequest { pose: 5, turn_rad: 0.0 });
    bench.hold(&person, &postures()[5], None, 1000);
    assert_eq!(bench.state().suggested_pose, WANTED as u32, "the second does not replace the first");
    bench.hold(&person, &postures()[WANTED], None, 1000);
    assert_eq!(bench.state().suggested_pose, 5);
    bench.command(CommandKind::PoseSkip);
    bench.hold(&person, &postures()[8], None, 100);
    assert_eq!(bench.state().suggested_pose, NONE);
    assert!(bench.memory.is_sound());
}

#[test]
fn a_requested_turn_is_part_of_the_pose() {
    let (person, mut bench) = identified(core::f64::consts::FRAC_PI_2);
    let wanted = turned(&postures()[WANTED], 0);
    let library: &'static [Posture] = Box::leak(Box::new([wanted; 4]));
    bench.settings.library = library;
    for off_deg in [0, -90, 150] {
        bench.hold(&person, &turned(&wanted, off_deg), None, 1000);
        assert_eq!(bench.state().suggested_pose, WANTED as u32, "turned by {off_deg}°");
        assert!(bench.state().pose_mismatch_rad > POSE_REACHED_RAD, "and it is published");
    }
    bench.hold(&person, &turned(&wanted, 80), None, 1000);
    assert_eq!(bench.state().suggested_pose, NONE);
}

#[test]
fn a_requested_pose_can_be_skipped_and_must_be_in_the_library() {
    let (person, mut bench) = identified(0.0);
    bench.command(CommandKind::PoseSkip);
    bench.hold(&person, &postures()[8], None, 100);
    assert_eq!(bench.state().suggested_pose, NONE);
    let (person, mut bench) = identified(0.0);
    bench.settings.pose_requests[0] = Some(PoseRequest { pose: 20, turn_rad: 0.0 });
    bench.hold(&person, &postures()[8], None, 100);
    assert_eq!(bench.state().suggested_pose, NONE);
}
