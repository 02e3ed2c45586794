//! From a session to a finding, on sessions of known truth.
#![expect(clippy::unwrap_used, reason = "a test may panic, and so may its helpers")]

mod support;

use equipoise_core::body::{Segment, Side};
use equipoise_core::effect::{Effect, Place};
use equipoise_discrepancy::block::Block;
use equipoise_discrepancy::finding::Verdict;
use equipoise_discrepancy::session::{LeftOut, Session};
use equipoise_discrepancy::{Options, Outcome, reconcile};
use support::{END_S, REFERENCE_S, clean, hide};

fn answer(session: &Session) -> Outcome {
    reconcile(session, &Options::default(), &mut |_| {}).unwrap()
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    for seed in 1..4 {
        let outcome = answer(&clean(seed));
        assert_eq!(outcome.finding.verdict, Verdict::None, "{:#?}", outcome.finding);
        assert!(outcome.terms.is_empty());
    }
}

#[test]
fn a_load_in_the_right_hand_is_named_and_the_gap_shrinks() {
    let mut session = clean(7);
    hide(&mut session, Effect::HandLoad, Place::Hand(Side::Right), &[1.0], [REFERENCE_S, END_S]);
    let outcome = answer(&session);
    let finding = &outcome.finding;
    assert_eq!(finding.effects[0].name, "hand_load", "{finding:#?}");
    assert_eq!(finding.effects[0].place["hand"], "right");
    let mass = finding.effects[0].parameters["mass_kg"];
    assert!((mass.value - 1.0).abs() < 3.0 * mass.sigma.max(0.02), "{mass:?}");
    assert!(finding.gap.after_mm < 0.7 * finding.gap.before_mm, "{:?}", finding.gap);
}

#[test]
fn what_was_wrong_with_the_worker_before_belongs_to_neither_side_of_the_gap() {
    let gap_of = |chest_m: f64| {
        let mut session = clean(7);
        hide(&mut session, Effect::HandLoad, Place::Hand(Side::Right), &[1.0], [REFERENCE_S, END_S]);
        let chest = Place::Segment(Segment::T8);
        hide(&mut session, Effect::UnbalancedParameters, chest, &[chest_m, 0.0, 0.0], [0.0, END_S]);
        answer(&session).finding.gap
    };
    let [right, wrong] = [0.0, 0.02].map(gap_of);
    assert!((wrong.before_mm / right.before_mm - 1.0).abs() < 0.2, "{right:?} {wrong:?}");
    assert!(wrong.after_mm < 0.7 * wrong.before_mm, "{wrong:?}");
}

#[test]
fn a_backpack_that_is_put_on_halfway_is_named_with_its_time() {
    let mut session = clean(9);
    hide(&mut session, Effect::WornMass, Place::Segment(Segment::T8), &[3.0, -0.4, 0.0, 0.0], [250.0, END_S]);
    let outcome = answer(&session);
    let effect = &outcome.finding.effects[0];
    assert_eq!(effect.name, "worn_mass", "{:#?}", outcome.finding);
    assert!((effect.place["from_s"].as_f64().unwrap() - 250.0).abs() < 3.0, "{:?}", effect.place);
    assert!(outcome.terms[0].term.span_s[1].is_infinite());
}

#[test]
fn a_plate_that_lies_askew_is_named() {
    let mut session = clean(11);
    hide(&mut session, Effect::PlateGain, Place::Whole, &[0.06, 0.06], [REFERENCE_S, END_S]);
    let outcome = answer(&session);
    assert_eq!(outcome.finding.effects[0].name, "plate_gain", "{:#?}", outcome.finding);
}

#[test]
fn a_large_effect_keeps_its_size() {
    let mut session = clean(11);
    // Six times the catalogue's prior.
    hide(&mut session, Effect::PlateDrift, Place::Whole, &[0.0005, 0.0005], [REFERENCE_S, END_S]);
    let outcome = answer(&session);
    let effect = &outcome.finding.effects[0];
    assert_eq!(effect.name, "plate_drift", "{:#?}", outcome.finding);
    let [x, y] = ["vx_m_per_s", "vy_m_per_s"].map(|name| effect.parameters[name].value);
    assert!((x / 0.0005 - 1.0).abs() < 0.05 && (y / 0.0005 - 1.0).abs() < 0.05, "{:?}", effect.parameters);
}

#[test]
fn a_strong_push_for_a_while_is_named_with_both_of_its_edges() {
    let mut session = clean(13);
    let hand = Place::Hand(Side::Left);
    hide(&mut session, Effect::HandContact, hand, &[8.0, -4.0, 45.0], [231.3, 262.9]);
    let outcome = answer(&session);
    let effect = &outcome.finding.effects[0];
    assert_eq!(
        (effect.name.as_str(), &effect.place["hand"]),
        ("hand_contact", &"left".into()),
        "{:#?}",
        outcome.finding
    );
    for (edge, truth_s) in [("from_s", 231.3), ("to_s", 262.9)] {
        assert!((effect.place[edge].as_f64().unwrap() - truth_s).abs() < 1.0, "{:?}", effect.place);
    }
    let up = effect.parameters["fz_n"];
    assert!((up.value - 45.0).abs() < 3.0 * up.sigma, "{up:?}");
}

#[test]
fn a_large_heading_error_is_estimated_without_bias() {
    let mut session = clean(15);
    hide(&mut session, Effect::SegmentHeading, Place::Segment(Segment::T8), &[-0.7], [REFERENCE_S, END_S]);
    let outcome = answer(&session);
    let effect = &outcome.finding.effects[0];
    assert_eq!((effect.name.as_str(), &effect.place["segment"]), ("segment_heading", &"T8".into()));
    let psi = effect.parameters["psi_rad"];
    assert!((psi.value + 0.7).abs() < 0.03, "{psi:?}");
}

/// Thighs turned by four degrees are soft tissue, and their evidence must not support any other conclusion.
#[test]
fn a_trifle_is_not_named_and_nothing_in_its_place() {
    let mut session = clean(17);
    for thigh in [Segment::LeftUpperLeg, Segment::RightUpperLeg] {
        hide(&mut session, Effect::SegmentHeading, Place::Segment(thigh), &[0.07], [REFERENCE_S, END_S]);
    }
    let finding = answer(&session).finding;
    assert_eq!(finding.verdict, Verdict::None, "{finding:#?}");
    assert!(!finding.set_aside.is_empty(), "{finding:#?}");
}

#[test]
fn too_little_work_is_an_error_that_counts_what_was_left_out_and_why() {
    let mut session = clean(5);
    session.blocks.retain(|block| block.observation.time_s < REFERENCE_S + 4.0);
    let error =
        |session: &Session| reconcile(session, &Options::default(), &mut |_| {}).unwrap_err().to_string();
    assert!(error(&session).ends_with("choose a longer span with --work"), "{}", error(&session));
    session.left_out = LeftOut { lifted_foot: 431, impact: 3, ..LeftOut::default() };
    let error = error(&session);
    let expected = "; left out: 431 within 0.4 s of a lifted foot (ankle 4 cm above the other), 3 with the \
                    acceleration of an impact; if both feet stood, a sensor of a leg is displaced: fasten it, and \
                    calibrate the suit";
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn any_value_that_is_not_a_number_is_an_error() {
    let damages: [fn(&mut Block); 4] = [
        |block| block.observation.rotation[3][0][1] = f64::NAN,
        |block| block.joint_rad[3][0] = f64::INFINITY,
        |block| block.by_lag[0].cop_m[0] = f64::NAN,
        |block| block.observation.force_measured_n[2] = f64::NAN,
    ];
    for damage in damages {
        let mut session = clean(5);
        let block = session.blocks.last_mut().unwrap();
        damage(block);
        let expected = format!("a value of the block at {:.1} s is not a number", block.observation.time_s);
        let error = reconcile(&session, &Options::default(), &mut |_| {}).unwrap_err().to_string();
        assert!(error.starts_with(&expected), "{error}");
    }
}
