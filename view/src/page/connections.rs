//! Accepts connections and limits their cost. All limits of the page's server are defined here.

use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpStream;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// Maximum number of open connections; a browser opens up to six. Further ones get a 503 response and are closed.
pub(super) const CONNECTIONS_MAX: usize = 64;
/// Time limit for a request's line and headers, and for an idle connection. Origin: Apache's `KeepAliveTimeout`.
const HEADERS_WITHIN: Duration = Duration::from_secs(5);
/// Maximum number of headers of a request.
const HEADERS_MAX: usize = 64;
/// Maximum size of a request's line and headers together; hyper requires at least 8 KiB.
const HEADERS_BYTES_MAX: usize = 16 * 1024;
/// A client that acknowledges nothing of the sent data for this long is disconnected.
const UNREAD_FOR_MAX: Duration = Duration::from_secs(30);
/// About four frames: a browser that has paused reading gets the newest state next, not a minute of old ones.
const SEND_BUFFER_BYTES: usize = 16 * 1024;
/// Time for open connections to end after a stop.
const FAREWELL: Duration = Duration::from_secs(1);
/// Pause after a failed accept: without free file descriptors, retrying at once would only consume CPU time.
const AFTER_A_FAILURE: Duration = Duration::from_millis(100);

const TOO_MANY: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain\r\nConnection: close\r\n\
    Content-Length: 64\r\n\r\nToo many connections to the page are open; close one, try again\n";

/// Serves `routes` until `stopped` completes; then calls `on_stop` with its value, which must end endless responses.
pub(crate) async fn serve<T>(
    listener: TcpListener,
    routes: Router,
    stopped: impl Future<Output = T>,
    on_stop: impl FnOnce(T),
) {
    // Fails only without a reactor; this function runs inside one.
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    let open = Arc::new(GracefulShutdown::new());
    let taking = tokio::spawn(take(listener, routes, Arc::downgrade(&open)));
    let last = stopped.await;
    taking.abort();
    // The task may hold a watcher until it has ended.
    let _ = taking.await;
    on_stop(last);
    if let Some(open) = Arc::into_inner(open) {
        let _ = timeout(FAREWELL, open.shutdown()).await;
    }
}

async fn take(listener: tokio::net::TcpListener, routes: Router, open: std::sync::Weak<GracefulShutdown>) {
    let places = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(AFTER_A_FAILURE).await;
            continue;
        };
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
            // Best effort: a client that cannot take the short response at once is closed without it.
            let _ = stream.try_write(TOO_MANY);
            continue;
        };
        let Some(watcher) = open.upgrade().map(|open| open.watcher()) else { return };
        let _ = prepare(&stream);
        tokio::spawn(converse(stream, routes.clone(), watcher, place));
    }
}

/// All options are optimisations; the page works without them.
fn prepare(stream: &TcpStream) -> io::Result<()> {
    let socket = socket2::SockRef::from(stream);
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.set_tcp_nodelay(true)?;
    socket.set_tcp_user_timeout(Some(UNREAD_FOR_MAX))
}

async fn converse(stream: TcpStream, routes: Router, watcher: Watcher, place: OwnedSemaphorePermit) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADERS_WITHIN)
        .max_headers(HEADERS_MAX)
        .max_buf_size(HEADERS_BYTES_MAX)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(routes));
    // Errors at the end of a connection are the client's and are ignored.
    let _ = watcher.watch(connection).await;
    drop(place);
}
