//! The routes, and the lifetime of the server.

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::Router;
use axum::extract::{RawQuery, State};
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use axum::middleware::from_fn_with_state;
use axum::response::sse::Event;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::WatchStream;

use super::guard::{Access, guard};
use super::newest::{Newest, run_frame_feed};
use super::station::Engineer;
use super::{PageFrame, assets, connections, engineer, event_stream};

const NOT_FOUND: &str = "This address has no page. Worker's page: /, engineer's page: /engineer.\n";

/// Serves until `stopped` completes, whose text is the last event of open pages, its sender is dropped, or a task that
/// reads the station panics. Counts opened event streams in `streams`.
pub(super) async fn serve<F>(
    listener: TcpListener,
    access: Access,
    feed: F,
    engineer: Option<Engineer>,
    streams: Arc<AtomicU64>,
    stopped: oneshot::Receiver<Arc<str>>,
) where
    F: FnMut() -> Option<PageFrame> + Send + 'static,
{
    let (newest, watched) = watch::channel(Newest::Silent);
    let mut readers = JoinSet::new();
    readers.spawn(run_frame_feed(feed, newest.clone()));
    let (more, facts_reader) = engineer.map(engineer::routes).unzip();
    if let Some(facts_reader) = facts_reader {
        readers.spawn(facts_reader);
    }
    let routes = pages(Watched { newest: watched, streams })
        .merge(more.unwrap_or_default())
        .fallback(|| std::future::ready((StatusCode::NOT_FOUND, NOT_FOUND)))
        .layer(from_fn_with_state(access, guard));
    let ended = async {
        let last = tokio::select! {
            last = stopped => last.ok(),
            // Readers never return: only a panic ends one.
            _ = readers.join_next() => None,
        };
        (last, readers)
    };
    // Aborting the readers and dropping the senders ends the event streams, after their last event.
    let on_stop = |(last, mut readers): (Option<Arc<str>>, JoinSet<()>)| {
        readers.abort_all();
        if let Some(last) = last {
            newest.send_replace(Newest::Ended(last));
        }
        drop(newest);
    };
    connections::serve(listener, routes, ended, on_stop).await;
}

/// What the routes read.
#[derive(Clone)]
struct Watched {
    newest: watch::Receiver<Newest>,
    streams: Arc<AtomicU64>,
}

fn pages(watched: Watched) -> Router {
    assets::routes()
        .route("/healthz", get(|| std::future::ready("ok\n")))
        .route("/events", get(events))
        .route("/api/state", get(state))
        .with_state(watched)
}

/// Sends the newest frame at once, then every newer one; a slow client skips frames.
async fn events(
    State(Watched { newest, streams }): State<Watched>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    streams.fetch_add(1, Ordering::Relaxed);
    let events = WatchStream::new(newest).map(|newest| {
        Ok(match newest {
            Newest::Silent => Event::default().event("silent").data("{}"),
            Newest::State { frame, .. } => Event::default().event("frame").data(frame),
            Newest::Ended(results) => Event::default().event("ended").data(results),
        })
    });
    match event_stream::interval_of(query.as_deref()) {
        Some(interval) => event_stream::response(&headers, events.throttle(interval)),
        None => event_stream::response(&headers, events),
    }
}

async fn state(State(Watched { newest, .. }): State<Watched>) -> Response {
    const JSON: [(header::HeaderName, &str); 1] = [(header::CONTENT_TYPE, "application/json")];
    match &*newest.borrow() {
        Newest::State { state, .. } => (JSON, state.to_string()).into_response(),
        Newest::Silent | Newest::Ended(_) => {
            let sentence = r#"{"error":"the service has published no state within the last second"}"#;
            (StatusCode::SERVICE_UNAVAILABLE, JSON, sentence).into_response()
        }
    }
}
