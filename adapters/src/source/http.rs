//! Requests over HTTP on the local network (a device's settings, a station's page): one request, one bounded answer, no
//! state.

use std::io;
use std::time::Duration;
use ureq::config::Config;
use ureq::http::Response;
use ureq::{Agent, Body, Error};

/// A device with a slower answer counts as absent: the daemon's shutdown waits for pending requests.
const TIMEOUT: Duration = Duration::from_secs(2);
/// Settings have some kilobytes; a longer answer is not the requested one.
const BYTES_MAX: u64 = 1 << 20;

/// A device's answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// The HTTP status, 200 for success. Devices signal errors by it, with details in the text.
    pub status: u16,
    /// The body; invalid UTF-8 is replaced.
    pub text: String,
}

/// HTTP client without proxy, redirects, cookies or any state between requests.
#[derive(Debug, Clone)]
pub struct HttpClient {
    agent: Agent,
}

impl Default for HttpClient {
    fn default() -> Self {
        HttpClient::new()
    }
}

impl HttpClient {
    /// A client whose requests end within two seconds.
    pub fn new() -> HttpClient {
        let config = Config::builder()
            .timeout_global(Some(TIMEOUT))
            // A configured proxy would leave the local network, and devices have no reason to redirect.
            .proxy(None)
            .max_redirects(0)
            .max_redirects_will_error(false)
            .http_status_as_error(false)
            .max_idle_connections(0)
            .user_agent("equipoise")
            .build();
        HttpClient { agent: config.new_agent() }
    }

    /// `GET url`.
    ///
    /// # Errors
    /// No connection, no answer in time, an answer that is too long or not HTTP.
    pub fn get(&self, url: &str) -> io::Result<Answer> {
        answer(self.agent.get(url).call())
    }

    /// `GET url` with `Authorization: Bearer TOKEN`.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub fn get_with_token(&self, url: &str, token: &str) -> io::Result<Answer> {
        answer(self.agent.get(url).header("authorization", format!("Bearer {token}")).call())
    }

    /// `POST url` with a body of JSON.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub fn post_json(&self, url: &str, body: &str) -> io::Result<Answer> {
        answer(self.agent.post(url).content_type("application/json").send(body))
    }
}

fn answer(response: Result<Response<Body>, Error>) -> io::Result<Answer> {
    let mut response = response.map_err(in_words)?;
    let status = response.status().as_u16();
    let bytes = response.body_mut().with_config().limit(BYTES_MAX).read_to_vec().map_err(in_words)?;
    Ok(Answer { status, text: String::from_utf8_lossy(&bytes).into_owned() })
}

fn in_words(error: Error) -> io::Error {
    match error {
        Error::Io(error) => error,
        Error::Timeout(_) => {
            io::Error::new(io::ErrorKind::TimedOut, format!("no answer within {} s", TIMEOUT.as_secs()))
        }
        Error::BodyExceedsLimit(limit) => {
            io::Error::other(format!("the answer is longer than {limit} bytes"))
        }
        other => io::Error::other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpListener;
    use std::thread::{self, JoinHandle};

    /// Answers one request with these bytes and returns the request.
    fn device(answer: Vec<u8>) -> (String, JoinHandle<String>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/page.xml", listener.local_addr().unwrap());
        let serving = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut asked = Vec::new();
            let mut piece = [0; 4096];
            // The header, and the body of the tests' POST requests.
            while !asked.ends_with(if asked.starts_with(b"POST") { b"}".as_slice() } else { b"\r\n\r\n" }) {
                let count = stream.read(&mut piece).unwrap();
                asked.extend_from_slice(&piece[..count]);
            }
            // The client may close the connection in the middle of an answer that is too long.
            let _gone = stream.write_all(&answer);
            String::from_utf8(asked).unwrap()
        });
        (url, serving)
    }

    fn page(status: &str, body: &[u8]) -> Vec<u8> {
        let head = format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\n\r\n", body.len());
        [head.as_bytes(), body].concat()
    }

    #[test]
    fn a_page_is_read_and_a_refusal_keeps_its_words() {
        let (url, serving) = device(page("200 OK", b"<a>\xb0C</a>"));
        let answer = HttpClient::new().get(&url).unwrap();
        assert_eq!((answer.status, answer.text.as_str()), (200, "<a>\u{fffd}C</a>"));
        assert!(serving.join().unwrap().starts_with("GET /page.xml HTTP/1.1\r\n"));

        let (url, serving) = device(page("400 Bad Request", b"no such measurement"));
        let answer = HttpClient::new().post_json(&url, "{\"id\":1}").unwrap();
        assert_eq!((answer.status, answer.text.as_str()), (400, "no such measurement"));
        let asked = serving.join().unwrap();
        assert!(asked.starts_with("POST ") && asked.ends_with("\r\n\r\n{\"id\":1}"), "{asked}");
        assert!(asked.to_lowercase().contains("content-type: application/json"), "{asked}");
    }

    #[test]
    fn redirects_are_not_followed() {
        let (url, serving) = device(
            b"HTTP/1.1 302 Found\r\nLocation: http://192.0.2.1/\r\nContent-Length: 0\r\n\r\n".to_vec(),
        );
        assert_eq!(HttpClient::new().get(&url).unwrap().status, 302);
        serving.join().unwrap();
    }

    #[test]
    fn too_much_too_little_and_nothing_end_with_a_reason() {
        let (url, serving) = device(page("200 OK", &vec![b'a'; BYTES_MAX as usize + 1]));
        let error = HttpClient::new().get(&url).unwrap_err();
        assert!(error.to_string().contains("longer than 1048576 bytes"), "{error}");
        serving.join().unwrap();

        let (url, serving) = device(b"MXTP02".to_vec());
        assert!(HttpClient::new().get(&url).is_err());
        serving.join().unwrap();

        let silent = TcpListener::bind("127.0.0.1:0").unwrap();
        let error = HttpClient::new().get(&format!("http://{}/", silent.local_addr().unwrap())).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert_eq!(error.to_string(), "no answer within 2 s");
    }
}
