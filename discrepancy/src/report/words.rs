//! Wording of effects and places, odds, and numbers with their uncertainty.

mod effects;

use std::collections::BTreeMap;

use equipoise_core::body::Segment;

use crate::finding::{Estimate, Named};
pub(super) use effects::{effect, remedy};

/// Place of a named effect, as in a candidate's name: `right`, `T8`, or empty.
pub(super) fn place_name(place: &BTreeMap<String, serde_json::Value>) -> String {
    ["hand", "segment"]
        .iter()
        .find_map(|key| place.get(*key))
        .map(|value| value.as_str().map_or_else(|| value.to_string(), str::to_owned))
        .unwrap_or_default()
}

/// Name with place, as in [`crate::finding::Candidate::name`].
pub(super) fn full_name(named: &Named) -> String {
    format!("{} {}", named.name, place_name(&named.place)).trim_end().to_owned()
}

/// A candidate's name in words.
pub(super) fn candidate(name: &str) -> String {
    let (name, place) = name.split_once(' ').unwrap_or((name, ""));
    effect(name, &place_in_words(place))
}

/// A place in words.
pub(super) fn place_in_words(place: &str) -> String {
    match place {
        "" => "a part of the body".to_owned(),
        "right" => "the right hand".to_owned(),
        "left" => "the left hand".to_owned(),
        "both" => "both hands".to_owned(),
        "Pelvis" => "the pelvis".to_owned(),
        "L5" => "the lower back (L5)".to_owned(),
        "L3" => "the lower back (L3)".to_owned(),
        "T12" => "the middle of the back (T12)".to_owned(),
        "T8" => "the upper trunk (T8)".to_owned(),
        other => segment(other),
    }
}

/// `RightUpperArm` becomes `the right upper arm`; other names are returned unchanged.
fn segment(name: &str) -> String {
    if !Segment::ALL.iter().any(|known| known.name() == name) {
        return name.to_owned();
    }
    let mut words = String::from("the");
    for letter in name.chars() {
        if letter.is_uppercase() {
            words.push(' ');
        }
        words.extend(letter.to_lowercase());
    }
    words.replace("right shoulder", "right collarbone").replace("left shoulder", "left collarbone")
}

/// How much less likely an explanation is, by the difference of log odds (natural), positive if it is less likely.
pub(super) fn less_likely(by: f64) -> String {
    match times(by) {
        None => "about as likely".to_owned(),
        Some(factor) => format!("{factor} times less likely"),
    }
}

/// A factor in words, from its logarithm; `None` below 2.
pub(super) fn times(log: f64) -> Option<String> {
    let factor = log.exp();
    if log.is_nan() || factor < 2.0 {
        None
    } else if factor < 950.0 {
        Some(format!("about {}", one_digit(factor)))
    } else if factor < 1500.0 {
        Some("a thousand".to_owned())
    } else if factor < 950e3 {
        Some(format!("{} thousand", one_digit(factor / 1e3)))
    } else {
        Some("more than a million".to_owned())
    }
}

fn one_digit(value: f64) -> String {
    let power = 10f64.powf(value.log10().floor());
    format!("{:.0}", (value / power).round() * power)
}

/// Three significant digits.
pub(super) fn number(value: f64) -> String {
    let decimals = decimals(value, 3);
    if !value.is_finite() {
        "unavailable".to_owned()
    } else if value != 0.0 && value.abs() < 1e-4 {
        format!("{value:.1e}").replace('-', "−")
    } else {
        format!("{value:.decimals$}").replace('-', "−")
    }
}

/// Log odds with one decimal.
pub(super) fn odds(log_odds: f64) -> String {
    if log_odds.is_finite() { format!("{log_odds:.1}").replace('-', "−") } else { "unavailable".to_owned() }
}

/// Two numbers as `value ± sigma`, to two significant digits of σ.
pub(super) fn with_sigma(value: f64, sigma: f64) -> String {
    if !(sigma.is_finite() && sigma > 0.0) || sigma < 1e-6 || !value.is_finite() {
        return format!("{} ± {}", number(value), number(sigma));
    }
    let decimals = decimals(sigma, 2);
    format!("{value:.decimals$} ± {sigma:.decimals$}").replace('-', "−")
}

fn decimals(value: f64, digits: i32) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    (digits - 1 - value.abs().log10().floor() as i32).clamp(0, 7) as usize
}

/// An estimate in its own unit.
pub(super) fn estimate(estimate: &Estimate) -> String {
    let value = with_sigma(estimate.value, estimate.sigma);
    if ["", "1"].contains(&estimate.unit) { value } else { format!("{value} {}", estimate.unit) }
}

/// The same in an everyday unit, where there is one.
pub(super) fn in_everyday_units(of: &Estimate) -> Option<String> {
    let (factor, unit) = everyday_unit(of.unit, of.value)?;
    Some(format!("{} {unit}", with_sigma(of.value * factor, of.sigma * factor)))
}

/// A size in everyday units, or else in its original unit.
pub(super) fn size(value: f64, unit: &str) -> String {
    let (factor, unit) = everyday_unit(unit, value).unwrap_or((1.0, unit));
    format!("{} {unit}", number(value * factor))
}

fn everyday_unit(unit: &str, value: f64) -> Option<(f64, &'static str)> {
    const DEGREE: f64 = 180.0 / std::f64::consts::PI;
    match unit {
        "rad" => Some((DEGREE, "°")),
        "rad/s" => Some((60.0 * DEGREE, "° per minute")),
        "m" => Some((1e3, "mm")),
        "m/s" => Some((60e3, "mm per minute")),
        "s" if value.abs() < 1.0 => Some((1e3, "ms")),
        "" | "1" => Some((100.0, "%")),
        _ => None,
    }
}

/// A time within the recording.
pub(super) fn seconds(time_s: f64) -> String {
    format!("{time_s:.1} s")
}

/// A part of the recording, in the syntax of the command line.
pub(super) fn span(span_s: [f64; 2]) -> String {
    format!("{:.1}:{:.1}", span_s[0], span_s[1])
}

/// `3.1 times`, or a dash if there is no reference.
pub(super) fn ratio(value: f64, floor: f64) -> String {
    if floor > 0.0 && value.is_finite() { format!("{:.1} times", value / floor) } else { "–".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_in_words_never_overstate() {
        assert_eq!(less_likely(0.3), "about as likely");
        assert_eq!(less_likely(3f64.ln()), "about 3 times less likely");
        assert_eq!(less_likely(1000f64.ln()), "a thousand times less likely");
        assert_eq!(less_likely(42_000f64.ln()), "40 thousand times less likely");
        assert_eq!(less_likely(500.0), "more than a million times less likely");
        assert_eq!(less_likely(f64::NAN), "about as likely");
        assert_eq!(times(-5.0), None);
    }

    #[test]
    fn numbers_keep_the_digits_that_count() {
        assert_eq!(number(23.456), "23.5");
        assert_eq!(number(-0.004567), "−0.00457");
        assert_eq!(number(1234.5), "1234");
        assert_eq!(number(0.0), "0");
        assert_eq!(number(f64::NAN), "unavailable");
        assert_eq!(with_sigma(1.5234, 0.0417), "1.523 ± 0.042");
        assert_eq!(with_sigma(-12.3, 4.1), "−12.3 ± 4.1");
        assert_eq!(with_sigma(2.0, 0.0), "2.00 ± 0");
    }

    #[test]
    fn everyday_units_are_the_same_quantity() {
        let yaw = Estimate { value: 0.0349066, sigma: 0.00349066, unit: "rad" };
        assert_eq!(in_everyday_units(&yaw).unwrap(), "2.00 ± 0.20 °");
        let drift = Estimate { value: 1e-4, sigma: 1e-5, unit: "m/s" };
        assert_eq!(in_everyday_units(&drift).unwrap(), "6.00 ± 0.60 mm per minute");
        assert!(in_everyday_units(&Estimate { value: 1.0, sigma: 0.1, unit: "kg" }).is_none());
    }

    #[test]
    fn every_segment_has_words() {
        for segment in Segment::ALL {
            let words = place_in_words(segment.name());
            assert!(words.starts_with("the ") && words != "the ", "{words}");
        }
        assert_eq!(
            candidate("segment_misalignment RightUpperArm"),
            "a misaligned sensor on the right upper arm"
        );
        assert_eq!(candidate("hand_load both"), "a load in both hands");
        assert_eq!(candidate("of_tomorrow T8"), "of_tomorrow the upper trunk (T8)");
    }
}
