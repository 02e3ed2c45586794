//! What can go wrong on the bus, each as one sentence for a person.

use std::path::PathBuf;
use std::time::Duration;

/// What went wrong, where, and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// A station or role name with other characters, or too long.
    #[error("{name:?} is no name for a {what}: use 1 to 32 letters, digits, '-' and '_'")]
    Name {
        /// "station" or "role".
        what: &'static str,
        /// What was given.
        name: String,
    },
    /// The root directory cannot be used.
    #[error(
        "cannot keep the bus under {}: set EQUIPOISE_BUS_ROOT to an absolute path of at most {} plain characters",
        root.display(),
        crate::root::ROOT_BYTES_MAX
    )]
    Root {
        /// What was given.
        root: PathBuf,
    },
    /// The process cannot take part in the bus.
    #[error("cannot join the bus under {}: {detail}; the directory must be writable and belong to this user; or set EQUIPOISE_BUS_ROOT to another one", root.display())]
    Join {
        /// The root directory.
        root: PathBuf,
        /// iceoryx2's word for the cause.
        detail: String,
    },
    /// The directory is closed to this user.
    #[error(
        "cannot join the bus under {}: it belongs to another user, and only that user's processes may read or command; \
         run this as that user (sudo -u equipoise …)",
        root.display()
    )]
    NotOurs {
        /// The root directory.
        root: PathBuf,
    },
    /// The service was made with another layout of its messages.
    #[error(
        "cannot open {service}: it was made by another version of Equipoise (schema {theirs}, here {ours}); \
         run the same release in all processes of this station"
    )]
    OtherSchema {
        /// Full name of the service.
        service: String,
        /// The schema it was made with.
        theirs: String,
        /// The schema of this program.
        ours: String,
    },
    /// The service was made with other limits or by another release of iceoryx2.
    #[error(
        "cannot open {service}: it was made with other settings ({detail}); \
         stop all processes of this station and start the same release everywhere"
    )]
    OtherSettings {
        /// Full name of the service.
        service: String,
        /// iceoryx2's word for the difference.
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
    /// All places are taken.
    #[error(
        "cannot join {service}: all its {most} places for a {what} are taken; stop one that is not needed"
    )]
    Full {
        /// Full name of the service.
        service: String,
        /// What was asked for: "publisher", "subscriber", …
        what: &'static str,
        /// How many there may be.
        most: usize,
    },
    /// A subscriber asked for an impossible buffer.
    #[error("cannot buffer {asked} messages of {service}: choose 1 to {most}")]
    Depth {
        /// Full name of the service.
        service: String,
        /// What was asked for.
        asked: usize,
        /// The table's limit.
        most: usize,
    },
    /// Nobody serves commands.
    #[error("nobody answers on {service}: no daemon runs on this station; start `equipoise run`")]
    NoDaemon {
        /// Full name of the service.
        service: String,
    },
    /// A daemon is there but did not answer in time.
    #[error("the daemon did not answer on {service} within {} ms; it may be hung or busy, so ask its status", timeout.as_millis())]
    NoAnswer {
        /// Full name of the service.
        service: String,
        /// How long was waited.
        timeout: Duration,
    },
    /// Anything else that iceoryx2 reports.
    #[error("cannot {what} on {service}: {detail}; if it persists, restart the processes of this station")]
    Failed {
        /// What was tried: "send", "receive", …
        what: &'static str,
        /// Full name of the service.
        service: String,
        /// iceoryx2's word for the cause.
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
