//! The report before it has a form: HTML and Markdown are made of the same pieces and so tell the same.

use super::svg::Drawing;

/// The whole report.
#[derive(Debug, Clone)]
pub(super) struct Document {
    pub(super) title: String,
    /// The verdict in a word.
    pub(super) verdict: &'static str,
    /// The answer in a sentence or two.
    pub(super) headline: Text,
    /// The few numbers that matter: what, value, what it means.
    pub(super) numbers: Vec<[String; 3]>,
    pub(super) sections: Vec<Section>,
}

/// A part under a heading.
#[derive(Debug, Clone)]
pub(super) struct Section {
    pub(super) title: String,
    pub(super) pieces: Vec<Piece>,
}

impl Section {
    pub(super) fn new(title: impl Into<String>) -> Section {
        Section { title: title.into(), pieces: Vec::new() }
    }

    pub(super) fn say(&mut self, text: impl Into<Text>) {
        self.pieces.push(Piece::Paragraph(text.into()));
    }

    pub(super) fn note(&mut self, text: impl Into<Text>) {
        self.pieces.push(Piece::Note(text.into()));
    }

    pub(super) fn head(&mut self, text: impl Into<Text>) {
        self.pieces.push(Piece::Subheading(text.into()));
    }

    pub(super) fn list(&mut self, items: Vec<Text>) {
        if !items.is_empty() {
            self.pieces.push(Piece::List(items));
        }
    }

    pub(super) fn table(&mut self, table: Table) {
        if !table.rows.is_empty() {
            self.pieces.push(Piece::Table(table));
        }
    }

    pub(super) fn code(&mut self, language: &'static str, text: impl Into<String>) {
        self.pieces.push(Piece::Code { language, text: text.into() });
    }

    pub(super) fn figures(&mut self, figures: Vec<Figure>) {
        if !figures.is_empty() {
            self.pieces.push(Piece::Figures(figures));
        }
    }
}

/// What a section consists of.
#[derive(Debug, Clone)]
pub(super) enum Piece {
    Paragraph(Text),
    Note(Text),
    Subheading(Text),
    List(Vec<Text>),
    Table(Table),
    Code { language: &'static str, text: String },
    Figures(Vec<Figure>),
}

/// A table; cells of columns in `numeric` are set to the right.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) head: Vec<String>,
    pub(super) numeric: Vec<bool>,
    pub(super) rows: Vec<Vec<Text>>,
}

impl Table {
    /// Names of columns; those that begin with a `>` are numeric.
    pub(super) fn new(head: &[&str]) -> Table {
        Table {
            head: head.iter().map(|name| name.trim_start_matches('>').to_owned()).collect(),
            numeric: head.iter().map(|name| name.starts_with('>')).collect(),
            rows: Vec::new(),
        }
    }
}

/// A drawing with what it shows.
#[derive(Debug, Clone)]
pub(super) struct Figure {
    pub(super) drawing: Drawing,
    pub(super) caption: Text,
}

/// A line of text.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Text(pub(super) Vec<Inline>);

/// A part of a line.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Inline {
    Plain(String),
    Strong(String),
    Code(String),
}

impl Text {
    pub(super) fn plain(mut self, text: impl Into<String>) -> Text {
        self.0.push(Inline::Plain(text.into()));
        self
    }

    pub(super) fn strong(mut self, text: impl Into<String>) -> Text {
        self.0.push(Inline::Strong(text.into()));
        self
    }

    pub(super) fn code(mut self, text: impl Into<String>) -> Text {
        self.0.push(Inline::Code(text.into()));
        self
    }

    /// One text after another.
    pub(super) fn then(mut self, other: Text) -> Text {
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

/// Begins a text with strong words.
pub(super) fn strong(text: impl Into<String>) -> Text {
    Text::default().strong(text)
}

/// Begins a text with code.
pub(super) fn code(text: impl Into<String>) -> Text {
    Text::default().code(text)
}
