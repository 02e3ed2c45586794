//! The outlet: every beat the values of all nodes, and a watch that withdraws them when beats stay away.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use equipoise_client::NoReading;
use equipoise_files::secret::logins;
use equipoise_outlets::config::OpcUaConfig;
use equipoise_outlets::{Outlet, Seen, Tally};
use opcua::server::ServerHandle;
use opcua::types::{DataValue, NodeId, VariableId, Variant};
use tracing::{error, warn};

use crate::certificates;
use crate::leftovers::{self, Held};
use crate::nodes::{Keeper, Newest, renew};
use crate::server::Server;
use crate::users::Users;
use crate::values::{Clocks, of_no_reading, of_seen};

/// So many beats may stay away before values are withdrawn, and never less than [`SILENCE_MIN`].
const BEATS_MISSED_MAX: f64 = 5.0;
const SILENCE_MIN: Duration = Duration::from_millis(250);
/// How often the watch looks.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often it is counted what clients have left behind.
const COUNT_EVERY: Duration = Duration::from_secs(2);
/// How often certificates of strangers are cleared away.
const CLEAR_EVERY: Duration = Duration::from_secs(10);
/// How long clients are given to hear that the server ends.
const FAREWELL: Duration = Duration::from_secs(2);
/// `ServiceLevel` of a server with values, and of one without (OPC UA Part 4, 6.6.2).
const SERVICE_LEVELS: [u8; 2] = [255, 1];

/// The OPC UA server of a station.
pub struct OpcUa {
    board: Arc<Board>,
    server: Server,
    thread: JoinHandle<()>,
    beats: u64,
}

/// The nodes, for the beat and for the watch.
struct Board {
    handle: ServerHandle,
    keeper: Arc<Keeper>,
    nodes: Vec<NodeId>,
    told: Mutex<Told>,
}

struct Told {
    at: Instant,
    /// Whether there was a state since the server began.
    ever: bool,
    /// Whether nodes hold values now.
    has_values: bool,
    /// How often the watch had to withdraw them.
    withdrawn: u64,
    /// Monitored items that the library knew at the last beat.
    items: usize,
    /// Of each node.
    newest: Vec<Newest>,
}

impl OpcUa {
    /// A server at the configured address, which serves at once: until the first beat nothing has a value. `on_end` is told
    /// if the server ends by itself.
    ///
    /// # Errors
    /// Users, certificates or address cannot be had; in words for the person who wrote the configuration.
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
        let told =
            Told { at: Instant::now(), ever: false, has_values: false, withdrawn: 0, items: 0, newest };
        let board = Arc::new(Board {
            handle: server.handle.clone(),
            keeper: Arc::clone(&server.keeper),
            nodes: server.nodes.clone(),
            told: Mutex::new(told),
        });
        board.show(&Err(NoReading::Silent { silent: Duration::ZERO }));
        let silence_max = Duration::from_secs_f64(BEATS_MISSED_MAX / config.rate_hz).max(SILENCE_MIN);
        let thread = server.serve(watch(Arc::clone(&board), silence_max, pki), on_end)?;
        Ok(OpcUa { board, server, thread, beats: 0 })
    }

    /// Where it listens.
    pub fn address(&self) -> std::net::SocketAddr {
        self.server.address
    }
}

impl Outlet for OpcUa {
    fn tell(&mut self, seen: &Seen) {
        self.beats += 1;
        self.board.show(seen);
    }

    /// Beats that nodes were renewed at; lost are those that stayed away so long that values were withdrawn.
    fn tally(&self) -> Tally {
        let count = VariableId::Server_ServerDiagnostics_ServerDiagnosticsSummary_CurrentSessionCount;
        let peers = match self.server.handle.info().diagnostics.get(count).and_then(|count| count.value) {
            Some(Variant::UInt32(count)) => u64::from(count),
            _ => 0,
        };
        Tally { sent: self.beats, lost: self.board.told().withdrawn, peers }
    }
}

impl Drop for OpcUa {
    /// Clients are told; those that do not listen are not waited for.
    fn drop(&mut self) {
        self.server.handle.cancel();
        let end = Instant::now() + FAREWELL;
        while !self.thread.is_finished() && Instant::now() < end {
            std::thread::sleep(FAREWELL / 100);
        }
    }
}

impl Board {
    fn told(&self) -> std::sync::MutexGuard<'_, Told> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show(&self, seen: &Seen) {
        let mut told = self.told();
        told.ever |= seen.is_ok();
        told.at = Instant::now();
        let values = of_seen(seen, told.ever, Clocks::now());
        self.put(&mut told, values, seen.is_ok());
    }

    /// The lock is held meanwhile, so that the watch cannot overtake a beat.
    fn put(&self, told: &mut Told, values: Vec<DataValue>, has_values: bool) {
        let renewed = renew(&self.keeper, self.handle.subscriptions(), &self.nodes, &mut told.newest, values);
        match renewed {
            Ok(items) => told.items = items,
            Err(code) => error!("nodes cannot be renewed: {code}"),
        }
        if told.has_values != has_values {
            told.has_values = has_values;
            self.handle.set_service_level(SERVICE_LEVELS[usize::from(!has_values)]);
        }
    }

    /// Takes back what nodes hold if beats have stayed away for too long. It is told at every look: who subscribed while
    /// values were taken back hears of it, too.
    fn withdraw_if_silent(&self, silence_max: Duration) {
        let mut told = self.told();
        let silent = told.at.elapsed();
        if silent <= silence_max {
            return;
        }
        if told.has_values {
            told.withdrawn += 1;
            warn!("no beat for {} ms: values are withdrawn", silent.as_millis());
        }
        let values = of_no_reading(&NoReading::Silent { silent }, told.ever, Clocks::now());
        self.put(&mut told, values, false);
    }

    /// Why the server has to end, if clients have left too much behind.
    fn left_behind(&self) -> Option<String> {
        let held =
            Held { subscriptions: leftovers::subscriptions_held(&self.handle), items: self.told().items };
        held.too_much(leftovers::living(self.handle.subscriptions(), &mut self.keeper.inner().sessions()))
    }
}

/// Watches until the server has to end; why.
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
            certificates::forget_strangers(&pki);
        }
    }
}
