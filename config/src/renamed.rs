//! Keys of the previous release that were renamed or removed, which are accepted for one release.

use toml::{Table, Value};

/// Old and new dotted names. Each old name is also accepted where the key is read (`serde(alias)`).
const RENAMED: [(&str, &str); 13] = [
    ("outlets", "gateways"),
    ("gateways.rtde.registers.moment_age_s", "sample_age_s"),
    ("gateways.rtde.registers.not_given", "unavailable"),
    ("gateways.rtde.registers.worst_share", "worst_limit_ratio"),
    ("suit.wander_deg", "orientation_drift_deg"),
    ("suit.up", "up_axis"),
    ("suit.others", "forwarded"),
    ("subject.remember", "save_profile"),
    ("static_pose.leave_deg", "new_pose_deg"),
    ("overload.load_distance_max_m", "load_hand_distance_max_m"),
    ("ground.text.over", "transport"),
    ("ground.binary.over", "transport"),
    ("ground.channels.soles", "insoles"),
];

/// Removed dotted names, and the reason. Each is read (`skip_serializing`), but not used.
const REMOVED: [(&str, &str); 1] = [(
    "ground.amti.auto_zero",
    "zeroing at the start would take a worker on the plate as zero; `equipoise tare` zeroes the empty plate",
)];

/// A sentence for each key of a configuration that has an old name or was removed.
pub fn renamed_keys(text: &str) -> Vec<String> {
    let Ok(table) = toml::from_str::<Table>(text) else { return Vec::new() };
    let mut sentences = Vec::new();
    for (old, new) in RENAMED {
        let of_second = old.strip_prefix("ground.").map(|key| format!("ground.second.{key}"));
        let of_outlets = old.strip_prefix("gateways.").map(|key| format!("outlets.{key}"));
        for key in [Some(old.to_owned()), of_second, of_outlets].into_iter().flatten() {
            if has(&table, &key) {
                sentences
                    .push(format!("`{key}` is now called `{new}`: rename it; the next release rejects it"));
            }
        }
    }
    for (key, reason) in REMOVED {
        let of_second = key.strip_prefix("ground.").map(|key| format!("ground.second.{key}"));
        for key in [Some(key.to_owned()), of_second].into_iter().flatten().filter(|key| has(&table, key)) {
            sentences.push(format!(
                "`{key}` has no effect any more: {reason}; delete the key, the next release rejects it"
            ));
        }
    }
    sentences
}

/// Whether a table has a dotted key.
fn has(table: &Table, key: &str) -> bool {
    match key.split_once('.') {
        Some((first, rest)) => {
            table.get(first).and_then(Value::as_table).is_some_and(|inner| has(inner, rest))
        }
        None => table.contains_key(key),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use crate::tests::SMALLEST;

    fn parse(text: &str) -> Config {
        Config::parse(text, "c.toml").unwrap()
    }

    #[test]
    fn keys_of_the_previous_release_are_accepted_and_reported() {
        let with = |section: &str, key: &str| format!("{SMALLEST}\n[{section}]\n{key}\n");
        let udp = "to = [\"127.0.0.1:7411\"]";
        for (old, new) in [
            (with("outlets.udp", udp), with("gateways.udp", udp)),
            (with("static_pose", "leave_deg = 8.0"), with("static_pose", "new_pose_deg = 8.0")),
            (
                with("overload", "load_distance_max_m = 0.4"),
                with("overload", "load_hand_distance_max_m = 0.4"),
            ),
            (
                SMALLEST.replace("[suit]", "[suit]\nwander_deg = 0.5\nup = \"y\""),
                SMALLEST.replace("[suit]", "[suit]\norientation_drift_deg = 0.5\nup_axis = \"y\""),
            ),
            (
                SMALLEST.replace("[subject]", "[subject]\nremember = false"),
                SMALLEST.replace("[subject]", "[subject]\nsave_profile = false"),
            ),
        ] {
            assert_eq!(parse(&old), parse(&new));
            assert_eq!(renamed_keys(&new), [""; 0]);
            assert!(!renamed_keys(&old).is_empty(), "{old}");
        }
        let both = with("outlets.udp", udp) + "[gateways.rtde]\nrobot = \"127.0.0.1:1\"\n";
        assert!(Config::parse(&both, "c.toml").is_err());
    }

    #[test]
    fn keys_of_nested_tables_are_reported() {
        let nested = renamed_keys(
            "[ground.second.text]\nover = \"udp\"\n[outlets.rtde.registers]\nworst_share = 27\n",
        );
        assert_eq!(nested.len(), 3, "{nested:?}");
        assert!(
            nested.iter().any(|sentence| sentence.starts_with("`ground.second.text.over`")),
            "{nested:?}"
        );
    }
}
