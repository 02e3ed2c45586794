//! The Zenoh session: only configured links, and no blocking on slow peers.

use std::path::Path;

use anyhow::{Context, anyhow};
use equipoise_files::secret;
use equipoise_gateways::config::ZenohConfig;
use serde_json::Value;
use zenoh::{Config, Session, Wait};

/// Opens a session as configured. A router that is not reachable yet is connected to later.
///
/// # Errors
/// Zenoh rejects an endpoint or a file, or cannot listen at an address.
pub fn open(config: &ZenohConfig) -> anyhow::Result<Session> {
    zenoh::open(settings(config)?).wait().map_err(|error| {
        anyhow!("cannot open a Zenoh session: {error}; see gateways.zenoh.connect and .listen")
    })
}

/// Zenoh's defaults would listen at every address and discover peers by multicast. Gossip stays on, because a router
/// needs it for forwarding, but discovered peers are never connected to: only configured links are used.
const OWN: [(&str, &str); 5] = [
    ("mode", "\"peer\""),
    ("connect/endpoints", "[]"),
    ("listen/endpoints", "[]"),
    ("scouting/multicast/enabled", "false"),
    ("scouting/gossip/autoconnect", r#"{"router": [], "peer": [], "client": []}"#),
];

/// Merges settings; in order of increasing precedence: Zenoh's defaults, the defaults of this gateway, the file, the
/// section of the configuration.
fn settings(config: &ZenohConfig) -> anyhow::Result<Config> {
    let mut settings = match &config.file {
        Some(path) => of_file(path).with_context(|| format!("gateways.zenoh.file = {}", path.display()))?,
        None => Config::default(),
    };
    let defaults = Config::default();
    for (key, value) in OWN {
        if get(&settings, key)? == get(&defaults, key)? {
            set(&mut settings, key, value)?;
        }
    }
    for (key, endpoints) in [("connect/endpoints", &config.connect), ("listen/endpoints", &config.listen)] {
        if !endpoints.is_empty() {
            set(&mut settings, key, &serde_json::to_string(endpoints)?)?;
        }
    }
    refuse_open_secrets(&settings)?;
    // A full queue means that the peer does not read: drop the message at once, so that the next tick is not delayed.
    set(&mut settings, "transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0")?;
    // Batches queued per peer; with two of 64 KiB each, short busy periods of the machine already lose messages.
    for priority in ["real_time", "data"] {
        set(&mut settings, &format!("transport/link/tx/queue/size/{priority}"), "4")?;
    }
    Ok(settings)
}

/// Reads the file, if only its owner has access: it may contain passwords and keys.
fn of_file(path: &Path) -> anyhow::Result<Config> {
    let text = secret::read(path)?;
    let is_json = path.extension().is_some_and(|ending| ending == "json5" || ending == "json");
    // Zenoh parses other formats itself.
    let read = if is_json { Config::from_json5(&text) } else { Config::from_file(path) };
    read.map_err(|error| anyhow!("{error}"))
}

/// Zenoh settings that name a file with a private key or passwords.
const SECRET_FILES: [&str; 4] = [
    "transport/link/tls/listen_private_key",
    "transport/link/tls/connect_private_key",
    "transport/auth/usrpwd/dictionary_file",
    "transport/auth/pubkey/private_key_file",
];
/// An endpoint may name such a file, too: `tls/host:port#connect_private_key_file=PATH;…`.
const SECRET_OF_ENDPOINT: &str = "_private_key_file";

/// Rejects files with keys and passwords that other users can read; Zenoh itself accepts them.
fn refuse_open_secrets(settings: &Config) -> anyhow::Result<()> {
    for key in SECRET_FILES {
        if let Some(path) = serde_json::from_str::<Option<String>>(&get(settings, key)?)? {
            secret::read(Path::new(&path)).with_context(|| format!("Zenoh's {key}"))?;
        }
    }
    for key in ["connect/endpoints", "listen/endpoints"] {
        let mut endpoints = Vec::new();
        texts(serde_json::from_str(&get(settings, key)?)?, &mut endpoints);
        for (endpoint, name, path) in endpoints.iter().flat_map(|endpoint| own_files(endpoint)) {
            secret::read(Path::new(path)).with_context(|| format!("Zenoh's {key}, {endpoint}, {name}"))?;
        }
    }
    Ok(())
}

/// Endpoint address, parameter name and path of each key file that an endpoint names.
fn own_files(endpoint: &str) -> impl Iterator<Item = (&str, &str, &str)> {
    let (address, own) = endpoint.split_once('#').unwrap_or((endpoint, ""));
    let pairs = own.split(';').filter_map(|pair| pair.split_once('='));
    pairs
        .filter(|(name, _)| name.ends_with(SECRET_OF_ENDPOINT))
        .map(move |(name, path)| (address, name, path))
}

/// Collects all strings of a value: endpoints are a list, or lists per session mode.
fn texts(value: Value, found: &mut Vec<String>) {
    match value {
        Value::String(text) => found.push(text),
        Value::Array(values) => values.into_iter().for_each(|value| texts(value, found)),
        Value::Object(values) => values.into_iter().for_each(|(_, value)| texts(value, found)),
        _ => {}
    }
}

fn get(settings: &Config, key: &str) -> anyhow::Result<String> {
    settings.get_json(key).map_err(|error| anyhow!("Zenoh's {key}: {error}"))
}

fn set(settings: &mut Config, key: &str, value: &str) -> anyhow::Result<()> {
    settings.insert_json5(key, value).map_err(|error| anyhow!("Zenoh's {key} = {value}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_gateways::StationFile;
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;

    /// A station's folder; its Zenoh file is readable by its owner only, unless a test changes that.
    struct Folder(tempfile::TempDir);

    impl Folder {
        fn with(zenoh: &str) -> Folder {
            let folder = Folder(tempfile::tempdir().expect("a folder"));
            folder.put("zenoh.json5", zenoh, 0o600);
            folder
        }

        fn path(&self, name: &str) -> String {
            self.0.path().join(name).to_str().expect("plain characters").to_owned()
        }

        fn put(&self, name: &str, text: &str, mode: u32) {
            std::fs::write(self.path(name), text).expect("a file");
            std::fs::set_permissions(self.path(name), Permissions::from_mode(mode)).expect("its mode");
        }

        /// Resulting settings with the folder's file and these keys.
        fn settings(&self, keys: &str) -> anyhow::Result<Config> {
            let station = format!("station = \"s\"\n[gateways.zenoh]\nfile = \"zenoh.json5\"\n{keys}\n");
            self.put("station.toml", &station, 0o644);
            let config = StationFile::read(Path::new(&self.path("station.toml")));
            settings(&config.expect("readable").gateways.zenoh.expect("a section"))
        }
    }

    /// Resulting settings with this file and these keys.
    fn with_file(file: &str, keys: &str) -> Config {
        Folder::with(file).settings(keys).expect("Zenoh understands it")
    }

    #[test]
    fn a_file_that_others_can_read_is_refused_for_it_may_hold_a_password() {
        let folder = Folder::with("{ transport: { auth: { usrpwd: { user: \"u\", password: \"p\" } } } }");
        let connect = "connect = [\"tcp/192.0.2.30:7447\"]";
        assert!(folder.settings(connect).is_ok());
        for mode in [0o644, 0o640, 0o602] {
            let file = folder.path("zenoh.json5");
            std::fs::set_permissions(&file, Permissions::from_mode(mode)).expect("its mode");
            let refusal = format!("{:#}", folder.settings(connect).expect_err("it is refused"));
            assert!(refusal.contains("gateways.zenoh.file"), "{refusal}");
            assert!(refusal.contains(&format!("chmod 0600 {file}")), "{refusal}");
        }
    }

    #[test]
    fn keys_and_passwords_that_others_can_read_are_refused_at_every_setting() {
        let tls = |name: &str, path: &str| {
            format!("{{ transport: {{ link: {{ tls: {{ {name}: {path:?} }} }} }} }}")
        };
        let auth = |name: &str, path: &str| format!("{{ transport: {{ auth: {{ {name}: {path:?} }} }} }} }}");
        let at = |where_: &str, path: &str, of: &str| {
            format!("{{ {where_}: {{ endpoints: {} }} }}", of.replace("PATH", path))
        };
        let endpoint =
            "[\"tls/192.0.2.30:7447#root_ca_certificate_file=/no/ca;connect_private_key_file=PATH\"]";
        let by_mode = "{ peer: [\"tls/192.0.2.17:7447#listen_private_key_file=PATH\"], router: [] }";
        type File<'a> = &'a dyn Fn(&str) -> String;
        let cases: [(&str, File<'_>); 6] = [
            ("transport/link/tls/listen_private_key", &|path| tls("listen_private_key", path)),
            ("transport/link/tls/connect_private_key", &|path| tls("connect_private_key", path)),
            ("transport/auth/usrpwd/dictionary_file", &|path| auth("usrpwd: { dictionary_file", path)),
            ("transport/auth/pubkey/private_key_file", &|path| auth("pubkey: { private_key_file", path)),
            ("connect/endpoints, tls/192.0.2.30:7447, connect_private_key_file", &|path| {
                at("connect", path, endpoint)
            }),
            ("listen/endpoints, tls/192.0.2.17:7447, listen_private_key_file", &|path| {
                at("listen", path, by_mode)
            }),
        ];
        for (named, file) in cases {
            let folder = Folder::with("");
            folder.put("zenoh.json5", &file(&folder.path("secret")), 0o600);
            let missing = format!("{:#}", folder.settings("").expect_err("there is none"));
            assert!(missing.contains(named) && missing.contains("cannot read"), "{missing}");
            folder.put("secret", "s", 0o640);
            let refusal = format!("{:#}", folder.settings("").expect_err("it is refused"));
            assert!(refusal.contains(named) && refusal.contains("chmod 0600"), "{refusal}");
            folder.put("secret", "s", 0o600);
            assert!(folder.settings("").is_ok(), "{named}: only its owner can read it");
        }
        // Key files named in the section are checked, too.
        let folder = Folder::with("{}");
        folder.put("secret", "s", 0o644);
        let keys = format!("connect = {}", endpoint.replace("PATH", &folder.path("secret")));
        let refusal = format!("{:#}", folder.settings(&keys).expect_err("it is refused"));
        assert!(refusal.contains("connect_private_key_file"), "{refusal}");
    }

    #[test]
    fn a_file_opens_only_what_it_says() {
        let tls = r#"{ transport: { link: { tls: { close_link_on_expiration: true } } } }"#;
        let closed = with_file(tls, "connect = [\"tls/192.0.2.30:7447\"]");
        let setting = |settings: &Config, key: &str| get(settings, key).expect("a key of Zenoh's");
        assert_eq!(setting(&closed, "listen/endpoints"), "[]");
        assert_eq!(setting(&closed, "connect/endpoints"), "[\"tls/192.0.2.30:7447\"]");
        assert_eq!(setting(&closed, "scouting/multicast/enabled"), "false");
        assert!(
            !setting(&closed, "scouting/gossip/autoconnect").contains("peer\":[\""),
            "links announced by gossip"
        );
        assert_eq!(setting(&closed, "mode"), "\"peer\"");
        assert_eq!(setting(&closed, "transport/link/tls/close_link_on_expiration"), "true");

        let said = r#"{ mode: "router", listen: { endpoints: ["tcp/192.0.2.17:7447"] },
                        scouting: { multicast: { enabled: true } } }"#;
        let open = with_file(said, "");
        assert_eq!(setting(&open, "mode"), "\"router\"");
        assert_eq!(setting(&open, "listen/endpoints"), "[\"tcp/192.0.2.17:7447\"]");
        assert_eq!(setting(&open, "scouting/multicast/enabled"), "true");
    }
}
