//! The similar subject of `identification.prior = "similar-subject"` as text, for status and recordings: its numbers,
//! without its name.

use equipoise_core::cycle::Similar;
use equipoise_core::sesc::PARAMETERS;
use serde::{Deserialize, Serialize};

/// Fields as in [`Similar`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SimilarText {
    likeness: f64,
    deviation_m: Vec<f64>,
    variance_m2: Vec<f64>,
}

impl SimilarText {
    /// `None` if the count of numbers is another.
    fn to_similar(&self) -> Option<Similar> {
        let numbers = |numbers: &[f64]| -> Option<[f64; PARAMETERS]> { numbers.try_into().ok() };
        let (deviation_m, variance_m2) = (numbers(&self.deviation_m)?, numbers(&self.variance_m2)?);
        Some(Similar { deviation_m, variance_m2, likeness: self.likeness })
    }
}

/// The text of a similar subject; empty without one.
pub fn to_toml(similar: Option<&Similar>) -> String {
    let text = |Similar { deviation_m, variance_m2, likeness }: &Similar| SimilarText {
        likeness: *likeness,
        deviation_m: deviation_m.to_vec(),
        variance_m2: variance_m2.to_vec(),
    };
    // Numbers can always be encoded.
    similar.map(text).and_then(|text| toml::to_string(&text).ok()).unwrap_or_default()
}

/// Parses the text; `None` if it is empty. `name` is its name in errors.
///
/// # Errors
/// A sentence on what is wrong.
pub fn parse(text: &str, name: &str) -> Result<Option<Similar>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    let text: SimilarText = toml::from_str(text).map_err(|error| format!("{name}: {}", error.message()))?;
    let similar = text.to_similar().filter(|similar| {
        similar.deviation_m.iter().all(|metres| metres.is_finite())
            && similar.variance_m2.iter().all(|variance| variance.is_finite() && *variance >= 0.0)
            && (0.0..=1.0).contains(&similar.likeness)
    });
    similar.map(Some).ok_or_else(|| format!("{name}: numbers are missing or out of range"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similar_subject_is_restored_bit_for_bit_and_impossible_numbers_are_refused() {
        let similar = Similar {
            deviation_m: std::array::from_fn(|index| 1e-3 * (index as f64).sin()),
            variance_m2: std::array::from_fn(|index| (index as f64 / 7.0).powi(2) * 1e-21),
            likeness: 2.0 / 3.0,
        };
        let text = to_toml(Some(&similar));
        assert_eq!(parse(&text, "it"), Ok(Some(similar)));
        assert_eq!((to_toml(None), parse("", "it")), (String::new(), Ok(None)));
        let negative = Similar { variance_m2: [-1.0; PARAMETERS], ..similar };
        for (wrong, reason) in [
            (to_toml(Some(&negative)), "it: numbers are"),
            (text.replace("deviation_m = [", "deviation_m = [0.5, "), "it: numbers are"),
            ("likeness = 0.5".to_owned(), "it: missing field"),
        ] {
            let error = parse(&wrong, "it").unwrap_err();
            assert!(error.starts_with(reason), "{error}");
        }
    }
}
