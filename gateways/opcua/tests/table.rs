//! The tables of `docs/consumers/opcua.md` are generated from the declaration of the nodes:
//! `EQUIPOISE_WRITE=1 cargo test -p equipoise-gateway-opcua --test table` writes them; without the variable the test
//! compares them.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

use std::collections::BTreeMap;
use std::fmt::Write as _;

use equipoise_core::message::Validity;
use equipoise_gateway_opcua::quality::of_withheld;
use equipoise_gateway_opcua::table::{About, JOINT, Row, STATION, Type};

const BEGIN: &str = "<!-- nodes: begin -->\n";
const END: &str = "<!-- nodes: end -->";

fn type_name(of: Type) -> String {
    match of {
        Type::Boolean => "Boolean".to_owned(),
        Type::UInt64 => "UInt64".to_owned(),
        Type::Text => "String".to_owned(),
        Type::Texts => "String[]".to_owned(),
        Type::Double => "Double".to_owned(),
        Type::Doubles(length) => format!("Double[{length}]"),
        Type::State(names) => {
            let names: Vec<_> =
                names.iter().enumerate().map(|(number, name)| format!("{number} `{name}`")).collect();
            format!("UInt32: {}", names.join(", "))
        }
    }
}

fn set_name(invalidating: Validity) -> &'static str {
    Validity::FLAG_SETS.iter().find(|(set, _)| *set == invalidating).map_or("", |(_, name)| name)
}

fn of_rows(rows: &[Row], of: &str) -> String {
    let mut text = format!(
        "| {of} | type | unit | bad while `Valid` has a bit of | SourceTimestamp | meaning |\n|---|---|---|---|---|---|\n"
    );
    for row in rows {
        let unit = row.unit.map_or("", |unit| unit.symbol);
        let about = match row.about {
            About::Cycle => "cycle",
            About::Sample => "sample",
        };
        let (name, of, invalidating, says) =
            (row.name, type_name(row.of), set_name(row.invalidating), row.meaning);
        writeln!(text, "| `{name}` | {of} | {unit} | {invalidating} | {about} | {says} |").unwrap();
    }
    text
}

/// The flags of each status.
fn statuses() -> String {
    let mut flags_of: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (flag, name) in Validity::NAMES {
        let flags = flags_of.entry(of_withheld(*flag).to_string()).or_default();
        flags.push(format!("{} `{name}`", flag.0.trailing_zeros()));
    }
    let mut text = "| status of invalid values | bits of `Valid` |\n|---|---|\n".to_owned();
    for (status, flags) in &flags_of {
        writeln!(text, "| {status} | {} |", flags.join(", ")).unwrap();
    }
    text
}

#[test]
fn the_document_shows_the_nodes_as_they_are_declared() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/consumers/opcua.md");
    let document = std::fs::read_to_string(path).unwrap();
    let (head, rest) = document.split_once(BEGIN).unwrap();
    let (written, tail) = rest.split_once(END).unwrap();
    let tables = format!(
        "\n{}\n{}\n{}\n",
        of_rows(&STATION, "of the station"),
        of_rows(&JOINT, "of each joint"),
        statuses()
    );
    if std::env::var_os("EQUIPOISE_WRITE").is_some() {
        std::fs::write(path, format!("{head}{BEGIN}{tables}{END}{tail}")).unwrap();
        return;
    }
    assert_eq!(written, tables, "docs/consumers/opcua.md: rewrite its tables, see the head of this test");
}
