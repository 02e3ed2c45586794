//! Binary frames by a description: where a frame begins, how long it is, what must stand in it, and where its numbers are.
//!
//! Only the form is known here; what a number means, its reader knows. Where no frame is, a stream goes on by one byte:
//! what looks like a beginning may stand within a frame ([`Frames`]).

mod number;
mod stream;

pub use number::{Endian, Number, Place};
pub use stream::{Found, Frames};

use super::checksum::Checksum;

/// No frame is longer.
pub const FRAME_BYTES_MAX: usize = 64 * 1024;

/// The form of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameForm {
    /// What every frame begins with; empty for none.
    pub sync: Vec<u8>,
    /// How long it is.
    pub length: Length,
    /// Numbers that must have certain values, or there is no frame: tags that stand all over it.
    pub tags: Vec<Tag>,
    /// The number that says that a sound frame is of the kind to be read.
    pub kind: Option<Tag>,
    /// Its checksum.
    pub checksum: Option<Summed>,
}

/// How long a frame is, in bytes, all of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// Always the same.
    Fixed(usize),
    /// It tells: so many bytes more than the number says, at most `most`.
    Told {
        /// Where.
        place: Place,
        /// What the number leaves out.
        plus: usize,
        /// The longest.
        most: usize,
    },
}

/// A number that must have one of these values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tag {
    /// Where.
    pub place: Place,
    /// Which, under the place's mask and where they stand there.
    pub values: Vec<u64>,
}

/// Which bytes a checksum is of, and where it stands. Places below zero count from the frame's end.
#[derive(Debug, Clone, PartialEq)]
pub struct Summed {
    /// Which.
    pub checksum: Checksum,
    /// From this byte …
    pub from: i32,
    /// … to before this one.
    pub to: i32,
    /// Where it stands.
    pub at: i32,
    /// In which order its bytes stand.
    pub endian: Endian,
}

/// What stands at the beginning of some bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look<'a> {
    /// More bytes are needed to tell.
    TooFew,
    /// A frame, whole.
    Frame(&'a [u8]),
    /// A sound frame of another kind.
    Other(&'a [u8]),
    /// No frame.
    Nothing,
}

/// Why a form describes no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FormFault {
    /// No bytes, or too many.
    #[error("a frame has 1 to {FRAME_BYTES_MAX} bytes")]
    Length,
    /// The length stands where not every frame has bytes.
    #[error("the length must stand within the first bytes of a frame, counted from its beginning")]
    LengthPlace,
    /// The checksum is of bytes that are not there, of none, or of itself.
    #[error("the checksum must be of bytes of the frame, and not of its own")]
    Checksum,
    /// A place beyond the frame.
    #[error("it stands beyond the frame, which has {0} bytes")]
    Beyond(usize),
    /// Nothing marks a frame.
    #[error("without sync, tags and checksum any bytes are a frame, and a stream has no beginning")]
    Unmarked,
}

impl FrameForm {
    /// Bytes of the shortest frame.
    pub fn least(&self) -> usize {
        match self.length {
            Length::Fixed(bytes) => bytes,
            // What the number tells, it tells of the rest; sync and length themselves are always there.
            Length::Told { place, plus, .. } => {
                place.end(0).unwrap_or(usize::MAX).max(self.sync.len()).max(plus)
            }
        }
    }

    /// Bytes of the longest frame.
    pub fn most(&self) -> usize {
        match self.length {
            Length::Fixed(bytes) => bytes,
            Length::Told { most, .. } => most,
        }
    }

    /// Whether something tells a frame from other bytes.
    pub fn is_marked(&self) -> bool {
        !self.sync.is_empty() || !self.tags.is_empty() || self.checksum.is_some()
    }

    /// Whether a number stands within a frame: every one of a fixed length, the longest of those that tell theirs.
    ///
    /// # Errors
    /// [`FormFault::Beyond`].
    pub fn check_place(&self, place: Place) -> Result<(), FormFault> {
        let most = self.most();
        match place.range(most) {
            Some(_) => Ok(()),
            None => Err(FormFault::Beyond(most)),
        }
    }

    /// Whether it describes frames at all. `stream`: they must be found among other bytes.
    ///
    /// # Errors
    /// [`FormFault`].
    pub fn check(&self, stream: bool) -> Result<(), FormFault> {
        if let Length::Told { place, .. } = self.length
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

    /// What stands at the beginning of these bytes.
    pub fn look<'a>(&self, bytes: &'a [u8]) -> Look<'a> {
        let Some(head) = bytes.get(..self.least()) else { return Look::TooFew };
        if !head.starts_with(&self.sync) {
            return Look::Nothing;
        }
        let length = match self.length {
            Length::Fixed(length) => length,
            Length::Told { place, plus, most } => {
                let told = place.raw(head).and_then(|told| usize::try_from(told).ok());
                match told.and_then(|told| told.checked_add(plus)) {
                    Some(length) if (self.least()..=most).contains(&length) => length,
                    _ => return Look::Nothing,
                }
            }
        };
        let Some(frame) = bytes.get(..length) else { return Look::TooFew };
        let is_sound = self.tags.iter().all(|tag| tag.fits(frame))
            && self.checksum.as_ref().is_none_or(|summed| summed.fits(frame));
        match (is_sound, &self.kind) {
            (false, _) => Look::Nothing,
            (true, Some(kind)) if !kind.fits(frame) => Look::Other(frame),
            (true, _) => Look::Frame(frame),
        }
    }

    /// Whether these bytes begin as a frame does that can be damaged and be known to be: by its checksum.
    pub fn begins_damaged(&self, bytes: &[u8]) -> bool {
        self.checksum.is_some() && bytes.starts_with(&self.sync)
    }
}

impl Tag {
    /// Whether a frame has one of the values there.
    pub fn fits(&self, frame: &[u8]) -> bool {
        self.place.masked(frame).is_some_and(|value| self.values.contains(&value))
    }
}

impl Summed {
    fn fits(&self, frame: &[u8]) -> bool {
        self.parts(frame).is_some_and(|(of, stands)| self.checksum.of(of) == self.endian.number(stands))
    }

    /// The bytes that it is of, and the bytes that it stands in.
    fn parts<'a>(&self, frame: &'a [u8]) -> Option<(&'a [u8], &'a [u8])> {
        let from = number::index(self.from, frame.len())?;
        // An end at 0 is the frame's own end: counted from there, it is 0 bytes before it.
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
