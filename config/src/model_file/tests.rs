use equipoise_core::body::{Segment, Side};
use proptest::prelude::*;

use super::*;

const TEXT: &str = r#"version = 1
[provenance]
recording_sha256 = "00112233445566778899aabbccddeeff00112233445566778899AABBCCDDEEFF"
date = "2026-03-01T08:30:00Z"
subject = "anon-1"
station = "station-1"
software = "0.1.0"
identify_s = [0, 90]
work_s = [240.0, 330.5]

[[effect]]
name = "worn_mass"
where = { segment = "T8" }
span_s = [120.0, 640.0]
open_ended = true
log_odds = 83.0
[effect.parameters.mass_kg]
value = 2.1
sigma = 0.05
unit = "kg"

[[effect]]
name = "plate_drift"
span_s = [10, 20]
open_ended = false
log_odds = 9.5
[effect.parameters.tau_s]
value = 40.0
sigma = 5.0
unit = "s"
[effect.parameters.ax_m]
value = 0.02
sigma = 0.001
unit = "m"
"#;

fn refusal(text: &str) -> String {
    ModelFile::parse(text, "m.toml").expect_err("must be refused").to_string()
}

#[test]
fn what_stands_in_a_file_is_what_runs() {
    let file = ModelFile::parse(TEXT, "m.toml").unwrap();
    let [worn, drift] = &file.effects[..] else { panic!("two effects") };
    assert_eq!((worn.effect, worn.place), (Effect::WornMass, Place::Segment(Segment::T8)));
    assert_eq!((worn.value, worn.sigma[0]), ([2.1, 0.0, 0.0, 0.0], 0.05));
    assert_eq!((drift.shape, drift.value), (40.0, [0.02, 0.0, 0.0, 0.0]));
    assert_eq!((worn.name().as_str(), drift.name().as_str()), ("worn_mass T8", "plate_drift"));

    let (here, none) = file.model(Spans::Hold { begin_ns: 7 });
    assert!(none.is_empty());
    assert_eq!(here.origin_ns, Some(7));
    let spans: Vec<_> = here.terms.iter().flatten().map(|term| term.span_s).collect();
    assert_eq!(spans, [[120.0, f64::INFINITY], [10.0, 20.0]]);
    let (elsewhere, left_out) = file.model(Spans::OpenEndedForEver);
    assert_eq!((elsewhere.terms.iter().flatten().count(), elsewhere.origin_ns), (1, None));
    assert_eq!(elsewhere.terms[0].unwrap().span_s, [0.0, f64::INFINITY]);
    assert_eq!(left_out, [drift]);

    assert!(file.is_of("00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff"));
    assert!(!file.is_of(""));
    assert!(!ModelFile::default().is_of(""));
}

#[test]
fn what_grows_with_time_is_applied_to_its_recording_only() {
    let applied = |effect: Effect, shape: f64, spans: Spans| {
        let mut file = ModelFile::parse(TEXT, "m.toml").unwrap();
        file.effects[0] = Fitted { effect, place: Place::Whole, shape, ..file.effects[0].clone() };
        let (model, left_out) = file.model(spans);
        let is_left_out = left_out.iter().any(|fitted| fitted.effect == effect && fitted.open_ended);
        assert_eq!(
            model.terms.iter().flatten().any(|term| term.effect == effect && term.shape == shape),
            !is_left_out
        );
        !is_left_out
    };
    for (effect, shape) in [(Effect::PlateDrift, 0.0), (Effect::SuitHeadingDrift, 0.0)] {
        assert!(
            applied(effect, shape, Spans::Hold { begin_ns: 0 })
                && !applied(effect, shape, Spans::OpenEndedForEver)
        );
    }
    assert!(applied(Effect::PlateDrift, 90.0, Spans::OpenEndedForEver), "it has an end");
}

/// Changes of [`TEXT`] that make it invalid, and a part of the message.
const INVALID: &[(&str, &str, &str)] = &[
    ("version = 1", "version = 2", "m.toml, version: version 2 is not one that this release reads"),
    (
        "\"worn_mass\"",
        "\"wornmass\"",
        "m.toml, effect 1, name: `wornmass` is not an effect; did you mean `worn_mass`?",
    ),
    ("\"T8\"", "\"T9\"", "m.toml, effect 1, where.segment: `T9` is not a segment; did you mean `T8`?"),
    ("segment = \"T8\"", "hand = \"rihgt\"", "where.hand: `rihgt` is not a hand; did you mean `right`?"),
    (
        "segment = \"T8\"",
        "hand = \"right\"",
        "effect 1, where: worn_mass does not act there; it takes where = { segment",
    ),
    ("segment =", "sgement =", "m.toml, line 13, effect 1: `sgement` is not known; did you mean `segment`?"),
    (
        "where = { segment = \"T8\" }",
        "where = { segment = \"T8\", hand = \"left\" }",
        "a hand or a segment, not both",
    ),
    (
        "name = \"plate_drift\"",
        "name = \"plate_drift\"\nwhere = { hand = \"left\" }",
        "effect 2, where: plate_drift does not",
    ),
    ("[120.0, 640.0]", "[640.0, 120.0]", "m.toml, effect 1, span_s: [640, 120] is not a span"),
    ("[120.0, 640.0]", "[nan, 120.0]", "effect 1, span_s: [NaN, 120] is not a span"),
    ("83.0", "inf", "m.toml, effect 1, log_odds: inf is not between -1e12 and 1e12"),
    ("83.0", "-2e12", "effect 1, log_odds: -2000000000000 is not between"),
    (
        "parameters.mass_kg]",
        "parameters.mas_kg]",
        "parameters.mas_kg: worn_mass has no parameter `mas_kg`; did you mean `mass_kg`?",
    ),
    (
        "value = 2.1",
        "value = 2100.0",
        "m.toml, effect 1, parameters.mass_kg.value: 2100 is not between -150 and 150",
    ),
    ("value = 2.1", "value = nan", "parameters.mass_kg.value: NaN is not between"),
    (
        "sigma = 0.05",
        "sigma = -0.05",
        "m.toml, effect 1, parameters.mass_kg.sigma: -0.05 is not between 0 and 15000",
    ),
    ("sigma = 0.05", "sigma = 20000.0", "parameters.mass_kg.sigma: 20000 is not between 0 and 15000"),
    ("sigma = 0.05", "sigma = inf", "parameters.mass_kg.sigma: inf is not between"),
    ("sigma = 5.0", "sigma = 2e7", "parameters.tau_s.sigma: 20000000 is not between 0 and 10000000"),
    ("unit = \"kg\"", "unit = \"g\"", "m.toml, effect 1, parameters.mass_kg.unit: `g` must be `kg`"),
    (
        "value = 40.0",
        "value = -1.0",
        "m.toml, effect 2, parameters.tau_s.value: -1 is not between 0.1 and 100000",
    ),
    ("tau_s", "hz", "effect 2, parameters.ax_m: plate_drift has no parameter `ax_m`; did you mean"),
    ("DDEEFF\"", "DDEEF\"", "m.toml, provenance, recording_sha256: must be 64"),
    ("[0, 90]", "[90, 0]", "m.toml, provenance, identify_s: [90, 0] is not a span"),
    (
        "open_ended = true",
        "open_endet = true",
        "effect 1: `open_endet` is not known; did you mean `open_ended`?",
    ),
];

#[test]
fn an_error_names_file_effect_key_and_the_nearest_name() {
    let with = |from: &str, to: &str| {
        assert!(TEXT.contains(from));
        refusal(&TEXT.replacen(from, to, 1))
    };
    for (from, to, said) in INVALID {
        let found = with(from, to);
        assert!(found.contains(said), "{found}\nwanted: {said}");
    }
    assert!(refusal("version = 1\n[[effect]]\n").contains("line 2, effect 1: missing field `name`"));
    let one = TEXT.split("\n[[effect]]").nth(1).unwrap();
    let many = format!("version = 1\n{}", format!("[[effect]]{one}\n").repeat(TERMS_MAX + 1));
    assert_eq!(refusal(&many), "m.toml: 9 effects; the loop runs at most 8");
}

#[test]
fn what_cannot_do_without_its_shape_says_so() {
    let lag = |parameters: &str| {
        format!(
            "version = 1\n[[effect]]\nname = \"suit_lag\"\nspan_s = [0, 9]\nopen_ended = true\nlog_odds = 5.0\n{parameters}"
        )
    };
    assert!(refusal(&lag("")).contains("effect 1, parameters.tau_s: must be given"));
    let toml = lag("[effect.parameters.tau_s]\nvalue = 0.02\nsigma = 0.001\nunit = \"s\"\n");
    let file = ModelFile::parse(&toml, "m.toml").unwrap();
    assert_eq!((file.effects[0].shape, file.effects[0].value[0]), (0.02, 0.02));
}

#[test]
fn a_file_is_read_as_written_and_invalid_values_are_refused() {
    let file = ModelFile::parse(TEXT, "m.toml").unwrap();
    assert_eq!(ModelFile::parse(&file.to_toml(), "m.toml").unwrap(), file);

    let mut nonsense = file.clone();
    nonsense.effects[0].value[0] = 2100.0;
    let said = ModelFile::parse(&nonsense.to_toml(), "m.toml").unwrap_err().to_string();
    assert!(said.contains("parameters.mass_kg.value"), "{said}");
}

fn any_fitted() -> impl Strategy<Value = Fitted> {
    let effect = prop::sample::select(Effect::ALL.to_vec());
    let at = (0..100usize, 0.0..500.0f64, 0.01..500.0f64, any::<bool>(), -5.0..500.0f64);
    (effect, at, prop::array::uniform4(-0.009..0.009f64), prop::array::uniform4(0.0..1.0f64), 0.1..0.4f64)
        .prop_map(|(effect, (place, from_s, length_s, open_ended, log_odds), some, sigmas, shape)| {
            let shape = if effect.shape_name().is_some() { shape } else { 0.0 };
            let (mut value, mut sigma) = ([0.0; PARAMETERS_MAX], [0.0; PARAMETERS_MAX]);
            for index in 0..effect.parameters_of(shape).len() {
                (value[index], sigma[index]) = (some[index], sigmas[index]);
            }
            if matches!(effect, Effect::SuitLag | Effect::PlateLowpass) {
                (value[0], sigma[0]) = (shape, sigmas[0]);
            }
            let shape_sigma = if shape == 0.0 { 0.0 } else { sigmas[0] };
            let place = effect.places()[place % effect.places().len()];
            let span_s = [from_s, from_s + length_s];
            let review = None;
            Fitted { effect, place, shape, shape_sigma, value, sigma, span_s, open_ended, log_odds, review }
        })
}

proptest! {
    #[test]
    fn what_is_written_is_what_is_read(effects in prop::collection::vec(any_fitted(), 0..=TERMS_MAX)) {
        let file = ModelFile { effects, ..ModelFile::default() };
        let again = ModelFile::parse(&file.to_toml(), "written").unwrap();
        prop_assert_eq!(again, file);
    }
}

#[test]
fn every_place_has_a_name_that_leads_back() {
    for side in Side::BOTH {
        let (key, name) = text::place_name(Place::Hand(side)).unwrap();
        assert_eq!(
            (key, text::HANDS.iter().find(|(other, _)| *other == name).unwrap().1),
            ("hand", Place::Hand(side))
        );
    }
    for segment in Segment::ALL {
        assert_eq!(text::segment_named(segment.name()), Some(segment));
    }
}
