//! Reads a report's page with an XML parser: tables by their preceding heading, and all words.

use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::Event;

/// Content of a page.
#[derive(Debug, Default)]
pub(crate) struct Page {
    /// Each table with its preceding heading: rows of cells, the header first.
    pub(crate) tables: Vec<(String, Vec<Vec<String>>)>,
    /// All text, words separated.
    pub(crate) text: String,
    /// Elements by name, and their attributes.
    pub(crate) elements: Vec<(String, Vec<(String, String)>)>,
}

impl Page {
    /// The page in a file; it must be well-formed to the last element.
    pub(crate) fn read(path: &Path) -> Page {
        let source = std::fs::read_to_string(path).unwrap();
        let mut reader = Reader::from_str(&source);
        let (mut page, mut open, mut text, mut heading) =
            (Page::default(), Vec::<String>::new(), String::new(), String::new());
        loop {
            match reader
                .read_event()
                .unwrap_or_else(|error| panic!("{error} at {}", reader.buffer_position()))
            {
                Event::Start(start) => {
                    let name = start.name().0.to_owned();
                    page.element(&name, &start);
                    match name.as_str() {
                        "table" => page.tables.push((heading.clone(), Vec::new())),
                        "tr" => page.tables.last_mut().unwrap().1.push(Vec::new()),
                        "td" | "th" | "h1" | "h2" | "h3" => text.clear(),
                        _ => {}
                    }
                    open.push(name);
                }
                Event::Empty(start) => {
                    let name = start.name().0.to_owned();
                    page.element(&name, &start);
                }
                Event::End(_) => match open.pop().unwrap().as_str() {
                    "td" | "th" => page.tables.last_mut().unwrap().1.last_mut().unwrap().push(text.clone()),
                    "h2" | "h3" => heading.clone_from(&text),
                    _ => page.text.push(' '),
                },
                Event::Text(part) if open.last().is_none_or(|name| name != "style") => {
                    let part = part.into_inner();
                    text.push_str(&part);
                    page.text.push_str(&part);
                }
                Event::GeneralRef(reference) => {
                    let letter = match reference.into_inner().as_ref() {
                        "amp" => '&',
                        "lt" => '<',
                        "gt" => '>',
                        "quot" => '"',
                        "#39" => '\'',
                        other => panic!("&{other};"),
                    };
                    text.push(letter);
                    page.text.push(letter);
                }
                Event::Eof => break,
                _ => {}
            }
        }
        assert_eq!(open, Vec::<String>::new(), "never closed");
        page
    }

    fn element(&mut self, name: &str, start: &quick_xml::events::BytesStart<'_>) {
        let attributes = start.attributes().map(|attribute| {
            let attribute = attribute.unwrap();
            (attribute.key.0.to_owned(), attribute.value.into_owned())
        });
        self.elements.push((name.to_owned(), attributes.collect()));
    }

    /// The rows under a heading, without the header.
    #[track_caller]
    pub(crate) fn rows(&self, heading: &str) -> &[Vec<String>] {
        let found = self.tables.iter().find(|(name, _)| name == heading);
        let (_, rows) = found.unwrap_or_else(|| panic!("no table under {heading}: {}", self.text));
        &rows[1..]
    }

    /// The cell in the row that starts with `row` and the column with header `column`.
    #[track_caller]
    pub(crate) fn cell(&self, heading: &str, row: &str, column: &str) -> &str {
        let (_, rows) = self.tables.iter().find(|(name, _)| name == heading).unwrap();
        let at = rows[0].iter().position(|name| name == column).unwrap();
        let row = rows.iter().find(|cells| cells[0] == row);
        &row.unwrap_or_else(|| panic!("no such row under {heading}: {rows:?}"))[at]
    }

    /// The path of the line in the drawing of this name.
    pub(crate) fn line(&self, drawing: &str) -> &str {
        let of = |(name, attributes): &&(String, Vec<(String, String)>)| {
            name == "svg" && attributes.iter().any(|(_, value)| value.starts_with(&format!("{drawing}-t ")))
        };
        let at = self.elements.iter().position(|element| of(&element)).expect(drawing);
        let line = self.elements[at..].iter().find_map(|(name, attributes)| {
            let is = |key: &str, value: &str| attributes.iter().any(|(k, v)| k == key && v == value);
            let d = || attributes.iter().find(|(key, _)| key == "d").map(|(_, d)| d.as_str());
            (name == "path" && is("class", "line after")).then(d)?
        });
        line.expect("a line in it")
    }
}
