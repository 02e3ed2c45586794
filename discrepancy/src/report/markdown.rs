//! The report as Markdown, with its drawings as separate files.

use std::fmt::Write;

use super::document::{Document, Inline, Piece, Table, Text};
use super::escape;

/// Writes the text.
pub(super) fn markdown(document: &Document) -> String {
    let mut out = format!(
        "# {}\n\n**{}** {}\n\n",
        escape::markdown(&document.title),
        escape::markdown(document.verdict),
        text(&document.headline)
    );
    for [what, value, meaning] in &document.numbers {
        let [what, value, meaning] = [what, value, meaning].map(|part| escape::markdown(part));
        let _ = writeln!(out, "- {what} **{value}** {meaning}");
    }
    for section in &document.sections {
        let _ = write!(out, "\n## {}\n", escape::markdown(&section.title));
        for each in &section.pieces {
            out.push('\n');
            piece(each, &mut out);
        }
    }
    out
}

fn piece(piece: &Piece, out: &mut String) {
    match piece {
        Piece::Scrubber(scrubber) => {
            for step in &scrubber.steps {
                let _ = writeln!(out, "- {}", escape::markdown(&step.label));
            }
        }
        Piece::Paragraph(line) => out.push_str(&format!("{}\n", text(line))),
        Piece::Note(line) => out.push_str(&format!("> {}\n", text(line))),
        Piece::Subheading(line) => out.push_str(&format!("### {}\n", text(line))),
        Piece::List(items) => {
            for item in items {
                let _ = writeln!(out, "- {}", text(item));
            }
        }
        Piece::Table(content) => table(content, out),
        Piece::Code { language, text } => out.push_str(&escape::markdown_block(language, text)),
        Piece::Figures(figures) => {
            for (n, figure) in figures.iter().enumerate() {
                let gap = if n == 0 { "" } else { "\n" };
                let (title, name) = (escape::markdown(&figure.drawing.title), &figure.drawing.name);
                let _ = writeln!(out, "{gap}![{title}]({name}.svg)");
                if !figure.caption.0.is_empty() {
                    let _ = write!(out, "\n{}\n", text(&figure.caption));
                }
            }
        }
    }
}

fn table(table: &Table, out: &mut String) {
    let row = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    out.push_str(&row(table.head.iter().map(|name| escape::markdown(name)).collect()));
    out.push_str(&row(table.numeric.iter().map(|n| if *n { "---:" } else { "---" }.to_owned()).collect()));
    for cells in &table.rows {
        out.push_str(&row(cells.iter().map(text).collect()));
    }
}

/// Asterisks mark words as strong only if they are adjacent to them.
fn strong(text: &str) -> String {
    let words = text.trim_end();
    format!("**{}**{}", escape::markdown(words), &text[words.len()..])
}

fn text(text: &Text) -> String {
    text.0
        .iter()
        .map(|part| match part {
            Inline::Plain(text) => escape::markdown(text),
            Inline::Strong(text) => strong(text),
            Inline::Code(text) => escape::markdown_code(text),
        })
        .collect()
}
