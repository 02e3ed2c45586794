//! The server in its own thread: address, security, limits.

use std::convert::Infallible;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use crossbeam_channel::{Receiver, bounded};
use equipoise_gateways::config::OpcUaConfig;
use opcua::crypto::SecurityPolicy;
use opcua::server::{ServerBuilder, ServerEndpoint, ServerHandle};
use opcua::types::{BuildInfo, MessageSecurityMode, NodeId};
use socket2::{Domain, Protocol, Socket, TcpKeepalive, Type};
use tokio::runtime::Runtime;

use crate::certificates;
use crate::nodes::{StationNodeManager, node_manager_builder};
use crate::space::{NAMESPACE, build};
use crate::users::Users;

/// Time-out of a client that acknowledges nothing or has vanished (TCP user time-out and keep-alive).
const CUT_OFF_AFTER: Duration = Duration::from_secs(10);
/// Length of the kernel's accept queue.
const BACKLOG: i32 = 64;
/// Maximum number of subscriptions per session.
const SUBSCRIPTIONS_MAX: usize = 5;
/// Maximum queue length of a monitored item, for slow clients.
const QUEUE_MAX: usize = 20;
/// Maximum number of publishing intervals without a publish request before a subscription expires.
const LIFETIME_MAX: u32 = 300;

/// Shared parts of the server.
pub struct Server {
    /// The library's server handle.
    pub handle: ServerHandle,
    /// The node manager.
    pub node_manager: Arc<StationNodeManager>,
    /// The nodes, in the order of [`crate::values::rows`].
    pub nodes: Vec<NodeId>,
    /// Address of the listening socket.
    pub address: SocketAddr,
    inner: Option<(Runtime, opcua::server::Server, TcpListener)>,
}

impl Server {
    /// Creates missing certificates, binds the address, and builds the nodes. Connections are not served yet.
    ///
    /// # Errors
    /// The address or the folder cannot be used, or the library rejects the configuration.
    pub fn new(station: &str, config: &OpcUaConfig, pki: &Path, users: Users) -> anyhow::Result<Server> {
        let listener = listen(config.listen)
            .with_context(|| format!("cannot serve at {} (gateways.opcua.listen)", config.listen))?;
        let address = listener.local_addr()?;
        let host = config.host.clone().unwrap_or_else(|| address.ip().to_string());
        let uri = format!("urn:equipoise:{host}:{station}");
        certificates::prepare(pki, &uri, &host)?;
        let builder = builder(station, config, &host, &uri, address.port()).pki_dir(pki);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        // The library starts tasks while it builds the server.
        let within = runtime.enter();
        let (inner, handle) = builder
            .with_node_manager(node_manager_builder())
            .with_authenticator(Arc::new(users))
            .build()
            .map_err(|what| anyhow::anyhow!("the OPC UA server cannot be built: {what}"))?;
        let node_manager = handle.node_managers().get_of_type::<StationNodeManager>();
        let node_manager = node_manager.context("OPC UA node manager not found")?;
        let namespace = handle.get_namespace_index(NAMESPACE).context("OPC UA namespace not found")?;
        let nodes = build(&mut node_manager.address_space().write(), namespace, station);
        drop(within);
        Ok(Server { handle, node_manager, nodes, address, inner: Some((runtime, inner, listener)) })
    }

    /// Serves in a thread of its own until the handle is cancelled; `on_end` is called if the server ends otherwise.
    /// The future `monitor` runs concurrently and ends the server when it returns a reason. The returned channel is
    /// disconnected once the thread has ended.
    ///
    /// # Errors
    /// The thread cannot be started, or the server already runs.
    pub fn serve(
        &mut self,
        monitor: impl Future<Output = String> + Send + 'static,
        on_end: impl FnOnce(String) + Send + 'static,
    ) -> anyhow::Result<Receiver<Infallible>> {
        let (runtime, inner, listener) = self.inner.take().context("it serves already")?;
        let (running, ended) = bounded(0);
        let serve = move || {
            // Dropped in reverse order: the end is visible once the runtime has closed its sockets.
            let (_running, runtime) = (running, runtime);
            let outcome = runtime.block_on(async {
                let listener =
                    tokio::net::TcpListener::from_std(listener).map_err(|error| error.to_string())?;
                tokio::select! {
                    outcome = inner.run_with(listener) => outcome,
                    why = monitor => Err(why),
                }
            });
            if let Err(what) = outcome {
                on_end(what);
            }
        };
        std::thread::Builder::new().name("opcua".to_owned()).spawn(serve)?;
        Ok(ended)
    }
}

/// Connections inherit the time-out of the listener: without it the library keeps, and even busy-polls, a connection
/// whose client reads nothing.
fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
    socket.set_reuse_address(true)?;
    socket.set_tcp_user_timeout(Some(CUT_OFF_AFTER))?;
    socket
        .set_tcp_keepalive(&TcpKeepalive::new().with_time(CUT_OFF_AFTER).with_interval(CUT_OFF_AFTER / 2))?;
    socket.set_nonblocking(true)?;
    socket.bind(&address.into())?;
    socket.listen(BACKLOG)?;
    Ok(socket.into())
}

fn builder(station: &str, config: &OpcUaConfig, host: &str, uri: &str, port: u16) -> ServerBuilder {
    let url_host = if host.contains(':') { format!("[{host}]") } else { host.to_owned() };
    let version = env!("CARGO_PKG_VERSION");
    let beat_ms = 1000.0 / config.rate_hz;
    let mut builder = ServerBuilder::new()
        .application_name(format!("Equipoise {station}"))
        .application_uri(uri)
        .product_uri("urn:equipoise")
        .build_info(BuildInfo {
            product_uri: "urn:equipoise".into(),
            product_name: "Equipoise".into(),
            software_version: version.into(),
            ..BuildInfo::default()
        })
        .certificate_path(certificates::OWN)
        .private_key_path(certificates::KEY)
        .trust_client_certs(false)
        .check_cert_time(true)
        .discovery_urls(vec![format!("opc.tcp://{url_host}:{port}/")])
        .host(url_host)
        .port(port)
        .max_sessions(config.sessions_max)
        .subscription_poll_interval_ms((beat_ms / 2.0).clamp(5.0, 100.0) as u64)
        .diagnostics_enabled(true);
    let limits = &mut builder.limits_mut().subscriptions;
    limits.max_subscriptions_per_session = SUBSCRIPTIONS_MAX;
    limits.max_monitored_item_queue_size = QUEUE_MAX;
    limits.min_publishing_interval_ms = beat_ms;
    limits.min_sampling_interval_ms = 0.0;
    limits.max_keep_alive_count = LIFETIME_MAX / 3;
    limits.max_lifetime_count = LIFETIME_MAX;
    for (id, policy) in policies(config) {
        let mode = match policy {
            SecurityPolicy::None => MessageSecurityMode::None,
            _ => MessageSecurityMode::SignAndEncrypt,
        };
        builder = builder.add_endpoint(id, ServerEndpoint::new("/", policy, mode, &[]));
    }
    builder
}

/// No security on loopback only. Policies that the standard deprecates are not offered.
fn policies(config: &OpcUaConfig) -> Vec<(&'static str, SecurityPolicy)> {
    let mut all = vec![
        ("basic256sha256", SecurityPolicy::Basic256Sha256),
        ("aes128sha256rsaoaep", SecurityPolicy::Aes128Sha256RsaOaep),
        ("aes256sha256rsapss", SecurityPolicy::Aes256Sha256RsaPss),
    ];
    if config.is_local() {
        all.push(("none", SecurityPolicy::None));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_gateways::StationFile;

    #[test]
    fn nothing_is_offered_in_the_clear_beyond_loopback() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let ids = |listen: &str| {
            let section = format!("[gateways.opcua]\nlisten = \"{listen}\"\nusers_file = \"u\"");
            std::fs::write(file.path(), format!("station = \"s\"\n{section}")).unwrap();
            let config = StationFile::read(file.path()).unwrap().gateways.opcua.unwrap();
            policies(&config).into_iter().map(|(_, policy)| policy).collect::<Vec<_>>()
        };
        assert!(ids("127.0.0.1:4840").contains(&SecurityPolicy::None));
        for listen in ["192.0.2.7:4840", "[2001:db8::7]:4840"] {
            let offered = ids(listen);
            assert_eq!(offered.len(), 3, "{offered:?}");
            assert!(!offered.contains(&SecurityPolicy::None));
        }
    }
}
