//! Validates a JSON value against a JSON schema, with the features that this crate's schemas use (tests only;
//! `.ci/python-mcap.py` uses an independent validator).

use serde_json::Value;

/// Mismatches with their paths; empty if the value is valid.
pub(crate) fn misfits(schema: &Value, value: &Value) -> Vec<String> {
    let mut found = Vec::new();
    walk(schema, value, "", &mut found);
    found
}

fn walk(schema: &Value, value: &Value, at: &str, found: &mut Vec<String>) {
    let fits = match schema["type"].as_str() {
        Some("object") => value.is_object(),
        Some("array") => value.is_array(),
        Some("string") => value.is_string(),
        Some("number") => value.is_number(),
        Some("integer") => value.is_u64(),
        Some("boolean") => value.is_boolean(),
        Some(other) => panic!("{at}: a type {other} that this checker does not know"),
        None => {
            schema["oneOf"].as_array().is_some_and(|choices| choices.iter().any(|one| one["const"] == *value))
        }
    };
    if !fits {
        found.push(format!("{at}: {value}"));
        return;
    }
    if let Some(names) = schema["enum"].as_array()
        && !names.contains(value)
    {
        found.push(format!("{at}: {value} is none of {names:?}"));
    }
    for name in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if value.get(name).is_none() {
            found.push(format!("{at}/{name} is missing"));
        }
    }
    if let (Some(entries), Some(properties)) = (value.as_object(), schema["properties"].as_object()) {
        for (name, inner) in entries {
            match properties.get(name) {
                Some(schema) => walk(schema, inner, &format!("{at}/{name}"), found),
                None => found.push(format!("{at}/{name} is not in the schema")),
            }
        }
    }
    if let Some(items) = value.as_array() {
        let count = items.len() as u64;
        if schema["minItems"].as_u64().is_some_and(|min| count < min)
            || schema["maxItems"].as_u64().is_some_and(|max| count > max)
        {
            found.push(format!("{at}: {count} items"));
        }
        for (index, item) in items.iter().enumerate() {
            walk(&schema["items"], item, &format!("{at}/{index}"), found);
        }
    }
}
