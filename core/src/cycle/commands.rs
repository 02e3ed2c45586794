//! Commands: the only place besides [`super::step`] that changes the state of several stages.

use bytemuck::Zeroable;

use super::memory::Memory;
use super::settings::Settings;
use super::{Tick, identification::BodySource, identification::Identification};
use crate::message::command::CommandKind;

/// Applies a command before the samples of the cycle are ingested.
pub(super) fn apply(settings: &Settings, memory: &mut Memory, command: CommandKind, tick: Tick) {
    match command {
        CommandKind::IdentifyStart => memory.identification.continue_identification(),
        CommandKind::IdentifyStop => {
            memory.identification.stop();
            memory.load.reset_position();
            memory.model_changed_ns = tick.due_ns;
        }
        CommandKind::IdentifyReset => {
            // Samples from before the command must not update the filter again.
            memory.clear_windows();
            memory.load.reset_position();
            memory.move_stance_offset_to_anchor();
            memory.identification.restart(settings);
            memory.pose_request.restart(settings);
            memory.motion_updates.used = 0;
            memory.model_changed_ns = tick.due_ns;
        }
        CommandKind::Tare => {
            if let Some(zero_n) = memory.align.tare() {
                if !memory.ground.reset_offset(settings, zero_n) {
                    memory.identification.reset_weighing();
                }
                memory.prediction.noise.reset_shear();
                memory.model_changed_ns = tick.due_ns;
            }
        }
        CommandKind::PoseSkip => {
            if !memory.pose_request.skip(settings, &memory.identification) {
                memory.identification.skip_pose();
            }
        }
        CommandKind::UndoLift => {
            memory.exposure.dose.undo_lift();
            memory.publication.hold_shift(&memory.exposure);
        }
        // Handled by the daemon: the loop's memory does not change, or is replaced as a whole.
        CommandKind::Checkpoint | CommandKind::SubjectSave | CommandKind::SubjectDelete => {}
        CommandKind::Reload => reload(settings, memory, tick),
        CommandKind::SubjectLoad => {
            // The window contains poses of the previous subject.
            memory.clear_windows();
            memory.load.start_subject();
            memory.ground.force_offset.reset();
            memory.pose_request.restart(settings);
            memory.prediction.noise = Zeroable::zeroed();
            memory.motion_updates.used = 0;
            memory.model_changed_ns = tick.due_ns;
        }
    }
}

/// Resets the results of the previous settings and model.
fn reload(settings: &Settings, memory: &mut Memory, tick: Tick) {
    // Filters and the static pose window contain results of the previous model.
    memory.clear_windows();
    memory.load.reset_position();
    replace_model(settings, memory, tick);
    memory.prediction.terms.restart();
    if memory.differentiation != settings.differentiation() {
        memory.differentiation = settings.differentiation();
        memory.prediction.noise = Zeroable::zeroed();
        memory.early.reset_differences();
    }
    // Before the first measurement the prior is that of the settings.
    let subject = &memory.identification;
    let is_measured = subject.poses_used > 0 || memory.motion_updates.used > 0 || subject.identified == 1;
    if subject.has_body() && !is_measured && subject.body_source() != BodySource::Stored {
        memory.reset_to_prior(settings);
    }
    memory.pose_request.restart(settings);
    memory.model_changed_ns = tick.due_ns;
}

/// Revises what was measured with the previous model, unless it has the same terms.
fn replace_model(settings: &Settings, memory: &mut Memory, tick: Tick) {
    let fingerprint = settings.model.fingerprint();
    if memory.model == fingerprint {
        return;
    }
    memory.model = fingerprint;
    let lag_s = memory.prediction.terms.suit_lag_s(&settings.model, tick.due_ns);
    memory.align.replace_model_lag(lag_s);
    memory.ground.widen_offset();
    memory.identification.widen_stance_offset(settings);
}

impl Identification {
    /// Ends the identification; the present estimate is used.
    fn stop(&mut self) {
        self.identifying = 0;
        self.identified = u64::from(self.has_body());
    }

    /// Starts again from the prior, with the mass of the settings: the measured one may have been wrong.
    fn restart(&mut self, settings: &Settings) {
        if self.has_body() {
            self.reset_to_prior(settings);
        }
        self.mass_kg = settings.mass_kg.unwrap_or(0.0);
        self.identifying = 1;
    }
}
