//! `equipoise model`: effects of model files, an engineer's verdict on them, and models of several sessions in one.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_config::LoadedModel;
use equipoise_config::model_file::{Fitted, ModelFile, Parameter, Review, Verdict, merge, with_review};
use equipoise_files::atomic_file::write_atomically;
use jiff::Timestamp;

use super::Outcome;
use crate::calibration::config_file::rewrite;

/// Show, confirm, reject or merge what `reconcile` found
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise model show model.toml\n  equipoise model confirm model.toml plate_offset --reason \
                  \"it had been pushed\"\n  equipoise model reject model.toml \"worn_mass T8\" --reason \"no vest was worn\"\n  \
                  equipoise reconcile shift.mcap --model model.toml --out again   # looks for other explanations\n  \
                  equipoise model merge monday/model.toml tuesday/model.toml --out model.toml"
)]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// List the effects of a model file, with σ, evidence and verdicts
    Show {
        /// The model file
        file: PathBuf,
    },
    /// Record that an effect was found in reality, too
    Confirm(ReviewArguments),
    /// Record that an effect is not there: it is no longer applied, and `reconcile --model` looks for others
    Reject(ReviewArguments),
    /// Merge the models of several sessions of one worker at one station: effects that last in all of them
    Merge {
        /// Model files that `reconcile` wrote
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// The merged model; must not exist
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

#[derive(Debug, clap::Args)]
struct ReviewArguments {
    /// The model file
    file: PathBuf,
    /// The effect: its number or its name as shown, such as "worn_mass T8"
    effect: String,
    /// Why, for later readers of the file
    #[arg(long, value_name = "TEXT")]
    reason: String,
    /// Pseudonym of the engineer
    #[arg(long, value_name = "NAME")]
    by: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.action {
        Action::Show { file } => print!("{}", table(LoadedModel::read(file)?.file())),
        Action::Confirm(review) => record(review, Verdict::Confirmed)?,
        Action::Reject(review) => record(review, Verdict::Rejected)?,
        Action::Merge { files, out } => merge_files(files, out)?,
    }
    Ok(Outcome::Done)
}

/// One line for each effect, and one for its verdict.
fn table(model: &ModelFile) -> String {
    let sources = model.provenance.iter().chain(&model.merged_from);
    let mut text: String =
        sources.map(|from| format!("{} at {}, {}\n", from.subject, from.station, from.date)).collect();
    for (index, fitted) in model.effects.iter().enumerate() {
        let lasts = if fitted.open_ended { "" } else { ", ended" };
        text += &format!("{:>2}  {}{lasts}, log odds {:.0}", index + 1, fitted.name(), fitted.log_odds);
        text += &format!(": {}\n", parameters(fitted).join(", "));
        if let Some(Review { verdict, date, reason, by }) = &fitted.review {
            let by = by.as_ref().map_or(String::new(), |by| format!(" by {by}"));
            text += &format!("    {} {date}{by}: {reason}\n", verdict.name());
        }
    }
    if model.effects.is_empty() {
        text += "no effects\n";
    }
    text
}

/// `mass_kg 2.10 ± 0.05`.
fn parameters(fitted: &Fitted) -> Vec<String> {
    let parameter = |Parameter { name, value, sigma, .. }: Parameter| {
        // As many digits as σ has.
        let digits = if sigma > 0.0 { (1.0 - sigma.log10().floor()).clamp(0.0, 9.0) as usize } else { 3 };
        format!("{name} {value:.digits$} ± {sigma:.digits$}")
    };
    fitted.parameters().into_iter().map(parameter).collect()
}

fn record(arguments: &ReviewArguments, verdict: Verdict) -> anyhow::Result<()> {
    let ReviewArguments { file, effect, reason, by } = arguments;
    let review =
        Review { verdict, date: format!("{:.0}", Timestamp::now()), reason: reason.clone(), by: by.clone() };
    let mut name = String::new();
    rewrite(file, |text, file| {
        let model = ModelFile::parse(text, file)?;
        let index = index_of(&model, effect).with_context(|| file.to_owned())?;
        name = model.effects[index].name();
        let after = with_review(text, index, &review).with_context(|| format!("{file}: no [[effect]]"))?;
        ModelFile::parse(&after, file)?;
        Ok(after)
    })?;
    println!("{name} is {} in {}", verdict.name(), file.display());
    Ok(())
}

/// The effect with this number (from 1) or name.
fn index_of(model: &ModelFile, effect: &str) -> anyhow::Result<usize> {
    let names: Vec<String> = model.effects.iter().map(Fitted::name).collect();
    if let Ok(number) = effect.parse::<usize>() {
        let index = number.checked_sub(1).filter(|index| *index < names.len());
        return index.with_context(|| format!("no effect has number {number}; it has {}", names.len()));
    }
    let with_name: Vec<usize> = (0..names.len()).filter(|&index| names[index] == effect).collect();
    match with_name[..] {
        [index] => Ok(index),
        [] => bail!("no effect is called `{effect}`; it has: {}", names.join(", ")),
        _ => bail!(
            "{} effects are called `{effect}`; give the number that `model show` prints",
            with_name.len()
        ),
    }
}

fn merge_files(files: &[PathBuf], out: &Path) -> anyhow::Result<()> {
    if out.exists() {
        bail!("{} exists already; choose another name", out.display());
    }
    let mut models = Vec::with_capacity(files.len());
    for file in files {
        models.push((file.display().to_string(), LoadedModel::read(file)?.file().clone()));
    }
    let merged = merge(&models)?;
    let text = merged.file.to_toml();
    // Effects that were added up can exceed what a model file may have.
    ModelFile::parse(&text, &out.display().to_string())?;
    write_atomically(out, text.as_bytes()).with_context(|| format!("cannot write {}", out.display()))?;
    print!("{}", table(&merged.file));
    for (name, count) in &merged.left_out {
        println!("left out: {name}, which lasts in {count} of {}", models.len());
    }
    println!("written: {}", out.display());
    Ok(())
}
