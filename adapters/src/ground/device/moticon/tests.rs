use super::*;
use crate::ground::protocol::GroundProtocol;
use crate::ground::receiver::GroundSettings;
use equipoise_core::message::{Component, FootFrame, GroundDevice as DeviceKind, GroundSample};
use proptest::prelude::*;

/// A line with all channels (`plate_vectors.json`, `moticon_51`).
const VECTOR: &str = "12.34 0.01 -0.02 0.98 1.5 -2.5 3.5 -0.10 0.02 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 \
                      0.5 0.5 350.0 0.02 -0.01 0.97 0.5 0.6 0.7 0.12 -0.03 0.25 0.25 0.25 0.25 0.25 0.25 0.25 0.25 0.25 0.25 \
                      0.25 0.25 0.25 0.25 0.25 0.25 340.0";

fn settings() -> MoticonSettings {
    MoticonSettings {
        fields: all_fields(),
        length_m: 0.2486,
        width_m: 0.089,
        x_to_tip: true,
        y: Sideways::Medial,
        swapped: false,
        time: Unit::NanosecondInSeconds,
    }
}

fn protocol(settings: &MoticonSettings) -> GroundProtocol {
    let device = Box::new(Moticon::new(settings).unwrap());
    GroundProtocol::new(device, GroundSettings { device: DeviceKind::Insoles, ..GroundSettings::default() })
}

fn one(settings: &MoticonSettings, line: &str) -> GroundSample {
    let mut samples = Vec::new();
    protocol(settings).receive(line.as_bytes(), 1_000_000_000, &mut samples);
    samples[0]
}

#[test]
fn the_known_line_is_two_feet_and_nothing_that_insoles_cannot_feel() {
    let sample = one(&settings(), VECTOR);
    assert_eq!((sample.per_foot, sample.devices), (1, DeviceKind::Insoles as u32));
    assert_eq!(sample.foot_frame, FootFrame::Insole as u32);
    assert_eq!((sample.foot_vertical_n, sample.force_n), ([350.0, 340.0], [0.0, 0.0, 690.0]));
    // Medial is to the right on the left foot and to the left on the right foot.
    let want = [[-0.1 * 0.2486, -0.02 * 0.089], [0.12 * 0.2486, -0.03 * 0.089]];
    for (got, want) in sample.foot_cop_m.iter().flatten().zip(want.iter().flatten()) {
        assert!((got - want).abs() < 1e-12, "{:?}", sample.foot_cop_m);
    }
    for component in [Component::Shear, Component::Tilt, Component::FreeMoment] {
        assert!(!sample.measures(component));
    }
}

#[test]
fn ends_sides_and_feet_may_be_the_other_way_round() {
    let plain = one(&settings(), VECTOR);
    let heel = one(&MoticonSettings { x_to_tip: false, ..settings() }, VECTOR);
    assert_eq!(heel.foot_cop_m.map(|[x, y]| [-x, y]), plain.foot_cop_m);
    let lateral = one(&MoticonSettings { y: Sideways::Lateral, ..settings() }, VECTOR);
    assert_eq!(lateral.foot_cop_m.map(|[x, y]| [x, -y]), plain.foot_cop_m);
    let left = one(&MoticonSettings { y: Sideways::Left, ..settings() }, VECTOR);
    assert_eq!(left.foot_cop_m, [lateral.foot_cop_m[0], plain.foot_cop_m[1]]);
    let swapped = one(&MoticonSettings { swapped: true, y: Sideways::Left, ..settings() }, VECTOR);
    assert_eq!(swapped.foot_vertical_n, [340.0, 350.0]);
    assert_eq!(swapped.foot_cop_m, [left.foot_cop_m[1], left.foot_cop_m[0]]);
}

#[test]
fn fewer_channels_are_a_shorter_list_and_what_is_missing_is_named() {
    let fields = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let seven = "time left_cop_x left_cop_y left_force right_cop_x right_cop_y right_force";
    let short = MoticonSettings { fields: fields(seven), ..settings() };
    assert_eq!(one(&short, "1.00 0.1 0 350 0 0 340").foot_vertical_n, [350.0, 340.0]);
    let fault =
        |text: &str| Moticon::new(&MoticonSettings { fields: fields(text), ..settings() }).unwrap_err();
    assert_eq!(fault(&seven.replace("right_force", "-")), FieldsFault::Missing("right_force".to_owned()));
    assert_eq!(fault(&format!("{seven} left_farce")), FieldsFault::Unknown("left_farce".to_owned()));
    assert_eq!(fault(&format!("{seven} left_force")), FieldsFault::Twice("left_force".to_owned()));
    let flat = Moticon::new(&MoticonSettings { width_m: 0.0, ..settings() }).unwrap_err();
    assert!(flat.to_string().contains("width"), "{flat}");
    let mut protocol = protocol(&short);
    protocol.receive(VECTOR.as_bytes(), 1, &mut Vec::new());
    assert_eq!(protocol.counts().refused[GroundRefusal::Fields.index()], 1);
}

#[test]
fn a_list_in_another_order_than_the_software_sends_is_noticed() {
    let mut mixed = settings();
    mixed.fields.swap(7, 6);
    let mut wrong = protocol(&mixed);
    let mut samples = Vec::new();
    for index in 0..REPORTED_AFTER_SAMPLES {
        assert_eq!(wrong.diagnostic(), None);
        let line = VECTOR.replacen("12.34", &format!("{}.00", 12 + index), 1);
        wrong.receive(line.as_bytes(), 1_000_000_000 * u64::from(index + 1), &mut samples);
    }
    assert!(samples.is_empty() && wrong.diagnostic().is_some_and(|said| said.contains("outside the insole")));

    let mut numb = protocol(&settings());
    let silent = VECTOR.replace(" 0.5", " 0.0");
    for index in 0..REPORTED_AFTER_SAMPLES {
        let line = silent.replacen("12.34", &format!("{}.00", 12 + index), 1);
        numb.receive(line.as_bytes(), 1_000_000_000 * u64::from(index + 1), &mut samples);
    }
    assert_eq!(samples.len(), REPORTED_AFTER_SAMPLES as usize);
    assert!(numb.diagnostic().is_some_and(|said| said.contains("feels pressure")));
}

#[test]
fn a_line_that_contradicts_itself_is_refused_and_not_lost() {
    let mut protocol = protocol(&settings());
    let mut samples = Vec::new();
    for index in 0..20u32 {
        let line = VECTOR.replacen("12.34", &format!("12.{:02}", 30 + index), 1);
        let line = if index % 8 == 7 { line.replacen("-0.10", "-0.90", 1) } else { line };
        protocol.receive(line.as_bytes(), 1_000_000_000 + u64::from(index) * 10_000_000, &mut samples);
    }
    assert_eq!((samples.len(), protocol.counts().lost), (18, 0));
    assert_eq!(protocol.counts().refused[GroundRefusal::Implausible.index()], 2);
}

proptest! {
    #[test]
    fn loss_is_counted_by_the_stamps_whatever_the_rate(
        rate_hz in prop_oneof![Just(25u32), Just(50), Just(75), Just(100)],
        drops in proptest::collection::btree_set(10u32..200, 0..30),
    ) {
        let mut protocol = protocol(&settings());
        let mut samples = Vec::new();
        // Sensors are sampled at exact intervals; stamps are rounded to milliseconds.
        for index in (0..200).filter(|index| !drops.contains(index)) {
            let line = VECTOR.replacen("12.34", &format!("{:.3}", 5.0 + f64::from(index) / f64::from(rate_hz)), 1);
            let arrival_ns = 7_000_000_000 + u64::from(index) * 1_000_000_000 / u64::from(rate_hz);
            protocol.receive(line.as_bytes(), arrival_ns, &mut samples);
        }
        // A loss at the end of the stream cannot be detected.
        let missed = drops.iter().filter(|index| (**index..200).any(|later| !drops.contains(&later))).count();
        prop_assert_eq!(protocol.counts().lost, missed as u64);
        prop_assert_eq!(samples.len(), 200 - drops.len());
        prop_assert!(samples.iter().all(|sample| sample.session == 0));
    }

    #[test]
    fn garbage_never_panics(datagrams in proptest::collection::vec("[0-9. e-]{0,200}", 0..20)) {
        let mut protocol = protocol(&settings());
        let mut samples = Vec::new();
        for datagram in datagrams {
            protocol.receive(datagram.as_bytes(), 1, &mut samples);
        }
    }
}
