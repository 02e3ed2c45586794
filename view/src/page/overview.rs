//! The server of the page of several stations.

use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use axum::middleware::from_fn_with_state;
use axum::response::sse::Event;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::sync::{oneshot, watch};
use tokio::time::{MissedTickBehavior, interval};
use tokio_stream::StreamExt;
use tokio_stream::wrappers::WatchStream;

use super::guard::{Access, guard};
use super::{assets, connections, event_stream};

/// Interval of the event stream.
const EVERY: Duration = Duration::from_millis(500);
const NOT_FOUND: &str = "This address has no page. Stations: /.\n";

type Stations = watch::Receiver<Arc<str>>;

/// Serves until `stopped` completes or its sender is dropped, or the feed panics.
pub(super) async fn serve<F>(
    listener: TcpListener,
    access: Access,
    mut feed: F,
    stopped: oneshot::Receiver<Arc<str>>,
) where
    F: FnMut() -> String + Send + 'static,
{
    let (newest, watched) = watch::channel(Arc::from(feed()));
    let mut follower = tokio::spawn(async move {
        let mut ticks = interval(EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            ticks.tick().await;
            newest.send_replace(feed().into());
        }
    });
    let routes = assets::overview_routes()
        .route("/healthz", get(|| std::future::ready("ok\n")))
        .route("/events", get(events))
        .route("/api/stations", get(stations))
        .with_state(watched)
        .fallback(|| std::future::ready((StatusCode::NOT_FOUND, NOT_FOUND)))
        .layer(from_fn_with_state(access, guard));
    let follower_handle = follower.abort_handle();
    let ended = async {
        tokio::select! {
            _ = stopped => {}
            _ = &mut follower => {}
        }
    };
    // The aborted task drops the sender, which ends the event streams.
    connections::serve(listener, routes, ended, |()| follower_handle.abort()).await;
}

async fn events(State(stations): State<Stations>, headers: HeaderMap) -> Response {
    let events =
        WatchStream::new(stations).map(|stations| Ok(Event::default().event("stations").data(stations)));
    event_stream::response(&headers, events)
}

async fn stations(State(stations): State<Stations>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], stations.borrow().to_string()).into_response()
}
