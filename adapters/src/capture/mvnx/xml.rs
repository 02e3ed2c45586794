//! Reads an .mvnx file as a sequence of tags and texts with line numbers.
//!
//! An export may be larger than the memory, or damaged: memory is bounded by limits on the length of a tag or text and
//! on the nesting depth, beyond which reading ends with a [`Fault`]. Entities that a document defines (`<!ENTITY …>`)
//! are never expanded.

use std::io::{self, BufRead, ErrorKind, Read};

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

/// Maximum length of a tag, comment or text, bytes; the largest of a frame has about 3000.
const EVENT_BYTES_MAX: usize = 256 * 1024;
/// Maximum nesting depth; an .mvnx has 8 levels.
const DEPTH_MAX: usize = 64;

/// Maximum length of the reason in a [`Fault`], characters.
const REASON_MAX: usize = 200;

/// The next part of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token<'a> {
    /// Start of an element.
    Start(Element<'a>),
    /// End of the innermost open element.
    End,
    /// Text without resolved references, untrimmed; empty for comments, declarations and processing instructions.
    Text(&'a str),
    /// A reference `&name;` between tags; not resolved, since the numbers of a frame contain none.
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
    /// The name, without a namespace prefix.
    pub(super) fn name(&self) -> &str {
        self.tag.local_name().into_inner()
    }

    /// Value of an attribute, with XML's five predefined entities resolved; `None` if it is absent or malformed.
    pub(super) fn attribute(&self, name: &str) -> Option<String> {
        let attribute = self.tag.try_get_attribute(name).ok()??;
        Some(attribute.normalized_value(XmlVersion::Explicit1_0).ok()?.into_owned())
    }
}

/// Why the file cannot be read further.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    /// Line of the fault, from 1.
    pub(super) line: u64,
    /// Cause, for the error message.
    pub(super) reason: String,
}

/// Parser of one file.
pub(super) struct Xml<R: BufRead> {
    reader: Reader<LimitedReader<R>>,
    /// Bytes of the current event.
    event_buffer: Vec<u8>,
    depth: usize,
}

impl<R: BufRead> Xml<R> {
    pub(super) fn new(inner: R) -> Xml<R> {
        let mut reader = Reader::from_reader(LimitedReader { inner, lines: 0, event_bytes: 0 });
        reader.config_mut().expand_empty_elements = true;
        Xml { reader, event_buffer: Vec::new(), depth: 0 }
    }

    /// The current line, from 1.
    pub(super) fn line(&self) -> u64 {
        self.reader.get_ref().lines + 1
    }

    /// Count of open elements.
    pub(super) fn depth(&self) -> usize {
        self.depth
    }

    /// Reads the next tag, text or end of the file. Fails if the XML is malformed, exceeds a limit, or ends within an
    /// element, and if the file cannot be read.
    pub(super) fn next(&mut self) -> Result<Token<'_>, Fault> {
        self.event_buffer.clear();
        self.reader.get_mut().event_bytes = 0;
        let event = match self.reader.read_event_into(&mut self.event_buffer) {
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
            Event::Text(text) => Token::Text(event_text(text.into_inner())),
            Event::CData(text) => Token::Text(event_text(text.into_inner())),
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

/// The text of an event; events that are read into a buffer always borrow it.
fn event_text(text: std::borrow::Cow<'_, str>) -> &str {
    match text {
        std::borrow::Cow::Borrowed(text) => text,
        std::borrow::Cow::Owned(_) => "",
    }
}

/// Reader that counts lines, and fails after [`EVENT_BYTES_MAX`] bytes of one XML event.
struct LimitedReader<R> {
    inner: R,
    /// Line ends consumed.
    lines: u64,
    /// Bytes consumed since the begin of the current event.
    event_bytes: usize,
}

impl<R: BufRead> Read for LimitedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let available = self.fill_buf()?;
        let count = available.len().min(buffer.len());
        buffer[..count].copy_from_slice(&available[..count]);
        self.consume(count);
        Ok(count)
    }
}

impl<R: BufRead> BufRead for LimitedReader<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.event_bytes > EVENT_BYTES_MAX {
            let message = format!("a tag or text of more than {EVENT_BYTES_MAX} bytes: this is no .mvnx");
            return Err(io::Error::new(ErrorKind::InvalidData, message));
        }
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        // Consumed bytes are in the buffer, so that `fill_buf` does not read.
        if let Ok(bytes) = self.inner.fill_buf() {
            self.lines +=
                bytes[..count.min(bytes.len())].iter().filter(|byte| **byte == b'\n').count() as u64;
        }
        self.event_bytes += count;
        self.inner.consume(count);
    }
}
