use super::*;
use crate::hidden::truth::{Hidden, Spans};
use serde_json::json;

/// Name, place and one parameter of a hidden effect.
type InjectedEffect = (&'static str, Option<(&'static str, &'static str)>, (&'static str, f64));

/// A truth with these hidden effects.
pub(crate) fn truth(hidden: &[InjectedEffect]) -> Truth {
    let effect = |(name, place, (parameter, value)): &InjectedEffect| Hidden {
        name: (*name).into(),
        place: place.iter().map(|(what, place)| ((*what).into(), (*place).into())).collect(),
        parameters: [((*parameter).into(), *value)].into(),
        span_s: [180.0, 270.0],
        flips_at_s: None,
        size: 2.0,
        from_beginning: false,
        description: "in words".into(),
    };
    Truth {
        session: "session-0001".into(),
        seed: 1,
        kind: hidden.first().map_or("clean".into(), |hidden| hidden.0.into()),
        noise: "ordinary".into(),
        height_m: 1.77,
        mass_kg: 72.0,
        spans: Spans { identify: [0.0, 60.0], reference: [60.0, 180.0], work: [180.0, 270.0] },
        reports_reference: true,
        length_s: 270.0,
        places: Vec::new(),
        turned: true,
        effects: hidden.iter().map(effect).collect(),
        effect_mm: 3.0,
    }
}

/// A finding as the program prints it.
pub(crate) fn finding(verdict: &str, effects: &[(&str, Value, Value)], candidates: &[(&str, f64)]) -> Value {
    let effects = effects.iter().map(|(name, place, parameters)| {
        json!({"name": name, "where": place, "parameters": parameters, "log_odds": 40.0,
               "probability": 0.98, "runner_up": null, "family": []})
    });
    let candidates = candidates
        .iter()
        .map(|(name, probability)| json!({"name": name, "log_odds": 20.0, "probability": probability}));
    json!({
        "verdict": verdict,
        "effects": effects.collect::<Vec<_>>(),
        "candidates": candidates.collect::<Vec<_>>(),
        "set_aside": [], "unexplained": [], "spans": [], "ask_next": null, "model": null,
        "gap": {"before_mm": 5.0, "after_mm": 4.2, "noise_floor_mm": 3.8, "held_out": true, "per_axis": {}},
    })
}

const LOAD: InjectedEffect = ("hand_load", Some(("hand", "right")), ("mass_kg", 0.5));

fn mass(value: f64) -> Value {
    json!({"mass_kg": {"value": value, "sigma": 0.05, "unit": "kg"}})
}

#[test]
fn the_right_name_at_the_right_place_is_exact_and_its_parameter_is_compared() {
    let answer = finding("named", &[("hand_load", json!({"hand": "right"}), mass(0.58))], &[]);
    let evaluated = evaluate(&truth(&[LOAD]), Ok(&answer), None, 1.0);
    assert!(evaluated.exact && evaluated.family && evaluated.found == 1);
    assert!((evaluated.parameters[0].error_over_sigma() - 1.6).abs() < 1e-9);
    // √(5² − 3²) = 4.
    assert!((evaluated.oracle_mm - 4.0).abs() < 1e-12);
    assert!((evaluated.over_the_oracle().unwrap() - 1.05).abs() < 1e-12);
    assert!((evaluate(&truth(&[LOAD]), Ok(&answer), Some(4.2), 1.0).oracle_mm - 4.2).abs() < 1e-12);
}

#[test]
fn a_forearm_is_family_of_its_hand_and_the_other_hand_is_wrong() {
    let forearm = finding("named", &[("worn_mass", json!({"segment": "RightForearm"}), mass(0.5))], &[]);
    let evaluated = evaluate(&truth(&[LOAD]), Ok(&forearm), None, 1.0);
    assert!(!evaluated.exact && evaluated.family && evaluated.parameters.is_empty());
    let left = finding("named", &[("hand_load", json!({"hand": "left"}), mass(0.5))], &[]);
    let evaluated = evaluate(&truth(&[LOAD]), Ok(&left), None, 1.0);
    assert!(!evaluated.exact && !evaluated.family && evaluated.found == 0);
}

#[test]
fn an_ambiguous_answer_is_right_if_its_set_holds_the_truth() {
    let candidates =
        [("plate_gain", 0.6), ("plate_crosstalk", 0.2), ("hand_load right", 0.15), ("plate_yaw", 0.03)];
    let answer = finding("ambiguous", &[], &candidates);
    let evaluated = evaluate(&truth(&[LOAD]), Ok(&answer), None, 1.0);
    assert!(!evaluated.exact && evaluated.family);
    let yaw = ("plate_yaw", None, ("psi_rad", 0.1));
    assert!(!evaluate(&truth(&[yaw]), Ok(&answer), None, 1.0).family);
}

#[test]
fn effects_with_the_same_columns_are_one_name_with_the_larger_probability() {
    let candidates = [("segment_misalignment T8", 0.8), ("unbalanced_parameters T8", 0.0)];
    let evaluated = evaluate(&truth(&[LOAD]), Ok(&finding("ambiguous", &[], &candidates)), None, 1.0);
    assert_eq!(evaluated.stated, [("segment_misalignment T8".to_owned(), 0.8)].into());
}

#[test]
fn a_declared_substitute_is_right_in_the_outcome_and_in_its_stated_probability() {
    let mut hidden = truth(&[("outside", None, ("mm", 20.0))]);
    hidden.kind = "outside spine_shape".into();
    let of = |segment: &str| {
        let answer =
            finding("named", &[("segment_misalignment", json!({"segment": segment}), json!({}))], &[]);
        let evaluated = evaluate(&hidden, Ok(&answer), None, 1.0);
        (evaluated.outcome(), evaluated.statements().collect::<Vec<_>>())
    };
    assert_eq!(of("T8"), (Outcome::Right, vec![(0.98, true)]));
    assert_eq!(of("Pelvis"), (Outcome::Wrong, vec![(0.98, false)]));
}

#[test]
fn effects_named_in_a_clean_session_are_false_alarms() {
    let clean = truth(&[]);
    let named = finding("named", &[("plate_yaw", json!({}), json!({}))], &[]);
    assert!(evaluate(&clean, Ok(&named), None, 1.0).is_false_alarm());
    assert!(!evaluate(&clean, Ok(&finding("none", &[], &[])), None, 1.0).is_false_alarm());
    assert!(evaluate(&clean, Err("no still poses"), None, 1.0).is_false_alarm());
}

#[test]
fn what_a_finding_lacks_is_not_right() {
    let load = [("hand_load", json!({"hand": "right"}), mass(0.5))];
    for key in GAP {
        let mut answer = finding("named", &load, &[]);
        answer["gap"][key] = Value::Null;
        let evaluated = evaluate(&truth(&[LOAD]), Ok(&answer), None, 1.0);
        assert!(
            evaluated.verdict == "failed" && evaluated.failure.is_some() && !evaluated.family,
            "{evaluated:?}"
        );
        assert_eq!(evaluated.over_the_oracle(), None);
    }
    // A verdict without names.
    for hidden in [&[LOAD][..], &[]] {
        let evaluated = evaluate(&truth(hidden), Ok(&finding("named", &[], &[])), None, 1.0);
        assert_eq!(evaluated.outcome(), Outcome::Wrong);
    }
    for part in ["value", "sigma"] {
        let mut parameters = mass(0.5);
        parameters["mass_kg"][part] = Value::Null;
        let answer = finding("named", &[("hand_load", json!({"hand": "right"}), parameters)], &[]);
        let evaluated = evaluate(&truth(&[LOAD]), Ok(&answer), None, 1.0);
        assert!(evaluated.parameters[0].error_over_sigma() > 2.0, "{part}: {:?}", evaluated.parameters);
    }
}

#[test]
fn both_of_a_pair_must_be_found_and_a_failure_is_reported() {
    let yaw = ("plate_yaw", None, ("psi_rad", 0.1));
    let both = finding(
        "named",
        &[("plate_yaw", json!({}), json!({})), ("hand_load", json!({"hand": "right"}), mass(0.5))],
        &[],
    );
    assert_eq!(evaluate(&truth(&[LOAD, yaw]), Ok(&both), None, 1.0).found, 2);
    let failed = evaluate(&truth(&[LOAD, yaw]), Err("no still poses"), None, 1.0);
    assert!(failed.verdict == "failed" && failed.found == 0 && failed.failure.is_some());
}
