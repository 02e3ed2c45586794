//! Commands to a running daemon, and replies.

use super::layout::{ZeroCopySend, message};

message! {
    /// A request to the daemon.
    as "equipoise/Command/1", 128 bytes,
    pub struct Command {
        /// A [`CommandKind`].
        pub kind: u32,
        /// Always zero.
        pub reserved: u32,
        /// Arguments; their meaning depends on `kind`.
        pub argument: [f64; 4],
        /// Pseudonym of a subject, UTF-8, padded with zeros; for the `Subject…` kinds.
        pub subject: [u8; 64],
        /// Always zero; pads the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 3],
    }
}

message! {
    /// The answer to a [`Command`].
    as "equipoise/Reply/1", 320 bytes,
    pub struct Reply {
        /// 0: done. Otherwise the command was refused, and `text` states the reason.
        pub refused: u32,
        /// Always zero.
        pub reserved: u32,
        /// First cycle with the command's effect; 0 if the command does not concern the loop.
        pub cycle: u64,
        /// One sentence, UTF-8, padded with zeros.
        pub text: [u8; 304],
    }
}

/// What may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Kind of a command.
pub enum CommandKind {
    /// Start the identification with static poses.
    IdentifyStart = 1,
    /// Stop the identification and monitor with the present estimate.
    IdentifyStop = 2,
    /// Reset the identification to the prior.
    IdentifyReset = 3,
    /// Publish a copy of the loop's memory on the checkpoint service; recorders start with one.
    Checkpoint = 4,
    /// Save the active subject's profile.
    SubjectSave = 5,
    /// Load the profile `subject`.
    SubjectLoad = 6,
    /// Subtract the mean wrench of the last 0.3 s from now on; the plate must be empty.
    Tare = 7,
    /// Skip the suggested pose and suggest another one.
    PoseSkip = 8,
    /// Delete a subject from the daemon's state; an active one is replaced by an unknown subject.
    SubjectDelete = 9,
    /// Apply new settings from this cycle on. Not accepted over the bus: the daemon reloads its configuration.
    Reload = 10,
    /// Remove the last lift of the shift from the dose.
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
        CommandKind::SubjectDelete,
        CommandKind::Reload,
        CommandKind::UndoLift,
    ];

    /// Kind with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<CommandKind> {
        Self::ALL.into_iter().find(|kind| *kind as u32 == number)
    }
}
