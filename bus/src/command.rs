//! Command requests to the daemon and its replies.

use equipoise_core::message::{Command, Message, Reply};

use crate::error::BusError;
use crate::event::{Channel, Event, Notifier};
use crate::node::Bus;
use crate::open::{Place, open_or_create, take};
use crate::service::{CLIENTS_MAX, NODES_MAX, full_name};
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::{BackpressureStrategy, MessagingPattern, ipc};
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::request_response::PortFactory;
use iceoryx2::service::port_factory::server::ServerCreateError;
use std::fmt;
use std::thread;
use std::time::{Duration, Instant};

/// Last part of the service's name.
pub const SUFFIX: &str = "command";
/// Polling interval of a client that waits for a reply.
const LOOK_EVERY: Duration = Duration::from_millis(1);
/// Requests of one client that may be in flight: the current one, and timed-out ones that the daemon has not received
/// yet.
const ACTIVE_REQUESTS_MAX: usize = 4;

type Factory = PortFactory<ipc::Service, Command, (), Reply, ()>;

fn open_command(bus: &Bus) -> Result<(String, Factory), BusError> {
    let name = full_name(&bus.station, SUFFIX);
    let schema = format!("0x{:016x}+0x{:016x}", Command::SCHEMA_HASH, Reply::SCHEMA_HASH);
    let factory =
        open_or_create(bus, &name, MessagingPattern::RequestResponse, &schema, |name, attributes| {
            bus.node
                .service_builder(name)
                .request_response::<Command, Reply>()
                .enable_safe_overflow_for_requests(true)
                .enable_safe_overflow_for_responses(true)
                // A request whose client has timed out must not be executed.
                .enable_fire_and_forget_requests(false)
                .max_active_requests_per_client(ACTIVE_REQUESTS_MAX)
                .max_loaned_requests(1)
                .max_response_buffer_size(1)
                .max_borrowed_responses_per_pending_response(1)
                .max_servers(1)
                .max_clients(CLIENTS_MAX)
                .max_nodes(NODES_MAX)
                .open_or_create_with_attributes(attributes)
        })?;
    Ok((name, factory))
}

/// Sends commands to the daemon of a station.
pub struct CommandClient {
    port: Client<ipc::Service, Command, (), Reply, ()>,
    notifier: Notifier,
    name: String,
}

impl fmt::Debug for CommandClient {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CommandClient({})", self.name)
    }
}

impl CommandClient {
    pub(crate) fn open(bus: &Bus) -> Result<CommandClient, BusError> {
        let (name, factory) = open_command(bus)?;
        let notifier = Notifier::open(bus, Channel::Inputs)?;
        let place = Place { what: "client", most: CLIENTS_MAX };
        let port = take(bus, &name, place, ClientCreateError::ExceedsMaxSupportedClients, || {
            factory.client_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create()
        })?;
        Ok(CommandClient { port, notifier, name })
    }

    /// Sends `command`, wakes the daemon and waits for its reply.
    ///
    /// # Errors
    /// [`BusError::NoDaemon`] if no daemon serves the station, [`BusError::NoAnswer`] after `timeout`: a command that
    /// the daemon has not started by then is not executed.
    pub fn ask(&self, command: &Command, timeout: Duration) -> Result<Reply, BusError> {
        let give_up = Instant::now() + timeout;
        let pending = self.port.send_copy(*command).map_err(BusError::failed("ask", &self.name))?;
        if pending.number_of_server_connections() == 0 {
            return Err(BusError::NoDaemon { service: self.name.clone() });
        }
        self.notifier.notify(Event::CommandArrived)?;
        loop {
            let answer = pending.receive().map_err(BusError::failed("read the answer", &self.name))?;
            if let Some(reply) = answer {
                return Ok(*reply.payload());
            }
            if Instant::now() >= give_up {
                return Err(BusError::NoAnswer { service: self.name.clone(), timeout });
            }
            thread::sleep(LOOK_EVERY);
        }
    }
}

/// Replies to the commands of a station. One per station, so opening a second one reports that a daemon already runs.
pub struct CommandServer {
    port: Server<ipc::Service, Command, (), Reply, ()>,
    name: String,
}

impl fmt::Debug for CommandServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CommandServer({})", self.name)
    }
}

impl CommandServer {
    pub(crate) fn open(bus: &Bus) -> Result<CommandServer, BusError> {
        let (name, factory) = open_command(bus)?;
        let place = Place { what: "daemon", most: 1 };
        let port = take(bus, &name, place, ServerCreateError::ExceedsMaxSupportedServers, || {
            factory
                .server_builder()
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .max_loaned_responses_per_request(1)
                .create()
        })?;
        Ok(CommandServer { port, name })
    }

    /// Replies to one pending command; returns whether there was one. Call it until it returns `false`.
    ///
    /// A client that has disconnected is not an error: its reply is dropped.
    ///
    /// # Errors
    /// The connection to a client is damaged, or the reply cannot be sent.
    pub fn poll(&mut self, answer: impl FnOnce(&Command) -> Reply) -> Result<bool, BusError> {
        let mut answer = Some(answer);
        self.poll_next(&mut |command| answer.take().map(|answer| answer(command)))
    }

    /// Not generic, so that it is compiled once, here.
    fn poll_next(&mut self, answer: &mut dyn FnMut(&Command) -> Option<Reply>) -> Result<bool, BusError> {
        let request = self.port.receive().map_err(BusError::failed("receive", &self.name))?;
        let Some(request) = request else { return Ok(false) };
        if request.is_connected()
            && let Some(reply) = answer(request.payload())
        {
            let sent = request.send_copy(reply).map_err(BusError::failed("answer", &self.name));
            if request.is_connected() {
                sent?;
            }
        }
        Ok(true)
    }
}

/// The text of a zero-filled field.
pub fn parse_text(field: &[u8]) -> String {
    let end = field.iter().position(|byte| *byte == 0).unwrap_or(field.len());
    String::from_utf8_lossy(&field[..end]).into_owned()
}
