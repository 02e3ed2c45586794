//! Recordings: MCAP files with the bus messages, byte for byte.
//!
//! A message is packed little-endian without padding, so its bytes are the ROS 1 serialization of a message of
//! fixed-size arrays. A recording therefore declares `ros1` / `ros1msg` with a schema generated from `Message::FIELDS`:
//! Foxglove, Lichtblick and the `mcap` tools read it without a plugin, and Equipoise reads the same bytes back into the
//! same struct.
//!
//! Times in a recording are CLOCK_MONOTONIC ns of the recording machine; the header contains the wall-clock time of the
//! start. A recording contains no names of host or person.
//!
//! Layers, lowest first: [`topic`] → [`header`] → [`error`] → `channels`, `frame`, `hashed_file` → [`writer`],
//! [`reader`]

mod channels;
pub mod error;
mod frame;
mod hashed_file;
pub mod header;
pub mod reader;
mod store;
pub mod topic;
pub mod writer;

pub use error::ReadError;
pub use hashed_file::HashedFile;
pub use header::{Predecessor, RecordingHeader, Reloaded, pseudonym};
pub use reader::{Entries, Recording};
pub use topic::{Entry, Recorded, TimedEntry};
pub use writer::{ExtraChannel, Recorder, WriteError};
