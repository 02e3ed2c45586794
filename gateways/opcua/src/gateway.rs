//! The gateway: each tick updates all nodes, and a watchdog invalidates them if ticks cease.

use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use equipoise_client::NoReading;
use equipoise_files::secret::logins;
use equipoise_gateways::config::OpcUaConfig;
use equipoise_gateways::{Gateway, Latest, Tally};
use opcua::server::ServerHandle;
use opcua::types::{DataValue, NodeId, VariableId, Variant};
use tracing::{error, warn};

use crate::certificates;
use crate::leftovers::{self, Held};
use crate::nodes::{Newest, StationNodeManager, renew};
use crate::server::Server;
use crate::users::Users;
use crate::values::{Clocks, of_latest, of_no_reading};

/// Missed ticks after which values are withdrawn, but not before [`SILENCE_MIN`].
const TICKS_MISSED_MAX: f64 = 5.0;
const SILENCE_MIN: Duration = Duration::from_millis(250);
/// Interval of the watchdog.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often the leftovers of disconnected clients are counted.
const COUNT_EVERY: Duration = Duration::from_secs(2);
/// How often rejected certificates are cleaned up.
const CLEAR_EVERY: Duration = Duration::from_secs(10);
/// Time for clients to receive the shutdown notification.
const FAREWELL: Duration = Duration::from_secs(2);
/// `ServiceLevel` of a server with values and of one without (OPC UA Part 4, 6.6.2).
const SERVICE_LEVELS: [u8; 2] = [255, 1];

/// The OPC UA server of a station.
pub struct OpcUa {
    board: Arc<Board>,
    server: Server,
    /// Disconnected once the server's thread has ended.
    ended: Receiver<Infallible>,
    ticks: u64,
}

/// The nodes, shared by the publishing loop and the watchdog.
struct Board {
    handle: ServerHandle,
    node_manager: Arc<StationNodeManager>,
    nodes: Vec<NodeId>,
    published: Mutex<Published>,
}

/// What the nodes show.
struct Published {
    /// When the nodes were last set by a tick.
    at: Instant,
    /// Whether any state was available since the server started.
    ever: bool,
    /// Whether nodes have values now.
    has_values: bool,
    /// How often the watchdog withdrew values.
    withdrawn: u64,
    /// Monitored items in the library at the last tick.
    items: usize,
    /// One per node.
    newest: Vec<Newest>,
}

impl OpcUa {
    /// Starts a server at the configured address; no node has a value before the first tick. `on_end` is called if the
    /// server ends by itself.
    ///
    /// # Errors
    /// Users, certificates or address cannot be used; worded for the author of the configuration.
    pub fn new(
        station: &str,
        config: &OpcUaConfig,
        on_end: impl FnOnce(String) + Send + 'static,
    ) -> anyhow::Result<OpcUa> {
        let known = config.users_file.as_deref().map(logins).transpose()?.unwrap_or_default();
        let users = Users::new(known, config.lets_anonymous_read());
        let pki = config.pki.clone().map_or_else(certificates::usual_folder, Ok)?;
        let mut server = Server::new(station, config, &pki, users)?;
        let newest = vec![Newest::default(); server.nodes.len()];
        let published =
            Published { at: Instant::now(), ever: false, has_values: false, withdrawn: 0, items: 0, newest };
        let board = Arc::new(Board {
            handle: server.handle.clone(),
            node_manager: Arc::clone(&server.node_manager),
            nodes: server.nodes.clone(),
            published: Mutex::new(published),
        });
        // The library's initial level is that of a server with values, so set that of one without.
        board.handle.set_service_level(SERVICE_LEVELS[1]);
        board.show(&Err(NoReading::Silent { silent: Duration::ZERO }));
        let silence_max = Duration::from_secs_f64(TICKS_MISSED_MAX / config.rate_hz).max(SILENCE_MIN);
        let ended = server.serve(watch(Arc::clone(&board), silence_max, pki), on_end)?;
        Ok(OpcUa { board, server, ended, ticks: 0 })
    }

    /// Address of the listening socket.
    pub fn address(&self) -> std::net::SocketAddr {
        self.server.address
    }
}

impl Gateway for OpcUa {
    fn send(&mut self, latest: &Latest) {
        self.ticks += 1;
        self.board.show(latest);
    }

    /// `sent`: ticks that updated the nodes. `lost`: intervals without ticks so long that values were withdrawn.
    fn tally(&self) -> Tally {
        let count = VariableId::Server_ServerDiagnostics_ServerDiagnosticsSummary_CurrentSessionCount;
        let peers = match self.server.handle.info().diagnostics.get(count).and_then(|count| count.value) {
            Some(Variant::UInt32(count)) => u64::from(count),
            _ => 0,
        };
        Tally { sent: self.ticks, lost: self.board.published().withdrawn, peers }
    }
}

impl Drop for OpcUa {
    /// Notifies clients of the shutdown, but waits at most 2 s for them.
    fn drop(&mut self) {
        self.server.handle.cancel();
        let _ = self.ended.recv_timeout(FAREWELL);
    }
}

impl Board {
    fn published(&self) -> std::sync::MutexGuard<'_, Published> {
        self.published.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show(&self, latest: &Latest) {
        let mut published = self.published();
        published.ever |= latest.is_ok();
        published.at = Instant::now();
        let values = of_latest(latest, published.ever, Clocks::now());
        self.put(&mut published, values, latest.is_ok());
    }

    /// The caller holds the lock, so that the watchdog cannot overtake a tick.
    fn put(&self, published: &mut Published, values: Vec<DataValue>, has_values: bool) {
        let renewed = renew(
            &self.node_manager,
            self.handle.subscriptions(),
            &self.nodes,
            &mut published.newest,
            values,
        );
        match renewed {
            Ok(items) => published.items = items,
            Err(code) => error!("nodes cannot be renewed: {code}"),
        }
        if published.has_values != has_values {
            published.has_values = has_values;
            self.handle.set_service_level(SERVICE_LEVELS[usize::from(!has_values)]);
        }
    }

    /// Withdraws all values if ticks have ceased for too long. Repeated at every check, so that clients that subscribed
    /// during the withdrawal are notified, too.
    fn withdraw_if_silent(&self, silence_max: Duration) {
        let mut published = self.published();
        let silent = published.at.elapsed();
        if silent <= silence_max {
            return;
        }
        if published.has_values {
            published.withdrawn += 1;
            warn!("no tick for {} ms: values are withdrawn", silent.as_millis());
        }
        let values = of_no_reading(&NoReading::Silent { silent }, published.ever, Clocks::now());
        self.put(&mut published, values, false);
    }

    /// The reason why the server must end, if clients have left too many resources behind.
    fn left_behind(&self) -> Option<String> {
        let held = Held {
            subscriptions: leftovers::subscriptions_held(&self.handle),
            items: self.published().items,
        };
        held.too_much(leftovers::living(
            self.handle.subscriptions(),
            &mut self.node_manager.inner().sessions(),
        ))
    }
}

/// Runs the watchdog until the server must end; returns the reason.
async fn watch(board: Arc<Board>, silence_max: Duration, pki: std::path::PathBuf) -> String {
    let (mut cleared, mut counted) = (Instant::now(), Instant::now());
    loop {
        tokio::time::sleep(LOOK_EVERY).await;
        board.withdraw_if_silent(silence_max);
        if counted.elapsed() >= COUNT_EVERY {
            counted = Instant::now();
            if let Some(why) = board.left_behind() {
                return why;
            }
        }
        if cleared.elapsed() >= CLEAR_EVERY {
            cleared = Instant::now();
            certificates::remove_old_rejected(&pki);
        }
    }
}
