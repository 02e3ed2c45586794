//! The finding as a report: `report.html`, which is self-contained, and `report.md` with drawings as separate files.
//!
//! Six steps, each in plain words with its figure: what disagrees, where beyond noise, what was rejected and why, the
//! change, the same figure on held-out data, what remains. A finding without named effects is reported in the same
//! detail. Both forms are rendered from one document, so their numbers agree.

pub mod document;
mod escape;
mod figures;
mod figures_by_row;
mod figures_remainder;
mod html;
mod markdown;
mod story;
pub mod svg;
mod words;

use crate::finding::Finding;
use crate::picture::Picture;
use document::{Document, Piece};

/// Inputs of a report.
#[derive(Debug, Clone, Copy)]
pub struct Report<'a> {
    /// The finding.
    pub finding: &'a Finding,
    /// Data of the figures.
    pub picture: &'a Picture,
    /// Provenance of the finding.
    pub origin: &'a Origin,
    /// The text of the model file, if one was written; its path is [`Finding::model`].
    pub model_toml: Option<&'a str>,
}

/// Provenance of a finding, sufficient to reproduce it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// Recordings read.
    pub recordings: Vec<Recording>,
    /// The measured subject.
    pub subject: String,
    /// The station.
    pub station: String,
    /// Time of the finding: RFC 3339.
    pub date: String,
    /// Program with its version.
    pub software: String,
    /// The command line as entered.
    pub command: String,
}

/// A recording used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// Name of its file, as entered.
    pub name: String,
    /// SHA-256 of its bytes, in hexadecimal.
    pub sha256: String,
}

/// Renders a document as one self-contained page: no script, no external resources; light, dark and print styles.
///
/// The style sheet has colours for the verdicts of a finding; any other word has none.
pub fn page(document: &Document) -> String {
    html::html(document)
}

/// Escapes external text for the body of a drawing.
pub fn escaped(text: &str) -> String {
    escape::xml(text)
}

/// A report, ready to be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pages {
    /// Names and contents of its files: the HTML page, the Markdown text, its drawings.
    pub files: Vec<(String, String)>,
}

impl Report<'_> {
    /// Renders both forms.
    pub fn pages(&self) -> Pages {
        let document = story::document(self);
        let mut files = vec![
            ("report.html".to_owned(), html::html(&document)),
            ("report.md".to_owned(), markdown::markdown(&document)),
        ];
        files.extend(drawings(&document));
        Pages { files }
    }
}

fn drawings(document: &Document) -> impl Iterator<Item = (String, String)> {
    let pieces = document.sections.iter().flat_map(|section| &section.pieces);
    let figures = pieces.filter_map(|piece| match piece {
        Piece::Figures(figures) => Some(figures),
        _ => None,
    });
    figures.flatten().map(|figure| (format!("{}.svg", figure.drawing.name), figure.drawing.standalone()))
}
