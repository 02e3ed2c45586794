//! Xsens MVN's network streamer: big-endian datagrams of a 24-byte header and a payload of one type.
//!
//! After the network streaming specification, revision N, except where real datagrams differ: type 02 in metres, a
//! datagram with fingers in one piece, null poses with a datagram counter without an end mark.

pub mod describe;
pub mod items;

/// MVN's default destination port: 9 X 6 M 3 E.
pub const DEFAULT_PORT: u16 = 9763;
/// Length of the header.
pub const HEADER_LEN: usize = 24;
/// The datagram counter of a sample's only datagram.
pub const ONLY_DATAGRAM: u8 = 0x80;

/// A payload beyond 65 535 bytes or 255 items, which the header cannot represent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{items} items in {bytes} bytes do not fit a datagram of MVN")]
pub struct TooLong {
    /// Items.
    pub items: usize,
    /// Bytes of the payload.
    pub bytes: usize,
}

/// Header fields of every sample datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// +1 for every sample of the suit.
    pub sample_counter: u32,
    /// Milliseconds of the suit's clock.
    pub time_code_ms: u32,
    /// Character; tracked objects are numbered after the people.
    pub avatar: u8,
    /// Body segments (23; 0 before MVN 2019), props and finger segments (0 or 40).
    pub segments: [u8; 3],
}

impl Stamp {
    /// That of a body without props and fingers.
    pub fn of_a_body(sample_counter: u32, time_code_ms: u32, avatar: u8) -> Stamp {
        Stamp { sample_counter, time_code_ms, avatar, segments: [23, 0, 0] }
    }

    /// A datagram: `kind` is the type's two digits, `counter` the datagram's number in the sample, with the highest bit
    /// on the last.
    ///
    /// # Errors
    /// [`TooLong`].
    pub fn datagram(
        &self,
        kind: &[u8; 2],
        counter: u8,
        items: usize,
        payload: &[u8],
    ) -> Result<Vec<u8>, TooLong> {
        let too_long = TooLong { items, bytes: payload.len() };
        let mut bytes = Vec::with_capacity(HEADER_LEN + payload.len());
        bytes.extend_from_slice(b"MXTP");
        bytes.extend_from_slice(kind);
        bytes.extend_from_slice(&self.sample_counter.to_be_bytes());
        bytes.push(counter);
        bytes.push(u8::try_from(items).map_err(|_| too_long)?);
        bytes.extend_from_slice(&self.time_code_ms.to_be_bytes());
        bytes.push(self.avatar);
        bytes.extend_from_slice(&self.segments);
        bytes.extend_from_slice(&[0; 2]);
        bytes.extend_from_slice(&u16::try_from(payload.len()).map_err(|_| too_long)?.to_be_bytes());
        bytes.extend_from_slice(payload);
        Ok(bytes)
    }
}

/// Numbers in wire format.
fn floats(out: &mut Vec<u8>, numbers: &[f32]) {
    for number in numbers {
        out.extend_from_slice(&number.to_be_bytes());
    }
}

/// A length and a text, without a terminator.
fn text(out: &mut Vec<u8>, text: &str) {
    out.extend_from_slice(&(text.len() as u32).to_be_bytes());
    out.extend_from_slice(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_is_that_of_a_real_datagram() {
        // Sample 6681 at 27 837 ms, sent by a real MVN.
        let stamp = Stamp::of_a_body(6681, 27_837, 0);
        let bytes = stamp.datagram(b"01", ONLY_DATAGRAM, 23, &[0; 644]).unwrap();
        let expected = *b"MXTP01\x00\x00\x1a\x19\x80\x17\x00\x00\x6c\xbd\x00\x17\x00\x00\x00\x00\x02\x84";
        assert_eq!(bytes[..HEADER_LEN], expected);
        assert_eq!(bytes.len(), 668);
    }

    #[test]
    fn what_the_header_cannot_say_is_not_sent() {
        let stamp = Stamp::of_a_body(0, 0, 0);
        assert!(stamp.datagram(b"02", ONLY_DATAGRAM, 256, &[]).is_err());
        assert!(stamp.datagram(b"02", ONLY_DATAGRAM, 1, &[0; 65_536]).is_err());
    }
}
