//! Merges the models of several sessions: one value for each effect that lasts in all of them.
//!
//! An effect differs between sessions by more than its σ: a plate is pushed, a suit is put on again. Each parameter is
//! merged with random effects (DerSimonian and Laird, Controlled Clinical Trials 7, 1986): its variance between
//! sessions, τ², follows from Cochran's Q; the reported σ is that of the value in one more session.

use equipoise_core::effect::{Effect, PARAMETERS_MAX, Place};

use super::{Fitted, ModelFile, Provenance};

/// Merged models.
#[derive(Debug, Clone, PartialEq)]
pub struct Merged {
    /// The merged model.
    pub file: ModelFile,
    /// Effects that are not in every model: name, and number of models that have it.
    pub left_out: Vec<(String, usize)>,
}

/// Why models cannot be merged.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// One model or none.
    #[error("give the models of two sessions or more")]
    TooFew,
    /// A model of unknown origin.
    #[error("{0} has no [provenance]; merge files that `equipoise reconcile --out` wrote")]
    NoProvenance(String),
    /// Models of different subjects or stations.
    #[error(
        "{one} is of {one_value} and {other} of {other_value}; merge models of one subject and one station"
    )]
    Different {
        /// A file.
        one: String,
        /// Its subject or station.
        one_value: String,
        /// Another file.
        other: String,
        /// Its subject or station.
        other_value: String,
    },
    /// The same data twice.
    #[error("{0} and {1} are of the same recording, which would count twice; give one of them")]
    SameRecording(String, String),
    /// An effect that acts twice at the end, with a parameter that does not add up.
    #[error("{file} has {effect} twice at the end of its recording; combine them in the file first")]
    Twice {
        /// The file.
        file: String,
        /// The effect.
        effect: String,
    },
    /// No effect lasts in all sessions.
    #[error("no effect lasts to the end of every recording; found: {0}")]
    NothingInCommon(String),
}

/// A value and its 1-σ.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Measured {
    value: f64,
    sigma: f64,
}

/// Merges models, each with its name for errors.
///
/// # Errors
/// [`MergeError`].
pub fn merge(models: &[(String, ModelFile)]) -> Result<Merged, MergeError> {
    let merged_from = provenances(models)?;
    let mut sessions = Vec::with_capacity(models.len());
    for (name, model) in models {
        sessions.push(lasting(name, model)?);
    }
    let mut distinct: Vec<&Fitted> = Vec::new();
    for fitted in sessions.iter().flatten() {
        if !distinct.iter().any(|other| is_same(other, fitted)) {
            distinct.push(fitted);
        }
    }
    let (mut effects, mut left_out) = (Vec::new(), Vec::new());
    for fitted in distinct {
        let found: Vec<&Fitted> = sessions.iter().flatten().filter(|other| is_same(other, fitted)).collect();
        if found.len() == models.len() {
            effects.push(merged(&found));
        } else {
            left_out.push((fitted.name(), found.len()));
        }
    }
    if effects.is_empty() {
        let names: Vec<String> = left_out.into_iter().map(|(name, _)| name).collect();
        let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(MergeError::NothingInCommon(names));
    }
    Ok(Merged { file: ModelFile { merged_from, effects, ..ModelFile::default() }, left_out })
}

/// The origin of each model; of one subject and station, and of different recordings.
fn provenances(models: &[(String, ModelFile)]) -> Result<Vec<Provenance>, MergeError> {
    if models.len() < 2 {
        return Err(MergeError::TooFew);
    }
    let mut known: Vec<(&String, &Provenance)> = Vec::with_capacity(models.len());
    for (name, model) in models {
        let Some(provenance) = &model.provenance else { return Err(MergeError::NoProvenance(name.clone())) };
        for (other_name, other) in &known {
            if other.recording_sha256.eq_ignore_ascii_case(&provenance.recording_sha256) {
                return Err(MergeError::SameRecording((*other_name).clone(), name.clone()));
            }
            let pairs = [(&other.subject, &provenance.subject), (&other.station, &provenance.station)];
            if let Some((one_value, other_value)) = pairs.into_iter().find(|(one, other)| one != other) {
                return Err(MergeError::Different {
                    one: (*other_name).clone(),
                    one_value: one_value.clone(),
                    other: name.clone(),
                    other_value: other_value.clone(),
                });
            }
        }
        known.push((name, provenance));
    }
    Ok(known.into_iter().map(|(_, provenance)| provenance.clone()).collect())
}

/// The effects at the end of the recording that are not rejected; two of the same add up.
fn lasting(name: &str, model: &ModelFile) -> Result<Vec<Fitted>, MergeError> {
    let mut all: Vec<Fitted> = Vec::new();
    for fitted in model.effects.iter().filter(|fitted| fitted.open_ended && !fitted.is_rejected()) {
        match all.iter_mut().find(|other| is_same(other, fitted)) {
            None => all.push(fitted.clone()),
            Some(_) if fitted.shape != 0.0 => {
                return Err(MergeError::Twice { file: name.to_owned(), effect: fitted.name() });
            }
            Some(sum) => {
                for index in 0..PARAMETERS_MAX {
                    sum.value[index] += fitted.value[index];
                    sum.sigma[index] = sum.sigma[index].hypot(fitted.sigma[index]);
                }
                sum.log_odds += fitted.log_odds;
            }
        }
    }
    Ok(all)
}

/// Whether two have the same parameters: a drift without a time constant is another function than one with it.
fn is_same(one: &Fitted, other: &Fitted) -> bool {
    let key =
        |fitted: &Fitted| -> (Effect, Place, bool) { (fitted.effect, fitted.place, fitted.shape == 0.0) };
    key(one) == key(other)
}

/// One effect of all sessions.
fn merged(found: &[&Fitted]) -> Fitted {
    let of = |measured: &dyn Fn(&Fitted) -> Measured| {
        random_effects(&found.iter().map(|fitted| measured(fitted)).collect::<Vec<Measured>>())
    };
    let shape = of(&|fitted| Measured { value: fitted.shape, sigma: fitted.shape_sigma });
    let values: [Measured; PARAMETERS_MAX] = std::array::from_fn(|index| {
        of(&|fitted| Measured { value: fitted.value[index], sigma: fitted.sigma[index] })
    });
    Fitted {
        effect: found[0].effect,
        place: found[0].place,
        shape: shape.value,
        shape_sigma: shape.sigma,
        value: values.map(|measured| measured.value),
        sigma: values.map(|measured| measured.sigma),
        span_s: [0.0, found.iter().map(|fitted| fitted.span_s[1]).fold(0.0, f64::max)],
        open_ended: true,
        log_odds: found.iter().map(|fitted| fitted.log_odds).sum(),
        review: None,
    }
}

/// The mean over sessions, and the 1-σ of the value in one more session. A value without σ does not weigh infinitely:
/// all are then weighted alike.
fn random_effects(all: &[Measured]) -> Measured {
    let is_weighted = all.iter().all(|one| one.sigma > 0.0);
    let variance = |one: &Measured| if is_weighted { one.sigma * one.sigma } else { 1.0 };
    let sums = |between: f64| {
        let weights = all.iter().map(|one| 1.0 / (variance(one) + between));
        let weight: f64 = weights.clone().sum();
        let mean = weights.clone().zip(all).map(|(weight, one)| weight * one.value).sum::<f64>() / weight;
        (weight, weights.map(|weight| weight * weight).sum::<f64>(), mean)
    };
    let freedom = all.len() as f64 - 1.0;
    let (weight, squared, mean) = sums(0.0);
    let q: f64 = all.iter().map(|one| (one.value - mean).powi(2) / variance(one)).sum();
    if !is_weighted {
        // The sample's variance, of one more value and of the mean.
        return Measured { value: mean, sigma: (q / freedom * (1.0 + 1.0 / weight)).sqrt() };
    }
    let between = ((q - freedom) / (weight - squared / weight)).max(0.0);
    let (weight, _, value) = sums(between);
    Measured { value, sigma: (between + 1.0 / weight).sqrt() }
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::Segment;

    use super::super::{Review, Verdict, with_review};
    use super::*;

    fn session(number: u8, effects: Vec<Fitted>) -> (String, ModelFile) {
        let provenance = Provenance {
            recording_sha256: format!("{number:064x}"),
            date: "2026-03-01T08:30:00Z".to_owned(),
            subject: "anon-1".to_owned(),
            station: "station-1".to_owned(),
            software: "0.1.0".to_owned(),
            identify_s: [0.0, 90.0],
            reference_s: None,
            work_s: [90.0, 600.0],
        };
        let file = ModelFile { provenance: Some(provenance), effects, ..ModelFile::default() };
        (format!("{number}.toml"), file)
    }

    fn worn(mass_kg: f64, sigma_kg: f64) -> Fitted {
        Fitted {
            effect: Effect::WornMass,
            place: Place::Segment(Segment::T8),
            shape: 0.0,
            shape_sigma: 0.0,
            value: [mass_kg, 0.0, 0.0, 0.0],
            sigma: [sigma_kg, 0.0, 0.0, 0.0],
            span_s: [100.0, 600.0],
            open_ended: true,
            log_odds: 20.0,
            review: None,
        }
    }

    #[test]
    fn values_that_agree_are_averaged_and_values_that_do_not_have_the_spread_of_one_more_session() {
        let of = |all: &[(f64, f64)]| {
            random_effects(
                &all.iter().map(|&(value, sigma)| Measured { value, sigma }).collect::<Vec<Measured>>(),
            )
        };
        // Q below its expectation: weights 1/σ², as by hand (2/0.01 + 2.1/0.04)/(1/0.01 + 1/0.04).
        let agree = of(&[(2.0, 0.1), (2.1, 0.2)]);
        assert!((agree.value - 2.02).abs() < 1e-12 && (agree.sigma - (1.0_f64 / 125.0).sqrt()).abs() < 1e-12);
        // Equal σ = 0.1: Q = 2 (0.5/0.1)² = 50, τ² = 49/100, variance of the mean (0.49 + 0.01)/2.
        let differ = of(&[(2.0, 0.1), (3.0, 0.1)]);
        assert!((differ.value - 2.5).abs() < 1e-12, "{differ:?}");
        assert!((differ.sigma.powi(2) - (0.49 + 0.25)).abs() < 1e-12, "{differ:?}");
        // Without σ: variance 0.5 of one value, 0.25 of the mean.
        let exact = of(&[(2.0, 0.0), (3.0, 0.1)]);
        assert!(exact.value == 2.5 && (exact.sigma.powi(2) - 0.75).abs() < 1e-12, "{exact:?}");
        assert_eq!(of(&[(0.0, 0.0), (0.0, 0.0)]), Measured { value: 0.0, sigma: 0.0 });
    }

    #[test]
    fn only_what_lasts_in_every_session_and_is_not_rejected_is_merged() {
        let yaw = Fitted { effect: Effect::PlateYaw, place: Place::Whole, ..worn(0.1, 0.01) };
        let offset = Fitted { effect: Effect::PlateOffset, place: Place::Whole, ..worn(0.01, 0.001) };
        let review = Review {
            verdict: Verdict::Rejected,
            date: "2026-03-02T08:30:00Z".to_owned(),
            reason: "the plate is bolted down".to_owned(),
            by: None,
        };
        let rejected = Fitted { review: Some(review), ..offset.clone() };
        let ended = Fitted { open_ended: false, ..yaw.clone() };
        // A model that was found in addition to a loaded one: both effects act.
        let one = session(1, vec![worn(1.5, 0.1), worn(0.5, 0.1), yaw, offset]);
        let two = session(2, vec![worn(2.0, 0.1), ended, rejected]);
        let merged = merge(&[one, two]).unwrap();
        let [effect] = &merged.file.effects[..] else { panic!("{merged:?}") };
        assert_eq!((effect.name().as_str(), effect.value[0], effect.log_odds), ("worn_mass T8", 2.0, 60.0));
        assert_eq!(merged.left_out, [("plate_yaw".to_owned(), 1), ("plate_offset".to_owned(), 1)]);
        let again = ModelFile::parse(&merged.file.to_toml(), "merged").unwrap();
        assert_eq!(again, merged.file);
        assert_eq!(again.merged_from.len(), 2);
    }

    #[test]
    fn models_that_do_not_belong_together_are_refused() {
        let one = session(1, vec![worn(2.0, 0.1)]);
        let refused = |other: (String, ModelFile)| merge(&[one.clone(), other]).unwrap_err().to_string();
        assert_eq!(merge(std::slice::from_ref(&one)), Err(MergeError::TooFew));
        assert!(
            refused(session(1, vec![worn(2.0, 0.1)])).contains("1.toml and 1.toml are of the same recording")
        );
        let mut other = session(2, vec![worn(2.0, 0.1)]);
        other.1.provenance.as_mut().unwrap().subject = "anon-2".to_owned();
        assert!(refused(other.clone()).contains("1.toml is of anon-1 and 2.toml of anon-2"));
        other.1.provenance = None;
        assert!(refused(other).contains("2.toml has no [provenance]"));
        assert!(
            refused(session(2, Vec::new()))
                .contains("no effect lasts to the end of every recording; found: worn_mass T8")
        );
        let lag = Fitted { effect: Effect::SuitLag, place: Place::Whole, shape: 0.02, ..worn(0.0, 0.0) };
        assert!(refused(session(2, vec![lag.clone(), lag])).contains("2.toml has suit_lag twice"));
    }

    #[test]
    fn a_review_leaves_the_rest_of_the_file_as_it_is() {
        let (_, file) = session(
            1,
            vec![worn(2.0, 0.1), Fitted { effect: Effect::PlateYaw, place: Place::Whole, ..worn(0.1, 0.01) }],
        );
        let text = file.to_toml().replace("sigma = 0.1\n", "sigma = 0.1 # by the scales\n");
        let review = |verdict: Verdict, reason: &str| Review {
            verdict,
            date: "2026-03-02T08:30:00Z".to_owned(),
            reason: reason.to_owned(),
            by: Some("eng-3".to_owned()),
        };
        let rejected = with_review(&text, 1, &review(Verdict::Rejected, "it is \"bolted\"")).unwrap();
        assert!(rejected.contains("sigma = 0.1 # by the scales\n"), "{rejected}");
        let read = ModelFile::parse(&rejected, "m.toml").unwrap();
        assert!(!read.effects[0].is_rejected() && read.effects[1].is_rejected(), "{rejected}");
        assert_eq!(read.effects[1].review.as_ref().unwrap().reason, "it is \"bolted\"");
        let (model, left_out) = read.model(super::super::Spans::Hold { begin_ns: 0 });
        assert_eq!((model.terms.iter().flatten().count(), left_out.len()), (1, 1));
        // The last verdict counts.
        let confirmed = with_review(&rejected, 1, &review(Verdict::Confirmed, "it was pushed")).unwrap();
        assert!(!ModelFile::parse(&confirmed, "m.toml").unwrap().effects[1].is_rejected());
        assert_eq!(with_review(&text, 2, &review(Verdict::Rejected, "x")), None);
        for wrong in ["", "two\nlines"] {
            let text = with_review(&text, 0, &review(Verdict::Rejected, wrong)).unwrap();
            let said = ModelFile::parse(&text, "m.toml").unwrap_err().to_string();
            assert!(said.starts_with("m.toml, effect 1, review.reason: "), "{said}");
        }
    }
}
