//! The parts of a configuration that can change while the daemon runs.

use std::collections::{BTreeMap, BTreeSet};

use toml::Value;

use super::Config;
use super::method::{Build, SubjectConfig};

impl Config {
    /// This configuration with the live parts of another one: `[overload]`, `[static_pose]`, `[model]` and the model
    /// itself, `[latency]`, `subject.tau_max_nm`, and `[gateways]`, `[page]` and `[recording]`, which
    /// other processes read.
    pub fn with_live_settings_of(&self, other: &Config) -> Config {
        let mut live = self.clone();
        live.overload = other.overload.clone();
        live.static_pose = other.static_pose.clone();
        live.model = other.model.clone();
        live.loaded_model = other.loaded_model.clone();
        live.latency = other.latency.clone();
        live.gateways = other.gateways.clone();
        live.page = other.page.clone();
        live.recording = other.recording.clone();
        live.subject.tau_max_nm = other.subject.tau_max_nm.clone();
        live
    }

    /// This configuration for another subject: the mass and the torque limits of the configured one do not apply, and its
    /// stature and sex only if those of the other are unknown.
    pub fn with_subject(&self, id: &str, build: Option<Build>) -> Config {
        let Build { height_m, sex } = build.unwrap_or(self.subject.build());
        let subject = SubjectConfig {
            id: id.to_owned(),
            height_m,
            sex,
            mass_kg: None,
            save_profile: self.subject.save_profile,
            tau_max_nm: BTreeMap::new(),
        };
        Config { subject, ..self.clone() }
    }

    /// The process that reads a key if it is not the daemon.
    pub fn reader_of(key: &str) -> Option<&'static str> {
        match key.split('.').next() {
            Some("gateways") => Some("its gateway"),
            Some("page") => Some("equipoise view"),
            Some("recording") => Some("the recorder"),
            _ => None,
        }
    }

    /// A section of this configuration, complete with its defaults.
    pub fn section(&self, name: &str) -> Option<Value> {
        self.to_toml().parse::<toml::Table>().ok()?.remove(name)
    }

    /// Every dotted key whose value differs, such as `loop.rate_hz`.
    pub fn keys_that_differ(&self, other: &Config) -> Vec<String> {
        // Through the text: a second set of serializers for all types would only cost compile time.
        let table = |config: &Config| config.to_toml().parse().map_or(Value::Boolean(false), Value::Table);
        let mut keys = BTreeSet::new();
        compare("", Some(&table(self)), Some(&table(other)), &mut keys);
        keys.into_iter().collect()
    }
}

fn compare(name: &str, one: Option<&Value>, other: Option<&Value>, keys: &mut BTreeSet<String>) {
    match (one, other) {
        (Some(Value::Table(one)), Some(Value::Table(other))) => {
            for key in one.keys().chain(other.keys()) {
                let inner = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                compare(&inner, one.get(key), other.get(key), keys);
            }
        }
        _ if one == other => {}
        _ => {
            keys.insert(name.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn live_settings_are_applied_and_the_others_are_reported() {
        let parse = |text: &str| {
            Config::parse(&format!("{}{text}", super::super::tests::SMALLEST), "the test's").unwrap()
        };
        let before = parse("");
        let mut new =
            parse("[overload]\nthreshold_n = 20.0\n[static_pose]\n[page]\nlisten = \"127.0.0.1:1\"\n");
        new.tick.rate_hz = 500;
        new.subject.height_m = 1.6;
        let after = before.with_live_settings_of(&new);
        assert_eq!(after.keys_that_differ(&new), ["loop.rate_hz", "subject.height_m"]);
        let changed = before.keys_that_differ(&after);
        assert_eq!(changed, ["overload.threshold_n", "page"]);
        assert_eq!(
            [&changed[0], &changed[1]].map(|key| Config::reader_of(key)),
            [None, Some("equipoise view")]
        );
        assert_eq!(after.tick, before.tick);
    }
}
