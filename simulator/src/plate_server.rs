//! A force plate's RDT server: answers requests and streams records to the client of the last request.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use crate::faults::{FaultCounts, Faults, FaultyStream};
use crate::wires::ati_rdt::{Command, Family, Record, request};

/// Records of a datagram in the buffered mode.
const BUFFERED_RECORDS: usize = 10;

/// Client requests other than records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Take the present load as zero.
    SetBias,
}

/// The device's side of the RDT protocol. It has no thread: call [`PlateServer::poll`] and [`PlateServer::send`].
#[derive(Debug)]
pub struct PlateServer {
    address: SocketAddr,
    socket: Option<UdpSocket>,
    network: FaultyStream,
    client: Option<Client>,
    family: Family,
}

#[derive(Debug)]
struct Client {
    address: SocketAddr,
    /// Records still to be sent; `None` without limit.
    left: Option<u32>,
    rdt_sequence: u32,
    records_per_datagram: usize,
    waiting: Vec<u8>,
    waiting_records: usize,
}

impl PlateServer {
    /// Listens on an address (port 0: any free one).
    ///
    /// # Errors
    /// Those of the socket, for example that the address is taken.
    pub fn bind(address: SocketAddr, faults: Faults, seed: u64) -> io::Result<PlateServer> {
        let network = FaultyStream::new(faults, seed);
        let mut server = PlateServer { address, socket: None, network, client: None, family: Family::NetFt };
        server.plug()?;
        Ok(server)
    }

    /// Uses the command numbers of this family.
    #[must_use]
    pub fn of_family(self, family: Family) -> PlateServer {
        PlateServer { family, ..self }
    }

    /// The listening address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Closes the socket.
    pub fn unplug(&mut self) {
        self.socket = None;
        self.restart();
    }

    /// Opens the socket again at the same address.
    ///
    /// # Errors
    /// The address is taken by now.
    pub fn plug(&mut self) -> io::Result<()> {
        if self.socket.is_none() {
            let socket = UdpSocket::bind(self.address)?;
            socket.set_nonblocking(true)?;
            self.address = socket.local_addr()?;
            self.socket = Some(socket);
        }
        Ok(())
    }

    /// Replaces the faults from the next datagram on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.network.set_faults(faults);
    }

    /// Counters of the sent records.
    pub fn fault_counts(&self) -> FaultCounts {
        self.network.fault_counts()
    }

    /// Power cycle: drops its client.
    pub fn restart(&mut self) {
        self.client = None;
    }

    /// Whether a client has requested records.
    pub fn has_client(&self) -> bool {
        self.client.is_some()
    }

    /// Processes all received requests; a later client takes the stream from an earlier one.
    pub fn poll(&mut self) -> Option<Request> {
        let mut requested = None;
        let mut bytes = [0; 64];
        // An error is either "no data" or an echo of a departed client: no action in both cases.
        while let Some(Ok((length, address))) =
            self.socket.as_ref().map(|socket| socket.recv_from(&mut bytes))
        {
            // A real device ignores unknown requests.
            let Some((command, count)) = request(&bytes[..length], self.family) else { continue };
            match command {
                Command::Stop => self.client = None,
                Command::StreamBlocks => self.start(address, count, BUFFERED_RECORDS),
                Command::Stream => self.start(address, count, 1),
                Command::Bias => requested = Some(Request::SetBias),
                Command::ResetLatch => {}
            }
        }
        requested
    }

    fn start(&mut self, address: SocketAddr, sample_count: u32, records_per_datagram: usize) {
        self.client = Some(Client {
            address,
            left: (sample_count > 0).then_some(sample_count),
            rdt_sequence: 0,
            records_per_datagram,
            waiting: Vec::new(),
            waiting_records: 0,
        });
    }

    /// Sends a record, numbered for the client; does nothing without one.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn send(&mut self, record: Record) -> io::Result<()> {
        let (Some(client), Some(socket)) = (&mut self.client, &self.socket) else { return Ok(()) };
        client.rdt_sequence = client.rdt_sequence.wrapping_add(1);
        let record = Record { rdt_sequence: client.rdt_sequence, ..record };
        client.waiting.extend_from_slice(&record.to_bytes());
        client.waiting_records += 1;
        client.left = client.left.map(|left| left - 1);
        let done = client.left == Some(0);
        if done || client.waiting_records >= client.records_per_datagram {
            let datagram = std::mem::take(&mut client.waiting);
            let records = std::mem::take(&mut client.waiting_records) as u32;
            for datagram in self.network.datagrams(&datagram, records) {
                match socket.send_to(&datagram, client.address) {
                    // No listener: irrelevant for a sensor.
                    Err(error) if error.kind() != io::ErrorKind::ConnectionRefused => return Err(error),
                    _ => {}
                }
            }
        }
        if done {
            self.client = None;
        }
        Ok(())
    }
}
