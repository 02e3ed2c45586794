//! The file's layout, both ways, and error messages for parser errors.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use equipoise_core::body::{Segment, Side};
use equipoise_core::effect::{Effect, Place};
use serde::Deserialize;

use super::{Ask, Fitted, ModelFile, ModelFileError, Parameter, Provenance, Review, VERSION};

/// The file as parsed, before validation.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Raw {
    pub(super) version: u32,
    pub(super) provenance: Option<Provenance>,
    #[serde(default)]
    pub(super) merged_from: Vec<Provenance>,
    pub(super) ask: Option<Ask>,
    #[serde(default)]
    pub(super) effect: Vec<RawEffect>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawEffect {
    pub(super) name: String,
    #[serde(default, rename = "where")]
    pub(super) place: RawPlace,
    pub(super) span_s: [f64; 2],
    pub(super) open_ended: bool,
    pub(super) log_odds: f64,
    pub(super) review: Option<Review>,
    #[serde(default)]
    pub(super) parameters: BTreeMap<String, RawParameter>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPlace {
    pub(super) hand: Option<String>,
    pub(super) segment: Option<String>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawParameter {
    pub(super) value: f64,
    pub(super) sigma: f64,
    pub(super) unit: String,
}

/// Names of hands and their places.
pub(super) const HANDS: [(&str, Place); 3] =
    [("left", Place::Hand(Side::Left)), ("right", Place::Hand(Side::Right)), ("both", Place::BothHands)];

/// Key and name of a place; `None` for the whole body.
pub(super) fn place_name(place: Place) -> Option<(&'static str, &'static str)> {
    match place {
        Place::Whole => None,
        Place::Segment(segment) => Some(("segment", segment.name())),
        hand => HANDS.iter().find(|(_, other)| *other == hand).map(|(name, _)| ("hand", *name)),
    }
}

/// The segment of that name.
pub(super) fn segment_named(name: &str) -> Option<Segment> {
    Segment::ALL.into_iter().find(|segment| segment.name() == name)
}

/// The unit of a shape.
pub(super) fn shape_unit(effect: Effect) -> &'static str {
    match effect {
        Effect::PlateLowpass | Effect::PeriodicSway => "Hz",
        _ => "s",
    }
}

/// Whether the shape is the effect's one parameter.
pub(super) fn shape_is_parameter(effect: Effect) -> bool {
    matches!(effect, Effect::SuitLag | Effect::PlateLowpass)
}

/// The file as TOML.
pub(super) fn of(file: &ModelFile) -> String {
    let mut text = format!(
        "# What the model of this station has in addition to the body. `equipoise check` says whether a configuration with it can \
         be\n# used.\nversion = {VERSION}\n"
    );
    let own = file.provenance.iter().map(|provenance| ("[provenance]", provenance));
    let merged = file.merged_from.iter().map(|provenance| ("[[merged_from]]", provenance));
    for (head, provenance) in own.chain(merged) {
        // Every value has a TOML form: strings and numbers.
        let table = toml::to_string(provenance).unwrap_or_default();
        let _ = write!(text, "\n{head}\n{table}");
    }
    if let Some(ask) = &file.ask {
        super::ask::write(&mut text, ask);
    }
    for fitted in &file.effects {
        write_effect(&mut text, fitted);
    }
    text
}

fn write_effect(text: &mut String, fitted: &Fitted) {
    let [from_s, to_s] = fitted.span_s;
    // Writing to a string cannot fail.
    let _ = write!(text, "\n[[effect]]\nname = \"{}\"\n", fitted.effect.name());
    if let Some((key, name)) = place_name(fitted.place) {
        let _ = writeln!(text, "where = {{ {key} = \"{name}\" }}");
    }
    let _ = writeln!(text, "span_s = [{from_s:?}, {to_s:?}]");
    let _ = writeln!(text, "open_ended = {}\nlog_odds = {:?}", fitted.open_ended, fitted.log_odds);
    if let Some(review) = &fitted.review {
        let _ = writeln!(text, "review = {}", review.to_toml());
    }
    for Parameter { name, value, sigma, unit } in fitted.parameters() {
        let _ = write!(
            text,
            "[effect.parameters.{name}]\nvalue = {value:?}\nsigma = {sigma:?}\nunit = \"{unit}\"\n"
        );
    }
}

/// Error message for a parser's error: file, line, effect, and the nearest valid key.
pub(super) fn explain(error: &toml::de::Error, text: &str, name: &str) -> ModelFileError {
    let place = match error.span() {
        Some(span) => place_at(text, span.start, name),
        None => name.to_owned(),
    };
    let said = error.message();
    let what = match unknown(said) {
        Some((unknown, known)) => format!("`{unknown}` is not known{}", hint(unknown, &known)),
        None => said.to_owned(),
    };
    ModelFileError::Wrong { place, what }
}

/// File, line, and the number of the effect that the line is part of.
fn place_at(text: &str, byte: usize, name: &str) -> String {
    let end = text.bytes().take(byte).filter(|byte| *byte == b'\n').count() + 1;
    let effect = text.lines().take(end).filter(|line| line.trim() == "[[effect]]").count();
    let effect = if effect > 0 { format!(", effect {effect}") } else { String::new() };
    format!("{name}, line {end}{effect}")
}

/// Parses serde's "unknown field `a`, expected one of `b`, `c`".
fn unknown(said: &str) -> Option<(&str, Vec<&str>)> {
    let rest = said.strip_prefix("unknown field ")?;
    let mut quoted = rest.split('`').skip(1).step_by(2);
    let unknown = quoted.next()?;
    Some((unknown, quoted.collect()))
}

/// "; did you mean `b`? (known here: a, b)".
pub(super) fn hint(unknown: &str, known: &[&str]) -> String {
    let likeness = |name: &str| strsim::jaro_winkler(name, unknown);
    let nearest = known.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    nearest.map_or_else(String::new, |nearest| {
        format!("; did you mean `{nearest}`? (known here: {})", known.join(", "))
    })
}
