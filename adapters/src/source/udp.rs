//! UDP socket whose datagrams have the kernel's receive stamp.

use super::error::SourceError;
use crate::clock::{StampTranslator, now_monotonic_ns};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{
    ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt, sockopt::RcvBuf,
    sockopt::ReceiveTimestampns,
};
use nix::sys::time::TimeSpec;
use std::io::{self, IoSliceMut};
use std::net::{IpAddr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::AsRawFd;
use std::time::Duration;

/// Maximum size of a UDP datagram.
const BUFFER_SIZE: usize = 65_536;
/// Requested receive buffer; the kernel grants at most `net.core.rmem_max`. One second of all types is about 1 MB.
const KERNEL_BUFFER_SIZE: usize = 4 << 20;

/// Admitted senders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Senders {
    /// Only this computer.
    Loopback,
    /// Only this address.
    Only(IpAddr),
    /// Any sender that can reach the socket.
    Anyone,
}

impl Senders {
    /// Whether a sender is admitted.
    pub fn admit(self, sender: IpAddr) -> bool {
        match self {
            Senders::Loopback => sender.is_loopback(),
            Senders::Only(address) => sender == address,
            Senders::Anyone => true,
        }
    }
}

/// Restricts a port to one sender, as two would corrupt each other's samples. Only accepted samples reserve it; a stray
/// datagram does not lock out the device.
#[derive(Debug, Clone, Copy, Default)]
pub struct OneSender {
    /// Sender of the last accepted sample, and its time.
    holder: Option<(IpAddr, u64)>,
}

impl OneSender {
    /// The port is released if no sample was accepted for this long; far above the gaps of a radio link.
    const HOLDS_NS: u64 = 1_000_000_000;

    /// Whether a datagram of `sender` that arrived at `arrival_ns` is to be read: no other sender holds the port.
    pub fn admits(&self, sender: IpAddr, arrival_ns: u64) -> bool {
        let holds = |last_ns: u64| arrival_ns.saturating_sub(last_ns) < Self::HOLDS_NS;
        self.holder.is_none_or(|(holder, last_ns)| holder == sender || !holds(last_ns))
    }

    /// A sample of `sender` was accepted, whose datagram arrived at `arrival_ns`: reserves the port.
    pub fn hold(&mut self, sender: IpAddr, arrival_ns: u64) {
        self.holder = Some((sender, arrival_ns));
    }

    /// Whether no other sender holds the port.
    pub fn may_be(&self, peer: IpAddr) -> bool {
        self.holder.is_none_or(|(holder, _)| holder == peer)
    }
}

/// One datagram.
#[derive(Debug, Clone, Copy)]
pub struct Received<'a> {
    /// The datagram.
    pub bytes: &'a [u8],
    /// The sender.
    pub sender: SocketAddr,
    /// Whether the sender is admitted. If not, `bytes` must not be used.
    pub admitted: bool,
    /// The kernel's receive stamp, CLOCK_MONOTONIC.
    pub arrival_ns: u64,
}

/// The socket and its buffers.
#[derive(Debug)]
pub struct StampedUdpSocket {
    socket: UdpSocket,
    local: SocketAddr,
    key: &'static str,
    senders: Senders,
    stamps: StampTranslator,
    buffer: Box<[u8]>,
    control: Vec<u8>,
}

impl StampedUdpSocket {
    /// Listens on an address. `timeout` bounds each [`Self::receive`]; `key` is the configuration key for errors.
    ///
    /// # Errors
    /// [`SourceError::PortTaken`] or [`SourceError::Open`].
    pub fn open(
        address: SocketAddr,
        senders: Senders,
        timeout: Duration,
        key: &'static str,
    ) -> Result<StampedUdpSocket, SourceError> {
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::AddrInUse => SourceError::PortTaken { port: address.port(), address, key },
            _ => SourceError::Open { address, key, error },
        };
        let socket = UdpSocket::bind(address).map_err(failed)?;
        // A timeout of zero would block forever.
        socket.set_read_timeout(Some(timeout.max(Duration::from_micros(1)))).map_err(failed)?;
        setsockopt(&socket, ReceiveTimestampns, &true).map_err(|errno| failed(errno.into()))?;
        setsockopt(&socket, RcvBuf, &KERNEL_BUFFER_SIZE).map_err(|errno| failed(errno.into()))?;
        let local = socket.local_addr().map_err(failed)?;
        let mut stamps = StampTranslator::default();
        stamps.monotonic_ns(0);
        Ok(StampedUdpSocket {
            socket,
            local,
            key,
            senders,
            stamps,
            buffer: vec![0; BUFFER_SIZE].into_boxed_slice(),
            control: cmsg_space!(TimeSpec),
        })
    }

    /// The local address, with the port that the system chose if 0 was requested.
    pub fn local_address(&self) -> SocketAddr {
        self.local
    }

    /// Waits for one datagram; `None` after the timeout.
    ///
    /// # Errors
    /// [`SourceError::Receive`] if the socket itself fails.
    pub fn receive(&mut self) -> Result<Option<Received<'_>>, SourceError> {
        let mut slices = [IoSliceMut::new(&mut self.buffer)];
        let message = recvmsg::<SockaddrStorage>(
            self.socket.as_raw_fd(),
            &mut slices,
            Some(&mut self.control),
            MsgFlags::empty(),
        );
        let (length, sender, stamp_ns) = match message {
            Ok(message) => {
                let stamp_ns =
                    message.cmsgs().ok().and_then(|mut messages| messages.find_map(kernel_stamp_ns));
                (message.bytes, message.address.as_ref().and_then(socket_address), stamp_ns)
            }
            // A timeout, a signal, or an ICMP reply that a device is absent: no data yet.
            Err(Errno::EAGAIN | Errno::EINTR | Errno::ECONNREFUSED) => return Ok(None),
            Err(errno) => return Err(SourceError::Receive { address: self.local, error: errno.into() }),
        };
        let Some(sender) = sender else {
            // Every datagram has a sender. Repeated empty results without one mean that the socket was shut down.
            let error = io::Error::new(io::ErrorKind::NotConnected, "the socket was shut down from outside");
            return Err(SourceError::Receive { address: self.local, error });
        };
        let arrival_ns = match stamp_ns {
            Some(stamp_ns) => self.stamps.monotonic_ns(stamp_ns),
            None => now_monotonic_ns(),
        };
        let bytes = self.buffer.get(..length).unwrap_or_default();
        Ok(Some(Received { bytes, sender, admitted: self.senders.admit(sender.ip()), arrival_ns }))
    }

    /// Sends to a device.
    ///
    /// # Errors
    /// [`SourceError::Send`].
    pub fn send_to(&self, bytes: &[u8], address: SocketAddr) -> Result<(), SourceError> {
        match self.socket.send_to(bytes, address) {
            Ok(_) => Ok(()),
            Err(error) => Err(SourceError::Send { address, key: self.key, error }),
        }
    }
}

fn kernel_stamp_ns(message: ControlMessageOwned) -> Option<u64> {
    match message {
        ControlMessageOwned::ScmTimestampns(stamp) => u64::try_from(Duration::from(stamp).as_nanos()).ok(),
        _ => None,
    }
}

fn socket_address(address: &SockaddrStorage) -> Option<SocketAddr> {
    if let Some(v4) = address.as_sockaddr_in() {
        return Some(SocketAddr::new(IpAddr::V4(v4.ip()), v4.port()));
    }
    let v6 = address.as_sockaddr_in6()?;
    let ip: Ipv6Addr = v6.ip();
    // A dual-stack socket reports IPv4 senders in mapped form.
    Some(SocketAddr::new(ip.to_canonical(), v6.port()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loopback(senders: Senders) -> StampedUdpSocket {
        StampedUdpSocket::open(
            "127.0.0.1:0".parse().unwrap(),
            senders,
            Duration::from_millis(200),
            "suit.listen",
        )
        .unwrap()
    }

    #[test]
    fn a_datagram_carries_its_arrival_and_its_sender() {
        let mut socket = loopback(Senders::Loopback);
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let local = sender.local_addr().unwrap();
        // The kernel starts stamping some time after the first socket requests it; until then it stamps on reading.
        let is_stamped_on_arrival = || {
            let before_ns = now_monotonic_ns();
            sender.send_to(b"hello", socket.local_address()).unwrap();
            std::thread::sleep(Duration::from_millis(30));
            let read_ns = now_monotonic_ns();
            let received = socket.receive().unwrap().unwrap();
            assert_eq!((received.bytes, received.sender, received.admitted), (&b"hello"[..], local, true));
            assert!(received.arrival_ns >= before_ns);
            received.arrival_ns < read_ns
        };
        assert!(std::iter::repeat_with(is_stamped_on_arrival).take(100).any(|stamped| stamped), "only ours");
        assert!(socket.receive().unwrap().is_none());
    }

    #[test]
    fn a_port_is_held_by_accepted_samples_until_there_are_none() {
        let [one, other] = ["192.0.2.1", "192.0.2.2"].map(|ip| ip.parse::<IpAddr>().unwrap());
        let mut sender = OneSender::default();
        // Sender, time, whether the datagram is a sample, and whether it is admitted: noise twice a second never
        // reserves the port.
        let datagrams = [
            (other, 0, false, true),
            (one, 10, true, true),
            (other, 500, false, false),
            (one, 900, true, true),
            (one, 1500, false, true),
            (other, 1800, true, false),
            (other, 1950, true, true),
            (one, 2000, true, false),
        ];
        for (ip, ms, is_sample, admitted) in datagrams {
            assert_eq!(sender.admits(ip, ms * 1_000_000), admitted, "{ip} at {ms} ms");
            if admitted && is_sample {
                sender.hold(ip, ms * 1_000_000);
            }
        }
        assert!(sender.may_be(other) && !sender.may_be(one));
    }

    #[test]
    fn a_taken_port_is_named() {
        let socket = loopback(Senders::Loopback);
        let error = StampedUdpSocket::open(
            socket.local_address(),
            Senders::Loopback,
            Duration::from_millis(1),
            "suit.listen",
        )
        .unwrap_err();
        let text = error.to_string();
        assert!(text.contains(&format!("port {} is taken", socket.local_address().port())), "{text}");
        assert!(text.contains("set suit.listen"), "{text}");
    }

    #[test]
    fn a_socket_that_was_shut_down_is_an_error_and_not_an_endless_stream_of_nothing() {
        let mut socket = loopback(Senders::Loopback);
        use nix::sys::socket::{Shutdown, shutdown};
        // The kernel returns "not connected", but shuts the socket down.
        let _ = shutdown(socket.socket.as_raw_fd(), Shutdown::Both);
        let error = socket.receive().unwrap_err();
        assert!(error.to_string().contains("was shut down from outside"), "{error}");
    }

    #[test]
    fn other_senders_are_distinguished() {
        assert!(!Senders::Loopback.admit("192.168.1.4".parse().unwrap()));
        assert!(Senders::Loopback.admit("::1".parse().unwrap()));
        assert!(Senders::Anyone.admit("192.168.1.4".parse().unwrap()));
        let mut socket = loopback(Senders::Only("127.0.0.9".parse().unwrap()));
        UdpSocket::bind("127.0.0.1:0").unwrap().send_to(b"x", socket.local_address()).unwrap();
        assert!(!socket.receive().unwrap().unwrap().admitted);
    }
}
