//! Extracts frames from a stream, independently of its division into pieces.

use super::{FrameForm, FrameMatch};

/// The next element of a stream.
#[derive(Debug, PartialEq, Eq)]
pub enum StreamElement<'a> {
    /// A frame.
    Frame(&'a [u8]),
    /// A valid frame of another kind.
    Other,
    /// Bytes that are no part of a frame; a frame or more such bytes follow.
    Skipped {
        /// Their count.
        bytes: usize,
        /// Whether they began like a frame whose checksum does not match.
        damaged: bool,
    },
}

/// The unread bytes of a stream.
#[derive(Debug, Clone)]
pub struct Frames {
    form: FrameForm,
    bytes: Vec<u8>,
    read: usize,
}

impl Frames {
    /// A stream of frames of this format.
    pub fn new(form: FrameForm) -> Frames {
        Frames { form, bytes: Vec::new(), read: 0 }
    }

    /// The format.
    pub fn form(&self) -> &FrameForm {
        &self.form
    }

    /// Discards partially received data.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.read = 0;
    }

    /// Count of the buffered bytes.
    pub fn kept(&self) -> usize {
        self.bytes.len() - self.read
    }

    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.read);
        self.read = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next element; `None` if more bytes are needed. At most one frame remains buffered.
    pub fn advance(&mut self) -> Option<StreamElement<'_>> {
        let Frames { form, bytes, read } = self;
        let begin = *read;
        loop {
            let rest = bytes.get(*read..).unwrap_or_default();
            let skipped = *read - begin;
            match form.match_start(rest) {
                FrameMatch::Nothing => *read += 1,
                FrameMatch::Frame(frame) if skipped == 0 => {
                    *read += frame.len();
                    return Some(StreamElement::Frame(frame));
                }
                FrameMatch::Other(frame) if skipped == 0 => {
                    *read += frame.len();
                    return Some(StreamElement::Other);
                }
                // The data after the skipped bytes are read in the next call.
                FrameMatch::Frame(_) | FrameMatch::Other(_) | FrameMatch::TooFew => {
                    let damaged = form.begins_damaged(bytes.get(begin..).unwrap_or_default());
                    return (skipped > 0).then_some(StreamElement::Skipped { bytes: skipped, damaged });
                }
            }
        }
    }
}
