//! Taking connections, and what each may cost. Every limit of the page's server stands here.

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
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio::time::timeout;

/// Open connections at once; a browser opens up to six. One more is told so and closed.
pub(super) const CONNECTIONS_MAX: usize = 64;
/// A request's line and headers must be there after this long, and a connection that asks for nothing is closed.
const HEADERS_WITHIN: Duration = Duration::from_secs(10);
/// Headers of one request.
const HEADERS_MAX: usize = 64;
/// A request's line and headers together; hyper takes no less than 8 KiB.
const HEADERS_BYTES_MAX: usize = 16 * 1024;
/// A client that takes nothing of what was sent is given up after this long.
const UNREAD_FOR_MAX: Duration = Duration::from_secs(30);
/// About four frames: a browser that stops reading finds the newest state after it, not a minute of old ones.
const SEND_BUFFER_BYTES: usize = 16 * 1024;
/// How long open connections get to end after a stop.
const FAREWELL: Duration = Duration::from_secs(1);
/// When the system has no file descriptor left, trying at once again would only keep it busy.
const AFTER_A_FAILURE: Duration = Duration::from_millis(100);

const TOO_MANY: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain\r\nConnection: close\r\n\
    Content-Length: 64\r\n\r\nToo many connections to the page are open; close one, try again\n";

/// Serves `routes` until `stopped` says so (or its sender is gone); then calls `farewell`, which is to end what would
/// never end by itself.
pub(crate) async fn serve(
    listener: TcpListener,
    routes: Router,
    stopped: oneshot::Receiver<()>,
    farewell: impl FnOnce(),
) {
    // Fails only without a reactor, and this runs inside one.
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    let open = Arc::new(GracefulShutdown::new());
    let taking = tokio::spawn(take(listener, routes, Arc::downgrade(&open)));
    let _ = stopped.await;
    taking.abort();
    // Until it has ended it may hold on to a watcher.
    let _ = taking.await;
    farewell();
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
            // Whoever is not ready for a short sentence goes without.
            let _ = stream.try_write(TOO_MANY);
            continue;
        };
        let Some(watcher) = open.upgrade().map(|open| open.watcher()) else { return };
        let _ = prepare(&stream);
        tokio::spawn(converse(stream, routes.clone(), watcher, place));
    }
}

/// All of it only makes the page smoother; without it the page works.
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
    // How a client ends its connection is its own affair.
    let _ = watcher.watch(connection).await;
    drop(place);
}
