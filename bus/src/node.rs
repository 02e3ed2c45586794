//! Joining a station's bus as a node.

use crate::command::{CommandClient, CommandServer, HandoverClient, HandoverServer};
use crate::empty_memory;
use crate::error::BusError;
use crate::event::{Channel, Listener, Notifier};
use crate::half_made;
use crate::orphaned_connections;
use crate::publisher::{Publisher, RetainedService};
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

/// Which station to join, and as what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusSettings {
    /// The station: 1 to 32 letters, digits, '-', '_'.
    pub station: String,
    /// Role of this thread or process on the bus, for example `egress`; same characters.
    pub role: String,
    /// Directory of the bus's files, on a local file system. Each root is a separate bus.
    pub root: PathBuf,
}

impl BusSettings {
    /// Settings with the root of the environment ([`root::root_of_environment`]).
    pub fn new(station: &str, role: &str) -> BusSettings {
        BusSettings { station: station.to_owned(), role: role.to_owned(), root: root::root_of_environment() }
    }
}

/// A live participant of a station's bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Participant {
    /// Its role name.
    pub role: String,
    /// Its process id.
    pub process_id: u32,
}

/// A node on a station's bus; creates ports. Belongs to the thread that joined.
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
    /// Joins a station. Does not remove the remains of dead participants: see [`Bus::clean_up_dead_nodes`].
    ///
    /// Signal handling is left to the caller: iceoryx2 installs no handler.
    ///
    /// # Errors
    /// An invalid name or root, or a root that belongs to another user.
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
        // iceoryx2's warnings are dumps of its internal state, for example when a peer disconnects while it is being
        // connected.
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

    /// Removes the remains of killed participants; returns their number.
    ///
    /// Frees their ports, and their peers drop the connections. Takes 0.15 ms, plus 1.5 ms per dead participant: a
    /// long-lived process calls it once per second, never from a thread with real-time deadlines.
    pub fn clean_up_dead_nodes(&self) -> usize {
        self.clear_away_the_dead().0
    }

    /// Returns the number of dead nodes removed, and the number left for the next call.
    pub(crate) fn clear_away_the_dead(&self) -> (usize, usize) {
        let prefix = self.config().global.prefix.to_string();
        let memory = Path::new(empty_memory::DIRECTORY);
        empty_memory::remove(memory, &prefix);
        let (mut cleaned, mut left) = (0, 0);
        // If the list cannot be read, the next call tries again.
        let _ = Node::<ipc::Service>::list(self.config(), |state| {
            if let NodeState::Dead(dead) = state {
                // A dead node creates no more memory, so the result stays valid while it is removed.
                if empty_memory::is_there(memory, &prefix) {
                    left += 1;
                    return CallbackProgression::Continue;
                }
                // A node killed while it joined or left has lost its details. iceoryx2 then searches for its files
                // under the default root and counts it as removed each time, so the details are supplied here.
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
        // The default root is shared with other programs that use iceoryx2, whose files may differ.
        let shared = self.root == Path::new(root::DEFAULT_ROOT);
        if shared {
            return (cleaned, left);
        }
        let nodes = self.root.join("nodes");
        let half_made = half_made::remove(&nodes, &prefix);
        // If a directory cannot be read, the next call tries again.
        let _ = orphaned_connections::remove(memory, &nodes, &prefix);
        (cleaned + half_made, left)
    }

    /// All live participants of this station, this bus included; several roles of one process are separate entries.
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

    /// Creates a publisher of `M`.
    ///
    /// # Errors
    /// Another version of the message, no free port, or a service that cannot be opened.
    pub fn publisher<M: Topic>(&self) -> Result<Publisher<M>, BusError> {
        M::open_publisher(self)
    }

    /// Creates a subscriber of `M` with a buffer of `depth` messages; 1 for "only the newest".
    ///
    /// # Errors
    /// A depth of 0 or above the table's limit; otherwise as [`Bus::publisher`].
    pub fn subscriber<M: Topic>(&self, depth: usize) -> Result<Subscriber<M>, BusError> {
        M::open_subscriber(self, depth)
    }

    /// Holds the service of `M` open without a port, for a topic that other processes write and read. The service then
    /// exists before the first of them starts, so that none of them can be killed while creating it.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn retain<M: Topic>(&self) -> Result<RetainedService<M>, BusError> {
        M::open_retained(self)
    }

    /// Creates a notifier that wakes the listeners of a channel.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn notifier(&self, channel: Channel) -> Result<Notifier, BusError> {
        Notifier::open(self, channel)
    }

    /// Creates a listener that blocks until a channel is notified.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn listener(&self, channel: Channel) -> Result<Listener, BusError> {
        Listener::open(self, channel)
    }

    /// Creates a client for commands to the station's daemon.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn command_client(&self) -> Result<CommandClient, BusError> {
        CommandClient::open(self)
    }

    /// Creates the command server: one per station.
    ///
    /// # Errors
    /// [`BusError::Full`] if a daemon already serves the station; otherwise as [`Bus::publisher`].
    pub fn command_server(&self) -> Result<CommandServer, BusError> {
        CommandServer::open(self)
    }

    /// Creates a client for plans of handovers by the station's daemon.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn handover_client(&self) -> Result<HandoverClient, BusError> {
        HandoverClient::open(self)
    }

    /// Creates the server of plans of handovers: one per station.
    ///
    /// # Errors
    /// As [`Bus::command_server`].
    pub fn handover_server(&self) -> Result<HandoverServer, BusError> {
        HandoverServer::open(self)
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
