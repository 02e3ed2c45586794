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

/// Refusal of a command that is not executed because the daemon ends.
pub const STOPPING: &str = "the daemon is stopping; ask again after its next start";

/// Polling interval for commands.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Polling interval for the loop's receipt of a command.
const RECEIPT_POLL_INTERVAL: Duration = Duration::from_millis(1);

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

    /// Answers commands until a stop is requested, and refuses them from then on until `is_released` returns that the
    /// station's other threads have ended. The command server stays open until this value is dropped.
    ///
    /// # Errors
    /// The bus fails.
    pub fn run(
        &mut self,
        active_configuration: &SharedConfiguration,
        subjects: &Subjects,
        is_released: impl Fn() -> bool,
    ) -> Result<(), BusError> {
        loop {
            // Checked before the commands, so that those sent before the release are answered.
            let ended = self.ends.control.is_stopping() && is_released();
            self.serve(active_configuration, subjects)?;
            if ended {
                return Ok(());
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Answers all pending commands.
    fn serve(
        &mut self,
        active_configuration: &SharedConfiguration,
        subjects: &Subjects,
    ) -> Result<(), BusError> {
        if !self.ends.control.is_stopping()
            && let Some(state) = self.state.latest()?
        {
            self.latest = Some(state);
            self.plate.update(&state);
        }
        let (ends, latest, plate) = (&mut self.ends, self.latest.as_ref(), &self.plate);
        while self
            .server
            .poll(|command| answer(command, ends, active_configuration, subjects, latest, plate))?
        {}
        while self.ends.returned_workers.pop().is_ok() {}
        active_configuration.free_returned_settings();
        Ok(())
    }
}

/// Executes a command, waits until the loop has received its part of it, and returns the reply.
fn answer(
    command: &Command,
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
    latest: Option<&State>,
    plate: &PlateHistory,
) -> Reply {
    let outcome = execute(command, ends, active_configuration, subjects, latest, plate);
    let cycle = ends.control.last_cycle() + 1;
    let outcome = match outcome.and_then(|text| await_receipt(ends).map(|()| text)) {
        // The stop may be the cause of any failure, such as that of a wait for the loop.
        Err(_) if ends.control.is_stopping() => Err(STOPPING.to_owned()),
        outcome => outcome,
    };
    reply(cycle, outcome)
}

fn execute(
    command: &Command,
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
    latest: Option<&State>,
    plate: &PlateHistory,
) -> Answer {
    if ends.control.is_stopping() {
        return Err(STOPPING.to_owned());
    }
    match CommandKind::from_number(command.kind) {
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
    }
}

const TOO_MANY: &str = "too many commands at once; ask again";

fn push_command(ends: &mut CommandEnds, kind: CommandKind) -> Result<(), String> {
    ends.command.push(kind).map_err(|_| TOO_MANY.to_owned())
}

/// Waits until the loop has received all commands, which it executes in the same cycle, or has ended without.
fn await_receipt(ends: &CommandEnds) -> Result<(), String> {
    loop {
        // Checked before the ring: the loop may receive a command in its last cycle.
        let ended = ends.control.has_ended();
        if ends.command.slots() == ends.command.buffer().capacity() {
            return Ok(());
        }
        if ended {
            return Err(STOPPING.to_owned());
        }
        std::thread::sleep(RECEIPT_POLL_INTERVAL);
    }
}

/// What follows a reset of the identification: without a configured mass the subject is weighed first, which may be
/// delayed.
fn describe_reset(latest: Option<&State>, settings: &Settings) -> String {
    if settings.mass_kg.is_some() {
        return "all poses are discarded; identification restarts".to_owned();
    }
    let delay = latest.and_then(weighing::obstacle).map_or_else(
        || ": stand still on the plate with both feet and empty hands".to_owned(),
        |obstacle| format!(", which waits: {obstacle}"),
    );
    format!("all poses are discarded; identification restarts once the worker is weighed{delay}")
}

/// The accuracy reached by an identification that was stopped.
fn describe_stop(latest: Option<&State>, settings: &Settings) -> String {
    let Some(state) = latest.filter(|state| state.variance_max_m2 > 0.0) else {
        return "identification has ended before anything was known of the worker".to_owned();
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
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use equipoise_bus::root::shared_memory_prefix;
    use equipoise_bus::{BusSettings, parse_text};
    use equipoise_station::state_directory::StateDirectory;

    use super::*;
    use crate::active_configuration::ActiveConfiguration;
    use crate::example_config;
    use crate::rings::{LoopEnds, Rings};
    use crate::subjects::ProfileDestination;

    const RESET: CommandKind = CommandKind::IdentifyReset;

    /// A daemon without a loop, whose configured subject is alice.
    pub(super) fn daemon(state: &StateDirectory) -> (CommandEnds, LoopEnds, SharedConfiguration, Subjects) {
        let config = example_config::config("alice", "");
        let Rings { commands, loop_ends, settings, .. } = Rings::new().unwrap();
        let active = ActiveConfiguration { config, loaded: None, similar: None };
        let configured = ProfileDestination::of(state, "alice", None, true);
        let subjects = Subjects::new(state.clone(), "s", configured);
        (commands, loop_ends, SharedConfiguration::new(active, settings), subjects)
    }

    /// Whether a reply is a refusal, and its text.
    fn parts(reply: &Reply) -> (u32, String) {
        (reply.refused, parse_text(&reply.text))
    }

    #[test]
    fn a_command_that_the_loop_does_not_execute_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let (mut commands, mut loop_ends, active, subjects) = daemon(&StateDirectory::at(directory.path()));
        let control = Arc::clone(&commands.control);
        let ask = |ends: &mut CommandEnds| {
            let command = Command { kind: RESET as u32, ..Command::zeroed() };
            parts(&answer(&command, ends, &active, &subjects, None, &PlateHistory::default()))
        };
        let mut running = Some(control.mark_loop_running());
        for stops in [false, true] {
            let reply = std::thread::scope(|scope| {
                let reply = scope.spawn(|| ask(&mut commands));
                while loop_ends.command.is_empty() && !reply.is_finished() {
                    std::thread::sleep(RECEIPT_POLL_INTERVAL);
                }
                if stops {
                    control.stop();
                    drop(running.take());
                } else {
                    assert_eq!(loop_ends.command.pop().ok(), Some(RESET));
                }
                reply.join().unwrap()
            });
            if stops {
                assert_eq!(reply, (1, STOPPING.to_owned()));
            } else {
                assert_eq!(reply.0, 0, "{}", reply.1);
            }
        }
        // Nothing is passed on after the stop.
        assert_eq!(loop_ends.command.pop().ok(), Some(RESET));
        assert_eq!(ask(&mut commands), (1, STOPPING.to_owned()));
        assert!(loop_ends.command.is_empty());
    }

    #[test]
    fn commands_are_refused_until_the_station_is_released() {
        // The root of a bus has at most 46 bytes.
        let directory = tempfile::Builder::new().prefix("eq").tempdir_in("/tmp").unwrap();
        let join = |role: &str| {
            Bus::join(&BusSettings { root: directory.path().to_owned(), ..BusSettings::new("s", role) })
        };
        let (ends, _loop_ends, active, subjects) = daemon(&StateDirectory::at(directory.path()));
        let control = Arc::clone(&ends.control);
        let (open, released) = (AtomicBool::new(false), AtomicBool::new(false));
        let reply = std::thread::scope(|scope| {
            let server = scope.spawn(|| {
                let bus = join("daemon").unwrap();
                let server = bus.command_server().unwrap();
                let mut commands = Commands::open(bus, server, ends).unwrap();
                open.store(true, Ordering::SeqCst);
                commands.run(&active, &subjects, || released.load(Ordering::SeqCst))
            });
            while !open.load(Ordering::SeqCst) && !server.is_finished() {
                std::thread::sleep(POLL_INTERVAL);
            }
            control.stop();
            let command = Command { kind: RESET as u32, ..Command::zeroed() };
            let client = join("client").and_then(|bus| bus.command_client());
            let reply = client.and_then(|client| client.ask(&command, Duration::from_secs(60)));
            released.store(true, Ordering::SeqCst);
            server.join().unwrap().unwrap();
            reply
        });
        assert_eq!(parts(&reply.unwrap()), (1, STOPPING.to_owned()));
        // iceoryx2 leaves small files behind for each root.
        let prefix = shared_memory_prefix(directory.path());
        for file in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if file.file_name().to_string_lossy().starts_with(&prefix) {
                let _ = std::fs::remove_file(file.path());
            }
        }
    }

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
        assert_eq!(message, "all poses are discarded; identification restarts");
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
