//! Tests of the assembler with datagrams as MVN sends them.

use super::{SuitAssembler, SuitRefusal, SuitSettings, TypeSet};
use crate::wire::mvn::{
    EulerPose, Header, LinearKinematics, SegmentPose, linear_kinematics, meta, pose_euler, pose_quaternion,
};
use equipoise_core::message::SuitSample;
use equipoise_core::message::suit::SuitBlocks;
use proptest::prelude::*;

mod extras;
mod routes;
mod surveys;

const PERIOD_NS: u64 = 4_166_667;

fn standing() -> Vec<SegmentPose> {
    (1..=23)
        .map(|segment_id| SegmentPose {
            segment_id,
            position_m: [0.1, 0.2, if segment_id > 15 { 0.1 } else { 1.0 + segment_id as f32 / 20.0 }],
            orientation_wxyz: [0.6, 0.0, 0.8, 0.0],
        })
        .collect()
}

fn pose_datagram(counter: u32, poses: &[SegmentPose]) -> Vec<u8> {
    let mut bytes = Vec::new();
    pose_quaternion::encode(&Header::new(counter, counter * 4, 0), poses, &mut bytes).unwrap();
    bytes
}

fn linear_datagram(counter: u32) -> Vec<u8> {
    let items: Vec<_> = (1..=23)
        .map(|segment_id| LinearKinematics {
            segment_id,
            position_m: [0.0; 3],
            velocity_m_per_s: [segment_id as f32, 0.0, 0.0],
            acceleration_m_per_s2: [0.0; 3],
        })
        .collect();
    let mut bytes = Vec::new();
    linear_kinematics::encode(&Header::new(counter, counter * 4, 0), &items, &mut bytes).unwrap();
    bytes
}

fn feed(assembler: &mut SuitAssembler, datagrams: &[Vec<u8>], arrival_ns: u64) -> Vec<SuitSample> {
    let mut samples = Vec::new();
    for datagram in datagrams {
        samples.extend(assembler.receive(datagram, arrival_ns));
        while let Some(sample) = assembler.take_ready() {
            samples.push(sample);
        }
    }
    samples
}

fn refused(assembler: &SuitAssembler, refusal: SuitRefusal) -> u64 {
    assembler.counts().refused[refusal.index()]
}

#[test]
fn types_of_one_sample_are_merged_and_published_at_once_when_learnt() {
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    let mut counters = Vec::new();
    for counter in 0..20u32 {
        let datagrams = [pose_datagram(counter, &standing()), linear_datagram(counter)];
        for sample in feed(&mut assembler, &datagrams, 1_000_000_000 + u64::from(counter) * PERIOD_NS) {
            assert!(sample.has(SuitBlocks::LinearKinematics));
            assert_eq!(sample.velocity_m_per_s[4][0], 5.0);
            counters.push((counter, sample.device_counter));
        }
    }
    let all: Vec<u32> = counters.iter().map(|(_, published)| *published).collect();
    assert_eq!(all, (0..20).collect::<Vec<_>>(), "every sample once and in order");
    assert!(counters.iter().skip(4).all(|(now, published)| now == published), "no delay once learnt");
    assert_eq!(assembler.learnt_types(), TypeSet::POSE_QUATERNION.and(TypeSet::LINEAR_KINEMATICS));
    assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
}

#[test]
fn a_lost_type_delays_its_sample_by_one_and_a_type_switched_off_is_forgotten() {
    let settings = SuitSettings::default();
    let mut assembler = SuitAssembler::new(settings);
    for counter in 0..10 {
        feed(&mut assembler, &[pose_datagram(counter, &standing()), linear_datagram(counter)], 0);
    }
    assert!(feed(&mut assembler, &[pose_datagram(10, &standing())], 0).is_empty());
    let late = feed(&mut assembler, &[pose_datagram(11, &standing())], 0);
    assert_eq!(late[0].device_counter, 10);
    assert_eq!((refused(&assembler, SuitRefusal::Incomplete), assembler.counts().lost), (1, 0));
    assert!(!late[0].has(SuitBlocks::LinearKinematics), "a block that was not sent is not held over");
    for counter in 12..30 {
        feed(&mut assembler, &[pose_datagram(counter, &standing())], 0);
    }
    let at_once = feed(&mut assembler, &[pose_datagram(30, &standing())], 0);
    assert_eq!(at_once.iter().map(|sample| sample.device_counter).collect::<Vec<_>>(), [30]);
    assert_eq!(assembler.counts().published, 31);
}

#[test]
fn a_sample_whose_pose_is_lost_is_lost() {
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    for counter in 0..20 {
        let pose = (counter % 5 != 4).then(|| pose_datagram(counter, &standing()));
        let datagrams: Vec<_> = pose.into_iter().chain([linear_datagram(counter)]).collect();
        feed(&mut assembler, &datagrams, u64::from(counter) * PERIOD_NS);
    }
    feed(&mut assembler, &[pose_datagram(20, &standing())], 20 * PERIOD_NS);
    assert_eq!((refused(&assembler, SuitRefusal::NoPose), assembler.counts().lost), (4, 4));
    // If no pose was ever sent, none is lost.
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    for counter in 0..20 {
        feed(&mut assembler, &[linear_datagram(counter)], u64::from(counter) * PERIOD_NS);
    }
    assert_eq!((refused(&assembler, SuitRefusal::NoPose), assembler.counts().lost), (19, 0));
}

#[test]
fn euler_poses_stand_in_for_quaternions() {
    let required = Some(TypeSet::POSE_EULER);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    let items: Vec<_> = standing().iter().map(EulerPose::from_z_up).collect();
    let mut bytes = Vec::new();
    pose_euler::encode(&Header::new(1, 4, 0), &items, &mut bytes).unwrap();
    let sample = assembler.receive(&bytes, 7).unwrap();
    for axis in 0..3 {
        assert!((sample.position_m[6][axis] - f64::from(standing()[6].position_m[axis])).abs() < 1e-6);
    }
    assert!(
        (sample.orientation_wxyz[6][0] - 0.6).abs() < 1e-6
            && (sample.orientation_wxyz[6][2] - 0.8).abs() < 1e-6
    );
}

#[test]
fn bad_poses_are_refused_by_reason_and_change_nothing() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let settings = SuitSettings { required, ..SuitSettings::default() };
    let mut damaged: Vec<(SuitRefusal, Vec<SegmentPose>)> = Vec::new();
    let mut damage = |refusal, change: &dyn Fn(&mut Vec<SegmentPose>)| {
        let mut poses = standing();
        change(&mut poses);
        damaged.push((refusal, poses));
    };
    damage(SuitRefusal::NotFinite, &|poses| poses[3].position_m[1] = f32::NAN);
    damage(SuitRefusal::NotFinite, &|poses| poses[3].orientation_wxyz[1] = f32::INFINITY);
    damage(SuitRefusal::DuplicateSegment, &|poses| poses[3].segment_id = 3);
    damage(SuitRefusal::MissingSegment, &|poses| poses[3].segment_id = 24);
    damage(SuitRefusal::NotUnitQuaternion, &|poses| poses[3].orientation_wxyz = [0.9, 0.0, 0.0, 0.0]);
    damage(SuitRefusal::UpsideDown, &|poses| poses.iter_mut().for_each(|pose| pose.position_m[2] *= -1.0));
    for (refusal, poses) in damaged {
        let mut assembler = SuitAssembler::new(settings);
        assert!(assembler.receive(&pose_datagram(5, &standing()), 0).is_some());
        assert!(assembler.receive(&pose_datagram(6, &poses), 0).is_none());
        assert_eq!(refused(&assembler, refusal), 1, "{refusal:?}");
        // A refused datagram does not register its counter: a valid one with the same counter is no duplicate.
        assert!(assembler.receive(&pose_datagram(6, &standing()), 0).is_some(), "{refusal:?}");
    }
}

#[test]
fn quaternions_are_normalised_and_keep_their_side() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    let first = assembler.receive(&pose_datagram(1, &standing()), 0).unwrap();
    let mut turned = standing();
    turned[9].orientation_wxyz = [-0.62, 0.0, -0.8, 0.0];
    let second = assembler.receive(&pose_datagram(2, &turned), 0).unwrap();
    let norm: f64 = second.orientation_wxyz[9].iter().map(|part| part * part).sum();
    assert!((norm - 1.0).abs() < 1e-12);
    assert!(first.orientation_wxyz[9][0] > 0.0 && second.orientation_wxyz[9][0] > 0.0);
}

#[test]
fn repetitions_old_counters_and_other_avatars_are_dropped() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    let mut other = Vec::new();
    pose_quaternion::encode(&Header::new(8, 0, 3), &standing(), &mut other).unwrap();
    let sent =
        [pose_datagram(7, &standing()), pose_datagram(7, &standing()), other, pose_datagram(6, &standing())];
    assert_eq!(feed(&mut assembler, &sent, 0).len(), 1);
    assert_eq!(refused(&assembler, SuitRefusal::Duplicate), 1);
    assert_eq!(refused(&assembler, SuitRefusal::OtherAvatar), 1);
    assert_eq!(refused(&assembler, SuitRefusal::OutOfOrder), 1);
}

#[test]
fn loss_is_counted_against_the_stride_and_a_restart_is_a_session() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    for (index, counter) in [4000u32, 4004, 4008, 4016, 4020].into_iter().enumerate() {
        feed(&mut assembler, &[pose_datagram(counter, &standing())], index as u64 * 4 * PERIOD_NS);
    }
    assert_eq!(assembler.counts().lost, 1);
    let mut sessions = Vec::new();
    for (index, counter) in [0u32, 4, 8, 12].into_iter().enumerate() {
        let arrival_ns = 1_000_000_000 + index as u64 * 4 * PERIOD_NS;
        sessions.extend(feed(&mut assembler, &[pose_datagram(counter, &standing())], arrival_ns));
    }
    assert_eq!(sessions.iter().map(|s| (s.device_counter, s.session)).collect::<Vec<_>>(), [(8, 1), (12, 1)]);
    assert_eq!(assembler.counts().lost, 1);
}

#[test]
fn stamps_follow_the_counter_and_not_the_jitter() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    for counter in 0..2400u32 {
        let taken_ns = 5_000_000_000 + u64::from(counter) * PERIOD_NS;
        let delay_ns = u64::from(counter * 7919 % 13) * 150_000;
        let sample = assembler.receive(&pose_datagram(counter, &standing()), taken_ns + delay_ns).unwrap();
        if counter > 480 {
            assert!(sample.sample_time_ns.abs_diff(taken_ns) < 20_000, "{counter}");
            assert!(sample.sample_time_sigma_ns < 200_000);
        }
    }
}

#[test]
fn a_longer_delay_begins_a_clock_epoch() {
    let required = Some(TypeSet::POSE_QUATERNION);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    let epochs = (0..1200u32).map(|counter| {
        let delay_ns = if counter < 480 { 0 } else { 200_000_000 };
        let arrival_ns = 5_000_000_000 + u64::from(counter) * PERIOD_NS + delay_ns;
        assembler.receive(&pose_datagram(counter, &standing()), arrival_ns).unwrap().clock_epoch
    });
    let epochs: Vec<u32> = epochs.collect();
    let begins = epochs.partition_point(|epoch| *epoch == 0);
    assert!((480..780).contains(&begins) && epochs[begins..].iter().all(|epoch| *epoch == 1), "{begins}");
}

#[test]
fn the_wearer_is_remembered() {
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    let mut bytes = Vec::new();
    meta::encode(&Header::new(0, 0, 0), &[("name", "anon-1"), ("timeOffset", "-3600000")], &mut bytes)
        .unwrap();
    assert!(assembler.receive(&bytes, 0).is_none());
    assert_eq!(assembler.subject().name.as_deref(), Some("anon-1"));
    assert_eq!(assembler.subject().time_offset_ms, Some(-3_600_000));
}

proptest! {
    /// For arbitrary damage: no panic, every published sample is valid, every datagram is counted.
    #[test]
    fn damage_never_reaches_a_sample(damage in proptest::collection::vec((0..760usize, any::<u8>(), 0..761usize), 1..60)) {
        let required = Some(TypeSet::POSE_QUATERNION);
        let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
        for (index, (at, byte, length)) in damage.into_iter().enumerate() {
            let mut bytes = pose_datagram(index as u32, &standing());
            bytes[at] ^= byte;
            if length % 3 == 0 {
                bytes.truncate(length);
            }
            if let Some(sample) = assembler.receive(&bytes, index as u64 * PERIOD_NS) {
                for quaternion in sample.orientation_wxyz {
                    let norm: f64 = quaternion.iter().map(|part| part * part).sum();
                    prop_assert!((norm - 1.0).abs() < 1e-9);
                }
                prop_assert!(sample.position_m.iter().flatten().all(|metres| metres.is_finite()));
            }
        }
    }
}

#[test]
fn a_constant_latency_is_taken_off_every_sample_time_and_off_nothing_else() {
    const LATENCY_NS: u64 = 37_000_000;
    let mut plain = SuitAssembler::new(SuitSettings::default());
    let mut late = SuitAssembler::new(SuitSettings { latency_ns: LATENCY_NS, ..SuitSettings::default() });
    let mut compared = 0;
    for counter in 0..40u32 {
        let datagrams = [pose_datagram(counter, &standing())];
        let arrival_ns = 1_000_000_000 + u64::from(counter) * PERIOD_NS;
        let expected = feed(&mut plain, &datagrams, arrival_ns);
        for (mut late_sample, expected) in feed(&mut late, &datagrams, arrival_ns).into_iter().zip(expected) {
            assert_eq!(late_sample.sample_time_ns, expected.sample_time_ns - LATENCY_NS);
            late_sample.sample_time_ns += LATENCY_NS;
            assert_eq!(late_sample, expected);
            compared += 1;
        }
    }
    assert!(compared >= 39, "before and after the clock is fitted: {compared}");
}
