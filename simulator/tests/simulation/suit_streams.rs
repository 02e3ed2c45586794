//! Everything that the simulated MVN sends, parsed by the adapters: two implementations of one specification.

use equipoise_adapters::wire::mvn::Datagram;
use equipoise_core::body::{SEGMENTS, Segment};
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::{Suit, SuitNoise};
use equipoise_simulator::person::Person;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame_at};
use equipoise_simulator::wire::SuitFrame;

/// A moving person at a time, as measured by a suit without error.
fn seen(streams: Streams) -> SuitFrame {
    let mut worker = Worker::with_habits(Person::new(5, 1.77, 72.0), 5, Habits::ORDINARY);
    worker.take_pose(&equipoise_core::pose_suggestion::library::LIBRARY[7], 0.2, 1.5);
    let suit = Suit::new(SuitNoise::NONE, 5);
    frame_at(&worker, &suit, SuitWorld::default(), streams, 0, 0.9, (54, 900))
}

fn apart(reported: [f32; 3], is: [f64; 3]) -> f64 {
    reported.iter().zip(is).map(|(reported, is)| (f64::from(*reported) - is).abs()).fold(0.0, f64::max)
}

#[test]
fn every_datagram_is_read_and_all_poses_are_one() {
    let frame = seen(Streams { fingers: true, props: 2, ..Streams::ALL });
    let datagrams = frame.datagrams().unwrap();
    let mut kinds = Vec::new();
    for bytes in &datagrams {
        let same_pose = |i: usize, place: [f32; 3], turn: [f32; 4]| {
            let dot: f64 = turn.iter().zip(frame.orientation_wxyz[i]).map(|(t, q)| f64::from(*t) * q).sum();
            assert!(
                apart(place, frame.position_m[i]) < 2e-6 && (dot.abs() - 1.0).abs() < 1e-6,
                "{i}: {place:?} {dot}"
            );
        };
        match Datagram::parse(bytes).unwrap() {
            Datagram::PoseQuaternion(header, items) => {
                assert_eq!((header.items, header.props, header.finger_segments), (65, 2, 40));
                for (i, item) in items.take(SEGMENTS).enumerate() {
                    same_pose(i, item.position_m, item.orientation_wxyz);
                }
                assert_eq!(bytes.len(), 24 + 65 * 32);
            }
            Datagram::PoseEuler(_, items) => {
                for (i, item) in items.take(SEGMENTS).enumerate() {
                    let pose = item.to_z_up();
                    same_pose(i, pose.position_m, pose.orientation_wxyz);
                }
            }
            Datagram::Unity(_, body) => {
                for (i, pose) in body.to_z_up().into_iter().enumerate() {
                    same_pose(i, pose.position_m, pose.orientation_wxyz);
                }
            }
            Datagram::JointAngles(_, items) => assert_eq!(items.count(), 28),
            Datagram::LinearKinematics(_, items) => assert_eq!(items.count(), SEGMENTS),
            Datagram::AngularKinematics(_, items) => assert_eq!(items.count(), SEGMENTS),
            Datagram::CentreOfMass(..) | Datagram::Unused(_) => {}
            other => panic!("{other:?}"),
        }
        kinds.push(String::from_utf8_lossy(&bytes[4..6]).into_owned());
    }
    assert_eq!(kinds, ["02", "01", "05", "03", "20", "21", "22", "23", "24", "25"]);
}

#[test]
fn angular_velocities_match_the_rotation() {
    let (before, now, after) = (seen_at(0.899), seen_at(0.9), seen_at(0.901));
    let angular = now.more.angular.unwrap();
    for segment in [Segment::Pelvis, Segment::RightUpperArm, Segment::Head] {
        let i = segment.index();
        let turn = |frame: &SuitFrame| {
            let [w, x, y, z] = frame.orientation_wxyz[i];
            nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
        };
        let rate = (turn(&after) * turn(&before).inverse()).scaled_axis() / 0.002;
        let reported = nalgebra::Vector3::from(angular[i][0]);
        assert!((rate - reported).norm() < 0.02 * rate.norm() + 0.01, "{segment:?}: {rate:?} {reported:?}");
    }
    // A tracker measures gravity and its own acceleration.
    for tracker in &now.more.trackers {
        let [measured, _] = tracker.measured.unwrap();
        let strength = measured.iter().map(|part| part * part).sum::<f32>().sqrt();
        assert!((5.0..20.0).contains(&strength), "{tracker:?}");
    }
    assert_eq!(now.more.trackers.len(), 17);
}

fn seen_at(time_s: f64) -> SuitFrame {
    let mut worker = Worker::with_habits(Person::new(5, 1.77, 72.0), 5, Habits::ORDINARY);
    worker.take_pose(&equipoise_core::pose_suggestion::library::LIBRARY[7], 0.2, 1.5);
    let suit = Suit::new(SuitNoise::NONE, 5);
    frame_at(&worker, &suit, SuitWorld::default(), Streams::ALL, 0, time_s, (54, 900))
}

#[test]
fn old_versions_send_shorter_datagrams() {
    let lengths = |old_sizes| {
        let datagrams = seen(Streams { old_sizes, ..Streams::ALL }).datagrams().unwrap();
        let all = datagrams.iter().filter(|bytes| [*b"23", *b"24", *b"25"].contains(&[bytes[4], bytes[5]]));
        all.map(|bytes| {
            assert!(Datagram::parse(bytes).is_ok());
            bytes.len()
        })
        .collect::<Vec<_>>()
    };
    assert_eq!(lengths(false), [1180, 60, 40]);
    assert_eq!(lengths(true), [772, 36, 36]);
}
