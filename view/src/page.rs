//! The worker's page: a small web server on loopback, in a thread and a runtime of its own, never in the loop.
//!
//! It tells and does not listen, except for commands that bring a token of their own (`engineer.rs`). `/` is the worker's
//! page, `/engineer` the engineer's, `/events` the state as Server-Sent Events, `/api/state` the newest state once
//! ([`crate::state_json`]), `/healthz` says that the page is served.
//!
//! A browser anywhere can be tricked into asking `127.0.0.1`; so a request must name loopback in its `Host`, and answers
//! carry no permission for other origins. Addresses beyond loopback are served with a [`Token`] only, which every
//! request must bring. What a connection may cost is bounded (`connections.rs`, `guard.rs`).

mod assets;
pub(crate) mod connections;
mod engineer;
mod frame;
pub(crate) mod guard;
mod newest;
mod server;
mod station;
mod token;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::thread::JoinHandle;

use tokio::sync::oneshot;

pub use engineer::COMMAND_HEADER;
pub use frame::PageFrame;
pub use station::{Engineer, PageCommand, Station};
pub use token::{TOKEN_CHARS_MAX, TOKEN_CHARS_MIN, Token};

/// How often the feed is asked, and so how often the page is told.
pub const FRAME_RATE_HZ: u32 = 60;

/// Threads for what may wait: a command, a report.
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
        /// The address asked for.
        listen: SocketAddr,
    },
    /// Somebody else listens there.
    #[error(
        "the page cannot listen on {listen}: the port is taken, perhaps by another daemon; \
         choose another port, or 0 for any free one"
    )]
    PortTaken {
        /// The address asked for.
        listen: SocketAddr,
    },
    /// The system refused the address for another reason.
    #[error("the page cannot listen on {listen}: {source}")]
    Listen {
        /// The address asked for.
        listen: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The system gave no thread or no event queue.
    #[error("the page cannot be started: {0}")]
    Start(#[source] io::Error),
}

/// A page being served. Dropping it stops it.
#[derive(Debug)]
pub struct Page {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Page {
    /// Serves the page on a loopback address to everybody on this machine; port 0 takes any free port.
    ///
    /// `feed` is called [`FRAME_RATE_HZ`] times a second on the page's thread and gives the newest frame, or `None`
    /// when there is nothing new. It must not block. A frame of the same cycle as before counts as nothing new;
    /// after a second of that the page says that the service is silent and shows no values.
    ///
    /// The thread inherits the caller's scheduling: start it from one without real-time priority.
    pub fn start<F>(listen: SocketAddr, feed: F) -> Result<Page, PageError>
    where
        F: FnMut() -> Option<PageFrame> + Send + 'static,
    {
        Page::start_for(listen, None, feed)
    }

    /// The same, on any address, to those who bring the token; without one on loopback only.
    pub fn start_for<F>(listen: SocketAddr, token: Option<Token>, feed: F) -> Result<Page, PageError>
    where
        F: FnMut() -> Option<PageFrame> + Send + 'static,
    {
        Page::start_with(listen, token, feed, None)
    }

    /// The same with what the engineer's page needs: its facts, and the commands that it may ask for.
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
        let thread = std::thread::Builder::new()
            .name("page".to_owned())
            .spawn(move || {
                runtime.block_on(server::serve(listener, access, feed, engineer, stopped));
                runtime.shutdown_background();
            })
            .map_err(PageError::Start)?;
        Ok(Page { address, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it listens, with the port that port 0 became.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What to type into a browser.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Whether it is still served; `false` after its feed panicked.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Ends the open connections and waits for the thread, at most about a second.
    pub fn stop(mut self) {
        self.halt();
    }

    fn halt(&mut self) {
        // The receiver takes a dropped sender for the same message.
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic of the feed was printed by its own thread; there is nothing left to stop.
            let _ = thread.join();
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.halt();
    }
}
