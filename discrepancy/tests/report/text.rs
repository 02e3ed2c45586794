//! Reads a report back: its words without markup, and whether its markup is well-formed.

/// Words of a page as displayed, without its drawings.
pub(crate) fn html_words(html: &str) -> Vec<String> {
    let body = html.split_once("<body>").unwrap().1;
    let mut text = String::new();
    let mut rest = without(body, "<svg", "</svg>");
    while let Some(begin) = rest.find('<') {
        let end = begin + rest[begin..].find('>').unwrap();
        text.push_str(&rest[..begin]);
        // A tag separates words.
        text.push(' ');
        rest = rest[end + 1..].to_owned();
    }
    text.push_str(&rest);
    for (entity, sign) in [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#39;", "'"), ("&amp;", "&")] {
        text = text.replace(entity, sign);
    }
    words(&text)
}

/// Words of a Markdown text as displayed, without its drawings.
pub(crate) fn markdown_words(markdown: &str) -> Vec<String> {
    let mut text = String::new();
    for line in markdown.lines() {
        let rule = line.starts_with('|') && line.chars().all(|c| "|-: ".contains(c));
        if rule || line.starts_with("![") || line.starts_with("```") {
            continue;
        }
        let line = line.trim_start_matches(['#', '>', '-']);
        let mut letters = line.chars().peekable();
        while let Some(letter) = letters.next() {
            match letter {
                '\\' => text.extend(letters.next()),
                '*' | '`' | '|' => text.push(' '),
                _ => text.push(letter),
            }
        }
        text.push('\n');
    }
    words(&text)
}

/// Separates signs from words, whatever spaces the markup has.
fn words(text: &str) -> Vec<String> {
    let mut spaced = String::new();
    for letter in text.chars() {
        if "()[];,:/=\"<>|'`*\\".contains(letter) {
            spaced.extend([' ', letter, ' ']);
        } else {
            spaced.push(letter);
        }
    }
    // A full stop may follow markup.
    spaced
        .split_whitespace()
        .map(|word| word.trim_end_matches('.').to_owned())
        .filter(|word| !word.is_empty())
        .collect()
}

fn without(text: &str, begin: &str, end: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(begin) {
        out.push_str(&rest[..at]);
        rest = rest[at..].split_once(end).unwrap().1;
    }
    out + rest
}

/// Values of all attributes of that name.
pub(crate) fn attributes(markup: &str, name: &str) -> Vec<String> {
    let begin = format!(" {name}=\"");
    markup.split(&begin).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect()
}

/// Checks that every tag is closed in order, every attribute is quoted, every ampersand begins an entity.
pub(crate) fn well_formed(markup: &str) -> Result<(), String> {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = without(markup, "<style>", "</style>");
    rest = rest.trim().to_owned();
    let mut parts = rest.split('<');
    parts.next();
    for part in parts {
        let (tag, text) = part.split_once('>').ok_or_else(|| format!("<{part} never ends"))?;
        let name = tag.split([' ', '/']).find(|name| !name.is_empty()).unwrap_or_default();
        if tag.matches('"').count() % 2 != 0 {
            return Err(format!("<{tag}>: quotes"));
        }
        let sound = |entity: &str| {
            ["amp;", "lt;", "gt;", "quot;", "#39;"].iter().any(|known| entity.starts_with(known))
        };
        if part.split('&').skip(1).any(|entity| !sound(entity)) {
            return Err(format!("a bare ampersand in {text}"));
        }
        if text.contains('>') {
            return Err(format!("a bare > in {text}"));
        }
        if tag.starts_with('/') {
            let last = open.pop();
            if last != Some(name) {
                return Err(format!("</{name}> closes {last:?}"));
            }
        } else if !tag.ends_with('/') && name != "meta" {
            open.push(name);
        }
    }
    if open.is_empty() { Ok(()) } else { Err(format!("never closed: {open:?}")) }
}

/// A Markdown text without its code, in blocks and in lines.
pub(crate) fn without_code(markdown: &str) -> String {
    let mut out = String::new();
    let mut letters = markdown.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '\\' => out.extend([letter].into_iter().chain(letters.next())),
            '`' => skip_code(&mut letters),
            _ => out.push(letter),
        }
    }
    out
}

/// Skips to the end of a run of backticks as long as the opening one.
fn skip_code(letters: &mut std::iter::Peekable<std::str::Chars<'_>>) {
    let run = |letters: &mut std::iter::Peekable<std::str::Chars<'_>>| {
        std::iter::from_fn(|| letters.next_if_eq(&'`')).count()
    };
    let length = 1 + run(letters);
    while letters.peek().is_some() && run(letters) != length {
        letters.next();
    }
}
