//! The Zenoh session: only the links that were asked for, and nothing that waits.

use anyhow::{Context, anyhow};
use equipoise_outlets::config::ZenohConfig;
use zenoh::{Config, Session, Wait};

/// A session by the configuration. A router that is not there yet is connected to when it comes.
///
/// # Errors
/// An endpoint or a file that Zenoh does not understand, or an address that cannot be listened at.
pub fn open(config: &ZenohConfig) -> anyhow::Result<Session> {
    zenoh::open(settings(config)?).wait().map_err(|error| {
        anyhow!("cannot open a Zenoh session: {error}; see outlets.zenoh.connect and .listen")
    })
}

/// Zenoh's own defaults would listen at every address and look for others by multicast. Gossip tells a router whom it must
/// hand messages on to; whoever it tells of is not connected to: links are the configuration's affair.
const OWN: [(&str, &str); 5] = [
    ("mode", "\"peer\""),
    ("connect/endpoints", "[]"),
    ("listen/endpoints", "[]"),
    ("scouting/multicast/enabled", "false"),
    ("scouting/gossip/autoconnect", r#"{"router": [], "peer": [], "client": []}"#),
];

/// Zenoh's defaults, ours in their place, what the file says in place of ours, and what the section says in place of all.
fn settings(config: &ZenohConfig) -> anyhow::Result<Config> {
    let mut settings = match &config.file {
        Some(path) => Config::from_file(path)
            .map_err(|error| anyhow!("{error}"))
            .with_context(|| format!("outlets.zenoh.file = {}", path.display()))?,
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
    // A queue that is full is a peer that does not read: it loses the message, and the next beat does not wait for it.
    set(&mut settings, "transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0")?;
    // Batches that wait for a peer; with two, of 64 KiB each, messages are lost whenever the machine is busy for a moment.
    for priority in ["real_time", "data"] {
        set(&mut settings, &format!("transport/link/tx/queue/size/{priority}"), "4")?;
    }
    Ok(settings)
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
    use equipoise_outlets::StationFile;

    /// What Zenoh is told with this file and these keys.
    fn with_file(file: &str, keys: &str) -> Config {
        let folder =
            std::env::temp_dir().join(format!("equipoise-zenoh-{}-{}", std::process::id(), file.len()));
        std::fs::create_dir_all(&folder).expect("a folder");
        std::fs::write(folder.join("zenoh.json5"), file).expect("a file");
        let station = format!("station = \"s\"\n[outlets.zenoh]\nfile = \"zenoh.json5\"\n{keys}\n");
        std::fs::write(folder.join("station.toml"), station).expect("a file");
        let config = StationFile::read(&folder.join("station.toml")).map(|file| file.outlets.zenoh);
        let settings = settings(&config.expect("readable").expect("a section"));
        std::fs::remove_dir_all(&folder).expect("cleared away");
        settings.expect("Zenoh understands it")
    }

    #[test]
    fn a_file_opens_only_what_it_says() {
        let tls = r#"{ transport: { link: { tls: { close_link_on_expiration: true } } } }"#;
        let closed = with_file(tls, "connect = [\"tls/192.0.2.30:7447\"]");
        let told = |settings: &Config, key: &str| get(settings, key).expect("a key of Zenoh's");
        assert_eq!(told(&closed, "listen/endpoints"), "[]");
        assert_eq!(told(&closed, "connect/endpoints"), "[\"tls/192.0.2.30:7447\"]");
        assert_eq!(told(&closed, "scouting/multicast/enabled"), "false");
        assert!(
            !told(&closed, "scouting/gossip/autoconnect").contains("peer\":[\""),
            "links that gossip tells of"
        );
        assert_eq!(told(&closed, "mode"), "\"peer\"");
        assert_eq!(told(&closed, "transport/link/tls/close_link_on_expiration"), "true");

        let said = r#"{ mode: "router", listen: { endpoints: ["tcp/192.0.2.17:7447"] },
                        scouting: { multicast: { enabled: true } } }"#;
        let open = with_file(said, "");
        assert_eq!(told(&open, "mode"), "\"router\"");
        assert_eq!(told(&open, "listen/endpoints"), "[\"tcp/192.0.2.17:7447\"]");
        assert_eq!(told(&open, "scouting/multicast/enabled"), "true");
    }
}
