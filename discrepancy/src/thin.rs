//! Selects the blocks that are processed: as many as one minute of computing allows, however long the recording.

use crate::block::{Block, Phase};
use crate::session::Session;

/// Maximum number of stored identification blocks.
pub const IDENTIFY_MAX: usize = 140;
/// Maximum number of stored clean-work blocks.
pub const REFERENCE_MAX: usize = 300;
/// Maximum number of stored blocks of the work in question.
pub const WORK_MAX: usize = 450;
/// Duration of the change between clean work and work in question, s: a load is put on, or a contact begins.
const ONSET_S: f64 = 1.2;
/// Blocks kept of a static pose: further ones add only noise.
const PER_POSE: usize = 2;

/// The selected blocks: identification, clean work, work in question, each by time.
pub(crate) fn thin(session: &Session) -> Vec<&Block> {
    let of =
        |phase: Phase| session.blocks.iter().filter(move |block| block.phase == phase).collect::<Vec<_>>();
    let mut kept = evenly(few_per_pose(&of(Phase::Identify)), IDENTIFY_MAX);
    kept.extend(evenly(of(Phase::Reference), REFERENCE_MAX));
    let [begin_s, _] = session.spans_s.work;
    let mut work = of(Phase::Work);
    work.retain(|block| block.observation.time_s > begin_s + ONSET_S);
    kept.extend(evenly(work, WORK_MAX));
    kept
}

/// At most `most` blocks, evenly spaced.
fn evenly(blocks: Vec<&Block>, most: usize) -> Vec<&Block> {
    if blocks.len() <= most {
        return blocks;
    }
    (0..most).map(|i| blocks[i * blocks.len() / most]).collect()
}

/// Keeps a few blocks of every run of static ones; moving blocks are all kept.
fn few_per_pose<'a>(blocks: &[&'a Block]) -> Vec<&'a Block> {
    let mut kept = Vec::new();
    for run in blocks.chunk_by(|a, b| a.still && b.still && a.stance == b.stance && near(a, b)) {
        kept.extend(evenly(run.to_vec(), if run[0].still { PER_POSE } else { run.len() }));
    }
    kept
}

/// Whether two blocks have the same pose: no joint rotated by more than a tremor would.
fn near(a: &Block, b: &Block) -> bool {
    let turned =
        |(a, b): (&[f64; 3], &[f64; 3])| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let squared: f64 = a.joint_rad.iter().zip(&b.joint_rad).map(turned).sum();
    squared < 0.06 * 0.06 * 4.0
}
