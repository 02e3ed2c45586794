//! Runs the loop's memory and a second one that keeps the model of the table; both receive every cycle.

use equipoise_core::cycle::{Inputs, Memory, Settings, SubjectState, Tick, step};
use equipoise_core::message::{CommandKind, State};

use super::score::{SampleSelection, Scored};

/// State of a replay.
pub(super) struct Machine {
    settings: Settings,
    memory: Box<Memory>,
    table: Box<Memory>,
    table_settings: Settings,
    scored: Vec<Scored>,
}

impl Machine {
    /// Starts with this memory.
    pub(super) fn new(settings: Settings, memory: Box<Memory>) -> Machine {
        let mut table = memory.clone();
        table.identification.identifying = 0;
        Machine { settings, memory, table, table_settings: of_table(&settings), scored: Vec::new() }
    }

    /// Resumes from a memory of the live loop.
    pub(super) fn resume(&mut self, memory: &Memory) {
        copy_memory(&mut self.memory, memory);
        copy_memory(&mut self.table, memory);
        if self.table.identification.has_body() {
            self.table.reset_to_prior(&self.table_settings);
        }
        self.table.identification.identifying = 0;
    }

    /// Replaces the subject by one without data, with these settings from the next step on.
    pub(super) fn begin_subject(&mut self, settings: &Settings) {
        self.change_settings(settings);
        let mut subject = bytemuck::zeroed_box::<SubjectState>();
        subject.identification.start(settings);
        self.memory.replace_subject(&subject);
        subject.identification.identifying = 0;
        self.table.replace_subject(&subject);
    }

    /// Changes the settings from the next step on.
    pub(super) fn change_settings(&mut self, settings: &Settings) {
        (self.settings, self.table_settings) = (*settings, of_table(settings));
    }

    /// The samples that count for the error of the CoP.
    pub(super) fn into_scored(self) -> Vec<Scored> {
        self.scored
    }

    pub(super) fn memory(&self) -> &Memory {
        &self.memory
    }

    pub(super) fn state(&self) -> &State {
        &self.memory.state
    }

    /// Runs one cycle of both.
    pub(super) fn step(&mut self, tick: Tick, inputs: Inputs<'_>) -> &State {
        let before_ns = self.memory.state.suit_sample_time_ns;
        step(&self.settings, &mut self.memory, tick, inputs);
        // The table's model ignores commands that concern identification.
        let command = inputs.command.filter(|command| {
            matches!(command, CommandKind::Tare | CommandKind::Reload | CommandKind::SubjectLoad)
        });
        step(&self.table_settings, &mut self.table, tick, Inputs { command, ..inputs });
        if self.memory.state.suit_sample_time_ns != before_ns {
            self.scored.extend(Scored::of(
                &self.memory.state,
                &self.table.state,
                SampleSelection::QuasiStatic,
            ));
        }
        &self.memory.state
    }
}

/// The settings without the similar subject: the table alone.
fn of_table(settings: &Settings) -> Settings {
    Settings { similar: None, ..*settings }
}

/// Copies in place: a memory is too large for the stack.
fn copy_memory(to: &mut Memory, from: &Memory) {
    bytemuck::bytes_of_mut(to).copy_from_slice(bytemuck::bytes_of(from));
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::{SEGMENTS, Skeleton};
    use equipoise_core::cycle::{PriorKind, Similar};
    use equipoise_core::frame::{Pose, SuitWorld, rotation};
    use equipoise_core::sesc::PARAMETERS;

    use super::*;

    #[test]
    fn the_model_of_the_table_has_no_part_of_a_similar_subject() {
        let (deviation_m, variance_m2) = ([2e-3; PARAMETERS], [1e-6; PARAMETERS]);
        let similar = Some(Similar { deviation_m, variance_m2, likeness: 0.7 });
        let settings = Settings { prior: PriorKind::SimilarSubject, similar, ..Settings::for_height(1.77) };
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        let origin = Skeleton::nominal(1.77).t_pose_m().map(Into::into);
        let pose: Pose<SuitWorld> = Pose::new(origin, [rotation([1.0, 0.0, 0.0, 0.0]); SEGMENTS]);
        while !memory.identification.has_body() {
            memory.identification.update_skeleton(&pose, &settings);
        }
        let mut machine = Machine::new(settings, memory.clone());
        machine.resume(&memory);
        memory.identification.reset_to_prior(&Settings { prior: PriorKind::Table, ..settings });
        let filter = |memory: &Memory| bytemuck::bytes_of(&memory.identification.filter).to_vec();
        assert!(filter(&machine.table) == filter(&memory));
        assert!(filter(&machine.memory) != filter(&memory));
    }
}
