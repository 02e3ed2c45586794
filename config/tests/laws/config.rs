//! Configurations: reading, writing and reading again gives the same. Shared with the target `config` of `fuzz/`.

use equipoise_config::Config;

/// An accepted configuration is accepted again in its written form; a refused one has an error message that names the
/// file.
///
/// # Panics
/// If the bytes violate that.
pub(crate) fn check(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match Config::parse(text, "some.toml") {
        Ok(config) => {
            let written = config.to_toml();
            let again = Config::parse(&written, "again.toml");
            assert!(again.as_ref().is_ok_and(|again| *again == config), "{again:?}\n{written}");
        }
        Err(refusal) => assert!(refusal.to_string().contains("some.toml"), "{refusal}"),
    }
}

/// The shipped files, as they are and with everything uncommented; and the minimal configuration.
pub(crate) fn seeds() -> Vec<Vec<u8>> {
    let shipped = include_str!("../../../systemd/equipoise.toml");
    let all: String = shipped.lines().map(|line| format!("{}\n", line.trim_start_matches('#'))).collect();
    let least = "station = \"a\"\n[suit]\nsource = \"mvn-udp\"\n[ground]\nsource = \"external\"\n\
                 [subject]\nid = \"a\"\nheight_m = 1.7\n";
    [shipped, &all, least].map(|text| text.as_bytes().to_vec()).to_vec()
}
