//! The routes, and the life of the server.

use std::convert::Infallible;
use std::net::TcpListener;
use std::time::Duration;

use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::middleware::from_fn;
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::serve::ListenerExt;
use tokio::sync::{oneshot, watch};
use tokio::time::timeout;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

use super::PageFrame;
use super::guard::loopback_only;
use super::newest::{Newest, follow};

/// How long open connections get to end after a stop.
const FAREWELL: Duration = Duration::from_secs(1);

/// About four frames: a browser that stops reading finds the newest state after it, not a minute of old ones.
const SEND_BUFFER_BYTES: usize = 16 * 1024;

/// Serves until `stopped` says so (or its sender is gone).
pub(super) async fn serve<F>(listener: TcpListener, feed: F, stopped: oneshot::Receiver<()>)
where
    F: FnMut() -> Option<PageFrame> + Send + 'static,
{
    // Fails only without a reactor, and this runs inside one.
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    let listener = listener.tap_io(|stream| {
        let socket = socket2::SockRef::from(&*stream);
        // Both only make the page smoother; without them it works.
        let _ = socket.set_send_buffer_size(SEND_BUFFER_BYTES);
        let _ = socket.set_tcp_nodelay(true);
    });
    let (newest, watched) = watch::channel(Newest::Silent);
    let follower = tokio::spawn(follow(feed, newest));
    let (closing, closed) = oneshot::channel::<()>();
    let server = axum::serve(listener, routes(watched)).with_graceful_shutdown(async {
        let _ = closed.await;
    });
    let server = tokio::spawn(server.into_future());
    let _ = stopped.await;
    // The follower takes the sender of `watched` with it: that ends the event streams.
    follower.abort();
    drop(closing);
    let _ = timeout(FAREWELL, server).await;
}

fn routes(newest: watch::Receiver<Newest>) -> Router {
    let file = |kind: &'static str, text: &'static str| {
        get(move || std::future::ready(([(header::CONTENT_TYPE, kind)], text)))
    };
    const SCRIPT: &str = "text/javascript; charset=utf-8";
    Router::new()
        .route("/", file("text/html; charset=utf-8", include_str!("index.html")))
        .route("/style.css", file("text/css; charset=utf-8", include_str!("style.css")))
        .route("/page.js", file(SCRIPT, include_str!("page.js")))
        .route("/body.js", file(SCRIPT, include_str!("body.js")))
        .route("/figure.js", file(SCRIPT, include_str!("figure.js")))
        .route("/plate.js", file(SCRIPT, include_str!("plate.js")))
        .route("/icon.svg", file("image/svg+xml", include_str!("icon.svg")))
        .route("/healthz", file("text/plain; charset=utf-8", "ok\n"))
        .route("/events", get(events))
        .route("/api/state", get(state))
        .with_state(newest)
        .layer(from_fn(loopback_only))
}

/// The newest frame at once, then every newer one; a client that is slow misses the ones between.
async fn events(
    State(newest): State<watch::Receiver<Newest>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    Sse::new(WatchStream::new(newest).map(|newest| {
        Ok(match newest {
            Newest::Silent => Event::default().event("silent").data("{}"),
            Newest::State { frame, .. } => Event::default().event("frame").data(frame),
        })
    }))
}

async fn state(State(newest): State<watch::Receiver<Newest>>) -> Response {
    const JSON: [(header::HeaderName, &str); 1] = [(header::CONTENT_TYPE, "application/json")];
    match &*newest.borrow() {
        Newest::State { state, .. } => (JSON, state.to_string()).into_response(),
        Newest::Silent => {
            let sentence = r#"{"error":"the service has published no state within the last second"}"#;
            (StatusCode::SERVICE_UNAVAILABLE, JSON, sentence).into_response()
        }
    }
}
