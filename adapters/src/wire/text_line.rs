//! Lines of text with numbers, as sent by many small plates, bridges and export programs.
//!
//! Only the format is defined here; the caller interprets the fields. Bytes arrive in any pieces ([`Lines`]); a line
//! may end with LF, CR or both, and empty lines are ignored. Unused fields may contain anything.

mod number;

pub use number::{Decimal, Unit};

/// Separator between two fields.
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

/// The format of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineForm {
    /// Separator between two fields.
    pub delimiter: Delimiter,
    /// Decimal separator.
    pub decimal: Decimal,
    /// First character of a comment line, which is skipped.
    pub comment: Option<u8>,
    /// Prefix of every line, before its first field; other lines are skipped. Empty for none.
    pub prefix: Vec<u8>,
    /// Count of fields in a line.
    pub fields: usize,
}

/// Why a line does not match the format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// A different count of fields.
    #[error("{got} fields, and {want} are expected")]
    Fields {
        /// The actual count.
        got: usize,
        /// The expected count.
        want: usize,
    },
    /// A field that is not a number.
    #[error("field {field}, counted from 1, is no number")]
    Number {
        /// The field, counted from 1.
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
    /// Splits a line (without its end); `None` for an empty line, a comment, or a line without the prefix.
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
    /// The fields, without surrounding spaces.
    pub fn iter(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let delimiter = self.form.delimiter;
        let (line, byte) = match delimiter {
            Delimiter::Spaces => (self.line.trim_ascii(), b' '),
            Delimiter::Tab => (self.line, b'\t'),
            Delimiter::Comma => (self.line, b','),
            Delimiter::Semicolon => (self.line, b';'),
        };
        // Some programs end every line with a delimiter; it does not begin another field.
        let line =
            if delimiter == Delimiter::Spaces { line } else { line.strip_suffix(&[byte]).unwrap_or(line) };
        let is_between = move |at: &u8| *at == byte || (delimiter == Delimiter::Spaces && *at == b'\t');
        line.split(is_between)
            .map(<[u8]>::trim_ascii)
            .filter(move |field| delimiter != Delimiter::Spaces || !field.is_empty())
    }

    /// The number in a field; `index` counts from 0.
    ///
    /// # Errors
    /// [`Malformed::Number`].
    pub fn number(&self, index: usize) -> Result<f64, Malformed> {
        let text = self.iter().nth(index).and_then(|field| core::str::from_utf8(field).ok());
        text.and_then(|text| self.form.decimal.number(text)).ok_or(Malformed::Number { field: index + 1 })
    }

    /// The numbers in the fields `which`, which must be sorted.
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

    /// A counter, or a time in a unit, as an integer of the finest unit: exact for any length.
    ///
    /// # Errors
    /// [`Malformed::Number`], also for a negative number or one beyond 64 bits.
    pub fn whole(&self, index: usize, unit: Unit) -> Result<u64, Malformed> {
        let text = self.iter().nth(index).and_then(|field| core::str::from_utf8(field).ok());
        text.and_then(|text| self.form.decimal.whole(text, unit))
            .ok_or(Malformed::Number { field: index + 1 })
    }
}

/// Splits a stream into lines, independently of its division into pieces.
#[derive(Debug, Clone)]
pub struct Lines {
    partial: Vec<u8>,
    longest: usize,
    /// The rest of this line is discarded: it was too long, or its start is missing.
    skipping: bool,
}

/// A line that exceeds the maximum length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

impl Lines {
    /// Lines of at most `longest` bytes. If a stream is joined in the middle of a line (`cut`), the data before the
    /// first line end may be incomplete and are omitted.
    pub fn new(longest: usize, cut: bool) -> Lines {
        Lines { partial: Vec::new(), longest, skipping: cut }
    }

    /// Processes a piece and calls `each` for each line that ends in it.
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

    /// Ends the stream, as at the end of a datagram: the remaining data are a line.
    pub fn end(&mut self, each: impl FnMut(Result<&[u8], TooLong>)) {
        self.take(b"\n", each);
    }

    /// Whether these bytes make the line too long.
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
