//! One connection to the broker, as an MQTT 3.1.1 client that publishes only.
//!
//! Quality of service 1 with one message in flight: only the broker's acknowledgement distinguishes a working
//! connection from a blocked one. Duplicates are harmless, because every message contains the complete current values.
//! Packets are encoded and decoded by rumqttc.

use std::io::{self, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::BytesMut;
use crossbeam_channel::bounded;
use equipoise_files::secret::{self, Login, SecretError};
use equipoise_files::{TEXT_BYTES_MAX, read_text};
use equipoise_gateways::config::MqttConfig;
use rumqttc::{Connect, ConnectReturnCode, LastWill, Packet, PubAck, Publish, QoS};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, InvalidDnsNameError, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use crate::timed::Timed;

/// Time limit for each answer of the broker, and for resolving its name, connecting to its addresses, TLS and CONNACK
/// together.
pub const PATIENCE: Duration = Duration::from_secs(5);
/// Largest accepted packet; the broker's answers take a few bytes.
const PACKET_MAX: usize = 256 * 1024;
/// Retained message: whether the gateway is connected. The broker publishes `offline` itself when the connection breaks
/// (last will).
const ONLINE: &str = "online";
const OFFLINE: &str = "offline";

/// Why the connection failed.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// Name resolution, TCP or TLS failed.
    #[error("the broker cannot be reached: {0}")]
    Io(#[from] io::Error),
    /// The broker refused the connection.
    #[error("the broker refuses the connection: {0:?}; look at its users and rights")]
    Refused(ConnectReturnCode),
    /// The broker's answer is not valid MQTT 3.1.1.
    #[error("the broker's answer is not understood: {0}")]
    Answer(String),
}

/// Connection parameters, equal for all connections.
pub struct Target {
    broker: String,
    port: u16,
    tls: Option<(Arc<ClientConfig>, ServerName<'static>)>,
    login: Option<Login>,
    client_id: String,
    online_topic: String,
    keep_alive_s: u16,
}

/// Why certificates or passwords cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// A certificate file or the key is invalid.
    #[error("{path}: {what}; a PEM file is wanted")]
    Pem {
        /// Path of the file.
        path: String,
        /// What is wrong with it.
        what: String,
    },
    /// The password or key file cannot be used.
    #[error(transparent)]
    Secret(#[from] SecretError),
    /// The broker's name is not a valid server name.
    #[error("gateways.mqtt.broker: {0}")]
    Name(#[from] InvalidDnsNameError),
    /// Certificate and key do not match.
    #[error("gateways.mqtt.certificate_file: {0}")]
    Tls(#[from] rustls::Error),
}

impl Target {
    /// Reads passwords, certificates and key.
    ///
    /// # Errors
    /// One of the files cannot be used.
    pub fn new(station: &str, config: &MqttConfig) -> Result<Target, TargetError> {
        let login = config.password_file.as_deref().map(secret::logins).transpose()?;
        let tls = config.ca_file.as_deref().map(|ca_file| tls(ca_file, config)).transpose()?;
        Ok(Target {
            broker: config.broker.clone(),
            port: config.port(),
            tls,
            login: login.and_then(|logins| logins.into_iter().next()),
            client_id: format!("equipoise-{station}"),
            online_topic: format!("equipoise/{station}/online"),
            // Messages serve as keep-alive: three periods, at least 10 s.
            keep_alive_s: (3.0 / config.rate_hz).ceil().max(10.0) as u16,
        })
    }
}

fn tls(ca_file: &Path, config: &MqttConfig) -> Result<(Arc<ClientConfig>, ServerName<'static>), TargetError> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(ca_file)? {
        roots.add(certificate)?;
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots);
    let client = match (&config.certificate_file, &config.key_file) {
        (Some(own), Some(key_file)) => {
            let key = PrivateKeyDer::from_pem_slice(secret::read(key_file)?.as_bytes());
            let key = key.map_err(|error| pem(key_file, error.to_string()))?;
            builder.with_client_auth_cert(certificates(own)?, key)?
        }
        _ => builder.with_no_client_auth(),
    };
    Ok((Arc::new(client), ServerName::try_from(config.broker.clone())?))
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TargetError> {
    let text = read_text(path, TEXT_BYTES_MAX).map_err(|error| pem(path, error.to_string()))?;
    let all = CertificateDer::pem_slice_iter(text.as_bytes()).collect::<Result<Vec<_>, _>>();
    let all = all.map_err(|error| pem(path, error.to_string()))?;
    if all.is_empty() {
        return Err(pem(path, "there is no certificate in it".to_owned()));
    }
    Ok(all)
}

fn pem(path: &Path, what: String) -> TargetError {
    TargetError::Pem { path: path.display().to_string(), what }
}

enum Stream {
    Plain(Timed),
    Tls(Box<StreamOwned<ClientConnection, Timed>>),
}

impl Stream {
    fn timed(&mut self) -> &mut Timed {
        match self {
            Stream::Plain(timed) => timed,
            Stream::Tls(stream) => &mut stream.sock,
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Stream::Plain(stream) => stream.write_all(bytes),
            Stream::Tls(stream) => stream.write_all(bytes).and_then(|()| stream.flush()),
        }
    }

    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        match self {
            Stream::Plain(stream) => stream.read(to),
            Stream::Tls(stream) => stream.read(to),
        }
    }
}

/// A connection that the broker has accepted.
pub struct Session {
    stream: Stream,
    unread: BytesMut,
    packet_id: u16,
    online_topic: String,
}

impl Session {
    /// Connects, registers the last will, and publishes `online`.
    ///
    /// # Errors
    /// The connection failed, or the broker refused it.
    pub fn open(target: &Target) -> Result<Session, SessionError> {
        let deadline = Instant::now() + PATIENCE;
        let timed = Timed::new(connect(target, deadline)?, deadline);
        let stream = match &target.tls {
            None => Stream::Plain(timed),
            Some((config, name)) => {
                let connection = ClientConnection::new(Arc::clone(config), name.clone());
                let connection = connection.map_err(io::Error::other)?;
                Stream::Tls(Box::new(StreamOwned::new(connection, timed)))
            }
        };
        let online_topic = target.online_topic.clone();
        let mut session = Session { stream, unread: BytesMut::new(), packet_id: 0, online_topic };
        session.introduce(target)?;
        session.publish_online(ONLINE)?;
        Ok(session)
    }

    fn introduce(&mut self, target: &Target) -> Result<(), SessionError> {
        let mut hello = Connect::new(&target.client_id);
        hello.keep_alive = target.keep_alive_s;
        hello.last_will = Some(LastWill::new(&target.online_topic, OFFLINE, QoS::AtLeastOnce, true));
        if let Some(login) = &target.login {
            hello.set_login(&login.name, &login.password);
        }
        self.send(&Packet::Connect(hello))?;
        match self.receive()? {
            Packet::ConnAck(answer) if answer.code == ConnectReturnCode::Success => Ok(()),
            Packet::ConnAck(answer) => Err(SessionError::Refused(answer.code)),
            other => Err(SessionError::Answer(format!("{other:?}"))),
        }
    }

    /// Publishes a message, and waits for the broker's acknowledgement.
    ///
    /// # Errors
    /// No acknowledgement in time; the connection must be dropped.
    pub fn publish(&mut self, topic: &str, payload: Vec<u8>) -> Result<(), SessionError> {
        self.publish_as(topic, payload, false)
    }

    fn publish_as(&mut self, topic: &str, payload: Vec<u8>, retain: bool) -> Result<(), SessionError> {
        self.stream.timed().allow(PATIENCE);
        self.packet_id = self.packet_id.checked_add(1).unwrap_or(1);
        let mut message = Publish::new(topic, QoS::AtLeastOnce, payload);
        (message.pkid, message.retain) = (self.packet_id, retain);
        self.send(&Packet::Publish(message))?;
        loop {
            if self.receive()? == Packet::PubAck(PubAck::new(self.packet_id)) {
                return Ok(());
            }
        }
    }

    fn publish_online(&mut self, online: &str) -> Result<(), SessionError> {
        let topic = self.online_topic.clone();
        self.publish_as(&topic, online.as_bytes().to_vec(), true)
    }

    /// Publishes `offline` and disconnects. After an orderly disconnect the broker discards the last will, so `offline`
    /// must be published explicitly.
    ///
    /// # Errors
    /// `offline` was not acknowledged; the broker then publishes the last will.
    pub fn close(mut self) -> Result<(), SessionError> {
        self.publish_online(OFFLINE)?;
        self.send(&Packet::Disconnect)
    }

    fn send(&mut self, packet: &Packet) -> Result<(), SessionError> {
        let mut bytes = BytesMut::new();
        packet.write(&mut bytes, usize::MAX).map_err(|error| SessionError::Answer(error.to_string()))?;
        Ok(self.stream.write_all(&bytes)?)
    }

    fn receive(&mut self) -> Result<Packet, SessionError> {
        loop {
            match Packet::read(&mut self.unread, PACKET_MAX) {
                Ok(packet) => return Ok(packet),
                Err(rumqttc::Error::InsufficientBytes(_)) => {}
                Err(error) => return Err(SessionError::Answer(error.to_string())),
            }
            let mut read = [0; 1024];
            match self.stream.read(&mut read)? {
                0 => return Err(io::Error::from(io::ErrorKind::ConnectionReset).into()),
                count => self.unread.extend_from_slice(&read[..count]),
            }
        }
    }
}

fn connect(target: &Target, deadline: Instant) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the broker's name has no address");
    for address in addresses(&target.broker, target.port, deadline)? {
        match TcpStream::connect_timeout(&address, left(deadline)?) {
            Ok(socket) => {
                socket.set_nodelay(true)?;
                return Ok(socket);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Resolves a name. The system's resolver has no time-out, so it runs in a thread; a late one is abandoned and ends by
/// itself.
fn addresses(broker: &str, port: u16, deadline: Instant) -> io::Result<Vec<SocketAddr>> {
    if let Ok(ip) = broker.parse::<IpAddr>() {
        return Ok(vec![SocketAddr::new(ip, port)]);
    }
    let name = (broker.to_owned(), port);
    answer_until(deadline, move || name.to_socket_addrs().map(Iterator::collect))
}

fn answer_until<T: Send + 'static>(
    deadline: Instant,
    ask: impl FnOnce() -> io::Result<T> + Send + 'static,
) -> io::Result<T> {
    let (sender, receiver) = bounded(1);
    std::thread::Builder::new().name("mqtt name".to_owned()).spawn(move || {
        // Sending fails if the caller has timed out.
        let _ = sender.send(ask());
    })?;
    let late = |_| io::Error::new(io::ErrorKind::TimedOut, "its name is not answered for in time");
    receiver.recv_timeout(left(deadline)?).map_err(late)?
}

fn left(deadline: Instant) -> io::Result<Duration> {
    let left = deadline.saturating_duration_since(Instant::now());
    if left.is_zero() { Err(io::Error::new(io::ErrorKind::TimedOut, "no answer in time")) } else { Ok(left) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unanswered_name_lookup_ends_at_the_deadline() {
        let (_never, asked) = bounded::<io::Result<()>>(0);
        let deadline = Instant::now() + Duration::from_millis(50);
        let error = answer_until(deadline, move || asked.recv().map_err(io::Error::other)).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert!(left(deadline).is_err(), "the deadline is over for the addresses, too");
        let found = addresses("localhost", 1883, Instant::now() + Duration::from_secs(90)).unwrap();
        assert!(found.iter().all(|address| address.ip().is_loopback() && address.port() == 1883));
        assert!(!found.is_empty());
    }
}
