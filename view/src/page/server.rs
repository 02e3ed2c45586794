//! The routes, and the lifetime of the server.

use std::convert::Infallible;
use std::net::TcpListener;

use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::sync::{oneshot, watch};
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

use super::guard::{Access, guard};
use super::newest::{Newest, follow};
use super::station::Engineer;
use super::{PageFrame, connections, engineer};

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";

/// A static file of the pages: path on the server, content type, content.
type Asset = (&'static str, &'static str, &'static str);

/// All files. `view/web` builds them; `view/assets/LIBRARIES.md` lists the libraries in them.
const ASSETS: [Asset; 8] = [
    ("/", HTML, include_str!("../../assets/worker.html")),
    ("/worker.js", SCRIPT, include_str!("../../assets/worker.js")),
    ("/worker.css", STYLE, include_str!("../../assets/worker.css")),
    ("/engineer", HTML, include_str!("../../assets/engineer.html")),
    ("/engineer.js", SCRIPT, include_str!("../../assets/engineer.js")),
    ("/engineer.css", STYLE, include_str!("../../assets/engineer.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../../assets/icon.svg")),
    ("/libraries", "text/plain; charset=utf-8", include_str!("../../assets/LIBRARIES.md")),
];

/// Serves until `stopped` completes (or its sender is dropped).
pub(super) async fn serve<F>(
    listener: TcpListener,
    access: Access,
    feed: F,
    engineer: Option<Engineer>,
    stopped: oneshot::Receiver<()>,
) where
    F: FnMut() -> Option<PageFrame> + Send + 'static,
{
    let (newest, watched) = watch::channel(Newest::Silent);
    let follower = tokio::spawn(follow(feed, newest));
    let (more, telling) = engineer.map(engineer::routes).unzip();
    let telling = telling.map(tokio::spawn);
    let routes = pages(watched).merge(more.unwrap_or_default()).layer(from_fn_with_state(access, guard));
    // Aborting both tasks drops the senders, which ends the event streams.
    let farewell = || {
        follower.abort();
        if let Some(telling) = telling {
            telling.abort();
        }
    };
    connections::serve(listener, routes, stopped, farewell).await;
}

fn pages(newest: watch::Receiver<Newest>) -> Router {
    let file = |kind: &'static str, text: &'static str| {
        get(move || std::future::ready(([(header::CONTENT_TYPE, kind)], text)))
    };
    ASSETS
        .iter()
        .fold(Router::new(), |routes, (path, kind, text)| routes.route(path, file(kind, text)))
        .route("/healthz", file("text/plain; charset=utf-8", "ok\n"))
        .route("/events", get(events))
        .route("/api/state", get(state))
        .with_state(newest)
}

/// Sends the newest frame at once, then every newer one; a slow client skips frames.
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
