//! What a person or a controller may ask of a running daemon, and the answer.

use super::layout::{ZeroCopySend, message};

message! {
    /// One request.
    as "equipoise/Command/1", 128 bytes,
    pub struct Command {
        /// A [`CommandKind`].
        pub kind: u32,
        /// Always zero.
        pub reserved: u32,
        /// Arguments, as the kind says.
        pub argument: [f64; 4],
        /// A subject's pseudonymous id, UTF-8, zero-filled; for the `Subject…` kinds.
        pub subject: [u8; 64],
        /// Always zero; fills the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 3],
    }
}

message! {
    /// The answer to a [`Command`].
    as "equipoise/Reply/1", 320 bytes,
    pub struct Reply {
        /// 0: done. Otherwise refused, and `text` says why.
        pub refused: u32,
        /// Always zero.
        pub reserved: u32,
        /// The cycle from which the command holds; 0 if it does not concern the loop.
        pub cycle: u64,
        /// One sentence, UTF-8, zero-filled.
        pub text: [u8; 304],
    }
}

/// What may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum CommandKind {
    /// Learn from held poses from now on.
    IdentifyStart = 1,
    /// Stop learning and monitor with what is known.
    IdentifyStop = 2,
    /// Forget what was learnt; back to the prior.
    IdentifyReset = 3,
    /// Copy the whole memory of the loop to the checkpoint service (recorders start with one).
    Checkpoint = 4,
    /// Save the current subject's profile now.
    SubjectSave = 5,
    /// Load a stored profile by id.
    SubjectLoad = 6,
    /// Take the wrench of the last 0.3 s as zero; the plate must be empty.
    Tare = 7,
    /// The worker cannot hold the suggested pose: ask for another.
    PoseSkip = 8,
    /// Delete a subject by id from the daemon's state; if it is in use, an unknown subject replaces it.
    SubjectForget = 9,
    /// Other settings hold from this cycle on. Not asked for over the bus: the daemon reads its configuration again.
    Reload = 10,
    /// Take the last lift of the shift back: it counts no more.
    UndoLift = 11,
}

impl CommandKind {
    /// All kinds.
    pub const ALL: [CommandKind; 11] = [
        CommandKind::IdentifyStart,
        CommandKind::IdentifyStop,
        CommandKind::IdentifyReset,
        CommandKind::Checkpoint,
        CommandKind::SubjectSave,
        CommandKind::SubjectLoad,
        CommandKind::Tare,
        CommandKind::PoseSkip,
        CommandKind::SubjectForget,
        CommandKind::Reload,
        CommandKind::UndoLift,
    ];

    /// The kind of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<CommandKind> {
        Self::ALL.into_iter().find(|kind| *kind as u32 == number)
    }
}
