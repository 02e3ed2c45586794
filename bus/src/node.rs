//! Taking part in a station's bus.

use crate::command::{CommandClient, CommandServer};
use crate::empty_memory;
use crate::error::BusError;
use crate::event::{Channel, Listener, Notifier};
use crate::half_made;
use crate::publisher::{Kept, Publisher};
use crate::root;
use crate::service::Topic;
use crate::subscriber::Subscriber;
use iceoryx2::node::{DeadNodeView, NodeDetails, NodeView};
use iceoryx2::prelude::{
    CallbackProgression, Config, LogLevel, Node, NodeBuilder, NodeName, NodeState, SignalHandlingMode, ipc,
    set_log_level,
};
use std::fmt;
use std::path::{Path, PathBuf};

/// Who joins which station.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusSettings {
    /// The station: 1 to 32 letters, digits, '-', '_'.
    pub station: String,
    /// What this thread or process is on the bus, for example `egress`; same characters.
    pub role: String,
    /// Directory of the bus's files, on a local file system. Another root is another bus.
    pub root: PathBuf,
}

impl BusSettings {
    /// Settings with the root that the environment asks for ([`root::root_of_environment`]).
    pub fn new(station: &str, role: &str) -> BusSettings {
        BusSettings { station: station.to_owned(), role: role.to_owned(), root: root::root_of_environment() }
    }
}

/// A living participant of a station's bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Participant {
    /// Its role name.
    pub role: String,
    /// Its process.
    pub process_id: u32,
}

/// A place on a station's bus; makes ports. Belongs to the thread that joined.
pub struct Bus {
    pub(crate) node: Node<ipc::Service>,
    pub(crate) station: String,
    pub(crate) root: PathBuf,
}

impl fmt::Debug for Bus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bus({} under {})", self.node.name().as_str(), self.root.display())
    }
}

impl Bus {
    /// Joins a station. What dead participants left behind stays: see [`Bus::clean_up_dead_nodes`].
    ///
    /// Signals stay the caller's: iceoryx2 installs no handler.
    ///
    /// # Errors
    /// A name or root that cannot be used, or a root that belongs to another user.
    pub fn join(settings: &BusSettings) -> Result<Bus, BusError> {
        let BusSettings { station, role, root } = settings;
        check_name("station", station)?;
        check_name("role", role)?;
        let config = root::config(root)?;
        let failed = |detail: String| match std::fs::metadata(root) {
            Err(why) if why.kind() == std::io::ErrorKind::PermissionDenied => {
                BusError::NotOurs { root: root.clone() }
            }
            _ => BusError::Join { root: root.clone(), detail },
        };
        let name = NodeName::new(&node_name(station, role)).map_err(|cause| failed(format!("{cause:?}")))?;
        // Its warnings are dumps of its own insides, for example whenever a peer leaves while it is being connected.
        set_log_level(LogLevel::Error);
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create()
            .map_err(|cause| failed(format!("{cause:?}")))?;
        root::close_counters_to_others(root);
        Ok(Bus { node, station: station.clone(), root: root.clone() })
    }

    /// The station's name.
    pub fn station(&self) -> &str {
        &self.station
    }

    /// Removes what killed participants left behind; how many there were.
    ///
    /// Their places become free and their peers forget them. Takes 0.15 ms, 1.5 ms for each dead one: a long-lived
    /// process calls it once a second, never from a thread that keeps time.
    pub fn clean_up_dead_nodes(&self) -> usize {
        self.clear_away_the_dead().0
    }

    /// How many dead were cleared away, and how many must wait for the next call.
    pub(crate) fn clear_away_the_dead(&self) -> (usize, usize) {
        let prefix = self.config().global.prefix.to_string();
        let memory = Path::new(empty_memory::DIRECTORY);
        empty_memory::remove(memory, &prefix);
        let (mut cleaned, mut left) = (0, 0);
        // A list that cannot be read now is read by the next call.
        let _ = Node::<ipc::Service>::list(self.config(), |state| {
            if let NodeState::Dead(dead) = state {
                // All that is this one's is there already: it makes no more of it.
                if empty_memory::is_there(memory, &prefix) {
                    left += 1;
                    return CallbackProgression::Continue;
                }
                // One that was killed while it came or went has lost its details. iceoryx2 then looks for its files
                // under the default root and counts it as cleaned each time: so it is told where they are.
                let outcome = match dead.details() {
                    Some(_) => dead.try_remove_stale_resources(),
                    None => {
                        let details = NodeDetails::__internal_new(&None, self.config());
                        DeadNodeView::<ipc::Service>::__internal_try_remove_stale_resources(
                            *dead.id(),
                            details,
                        )
                    }
                };
                match outcome {
                    Ok(()) => cleaned += 1,
                    Err(_) => left += 1,
                }
            }
            CallbackProgression::Continue
        });
        // The default root is shared with whatever else speaks iceoryx2, whose files may look otherwise.
        let shared = self.root == Path::new(root::DEFAULT_ROOT);
        let half_made = if shared { 0 } else { half_made::remove(&self.root.join("nodes"), &prefix) };
        (cleaned + half_made, left)
    }

    /// Everybody alive on this station, this bus included; roles of one process are told apart.
    ///
    /// # Errors
    /// The bus's files cannot be read.
    pub fn participants(&self) -> Result<Vec<Participant>, BusError> {
        let mut participants = Vec::new();
        let prefix = node_name(&self.station, "");
        Node::<ipc::Service>::list(self.config(), |state| {
            if let NodeState::Alive(view) = &state
                && let Some(details) = view.details()
                && let Some(role) = details.name().as_str().strip_prefix(&prefix)
            {
                let process_id = details.process_id().value() as u32;
                participants.push(Participant { role: role.to_owned(), process_id });
            }
            CallbackProgression::Continue
        })
        .map_err(BusError::failed("list the participants", &prefix))?;
        Ok(participants)
    }

    /// A writer of `M`.
    ///
    /// # Errors
    /// Another version of the message, all places taken, or a service that cannot be opened.
    pub fn publisher<M: Topic>(&self) -> Result<Publisher<M>, BusError> {
        Publisher::open(self)
    }

    /// A reader of `M` with a buffer of `depth` messages; 1 for "only the newest".
    ///
    /// # Errors
    /// A depth of 0 or above the table's limit; otherwise as [`Bus::publisher`].
    pub fn subscriber<M: Topic>(&self, depth: usize) -> Result<Subscriber<M>, BusError> {
        Subscriber::open(self, depth)
    }

    /// The service of `M` itself, without a place in it: for a topic that others write and read. It is there then before
    /// the first of them, and none of them can be killed while it makes it.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn keep<M: Topic>(&self) -> Result<Kept<M>, BusError> {
        Kept::open(self)
    }

    /// Something that wakes the listeners of a channel.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn notifier(&self, channel: Channel) -> Result<Notifier, BusError> {
        Notifier::open(self, channel)
    }

    /// Something that sleeps until a channel is notified.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn listener(&self, channel: Channel) -> Result<Listener, BusError> {
        Listener::open(self, channel)
    }

    /// Asks the station's daemon.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn command_client(&self) -> Result<CommandClient, BusError> {
        CommandClient::open(self)
    }

    /// Answers commands: one per station.
    ///
    /// # Errors
    /// [`BusError::Full`] where a daemon already serves the station; otherwise as [`Bus::publisher`].
    pub fn command_server(&self) -> Result<CommandServer, BusError> {
        CommandServer::open(self)
    }

    pub(crate) fn config(&self) -> &Config {
        self.node.config()
    }
}

fn node_name(station: &str, role: &str) -> String {
    format!("equipoise/{station}/{role}")
}

fn check_name(what: &'static str, name: &str) -> Result<(), BusError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if (1..=32).contains(&name.len()) && name.chars().all(plain) {
        return Ok(());
    }
    Err(BusError::Name { what, name: name.to_owned() })
}
