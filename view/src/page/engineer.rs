//! The engineer's routes: facts, history, report, the stored workers, and commands, the only write access.
//!
//! The ids of the stored workers are listed for the command token only. A command is a `POST` without a body that has the command token in a header of its own. Neither a form nor another
//! site's script can send that header (the browser's preflight request is refused), and the cookie of the page does not
//! count: read access does not permit commands. A foreign `Origin` is refused even with the token.

use std::convert::Infallible;
use std::sync::{Arc, Weak};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use axum::response::sse::Event;
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use tokio::sync::{Mutex, Semaphore, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

use super::event_stream;
use super::station::{Engineer, PageCommand, Station};

/// Header with the command token.
pub const COMMAND_HEADER: &str = "x-equipoise-command";
/// How often facts are sent to viewers.
const FACTS_EVERY: Duration = Duration::from_secs(1);
/// How often to check for new viewers.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// One at a time: a second command before the first reply is an accidental double click.
const COMMANDS_AT_ONCE: usize = 1;

type Facts = Option<Arc<str>>;

#[derive(Clone)]
struct Desk {
    engineer: Engineer,
    /// Invalid after the page has stopped.
    sender: Weak<watch::Sender<Facts>>,
    places: Arc<Semaphore>,
    /// The report as last read. One request at a time reads the file; responses with equal content share its memory.
    report: Arc<Mutex<Bytes>>,
}

/// The routes, and the task that polls facts while there are viewers; it runs until it is aborted.
pub(super) fn routes(engineer: Engineer) -> (Router, impl Future<Output = ()> + Send + 'static) {
    let sender = Arc::new(watch::Sender::new(None));
    let desk = Desk {
        engineer: engineer.clone(),
        sender: Arc::downgrade(&sender),
        places: Arc::new(Semaphore::new(COMMANDS_AT_ONCE)),
        report: Arc::default(),
    };
    let routes = Router::new()
        .route("/events/station", get(events))
        .route("/api/station", get(facts))
        .route("/api/history", get(history))
        .route("/report", get(report))
        .route("/api/subjects", get(subjects))
        .route("/api/command/{name}", post(command))
        .route("/api/command/{name}/{subject}", post(command_on))
        .with_state(desk);
    (routes, tell(engineer.station, sender))
}

async fn tell(station: Arc<dyn Station>, sender: Arc<watch::Sender<Facts>>) {
    let mut ticks = interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let (mut watchers, mut last) = (0, None::<Instant>);
    loop {
        ticks.tick().await;
        let now = sender.receiver_count();
        let came = now > watchers;
        watchers = now;
        if watchers == 0 {
            // The next viewer must not get old facts.
            sender.send_if_modified(|facts| facts.take().is_some());
        } else if came || last.is_none_or(|last| last.elapsed() >= FACTS_EVERY) {
            last = Some(Instant::now());
            sender.send_replace(Some(station.facts().into()));
        }
    }
}

async fn events(State(desk): State<Desk>, headers: HeaderMap) -> Response {
    match desk.sender.upgrade() {
        Some(sender) => event_stream::response(&headers, stream(sender.subscribe())),
        None => (StatusCode::SERVICE_UNAVAILABLE, "The page is ending.\n").into_response(),
    }
}

fn stream(facts: watch::Receiver<Facts>) -> impl Stream<Item = Result<Event, Infallible>> + Send + use<> {
    WatchStream::new(facts).map(|facts| {
        Ok(match facts {
            Some(facts) => Event::default().event("station").data(facts),
            None => Event::default().event("silent").data("{}"),
        })
    })
}

async fn facts(State(desk): State<Desk>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], desk.engineer.station.facts()).into_response()
}

async fn history(State(desk): State<Desk>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], desk.engineer.station.history()).into_response()
}

async fn report(State(desk): State<Desk>) -> Response {
    let (station, mut last) = (desk.engineer.station, desk.report.lock_owned().await);
    let read = move || {
        let html = station.report().unwrap_or_default();
        if *last != html {
            *last = html.into();
        }
        (!last.is_empty()).then(|| last.clone())
    };
    match tokio::task::spawn_blocking(read).await {
        Ok(Some(html)) => Html(html).into_response(),
        _ => (StatusCode::NOT_FOUND, "No report was written, or [page] report does not name it.\n")
            .into_response(),
    }
}

async fn subjects(State(desk): State<Desk>, headers: HeaderMap) -> Response {
    if let Some(refusal) = desk.refusal(&headers) {
        return refusal;
    }
    let station = desk.engineer.station;
    match tokio::task::spawn_blocking(move || station.subjects()).await {
        Ok(Ok(ids)) => {
            let list = serde_json::Value::from(ids).to_string();
            ([(header::CONTENT_TYPE, "application/json")], list).into_response()
        }
        Ok(Err(reason)) => (StatusCode::INTERNAL_SERVER_ERROR, reason).into_response(),
        Err(_) => refused(StatusCode::INTERNAL_SERVER_ERROR, "The page failed to list the workers.\n"),
    }
}

async fn command(State(desk): State<Desk>, headers: HeaderMap, Path(name): Path<String>) -> Response {
    act(desk, &headers, PageCommand::named(&name, None)).await
}

async fn command_on(
    State(desk): State<Desk>,
    headers: HeaderMap,
    Path((name, subject)): Path<(String, String)>,
) -> Response {
    act(desk, &headers, PageCommand::named(&name, Some(&subject))).await
}

fn refused(status: StatusCode, sentence: &'static str) -> Response {
    (status, sentence).into_response()
}

impl Desk {
    /// The refusal of a request without the command token or from another site; `None` if it is permitted.
    fn refusal(&self, headers: &HeaderMap) -> Option<Response> {
        let Some(token) = &self.engineer.command_token else {
            return Some(refused(
                StatusCode::FORBIDDEN,
                "This page takes no commands: [page] command_token_file is not set.\n",
            ));
        };
        if !is_from_here(headers) {
            return Some(refused(StatusCode::FORBIDDEN, "Commands are taken from this page itself only.\n"));
        }
        let Some(given) = headers.get(COMMAND_HEADER) else {
            return Some(refused(StatusCode::UNAUTHORIZED, "A command needs the command token.\n"));
        };
        if !given.to_str().is_ok_and(|given| token.is_secret(given)) {
            return Some(refused(StatusCode::UNAUTHORIZED, "The command token is wrong.\n"));
        }
        None
    }
}

async fn act(desk: Desk, headers: &HeaderMap, command: Option<PageCommand>) -> Response {
    if let Some(refusal) = desk.refusal(headers) {
        return refusal;
    }
    let Some(command) = command else {
        return refused(StatusCode::NOT_FOUND, "There is no such command, or its subject is no id.\n");
    };
    let Ok(place) = desk.places.try_acquire_owned() else {
        return refused(StatusCode::TOO_MANY_REQUESTS, "Another command is on its way.\n");
    };
    let station = desk.engineer.station;
    let outcome = tokio::task::spawn_blocking(move || {
        let outcome = station.command(&command);
        drop(place);
        outcome
    });
    match outcome.await {
        Ok(Ok(sentence)) => sentence.into_response(),
        Ok(Err(sentence)) => (StatusCode::CONFLICT, sentence).into_response(),
        Err(_) => refused(StatusCode::INTERNAL_SERVER_ERROR, "The page failed while it asked the daemon.\n"),
    }
}

/// Whether the request comes from a page of this address, by the browser's headers; requests without such headers
/// (scripts) pass.
fn is_from_here(headers: &HeaderMap) -> bool {
    let text = |name: header::HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let ours = match (text(header::ORIGIN), text(header::HOST)) {
        (None, _) => true,
        (Some(origin), Some(host)) => origin.split_once("://").is_some_and(|(_, from)| from == host),
        (Some(_), None) => false,
    };
    let site = headers.get("sec-fetch-site").map(|value| value.to_str().unwrap_or("?"));
    ours && site.is_none_or(|site| matches!(site, "same-origin" | "none"))
}
