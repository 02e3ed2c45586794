//! Changes single values of a file and preserves comments, order and everything else.

use std::fs;
use std::os::unix::fs::{MetadataExt, fchown};
use std::path::Path;

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_files::atomic_file::write_atomically_with;
use equipoise_files::{TEXT_BYTES_MAX, read_text};
use toml_edit::{Array, DocumentMut, Item, Table, Value};

/// A dotted key and its new value.
pub type Change = (String, Value);

/// A number rounded to this many decimal digits.
pub fn number(value: f64, digits: i32) -> Value {
    let scale = 10_f64.powi(digits);
    // Adding 0.0 replaces −0 by 0.
    Value::from((value * scale).round() / scale + 0.0)
}

/// An array of numbers rounded to this many decimal digits.
pub fn numbers(values: &[f64], digits: i32) -> Value {
    Value::from(values.iter().map(|value| number(*value, digits)).collect::<Array>())
}

/// Returns the text with the changes.
///
/// # Errors
/// The text is not TOML, or a part of a key is not a table.
pub fn apply(text: &str, changes: &[Change]) -> anyhow::Result<String> {
    let mut document: DocumentMut = text.parse()?;
    for (key, value) in changes {
        let (path, last) = key.rsplit_once('.').unwrap_or(("", key));
        let mut table: &mut Item = document.as_item_mut();
        for part in path.split('.').filter(|part| !part.is_empty()) {
            let Some(inside) = table.as_table_like_mut() else { bail!("[{path}] is no table") };
            table = inside.entry(part).or_insert(Item::Table(Table::new()));
        }
        let Some(table) = table.as_table_like_mut() else { bail!("[{path}] is no table") };
        let mut value = value.clone();
        if let Some(before) = table.get(last).and_then(Item::as_value) {
            // Keeps the value's comment.
            *value.decor_mut() = before.decor().clone();
        }
        match table.get_mut(last) {
            Some(item) => *item = Item::Value(value),
            None => {
                table.insert(last, Item::Value(value));
            }
        }
    }
    Ok(document.to_string())
}

/// What a calibration measures and writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Calibrated {
    /// `[ground.frame]`
    Frames,
    /// `latency_ms` of `[suit]` and `[ground]`.
    Latencies,
}

impl Calibrated {
    /// Whether the result refers to the value of a dotted key.
    fn depends_on(self, key: &str) -> bool {
        let is_of =
            |table: &str| key == table || key.strip_prefix(table).is_some_and(|rest| rest.starts_with('.'));
        match self {
            Calibrated::Frames => is_of("ground") && !key.ends_with(".latency_ms"),
            Calibrated::Latencies => {
                (is_of("suit") || is_of("ground")) && !is_of("ground.frame") && !is_of("ground.second.frame")
            }
        }
    }
}

/// Checks, before a calibration begins, that a file is the configuration of the measured daemon: the result is valid
/// for the daemon's station and sensors only.
///
/// # Errors
/// The file cannot be read, is not a configuration, or is one of another station or with other sensors.
pub fn check(path: &Path, active: &Config, calibrated: Calibrated) -> anyhow::Result<()> {
    let text = read_text(path, TEXT_BYTES_MAX).with_context(|| format!("cannot read {}", path.display()))?;
    let name = path.display();
    let config = Config::parse(&text, &name.to_string())?;
    if config.station != active.station {
        bail!(
            "{name} is the configuration of station {}, but station {} is measured: give --write the file of {}'s daemon",
            config.station,
            active.station,
            active.station
        );
    }
    let differing = active.keys_that_differ(&config).into_iter().find(|key| calibrated.depends_on(key));
    if let Some(key) = differing {
        bail!(
            "{name}: {key} differs from the configuration of the running daemon, for which the result is valid: restart \
             the daemon with this file first, or give --write the file with which it runs"
        );
    }
    Ok(())
}

/// Changes a configuration file atomically; the result must be a valid configuration.
///
/// # Errors
/// The file cannot be read or written, or the result would be invalid.
pub fn write(path: &Path, changes: &[Change]) -> anyhow::Result<()> {
    rewrite(path, |text, name| {
        Config::parse(text, name)?;
        let after = apply(text, changes).with_context(|| name.to_owned())?;
        Config::parse(&after, name)?;
        Ok(after)
    })
}

/// Replaces a file's text atomically by what `change` makes of it and of the file's name; keeps owner and mode.
///
/// # Errors
/// The file cannot be read or written, or the error of `change`: then the file is unchanged.
pub fn rewrite(path: &Path, change: impl FnOnce(&str, &str) -> anyhow::Result<String>) -> anyhow::Result<()> {
    // Write to the target of a link, so that the link remains.
    let path = fs::canonicalize(path).with_context(|| format!("cannot find {}", path.display()))?;
    let text = read_text(&path, TEXT_BYTES_MAX).with_context(|| format!("cannot read {}", path.display()))?;
    let after = change(&text, &path.display().to_string())?;
    let before = fs::metadata(&path)?;
    write_atomically_with(&path, after.as_bytes(), |file| {
        // Fails without root, when this user owns the file already. The mode follows: chown may clear bits of it.
        let _not_root = fchown(file, Some(before.uid()), Some(before.gid()));
        file.set_permissions(before.permissions())
    })
    .with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    const FILE: &str = r#"# The station at the window.
station = "s"
[suit]
source = "external"   # from the other PC
latency_ms = 12       # by a stomp
[ground]              # Kistler's
source = "external"

# Where it stands.
[ground.frame]
yaw_deg = 3.0         # by eye
[subject]
id = "a"
height_m = 1.7
"#;

    fn change(key: &str, value: Value) -> Change {
        (key.to_owned(), value)
    }

    #[test]
    fn values_change_and_comments_are_preserved() {
        let changes = [
            change("suit.latency_ms", number(31.04, 0)),
            change("ground.frame.yaw_deg", number(-91.236_7, 2)),
            change("ground.frame.origin_m", numbers(&[0.123_46, -0.000_01, -0.05], 4)),
            change("ground.latency_ms", number(2.0, 1)),
        ];
        let after = apply(FILE, &changes).unwrap();
        for line in [
            "# The station at the window.",
            "source = \"external\"   # from the other PC",
            "latency_ms = 31.0       # by a stomp",
            "[ground]              # Kistler's",
            "# Where it stands.",
            "yaw_deg = -91.24         # by eye",
            "origin_m = [0.1235, 0.0, -0.05]",
        ] {
            assert!(after.contains(line), "{line:?} is not in\n{after}");
        }
        let config = Config::parse(&after, "after").unwrap();
        assert_eq!((config.suit.latency_ms, config.ground.latency_ms), (31.0, 2.0));
        assert_eq!(config.ground.frame.yaw_deg, -91.24);
        assert_eq!(apply(FILE, &[]).unwrap(), FILE);
    }

    #[test]
    fn a_missing_table_is_created() {
        let without_table = FILE.replace("[ground.frame]\nyaw_deg = 3.0         # by eye\n", "");
        let after = apply(&without_table, &[change("ground.frame.yaw_deg", number(5.0, 2))]).unwrap();
        assert_eq!(Config::parse(&after, "after").unwrap().ground.frame.yaw_deg, 5.0);
    }

    #[test]
    fn only_the_file_of_the_measured_daemon_is_accepted() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("s.toml");
        let active = Config::parse(FILE, "active").unwrap();
        let check = |before: &str, after: &str, calibrated| {
            assert!(FILE.contains(before));
            fs::write(&path, FILE.replace(before, after)).unwrap();
            check(&path, &active, calibrated).map_err(|error| error.to_string())
        };
        for calibrated in [Calibrated::Frames, Calibrated::Latencies] {
            assert_eq!(check("height_m = 1.7", "height_m = 1.8", calibrated), Ok(()));
            let refusal = check("station = \"s\"", "station = \"t\"", calibrated).unwrap_err();
            assert!(refusal.contains("of station t, but station s is measured"), "{refusal}");
            let refusal = check("[ground.frame]", "[ground.frame]\nsize_m = [0.5, 0.5]", calibrated);
            assert_eq!(refusal.is_err(), calibrated == Calibrated::Frames, "{refusal:?}");
            let refusal = check("latency_ms = 12 ", "latency_ms = 13 ", calibrated);
            assert_eq!(refusal.is_err(), calibrated == Calibrated::Latencies, "{refusal:?}");
            let refusal = check("[ground] ", "[ground]\nmeasures = \"reaction\" ", calibrated).unwrap_err();
            assert!(refusal.contains("ground.measures differs"), "{refusal}");
        }
    }

    #[test]
    fn a_change_is_atomic() {
        let directory = tempfile::tempdir().unwrap();
        let (path, link) = (directory.path().join("s.toml"), directory.path().join("link.toml"));
        fs::write(&path, FILE).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o604)).unwrap();
        std::os::unix::fs::symlink("s.toml", &link).unwrap();
        let refused = write(&link, &[change("suit.latency_ms", number(-5.0, 1))]).unwrap_err();
        assert!(refused.to_string().contains("suit.latency_ms"), "{refused}");
        assert_eq!(fs::read_to_string(&path).unwrap(), FILE);
        write(&link, &[change("suit.latency_ms", number(5.0, 1))]).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o604);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 2);
        assert!(write(&directory.path().join("none.toml"), &[]).is_err());
    }
}
