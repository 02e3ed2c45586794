//! Turns a parser's complaint into a sentence: file, line, field, and the nearest key that exists.

use super::ConfigError;
use super::ground::Mistake;

/// What to say of a parser's error.
pub(super) fn explain(error: &toml::de::Error, text: &str, name: &str) -> ConfigError {
    let place = match error.span() {
        Some(span) => format!("{name}, line {}", line_of(text, span.start)),
        None => name.to_owned(),
    };
    let said = error.message();
    let what = match unknown(said) {
        Some((unknown, known)) => {
            let nearest = known
                .iter()
                .max_by(|a, b| strsim::jaro_winkler(a, unknown).total_cmp(&strsim::jaro_winkler(b, unknown)));
            let hint = nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"));
            let rest =
                if known.len() > 1 { format!(" (known here: {})", known.join(", ")) } else { String::new() };
            format!("`{unknown}` is not known{hint}{rest}")
        }
        None => said.to_owned(),
    };
    ConfigError::Wrong { place, what }
}

/// Takes serde's "unknown field `a`, expected one of `b`, `c`" (or variant) apart.
fn unknown(said: &str) -> Option<(&str, Vec<&str>)> {
    let rest = said.strip_prefix("unknown field ").or_else(|| said.strip_prefix("unknown variant "))?;
    let mut quoted = rest.split('`').skip(1).step_by(2);
    let unknown = quoted.next()?;
    Some((unknown, quoted.collect()))
}

/// File and line of a dotted field, as well as it can be found; of the section where it would stand, if it is missing.
pub(super) fn place_of(field: &str, text: &str, name: &str) -> String {
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
        None if table.contains('.') => place_of(table, text, name),
        None => name.to_owned(),
    }
}

/// File and line of a mistake in a description.
pub(super) fn place_of_mistake(mistake: &Mistake, text: &str, name: &str) -> String {
    match &mistake.span {
        Some(span) => format!("{name}, line {}", line_of(text, span.start)),
        None => place_of(&mistake.key, text, name),
    }
}

fn line_of(text: &str, byte: usize) -> usize {
    text.bytes().take(byte).filter(|byte| *byte == b'\n').count() + 1
}
