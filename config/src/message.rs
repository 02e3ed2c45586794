//! Converts a parser's error to a sentence with file, line, field, and the nearest existing key.

use toml_edit::{Item, TableLike, Value};

use super::ConfigError;
use super::ground::DescriptionError;

/// The message for a parser's error.
pub(super) fn explain(error: &toml::de::Error, text: &str, name: &str) -> ConfigError {
    let place = match error.span() {
        Some(span) => format!("{name}, line {}", line_of(text, span.start)),
        None => name.to_owned(),
    };
    let message = error.message();
    let what = match unknown_name(message) {
        Some((unknown_name, valid)) => {
            let nearest = valid.iter().max_by(|a, b| {
                strsim::jaro_winkler(a, unknown_name).total_cmp(&strsim::jaro_winkler(b, unknown_name))
            });
            let hint = nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"));
            let rest =
                if valid.len() > 1 { format!(" (known here: {})", valid.join(", ")) } else { String::new() };
            format!("`{unknown_name}` is not known{hint}{rest}")
        }
        None => invalid_type(message),
    };
    let key = error.span().and_then(|span| key_at(text, span.start));
    let what = key.map_or_else(|| what.clone(), |key| format!("{key}: {what}"));
    ConfigError::Invalid { place, what }
}

/// Rewrites serde's `invalid type: string "20", expected f64` without Rust terms.
fn invalid_type(message: &str) -> String {
    let parts = message.strip_prefix("invalid type: ").and_then(|rest| rest.split_once(", expected "));
    let Some((actual, expected)) = parts else { return message.to_owned() };
    let expected = match expected {
        "f64" | "f32" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" | "i32" | "i64" => "a whole number",
        "a boolean" => "true or false",
        "a string" | "path string" => "a text in quotation marks",
        other => other,
    };
    format!("{} is given where {expected} is expected", actual.replace('`', ""))
}

/// The dotted key of the value at a byte offset of the text.
fn key_at(text: &str, byte: usize) -> Option<String> {
    let document = toml_edit::Document::parse(text).ok()?;
    in_table(document.as_table(), "", byte)
}

fn in_table(table: &dyn TableLike, path: &str, byte: usize) -> Option<String> {
    table.iter().find_map(|(name, item)| {
        let path = if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
        match item {
            Item::Value(value) => in_value(value, path, byte),
            Item::Table(table) => in_table(table, &path, byte),
            Item::ArrayOfTables(tables) => tables.iter().find_map(|table| in_table(table, &path, byte)),
            Item::None => None,
        }
    })
}

/// Entries of lists have no key of their own: the line number distinguishes them.
fn in_value(value: &Value, path: String, byte: usize) -> Option<String> {
    if !value.span()?.contains(&byte) {
        return None;
    }
    let inner = value.as_inline_table().and_then(|table| in_table(table, &path, byte));
    let entry = || value.as_array()?.iter().find_map(|entry| in_value(entry, path.clone(), byte));
    inner.or_else(entry).or(Some(path))
}

/// Splits serde's "unknown field `a`, expected one of `b`, `c`" (or variant) into its names.
fn unknown_name(message: &str) -> Option<(&str, Vec<&str>)> {
    let rest = message.strip_prefix("unknown field ").or_else(|| message.strip_prefix("unknown variant "))?;
    let mut quoted = rest.split('`').skip(1).step_by(2);
    let unknown_name = quoted.next()?;
    Some((unknown_name, quoted.collect()))
}

/// File and line of a dotted field, as precisely as possible; of its section if the field is missing.
pub(super) fn location_of(field: &str, text: &str, name: &str) -> String {
    let (table, key) = field.rsplit_once('.').unwrap_or(("", field));
    let mut inside = table.is_empty();
    let mut section = None;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if let Some(header) = line.strip_prefix('[') {
            let header = header.split(']').next().unwrap_or_default().trim();
            inside = header == table;
            if inside || header == field {
                section = Some(index + 1);
            }
        } else if inside && line.split('=').next().is_some_and(|left| left.trim() == key) {
            return format!("{name}, line {}", index + 1);
        }
    }
    match section {
        Some(line) => format!("{name}, line {line}"),
        None if table.contains('.') => location_of(table, text, name),
        None => name.to_owned(),
    }
}

/// File and line of an error in a description.
pub(super) fn location_of_error(error: &DescriptionError, text: &str, name: &str) -> String {
    match &error.span {
        Some(span) => format!("{name}, line {}", line_of(text, span.start)),
        None => location_of(&error.key, text, name),
    }
}

fn line_of(text: &str, byte: usize) -> usize {
    text.bytes().take(byte).filter(|byte| *byte == b'\n').count() + 1
}
