//! Several characters and an object on one port.

use super::*;
use crate::suit::SuitRouter;

fn of(avatar: u8, counter: u32, poses: &[SegmentPose]) -> Vec<u8> {
    let mut bytes = Vec::new();
    pose_quaternion::encode(&Header::new(counter, counter * 4, avatar), poses, &mut bytes).unwrap();
    bytes
}

fn at(forward_m: f32) -> Vec<SegmentPose> {
    let mut poses = standing();
    poses.iter_mut().for_each(|pose| pose.position_m[0] = forward_m);
    poses
}

#[test]
fn every_character_gets_its_own_samples_and_an_object_affects_none() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let settings = SuitSettings { required, ..SuitSettings::default() };
    let mut router = SuitRouter::new(settings, &[1, 7]);
    let mut got: Vec<(u32, u32, f64)> = Vec::new();
    // Counters of different subjects are independent; the object shares the first one's.
    for counter in 0..50u32 {
        let sent = [
            of(0, counter, &at(0.0)),
            of(1, 9000 + counter, &at(1.0)),
            of(2, counter, &at(3.0)[..1]),
            of(7, 70_000 + 4 * counter, &at(2.0)),
        ];
        for datagram in sent {
            let sample = router.receive(&datagram, u64::from(counter) * PERIOD_NS);
            got.extend(sample.map(|sample| (sample.avatar, sample.device_counter, sample.position_m[0][0])));
        }
    }
    for (avatar, first, step, forward_m) in [(0, 0, 1, 0.0), (1, 9000, 1, 1.0), (7, 70_000, 4, 2.0)] {
        let of_it: Vec<_> = got.iter().filter(|(whose, ..)| *whose == avatar).collect();
        let counters: Vec<u32> = of_it.iter().map(|(_, counter, _)| *counter).collect();
        assert_eq!(
            counters,
            (0..50).map(|index| first + step * index).collect::<Vec<_>>(),
            "avatar {avatar}"
        );
        assert!(of_it.iter().all(|(.., metres)| *metres == forward_m));
    }
    assert_eq!(refused(router.own(), SuitRefusal::OtherAvatar), 50, "the object");
    assert_eq!(router.own().counts().received, 100);
    for avatar in [1, 7] {
        let counts = router.other(avatar).unwrap().counts();
        assert_eq!((counts.received, counts.published, counts.lost), (50, 50, 0));
        assert_eq!(counts.refused.iter().sum::<u64>(), 0);
    }
    assert!(router.other(2).is_none());
}

#[test]
fn samples_without_a_route_are_counted_once() {
    let mut router = SuitRouter::new(SuitSettings::default(), &[1]);
    assert!(router.receive(b"noise", 0).is_none() && router.receive(&[7; 60], 0).is_none());
    router.refuse_datagram(SuitRefusal::ForeignSender);
    assert_eq!(router.own().counts().received, 3);
    assert_eq!(router.other(1).unwrap().counts().received, 0);
}
