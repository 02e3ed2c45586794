//! Static files of the pages: compressed once, and named by a digest, so that a browser loads each version once.

use std::io::Write as _;
use std::sync::LazyLock;

use axum::Router;
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";

/// All files: path on the server, content type, content. `view/web` builds them; `view/assets/LIBRARIES.md` lists the
/// libraries in them.
const FILES: [(&str, &str, &str); 11] = [
    ("/", HTML, include_str!("../../assets/worker.html")),
    ("/worker.js", SCRIPT, include_str!("../../assets/worker.js")),
    ("/worker.css", STYLE, include_str!("../../assets/worker.css")),
    ("/engineer", HTML, include_str!("../../assets/engineer.html")),
    ("/engineer.js", SCRIPT, include_str!("../../assets/engineer.js")),
    ("/engineer.css", STYLE, include_str!("../../assets/engineer.css")),
    ("/stations", HTML, include_str!("../../assets/stations.html")),
    ("/stations.js", SCRIPT, include_str!("../../assets/stations.js")),
    ("/stations.css", STYLE, include_str!("../../assets/stations.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../../assets/icon.svg")),
    ("/libraries", "text/plain; charset=utf-8", include_str!("../../assets/LIBRARIES.md")),
];

/// A browser may store a file, but asks with its tag whether it is current before each use.
const REVALIDATE: HeaderValue = HeaderValue::from_static("private, no-cache");

struct Asset {
    kind: &'static str,
    text: &'static str,
    /// The text compressed by gzip; empty if that failed.
    gzip: Vec<u8>,
    /// Weak, because it names the plain and the compressed form.
    tag: String,
}

static ASSETS: LazyLock<[Asset; FILES.len()]> =
    LazyLock::new(|| FILES.map(|(_, kind, text)| Asset { kind, text, gzip: gzip(text), tag: tag(text) }));

/// The page of several stations, served by a server of its own at `/`.
const OVERVIEW: &str = "/stations";

/// The routes of a station's pages.
pub(super) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    routes_of(|path| (!path.starts_with(OVERVIEW)).then_some(path))
}

/// The routes of the page of several stations.
pub(super) fn overview_routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    routes_of(|path| match path {
        OVERVIEW => Some("/"),
        "/icon.svg" | "/libraries" => Some(path),
        _ => path.starts_with(OVERVIEW).then_some(path),
    })
}

/// The files for which `place` returns a path.
fn routes_of<S: Clone + Send + Sync + 'static>(
    place: impl Fn(&'static str) -> Option<&'static str>,
) -> Router<S> {
    let placed =
        FILES.iter().zip(ASSETS.iter()).filter_map(|((path, ..), asset)| Some((place(path)?, asset)));
    placed.fold(Router::new(), |routes, (path, asset)| {
        routes.route(path, get(move |headers: HeaderMap| std::future::ready(asset.response(&headers))))
    })
}

impl Asset {
    fn response(&'static self, request: &HeaderMap) -> Response {
        let cached = [(header::ETAG, self.tag.as_str()), (header::VARY, "accept-encoding")];
        let caching = [(header::CACHE_CONTROL, REVALIDATE)];
        if listed(request, &header::IF_NONE_MATCH).any(|tag| tag == self.tag || tag == "*") {
            return (StatusCode::NOT_MODIFIED, cached, caching).into_response();
        }
        let kind = [(header::CONTENT_TYPE, self.kind)];
        if takes_gzip(request) && !self.gzip.is_empty() {
            let encoding = [(header::CONTENT_ENCODING, "gzip")];
            return (cached, caching, kind, encoding, self.gzip.as_slice()).into_response();
        }
        (cached, caching, kind, self.text).into_response()
    }
}

/// Whether a request accepts a response compressed by gzip.
pub(super) fn takes_gzip(request: &HeaderMap) -> bool {
    listed(request, &header::ACCEPT_ENCODING).any(accepts_gzip)
}

/// The comma-separated values of a header.
fn listed<'a>(headers: &'a HeaderMap, name: &header::HeaderName) -> impl Iterator<Item = &'a str> {
    let values = headers.get_all(name).into_iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).map(str::trim)
}

/// Whether an entry of `Accept-Encoding` is gzip with a weight above zero.
fn accepts_gzip(entry: &str) -> bool {
    let mut parts = entry.split(';').map(str::trim);
    parts.next().is_some_and(|name| name.eq_ignore_ascii_case("gzip"))
        && parts
            .filter_map(|part| part.strip_prefix("q="))
            .all(|weight| weight.parse::<f32>().is_ok_and(|q| q > 0.0))
}

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    // Writing to a vector cannot fail; without a compressed form the plain one is sent.
    encoder.write_all(text.as_bytes()).and_then(|()| encoder.finish()).unwrap_or_default()
}

fn tag(text: &str) -> String {
    let digits: String = Sha256::digest(text).iter().take(16).map(|byte| format!("{byte:02x}")).collect();
    format!("W/\"{digits}\"")
}

#[cfg(test)]
mod tests {
    use super::accepts_gzip;

    #[test]
    fn gzip_is_sent_only_where_it_is_accepted() {
        for entry in ["gzip", "GZIP", "gzip;q=0.5", "gzip; q=1"] {
            assert!(accepts_gzip(entry), "{entry}");
        }
        for entry in ["", "br", "gzip;q=0", "gzip;q=0.0", "identity", "xgzip"] {
            assert!(!accepts_gzip(entry), "{entry}");
        }
    }
}
