//! `equipoise identify` and `equipoise tare`: steer the identification of a running daemon; zero the plate.

use clap::ValueEnum;
use equipoise_core::message::command::CommandKind;

use super::{Outcome, StationArgument};
use crate::client;

/// Start, stop or reset the identification of the worker, or request another pose
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise identify start --station station-1")]
pub(super) struct Arguments {
    action: Action,
    #[command(flatten)]
    station: StationArgument,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Action {
    /// Use held poses from now on
    Start,
    /// End the identification and monitor with what is known
    Stop,
    /// Discard all poses and start again
    Reset,
    /// Request another pose, if the worker cannot hold the suggested one
    Skip,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let kind = match arguments.action {
        Action::Start => CommandKind::IdentifyStart,
        Action::Stop => CommandKind::IdentifyStop,
        Action::Reset => CommandKind::IdentifyReset,
        Action::Skip => CommandKind::PoseSkip,
    };
    println!("{}", client::request(&arguments.station.station, kind, "")?);
    Ok(Outcome::Done)
}

/// Take what the empty plate shows as zero
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: step off the plate, then: equipoise tare")]
pub(super) struct TareArguments {
    #[command(flatten)]
    station: StationArgument,
}

pub(super) fn tare(arguments: &TareArguments) -> anyhow::Result<Outcome> {
    println!("{}", client::request(&arguments.station.station, CommandKind::Tare, "")?);
    Ok(Outcome::Done)
}
