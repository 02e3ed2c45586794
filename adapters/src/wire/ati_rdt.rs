//! ATI Raw Data Transfer over UDP: a request of 8 bytes starts a stream of 36-byte records.
//!
//! Big-endian. Source: ATI Net F/T manual 9620-05-Net FT, "UDP interface using RDT". Replies go to the request's source
//! address and port; a later request of another client takes over the stream.

use super::reader::Reader;

/// The port of the device.
pub const DEFAULT_PORT: u16 = 49_152;
/// Bytes of a request.
pub const REQUEST_SIZE: usize = 8;
/// Bytes of a record.
pub const RECORD_SIZE: usize = 36;
const MAGIC: u16 = 0x1234;

/// Commands to the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Command {
    /// Stop streaming.
    Stop = 0x0000,
    /// Axia: one record in each datagram.
    StartSingleBlock = 0x0001,
    /// Net F/T: one record in each datagram, in real time.
    StartRealTime = 0x0002,
    /// Net F/T: several records in each datagram ("buffered"); Axia: "multi-block".
    StartBuffered = 0x0003,
    /// Several devices on one controller.
    StartMultiUnit = 0x0004,
    /// Clear the threshold latch.
    ResetThresholdLatch = 0x0041,
    /// Take the present load as zero.
    SetBias = 0x0042,
}

impl Command {
    const ALL: [Command; 7] = [
        Command::Stop,
        Command::StartSingleBlock,
        Command::StartRealTime,
        Command::StartBuffered,
        Command::StartMultiUnit,
        Command::ResetThresholdLatch,
        Command::SetBias,
    ];
}

/// A client's request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// The command.
    pub command: Command,
    /// Count of records to send; 0 for an endless stream.
    pub sample_count: u32,
}

impl Request {
    /// Encodes the request.
    pub fn to_bytes(self) -> [u8; REQUEST_SIZE] {
        let mut bytes = [0; REQUEST_SIZE];
        bytes[0..2].copy_from_slice(&MAGIC.to_be_bytes());
        bytes[2..4].copy_from_slice(&(self.command as u16).to_be_bytes());
        bytes[4..8].copy_from_slice(&self.sample_count.to_be_bytes());
        bytes
    }

    /// Parses a request, as a device does.
    ///
    /// # Errors
    /// A [`Malformed`] for another length, start or command.
    pub fn parse(bytes: &[u8]) -> Result<Request, Malformed> {
        let length = Malformed::Request { length: bytes.len() };
        let array: [u8; REQUEST_SIZE] = bytes.try_into().map_err(|_| length)?;
        let mut reader = Reader::new(&array);
        if reader.u16() != Some(MAGIC) {
            return Err(Malformed::NotRdt);
        }
        let number = reader.u16().ok_or(length)?;
        let command = Command::ALL
            .into_iter()
            .find(|command| *command as u16 == number)
            .ok_or(Malformed::UnknownCommand { number })?;
        Ok(Request { command, sample_count: reader.u32().ok_or(length)? })
    }
}

/// One sample of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record {
    /// Count of the records sent since the request; a gap is a loss in transit.
    pub rdt_sequence: u32,
    /// Count of the device's own measurements, sent or not: its clock.
    pub ft_sequence: u32,
    /// Zero if the sample is valid.
    pub status: u32,
    /// Force x, y, z on the sensor, counts.
    pub force_counts: [i32; 3],
    /// Torque x, y, z about the sensor's origin, counts.
    pub torque_counts: [i32; 3],
}

impl Record {
    /// Encodes the record, as a device does.
    pub fn to_bytes(self) -> [u8; RECORD_SIZE] {
        let mut bytes = [0; RECORD_SIZE];
        let words = [self.rdt_sequence, self.ft_sequence, self.status].map(u32::to_be_bytes);
        let counts = self.force_counts.into_iter().chain(self.torque_counts).map(i32::to_be_bytes);
        for (place, word) in bytes.chunks_exact_mut(4).zip(words.into_iter().chain(counts)) {
            place.copy_from_slice(&word);
        }
        bytes
    }

    fn read(reader: &mut Reader<'_>) -> Option<Record> {
        Some(Record {
            rdt_sequence: reader.u32()?,
            ft_sequence: reader.u32()?,
            status: reader.u32()?,
            force_counts: [reader.i32()?, reader.i32()?, reader.i32()?],
            torque_counts: [reader.i32()?, reader.i32()?, reader.i32()?],
        })
    }
}

/// The records of one datagram: one in real-time mode, several in buffered mode, oldest first.
#[derive(Debug, Clone, Copy)]
pub struct Records<'a> {
    reader: Reader<'a>,
}

impl<'a> Records<'a> {
    /// Parses one datagram.
    ///
    /// # Errors
    /// [`Malformed::Records`] unless it is a whole number of records, at least one.
    pub fn parse(bytes: &'a [u8]) -> Result<Records<'a>, Malformed> {
        if bytes.is_empty() || !bytes.len().is_multiple_of(RECORD_SIZE) {
            return Err(Malformed::Records { length: bytes.len() });
        }
        Ok(Records { reader: Reader::new(bytes) })
    }
}

impl Iterator for Records<'_> {
    type Item = Record;

    fn next(&mut self) -> Option<Record> {
        Record::read(&mut self.reader)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.reader.remaining() / RECORD_SIZE;
        (left, Some(left))
    }
}

impl ExactSizeIterator for Records<'_> {}

/// Why bytes are not RDT.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// Not a whole number of records.
    #[error("{length} bytes are not one or more RDT records of 36; something else sends to this port")]
    Records {
        /// Bytes received.
        length: usize,
    },
    /// Not the size of a request.
    #[error("{length} bytes are not an RDT request of 8")]
    Request {
        /// Bytes received.
        length: usize,
    },
    /// A request does not begin with 0x1234.
    #[error("the request does not begin with 0x1234")]
    NotRdt,
    /// An undefined command.
    #[error("RDT command {number:#06x} is not known")]
    UnknownCommand {
        /// The number sent.
        number: u16,
    },
}

// bytes    object (request)           bytes    object (record)
// 0–1      0x1234                     0–3      rdt_sequence u32
// 2–3      command u16                4–7      ft_sequence u32
// 4–7      sample_count u32           8–11     status u32
//                                     12–23    force_counts 3 × i32
//                                     24–35    torque_counts 3 × i32

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const VECTOR: [u8; RECORD_SIZE] = [
        0x00, 0x00, 0x03, 0xe8, 0x00, 0x01, 0xe2, 0x40, 0x00, 0x00, 0x00, 0x00, 0x00, 0x16, 0xe3, 0x60, 0xff,
        0xd9, 0xda, 0x60, 0x29, 0xbc, 0xf7, 0x90, 0xff, 0xff, 0xcf, 0x2c, 0x00, 0x00, 0x84, 0xd0, 0xff, 0xff,
        0xff, 0xff,
    ];

    #[test]
    fn the_known_record_is_read_and_written() {
        let record = Record {
            rdt_sequence: 1000,
            ft_sequence: 123_456,
            status: 0,
            force_counts: [1_500_000, -2_500_000, 700_250_000],
            torque_counts: [-12_500, 34_000, -1],
        };
        assert_eq!(Records::parse(&VECTOR).unwrap().collect::<Vec<_>>(), [record]);
        assert_eq!(record.to_bytes(), VECTOR);
        assert_eq!(Records::parse(&[VECTOR, VECTOR].concat()).unwrap().len(), 2);
        assert_eq!(Records::parse(&VECTOR[..35]).unwrap_err(), Malformed::Records { length: 35 });
        assert!(Records::parse(&[]).is_err());
    }

    #[test]
    fn the_known_requests_are_written() {
        let bytes = |command| Request { command, sample_count: 0 }.to_bytes();
        assert_eq!(bytes(Command::StartRealTime), [0x12, 0x34, 0, 2, 0, 0, 0, 0]);
        assert_eq!(bytes(Command::Stop), [0x12, 0x34, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes(Command::SetBias), [0x12, 0x34, 0, 0x42, 0, 0, 0, 0]);
        for command in Command::ALL {
            let request = Request { command, sample_count: 7 };
            assert_eq!(Request::parse(&request.to_bytes()), Ok(request));
        }
        assert_eq!(Request::parse(&[0; 8]), Err(Malformed::NotRdt));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(words in proptest::array::uniform3(any::<u32>()), counts in proptest::array::uniform6(any::<i32>())) {
            let record = Record {
                rdt_sequence: words[0], ft_sequence: words[1], status: words[2],
                force_counts: [counts[0], counts[1], counts[2]], torque_counts: [counts[3], counts[4], counts[5]],
            };
            prop_assert_eq!(Records::parse(&record.to_bytes()).unwrap().collect::<Vec<_>>(), vec![record]);
        }
    }
}
