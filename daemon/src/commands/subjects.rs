//! Commands that save, load or delete a subject.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::bail;
use equipoise_bus::parse_text;
use equipoise_config::is_plain;
use equipoise_config::method::SubjectConfig;
use equipoise_core::cycle::SubjectState;
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, State};
use equipoise_core::time::NS_PER_S;
use equipoise_files::FileLock;
use equipoise_station::ANONYMOUS;

use super::{Answer, TOO_MANY, await_receipt, push_command};
use crate::active_configuration::{ActiveConfiguration, LoadedSubject, SharedConfiguration};
use crate::profile::{Profile, unix_s};
use crate::realtime::now_ns;
use crate::rings::{CommandEnds, SettingsSender};
use crate::subjects::{DELETED, ProfileDestination, Subjects};

/// Maximum wait for the loop and for the saving thread before a subject is loaded.
const SAVED_TIMEOUT: Duration = Duration::from_millis(500);
const SAVED_POLL_INTERVAL: Duration = Duration::from_millis(5);

pub(super) fn save(ends: &mut CommandEnds, subjects: &Subjects, latest: Option<&State>) -> Answer {
    let destination = subjects.get(subjects.in_use()).ok_or("no subject is in use")?;
    if let Some(reason) = destination.refusal {
        return Err(format!("{} is not saved: {reason}", destination.subject));
    }
    // The filter has a variance once the body is available.
    if latest.is_none_or(|state| state.variance_max_m2 <= 0.0) {
        return Err("nothing is known of the worker yet; let the suit stream first".to_owned());
    }
    push_command(ends, CommandKind::SubjectSave)
        .map(|()| format!("the worker is being saved as {}", destination.subject))
}

pub(super) fn load(
    command: &Command,
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
) -> Answer {
    let id = parse_id(command)?;
    await_saved(&id, ends, subjects)?;
    if is_in_use(&id, subjects) {
        // Its file is up to half a second old.
        copy_subject_in_use(ends)?;
        await_saved(&id, ends, subjects)?;
    }
    // Not live: a reload does not change it.
    let save = active_configuration.with(|active| active.config.subject.save_profile);
    // Before the profile is read, so that the last data of another station are in it.
    let _claim = if save { claim(&id, subjects)? } else { None };
    let path = subjects.state().profile(&id);
    let profile = Profile::read(&path).map_err(|error| error.to_string())?;
    let mut changes = active_configuration.lock_changes();
    let mut active = active_configuration.get();
    // The configured mass applies to the configured subject only, `subject.save_profile` to every subject.
    let configured = active.config.subject.id == id;
    let Some(profile) = profile else {
        return load_without_profile(&id, ends, active_configuration, subjects, &mut changes, active);
    };
    active.loaded = (!configured).then(|| LoadedSubject { id: id.clone(), build: Some(profile.build()) });
    let settings = active.settings();
    let mut worker = bytemuck::zeroed_box::<SubjectState>();
    worker.identification =
        *profile.worker(&settings).map_err(|reason| format!("the profile {id} is not used: {reason}"))?;
    if let Some(mass_kg) = settings.mass_kg {
        worker.identification.mass_kg = mass_kg;
    }
    let shift = match profile.shift(unix_s()) {
        Ok((shift, age_s, message)) => {
            worker.exposure.resume(&shift, now_ns().wrapping_sub(age_s * NS_PER_S));
            message
        }
        Err(_) => "a new shift begins".to_owned(),
    };
    let (poses, mass_kg) = (worker.identification.poses_used, worker.identification.mass_kg);
    let destination = ProfileDestination {
        experience: profile.experience(),
        ..ProfileDestination::of(subjects.state(), &id, Some(profile.build()), save)
    };
    // The loop applies a command before settings: for one cycle the worker has the limits of the subject before, while
    // `model_changed` withholds the torques.
    active_configuration
        .apply(&mut changes, active, || push_worker(ends, subjects, worker, destination))
        .map_err(|error| format!("{id} is not loaded: {error:#}"))?;
    Ok(format!("{id} is in use: {poses} poses, {mass_kg:.1} kg; {shift}"))
}

/// Claims the files of a subject, which another daemon may have in use.
fn claim(id: &str, subjects: &Subjects) -> Result<Option<Arc<FileLock>>, String> {
    subjects.claim(id).map_err(|in_use| format!("{in_use}; load another subject there first"))
}

/// Loads a subject that has no profile, which only the configured one can be.
fn load_without_profile(
    id: &str,
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
    changes: &mut SettingsSender,
    active: ActiveConfiguration,
) -> Answer {
    let SubjectConfig { id: configured, save_profile, .. } = &active.config.subject;
    let (is_configured, is_saved) = (configured == id, *save_profile);
    if is_configured && !is_in_use(id, subjects) {
        return begin_configured(ends, active_configuration, subjects, changes, active);
    }
    // The profile that could not be used was moved away, and the loop has the data of this subject since the start.
    if is_configured && is_saved && subjects.end_refusal() {
        push_command(ends, CommandKind::SubjectSave)?;
        return Ok(format!("{id} is in use: a new profile begins, with the data since the start"));
    }
    Err(format!("there is no profile {id}; `equipoise subject list` shows them"))
}

/// Loads the configured subject without data.
fn begin_configured(
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
    changes: &mut SettingsSender,
    mut active: ActiveConfiguration,
) -> Answer {
    active.loaded = None;
    let worker = unidentified(&active);
    let SubjectConfig { id, save_profile, .. } = active.config.subject.clone();
    let build = active.config.subject.build();
    let destination = ProfileDestination::of(subjects.state(), &id, Some(build), save_profile);
    active_configuration
        .apply(changes, active, || push_worker(ends, subjects, worker, destination))
        .map_err(|error| format!("{id} is not loaded: {error:#}"))?;
    Ok(format!("{id} is in use, without data: a new profile begins"))
}

/// Removes a subject from all memory of the daemon; the client deletes the files, which are not written again.
pub(super) fn delete(
    command: &Command,
    ends: &mut CommandEnds,
    active_configuration: &SharedConfiguration,
    subjects: &Subjects,
) -> Answer {
    let id = parse_id(command)?;
    let mut changes = active_configuration.lock_changes();
    let mut active = active_configuration.get();
    let is_similar = active.similar.as_ref().is_some_and(|chosen| chosen.subject == id);
    let in_use = is_in_use(&id, subjects);
    if is_similar {
        active.similar = None;
    }
    if in_use {
        active.loaded = Some(LoadedSubject { id: ANONYMOUS.to_owned(), build: None });
    }
    if is_similar || in_use {
        let before_settings = || {
            if !in_use {
                return Ok(());
            }
            push_worker(ends, subjects, unidentified(&active), ProfileDestination::unnamed(DELETED))
        };
        active_configuration
            .apply(&mut changes, active.clone(), before_settings)
            .map_err(|error| format!("{id} is still in the daemon's memory: {error:#}"))?;
    }
    drop(changes);
    // A refused command deletes nothing.
    await_receipt(ends)?;
    subjects.delete(&id);
    let mut answer = if in_use {
        format!("{id} was in use: forgotten, an unknown worker is learnt instead and not saved")
    } else {
        format!("the daemon keeps nothing of {id}")
    };
    if active.config.subject.id == id {
        answer += "; its configuration still names it: change subject.id, or loading it begins a new profile";
    }
    Ok(answer)
}

/// Waits until the disk holds all that the loop has passed on of a subject, and a box is free for the last copy of the
/// subject in use.
fn await_saved(id: &str, ends: &CommandEnds, subjects: &Subjects) -> Result<(), String> {
    // A subject loaded before has passed the loop.
    let is_processed = || ends.worker.slots() > 0 && ends.control.copies_pending() == 0;
    if wait_for(|| is_processed() && !subjects.is_unwritten(id)) {
        return Ok(());
    }
    Err(if is_processed() {
        format!(
            "newer data of {id} are in memory and not on the disk yet: see the incident not_saved, and ask again"
        )
    } else {
        "the disk is slow, and data of the subject in use could be lost; ask again".to_owned()
    })
}

/// Requests a copy of the loop's subject and waits until it is made.
fn copy_subject_in_use(ends: &mut CommandEnds) -> Result<(), String> {
    push_command(ends, CommandKind::SubjectSave)?;
    let is_taken = wait_for(|| ends.command.slots() == ends.command.buffer().capacity());
    // The loop copies at the end of a cycle, after it has counted it.
    let cycle = ends.control.last_cycle();
    if is_taken && wait_for(|| ends.control.last_cycle() > cycle + 1) {
        Ok(())
    } else {
        Err("the loop does not run; see `equipoise status`".to_owned())
    }
}

/// Waits until a condition holds; returns whether it does.
fn wait_for(condition: impl Fn() -> bool) -> bool {
    let started = Instant::now();
    while !condition() {
        if started.elapsed() > SAVED_TIMEOUT {
            return false;
        }
        std::thread::sleep(SAVED_POLL_INTERVAL);
    }
    true
}

fn is_in_use(id: &str, subjects: &Subjects) -> bool {
    subjects.get(subjects.in_use()).is_some_and(|destination| destination.subject == id)
}

/// A subject without data.
fn unidentified(active: &ActiveConfiguration) -> Box<SubjectState> {
    let mut worker = bytemuck::zeroed_box::<SubjectState>();
    worker.identification.start(&active.settings());
    worker
}

fn parse_id(command: &Command) -> Result<String, String> {
    let id = parse_text(&command.subject);
    if is_plain(&id) {
        Ok(id)
    } else {
        Err("a subject's id is made of letters, digits, '-' and '_'".to_owned())
    }
}

/// Passes another subject to the loop.
fn push_worker(
    ends: &mut CommandEnds,
    subjects: &Subjects,
    worker: Box<SubjectState>,
    destination: ProfileDestination,
) -> anyhow::Result<()> {
    while ends.returned_workers.pop().is_ok() {}
    // Only this thread fills both rings, so a free slot stays free.
    if ends.command.is_full() || ends.worker.is_full() {
        bail!(TOO_MANY);
    }
    let number = subjects.add(destination);
    let _ = ends.worker.push((number, worker));
    push_command(ends, CommandKind::SubjectLoad).map_err(anyhow::Error::msg)?;
    subjects.activate(number);
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use bytemuck::Zeroable;
    use equipoise_core::message::CycleRecord;
    use equipoise_station::state_directory::StateDirectory;

    use super::*;
    use crate::commands::tests::daemon;
    use crate::profile::example;
    use crate::rings::{LoopEnds, Outcome, Rings};
    use crate::subjects::CONFIGURED;

    /// A loop that saves with `save` until it is stopped; returns the lifts of the subject loaded last.
    fn serve(loop_ends: &mut LoopEnds, save: impl Fn()) -> Option<u64> {
        let mut lifts = None;
        for cycle in 1.. {
            let command = loop_ends.command.pop().ok();
            let state = State { cycle, ..State::zeroed() };
            loop_ends.push_outcome(Outcome { state, record: CycleRecord::zeroed() });
            match command {
                Some(CommandKind::SubjectSave) => save(),
                Some(CommandKind::SubjectLoad) => {
                    lifts = loop_ends.worker.pop().ok().map(|(_, worker)| worker.exposure.dose.lifts);
                }
                _ if loop_ends.control.is_stopping() => break,
                _ => std::thread::sleep(Duration::from_millis(1)),
            }
        }
        lifts
    }

    fn command(kind: CommandKind) -> Command {
        let mut command = Command { kind: kind as u32, ..Command::zeroed() };
        command.subject[..5].copy_from_slice(b"alice");
        command
    }

    /// Loads alice, again if a busy machine delays the loop for too long.
    fn load_alice(ends: &mut CommandEnds, active: &SharedConfiguration, subjects: &Subjects) -> Answer {
        let started = Instant::now();
        loop {
            let answer = load(&command(CommandKind::SubjectLoad), ends, active, subjects);
            let is_late = answer.as_ref().is_err_and(|reason| {
                reason.contains("the loop does not run") || reason.contains("the disk is slow")
            });
            if !is_late || started.elapsed() > Duration::from_secs(90) {
                return answer;
            }
        }
    }

    #[test]
    fn the_subject_in_use_is_loaded_with_what_the_loop_has_of_it() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        fs::create_dir_all(state.profiles()).unwrap();
        let (mut commands, mut loop_ends, active, subjects) = daemon(&state);
        let [old, new] = [7, 8].map(|lifts| example::text("alice", lifts, &active.settings()));
        let path = state.profile("alice");
        fs::write(&path, old).unwrap();
        std::thread::scope(|scope| {
            let the_loop = scope.spawn(|| serve(&mut loop_ends, || fs::write(&path, &new).unwrap()));
            let answer = load_alice(&mut commands, &active, &subjects).and_then(|_| await_receipt(&commands));
            commands.control.stop();
            assert_eq!(the_loop.join().unwrap(), Some(8), "{answer:?}");
        });
    }

    #[test]
    fn the_configured_subject_is_saved_again_once_its_damaged_profile_is_moved_away() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        fs::create_dir_all(state.profiles()).unwrap();
        fs::write(state.profile("alice"), "damaged").unwrap();
        let (mut commands, mut loop_ends, active, subjects) = daemon(&state);
        subjects.refuse(CONFIGURED, "it is damaged".to_owned());
        let answers = std::thread::scope(|scope| {
            scope.spawn(|| serve(&mut loop_ends, || {}));
            let damaged = load_alice(&mut commands, &active, &subjects);
            let moved = fs::rename(state.profile("alice"), directory.path().join("moved"));
            let answers = [(); 2].map(|()| load_alice(&mut commands, &active, &subjects));
            commands.control.stop();
            (damaged, moved.is_ok(), answers)
        });
        let (Err(_), true, [Ok(first), Err(second)]) = &answers else { panic!("{answers:?}") };
        assert!(first.starts_with("alice is in use: a new profile begins"), "{first}");
        assert!(second.starts_with("there is no profile alice"), "{second}");
        let in_use = subjects.get(subjects.in_use()).unwrap();
        assert_eq!((in_use.subject.as_str(), in_use.refusal), ("alice", None));
    }

    #[test]
    fn a_subject_stays_if_the_loop_ends_before_it_has_another() {
        let directory = tempfile::tempdir().unwrap();
        let (mut commands, mut loop_ends, active, subjects) = daemon(&StateDirectory::at(directory.path()));
        let control = Arc::clone(&commands.control);
        let running = control.mark_loop_running();
        let deletion = command(CommandKind::SubjectDelete);
        std::thread::scope(|scope| {
            let answer = scope.spawn(|| delete(&deletion, &mut commands, &active, &subjects));
            while loop_ends.command.is_empty() && !answer.is_finished() {
                std::thread::sleep(SAVED_POLL_INTERVAL);
            }
            control.stop();
            drop(running);
            answer.join().unwrap().unwrap_err();
        });
        assert_eq!(loop_ends.command.pop().ok(), Some(CommandKind::SubjectLoad));
        assert_eq!(subjects.get(CONFIGURED).unwrap().subject, "alice");
    }

    #[test]
    fn a_subject_is_loaded_only_once_its_newest_data_are_on_the_disk() {
        let state = StateDirectory::at(std::path::Path::new("/nowhere"));
        let subjects = Subjects::new(state.clone(), "s", ProfileDestination::of(&state, "a", None, true));
        let Rings { mut commands, mut loop_ends, .. } = Rings::new().unwrap();
        assert_eq!(await_saved("a", &commands, &subjects), Ok(()));
        subjects.set_unwritten(CONFIGURED, true);
        assert!(await_saved("a", &commands, &subjects).unwrap_err().contains("newer data of a"));
        assert_eq!(await_saved("b", &commands, &subjects), Ok(()));
        subjects.set_unwritten(CONFIGURED, false);
        commands.control.count_copy();
        assert!(await_saved("b", &commands, &subjects).unwrap_err().contains("the disk is slow"));
        commands.control.count_processed_copy();
        // A subject loaded before whose predecessor's last copy is not made yet.
        assert!(commands.worker.push((1, bytemuck::zeroed_box())).is_ok());
        assert!(await_saved("b", &commands, &subjects).is_err());
        assert!(loop_ends.worker.pop().is_ok());
        assert_eq!(await_saved("b", &commands, &subjects), Ok(()));
    }
}
