//! The routes, and the lifetime of the server.

use std::net::TcpListener;

use axum::Router;
use axum::extract::{RawQuery, State};
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use axum::middleware::from_fn_with_state;
use axum::response::sse::Event;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::sync::{oneshot, watch};
use tokio_stream::StreamExt;
use tokio_stream::wrappers::WatchStream;

use super::guard::{Access, guard};
use super::newest::{Newest, follow};
use super::station::Engineer;
use super::{PageFrame, assets, connections, engineer, event_stream};

const NOT_FOUND: &str = "This address has no page. Worker's page: /, engineer's page: /engineer.\n";

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
    let routes = pages(watched)
        .merge(more.unwrap_or_default())
        .fallback(|| std::future::ready((StatusCode::NOT_FOUND, NOT_FOUND)))
        .layer(from_fn_with_state(access, guard));
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
    assets::routes()
        .route("/healthz", get(|| std::future::ready("ok\n")))
        .route("/events", get(events))
        .route("/api/state", get(state))
        .with_state(newest)
}

/// Sends the newest frame at once, then every newer one; a slow client skips frames.
async fn events(
    State(newest): State<watch::Receiver<Newest>>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let events = WatchStream::new(newest).map(|newest| {
        Ok(match newest {
            Newest::Silent => Event::default().event("silent").data("{}"),
            Newest::State { frame, .. } => Event::default().event("frame").data(frame),
        })
    });
    match event_stream::interval_of(query.as_deref()) {
        Some(interval) => event_stream::response(&headers, events.throttle(interval)),
        None => event_stream::response(&headers, events),
    }
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
