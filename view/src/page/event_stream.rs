//! Event streams: at most so many events a second, compressed for clients that accept it.

use std::convert::Infallible;
use std::io::{self, Write as _};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use flate2::Compression;
use flate2::write::GzEncoder;
use tokio_stream::{Stream, StreamExt};

use super::FRAME_RATE_HZ;
use super::assets::takes_gzip;

/// The time between two events that a query `hz=RATE` asks for; `None` without a valid rate below that of the frames.
pub(super) fn interval_of(query: Option<&str>) -> Option<Duration> {
    let rate_hz = query?.split('&').find_map(|pair| pair.strip_prefix("hz="))?.parse::<u32>().ok()?;
    (1..FRAME_RATE_HZ).contains(&rate_hz).then(|| Duration::from_secs(1) / rate_hz)
}

/// The response with these events.
pub(super) fn response(
    request: &HeaderMap,
    events: impl Stream<Item = Result<Event, Infallible>> + Send + 'static,
) -> Response {
    let response = Sse::new(events).into_response();
    if takes_gzip(request) { compressed(response) } else { response }
}

/// Compresses each event against the preceding ones, which differ from it in few bytes, and sends it at once.
fn compressed(response: Response) -> Response {
    let (mut parts, body) = response.into_parts();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    let chunks = body.into_data_stream().map(move |chunk| {
        encoder.write_all(&chunk.map_err(io::Error::other)?)?;
        encoder.flush()?;
        Ok::<_, io::Error>(Bytes::from(std::mem::take(encoder.get_mut())))
    });
    parts.headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    parts.headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
    Response::from_parts(parts, Body::from_stream(chunks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_below_that_of_the_frames_is_a_time_between_events() {
        assert_eq!(interval_of(Some("a=1&hz=10")), Some(Duration::from_millis(100)));
        for query in ["", "hz=", "hz=0", "hz=60", "hz=-1", "hz=x", "10"] {
            assert_eq!(interval_of(Some(query)), None, "{query}");
        }
        assert_eq!(interval_of(None), None);
    }
}
