//! Frames in a stream, whatever pieces it comes in.

use super::{FrameForm, Look};

/// What stood next in a stream.
#[derive(Debug, PartialEq, Eq)]
pub enum Found<'a> {
    /// A frame.
    Frame(&'a [u8]),
    /// A sound frame of another kind.
    Other,
    /// So many bytes that are no part of a frame; the next one follows, or more of them will.
    Passed {
        /// How many.
        bytes: usize,
        /// Whether they began as a frame whose checksum does not fit.
        damaged: bool,
    },
}

/// The bytes of a stream that are not read yet.
#[derive(Debug, Clone)]
pub struct Frames {
    form: FrameForm,
    bytes: Vec<u8>,
    read: usize,
}

impl Frames {
    /// A stream of frames of a form.
    pub fn new(form: FrameForm) -> Frames {
        Frames { form, bytes: Vec::new(), read: 0 }
    }

    /// The form.
    pub fn form(&self) -> &FrameForm {
        &self.form
    }

    /// Forgets what was half read.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.read = 0;
    }

    /// How many bytes are kept until more come.
    pub fn kept(&self) -> usize {
        self.bytes.len() - self.read
    }

    /// Appends what came.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.read);
        self.read = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// What stands next; `None` once more bytes are needed to tell. What is kept is never more than a frame.
    pub fn advance(&mut self) -> Option<Found<'_>> {
        let Frames { form, bytes, read } = self;
        let begin = *read;
        loop {
            let rest = bytes.get(*read..).unwrap_or_default();
            let passed = *read - begin;
            match form.look(rest) {
                Look::Nothing => *read += 1,
                Look::Frame(frame) if passed == 0 => {
                    *read += frame.len();
                    return Some(Found::Frame(frame));
                }
                Look::Other(frame) if passed == 0 => {
                    *read += frame.len();
                    return Some(Found::Other);
                }
                // What follows what was passed over is read at the next call.
                Look::Frame(_) | Look::Other(_) | Look::TooFew => {
                    let damaged = form.begins_damaged(bytes.get(begin..).unwrap_or_default());
                    return (passed > 0).then_some(Found::Passed { bytes: passed, damaged });
                }
            }
        }
    }
}
