//! A minimal HTTP server, as in a small device: one request, one response, close.

use std::io;
use std::net::SocketAddr;

use super::port::Port;
use super::tcp::TcpPort;

/// Maximum size of a request, bytes.
const REQUEST_MAX: usize = 1 << 16;

/// A request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// `GET`, `POST`.
    pub method: String,
    /// The path, without the query string.
    pub path: String,
    /// The body.
    pub body: String,
}

/// The server.
#[derive(Debug)]
pub struct HttpPort {
    port: TcpPort,
    session: u64,
    received: Vec<u8>,
}

impl HttpPort {
    /// Listens on an address (port 0: any free one).
    ///
    /// # Errors
    /// Those of the socket.
    pub fn bind(address: SocketAddr) -> io::Result<HttpPort> {
        Ok(HttpPort { port: TcpPort::bind(address)?, session: 0, received: Vec::new() })
    }

    /// The listening address.
    pub fn address(&self) -> SocketAddr {
        self.port.address()
    }

    /// The next request, once complete; [`Self::answer`] answers it.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn request(&mut self) -> io::Result<Option<Request>> {
        let bytes = self.port.receive()?;
        if self.port.session() != self.session {
            self.session = self.port.session();
            self.received.clear();
        }
        self.received.extend(bytes);
        let request = parsed(&self.received);
        if request.is_some() {
            self.received.clear();
        } else if self.received.len() > REQUEST_MAX {
            self.port.hang_up();
        }
        Ok(request)
    }

    /// Answers and closes.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn answer(&mut self, status: &str, kind: &str, body: &str) -> io::Result<()> {
        let head = format!(
            "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            body.len()
        );
        self.port.write((head + body).as_bytes())?;
        self.port.hang_up();
        Ok(())
    }

    /// Its connection.
    pub fn port(&mut self) -> &mut TcpPort {
        &mut self.port
    }

    /// As [`Port::config`].
    pub fn config(&self) -> [String; 2] {
        self.port.config()
    }
}

/// Parses a complete request.
fn parsed(received: &[u8]) -> Option<Request> {
    let end = received.windows(4).position(|four| four == b"\r\n\r\n")?;
    let head = String::from_utf8_lossy(&received[..end]).into_owned();
    let length: usize = head
        .lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(key, _)| key.eq_ignore_ascii_case("content-length"))
        .map_or(Some(0), |(_, value)| value.trim().parse().ok())?;
    let body = received.get(end + 4..end + 4 + length)?;
    let mut words = head.split_whitespace();
    let (method, target) = (words.next()?.to_owned(), words.next()?);
    let path = target.split('?').next().unwrap_or(target).to_owned();
    Some(Request { method, path, body: String::from_utf8_lossy(body).into_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_taken_once_its_body_is_there() {
        let whole = b"POST /api/x?y=1 HTTP/1.1\r\nHost: a\r\ncontent-length: 4\r\n\r\n{ } ";
        assert_eq!(parsed(&whole[..whole.len() - 1]), None);
        let expected = Request { method: "POST".into(), path: "/api/x".into(), body: "{ } ".into() };
        assert_eq!(parsed(whole), Some(expected));
        assert_eq!(parsed(b"GET / HTTP/1.0\r\n\r\n").unwrap().body, "");
    }
}
