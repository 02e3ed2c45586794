//! Ports of this computer that two sections name. Only one of them could open the port; the other would stay without
//! data.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use super::ground::GroundSourceKind;
use super::ground::second::InvalidField;
use super::suit::SuitSourceKind;
use super::{Config, GroundConfig};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Protocol {
    Udp,
    Tcp,
}

/// Checks that no port is opened twice.
pub(super) fn check(config: &Config) -> Result<(), InvalidField> {
    let listeners = listeners(config);
    for (index, (key, protocol, address)) in listeners.iter().enumerate() {
        let before = listeners[..index]
            .iter()
            .find(|(_, other_protocol, other)| other_protocol == protocol && is_same_port(*other, *address));
        if let Some((other, ..)) = before {
            let what = format!(
                "{address} is also the port of {other}, and only one of them can open it; use another"
            );
            return Err(((*key).into(), what));
        }
    }
    let serial =
        |ground: &GroundConfig| Some(ground.serial.as_ref().filter(|_| is_read(ground))?.port.clone());
    let second = config.ground.second.as_deref().and_then(serial);
    match (serial(&config.ground), second) {
        (Some(first), Some(second)) if target(&first) == target(&second) => Err((
            "ground.second.serial.port".into(),
            format!(
                "{} is also the port of ground.serial, and each device has its own; see `ls -l /dev/serial/by-id`",
                second.display()
            ),
        )),
        _ => Ok(()),
    }
}

/// Keys of the addresses on which processes of this configuration listen.
fn listeners(config: &Config) -> Vec<(&'static str, Protocol, SocketAddr)> {
    let suit = match config.suit.source {
        SuitSourceKind::MvnUdp => Some((Protocol::Udp, config.suit.listen)),
        SuitSourceKind::MvnTcp => Some((Protocol::Tcp, config.suit.listen)),
        SuitSourceKind::External => None,
    };
    let ground = |ground: &GroundConfig| Some((Protocol::Udp, ground.listen.filter(|_| is_read(ground))?));
    let tcp = |address: SocketAddr| (Protocol::Tcp, address);
    let all = [
        ("suit.listen", suit),
        ("ground.listen", ground(&config.ground)),
        ("ground.second.listen", config.ground.second.as_deref().and_then(ground)),
        ("page.listen", config.page.as_ref().map(|page| tcp(page.listen))),
        ("metrics.listen", config.metrics.as_ref().map(|metrics| tcp(metrics.listen))),
        ("gateways.opcua.listen", config.gateways.opcua.as_ref().map(|opcua| tcp(opcua.listen))),
        ("gateways.foxglove.listen", config.gateways.foxglove.as_ref().map(|foxglove| tcp(foxglove.listen))),
    ];
    let given = |(key, listener): (_, Option<(Protocol, SocketAddr)>)| {
        listener.map(|(protocol, address)| (key, protocol, address))
    };
    all.into_iter().filter_map(given).collect()
}

/// Whether a process of this configuration reads the device.
fn is_read(ground: &GroundConfig) -> bool {
    ground.source != GroundSourceKind::External
}

/// Port 0 is any free port.
fn is_same_port(a: SocketAddr, b: SocketAddr) -> bool {
    let overlap =
        a.ip().to_canonical() == b.ip().to_canonical() || a.ip().is_unspecified() || b.ip().is_unspecified();
    a.port() != 0 && a.port() == b.port() && overlap
}

/// The device to which the names under /dev/serial/by-id are links.
fn target(port: &Path) -> PathBuf {
    port.canonicalize().unwrap_or_else(|_| port.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "transport = \"udp\"\ndelimiter = \"comma\"\ncolumns = [\"fz\"]\n";

    /// A suit, two text devices with these keys of their connection, and more sections.
    fn refusal(suit: &str, [first, second]: [&str; 2], more: &str) -> Option<String> {
        let device = |table: &str, keys: &str| {
            let (keys, sections) = keys
                .split_once("\n[")
                .map_or((keys, String::new()), |(keys, sections)| (keys, format!("[{table}.{sections}\n")));
            let text = if sections.is_empty() { TEXT.to_owned() } else { TEXT.replace("udp", "serial") };
            format!(
                "[{table}]\nsource = \"text\"\n{keys}\n{sections}[{table}.text]\n{text}[{table}.channels.wrench]\nforce = \
                 \"N\"\n"
            )
        };
        let text = format!(
            "station = \"s\"\n[suit]\n{suit}\n{}{}[subject]\nid = \"a\"\nheight_m = 1.7\n{more}",
            device("ground", first),
            device("ground.second", second)
        );
        Config::parse(&text, "c.toml").err().map(|error| error.to_string())
    }

    #[test]
    fn a_port_that_two_sections_open_is_refused() {
        let suit = "source = \"mvn-udp\"\nlisten = \"0.0.0.0:9763\"";
        let listen = ["listen = \"0.0.0.0:9000\"", "listen = \"127.0.0.1:9001\""];
        assert_eq!(refusal(suit, listen, ""), None);
        let page = "[page]\nlisten = \"127.0.0.1:8080\"\n";
        let cases = [
            (
                suit,
                ["listen = \"127.0.0.1:9763\"", listen[1]],
                "",
                "ground.listen: 127.0.0.1:9763 is also the port of suit",
            ),
            (
                suit,
                [listen[0], "listen = \"127.0.0.1:9000\""],
                "",
                "ground.second.listen: 127.0.0.1:9000 is also",
            ),
            (
                suit,
                listen,
                &*format!("{page}[metrics]\nlisten = \"127.0.0.1:8080\"\n"),
                "metrics.listen: 127.0.0.1:8080",
            ),
            (
                "source = \"mvn-tcp\"\nlisten = \"127.0.0.1:8080\"",
                listen,
                page,
                "page.listen: 127.0.0.1:8080 is also",
            ),
        ];
        for (suit, ground, more, expected) in cases {
            let message = refusal(suit, ground, more).expect("must be refused");
            assert!(message.contains(expected), "{expected:?} is not in {message}");
            assert!(message.starts_with("c.toml, line "), "{message}");
        }
        // Another protocol, another process, another address, any free port.
        assert_eq!(refusal("source = \"mvn-udp\"\nlisten = \"127.0.0.1:8080\"", listen, page), None);
        assert_eq!(refusal("source = \"external\"\nlisten = \"127.0.0.1:9000\"", listen, ""), None);
        let other = ["listen = \"192.168.1.2:9000\"", "listen = \"127.0.0.1:9000\""];
        assert_eq!(refusal(suit, other, ""), None);
        assert_eq!(refusal(suit, ["listen = \"127.0.0.1:0\"", "listen = \"127.0.0.1:0\""], ""), None);
    }

    #[test]
    fn a_serial_port_of_two_devices_is_refused_under_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let (device, link) = (folder.path().join("ttyUSB0"), folder.path().join("by-id"));
        std::fs::write(&device, "").unwrap();
        std::os::unix::fs::symlink(&device, &link).unwrap();
        let check = |first: &Path, second: &Path| {
            let keys =
                [first, second].map(|port| format!("\n[serial]\nport = {:?}", port.display().to_string()));
            refusal("source = \"external\"", keys.each_ref().map(String::as_str), "")
        };
        for second in [&device, &link] {
            let message = check(&device, second).expect("must be refused");
            assert!(
                message.contains("ground.second.serial.port: ")
                    && message.contains("each device has its own"),
                "{message}"
            );
        }
        assert_eq!(check(&device, &folder.path().join("ttyUSB1")), None);
    }

    #[test]
    fn a_recorded_configuration_keeps_two_serial_ports() {
        let text = include_str!("../../examples/sensors/bota.toml");
        let mut config = Config::parse(text, "bota.toml").unwrap();
        let mut second = config.ground.clone();
        for (ground, port) in [(&mut config.ground, "/dev/left/plate"), (&mut second, "/dev/right/plate")] {
            ground.serial.as_mut().unwrap().port = port.into();
        }
        config.ground.second = Some(Box::new(second));
        let recorded = config.for_recording();
        assert!(Config::parse(&recorded.to_toml(), "recorded").is_ok());
    }
}
