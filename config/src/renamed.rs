//! Keys under their names of the previous release, which are accepted as aliases for one release.

use toml::{Table, Value};

/// Old and new dotted names. Each old name is a `serde(alias)` of the field.
const RENAMED: [(&str, &str); 1] = [("outlets", "gateways")];

/// A sentence for each key of a configuration that has an old name.
pub fn renamed_keys(text: &str) -> Vec<String> {
    let Ok(table) = toml::from_str::<Table>(text) else { return Vec::new() };
    let has = |name: &str| {
        let mut keys = name.split('.');
        let first = keys.next().and_then(|key| table.get(key));
        keys.try_fold(first, |value, key| Some(value.and_then(Value::as_table)?.get(key))).flatten().is_some()
    };
    let sentence = |(old, new): (&str, &str)| {
        format!("`{old}` is now called `{new}`: rename it; the next release rejects `{old}`")
    };
    RENAMED.into_iter().filter(|(old, _)| has(old)).map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use crate::tests::SMALLEST;

    #[test]
    fn a_key_of_the_previous_release_is_accepted_and_reported() {
        let with = |table: &str| format!("{SMALLEST}\n[{table}.udp]\nto = [\"127.0.0.1:7411\"]\n");
        let (old, new) = (with("outlets"), with("gateways"));
        let parse = |text: &str| Config::parse(text, "c.toml").unwrap();
        assert_eq!(parse(&old), parse(&new));
        assert_eq!(renamed_keys(&new), [""; 0]);
        assert!(renamed_keys(&old)[0].starts_with("`outlets` is now called `gateways`"));
        assert!(
            Config::parse(&(with("outlets") + "[gateways.rtde]\nrobot = \"127.0.0.1:1\"\n"), "c").is_err()
        );
    }
}
