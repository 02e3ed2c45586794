use std::net::IpAddr;
use std::time::Duration;

use equipoise_adapters::suit::SuitSettings;
use equipoise_adapters::wire::mvn::{
    DatagramType, Header, LinearKinematics, NullPoseSegment, SegmentPose, linear_kinematics, meta,
    pose_quaternion, scale, unity,
};
use equipoise_core::message::suit::SuitBlocks;

use super::super::Verdict::{self, Fail, Ok, Warn};
use super::super::ports::Holder;
use super::super::suit_facts::BusObservation;
use super::*;

const SENDER: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 4));
const TIME: Duration = Duration::from_secs(2);

fn config(keys: &str) -> Config {
    let text = format!(
        "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n{keys}\n[ground]\nsource = \"external\"\n[subject]\nid = \
         \"a\"\nheight_m = 1.7\n"
    );
    Config::parse(&text, "test").unwrap()
}

fn standing() -> [SegmentPose; 23] {
    std::array::from_fn(|index| SegmentPose {
        segment_id: index as u32 + 1,
        position_m: [0.1, 0.2, if index > 14 { 0.1 } else { 1.0 + index as f32 / 20.0 }],
        orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
    })
}

type Send<'a> = &'a dyn Fn(&Header) -> Vec<Vec<u8>>;

/// Two seconds of a suit at 240 Hz that sends every fourth sample.
fn received(avatar: u8, send: Send<'_>) -> Survey {
    let mut survey = Survey::new(SuitSettings { check_up_axis: true, ..SuitSettings::default() });
    receive(&mut survey, avatar, send);
    survey
}

fn receive(survey: &mut Survey, avatar: u8, send: Send<'_>) {
    for index in 0..=120u32 {
        let header = Header::new(4 * index, index * 50 / 3, avatar);
        for datagram in send(&header) {
            survey.take(SENDER, &datagram, u64::from(index) * 1_000_000_000 / 60);
        }
    }
}

fn encoded(encode: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(&mut bytes);
    bytes
}

fn pose(header: &Header) -> Vec<u8> {
    encoded(|out| pose_quaternion::encode(header, &standing(), out).unwrap())
}

/// A datagram of a type whose payload is not read.
fn unused(header: &Header, kind: DatagramType) -> Vec<u8> {
    let mut bytes = pose(header);
    bytes[4..6].copy_from_slice(&kind.0);
    bytes
}

fn checks_of(config: &Config, observed: SuitObservation) -> Vec<Check> {
    evaluate_suit(config, &SuitFacts { port: Port::Free, holder: None, time: TIME, observed })
}

fn of_survey(keys: &str, survey: Survey) -> Vec<Check> {
    checks_of(&config(keys), SuitObservation::AtThePort(Box::new(survey)))
}

fn check<'a>(checks: &'a [Check], name: &str) -> &'a Check {
    checks.iter().find(|check| check.name == name).unwrap_or_else(|| panic!("no {name} in {checks:#?}"))
}

fn verdict(checks: &[Check], name: &str) -> Verdict {
    check(checks, name).verdict
}

fn fix<'a>(checks: &'a [Check], name: &str) -> &'a str {
    check(checks, name).fix.as_deref().unwrap_or("")
}

fn fails(checks: &[Check]) -> Vec<&str> {
    checks.iter().filter(|check| check.verdict == Fail).map(|check| check.name).collect()
}

#[test]
fn a_complete_stream_is_ok_and_unused_types_may_be_unticked() {
    let segments: Vec<NullPoseSegment<'_>> =
        (0..23).map(|_| NullPoseSegment { name: "S", origin_m: [0.0; 3] }).collect();
    let survey = received(0, &|header| {
        let linear = LinearKinematics {
            segment_id: 1,
            position_m: [0.0; 3],
            velocity_m_per_s: [0.0; 3],
            acceleration_m_per_s2: [0.0; 3],
        };
        let linear: Vec<_> = (1..=23).map(|segment_id| LinearKinematics { segment_id, ..linear }).collect();
        vec![
            pose(header),
            encoded(|out| linear_kinematics::encode(header, &linear, out).unwrap()),
            unused(header, DatagramType::VIRTUAL_MARKERS),
            unused(header, DatagramType::TIME_CODE),
            encoded(|out| meta::encode(header, &[("name", "anon-1")], out).unwrap()),
            encoded(|out| scale::encode(&Header::new(0, 0, 0), &segments, &[], out).unwrap()),
        ]
    });
    let checks = of_survey("", survey);
    assert_eq!(fails(&checks), [""; 0], "{checks:#?}");
    assert_eq!(check(&checks, "02 pose quaternion").found, "60.0 a second: needed, and there");
    assert_eq!(
        check(&checks, "samples").found,
        "60.0 a second of the suit's 240 (one of 4 is sent), 0 lost, 0 repeated"
    );
    assert_eq!(check(&checks, "characters").found, "0 (anon-1); 0 is this station's");
    assert_eq!(check(&checks, "up axis").found, "Z points up in 121 of 121 poses");
    assert!(check(&checks, "13 scaling").found.starts_with("23 segments and 0 points"));
    assert_eq!(
        (verdict(&checks, "21 linear kinematics"), verdict(&checks, "22 angular kinematics")),
        (Ok, Ok)
    );
    assert!(
        fix(&checks, "22 angular kinematics")
            .contains("tick the box \"Angular Segment Kinematics\" if wanted")
    );
    assert!(fix(&checks, "24 centre of mass").contains("if wanted"));
    for unused in ["03 virtual markers", "25 time code"] {
        assert_eq!(verdict(&checks, unused), Ok);
        assert!(fix(&checks, unused).contains("may be unticked"), "{unused}");
    }
    assert!(!checks.iter().any(|check| check.name == "23 motion trackers"), "neither sent nor wanted");
}

#[test]
fn without_a_pose_the_suit_fails_and_another_type_substitutes() {
    let code = |header: &Header| vec![unused(header, DatagramType::TIME_CODE)];
    let checks = of_survey("", received(0, &code));
    assert_eq!(fails(&checks), ["02 pose quaternion"]);
    assert!(fix(&checks, "02 pose quaternion").contains(POSE_LABEL));
    let unity = |header: &Header| vec![encoded(|out| unity::encode(header, &standing(), out).unwrap())];
    let checks = of_survey("", received(0, &unity));
    assert_eq!(fails(&checks), [""; 0], "{checks:#?}");
    assert_eq!(verdict(&checks, "02 pose quaternion"), Warn);
    assert!(check(&checks, "05 Unity 3D").found.contains("stands in for 02"));
    for (better, label) in
        [("21 linear kinematics", "Linear Segment Kinematics"), ("13 scaling", "Avatar Scaling data")]
    {
        assert_eq!(verdict(&checks, better), Warn);
        assert!(fix(&checks, better).starts_with(&format!("tick the box \"{label}\"")));
    }
}

const POSE_LABEL: &str = "\"Position + Orientation (Quaternion)\"";

#[test]
fn silence_foreign_senders_and_invalid_data_are_distinguished() {
    let silent = of_survey("", Survey::new(SuitSettings::default()));
    assert_eq!(fails(&silent), ["sender"]);
    for part in [POSE_LABEL, "Port = 9763", "Protocol = UDP", "allow_remote = true", "0.0.0.0:9763"] {
        assert!(fix(&silent, "sender").contains(part), "{part}: {silent:#?}");
    }
    let open =
        of_survey("listen = \"0.0.0.0:9000\"\nallow_remote = true", Survey::new(SuitSettings::default()));
    assert!(fix(&open, "sender").contains("firewall") && fix(&open, "sender").contains("Port = 9000"));
    let mut away = Survey::new(SuitSettings::default());
    away.turn_away(SENDER);
    let checks = of_survey("", away);
    assert!(check(&checks, "sender").found.contains("192.168.1.4") && fails(&checks) == ["sender"]);
    assert!(fix(&checks, "sender").contains("suit.allow_remote = true"));
    let mut nonsense = Survey::new(SuitSettings::default());
    nonsense.take(SENDER, &[7; 100], 0);
    let checks = of_survey("", nonsense);
    assert_eq!(fails(&checks)[0], "readable");
    assert!(!fix(&silent, "sender").contains("switch it off and on"));
    let tcp = SuitConfig { source: equipoise_config::SuitSourceKind::MvnTcp, ..config("").suit };
    let tcp = Config { suit: tcp, ..config("") };
    let tcp = checks_of(&tcp, SuitObservation::AtThePort(Box::new(Survey::new(SuitSettings::default()))));
    assert!(fix(&tcp, "sender").contains("switch it off and on"), "{tcp:#?}");
    assert!(check(&tcp, "suit.listen").found.starts_with("TCP "), "{tcp:#?}");
}

#[test]
fn characters_are_reported_by_station() {
    let complete = |header: &Header| vec![pose(header)];
    let object = |header: &Header| {
        vec![encoded(|out| pose_quaternion::encode(header, &standing()[..1], out).unwrap())]
    };
    let mut survey = received(0, &complete);
    receive(&mut survey, 1, &complete);
    receive(&mut survey, 2, &object);
    let checks = of_survey("", survey.clone());
    assert_eq!(verdict(&checks, "characters"), Warn);
    let found = &check(&checks, "characters").found;
    assert!(found.contains("0, 1; objects, which are not used: 2; 1 belongs to no station"), "{found}");
    let both = "others = [{ avatar = 1, station = \"b\" }]";
    assert_eq!(verdict(&of_survey(both, survey.clone()), "characters"), Ok);
    let missing = of_survey("others = [{ avatar = 5, station = \"b\" }]", survey.clone());
    assert!(fails(&missing) == ["characters"] && fix(&missing, "characters").contains("add one for it"));
    let object = of_survey("avatar = 2", survey);
    assert!(fails(&object) == ["characters"] && fix(&object, "characters").contains("suit.avatar = 0"));
}

#[test]
fn rate_loss_and_a_pause_are_reported() {
    let of = |survey| of_survey("", survey);
    let mut lossy = Survey::new(SuitSettings::default());
    for index in (0..120u32).filter(|index| index % 10 != 9) {
        lossy.take(SENDER, &pose(&Header::new(index, index * 4, 0)), u64::from(index) * 10_000_000);
    }
    let checks = of(lossy);
    assert!(
        verdict(&checks, "samples") == Warn && fix(&checks, "samples").contains("mvn-tcp"),
        "{checks:#?}"
    );
    let mut slow = Survey::new(SuitSettings::default());
    let mut paused = Survey::new(SuitSettings::default());
    for index in 0..60u32 {
        slow.take(SENDER, &pose(&Header::new(index, index * 33, 0)), u64::from(index) * 33_000_000);
        paused.take(SENDER, &pose(&Header::new(7, 100, 0)), u64::from(index) * 33_000_000);
    }
    assert!(fix(&of(slow), "samples").contains("Stream rate"));
    let checks = of(paused);
    assert!(verdict(&checks, "samples") == Warn && fix(&checks, "samples").contains("Send Paused"));
    assert!(!checks.iter().any(|check| check.name == "refused"), "reported once");
}

#[test]
fn the_up_axis_check_names_the_setting() {
    let y_up = |header: &Header| {
        let poses = standing().map(|pose| {
            let [forward, left, up] = pose.position_m;
            SegmentPose { position_m: [left, up, forward], ..pose }
        });
        vec![encoded(|out| pose_quaternion::encode(header, &poses, out).unwrap())]
    };
    let wrong = of_survey("", received(0, &y_up));
    assert!(fails(&wrong) == ["up axis"] && fix(&wrong, "up axis").contains("suit.up_axis = \"y\""));
    assert!(fix(&wrong, "refused").contains("up axis"));
    let mut survey = Survey::new(SuitSettings { up: Up::Y.axis(), ..SuitSettings::default() });
    receive(&mut survey, 0, &y_up);
    assert_eq!(verdict(&of_survey("up = \"y\"", survey), "up axis"), Ok);
    let z_up = of_survey("up = \"y\"", received(0, &|header| vec![pose(header)]));
    assert!(fails(&z_up) == ["up axis"] && fix(&z_up, "up axis").contains("suit.up_axis = \"z\""));
}

#[test]
fn props_and_gloves_are_reported_as_unused() {
    let gloved = |header: &Header| {
        let items: Vec<SegmentPose> = standing()
            .into_iter()
            .chain([standing()[0]; 41].map(|pose| SegmentPose { segment_id: 30, ..pose }))
            .collect();
        let header = Header { props: 1, finger_segments: 40, ..*header };
        vec![encoded(|out| pose_quaternion::encode(&header, &items, out).unwrap())]
    };
    let found = &check(&of_survey("", received(0, &gloved)), "props and gloves").found.clone();
    assert!(found.contains("1 props and 40 finger segments"), "{found}");
}

#[test]
fn a_used_port_names_its_process_and_a_running_adapter_is_queried() {
    let facts = |port, holder, observed| SuitFacts { port, holder, time: TIME, observed };
    let holder = Holder { process_id: 77, program: "viewer".to_owned() };
    let occupied =
        evaluate_suit(&config(""), &facts(Port::InUse, Some(holder), SuitObservation::Nothing(None)));
    assert!(
        fails(&occupied) == ["suit.listen"] && occupied[0].found.contains("taken by viewer (process 77)")
    );
    assert!(
        evaluate_suit(&config(""), &facts(Port::InUse, None, SuitObservation::Nothing(None)))[0]
            .fix
            .is_some()
    );
    let mut observation = BusObservation {
        samples: 100,
        blocks: SuitBlocks::LinearKinematics as u32,
        avatar: Some(0),
        health: None,
    };
    let mut health: equipoise_core::message::AdapterHealth = bytemuck::Zeroable::zeroed();
    (health.received, health.published, health.rate_hz, health.stream) = (1000, 500, 60.0, 1);
    health.refused[SuitRefusal::OutOfOrder.index()] = 100;
    observation.health = Some(health);
    let asked = |observation: &BusObservation| {
        evaluate_suit(
            &config(""),
            &facts(Port::OwnProcess, None, SuitObservation::OnTheBus(Box::new(observation.clone()))),
        )
    };
    let checks = asked(&observation);
    assert_eq!(fails(&checks), [""; 0]);
    assert!(check(&checks, "samples").found.contains("60.0 a second of character 0"));
    assert_eq!(check(&checks, "21 linear kinematics").found, "in the samples");
    assert_eq!(check(&checks, "22 angular kinematics").found, "not in the samples");
    assert_eq!(check(&checks, "refused").found, "100 out_of_order");
    assert_eq!(fails(&asked(&BusObservation::default())), ["samples"]);
    let external = config("").suit;
    let external = Config {
        suit: SuitConfig { source: equipoise_config::SuitSourceKind::External, ..external },
        ..config("")
    };
    let none = evaluate_suit(&external, &facts(Port::Free, None, SuitObservation::OnTheBus(Box::default())));
    assert!(fails(&none) == ["samples"] && fix(&none, "samples").contains("suit.forwarded"));
}
