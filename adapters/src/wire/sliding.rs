//! Frames of one size in a stream that has no other marks: where no frame reads, go on by one byte.

/// What stood next in a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found<T> {
    /// A frame.
    Frame(T),
    /// Bytes that are no part of a frame; the next one follows, or more of them will.
    Passed {
        /// How many.
        bytes: usize,
        /// The first of them: what stood where a frame might have begun.
        first: u8,
    },
}

/// The bytes of a stream that are not read yet.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sliding {
    bytes: Vec<u8>,
    read: usize,
}

impl Sliding {
    /// Forgets what was half read.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.read = 0;
    }

    /// Appends what came.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.read);
        self.read = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next frame that `parse` makes of exactly `N` bytes, or how many bytes were passed over on the way to it;
    /// `None` once fewer than a frame are left.
    pub fn next<const N: usize, T>(&mut self, parse: impl Fn(&[u8; N]) -> Option<T>) -> Option<Found<T>> {
        let begun = self.read;
        loop {
            let window = self.bytes.get(self.read..).and_then(<[u8]>::first_chunk::<N>);
            match window.map(&parse) {
                Some(Some(frame)) if self.read == begun => {
                    self.read += N;
                    return Some(Found::Frame(frame));
                }
                Some(None) => self.read += 1,
                // A frame after what was passed over is read at the next call.
                Some(Some(_)) | None => {
                    let passed = self.bytes.get(begun..self.read)?;
                    return passed.first().map(|first| Found::Passed { bytes: passed.len(), first: *first });
                }
            }
        }
    }
}
