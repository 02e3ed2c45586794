//! The worker's page: a small web server on loopback, in a thread and a runtime of its own, never in the loop.
//!
//! It is read-only, except for commands with a separate token (`engineer.rs`). `/` is the worker's page, `/engineer`
//! the engineer's, `/events` the state as Server-Sent Events (`?hz=RATE` at a lower rate), `/api/state` the newest state once
//! ([`crate::state_json`]), `/healthz` confirms that the page is served.
//!
//! A browser can be tricked by any site into sending requests to `127.0.0.1`; therefore a request must name loopback in
//! its `Host`, and responses do not permit other origins. Addresses other than loopback are served only with a
//! [`Token`], which every request must contain. The cost of a connection is bounded (`connections.rs`, `guard.rs`).

mod assets;
pub(crate) mod connections;
mod demo;
mod engineer;
mod event_stream;
mod frame;
pub(crate) mod guard;
mod newest;
mod overview;
mod server;
mod station;
mod token;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;

use tokio::sync::oneshot;

pub use demo::{LiftResult, SimulatedCobot, SimulatedHuman};
pub use engineer::COMMAND_HEADER;
pub use frame::PageFrame;
pub use station::{Engineer, PageCommand, Station};
pub use token::{TOKEN_CHARS_MAX, TOKEN_CHARS_MIN, Token};

/// Rate at which the feed is polled, and therefore the maximum rate of frames.
pub const FRAME_RATE_HZ: u32 = 60;

/// Threads for blocking calls: commands and the report.
const BLOCKING_THREADS: usize = 4;

/// Why the page is not served.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The address can be reached from other machines.
    #[error(
        "the page may only listen on this machine without a token, but {listen} can be reached from others: \
         use 127.0.0.1:{} or [::1]:{} (a remote screen goes through an SSH tunnel), or give it a token",
        listen.port(), listen.port()
    )]
    NotLoopback {
        /// The configured address.
        listen: SocketAddr,
    },
    /// The port is in use.
    #[error(
        "the page cannot listen on {listen}: the port is taken, perhaps by another daemon; \
         choose another port, or 0 for any free one"
    )]
    PortTaken {
        /// The configured address.
        listen: SocketAddr,
    },
    /// The system rejected the address for another reason.
    #[error("the page cannot listen on {listen}: {source}")]
    Listen {
        /// The configured address.
        listen: SocketAddr,
        /// The system's error.
        source: io::Error,
    },
    /// The system could not create a thread or an event queue.
    #[error("the page cannot be started: {0}")]
    Start(#[source] io::Error),
}

/// A running page server. Dropping it stops the server.
#[derive(Debug)]
pub struct Page {
    address: SocketAddr,
    /// Stops the server; the text is the last event of open pages.
    stop: Option<oneshot::Sender<Arc<str>>>,
    streams: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Page {
    /// Serves the page on a loopback address to all users of this machine; port 0 selects a free one.
    ///
    /// `feed` is called [`FRAME_RATE_HZ`] times a second on the page's thread and returns the newest frame, or `None`
    /// if there is no new one. It must not block. A frame of the same cycle as before does not count as new; after a
    /// second without a new frame the page reports that the service is silent and displays no values.
    ///
    /// The thread inherits the caller's scheduling: start it from a thread without real-time priority.
    pub fn start<F>(listen: SocketAddr, feed: F) -> Result<Page, PageError>
    where
        F: FnMut() -> Option<PageFrame> + Send + 'static,
    {
        Page::start_for(listen, None, feed)
    }

    /// As above, on any address, for clients with the token; without a token on loopback only.
    pub fn start_for<F>(listen: SocketAddr, token: Option<Token>, feed: F) -> Result<Page, PageError>
    where
        F: FnMut() -> Option<PageFrame> + Send + 'static,
    {
        Page::start_with(listen, token, feed, None)
    }

    /// As above, with the engineer's page: its facts, and the commands that it may send.
    ///
    /// # Errors
    /// [`PageError`].
    pub fn start_with<F>(
        listen: SocketAddr,
        token: Option<Token>,
        feed: F,
        engineer: Option<Engineer>,
    ) -> Result<Page, PageError>
    where
        F: FnMut() -> Option<PageFrame> + Send + 'static,
    {
        Page::launch(listen, token, |listener, access, opened, stopped| {
            server::serve(listener, access, feed, engineer, opened, stopped)
        })
    }

    /// Serves the page of several stations: `feed` is called twice a second on the page's thread and returns their
    /// state, a JSON array. It must not block.
    ///
    /// # Errors
    /// [`PageError`].
    pub fn start_overview<F>(listen: SocketAddr, token: Option<Token>, feed: F) -> Result<Page, PageError>
    where
        F: FnMut() -> String + Send + 'static,
    {
        Page::launch(listen, token, |listener, access, _, stopped| {
            overview::serve(listener, access, feed, stopped)
        })
    }

    /// Starts the thread of a server.
    fn launch<S>(
        listen: SocketAddr,
        token: Option<Token>,
        serve: impl FnOnce(TcpListener, guard::Access, Arc<AtomicU64>, oneshot::Receiver<Arc<str>>) -> S
        + Send
        + 'static,
    ) -> Result<Page, PageError>
    where
        S: Future<Output = ()>,
    {
        let loopback_only = listen.ip().is_loopback();
        if !loopback_only && token.is_none() {
            return Err(PageError::NotLoopback { listen });
        }
        let listener = TcpListener::bind(listen).map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => PageError::PortTaken { listen },
            _ => PageError::Listen { listen, source },
        })?;
        listener.set_nonblocking(true).map_err(PageError::Start)?;
        let address = listener.local_addr().map_err(PageError::Start)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(BLOCKING_THREADS)
            .build()
            .map_err(PageError::Start)?;
        let access = guard::Access { loopback_only, token, port: address.port() };
        let (stop, stopped) = oneshot::channel();
        let streams = Arc::new(AtomicU64::new(0));
        let opened = Arc::clone(&streams);
        let thread = std::thread::Builder::new()
            .name("page".to_owned())
            .spawn(move || {
                runtime.block_on(serve(listener, access, opened, stopped));
                runtime.shutdown_background();
            })
            .map_err(PageError::Start)?;
        Ok(Page { address, stop: Some(stop), streams, thread: Some(thread) })
    }

    /// Address of the listening socket, with the actual port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// URL for a browser.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Whether the server still runs; `false` after its feed panicked.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Number of event streams that viewers have opened so far.
    pub fn streams_opened(&self) -> u64 {
        self.streams.load(Ordering::Relaxed)
    }

    /// Stops the server at the end of a demonstration: open pages keep displaying these results.
    pub fn end(&mut self, results: &[LiftResult]) {
        if let Some(stop) = self.stop.take() {
            // The server has ended by itself if nothing receives it.
            let _ = stop.send(serde_json::json!({ "results": results }).to_string().into());
        }
        self.halt();
    }

    /// Closes open connections and waits for the thread, at most about a second.
    pub fn stop(mut self) {
        self.halt();
    }

    fn halt(&mut self) {
        // The receiver also completes when the sender is dropped.
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // The thread has already printed a panic of the feed; nothing is left to stop.
            let _ = thread.join();
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.halt();
    }
}
