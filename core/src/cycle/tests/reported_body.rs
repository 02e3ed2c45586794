//! Body dimensions reported by the suit, and the conditions of their acceptance.

use super::*;
use crate::cycle::identification::StoredSubject;
use crate::message::suit_body::FootPoint;

const STANDING: [[i16; 3]; 2] = [[-80, 0, 0], [80, 0, 0]];

fn upright() -> Posture {
    stand(0, 0, STANDING[0], STANDING[1], 0)
}

fn null_pose_of(skeleton: &crate::body::Skeleton) -> SuitBody {
    let origin_m = skeleton.t_pose_m().map(|[x, y, z]| [x, y, z + 0.95]);
    SuitBody { origin_m, ..Zeroable::zeroed() }
}

fn body_status(bench: &Bench) -> (BodySource, BodyRejection) {
    let state = bench.state();
    (
        BodySource::from_number(state.body_source).unwrap(),
        BodyRejection::from_number(state.body_rejected).unwrap(),
    )
}

#[test]
fn the_null_pose_gives_exact_bone_lengths_at_the_first_sample() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.suit_body = Some(null_pose_of(&person.skeleton));
    bench.hold(&person, &upright(), None, 200);
    assert_eq!(body_status(&bench), (BodySource::NullPose, BodyRejection::None));
    let bones = bench.memory.identification.skeleton();
    let expected = bench.suit_body.unwrap().skeleton();
    assert_eq!(bones, expected, "the null pose's own, to the last bit");

    let mut without = Bench::new(|_| {});
    without.hold(&person, &upright(), None, 180);
    assert_eq!(body_status(&without).0, BodySource::Unknown);
    without.hold(&person, &upright(), None, 200);
    assert_eq!(body_status(&without).0, BodySource::Poses);
}

#[test]
fn the_null_pose_replaces_bone_lengths_from_poses_and_keeps_theta() {
    let (person, mut early) = (Person::real(), Bench::new(|_| {}));
    early.hold(&person, &upright(), None, 220);
    assert_eq!(body_status(&early).0, BodySource::Poses);
    early.suit_body = Some(null_pose_of(&person.skeleton));
    early.hold(&person, &upright(), None, 20);
    assert_eq!(body_status(&early).0, BodySource::NullPose);

    let mut late = Bench::identified();
    let used = late.state().poses_used;
    assert!(used > 0);
    late.suit_body = Some(null_pose_of(&person.skeleton));
    let theta = late.memory.identification.phi();
    late.hold(&person, &upright(), None, 5);
    late.hold(&person, &upright(), None, 95);
    assert_eq!(body_status(&late), (BodySource::NullPose, BodyRejection::None));
    assert!(late.memory.identification.phi() == theta || late.state().poses_used > used);
    assert!(late.state().poses_used >= used, "no pose is discarded");
}

#[test]
fn a_null_pose_that_contradicts_the_poses_is_rejected() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let taller = crate::body::Skeleton::nominal(1.2 * HEIGHT_M);
    bench.suit_body = Some(null_pose_of(&taller));
    bench.hold(&person, &upright(), None, 400);
    assert_eq!(body_status(&bench), (BodySource::Poses, BodyRejection::ContradictsPoses));
    assert!(bench.memory.identification.skeleton().differs_by_m(&person.skeleton) < 1e-9);
    // A subsequent correct message is accepted.
    bench.suit_body = Some(null_pose_of(&person.skeleton));
    bench.hold(&person, &upright(), None, 100);
    assert_eq!(body_status(&bench).1, BodyRejection::None);
}

#[test]
fn a_profile_that_contradicts_the_null_pose_is_reported_and_kept() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    let taller = Person {
        skeleton: crate::body::Skeleton::nominal(1.1 * HEIGHT_M),
        phi: person.phi,
        body: person.body,
    };
    bench.suit_body = Some(null_pose_of(&taller.skeleton));
    bench.hold(&taller, &upright(), None, 200);
    assert_eq!(body_status(&bench), (BodySource::Poses, BodyRejection::ContradictsWorker));
}

#[test]
fn the_null_pose_is_compared_with_each_subject_that_is_loaded() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.suit_body = Some(null_pose_of(&person.skeleton));
    bench.identify(&person);
    let mut stored = bytemuck::zeroed_box::<StoredSubject>();
    bench.memory.identification.store(&mut stored);
    let mut of_bones = |skeleton: &crate::body::Skeleton| {
        let mut subject = bytemuck::zeroed_box::<SubjectState>();
        stored.skeleton_m = skeleton.offset_m;
        assert!(subject.identification.restore(&stored, &bench.settings));
        subject
    };
    let right = of_bones(&person.skeleton);
    let wrong = of_bones(&crate::body::Skeleton::nominal(1.1 * HEIGHT_M));
    for (subject, expected) in [
        (&wrong, BodyRejection::ContradictsWorker),
        (&right, BodyRejection::None),
        (&wrong, BodyRejection::ContradictsWorker),
    ] {
        bench.memory.replace_subject(subject);
        bench.command(CommandKind::SubjectLoad);
        bench.hold(&person, &upright(), None, 200);
        assert_eq!(body_status(&bench).1, expected);
    }
}

#[test]
fn impossible_and_stale_bodies_are_rejected_with_a_reason_and_change_nothing() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.suit_session = 1;
    bench.suit_body = Some(SuitBody { session: 1, ..null_pose_of(&person.skeleton) });
    bench.hold(&person, &upright(), None, 200);
    let good = bench.suit_body.unwrap();
    let before = bench.memory.reported_body.body().copied();
    let mut lying = good;
    lying.origin_m.iter_mut().for_each(|[_, y, z]| core::mem::swap(y, z));
    for (suit_body, reason) in [
        (lying, BodyRejection::Impossible),
        (SuitBody { session: 0, ..good }, BodyRejection::Stale),
        (SuitBody { avatar: 3, ..good }, BodyRejection::OtherCharacter),
    ] {
        bench.suit_body = Some(suit_body);
        bench.hold(&person, &upright(), None, 50);
        assert_eq!(body_status(&bench), (BodySource::NullPose, reason));
        let body = bench.memory.reported_body.body().copied();
        assert!(
            body.zip(before).is_some_and(|(body, before)| body.has_same_dimensions(&before)),
            "{reason:?}"
        );
        bench.suit_body = Some(good);
        bench.hold(&person, &upright(), None, 20);
        assert_eq!(body_status(&bench).1, BodyRejection::None);
    }
    // A message that was delayed for long.
    bench.suit_body = None;
    let old = SuitBody { published_ns: bench.now_ns, ..good };
    bench.cycle += 1;
    bench.now_ns += 6 * NS_PER_S;
    let inputs = Inputs { body: Some(&old), ..Inputs::default() };
    step(&bench.settings, &mut bench.memory, Tick { cycle: bench.cycle, due_ns: bench.now_ns }, inputs);
    assert_eq!(body_status(&bench).1, BodyRejection::Stale);
}

#[test]
fn a_restarted_suit_must_send_its_null_pose_again() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.suit_body = Some(null_pose_of(&person.skeleton));
    bench.hold(&person, &upright(), None, 200);
    assert!(bench.memory.reported_body.body().is_some());
    bench.suit_body = None;
    bench.suit_session = 1;
    bench.hold(&person, &upright(), None, 50);
    assert!(bench.memory.reported_body.body().is_none(), "it may be another's");
    assert_eq!(body_status(&bench).1, BodyRejection::Stale);
}

#[test]
fn a_restarted_adapter_must_send_the_body_again() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.suit_session = 2;
    bench.suit_body = Some(SuitBody { session: 2, ..null_pose_of(&person.skeleton) });
    bench.hold(&person, &upright(), None, 200);
    assert!(bench.memory.reported_body.body().is_some());
    bench.suit_body = None;
    bench.suit_session = 0;
    bench.hold(&person, &upright(), None, 50);
    assert!(bench.memory.reported_body.body().is_none(), "it may be another's");
    assert_eq!(body_status(&bench).1, BodyRejection::Stale);
    bench.suit_body = Some(null_pose_of(&person.skeleton));
    bench.hold(&person, &upright(), None, 50);
    assert!(bench.memory.reported_body.body().is_some_and(|body| body.session == 0));
    assert_eq!(body_status(&bench).1, BodyRejection::None);
}

#[test]
fn a_null_pose_before_the_first_pose_of_its_session_is_kept_until_that_pose() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &upright(), None, 50);
    bench.suit_body = Some(SuitBody { session: 1, ..null_pose_of(&person.skeleton) });
    bench.hold(&person, &upright(), None, 50);
    assert!(bench.memory.reported_body.body().is_none(), "no pose of its session was received");
    bench.suit_body = None;
    bench.suit_session = 1;
    bench.hold(&person, &upright(), None, 50);
    assert!(bench.memory.reported_body.body().is_some_and(|body| body.session == 1));
}

#[test]
fn the_foot_outlines_of_the_suit_bound_the_cop() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let mut suit_body = null_pose_of(&person.skeleton);
    suit_body.foot_points = [FootPoint::Heel as u32 | FootPoint::ToeTip as u32; 2];
    // Very short feet: heel and tip next to the ankle.
    suit_body.foot_point_m = [[[-0.02, 0.0, -0.1], [0.0; 3], [0.0; 3], [0.12, 0.0, -0.1]]; 2];
    bench.suit_body = Some(suit_body);
    bench.hold(&person, &upright(), None, 100);
    assert_eq!(bench.state().foot_outline_source, 1);
    let forward = stand(40, 0, STANDING[0], STANDING[1], 0);
    bench.hold(&person, &forward, None, 600);
    let with_short_feet = bench.state().poses_used;

    let mut nominal = Bench::new(|_| {});
    nominal.hold(&person, &upright(), None, 100);
    assert_eq!(nominal.state().foot_outline_source, 0);
    nominal.hold(&person, &forward, None, 600);
    assert!(nominal.state().poses_used > with_short_feet, "the CoP of that pose is beyond short toes");
}
