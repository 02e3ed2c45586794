//! Answers the commands that people and controllers send to a running daemon.

mod plate;
mod subjects;

use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusError, CommandServer, Subscriber};
use equipoise_core::cycle::{Settings, StopRule};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, Reply, State};

use crate::active_configuration::SharedConfiguration;
use crate::rings::CommandEnds;
use crate::subjects::Subjects;
use crate::weighing;

use self::plate::PlateHistory;

/// Refusal of a tare without current data of the plate.
pub const PLATE_SILENT: &str = "the plate is silent or faulty; nothing to tare";

/// Polling interval for commands.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Refusal of a tare until the plate was empty for half a second.
pub const PLATE_LOADED_RECENTLY: &str =
    "the plate was loaded, silent or faulty within the last half second; ask again";

/// The command server's thread.
pub struct Commands {
    server: CommandServer,
    state: Subscriber<State>,
    ends: CommandEnds,
    latest: Option<State>,
    plate: PlateHistory,
    // Ports must be dropped before the node that they depend on.
    _bus: Bus,
}

/// The sentence of a reply: the effect and the cycle from which it applies, or the reason of a refusal.
type Answer = Result<String, String>;

impl Commands {
    /// Opens the station's only command server. The bus refuses a second one, which detects a second daemon.
    ///
    /// # Errors
    /// Another daemon runs on this station, or the bus fails.
    pub fn open(bus: Bus, server: CommandServer, ends: CommandEnds) -> Result<Commands, BusError> {
        let state = bus.subscriber::<State>(1)?;
        Ok(Commands { server, state, ends, latest: None, plate: PlateHistory::default(), _bus: bus })
    }

    /// Answers commands until stopped. The command server stays open until this value is dropped.
    ///
    /// # Errors
    /// The bus fails.
    pub fn run(
        &mut self,
        active_configuration: &SharedConfiguration,
        subjects: &Subjects,
    ) -> Result<(), BusError> {
        while !self.ends.control.is_stopping() {
            if let Some(state) = self.state.latest()? {
                self.latest = Some(state);
                self.plate.update(&state);
            }
            let (ends, latest, plate) = (&mut self.ends, self.latest.as_ref(), &self.plate);
            while self
                .server
                .poll(|command| answer(command, ends, active_configuration, subjects, latest, plate))?
            {
            }
            while self.ends.returned_workers.pop().is_ok() {}
            active_configuration.free_returned_settings();
            std::thread::sleep(POLL_INTERVAL);
        }
        Ok(())
    }
}

fn answer(
    command: &Command,
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
    latest: Option<&State>,
    plate: &PlateHistory,
) -> Reply {
    let outcome = match CommandKind::from_number(command.kind) {
        None => Err(format!("this version does not know command {}", command.kind)),
        Some(CommandKind::Tare) => plate::tare(ends, latest, plate),
        Some(CommandKind::SubjectLoad) => subjects::load(command, ends, active_configuration, subjects),
        Some(CommandKind::SubjectSave) => subjects::save(ends, subjects, latest),
        Some(kind @ CommandKind::UndoLift) => match latest.map_or(0, |state| state.lifts) {
            0 => Err("no lift of this shift counts".to_owned()),
            lifts => push_command(ends, kind).map(|()| {
                format!("the last of {lifts} lifts is taken back, if it is among the last 16 that ended")
            }),
        },
        Some(CommandKind::SubjectDelete) => subjects::delete(command, ends, active_configuration, subjects),
        Some(CommandKind::Reload) => {
            Err("send the daemon SIGHUP (`systemctl reload`): it reads its own configuration".to_owned())
        }
        Some(kind @ CommandKind::IdentifyStart) => {
            push_command(ends, kind).map(|()| "held poses are learnt from now on".to_owned())
        }
        Some(kind @ CommandKind::IdentifyStop) => {
            push_command(ends, kind).map(|()| describe_stop(latest, &active_configuration.settings()))
        }
        Some(kind @ CommandKind::PoseSkip) => match latest.filter(|state| state.suggested_pose != u32::MAX) {
            Some(state) => {
                let continuation = if state.converged == 1 { "" } else { "; another follows" };
                push_command(ends, kind).map(|()| format!("this pose is not asked for again{continuation}"))
            }
            None => Err("no pose is asked for now".to_owned()),
        },
        Some(kind @ CommandKind::IdentifyReset) => {
            push_command(ends, kind).map(|()| describe_reset(latest, &active_configuration.settings()))
        }
        Some(kind @ CommandKind::Checkpoint) => {
            push_command(ends, kind).map(|()| "a checkpoint is being published".to_owned())
        }
    };
    reply(ends.control.last_cycle() + 1, outcome)
}

const TOO_MANY: &str = "too many commands at once; ask again";

fn push_command(ends: &mut CommandEnds, kind: CommandKind) -> Result<(), String> {
    ends.command.push(kind).map_err(|_| TOO_MANY.to_owned())
}

/// What follows a reset of the identification: without a configured mass the subject is weighed first, which may be
/// delayed.
fn describe_reset(latest: Option<&State>, settings: &Settings) -> String {
    if settings.mass_kg.is_some() {
        return "all poses are discarded; learning starts again".to_owned();
    }
    let delay = latest.and_then(weighing::obstacle).map_or_else(
        || ": stand still on the plate with both feet and empty hands".to_owned(),
        |obstacle| format!(", which waits: {obstacle}"),
    );
    format!("all poses are discarded; learning starts again once the worker is weighed{delay}")
}

/// The accuracy reached by an identification that was stopped.
fn describe_stop(latest: Option<&State>, settings: &Settings) -> String {
    let Some(state) = latest.filter(|state| state.variance_max_m2 > 0.0) else {
        return "learning has ended before anything was known of the worker".to_owned();
    };
    let poses = match state.poses_used {
        1 => "1 pose".to_owned(),
        poses => format!("{poses} poses"),
    };
    let quality = match state.predicted_cop_sigma_m {
        sigma_m if sigma_m > 0.0 => format!("predicted CoP σ {:.1} mm", 1e3 * sigma_m),
        _ => "predicted CoP σ not known yet".to_owned(),
    };
    let threshold = match settings.stop {
        StopRule::PredictedCop { sigma_m } => format!("the rule asks {:.1} mm", 1e3 * sigma_m),
        StopRule::Paper { variance_m2 } => {
            format!("largest variance {:.4} m², the rule asks {variance_m2} m²", state.variance_max_m2)
        }
    };
    format!("stopped after {poses}: {quality} ({threshold})")
}

fn reply(cycle: u64, outcome: Answer) -> Reply {
    let mut reply = Reply { cycle, refused: u32::from(outcome.is_err()), ..Reply::zeroed() };
    let text = outcome.unwrap_or_else(|reason| reason);
    let mut length = text.len().min(reply.text.len());
    while !text.is_char_boundary(length) {
        length -= 1;
    }
    reply.text[..length].copy_from_slice(&text.as_bytes()[..length]);
    reply
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reset_reports_what_delays_the_weighing() {
        let mut settings = Settings::for_height(1.77);
        let mut state = State::zeroed();
        assert!(describe_reset(Some(&state), &settings).contains("once the worker is weighed"));
        state.cop_measured_m = [0.6, 0.0];
        let message = describe_reset(Some(&state), &settings);
        assert!(message.contains("which waits: the centre of pressure is 0.60 m from the feet"), "{message}");
        assert!(message.len() <= Reply::zeroed().text.len(), "{}", message.len());
        assert!(describe_reset(None, &settings).contains("once the worker is weighed"));
        settings.mass_kg = Some(72.0);
        let message = describe_reset(Some(&state), &settings);
        assert_eq!(message, "all poses are discarded; learning starts again");
    }

    #[test]
    fn an_early_stop_reports_the_uncertainty_of_the_estimate() {
        let mut settings = Settings::for_height(1.77);
        let state = State {
            poses_used: 4,
            variance_max_m2: 0.003,
            predicted_cop_sigma_m: 0.006_12,
            ..State::zeroed()
        };
        assert_eq!(
            describe_stop(Some(&state), &settings),
            "stopped after 4 poses: predicted CoP σ 6.1 mm (the rule asks 1.5 mm)"
        );
        settings.stop = StopRule::Paper { variance_m2: 0.002 };
        let message = describe_stop(Some(&State { poses_used: 1, ..state }), &settings);
        assert!(
            message.starts_with("stopped after 1 pose: ")
                && message.contains("0.0030 m², the rule asks 0.002 m²")
        );
        assert!(describe_stop(None, &settings).contains("before anything was known"));
    }
}
