//! `docs/discrepancy.md` covers every effect and every printed field.

#[path = "report/sample.rs"]
#[expect(dead_code, reason = "the report's tests need more of it")]
mod sample;

use std::collections::BTreeSet;

use equipoise_core::effect::Effect;
use serde_json::Value;

const DOCUMENT: &str = include_str!("../../docs/discrepancy.md");

#[test]
fn every_effect_has_a_row_in_the_catalogue() {
    let rows: Vec<&str> = DOCUMENT.lines().filter(|line| line.starts_with("| `")).collect();
    for effect in Effect::ALL {
        let name = format!("`{}`", effect.name());
        let listed = rows.iter().filter(|row| row.split('|').nth(1).unwrap().contains(&name));
        assert!(listed.count() >= 1, "{name}");
    }
}

#[test]
fn every_printed_field_is_explained() {
    let mut fields = BTreeSet::new();
    for sample in [sample::named(90.0), sample::unexplained(90.0)] {
        names(&serde_json::to_value(&sample.finding).unwrap(), &mut fields);
    }
    for free in ["hand", "mass_kg", "mx_kg_m"] {
        fields.remove(free);
    }
    assert!(fields.len() > 30, "{}", fields.len());
    for field in fields.iter().filter(|field| !field.ends_with("_still") && !field.ends_with("_moving")) {
        assert!(
            DOCUMENT.contains(&format!("`{field}`")) || DOCUMENT.contains(&format!("`{field}[]`")),
            "{field}"
        );
    }
}

fn names(value: &Value, all: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                all.insert(name.clone());
                names(value, all);
            }
        }
        Value::Array(values) => values.iter().for_each(|value| names(value, all)),
        _ => {}
    }
}
