//! Validates a model file's text into a runnable model.

use equipoise_core::body::Segment;
use equipoise_core::effect::{Effect, PARAMETERS_MAX, Place, TERMS_MAX};

use super::limits::{LOG_ODDS_MAX, SHAPES, SIGMA_MAX, TIME_MAX_S, largest};
use super::text::{self, HANDS, Raw, RawEffect, RawParameter};
use super::{Fitted, ModelFile, ModelFileError, Provenance, VERSION};

/// The validated file.
pub(super) fn checked(raw: Raw, name: &str) -> Result<ModelFile, ModelFileError> {
    let wrong = |place: String, what: String| Err(ModelFileError::Wrong { place, what });
    if raw.version != VERSION {
        let what = format!("version {} is not one that this release reads; it reads {VERSION}", raw.version);
        return wrong(format!("{name}, version"), what);
    }
    let own = raw.provenance.iter().map(|provenance| ("provenance", provenance));
    for (table, provenance) in own.chain(raw.merged_from.iter().map(|provenance| ("merged_from", provenance)))
    {
        if let Err((key, what)) = check_provenance(provenance) {
            return wrong(format!("{name}, {table}, {key}"), what);
        }
    }
    let mut effects = Vec::new();
    for (index, effect) in raw.effect.into_iter().enumerate() {
        match fitted(effect) {
            Ok(fitted) => effects.push(fitted),
            Err((key, what)) => return wrong(format!("{name}, effect {}, {key}", index + 1), what),
        }
    }
    let applied = effects.iter().filter(|fitted| !fitted.is_rejected()).count();
    if applied > TERMS_MAX {
        return wrong(name.to_owned(), format!("{applied} effects; the loop runs at most {TERMS_MAX}"));
    }
    if let Some(ask) = &raw.ask
        && let Err((key, what)) = super::ask::check(ask)
    {
        return wrong(format!("{name}, ask, {key}"), what);
    }
    Ok(ModelFile { provenance: raw.provenance, merged_from: raw.merged_from, effects, ask: raw.ask })
}

/// The invalid key and its error message.
type Refusal = (String, String);

fn refuse<T>(key: &str, what: impl Into<String>) -> Result<T, Refusal> {
    Err((key.to_owned(), what.into()))
}

fn check_provenance(provenance: &Provenance) -> Result<(), Refusal> {
    let hash = &provenance.recording_sha256;
    if hash.len() != 64 || !hash.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return refuse("recording_sha256", "must be 64 hexadecimal digits");
    }
    // A subject identified before the recording has an empty identification span.
    let [from_s, to_s] = provenance.identify_s;
    if from_s != to_s {
        check_span("identify_s", provenance.identify_s)?;
    }
    check_span("work_s", provenance.work_s)?;
    provenance.reference_s.map_or(Ok(()), |span_s| check_span("reference_s", span_s))
}

/// A span of the recording, s; comparisons with NaN are false, so NaN is rejected too.
fn check_span(key: &str, [from_s, to_s]: [f64; 2]) -> Result<(), Refusal> {
    if from_s >= 0.0 && from_s < to_s && to_s <= TIME_MAX_S {
        return Ok(());
    }
    refuse(key, format!("[{from_s}, {to_s}] is not a span: give seconds of the recording, the earlier first"))
}

fn fitted(raw: RawEffect) -> Result<Fitted, Refusal> {
    let Some(effect) = Effect::from_name(&raw.name) else {
        let known = Effect::ALL.map(Effect::name);
        return refuse("name", format!("`{}` is not an effect{}", raw.name, text::hint(&raw.name, &known)));
    };
    let place = place(&raw, effect)?;
    check_span("span_s", raw.span_s)?;
    if !(-LOG_ODDS_MAX..=LOG_ODDS_MAX).contains(&raw.log_odds) {
        return refuse("log_odds", format!("{} is not between -1e12 and 1e12", raw.log_odds));
    }
    let (shape, shape_sigma) = shape(&raw, effect)?;
    let (value, sigma) = values(&raw, effect, shape)?;
    if let Some(review) = &raw.review {
        review.check().or_else(|(key, what)| refuse(&format!("review.{key}"), what))?;
    }
    let RawEffect { span_s, open_ended, log_odds, review, .. } = raw;
    Ok(Fitted { effect, place, shape, shape_sigma, value, sigma, span_s, open_ended, log_odds, review })
}

fn place(raw: &RawEffect, effect: Effect) -> Result<Place, Refusal> {
    let named = match (&raw.place.hand, &raw.place.segment) {
        (None, None) => Place::Whole,
        (Some(hand), None) => match HANDS.iter().find(|(name, _)| name == hand) {
            Some((_, place)) => *place,
            None => {
                let known = HANDS.map(|(name, _)| name);
                let what = format!("`{hand}` is not a hand{}", text::hint(hand, &known));
                return refuse("where.hand", what);
            }
        },
        (None, Some(segment)) => match text::segment_named(segment) {
            Some(segment) => Place::Segment(segment),
            None => {
                let known = Segment::ALL.map(Segment::name);
                let what = format!("`{segment}` is not a segment{}", text::hint(segment, &known));
                return refuse("where.segment", what);
            }
        },
        (Some(_), Some(_)) => return refuse("where", "give a hand or a segment, not both"),
    };
    if effect.accepts(named) {
        return Ok(named);
    }
    let wanted = match effect.places().first().copied().and_then(text::place_name) {
        Some(("hand", _)) if effect.accepts(Place::BothHands) => {
            "where = { hand = … } with left, right or both"
        }
        Some(("hand", _)) => "where = { hand = … } with left or right",
        Some(_) => "where = { segment = … } with a segment's name",
        None => "no `where`: it concerns the whole plate or suit",
    };
    refuse("where", format!("{} does not act there; it takes {wanted}", effect.name()))
}

fn shape(raw: &RawEffect, effect: Effect) -> Result<(f64, f64), Refusal> {
    let Some(name) = effect.shape_name() else { return Ok((0.0, 0.0)) };
    let Some(written) = raw.parameters.get(name) else {
        // A drift without a time constant is linear.
        return if effect == Effect::PlateDrift {
            Ok((0.0, 0.0))
        } else {
            refuse(&format!("parameters.{name}"), "must be given")
        };
    };
    let [lag, cutoff, frequency, time_constant] = SHAPES;
    let [min, max] = match effect {
        Effect::SuitLag => lag,
        Effect::PlateLowpass => cutoff,
        Effect::PeriodicSway => frequency,
        _ => time_constant,
    };
    check_parameter(name, written, text::shape_unit(effect), [min, max])?;
    Ok((written.value, written.sigma))
}

fn values(
    raw: &RawEffect,
    effect: Effect,
    shape: f64,
) -> Result<([f64; PARAMETERS_MAX], [f64; PARAMETERS_MAX]), Refusal> {
    let parameters = effect.parameters_of(shape);
    let mut known: Vec<&str> = parameters.iter().map(|parameter| parameter.name).collect();
    known.extend(effect.shape_name().filter(|name| !known.contains(name)));
    if let Some(unknown) = raw.parameters.keys().find(|name| !known.contains(&name.as_str())) {
        let what = format!("{} has no parameter `{unknown}`{}", effect.name(), text::hint(unknown, &known));
        return refuse(&format!("parameters.{unknown}"), what);
    }
    if raw.parameters.is_empty() {
        return refuse("parameters", format!("give at least one of {}", known.join(", ")));
    }
    let (mut value, mut sigma) = ([0.0; PARAMETERS_MAX], [0.0; PARAMETERS_MAX]);
    for (index, parameter) in parameters.iter().enumerate() {
        let Some(written) = raw.parameters.get(parameter.name) else { continue };
        let max = largest(parameter.unit);
        check_parameter(parameter.name, written, parameter.unit, [-max, max])?;
        (value[index], sigma[index]) = (written.value, written.sigma);
    }
    Ok((value, sigma))
}

fn check_parameter(
    name: &str,
    written: &RawParameter,
    unit: &str,
    [min, max]: [f64; 2],
) -> Result<(), Refusal> {
    if written.unit != unit {
        return refuse(&format!("parameters.{name}.unit"), format!("`{}` must be `{unit}`", written.unit));
    }
    for (key, number, min, max) in
        [("sigma", written.sigma, 0.0, SIGMA_MAX * max), ("value", written.value, min, max)]
    {
        if !(min..=max).contains(&number) {
            let what = format!("{number} is not between {min} and {max}");
            return refuse(&format!("parameters.{name}.{key}"), what);
        }
    }
    Ok(())
}
