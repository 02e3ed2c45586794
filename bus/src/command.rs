//! Requests to the daemon and its responses: commands, and plans of handovers.

use equipoise_core::message::{Command, HandoverPlan, HandoverRequest, Message, Reply};

use crate::error::BusError;
use crate::event::{Channel, Event, Notifier};
use crate::node::Bus;
use crate::open::{PortLimit, create_port, open_or_create};
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

/// A request, its response and their service.
pub trait Request: Message {
    /// The response.
    type Response: Message;
    /// Last part of the service's name.
    const SUFFIX: &'static str;
    /// Event that announces a request; `None` if the server polls.
    const EVENT: Option<Event>;

    /// Schema that client and server must share: the hashes of the fields of request and response.
    fn schema() -> String
    where
        Self: Sized,
    {
        format!("0x{:016x}+0x{:016x}", Self::SCHEMA_HASH, Self::Response::SCHEMA_HASH)
    }
}

impl Request for Command {
    type Response = Reply;
    const SUFFIX: &'static str = "command";
    const EVENT: Option<Event> = Some(Event::CommandArrived);
}

impl Request for HandoverRequest {
    type Response = HandoverPlan;
    const SUFFIX: &'static str = "handover";
    const EVENT: Option<Event> = None;
}

/// Sends commands to the daemon.
pub type CommandClient = RequestClient<Command>;
/// Replies to the commands of a station.
pub type CommandServer = RequestServer<Command>;
/// Requests plans of handovers from the daemon.
pub type HandoverClient = RequestClient<HandoverRequest>;
/// Plans the handovers of a station.
pub type HandoverServer = RequestServer<HandoverRequest>;

/// Polling interval of a client that waits for a reply.
const LOOK_EVERY: Duration = Duration::from_millis(1);

/// Settings of all request–response services; the first process that opens a service sets them.
#[derive(Debug, Clone, Copy)]
pub struct RequestSettings {
    /// Whether a new request replaces the oldest of a full queue.
    pub overflow_requests: bool,
    /// Whether a new response replaces the oldest of a full queue.
    pub overflow_responses: bool,
    /// Whether the server executes a request whose client has timed out; never, because the client has reported a failure.
    pub fire_and_forget: bool,
    /// Requests of one client that may be in flight: the current one, and timed-out ones that the daemon has not
    /// received yet.
    pub active_requests_max: usize,
    /// Requests of one client that are written at the same time.
    pub loaned_requests_max: usize,
    /// Queue length of the responses to a request.
    pub responses_max: usize,
    /// Responses to a request that a client reads at the same time.
    pub borrowed_responses_max: usize,
    /// Number of servers.
    pub servers_max: usize,
    /// Number of clients.
    pub clients_max: usize,
}

/// The settings of all request–response services.
pub const REQUEST_SETTINGS: RequestSettings = RequestSettings {
    overflow_requests: true,
    overflow_responses: true,
    fire_and_forget: false,
    active_requests_max: 4,
    loaned_requests_max: 1,
    responses_max: 1,
    borrowed_responses_max: 1,
    servers_max: 1,
    clients_max: CLIENTS_MAX,
};

type Factory<Q> = PortFactory<ipc::Service, Q, (), <Q as Request>::Response, ()>;

fn open_service<Q: Request>(bus: &Bus) -> Result<(String, Factory<Q>), BusError> {
    let name = full_name(&bus.station, Q::SUFFIX);
    let settings = REQUEST_SETTINGS;
    let factory =
        open_or_create(bus, &name, MessagingPattern::RequestResponse, &Q::schema(), |name, attributes| {
            bus.node
                .service_builder(name)
                .request_response::<Q, Q::Response>()
                .enable_safe_overflow_for_requests(settings.overflow_requests)
                .enable_safe_overflow_for_responses(settings.overflow_responses)
                .enable_fire_and_forget_requests(settings.fire_and_forget)
                .max_active_requests_per_client(settings.active_requests_max)
                .max_loaned_requests(settings.loaned_requests_max)
                .max_response_buffer_size(settings.responses_max)
                .max_borrowed_responses_per_pending_response(settings.borrowed_responses_max)
                .max_servers(settings.servers_max)
                .max_clients(settings.clients_max)
                .max_nodes(NODES_MAX)
                .open_or_create_with_attributes(attributes)
        })?;
    Ok((name, factory))
}

/// Sends requests to the daemon of a station.
pub struct RequestClient<Q: Request> {
    port: Client<ipc::Service, Q, (), Q::Response, ()>,
    notifier: Option<(Notifier, Event)>,
    name: String,
}

impl<Q: Request> fmt::Debug for RequestClient<Q> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RequestClient({})", self.name)
    }
}

impl<Q: Request> RequestClient<Q> {
    pub(crate) fn open(bus: &Bus) -> Result<RequestClient<Q>, BusError> {
        let (name, factory) = open_service::<Q>(bus)?;
        let notifier = match Q::EVENT {
            Some(event) => Some((Notifier::open(bus, Channel::Inputs)?, event)),
            None => None,
        };
        let limit = PortLimit { what: "client", most: REQUEST_SETTINGS.clients_max };
        let port = create_port(bus, &name, limit, ClientCreateError::ExceedsMaxSupportedClients, || {
            factory.client_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create()
        })?;
        Ok(RequestClient { port, notifier, name })
    }

    /// Sends `request`, wakes the daemon if the request has an event, and waits for its response.
    ///
    /// # Errors
    /// [`BusError::NoDaemon`] if no daemon serves the station, [`BusError::NoAnswer`] after `timeout`: a request that
    /// the daemon has not started by then is not executed.
    pub fn ask(&self, request: &Q, timeout: Duration) -> Result<Q::Response, BusError> {
        self.ask_until(request, |waited| waited >= timeout)
    }

    /// As [`Self::ask`], but waits until `is_over`, which receives the time since the request.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn ask_until(
        &self,
        request: &Q,
        is_over: impl Fn(Duration) -> bool,
    ) -> Result<Q::Response, BusError> {
        let asked = Instant::now();
        let pending = self.port.send_copy(*request).map_err(BusError::failed("ask", &self.name))?;
        if pending.number_of_server_connections() == 0 {
            return Err(BusError::NoDaemon { service: self.name.clone() });
        }
        if let Some((notifier, event)) = &self.notifier {
            notifier.notify(*event)?;
        }
        loop {
            let answer = pending.receive().map_err(BusError::failed("read the answer", &self.name))?;
            if let Some(response) = answer {
                return Ok(*response.payload());
            }
            let waited = asked.elapsed();
            if is_over(waited) {
                return Err(BusError::NoAnswer { service: self.name.clone(), timeout: waited });
            }
            thread::sleep(LOOK_EVERY);
        }
    }
}

/// Responds to the requests of a station. One per station, so opening a second one reports that a daemon already runs.
pub struct RequestServer<Q: Request> {
    port: Server<ipc::Service, Q, (), Q::Response, ()>,
    name: String,
}

impl<Q: Request> fmt::Debug for RequestServer<Q> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RequestServer({})", self.name)
    }
}

impl<Q: Request> RequestServer<Q> {
    pub(crate) fn open(bus: &Bus) -> Result<RequestServer<Q>, BusError> {
        let (name, factory) = open_service::<Q>(bus)?;
        let limit = PortLimit { what: "daemon", most: REQUEST_SETTINGS.servers_max };
        let port = create_port(bus, &name, limit, ServerCreateError::ExceedsMaxSupportedServers, || {
            factory
                .server_builder()
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .max_loaned_responses_per_request(1)
                .create()
        })?;
        Ok(RequestServer { port, name })
    }

    /// Responds to one pending request; returns whether there was one. Call it until it returns `false`.
    ///
    /// A client that has disconnected is not an error: its response is dropped.
    ///
    /// # Errors
    /// The connection to a client is damaged, or the response cannot be sent.
    pub fn poll(&mut self, answer: impl FnOnce(&Q) -> Q::Response) -> Result<bool, BusError> {
        let mut answer = Some(answer);
        self.poll_next(&mut |request| answer.take().map(|answer| answer(request)))
    }

    /// Not generic over `answer`, so that it is compiled once for each request.
    fn poll_next(&mut self, answer: &mut dyn FnMut(&Q) -> Option<Q::Response>) -> Result<bool, BusError> {
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
