//! A force plate's RDT server: answers requests and streams records to the client of the last request.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use crate::faults::{Faults, FaultySender, Suffered};
use crate::wires::ati_rdt::{Command, Family, Record, request};

/// Records of a datagram in the buffered mode.
const BUFFERED_RECORDS: usize = 10;

/// What a client wants besides records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// Take the present load as zero.
    SetBias,
}

/// The device's side of the RDT protocol. It has no thread: call [`PlateServer::poll`] and [`PlateServer::send`].
#[derive(Debug)]
pub struct PlateServer {
    socket: UdpSocket,
    network: FaultySender,
    client: Option<Client>,
    family: Family,
}

#[derive(Debug)]
struct Client {
    address: SocketAddr,
    /// Records still to send; `None` without end.
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
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        Ok(PlateServer {
            socket,
            network: FaultySender::new(faults, seed),
            client: None,
            family: Family::NetFt,
        })
    }

    /// It numbers its commands as this family does.
    #[must_use]
    pub fn of_family(self, family: Family) -> PlateServer {
        PlateServer { family, ..self }
    }

    /// Where it listens.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// The network is another from the next datagram on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.network.set_faults(faults);
    }

    /// What became of what was sent.
    pub fn suffered(&self) -> Suffered {
        self.network.suffered()
    }

    /// The device is switched off and on: it knows no client any more.
    pub fn restart(&mut self) {
        self.client = None;
    }

    /// Whether anybody wants records.
    pub fn has_client(&self) -> bool {
        self.client.is_some()
    }

    /// Takes in all requests that have come; a later client takes the stream from an earlier one.
    pub fn poll(&mut self) -> Option<Wish> {
        let mut wish = None;
        let mut bytes = [0; 64];
        // An error is either "nothing there" or an echo of a client that has gone: nothing to do in both cases.
        while let Ok((length, address)) = self.socket.recv_from(&mut bytes) {
            // A real device ignores what it does not understand.
            let Some((command, count)) = request(&bytes[..length], self.family) else { continue };
            match command {
                Command::Stop => self.client = None,
                Command::StreamBlocks => self.start(address, count, BUFFERED_RECORDS),
                Command::Stream => self.start(address, count, 1),
                Command::Bias => wish = Some(Wish::SetBias),
                Command::ResetLatch => {}
            }
        }
        wish
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

    /// Sends a record, numbered for the client; nothing happens without one.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn send(&mut self, record: Record) -> io::Result<()> {
        let Some(client) = &mut self.client else { return Ok(()) };
        client.rdt_sequence = client.rdt_sequence.wrapping_add(1);
        let record = Record { rdt_sequence: client.rdt_sequence, ..record };
        client.waiting.extend_from_slice(&record.to_bytes());
        client.waiting_records += 1;
        client.left = client.left.map(|left| left - 1);
        let done = client.left == Some(0);
        if done || client.waiting_records >= client.records_per_datagram {
            let datagram = std::mem::take(&mut client.waiting);
            let records = std::mem::take(&mut client.waiting_records) as u32;
            self.network.send_samples(&self.socket, &datagram, records, client.address)?;
        }
        if done {
            self.client = None;
        }
        Ok(())
    }
}
