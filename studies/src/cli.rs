//! The command line: one command for each question.

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use equipoise_simulator::realism::Realism;

use crate::subject::Crowd;
use crate::table::Table;
use crate::{back, clocks, coverage, faults, hidden, lifting, natural, paper, poses, restarts, sources};

#[derive(Debug, Parser)]
#[command(
    name = "equipoise-study",
    version,
    about = "Asks questions of the method over many synthetic subjects and prints the tables",
    after_help = "Build it optimised: cargo run --release -p equipoise-studies -- paper"
)]
struct Cli {
    #[command(subcommand)]
    question: Question,
}

#[derive(Debug, Subcommand)]
enum Question {
    /// The paper's experiment by the paper's method and by the default one
    #[command(after_help = "Example: equipoise-study paper --subjects 10")]
    Paper(Choices),
    /// How many poses until the model is accurate, by prior and by choice of poses
    #[command(after_help = "Example: equipoise-study poses --subjects 20 --json")]
    Poses(Choices),
    /// Torques while lifting at natural speed, and false alarms without a load
    #[command(after_help = "Example: equipoise-study lifting --seed 100")]
    Lifting(Choices),
    /// Identification from natural squat lifts and bends without held poses, then a carry
    #[command(after_help = "Example: equipoise-study natural --subjects 20")]
    Natural(Choices),
    /// How often errors lie within the published 1-sigma and 2-sigma
    #[command(after_help = "Example: equipoise-study coverage --subjects 40")]
    Coverage(Choices),
    /// Moment and axial force at L5/S1 in natural bends and squats
    #[command(after_help = "Example: equipoise-study back --subjects 20")]
    Back(Choices),
    /// The suit's own accelerations, and insoles in place of a plate
    #[command(after_help = "Example: equipoise-study sources --subjects 20")]
    Sources(Choices),
    /// Skew and drift between the clocks of suit and plate, injected and estimated
    #[command(after_help = "Example: equipoise-study clocks --subjects 6")]
    Clocks(Choices),
    /// Suit, plate and daemon started again in the middle of work
    #[command(after_help = "Example: equipoise-study restarts --subjects 10")]
    Restarts(Choices),
    /// Sensors that fail without saying so, against the truth
    #[command(after_help = "Example: equipoise-study faults --subjects 20")]
    Faults(Choices),
    /// The blind bench of the discrepancy workflow: sessions with something hidden in them
    Hidden {
        #[command(subcommand)]
        task: hidden::cli::Task,
    },
}

#[derive(Debug, Args)]
struct Choices {
    /// How many synthetic subjects
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    subjects: u16,
    /// Seed of the first subject; the others follow
    #[arg(long, default_value_t = 1, value_name = "SEED")]
    seed: u64,
    /// How far body, contacts and sensors are from ideal ones: ideal, realistic or severe, then changes of single phenomena
    /// (feet, hands, load_place, squeeze, soft_tissue, suit_world, clocks, plate_zero), as in `realistic,feet=ideal`
    #[arg(long, default_value = "realistic", value_name = "SEVERITY")]
    realism: Realism,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Choices {
    fn answer(&self, study: fn(&Crowd) -> Vec<Table>) {
        let count = usize::from(self.subjects);
        let tables = study(&Crowd { first_seed: self.seed, count, realism: self.realism });
        if self.json {
            println!("{:#}", serde_json::Value::from_iter(tables.iter().map(Table::json)));
        } else {
            for table in tables {
                println!("{table}");
            }
        }
    }
}

/// Answers the question that the arguments ask.
pub fn main() -> ExitCode {
    match Cli::parse().question {
        Question::Paper(choices) => choices.answer(paper::study),
        Question::Poses(choices) => choices.answer(poses::study),
        Question::Lifting(choices) => choices.answer(lifting::study),
        Question::Natural(choices) => choices.answer(natural::study),
        Question::Coverage(choices) => choices.answer(coverage::study),
        Question::Back(choices) => choices.answer(back::study),
        Question::Sources(choices) => choices.answer(sources::study),
        Question::Clocks(choices) => choices.answer(clocks::study),
        Question::Restarts(choices) => choices.answer(restarts::study),
        Question::Faults(choices) => choices.answer(faults::study),
        Question::Hidden { task } => return hidden::cli::run(&task),
    }
    ExitCode::SUCCESS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_question_takes_the_same_choices() {
        for question in [
            "paper", "poses", "lifting", "natural", "coverage", "back", "sources", "clocks", "restarts",
            "faults",
        ] {
            let arguments = ["equipoise-study", question, "--subjects", "3", "--seed", "9", "--json"];
            assert!(Cli::try_parse_from(arguments).is_ok(), "{question}");
            assert!(
                Cli::try_parse_from(["equipoise-study", question, "--subjects", "0"]).is_err(),
                "{question}"
            );
        }
    }
}
