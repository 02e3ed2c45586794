//! Writes to disk what is learnt of the worker. A thread of its own: a disk may take its time, and nobody waits for it.

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use equipoise_core::cycle::Identification;
use equipoise_core::message::Incident;

use crate::incidents::IncidentBoard;
use crate::profile::Profile;
use crate::workers::Workers;

/// A worker's number and what is known of that worker now.
pub type ChangedWorker = (u64, Box<Identification>);

/// Saves until egress, which sends what there is to save, has ended.
pub fn run(changed: &Receiver<ChangedWorker>, workers: &Workers, board: &Arc<IncidentBoard>) {
    let saver = Saver { workers, board };
    while let Ok(mut newest) = changed.recv() {
        // Several poses may have come while the disk was slow; only the last of each worker counts.
        while let Ok(later) = changed.try_recv() {
            if later.0 != newest.0 {
                saver.write(&newest);
            }
            newest = later;
        }
        saver.write(&newest);
    }
}

struct Saver<'a> {
    workers: &'a Workers,
    board: &'a IncidentBoard,
}

impl Saver<'_> {
    fn write(&self, (number, worker): &ChangedWorker) {
        let Some(saving) = self.workers.get(*number).filter(|saving| saving.refusal.is_none()) else {
            return;
        };
        let Some(profile) = Profile::of(&saving.subject, saving.build, worker) else { return };
        match profile.write(&saving.path) {
            Ok(()) => self.board.end(Incident::NotSaved),
            Err(error) => self.board.begin(
                Incident::NotSaved,
                &format!("{error}; the worker is kept in memory and saved again after the next pose"),
            ),
        }
    }
}
