//! A report independent of its format: HTML and Markdown are rendered from the same pieces and agree.

use super::svg::Drawing;

/// The whole report.
#[derive(Debug, Clone)]
pub struct Document {
    /// Title of the report.
    pub title: String,
    /// The verdict in a word.
    pub verdict: &'static str,
    /// The result in one or two sentences.
    pub headline: Text,
    /// Key figures: quantity, value, meaning.
    pub numbers: Vec<[String; 3]>,
    /// Its parts.
    pub sections: Vec<Section>,
}

/// A section under a heading.
#[derive(Debug, Clone)]
pub struct Section {
    /// Its heading.
    pub title: String,
    /// Its content.
    pub pieces: Vec<Piece>,
}

impl Section {
    /// An empty section.
    pub fn new(title: impl Into<String>) -> Section {
        Section { title: title.into(), pieces: Vec::new() }
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: impl Into<Text>) {
        self.pieces.push(Piece::Paragraph(text.into()));
    }

    /// Appends a remark.
    pub fn note(&mut self, text: impl Into<Text>) {
        self.pieces.push(Piece::Note(text.into()));
    }

    /// Appends a subheading.
    pub fn head(&mut self, text: impl Into<Text>) {
        self.pieces.push(Piece::Subheading(text.into()));
    }

    /// Adds a list, unless it is empty.
    pub fn list(&mut self, items: Vec<Text>) {
        if !items.is_empty() {
            self.pieces.push(Piece::List(items));
        }
    }

    /// Adds a table, unless it has no rows.
    pub fn table(&mut self, table: Table) {
        if !table.rows.is_empty() {
            self.pieces.push(Piece::Table(table));
        }
    }

    /// Appends verbatim text of a file.
    pub fn code(&mut self, language: &'static str, text: impl Into<String>) {
        self.pieces.push(Piece::Code { language, text: text.into() });
    }

    /// Appends drawings of which the reader selects one.
    pub fn scrubber(&mut self, scrubber: Scrubber) {
        self.pieces.push(Piece::Scrubber(scrubber));
    }

    /// Appends a row of drawings, unless there are none.
    pub fn figures(&mut self, figures: Vec<Figure>) {
        if !figures.is_empty() {
            self.pieces.push(Piece::Figures(figures));
        }
    }
}

/// A piece of a section.
#[derive(Debug, Clone)]
pub enum Piece {
    /// A paragraph.
    Paragraph(Text),
    /// A remark.
    Note(Text),
    /// A heading within the section.
    Subheading(Text),
    /// A list.
    List(Vec<Text>),
    /// A table.
    Table(Table),
    /// Verbatim text of a file.
    Code {
        /// Its language, for Markdown.
        language: &'static str,
        /// The text.
        text: String,
    },
    /// Drawings in a row.
    Figures(Vec<Figure>),
    /// Drawings of which the reader selects one.
    Scrubber(Scrubber),
}

/// A table; cells of columns in `numeric` are right-aligned.
#[derive(Debug, Clone)]
pub struct Table {
    /// Names of the columns.
    pub head: Vec<String>,
    /// Right-aligned columns.
    pub numeric: Vec<bool>,
    /// Cells, row by row.
    pub rows: Vec<Vec<Text>>,
}

impl Table {
    /// Names of columns; those with a leading `>` are numeric.
    pub fn new(head: &[&str]) -> Table {
        Table {
            head: head.iter().map(|name| name.trim_start_matches('>').to_owned()).collect(),
            numeric: head.iter().map(|name| name.starts_with('>')).collect(),
            rows: Vec::new(),
        }
    }
}

/// A drawing with its caption.
#[derive(Debug, Clone)]
pub struct Figure {
    /// The drawing.
    pub drawing: Drawing,
    /// Its caption; may be empty.
    pub caption: Text,
}

/// Drawings over time, one for each step; radio buttons in a strip select one, so that no script is needed.
#[derive(Debug, Clone)]
pub struct Scrubber {
    /// Identifier, unique in its page.
    pub name: String,
    /// What is selected, and how.
    pub label: String,
    /// Height of a drawing, 540 wide.
    pub height: f64,
    /// SVG behind every step.
    pub background: String,
    /// The steps in order.
    pub steps: Vec<Step>,
    /// Index of the step that is selected first, and printed.
    pub selected: usize,
}

/// A step of a scrubber.
#[derive(Debug, Clone)]
pub struct Step {
    /// Text alternative.
    pub label: String,
    /// Colour of its bar in the strip.
    pub colour: String,
    /// Height of the bar over that of the strip.
    pub fraction: f64,
    /// Its SVG, in which external names are escaped already.
    pub body: String,
}

/// A line of text.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Text(
    /// Its parts.
    pub Vec<Inline>,
);

/// A part of a line.
#[derive(Debug, Clone, PartialEq)]
pub enum Inline {
    /// Plain text.
    Plain(String),
    /// Emphasised text.
    Strong(String),
    /// A name or a command.
    Code(String),
}

impl Text {
    /// Appends plain text.
    pub fn plain(mut self, text: impl Into<String>) -> Text {
        self.0.push(Inline::Plain(text.into()));
        self
    }

    /// Appends emphasised text.
    pub fn strong(mut self, text: impl Into<String>) -> Text {
        self.0.push(Inline::Strong(text.into()));
        self
    }

    /// Appends a name or a command.
    pub fn code(mut self, text: impl Into<String>) -> Text {
        self.0.push(Inline::Code(text.into()));
        self
    }

    /// Concatenates two texts.
    pub fn then(mut self, other: Text) -> Text {
        self.0.extend(other.0);
        self
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Text {
        Text::default().plain(text)
    }
}

impl From<String> for Text {
    fn from(text: String) -> Text {
        Text::default().plain(text)
    }
}

/// A text that starts with emphasised words.
pub fn strong(text: impl Into<String>) -> Text {
    Text::default().strong(text)
}

/// A text that starts with code.
pub fn code(text: impl Into<String>) -> Text {
    Text::default().code(text)
}
