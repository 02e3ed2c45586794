//! Access control, and security headers of responses.

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{Html, IntoResponse, Response};

use super::token::Token;

/// Maximum length of a request's path and query; the longest one of the page contains a token.
const TARGET_BYTES_MAX: usize = 1024;

/// All resources come from this server; framing, forms and evaluated scripts are forbidden.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
     connect-src 'self'; img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A report is one file with inline styles and drawings; scripts and requests are forbidden.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const ANSWER_HEADERS: [(HeaderName, HeaderValue); 5] = [
    (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(CONTENT_SECURITY_POLICY)),
    (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
    (header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY")),
    (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
    (HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin")),
];

/// Paths at which a browser exchanges the token for the cookie.
const PAGES: [&str; 2] = ["/", "/engineer"];
const TOKEN_MISSING: &str = "This page needs its token: open it once with ?token=TOKEN at the end of its address, or \
                             send Authorization: Bearer TOKEN.\n";
const TOKEN_WRONG: &str =
    "The token is wrong. `equipoise token` creates one; the page reads it from its token file.\n";

/// Access rules of the page.
#[derive(Debug, Clone)]
pub(crate) struct Access {
    /// Require loopback as the request's host; refuses a name that an attacker's DNS resolves to this machine (DNS
    /// rebinding).
    pub(crate) loopback_only: bool,
    /// Require this token.
    pub(crate) token: Option<Token>,
    /// Part of the cookie's name: cookies are not separated by port, so two pages on one PC need different names.
    pub(crate) port: u16,
}

/// Checks access, and adds security headers to every response.
pub(crate) async fn guard(State(access): State<Access>, request: Request, next: Next) -> Response {
    let is_report = request.uri().path() == "/report";
    let mut response = match access.refusal(&request) {
        Some(refusal) => refusal,
        None => next.run(request).await,
    };
    response.headers_mut().extend(ANSWER_HEADERS);
    // Only the pages' own files may be stored: they have a tag.
    if !response.headers().contains_key(header::ETAG) {
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    if is_report {
        response
            .headers_mut()
            .insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(REPORT_POLICY));
    }
    response
}

impl Access {
    /// The refusal of a request; `None` if it is permitted.
    fn refusal(&self, request: &Request) -> Option<Response> {
        let refused = |status: StatusCode, sentence: &'static str| Some((status, sentence).into_response());
        if target_bytes(request.uri()) > TARGET_BYTES_MAX {
            return refused(StatusCode::URI_TOO_LONG, "No address of this page is that long.\n");
        }
        if has_body(request.headers()) {
            return refused(StatusCode::PAYLOAD_TOO_LARGE, "This page accepts no request body: send none.\n");
        }
        if self.loopback_only && !names_loopback(request.headers(), request.uri()) {
            return refused(
                StatusCode::FORBIDDEN,
                "This page answers only to localhost, 127.0.0.1 or [::1].\n",
            );
        }
        let token = self.token.as_ref()?;
        if self.brings(token, request.headers()) {
            return None;
        }
        match token_of(request.uri()) {
            Some(given) if token.is_secret(given) => Some(self.welcome(token, request.uri().path())),
            Some(_) => Some(unauthorised(TOKEN_WRONG)),
            None if request.headers().contains_key(header::AUTHORIZATION) => Some(unauthorised(TOKEN_WRONG)),
            None => Some(unauthorised(TOKEN_MISSING)),
        }
    }

    fn brings(&self, token: &Token, headers: &HeaderMap) -> bool {
        let bearer = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
        if bearer.and_then(|value| value.strip_prefix("Bearer ")).is_some_and(|given| token.is_secret(given))
        {
            return true;
        }
        let name = self.cookie_name();
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        cookies
            .flat_map(|cookies| cookies.split(';'))
            .filter_map(|cookie| cookie.trim().split_once('='))
            .any(|(cookie, value)| cookie == name && token.is_cookie(value))
    }

    fn cookie_name(&self) -> String {
        format!("equipoise_page_{}", self.port)
    }

    /// Sets the cookie and reloads the page without the token in its address.
    ///
    /// Uses a page with a refresh instead of a redirect: after a click in an e-mail, a redirect would still count as
    /// cross-site, and the browser would not send the SameSite cookie.
    fn welcome(&self, token: &Token, path: &str) -> Response {
        let cookie =
            format!("{}={}; Path=/; HttpOnly; SameSite=Strict", self.cookie_name(), token.cookie_value());
        let page = format!(
            "<!doctype html><title>Equipoise</title><meta http-equiv=\"refresh\" content=\"0; url={path}\">\
             <p><a href=\"{path}\">To the page</a>"
        );
        ([(header::SET_COOKIE, cookie)], Html(page)).into_response()
    }
}

fn unauthorised(sentence: &'static str) -> Response {
    (StatusCode::UNAUTHORIZED, [(header::WWW_AUTHENTICATE, "Bearer realm=\"equipoise\"")], sentence)
        .into_response()
}

/// The token in a URL; accepted for the two pages only.
fn token_of(uri: &Uri) -> Option<&str> {
    let query = uri.query().filter(|_| PAGES.contains(&uri.path()))?;
    query.split('&').find_map(|pair| pair.strip_prefix("token="))
}

fn target_bytes(uri: &Uri) -> usize {
    uri.path_and_query().map_or(0, |target| target.as_str().len())
}

fn has_body(headers: &HeaderMap) -> bool {
    let length = headers.get(header::CONTENT_LENGTH);
    headers.contains_key(header::TRANSFER_ENCODING) || length.is_some_and(|length| length != "0")
}

fn names_loopback(headers: &HeaderMap, uri: &Uri) -> bool {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (Some(host), None) = (hosts.next(), hosts.next()) else { return false };
    host.to_str().is_ok_and(is_loopback) && uri.host().is_none_or(is_loopback)
}

/// Whether `host`, with or without a port, is this machine's loopback name or address.
fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => match rest.split_once(']') {
            Some((address, port)) if port.is_empty() || port.strip_prefix(':').is_some_and(is_port) => {
                address
            }
            _ => return false,
        },
        None => match host.split_once(':') {
            Some((name, port)) if is_port(port) => name,
            Some(_) => return false,
            None => host,
        },
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// Any port is accepted, because a tunnel has another port than the page.
fn is_port(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_digit()) && text.parse::<u16>().is_ok_and(|port| port > 0)
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
    fn a_port_is_a_number_that_a_port_can_have() {
        for port in ["", "0", "65536", "80evil", "+80", "-1", "80:80", " 80", "evil.example"] {
            for host in ["localhost", "127.0.0.1", "[::1]"] {
                assert!(!is_loopback(&format!("{host}:{port}")), "{host}:{port}");
            }
        }
        assert!(is_loopback("localhost:65535") && is_loopback("[::1]:1"));
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
