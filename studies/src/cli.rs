//! The command line: one command for each question.

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use equipoise_simulator::realism::Realism;

use crate::subject::Cohort;
use crate::table::Table;
use crate::{
    back, clocks, cobot, coverage, early, faults, handover, hidden, lifting, natural, paper, poses, restarts,
    sources,
};

#[derive(Debug, Parser)]
#[command(
    name = "equipoise-study",
    version,
    about = "Offline studies of the method over many simulated subjects; prints tables",
    after_help = "Run an optimised build: cargo run --release -p equipoise-studies -- paper"
)]
struct Cli {
    #[command(subcommand)]
    question: Question,
}

#[derive(Debug, Subcommand)]
enum Question {
    /// Reproduce the paper's experiment with the paper's method and the default method
    #[command(after_help = "Example: equipoise-study paper --subjects 10")]
    Paper(Choices),
    /// Number of poses to reach an accuracy, by prior and by pose choice
    #[command(after_help = "Example: equipoise-study poses --subjects 20 --json")]
    Poses(Choices),
    /// Torque errors while lifting at natural speed, and false positives without a load
    #[command(after_help = "Example: equipoise-study lifting --seed 100")]
    Lifting(Choices),
    /// Identification from natural squat lifts and bends without held poses, then a carry
    #[command(after_help = "Example: equipoise-study natural --subjects 20")]
    Natural(Choices),
    /// Coverage of errors by the published 1-sigma and 2-sigma
    #[command(after_help = "Example: equipoise-study coverage --subjects 40")]
    Coverage(Choices),
    /// Moment and axial force at L5/S1 in natural bends and squats
    #[command(after_help = "Example: equipoise-study back --subjects 20")]
    Back(Choices),
    /// Accelerations reported by the suit, and insoles in place of a plate
    #[command(after_help = "Example: equipoise-study sources --subjects 20")]
    Sources(Choices),
    /// Errors of estimated skew and drift between the clocks of suit and plate
    #[command(after_help = "Example: equipoise-study clocks --subjects 6")]
    Clocks(Choices),
    /// Age and errors of the early state, and of both states used about now and ahead
    #[command(after_help = "Example: equipoise-study early --subjects 10")]
    Early(Choices),
    /// Restarts of suit, plate and daemon during work
    #[command(after_help = "Example: equipoise-study restarts --subjects 10")]
    Restarts(Choices),
    /// Detection of undeclared sensor faults
    #[command(after_help = "Example: equipoise-study faults --subjects 20")]
    Faults(Choices),
    /// Predicted overload of a part handed over at a place, and the best place
    #[command(after_help = "Example: equipoise-study handover --subjects 20")]
    Handover(Choices),
    /// Overload with a part presented by a cobot: at a fixed place, and where the estimate says
    #[command(after_help = "Example: equipoise-study cobot --subjects 20")]
    Cobot(Choices),
    /// Blind benchmark of the discrepancy workflow: sessions with hidden effects
    Hidden {
        #[command(subcommand)]
        task: hidden::cli::Task,
    },
}

#[derive(Debug, Args)]
struct Choices {
    /// Number of simulated subjects
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    subjects: u16,
    /// Seed of the first subject; the others follow
    #[arg(long, default_value_t = 1, value_name = "SEED")]
    seed: u64,
    /// Deviation of body, contacts and sensors from ideal ones: ideal, realistic or severe, then changes of single phenomena
    /// (feet, feet_change, hands, load_place, squeeze, soft_tissue, suit_world, clocks, plate_zero), as in `realistic,feet=ideal`
    #[arg(long, default_value = "realistic", value_name = "SEVERITY")]
    realism: Realism,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Choices {
    fn answer(&self, study: fn(&Cohort) -> Vec<Table>) {
        let count = usize::from(self.subjects);
        let tables = study(&Cohort { first_seed: self.seed, count, realism: self.realism });
        if self.json {
            println!("{:#}", serde_json::Value::from_iter(tables.iter().map(Table::json)));
        } else {
            for table in tables {
                println!("{table}");
            }
        }
    }
}

/// Runs the selected study.
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
        Question::Early(choices) => choices.answer(early::study),
        Question::Restarts(choices) => choices.answer(restarts::study),
        Question::Faults(choices) => choices.answer(faults::study),
        Question::Handover(choices) => choices.answer(handover::study),
        Question::Cobot(choices) => choices.answer(cobot::study),
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
            "paper", "poses", "lifting", "natural", "coverage", "back", "sources", "clocks", "early",
            "restarts", "faults", "handover", "cobot",
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
