//! Extracts frames of constant size from a stream without other marks: advances by one byte where no frame is valid.

/// The next element of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamElement<T> {
    /// A frame.
    Frame(T),
    /// Bytes that are no part of a frame; a frame or more such bytes follow.
    Skipped {
        /// Their count.
        bytes: usize,
        /// The first of them, at the position where a frame might have begun.
        first: u8,
    },
}

/// The unread bytes of a stream.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sliding {
    bytes: Vec<u8>,
    read: usize,
}

impl Sliding {
    /// Discards partially received data.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.read = 0;
    }

    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.read);
        self.read = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next frame that `parse` accepts, of exactly `N` bytes, or the count of bytes skipped before it; `None` if
    /// fewer bytes than a frame remain.
    pub fn next<const N: usize, T>(
        &mut self,
        parse: impl Fn(&[u8; N]) -> Option<T>,
    ) -> Option<StreamElement<T>> {
        let begun = self.read;
        loop {
            let window = self.bytes.get(self.read..).and_then(<[u8]>::first_chunk::<N>);
            match window.map(&parse) {
                Some(Some(frame)) if self.read == begun => {
                    self.read += N;
                    return Some(StreamElement::Frame(frame));
                }
                Some(None) => self.read += 1,
                // A frame after skipped bytes is returned in the next call.
                Some(Some(_)) | None => {
                    let skipped = self.bytes.get(begun..self.read)?;
                    return skipped
                        .first()
                        .map(|first| StreamElement::Skipped { bytes: skipped.len(), first: *first });
                }
            }
        }
    }
}
