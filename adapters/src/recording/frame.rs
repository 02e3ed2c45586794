//! The frames of an MCAP file: positions of records, and contents of chunks. No length in the file is trusted.

use mcap::McapError;
use mcap::read::parse_record;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// The frame of a record: opcode, then the length of the body, little-endian.
pub(super) const RECORD_HEAD_BYTES: usize = 1 + 8;
/// A chunk or record with a larger declared size is damaged (own chunks have some 4 MiB).
pub(super) const RECORD_BYTES_MAX: usize = 64 << 20;
/// A chunk that decompresses to more is a decompression bomb, or exceeds a station's memory (own chunks have some 4
/// MiB).
const UNPACKED_BYTES_MAX: u64 = 32 << 20;
/// A chunk's header without the name of its compression.
const CHUNK_HEAD_BYTES: u64 = 8 + 8 + 8 + 4 + 4 + 8;

/// End of the record at `at` by its frame; `None` if the position overflows.
pub(super) fn record_end(at: usize, head: &[u8; RECORD_HEAD_BYTES]) -> Option<usize> {
    let [_, length @ ..] = *head;
    let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
    at.checked_add(RECORD_HEAD_BYTES)?.checked_add(length)
}

/// Parses the body of a record with mcap; `None` for kinds that are not needed for a recording's messages.
///
/// # Errors
/// The fault as text.
pub(super) fn parse(opcode: u8, body: &[u8]) -> Result<Option<Record<'_>>, String> {
    use Part::{Bytes, Map, Text};
    let parts: &[Part] = match opcode {
        op::SCHEMA => &[Bytes(2), Text, Text, Bytes(4)],
        op::CHANNEL => &[Bytes(4), Text, Text, Map],
        op::MESSAGE => &[Bytes(22)],
        op::CHUNK => &[Bytes(28), Text, Bytes(8)],
        op::ATTACHMENT => &[Bytes(16), Text, Text, Bytes(8 + 4)],
        op::METADATA => &[Text, Map],
        _ => return Ok(None),
    };
    // mcap 0.26 allocates the declared length before it checks that the data exist.
    if parts.iter().try_fold(0, |at, part| part.end(body, at)).is_none() {
        return Err("a text longer than its record".to_owned());
    }
    parse_record(opcode, body).map(Some).map_err(|error| error.to_string())
}

/// A part of a record's body (mcap.dev/spec).
enum Part {
    Bytes(usize),
    /// A length of 4 bytes, followed by that many bytes.
    Text,
    /// A length of 4 bytes, followed by texts of that total length.
    Map,
}

impl Part {
    /// End of the part that begins at `at`; `None` if it is beyond the body.
    fn end(&self, body: &[u8], at: usize) -> Option<usize> {
        let counted = || {
            let length = body.get(at..)?.first_chunk::<4>()?;
            at.checked_add(4)?.checked_add(u32::from_le_bytes(*length) as usize)
        };
        let end = match self {
            Part::Bytes(length) => at.checked_add(*length),
            Part::Text | Part::Map => counted(),
        };
        let end = end.filter(|end| *end <= body.len())?;
        if let Part::Map = self {
            let mut text = at + 4;
            while text < end {
                text = Part::Text.end(&body[..end], text)?;
            }
        }
        Some(end)
    }
}

/// Passes every record of a chunk to `take`, after verifying the chunk's checksum.
///
/// `record` is the complete chunk record with its frame.
///
/// # Errors
/// The error of `take`, or the result of `damaged` for the fault's text.
pub(super) fn unpack_chunk<E>(
    record: &[u8],
    damaged: impl Fn(String) -> E,
    mut take: impl FnMut(u8, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let body = record.get(RECORD_HEAD_BYTES..).unwrap_or_default();
    match parse(op::CHUNK, body) {
        Ok(Some(Record::Chunk { header, .. })) => {
            let head_bytes = CHUNK_HEAD_BYTES + header.compression.len() as u64;
            // mcap 0.26 has an unchecked subtraction if bytes follow an uncompressed chunk's data.
            if head_bytes.checked_add(header.compressed_size) != Some(body.len() as u64) {
                return Err(damaged("a chunk of another size than its record".to_owned()));
            }
            if header.uncompressed_size > UNPACKED_BYTES_MAX {
                let bytes = header.uncompressed_size;
                return Err(damaged(format!("a chunk of {bytes} bytes, the most is {UNPACKED_BYTES_MAX}")));
            }
        }
        Ok(_) => return Err(damaged("no chunk".to_owned())),
        Err(reason) => return Err(damaged(reason)),
    }
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES_MAX),
    );
    let failed = |error: McapError| damaged(error.to_string());
    let mut rest = record;
    while let Some(event) = reader.next_event() {
        match event.map_err(failed)? {
            LinearReadEvent::ReadRequest(_) if rest.is_empty() => break,
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { data, opcode } => take(opcode, data)?,
        }
    }
    Ok(())
}
