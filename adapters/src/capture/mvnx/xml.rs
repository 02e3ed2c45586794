//! XML as a stream of tags and texts, in bounded memory, with line numbers.
//!
//! Entities that a document defines (`<!ENTITY …>`) are never expanded.

use std::io::{self, BufRead, ErrorKind, Read};

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

/// Maximum length of a tag, comment or text, bytes; a frame's largest has some 3000.
const EVENT_BYTES_MAX: usize = 256 * 1024;
/// Maximum nesting depth; an .mvnx has 8 levels.
const DEPTH_MAX: usize = 64;

/// Maximum length of a reported reason, characters.
const REASON_MAX: usize = 200;

/// The next element of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token<'a> {
    /// Start of an element.
    Start(Element<'a>),
    /// End of the innermost open element.
    End,
    /// Unmodified text, to be split at white space.
    Text(&'a str),
    /// `&name;` between tags: numbers contain none.
    Reference,
    /// The end of the file.
    Eof,
}

/// The start of an element.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Element<'a> {
    tag: BytesStart<'a>,
}

impl Element<'_> {
    /// The name, without a prefix.
    pub(super) fn name(&self) -> &str {
        self.tag.local_name().into_inner()
    }

    /// An attribute, with XML's five predefined entities resolved.
    pub(super) fn attribute(&self, name: &str) -> Option<String> {
        let attribute = self.tag.try_get_attribute(name).ok()??;
        Some(attribute.normalized_value(XmlVersion::Explicit1_0).ok()?.into_owned())
    }
}

/// Why the file cannot be read further.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    /// Line, from 1.
    pub(super) line: u64,
    /// The reason.
    pub(super) reason: String,
}

/// The XML reader.
pub(super) struct Xml<R: BufRead> {
    reader: Reader<Watched<R>>,
    event: Vec<u8>,
    depth: usize,
}

impl<R: BufRead> Xml<R> {
    pub(super) fn new(inner: R) -> Xml<R> {
        let mut reader = Reader::from_reader(Watched { inner, lines: 0, event_bytes: 0 });
        reader.config_mut().expand_empty_elements = true;
        Xml { reader, event: Vec::new(), depth: 0 }
    }

    /// The current line, from 1.
    pub(super) fn line(&self) -> u64 {
        self.reader.get_ref().lines + 1
    }

    /// Count of open elements.
    pub(super) fn depth(&self) -> usize {
        self.depth
    }

    /// Reads up to the next tag, text or end.
    pub(super) fn next(&mut self) -> Result<Token<'_>, Fault> {
        self.event.clear();
        self.reader.get_mut().event_bytes = 0;
        let event = match self.reader.read_event_into(&mut self.event) {
            Ok(event) => event,
            Err(error) => {
                // The error quotes names in the file, which may be as long as the file.
                let reason = error.to_string().chars().take(REASON_MAX).collect();
                return Err(Fault { line: self.reader.get_ref().lines + 1, reason });
            }
        };
        Ok(match event {
            Event::Start(tag) => {
                self.depth += 1;
                if self.depth > DEPTH_MAX {
                    let reason = format!("more than {DEPTH_MAX} elements within each other");
                    return Err(Fault { line: self.reader.get_ref().lines + 1, reason });
                }
                Token::Start(Element { tag })
            }
            Event::End(_) => {
                self.depth = self.depth.saturating_sub(1);
                Token::End
            }
            Event::Text(text) => Token::Text(borrowed(text.into_inner())),
            Event::CData(text) => Token::Text(borrowed(text.into_inner())),
            Event::GeneralRef(_) => Token::Reference,
            Event::Eof if self.depth > 0 => {
                let reason = "the file ends within an element".to_owned();
                return Err(Fault { line: self.reader.get_ref().lines + 1, reason });
            }
            Event::Eof => Token::Eof,
            Event::Empty(_) | Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) => {
                Token::Text("")
            }
        })
    }
}

/// Text that is read into a buffer is never owned.
fn borrowed(text: std::borrow::Cow<'_, str>) -> &str {
    match text {
        std::borrow::Cow::Borrowed(text) => text,
        std::borrow::Cow::Owned(_) => "",
    }
}

/// Counts lines, and fails if one event has too many bytes.
struct Watched<R> {
    inner: R,
    lines: u64,
    event_bytes: usize,
}

impl<R: BufRead> Read for Watched<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let available = self.fill_buf()?;
        let count = available.len().min(buffer.len());
        buffer[..count].copy_from_slice(&available[..count]);
        self.consume(count);
        Ok(count)
    }
}

impl<R: BufRead> BufRead for Watched<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.event_bytes > EVENT_BYTES_MAX {
            let sentence = format!("a tag or text of more than {EVENT_BYTES_MAX} bytes: this is no .mvnx");
            return Err(io::Error::new(ErrorKind::InvalidData, sentence));
        }
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        // The consumed bytes are in the buffer.
        if let Ok(bytes) = self.inner.fill_buf() {
            self.lines +=
                bytes[..count.min(bytes.len())].iter().filter(|byte| **byte == b'\n').count() as u64;
        }
        self.event_bytes += count;
        self.inner.consume(count);
    }
}
