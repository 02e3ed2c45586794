//! Crafts the files: small on disk, huge by their declared sizes. Written by the formats' specifications, not by a
//! library.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Maximum content of a zstd block (RFC 8878, section 3.1.1.2.4), with the window written below.
const BLOCK_BYTES: usize = 128 << 10;

/// The content of a chunk as a zstd frame (RFC 8878): runs of one byte are blocks of four bytes.
#[derive(Default)]
pub(crate) struct Chunk {
    /// Kind, length and content of every block.
    blocks: Vec<(u32, u32, Vec<u8>)>,
    length: usize,
}

impl Chunk {
    fn raw(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(BLOCK_BYTES) {
            self.blocks.push((0, part.len() as u32, part.to_vec()));
        }
        self.length += bytes.len();
    }

    pub(crate) fn repeat(&mut self, byte: u8, count: usize) {
        for from in (0..count).step_by(BLOCK_BYTES) {
            self.blocks.push((1, BLOCK_BYTES.min(count - from) as u32, vec![byte]));
        }
        self.length += count;
    }

    /// A schema with a text of this length.
    pub(crate) fn schema(&mut self, id: u16, text_bytes: usize) {
        let mut body = id.to_le_bytes().to_vec();
        body.extend(text("n"));
        body.extend(text("ros1msg"));
        body.extend((text_bytes as u32).to_le_bytes());
        self.raw(&record_head(0x03, body.len() + text_bytes));
        self.raw(&body);
        self.repeat(b' ', text_bytes);
    }

    /// A channel with a topic of this length.
    pub(crate) fn channel(&mut self, id: u16, topic_bytes: usize) {
        let mut begin = id.to_le_bytes().to_vec();
        begin.extend([0, 0]);
        begin.extend((topic_bytes as u32).to_le_bytes());
        let end = [text("ros1"), vec![0; 4]].concat();
        self.raw(&record_head(0x04, begin.len() + topic_bytes + end.len()));
        self.raw(&begin);
        self.repeat(b'a', topic_bytes);
        self.raw(&end);
    }

    pub(crate) fn channel_named(&mut self, id: u16, topic: &str) {
        let body = [id.to_le_bytes().to_vec(), vec![0, 0], text(topic), text("ros1"), vec![0; 4]].concat();
        self.raw(&record_head(0x04, body.len()));
        self.raw(&body);
    }

    /// This number of empty messages of a channel.
    pub(crate) fn messages(&mut self, channel: u16, count: usize) {
        let body = [channel.to_le_bytes().to_vec(), vec![0; 20]].concat();
        let message = [record_head(0x05, body.len()), body].concat();
        self.raw(&message.repeat(count));
    }

    fn frame(&self) -> Vec<u8> {
        // No size, no checksum; a window of 128 KiB.
        let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x38];
        for (index, (kind, length, content)) in self.blocks.iter().enumerate() {
            let last = u32::from(index + 1 == self.blocks.len());
            frame.extend(&(last | kind << 1 | length << 3).to_le_bytes()[..3]);
            frame.extend(content);
        }
        frame
    }
}

/// An MCAP file (mcap.dev/spec).
pub(crate) struct Mcap(BufWriter<File>);

impl Mcap {
    pub(crate) fn create(path: &Path) -> Mcap {
        let mut file = BufWriter::new(File::create(path).unwrap());
        file.write_all(MCAP_MAGIC).unwrap();
        Mcap(file)
    }

    /// Marks it as an Equipoise file, by an embedded configuration.
    pub(crate) fn our_head(&mut self) {
        let config = "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \"external\"\n\
                      [subject]\nid = \"anon-1\"\nheight_m = 1.7\n";
        self.attachment_of("config.toml", config.len(), |file| file.write_all(config.as_bytes()).unwrap());
    }

    pub(crate) fn chunk(&mut self, chunk: &Chunk) {
        self.chunk_that_claims(chunk, chunk.length);
    }

    pub(crate) fn chunk_that_claims(&mut self, chunk: &Chunk, length: usize) {
        let frame = chunk.frame();
        let mut body = vec![0; 16];
        body.extend((length as u64).to_le_bytes());
        body.extend([0; 4]);
        body.extend(text("zstd"));
        body.extend((frame.len() as u64).to_le_bytes());
        body.extend(frame);
        self.0.write_all(&record_head(0x06, body.len())).unwrap();
        self.0.write_all(&body).unwrap();
    }

    /// An attachment of this many zeros, sparse on disk.
    pub(crate) fn attachment(&mut self, name: &str, length: usize) {
        self.attachment_of(name, length, |file| {
            file.seek(SeekFrom::Current(length as i64)).unwrap();
        });
    }

    fn attachment_of(&mut self, name: &str, length: usize, content: impl FnOnce(&mut BufWriter<File>)) {
        let begin =
            [vec![0; 16], text(name), text("application/toml"), (length as u64).to_le_bytes().to_vec()];
        let begin = begin.concat();
        self.0.write_all(&record_head(0x09, begin.len() + length + 4)).unwrap();
        self.0.write_all(&begin).unwrap();
        content(&mut self.0);
        self.0.write_all(&[0; 4]).unwrap();
    }

    pub(crate) fn end(mut self) {
        self.0.write_all(&record_head(0x02, 20)).unwrap();
        self.0.write_all(&[0; 20]).unwrap();
        self.0.write_all(MCAP_MAGIC).unwrap();
        self.0.flush().unwrap();
    }
}

fn record_head(opcode: u8, length: usize) -> Vec<u8> {
    [vec![opcode], (length as u64).to_le_bytes().to_vec()].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// A network capture of raw IP packets (draft-gharris-opsawg-pcap).
pub(crate) struct Pcap(BufWriter<File>);

impl Pcap {
    pub(crate) fn create(path: &Path) -> Pcap {
        let mut file = BufWriter::new(File::create(path).unwrap());
        for word in [0xa1b2_c3d4_u32, 0x0004_0002, 0, 0, 262_144, 101] {
            file.write_all(&word.to_le_bytes()).unwrap();
        }
        Pcap(file)
    }

    fn packet_head(&mut self, length: usize) {
        for word in [1, 0, length as u32, length as u32] {
            self.0.write_all(&word.to_le_bytes()).unwrap();
        }
    }

    /// A packet of zeros, sparse on disk.
    pub(crate) fn packet_of_nothing(&mut self, length: usize) {
        self.packet_head(length);
        self.0.seek(SeekFrom::Current(length as i64)).unwrap();
    }

    /// The last fragment of a datagram of 64 KiB whose other fragments never arrive (RFC 791).
    pub(crate) fn last_fragment(&mut self, number: u32) {
        // 8 bytes at 65512, nothing after them. A different sender each time: no two belong to one datagram.
        self.fragment(number, 65_512 / 8, 1);
    }

    /// A fragment of one datagram, with others to follow: from this multiple of 8 bytes on, of this many.
    pub(crate) fn inner_fragment(&mut self, at: u16, eights: u16) {
        const MORE_FRAGMENTS: u16 = 0x2000;
        self.fragment(0, MORE_FRAGMENTS | at, eights);
    }

    fn fragment(&mut self, number: u32, flags_and_offset: u16, eights: u16) {
        let mut packet = vec![0x45, 0];
        packet.extend((20 + 8 * eights).to_be_bytes());
        packet.extend(&number.to_be_bytes()[2..]);
        packet.extend(flags_and_offset.to_be_bytes());
        packet.extend([64, 17, 0, 0, 10, 0]);
        packet.extend(&number.to_be_bytes()[1..3]);
        packet.extend([10, 1, 0, 1]);
        packet.resize(packet.len() + 8 * usize::from(eights), 0);
        self.packet_head(packet.len());
        self.0.write_all(&packet).unwrap();
    }

    pub(crate) fn end(mut self) {
        // Extends the file over the sparse bytes at the end.
        let length = self.0.stream_position().unwrap();
        self.0.get_mut().set_len(length).unwrap();
    }

    /// A pcapng file that is one block of an unknown type.
    pub(crate) fn one_block_of(path: &Path, length: usize) {
        let mut file = File::create(path).unwrap();
        // The section header.
        for word in [0x0a0d_0d0a_u32, 28, 0x1a2b_3c4d, 1, u32::MAX, u32::MAX, 28, 0x0bad_0bad, length as u32]
        {
            file.write_all(&word.to_le_bytes()).unwrap();
        }
        file.set_len(28 + length as u64).unwrap();
    }
}
