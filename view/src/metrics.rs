//! Prometheus metrics of the service: `GET /metrics`, on loopback, in a thread and a runtime of its own.
//!
//! Counts and ages only: no poses, torques or names. Like the page, the server is read-only.

mod families;
mod plain;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;

use axum::Router;
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::sync::oneshot;

pub use families::{JointCycles, Snapshot, Stream};

use crate::page::connections;
use crate::page::guard::{Access, guard};

const PLAIN: &str = "text/plain; version=0.0.4; charset=utf-8";
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Why metrics are not served.
#[derive(Debug, thiserror::Error)]
pub enum MetricsError {
    /// The address can be reached from other machines.
    #[error(
        "metrics may only listen on this machine, but {listen} can be reached from others: use 127.0.0.1:{} or \
         [::1]:{} (a Prometheus elsewhere asks through an agent here, or an SSH tunnel)",
        listen.port(), listen.port()
    )]
    NotLoopback {
        /// The configured address.
        listen: SocketAddr,
    },
    /// The system rejected the address.
    #[error(
        "metrics cannot listen on {listen}: {source}; if the port is taken, choose another one, or 0 for any free one"
    )]
    Listen {
        /// The configured address.
        listen: SocketAddr,
        /// The system's error.
        source: io::Error,
    },
    /// The system could not create a thread or an event queue.
    #[error("metrics cannot be started: {0}")]
    Start(#[source] io::Error),
}

/// A running metrics server. Dropping it stops the server.
#[derive(Debug)]
pub struct Metrics {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Metrics {
    /// Serves on a loopback address; port 0 selects a free one. `feed` is called once per scrape, and must not block.
    ///
    /// The thread inherits the caller's scheduling: start it from a thread without real-time priority.
    ///
    /// # Errors
    /// [`MetricsError`], worded for the author of the configuration.
    pub fn start(
        listen: SocketAddr,
        feed: impl Fn() -> Snapshot + Send + Sync + 'static,
    ) -> Result<Metrics, MetricsError> {
        if !listen.ip().is_loopback() {
            return Err(MetricsError::NotLoopback { listen });
        }
        let listener = TcpListener::bind(listen).map_err(|source| MetricsError::Listen { listen, source })?;
        listener.set_nonblocking(true).map_err(MetricsError::Start)?;
        let address = listener.local_addr().map_err(MetricsError::Start)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(MetricsError::Start)?;
        let (stop, stopped) = oneshot::channel();
        let feed = Arc::new(feed);
        let routes = Router::new()
            .route("/metrics", get(move |headers: HeaderMap| std::future::ready(answer(&headers, &feed()))))
            .layer(from_fn_with_state(
                Access { loopback_only: true, token: None, port: address.port() },
                guard,
            ));
        let thread = std::thread::Builder::new()
            .name("metrics".to_owned())
            .spawn(move || {
                runtime.block_on(connections::serve(listener, routes, stopped, drop));
                runtime.shutdown_background();
            })
            .map_err(MetricsError::Start)?;
        Ok(Metrics { address, stop: Some(stop), thread: Some(thread) })
    }

    /// Address of the listening socket, with the actual port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Metrics {
    fn drop(&mut self) {
        // The receiver also completes when the sender is dropped.
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // The thread has already printed its panic.
            let _ = thread.join();
        }
    }
}

/// OpenMetrics format if the client accepts it, otherwise Prometheus's own text format.
fn answer(headers: &HeaderMap, snapshot: &Snapshot) -> Response {
    let accepts = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let open = accepts.into_iter().any(|accepted| accepted.contains("application/openmetrics-text"));
    match families::open_metrics(snapshot) {
        Ok(text) if open => ([(header::CONTENT_TYPE, OPEN_METRICS)], text).into_response(),
        Ok(text) => ([(header::CONTENT_TYPE, PLAIN)], plain::of_open_metrics(&text)).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}
