//! Who may ask, and what a browser may do with the answer.

use std::net::IpAddr;

use axum::extract::Request;
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Everything the page needs comes from here, and nothing on it may be framed, posted or evaluated.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
     connect-src 'self'; img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const ANSWER_HEADERS: [(HeaderName, HeaderValue); 6] = [
    (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(CONTENT_SECURITY_POLICY)),
    (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
    (header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY")),
    (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
    (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
    (HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin")),
];

/// Answers only requests that name loopback as their host: a name that an attacker's DNS points here is refused.
pub(crate) async fn loopback_only(request: Request, next: Next) -> Response {
    let mut response = if names_loopback(request.headers(), request.uri()) {
        next.run(request).await
    } else {
        let sentence = "This page answers only to localhost, 127.0.0.1 or [::1].\n";
        (StatusCode::FORBIDDEN, sentence).into_response()
    };
    response.headers_mut().extend(ANSWER_HEADERS);
    response
}

fn names_loopback(headers: &HeaderMap, uri: &Uri) -> bool {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (Some(host), None) = (hosts.next(), hosts.next()) else { return false };
    host.to_str().is_ok_and(is_loopback) && uri.host().is_none_or(is_loopback)
}

/// Whether `host`, with or without a port, is this machine by name or by number.
fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => match rest.split_once(']') {
            Some((address, port)) if port.is_empty() || port.starts_with(':') => address,
            _ => return false,
        },
        None => host.split_once(':').map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::is_loopback;

    #[test]
    fn loopback_by_name_or_number_with_any_port() {
        for host in ["localhost", "LOCALHOST:8080", "127.0.0.1", "127.0.0.1:1", "[::1]", "[::1]:9000"] {
            assert!(is_loopback(host), "{host}");
        }
    }

    #[test]
    fn anything_else_is_somebody_elses_name() {
        for host in ["", ":80", "evil.example", "127.0.0.1.evil.example", "localhost.evil.example:80", "[::1"]
            .into_iter()
            .chain(["[::1]evil", "192.168.1.5", "0.0.0.0", "[::]:80", "localhost@evil.example"])
        {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
