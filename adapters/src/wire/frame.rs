//! Binary frames with a configured layout: start, length, required values, and positions of the numbers.
//!
//! Only the format is defined here; the caller interprets the numbers. Where no frame is found, a stream advances by
//! one byte, as an apparent start may be inside a frame ([`Frames`]).

mod number;
mod stream;

pub use number::{Endian, Number, NumberPosition};
pub use stream::{Frames, StreamElement};

use super::checksum::Checksum;

/// Maximum length of a frame.
pub const FRAME_BYTES_MAX: usize = 64 * 1024;

/// The format of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameForm {
    /// Initial bytes of every frame; empty for none.
    pub sync: Vec<u8>,
    /// Length of the frame.
    pub length: Length,
    /// Fields with required values: tags that are distributed over the frame.
    pub tags: Vec<Tag>,
    /// Field that identifies a valid frame as the kind to be read.
    pub kind: Option<Tag>,
    /// The frame's checksum.
    pub checksum: Option<ChecksumField>,
}

/// Total length of a frame, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// Constant length.
    Fixed(usize),
    /// A length field: `plus` bytes more than its value, at most `most`.
    InHead {
        /// Position of the field.
        place: NumberPosition,
        /// Bytes that the field does not count.
        plus: usize,
        /// The maximum length.
        most: usize,
    },
}

/// A field that must have one of these values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tag {
    /// Position of the field.
    pub place: NumberPosition,
    /// The values, masked and not shifted.
    pub values: Vec<u64>,
}

/// Range of a checksum, and its position. Negative positions count from the frame's end.
#[derive(Debug, Clone, PartialEq)]
pub struct ChecksumField {
    /// The algorithm.
    pub checksum: Checksum,
    /// First byte of the range …
    pub from: i32,
    /// … and its end, exclusive.
    pub to: i32,
    /// Position of the checksum.
    pub at: i32,
    /// Byte order of the checksum.
    pub endian: Endian,
}

/// Result of parsing the beginning of some bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameMatch<'a> {
    /// More bytes are needed.
    TooFew,
    /// A complete frame.
    Frame(&'a [u8]),
    /// A valid frame of another kind.
    Other(&'a [u8]),
    /// No frame.
    Nothing,
}

/// Why a format is invalid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FormFault {
    /// The length is zero or too large.
    #[error("a frame has 1 to {FRAME_BYTES_MAX} bytes")]
    Length,
    /// The length field is not within every frame.
    #[error("the length must stand within the first bytes of a frame, counted from its beginning")]
    LengthPlace,
    /// The checksum's range is outside the frame, empty, or includes the checksum itself.
    #[error("the checksum must be of bytes of the frame, and not of its own")]
    Checksum,
    /// A position beyond the frame.
    #[error("it stands beyond the frame, which has {0} bytes")]
    Beyond(usize),
    /// Nothing identifies a frame.
    #[error("without sync, tags and checksum any bytes are a frame, and a stream has no beginning")]
    Unmarked,
}

impl FrameForm {
    /// Length of the shortest frame.
    pub fn least(&self) -> usize {
        match self.length {
            Length::Fixed(bytes) => bytes,
            // The length field counts the rest of the frame; sync and the field itself are always present.
            Length::InHead { place, plus, .. } => {
                place.end(0).unwrap_or(usize::MAX).max(self.sync.len()).max(plus)
            }
        }
    }

    /// Length of the longest frame.
    pub fn most(&self) -> usize {
        match self.length {
            Length::Fixed(bytes) => bytes,
            Length::InHead { most, .. } => most,
        }
    }

    /// Whether frames can be distinguished from other bytes.
    pub fn is_marked(&self) -> bool {
        !self.sync.is_empty() || !self.tags.is_empty() || self.checksum.is_some()
    }

    /// Whether a field is within a frame: every frame of constant length, or the longest one of variable length.
    ///
    /// # Errors
    /// [`FormFault::Beyond`].
    pub fn check_place(&self, place: NumberPosition) -> Result<(), FormFault> {
        let most = self.most();
        match place.range(most) {
            Some(_) => Ok(()),
            None => Err(FormFault::Beyond(most)),
        }
    }

    /// Validates the format. `stream`: frames must be found among other bytes.
    ///
    /// # Errors
    /// [`FormFault`].
    pub fn check(&self, stream: bool) -> Result<(), FormFault> {
        if let Length::InHead { place, .. } = self.length
            && (place.at < 0 || matches!(place.number, Number::F32 | Number::F64))
        {
            return Err(FormFault::LengthPlace);
        }
        let (least, most) = (self.least(), self.most());
        if least == 0 || most > FRAME_BYTES_MAX || least > most || self.sync.len() > least {
            return Err(FormFault::Length);
        }
        if stream && !self.is_marked() {
            return Err(FormFault::Unmarked);
        }
        for tag in self.tags.iter().chain(&self.kind) {
            self.check_place(tag.place)?;
        }
        match &self.checksum {
            Some(summed) if summed.parts(&vec![0; most]).is_none() => Err(FormFault::Checksum),
            _ => Ok(()),
        }
    }

    /// Parses the beginning of these bytes.
    pub fn match_start<'a>(&self, bytes: &'a [u8]) -> FrameMatch<'a> {
        let Some(head) = bytes.get(..self.least()) else { return FrameMatch::TooFew };
        if !head.starts_with(&self.sync) {
            return FrameMatch::Nothing;
        }
        let length = match self.length {
            Length::Fixed(length) => length,
            Length::InHead { place, plus, most } => {
                let declared = place.raw(head).and_then(|declared| usize::try_from(declared).ok());
                match declared.and_then(|declared| declared.checked_add(plus)) {
                    Some(length) if (self.least()..=most).contains(&length) => length,
                    _ => return FrameMatch::Nothing,
                }
            }
        };
        let Some(frame) = bytes.get(..length) else { return FrameMatch::TooFew };
        let is_sound = self.tags.iter().all(|tag| tag.fits(frame))
            && self.checksum.as_ref().is_none_or(|summed| summed.fits(frame));
        match (is_sound, &self.kind) {
            (false, _) => FrameMatch::Nothing,
            (true, Some(kind)) if !kind.fits(frame) => FrameMatch::Other(frame),
            (true, _) => FrameMatch::Frame(frame),
        }
    }

    /// Whether these bytes begin like a frame whose damage its checksum reveals.
    pub fn begins_damaged(&self, bytes: &[u8]) -> bool {
        self.checksum.is_some() && bytes.starts_with(&self.sync)
    }
}

impl Tag {
    /// Whether the field has one of the values.
    pub fn fits(&self, frame: &[u8]) -> bool {
        self.place.masked(frame).is_some_and(|value| self.values.contains(&value))
    }
}

impl ChecksumField {
    fn fits(&self, frame: &[u8]) -> bool {
        self.parts(frame).is_some_and(|(of, stands)| self.checksum.of(of) == self.endian.number(stands))
    }

    /// The range of the checksum, and the checksum's bytes.
    fn parts<'a>(&self, frame: &'a [u8]) -> Option<(&'a [u8], &'a [u8])> {
        let from = number::index(self.from, frame.len())?;
        // A `to` of 0 is the frame's end: 0 bytes before it.
        let to = if self.to == 0 { frame.len() } else { number::index(self.to, frame.len())? };
        let at = number::index(self.at, frame.len())?;
        let stands = frame.get(at..at.checked_add(self.checksum.bytes())?)?;
        let overlap = at < to && from < at + self.checksum.bytes();
        let of = frame.get(from..to)?;
        (!overlap && !of.is_empty()).then_some((of, stands))
    }
}

#[cfg(test)]
mod tests;
