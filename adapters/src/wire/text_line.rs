//! Lines of text with numbers: what many small plates, bridges and export programs send.
//!
//! Only the form is known here; what a field means, its reader knows. Bytes come in any pieces ([`Lines`]); a line may end
//! with LF, CR or both, and an empty one means nothing. Fields that nobody reads may hold anything.

mod number;

pub use number::{Decimal, Unit};

/// What stands between two fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delimiter {
    /// Any run of spaces and tabs.
    Spaces,
    /// One tab.
    Tab,
    /// One comma.
    Comma,
    /// One semicolon.
    Semicolon,
}

/// The form of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineForm {
    /// What stands between two fields.
    pub delimiter: Delimiter,
    /// What stands before the decimals.
    pub decimal: Decimal,
    /// A line that begins with this is passed over.
    pub comment: Option<u8>,
    /// What every line begins with, before its first field; other lines are passed over. Empty for none.
    pub prefix: Vec<u8>,
    /// How many fields a line has.
    pub fields: usize,
}

/// Why a line is not of the form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// Another number of fields.
    #[error("{got} fields, and {want} are expected")]
    Fields {
        /// How many there are.
        got: usize,
        /// How many there should be.
        want: usize,
    },
    /// A field that is no number.
    #[error("field {field}, counted from 1, is no number")]
    Number {
        /// Which, counted from 1.
        field: usize,
    },
}

/// The fields of one line.
#[derive(Debug, Clone, Copy)]
pub struct Fields<'a> {
    form: &'a LineForm,
    line: &'a [u8],
}

impl LineForm {
    /// Takes a line (without its end) apart; `None` for one that says nothing: empty, a comment, without the prefix.
    ///
    /// # Errors
    /// [`Malformed::Fields`].
    pub fn parse<'a>(&'a self, line: &'a [u8]) -> Result<Option<Fields<'a>>, Malformed> {
        let line = line.trim_ascii_end();
        let begin = line.trim_ascii_start();
        if begin.is_empty() || self.comment.is_some_and(|comment| begin[0] == comment) {
            return Ok(None);
        }
        let Some(rest) =
            (if self.prefix.is_empty() { Some(line) } else { begin.strip_prefix(&self.prefix[..]) })
        else {
            return Ok(None);
        };
        let fields = Fields { form: self, line: rest };
        match fields.iter().count() {
            got if got == self.fields => Ok(Some(fields)),
            got => Err(Malformed::Fields { got, want: self.fields }),
        }
    }
}

impl<'a> Fields<'a> {
    /// The fields, without the spaces around them.
    pub fn iter(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let delimiter = self.form.delimiter;
        let (line, byte) = match delimiter {
            Delimiter::Spaces => (self.line.trim_ascii(), b' '),
            Delimiter::Tab => (self.line, b'\t'),
            Delimiter::Comma => (self.line, b','),
            Delimiter::Semicolon => (self.line, b';'),
        };
        // Some programs end every line with a delimiter; the field behind it is none.
        let line =
            if delimiter == Delimiter::Spaces { line } else { line.strip_suffix(&[byte]).unwrap_or(line) };
        let is_between = move |at: &u8| *at == byte || (delimiter == Delimiter::Spaces && *at == b'\t');
        line.split(is_between)
            .map(<[u8]>::trim_ascii)
            .filter(move |field| delimiter != Delimiter::Spaces || !field.is_empty())
    }

    /// A field's number; `index` counts from 0.
    ///
    /// # Errors
    /// [`Malformed::Number`].
    pub fn number(&self, index: usize) -> Result<f64, Malformed> {
        let text = self.iter().nth(index).and_then(|field| core::str::from_utf8(field).ok());
        text.and_then(|text| self.form.decimal.number(text)).ok_or(Malformed::Number { field: index + 1 })
    }

    /// All fields that `which` names, in that order; it is sorted.
    ///
    /// # Errors
    /// [`Malformed::Number`].
    pub fn numbers(&self, which: &[usize], out: &mut Vec<f64>) -> Result<(), Malformed> {
        out.clear();
        let mut fields = self.iter().enumerate();
        for wanted in which {
            let text = fields.find(|(index, _)| index == wanted).map(|(_, field)| field);
            let text = text.and_then(|field| core::str::from_utf8(field).ok());
            let number = text.and_then(|text| self.form.decimal.number(text));
            out.push(number.ok_or(Malformed::Number { field: wanted + 1 })?);
        }
        Ok(())
    }

    /// A field that counts, or a time in a unit, as a whole number of the finest unit: exactly, whatever its length.
    ///
    /// # Errors
    /// [`Malformed::Number`], also for one below zero or beyond 64 bits.
    pub fn whole(&self, index: usize, unit: Unit) -> Result<u64, Malformed> {
        let text = self.iter().nth(index).and_then(|field| core::str::from_utf8(field).ok());
        text.and_then(|text| self.form.decimal.whole(text, unit))
            .ok_or(Malformed::Number { field: index + 1 })
    }
}

/// Cuts a stream into lines, whatever pieces it comes in.
#[derive(Debug, Clone)]
pub struct Lines {
    partial: Vec<u8>,
    longest: usize,
    /// The rest of this line is not wanted: it was too long, or its start is not known.
    skipping: bool,
}

/// A line that does not end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

impl Lines {
    /// Lines of at most `longest` bytes. Where a stream is joined in the middle of a line (`cut`), what comes before the
    /// first end is not known to be whole and is left out.
    pub fn new(longest: usize, cut: bool) -> Lines {
        Lines { partial: Vec::new(), longest, skipping: cut }
    }

    /// Takes in a piece and hands on each line that ends in it, once.
    pub fn take(&mut self, mut bytes: &[u8], mut each: impl FnMut(Result<&[u8], TooLong>)) {
        while let Some(end) = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r')) {
            let (line, rest) = (&bytes[..end], &bytes[end + 1..]);
            bytes = rest;
            if self.append(line) {
                each(Err(TooLong));
            } else if !self.skipping && !self.partial.is_empty() {
                each(Ok(&self.partial));
            }
            self.partial.clear();
            self.skipping = false;
        }
        if self.append(bytes) {
            each(Err(TooLong));
        }
    }

    /// The stream ends, as a datagram does: what is there is a line.
    pub fn end(&mut self, each: impl FnMut(Result<&[u8], TooLong>)) {
        self.take(b"\n", each);
    }

    /// Whether the line has become too long with this.
    fn append(&mut self, bytes: &[u8]) -> bool {
        if self.skipping {
            return false;
        }
        if self.partial.len() + bytes.len() > self.longest {
            self.partial.clear();
            self.skipping = true;
            return true;
        }
        self.partial.extend_from_slice(bytes);
        false
    }
}

#[cfg(test)]
mod tests;
