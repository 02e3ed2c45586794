//! Commands that save, load or delete a subject.

use anyhow::bail;
use equipoise_bus::parse_text;
use equipoise_config::is_plain;
use equipoise_core::cycle::SubjectState;
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, State};
use equipoise_station::ANONYMOUS;

use super::{Answer, TOO_MANY, push_command};
use crate::active_configuration::{LoadedSubject, SharedConfiguration};
use crate::profile::{Profile, unix_s};
use crate::rings::CommandEnds;
use crate::subjects::{ProfileDestination, Subjects};

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
    let path = subjects.state().profile(&id);
    let profile = Profile::read(&path)
        .map_err(|error| error.to_string())?
        .ok_or_else(|| format!("there is no profile {id}; `equipoise subject list` shows them"))?;
    let mut changes = active_configuration.lock_changes();
    let mut active = active_configuration.get();
    // The configured mass applies to the configured subject only, `subject.save_profile` to every subject.
    let configured = active.config.subject.id == id;
    active.loaded = (!configured).then(|| LoadedSubject { id: id.clone(), build: profile.build() });
    let settings = active.settings();
    let mut worker = bytemuck::zeroed_box::<SubjectState>();
    worker.identification =
        *profile.worker(&settings).map_err(|reason| format!("the profile {id} is not used: {reason}"))?;
    if let Some(mass_kg) = settings.mass_kg {
        worker.identification.mass_kg = mass_kg;
    }
    let shift = match profile.shift(unix_s()) {
        Ok(shift) => {
            worker.exposure.resume(&shift);
            format!("the shift goes on, {} lifts", shift.lifts)
        }
        Err(_) => "a new shift begins".to_owned(),
    };
    let (poses, mass_kg) = (worker.identification.poses_used, worker.identification.mass_kg);
    let save = active.config.subject.save_profile;
    let destination = ProfileDestination {
        experience: profile.experience(),
        ..ProfileDestination::of(subjects.state(), &id, profile.build(), save)
    };
    // The loop applies a command before settings: for one cycle the worker has the limits of the subject before, while
    // `model_changed` withholds the torques.
    active_configuration
        .apply(&mut changes, active, || push_worker(ends, subjects, worker, destination))
        .map_err(|error| format!("{id} is not loaded: {error:#}"))?;
    let assumed = match (configured, profile.build()) {
        (false, None) => "; its profile lacks stature and sex, those of the configuration are assumed",
        _ => "",
    };
    Ok(format!("{id} is in use: {poses} poses, {mass_kg:.1} kg; {shift}{assumed}"))
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
    let in_use = subjects.get(subjects.in_use()).is_some_and(|destination| destination.subject == id);
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
            let mut unidentified = bytemuck::zeroed_box::<SubjectState>();
            unidentified.identification.start(&active.settings());
            push_worker(ends, subjects, unidentified, ProfileDestination::unnamed())
        };
        active_configuration
            .apply(&mut changes, active.clone(), before_settings)
            .map_err(|error| format!("{id} is still in the daemon's memory: {error:#}"))?;
    }
    subjects.delete(&id);
    let mut answer = if in_use {
        format!("{id} was in use: forgotten, an unknown worker is learnt instead and not saved")
    } else {
        format!("the daemon keeps nothing of {id}")
    };
    if active.config.subject.id == id {
        answer +=
            "; its configuration still names it: change subject.id, or the next start begins a new profile";
    }
    Ok(answer)
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
