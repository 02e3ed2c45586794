//! Configuration for tests.

use equipoise_config::Config;

/// Text of a configuration of station "s" with external sensors and a subject of 1.7 m; `more` are its last lines, which
/// begin in the table `[subject]`.
pub(crate) fn text(subject: &str, more: &str) -> String {
    format!(
        "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \"external\"\n[subject]\nid = \"{subject}\"\n\
         height_m = 1.7\n{more}"
    )
}

/// The same, parsed.
pub(crate) fn config(subject: &str, more: &str) -> Config {
    Config::parse(&text(subject, more), "the test's").unwrap()
}
