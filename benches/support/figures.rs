//! Figures as files, from which `plots` draws: one JSON file a bench, next to the build's results.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::options::Options;

/// One line of a result: what was measured, under which conditions, and the values.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Conditions: name and value.
    pub of: BTreeMap<String, String>,
    /// Values by name, units in the names.
    pub values: BTreeMap<String, f64>,
}

impl Figure {
    /// A figure under conditions.
    pub fn of<const N: usize>(conditions: [(&str, &str); N]) -> Figure {
        let of = conditions.map(|(name, value)| (name.to_owned(), value.to_owned())).into();
        Figure { of, values: BTreeMap::new() }
    }

    /// With one value more.
    pub fn with(mut self, name: &str, value: f64) -> Figure {
        self.values.insert(name.to_owned(), value);
        self
    }
}

/// Where results lie: `performance` in the target folder.
pub fn folder() -> PathBuf {
    let program = std::env::current_exe().unwrap_or_default();
    let built = program.ancestors().find(|folder| folder.ends_with("release") || folder.ends_with("debug"));
    built.and_then(|built| built.parent()).map(|target| target.join("performance")).unwrap_or_default()
}

/// Writes a bench's figures and says where; not those of a run that only showed that it works, or of a part.
pub fn write(bench: &str, options: &Options, figures: &[Figure]) {
    if options.quick || !options.only.is_empty() {
        return;
    }
    let path = folder().join(format!("{bench}.json"));
    let written = std::fs::create_dir_all(folder())
        .map_err(|error| error.to_string())
        .and_then(|()| serde_json::to_vec_pretty(figures).map_err(|error| error.to_string()))
        .and_then(|text| std::fs::write(&path, text).map_err(|error| error.to_string()));
    match written {
        Ok(()) => println!("figures: {}", path.display()),
        Err(error) => eprintln!("no figures for plots: cannot write {}: {error}", path.display()),
    }
}

/// Reads a bench's figures; empty if it has not run.
pub fn read(bench: &str) -> Vec<Figure> {
    let text = std::fs::read(folder().join(format!("{bench}.json")));
    text.ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
}
