//! The report as one self-contained HTML file: no script, no network, light or dark by the reader's setting.

use std::fmt::Write;

use super::document::{Document, Figure, Inline, Piece, Scrubber, Table, Text};
use super::escape::xml;
use super::svg;

/// Blocks all external resources, as a second line of defence.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

/// Writes the page.
pub(super) fn html(document: &Document) -> String {
    let title = xml(&document.title);
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{title}</title>\n\
         <style>\n{}{}</style>\n</head>\n<body>\n<main>\n",
        svg::STYLE,
        include_str!("page.css")
    );
    let verdict = xml(document.verdict);
    let _ = writeln!(
        out,
        "<header>\n<h1>{title}</h1>\n<p class=\"headline\"><b class=\"pill {verdict}\">{verdict}</b> {}</p>",
        text(&document.headline)
    );
    out.push_str("<dl class=\"numbers\">\n");
    for [what, value, meaning] in &document.numbers {
        let _ = writeln!(
            out,
            "<div><dt>{}</dt> <dd><b>{}</b> <small>{}</small></dd></div>",
            xml(what),
            xml(value),
            xml(meaning)
        );
    }
    out.push_str("</dl>\n</header>\n");
    for section in &document.sections {
        let _ = writeln!(out, "<section>\n<h2>{}</h2>", xml(&section.title));
        for each in &section.pieces {
            piece(each, &mut out);
        }
        out.push_str("</section>\n");
    }
    out.push_str("</main>\n</body>\n</html>\n");
    out
}

fn piece(piece: &Piece, out: &mut String) {
    let _ = match piece {
        Piece::Paragraph(line) => writeln!(out, "<p>{}</p>", text(line)),
        Piece::Note(line) => writeln!(out, "<p class=\"note\">{}</p>", text(line)),
        Piece::Subheading(line) => writeln!(out, "<h3>{}</h3>", text(line)),
        Piece::List(items) => {
            let items: String = items.iter().map(|item| format!("<li>{}</li>\n", text(item))).collect();
            writeln!(out, "<ul>\n{items}</ul>")
        }
        Piece::Table(content) => writeln!(out, "{}", table(content)),
        Piece::Code { text, .. } => {
            writeln!(out, "<pre tabindex=\"0\"><code>{}</code></pre>", xml(text.trim_end()))
        }
        Piece::Figures(all) => writeln!(out, "<div class=\"figures\">\n{}</div>", figures(all)),
        Piece::Scrubber(content) => writeln!(out, "{}", scrubber(content)),
    };
}

/// A drawing follows its radio button; the style sheet displays that of the selected one.
fn scrubber(scrubber: &Scrubber) -> String {
    let Scrubber { height, background, steps, selected, .. } = scrubber;
    let (name, label, width) = (xml(&scrubber.name), xml(&scrubber.label), svg::WIDTH);
    let drawing = |body: &str| {
        format!("<svg class=\"plot\" viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">{body}</svg>")
    };
    let mut out = format!(
        "<fieldset class=\"scrubber\">\n<legend>{label}</legend>\n<div class=\"stage\">{}<div class=\"strip\">\n",
        drawing(background)
    );
    for (index, step) in steps.iter().enumerate() {
        let _ = writeln!(
            out,
            "<input type=\"radio\" name=\"{name}\" aria-label=\"{}\" \
             style=\"--bar:{};--height:{:.0}%\"{}/>{}",
            xml(&step.label),
            xml(&step.colour),
            100.0 * step.fraction,
            if index == *selected { " checked=\"\"" } else { "" },
            drawing(&step.body)
        );
    }
    out.push_str("</div></div>\n</fieldset>");
    out
}

fn figures(figures: &[Figure]) -> String {
    figures
        .iter()
        .map(|figure| {
            let caption = if figure.caption.0.is_empty() {
                String::new()
            } else {
                format!("<figcaption>{}</figcaption>", text(&figure.caption))
            };
            format!("<figure>{}{caption}</figure>\n", figure.drawing.inline())
        })
        .collect()
}

fn table(table: &Table) -> String {
    let class = |column: usize| if table.numeric[column] { " class=\"n\"" } else { "" };
    let head: String = table
        .head
        .iter()
        .enumerate()
        .map(|(column, name)| format!("<th scope=\"col\"{}>{}</th>", class(column), xml(name)))
        .collect();
    let rows: String = table
        .rows
        .iter()
        .map(|row| {
            let cells: String = row
                .iter()
                .enumerate()
                .map(|(column, cell)| format!("<td{}>{}</td>", class(column), text(cell)))
                .collect();
            format!("<tr>{cells}</tr>\n")
        })
        .collect();
    format!(
        "<div class=\"wide\" tabindex=\"0\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n\
         </table></div>"
    )
}

fn text(text: &Text) -> String {
    text.0
        .iter()
        .map(|part| match part {
            Inline::Plain(text) => xml(text),
            Inline::Strong(text) => format!("<strong>{}</strong>", xml(text)),
            Inline::Code(text) => format!("<code>{}</code>", xml(text)),
        })
        .collect()
}
