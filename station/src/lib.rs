//! What the processes of a station find of each other without the bus: the daemon's status file and the page's address,
//! faults of adapters, the state directory, the bus directory, and the kernel's data of processes and threads; and what
//! all its programs do alike.
#![forbid(unsafe_code)]

pub mod adapter_fault;
pub mod bus_directory;
pub mod proc;
pub mod process;
pub mod process_state;
pub mod state_directory;
pub mod status;

/// Replaces a subject's pseudonym in flight records, and that of a deleted subject in recordings.
pub const ANONYMOUS: &str = "anonymous";

/// Role of the daemon on the bus.
pub const DAEMON_ROLE: &str = "daemon";
