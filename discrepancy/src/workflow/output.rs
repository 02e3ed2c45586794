//! Writes the results of a reconciliation (model and report) completely or not at all.

use std::path::{Path, PathBuf};
use std::{fs, io};

use anyhow::{Context, bail};
use equipoise_config::LoadedModel;
use equipoise_config::model_file::{Fitted, ModelFile, ModelFileError, Provenance};
use jiff::Timestamp;

use crate::Outcome;
use crate::report::{Origin, Recording, Report};

use super::{Compared, Reconcile};

/// Name of the model file in the results folder.
const MODEL: &str = "model.toml";

/// Destination and provenance of the results.
#[derive(Debug)]
pub struct Results<'a> {
    /// The results folder.
    pub folder: &'a Path,
    /// Path of the recording as given.
    pub file: &'a Path,
    /// SHA-256 of the recording.
    pub sha256: &'a str,
    /// The command line as given.
    pub command: String,
}

impl Results<'_> {
    /// Writes `model.toml` if the finding adds effects, and the report; enters the model's path in the outcome's
    /// finding.
    ///
    /// # Errors
    /// The folder cannot be written; its content is then unchanged, or an older report remains.
    pub fn write(
        &self,
        reconcile: &Reconcile<'_>,
        compared: &Compared,
        outcome: &mut Outcome,
    ) -> anyhow::Result<Vec<PathBuf>> {
        let date = format!("{:.0}", Timestamp::now());
        let model = self.model(reconcile, compared, outcome, &date);
        let path = self.folder.join(MODEL);
        let adds = !model.effects.is_empty();
        outcome.finding.model = adds.then(|| path.display().to_string());
        let text = model.to_toml();
        let origin = Origin {
            recordings: vec![Recording {
                name: self.file.display().to_string(),
                sha256: self.sha256.to_owned(),
            }],
            subject: reconcile.config.subject.id.clone(),
            station: reconcile.config.station.clone(),
            date,
            software: format!("equipoise {}", env!("CARGO_PKG_VERSION")),
            command: self.command.clone(),
        };
        let report = Report {
            finding: &outcome.finding,
            picture: &outcome.picture,
            origin: &origin,
            model_toml: adds.then_some(text.as_str()),
        };
        let mut files: Vec<(String, String)> = Vec::new();
        // An older model file would be mistaken for this finding's, so replace it with one without effects.
        if adds || path.exists() {
            ModelFile::parse(&text, MODEL)?;
            files.push((MODEL.to_owned(), text.clone()));
        }
        let mut pages = report.pages().files;
        // The page is the entry point, so it is moved last, once all other files exist.
        pages.reverse();
        files.extend(pages);
        self.write_files(&files)
            .with_context(|| format!("cannot write the results to {}", self.folder.display()))?;
        Ok(files.into_iter().map(|(name, _)| self.folder.join(name)).collect())
    }

    fn model(
        &self,
        reconcile: &Reconcile<'_>,
        compared: &Compared,
        outcome: &Outcome,
        date: &str,
    ) -> ModelFile {
        let spans_s = &compared.session.spans_s;
        let mut effects = reconcile
            .config
            .loaded_model
            .as_ref()
            .map(|model| model.file().effects.clone())
            .unwrap_or_default();
        effects.extend(outcome.terms.iter().map(|fitted| {
            let term = &fitted.term;
            let open_ended = term.span_s[1].is_infinite();
            let to_s = if open_ended { compared.session.length_s } else { term.span_s[1] };
            Fitted {
                effect: term.effect,
                place: term.place,
                shape: term.shape,
                shape_sigma: fitted.shape_sigma,
                value: term.value,
                sigma: fitted.sigma,
                span_s: [term.span_s[0], to_s],
                open_ended,
                log_odds: fitted.log_odds,
                review: None,
            }
        }));
        let provenance = Provenance {
            recording_sha256: self.sha256.to_owned(),
            date: date.to_owned(),
            subject: reconcile.config.subject.id.clone(),
            station: reconcile.config.station.clone(),
            software: env!("CARGO_PKG_VERSION").to_owned(),
            identify_s: spans_s.identify,
            reference_s: spans_s.reference,
            work_s: spans_s.work,
        };
        ModelFile {
            provenance: Some(provenance),
            effects,
            ask: outcome.finding.ask.clone(),
            ..ModelFile::default()
        }
    }

    /// Writes all files into a temporary subfolder, and moves them when all are complete.
    fn write_files(&self, files: &[(String, String)]) -> io::Result<()> {
        fs::create_dir_all(self.folder)?;
        let temporary = self.folder.join(format!(".reconcile-{}", std::process::id()));
        fs::create_dir(&temporary)?;
        let written = files.iter().try_for_each(|(name, text)| fs::write(temporary.join(name), text));
        let moved = written.and_then(|()| {
            files.iter().try_for_each(|(name, _)| fs::rename(temporary.join(name), self.folder.join(name)))
        });
        // Cleaning up may fail; return the first error.
        let _ = fs::remove_dir_all(&temporary);
        moved
    }
}

/// Checks that new results replace no engineer's verdict: a results folder may contain a model file with verdicts only if
/// `loaded`, from which the new file is made, contains them.
///
/// # Errors
/// Verdicts would be lost, or the model file in the folder cannot be read, so that it is unknown whether it has any.
pub fn check_verdicts(folder: &Path, loaded: Option<&ModelFile>) -> anyhow::Result<()> {
    let path = folder.join(MODEL);
    let existing = match LoadedModel::read(&path) {
        Ok(existing) => existing,
        Err(ModelFileError::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => {
            let advice = format!("{} would be replaced; name another --out", path.display());
            return Err(anyhow::Error::from(error).context(advice));
        }
    };
    let is_kept = |fitted: &Fitted| loaded.is_some_and(|model| model.effects.contains(fitted));
    let reviewed = |fitted: &&Fitted| fitted.review.is_some();
    match existing.file().effects.iter().filter(reviewed).find(|fitted| !is_kept(fitted)) {
        Some(fitted) => bail!(
            "{} contains an engineer's verdict on {}, which would be lost; name another --out, or pass this file with \
             --model",
            path.display(),
            fitted.name()
        ),
        None => Ok(()),
    }
}

/// A separate folder for each of several recordings.
///
/// # Errors
/// Two recordings have the same name.
pub fn folders(out: &Path, files: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    if let [_] = files {
        return Ok(vec![out.to_owned()]);
    }
    let mut folders: Vec<PathBuf> = Vec::new();
    for file in files {
        let folder = out.join(file.file_stem().unwrap_or(file.as_os_str()));
        if folders.contains(&folder) {
            bail!(
                "two recordings would be written to {}; reconcile them separately, each with its own --out",
                folder.display()
            );
        }
        folders.push(folder);
    }
    Ok(folders)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL_TEXT: &str = "version = 1\n[[effect]]\nname = \"plate_offset\"\nspan_s = [1, 2]\nopen_ended = \
                              true\nlog_odds = 9.0\n[effect.parameters.dx_m]\nvalue = 0.01\nsigma = 0.001\nunit = \
                              \"m\"\n";
    const REVIEW: &str = "log_odds = 9.0\nreview = { verdict = \"rejected\", date = \"2026-03-01T08:30:00Z\", reason = \
                          \"it stood still\" }\n";

    #[test]
    fn results_replace_no_verdict() {
        let folder = tempfile::tempdir().unwrap();
        let check = |loaded: Option<&ModelFile>| {
            check_verdicts(folder.path(), loaded).map_err(|error| format!("{error:#}"))
        };
        let write = |text: &str| fs::write(folder.path().join(MODEL), text).unwrap();
        assert_eq!(check(None), Ok(()));
        write(MODEL_TEXT);
        assert_eq!(check(None), Ok(()));
        let reviewed = MODEL_TEXT.replace("log_odds = 9.0\n", REVIEW);
        write(&reviewed);
        let refusal = check(None).unwrap_err();
        assert!(
            refusal.contains("verdict on plate_offset, which would be lost; name another --out"),
            "{refusal}"
        );
        let unreviewed = ModelFile::parse(MODEL_TEXT, "before the verdict").unwrap();
        assert!(check(Some(&unreviewed)).is_err());
        assert_eq!(check(Some(&ModelFile::parse(&reviewed, "the same").unwrap())), Ok(()));
        write("version = 1\n[[effect");
        assert!(check(None).unwrap_err().contains("would be replaced; name another --out"));
    }
}
