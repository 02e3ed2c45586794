//! Commands that save, load or delete a subject.

use equipoise_core::cycle::{PriorKind, SubjectState};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, State};

use super::{Answer, hand_over, text_of};
use crate::in_force::InForce;
use crate::profile::{self, Profile, unix_s};
use crate::rings::Rings;
use crate::workers::{Saving, Workers};

const TOO_MANY: &str = "too many commands at once; ask again";

pub(super) fn save(rings: &Rings, workers: &Workers, latest: Option<&State>) -> Answer {
    let saving = workers.get(workers.in_use()).ok_or("no subject is in use")?;
    if let Some(why) = saving.refusal {
        return Err(format!("{} is not saved: {why}", saving.subject));
    }
    // The filter has a variance once the body is available.
    if latest.is_none_or(|state| state.variance_max_m2 <= 0.0) {
        return Err("nothing is known of the worker yet; let the suit stream first".to_owned());
    }
    hand_over(rings, CommandKind::SubjectSave)
        .map(|()| format!("the worker is being saved as {}", saving.subject))
}

pub(super) fn load(command: &Command, rings: &Rings, in_force: &InForce, workers: &Workers) -> Answer {
    let id = id_of(command)?;
    let settings = in_force.look(|forced| forced.settings);
    let path = workers.state().profile(&id);
    let profile = Profile::read(&path)
        .map_err(|error| error.to_string())?
        .ok_or_else(|| format!("there is no profile {id}; `equipoise subject list` shows them"))?;
    let mut worker = bytemuck::zeroed_box::<SubjectState>();
    worker.identification =
        *profile.worker(&settings).map_err(|why| format!("the profile {id} is not used: {why}"))?;
    // `subject.remember` applies to every subject; the configured mass applies to the configured subject only.
    let (configured, remember) =
        in_force.look(|forced| (forced.config.subject.id == id, forced.config.subject.remember));
    if let (true, Some(mass_kg)) = (configured, settings.mass_kg) {
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
    put_in_place(rings, workers, worker, Saving::of(workers.state(), &id, profile.build(), remember))?;
    Ok(format!("{id} is in use: {poses} poses, {mass_kg:.1} kg; {shift}"))
}

/// Removes a subject from all memory of the daemon; the client deletes the files, which are not written again.
pub(super) fn forget(command: &Command, rings: &Rings, in_force: &InForce, workers: &Workers) -> Answer {
    let id = id_of(command)?;
    let _alone = in_force.alone();
    let mut forced = in_force.now();
    let is_similar = forced.similar.as_deref() == Some(&id);
    if is_similar && rings.settings.is_full() {
        return Err(TOO_MANY.to_owned());
    }
    let in_use = workers.get(workers.in_use()).is_some_and(|saving| saving.subject == id);
    if in_use {
        let mut unknown = bytemuck::zeroed_box::<SubjectState>();
        // The configured mass belongs to the configured subject.
        let settings = equipoise_core::cycle::Settings { mass_kg: None, ..forced.settings };
        unknown.identification.start(&settings);
        put_in_place(rings, workers, unknown, Saving::unnamed())?;
    }
    workers.forget(&id);
    if is_similar {
        (forced.settings.similar, forced.settings.prior, forced.similar) = (None, PriorKind::Table, None);
        if !rings.hand_over_settings(0, Box::new(forced.settings)) {
            return Err(TOO_MANY.to_owned());
        }
        in_force.replace(forced.clone());
    }
    let mut answer = if in_use {
        format!("{id} was in use: forgotten, an unknown worker is learnt instead and not saved")
    } else {
        format!("the daemon keeps nothing of {id}")
    };
    if forced.config.subject.id == id {
        answer +=
            "; its configuration still names it: change subject.id, or the next start begins a new profile";
    }
    Ok(answer)
}

fn id_of(command: &Command) -> Result<String, String> {
    let id = text_of(&command.subject);
    if profile::is_plain(&id) {
        Ok(id)
    } else {
        Err("a subject's id is made of letters, digits, '-' and '_'".to_owned())
    }
}

/// Passes another subject to the loop.
fn put_in_place(rings: &Rings, workers: &Workers, worker: Box<SubjectState>, saving: Saving) -> Result<(), String> {
    while rings.worker_back.pop().is_some() {}
    // Only this thread fills both rings, so a free slot stays free.
    if rings.command.is_full() || rings.worker.is_full() {
        return Err(TOO_MANY.to_owned());
    }
    let number = workers.add(saving);
    let _ = rings.worker.push((number, worker));
    hand_over(rings, CommandKind::SubjectLoad)?;
    workers.use_from_now_on(number);
    Ok(())
}
