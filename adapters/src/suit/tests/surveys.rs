//! Tests of the survey.

use super::*;
use crate::suit::Survey;
use crate::wire::mvn::{DatagramType, Layout};

const SENDER: std::net::IpAddr = std::net::IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 4));

fn of(avatar: u8, counter: u32, poses: &[SegmentPose]) -> Vec<u8> {
    let mut bytes = Vec::new();
    // The suit counts at 240 Hz.
    let header = Header::new(counter, counter * 25 / 6, avatar);
    pose_quaternion::encode(&header, poses, &mut bytes).unwrap();
    bytes
}

#[test]
fn rates_strides_losses_and_repetitions_are_distinguished() {
    let mut survey = Survey::new(SuitSettings::default());
    assert!(survey.is_silent());
    // Every fourth sample of 240 Hz is sent; two are lost in transit; then MVN is paused.
    for index in (0..120u32).filter(|index| ![50, 70].contains(index)) {
        survey.take(SENDER, &of(0, 4 * index, &standing()), u64::from(4 * index) * PERIOD_NS);
    }
    for index in 120..180u32 {
        survey.take(SENDER, &of(0, 4 * 119, &standing()), u64::from(4 * index) * PERIOD_NS);
    }
    let character = &survey.characters[&0];
    let (kind, pose) = character.pose().unwrap();
    assert_eq!(kind, DatagramType::POSE_QUATERNION);
    assert_eq!((pose.samples, pose.lost, pose.repeated, pose.stride()), (118, 2, 60, Some(4)));
    assert!((pose.rate_hz() - 60.0).abs() < 1.5, "{}", pose.rate_hz());
    assert!((character.suit_rate_hz().unwrap() - 240.0).abs() < 1.0);
    assert_eq!(character.upright, [178, 0, 0]);
    assert_eq!((survey.senders[&SENDER], survey.bytes), (178, 178 * 760));
    assert_eq!(character.refused().collect::<Vec<_>>(), [(SuitRefusal::Duplicate, 60)]);
}

#[test]
fn characters_objects_and_foreign_packets_are_distinguished() {
    let mut survey = Survey::new(SuitSettings::default());
    let gloves: Vec<SegmentPose> =
        (24..=64).map(|segment_id| SegmentPose { segment_id, ..standing()[0] }).collect();
    let with_gloves: Vec<SegmentPose> = standing().into_iter().chain(gloves).collect();
    let mut gloved = Vec::new();
    let header = Header { props: 1, finger_segments: 40, ..Header::new(1, 4, 3) };
    pose_quaternion::encode(&header, &with_gloves, &mut gloved).unwrap();
    let mut named = Vec::new();
    meta::encode(&Header::new(1, 4, 3), &[("name", "anon-3")], &mut named).unwrap();
    for datagram in [&gloved[..], &named, &of(4, 1, &standing()[..1]), b"{\"type\":1}", b"noise", &[9; 99]] {
        survey.take(SENDER, datagram, 0);
    }
    survey.turn_away(SENDER);
    survey.lose_step();
    assert_eq!(survey.characters.keys().copied().collect::<Vec<_>>(), [3, 4]);
    let (gloved, object) = (&survey.characters[&3], &survey.characters[&4]);
    assert!(!gloved.is_object() && object.is_object());
    assert_eq!(gloved.layout(), Some(Layout { body: 23, props: 1, fingers: 40 }));
    assert_eq!(gloved.name(), Some("anon-3"));
    assert_eq!(survey.texts, 1);
    let unreadable: Vec<_> = survey.unreadable.into_iter().collect();
    assert_eq!(unreadable, [("not_mvn", 1), ("out_of_step", 1), ("too_short", 1)]);
    assert_eq!(survey.turned_away[&SENDER], 1);
}

#[test]
fn an_up_axis_shows_whatever_is_configured() {
    let lying: Vec<SegmentPose> = standing()
        .into_iter()
        .map(|pose| SegmentPose { position_m: [pose.position_m[2], pose.position_m[1], 0.1], ..pose })
        .collect();
    let y_up: Vec<SegmentPose> = standing()
        .into_iter()
        .map(|pose| {
            let [forward, left, up] = pose.position_m;
            SegmentPose { position_m: [left, up, forward], ..pose }
        })
        .collect();
    let mut survey = Survey::new(SuitSettings::default());
    for (counter, poses) in [standing(), y_up.clone(), y_up, lying].iter().enumerate() {
        survey.take(SENDER, &of(0, counter as u32, poses), 0);
    }
    assert_eq!(survey.characters[&0].upright, [1, 2, 1]);
}
