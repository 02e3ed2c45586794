//! Errors of the bus, each displayed as one sentence for the user.

use std::path::PathBuf;
use std::time::Duration;

/// What failed, where, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// A station or role name with invalid characters, or too long.
    #[error("{name:?} is no name for a {what}: use 1 to 32 letters, digits, '-' and '_'")]
    Name {
        /// "station" or "role".
        what: &'static str,
        /// The name given.
        name: String,
    },
    /// The root directory cannot be used.
    #[error(
        "cannot keep the bus under {}: set EQUIPOISE_BUS_ROOT to an absolute path of at most {} plain characters",
        root.display(),
        crate::root::ROOT_BYTES_MAX
    )]
    Root {
        /// The directory given.
        root: PathBuf,
    },
    /// The process cannot join the bus.
    #[error("cannot join the bus under {}: {detail}; the directory must be writable and belong to this user; or set EQUIPOISE_BUS_ROOT to another one", root.display())]
    Join {
        /// The root directory.
        root: PathBuf,
        /// Cause reported by iceoryx2.
        detail: String,
    },
    /// This user has no access to the directory.
    #[error(
        "cannot join the bus under {}: it belongs to another user, and only that user's processes may read or command; \
         run this as that user (sudo -u equipoise …)",
        root.display()
    )]
    NotOurs {
        /// The root directory.
        root: PathBuf,
    },
    /// The service was created with another layout of its messages.
    #[error(
        "cannot open {service}: it was made by another version of Equipoise (schema {theirs}, here {ours}); \
         run the same release in all processes of this station"
    )]
    OtherSchema {
        /// Full name of the service.
        service: String,
        /// Schema of the existing service.
        theirs: String,
        /// Schema of this program.
        ours: String,
    },
    /// The service was created with other limits or by another release of iceoryx2.
    #[error(
        "cannot open {service}: it was made with other settings ({detail}); \
         stop all processes of this station and start the same release everywhere"
    )]
    OtherSettings {
        /// Full name of the service.
        service: String,
        /// Difference reported by iceoryx2.
        detail: String,
    },
    /// The service belongs to another user.
    #[error(
        "cannot open {service}: it belongs to another user; run all processes of this station as one user"
    )]
    Permission {
        /// Full name of the service.
        service: String,
    },
    /// The files of the service are damaged.
    #[error(
        "cannot open {service}: its files are damaged; stop all processes of this station and remove the directory {}",
        root.display()
    )]
    Damaged {
        /// Full name of the service.
        service: String,
        /// The root directory.
        root: PathBuf,
    },
    /// No port is free.
    #[error(
        "cannot join {service}: all its {most} places for a {what} are taken; stop one that is not needed"
    )]
    Full {
        /// Full name of the service.
        service: String,
        /// Kind of the port: "publisher", "subscriber", …
        what: &'static str,
        /// Maximum number of such ports.
        most: usize,
    },
    /// A subscriber requested an invalid buffer size.
    #[error("cannot buffer {asked} messages of {service}: choose 1 to {most}")]
    Depth {
        /// Full name of the service.
        service: String,
        /// The size requested.
        asked: usize,
        /// The maximum of the service table.
        most: usize,
    },
    /// No process serves commands.
    #[error("no answer on {service}: no daemon runs on this station; start `equipoise run`")]
    NoDaemon {
        /// Full name of the service.
        service: String,
    },
    /// A daemon runs but did not reply in time.
    #[error("the daemon did not answer on {service} within {} ms; it may be hung or busy, so ask its status", timeout.as_millis())]
    NoAnswer {
        /// Full name of the service.
        service: String,
        /// Time waited.
        timeout: Duration,
    },
    /// Any other error that iceoryx2 reports.
    #[error("cannot {what} on {service}: {detail}; if it persists, restart the processes of this station")]
    Failed {
        /// Operation that failed: "send", "receive", …
        what: &'static str,
        /// Full name of the service.
        service: String,
        /// Cause reported by iceoryx2.
        detail: String,
    },
}

impl BusError {
    /// `map_err` for the operation `what` on `service`.
    pub(crate) fn failed<E: std::fmt::Debug>(
        what: &'static str,
        service: &str,
    ) -> impl FnOnce(E) -> BusError {
        move |cause| BusError::Failed { what, service: service.to_owned(), detail: format!("{cause:?}") }
    }
}
