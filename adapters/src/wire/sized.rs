//! Cuts a stream into messages that tell their length at the front, however it was torn on the way.

/// Bytes at the front of a message that are enough to know its length.
pub(super) const FRONT: usize = 8;

/// What a stream of such messages looks like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form {
    /// The length of a message, front included, from its front.
    pub(super) size: fn([u8; FRONT]) -> usize,
    /// The shortest.
    pub(super) least: usize,
    /// The longest: what announces more is no such message, and nothing after it can be found.
    pub(super) most: usize,
    /// What is longer than this is passed over rather than kept.
    pub(super) kept: usize,
}

/// The next of a stream.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Cut<'a> {
    /// A message, front included.
    Whole(&'a [u8]),
    /// One too long to keep; its front.
    PassedOver([u8; FRONT]),
    /// No message has this front.
    Nonsense([u8; FRONT]),
}

/// A stream on its way.
#[derive(Debug, Clone, Default)]
pub(super) struct Sized {
    buffer: Vec<u8>,
    /// Bytes at the front of `buffer` that were handed out.
    taken: usize,
    /// Bytes still to come of a message that is passed over.
    skip: usize,
    /// Nothing can be found any more.
    broken: bool,
}

impl Sized {
    /// Forgets what was half read.
    pub(super) fn clear(&mut self) {
        self.buffer.clear();
        (self.taken, self.skip, self.broken) = (0, 0, false);
    }

    /// Takes in the next piece.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.taken);
        self.taken = 0;
        let skipped = self.skip.min(bytes.len());
        self.skip -= skipped;
        if !self.broken {
            self.buffer.extend_from_slice(&bytes[skipped..]);
        }
    }

    /// The next message; `None` until more has come.
    pub(super) fn cut(&mut self, form: Form) -> Option<Cut<'_>> {
        let from = self.taken;
        let rest = self.buffer.get(from..).unwrap_or_default();
        let front = *rest.first_chunk::<FRONT>()?;
        let size = (form.size)(front);
        if size < form.least.max(FRONT) || size > form.most {
            self.clear();
            self.broken = true;
            return Some(Cut::Nonsense(front));
        }
        if size > form.kept {
            let here = size.min(rest.len());
            self.taken += here;
            self.skip = size - here;
            return Some(Cut::PassedOver(front));
        }
        if rest.len() < size {
            return None;
        }
        self.taken += size;
        Some(Cut::Whole(self.buffer.get(from..from + size).unwrap_or_default()))
    }

    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        self.buffer.len() - self.taken
    }
}
