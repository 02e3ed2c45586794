//! The finding told for people: `report.html`, which needs nothing else, and `report.md` with drawings beside it.
//!
//! Six steps, each in plain words with its picture: what disagrees, where beyond noise, what was set aside and why, the
//! change, the same picture again on data held out, what is left. An answer that names nothing is told as openly. Both
//! forms are made of one document, so they cannot tell different numbers.

pub mod document;
mod escape;
mod figures;
mod figures_by_row;
mod figures_left;
mod html;
mod markdown;
mod story;
pub mod svg;
mod words;

use crate::finding::Finding;
use crate::picture::Picture;
use document::{Document, Piece};

/// All that a report tells.
#[derive(Debug, Clone, Copy)]
pub struct Report<'a> {
    /// What was found.
    pub finding: &'a Finding,
    /// What is drawn of it.
    pub picture: &'a Picture,
    /// Where it comes from.
    pub origin: &'a Origin,
    /// The text of the model file, if one was written; its path is [`Finding::model`].
    pub model_toml: Option<&'a str>,
}

/// Where a finding comes from, so that it can be made again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// What was read.
    pub recordings: Vec<Recording>,
    /// Who was measured.
    pub subject: String,
    /// Where.
    pub station: String,
    /// When the finding was made: RFC 3339.
    pub date: String,
    /// Program with its version.
    pub software: String,
    /// The command as it was given.
    pub command: String,
}

/// A recording that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// Name of its file, as it was given.
    pub name: String,
    /// SHA-256 of its bytes, in hexadecimal.
    pub sha256: String,
}

/// A document as one page that needs nothing else: no script, nothing from elsewhere; light, dark and printed.
///
/// The style sheet knows the verdicts of a finding by their colour; any other word stands there without one.
pub fn page(document: &Document) -> String {
    html::html(document)
}

/// Text from elsewhere made harmless, for the body of a drawing.
pub fn escaped(text: &str) -> String {
    escape::xml(text)
}

/// A report, ready to be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pages {
    /// Names of files and what is in them: the HTML page, the Markdown text, its drawings.
    pub files: Vec<(String, String)>,
}

impl Report<'_> {
    /// Tells the story, in both forms.
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
