//! Why a recording cannot be read, and the remedy.

use std::path::PathBuf;

use thiserror::Error;

use super::header::FORMAT;

/// Why a recording could not be read.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The file could not be read.
    #[error("cannot read the recording {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// It is not an MCAP file.
    #[error(
        "not a recording: it begins with {found}; give an .mcap file that `equipoise record` or `import` wrote"
    )]
    NotMcap {
        /// Its first bytes.
        found: String,
    },
    /// An MCAP file of another program.
    #[error(
        "an MCAP file, but not of Equipoise: it holds {found}; give one that `equipoise record` or `import` wrote"
    )]
    Foreign {
        /// Topics found.
        found: String,
    },
    /// Its layout is of a later release.
    #[error(
        "the recording has layout {found}, this release reads layout {FORMAT}; use the release that wrote it ({software_version})"
    )]
    LaterFormat {
        /// The layout's version as found.
        found: u32,
        /// The release that wrote it.
        software_version: String,
    },
    /// A topic holds another version of its message.
    #[error(
        "topic {topic} holds {found}, this release reads {expected}; use the release that wrote the recording"
    )]
    OtherType {
        /// The topic.
        topic: String,
        /// The type found.
        found: String,
        /// The type this release reads.
        expected: &'static str,
    },
    /// A message of the same name with different fields.
    #[error(
        "topic {topic} holds {type_name} with other fields than this release's (schema {found}, not {expected}); use the release that wrote the recording"
    )]
    OtherFields {
        /// The topic.
        topic: String,
        /// The type's name.
        type_name: &'static str,
        /// Schema hash found.
        found: String,
        /// Schema hash of this release.
        expected: String,
    },
    /// Some messages contain impossible numbers.
    #[error(
        "{count} messages hold numbers that are not finite or cannot be (the first at byte {at_byte}); they are left out"
    )]
    Impossible {
        /// Count of messages.
        count: u64,
        /// Position of the record that contains the first one.
        at_byte: usize,
    },
    /// The file's structure is intact, but its contents are invalid.
    #[error("the recording is damaged at byte {at_byte}: {reason}; what stands before is sound")]
    Damaged {
        /// Position of the invalid record.
        at_byte: usize,
        /// The reason.
        reason: String,
    },
}
