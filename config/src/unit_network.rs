//! Peers that the shipped units cannot reach without a drop-in: their `IPAddressAllow=` admits this PC only.

use std::net::{IpAddr, SocketAddr};

use super::Config;
use super::gateways::GatewaysConfig;

/// Protocols of Zenoh whose endpoints have a host.
const ZENOH_PROTOCOLS: [&str; 5] = ["tcp", "udp", "tls", "quic", "ws"];

/// Peers on other machines.
struct Peers {
    /// The key that names or admits them.
    key: String,
    unit: String,
    /// Address or name; `None` if they connect or send to this PC.
    host: Option<String>,
}

/// Notes for `equipoise check`, one for each peer that needs a drop-in; without effect outside systemd.
pub fn notes(config: &Config) -> Vec<String> {
    let page = config.page.as_ref().filter(|page| !page.listen.ip().is_loopback());
    let page = page.map(|_| Peers::sending("page.listen", "equipoise-view"));
    sensors(config)
        .into_iter()
        .chain(page)
        .chain(gateways(&config.gateways))
        .map(|peers| peers.note())
        .collect()
}

fn sensors(config: &Config) -> Vec<Peers> {
    let mut all = Vec::new();
    if config.suit.source.transport().is_some() && config.suit.allow_remote {
        all.push(Peers::sending("suit.allow_remote", "equipoise-adapter@suit"));
    }
    let unit = "equipoise-adapter@ground";
    let devices = [("ground", Some(&config.ground)), ("ground.second", config.ground.second.as_deref())];
    for (table, device) in devices.into_iter().filter_map(|(table, device)| Some((table, device?))) {
        if device.allow_remote {
            all.push(Peers::sending(&format!("{table}.allow_remote"), unit));
        }
        all.extend(device.address.and_then(|address| Peers::at(&format!("{table}.address"), unit, address)));
    }
    all
}

fn gateways(gateways: &GatewaysConfig) -> Vec<Peers> {
    let mut all = Vec::new();
    for to in gateways.udp.iter().flat_map(|udp| &udp.to) {
        all.extend(Peers::at("gateways.udp.to", "equipoise-gateway@udp", *to));
    }
    if let Some(rtde) = &gateways.rtde {
        all.extend(Peers::at("gateways.rtde.robot", "equipoise-gateway@rtde", rtde.robot));
    }
    if gateways.opcua.as_ref().is_some_and(|opcua| !opcua.is_local()) {
        all.push(Peers::sending("gateways.opcua.listen", "equipoise-gateway@opcua"));
    }
    if let Some(mqtt) = &gateways.mqtt {
        all.extend(Peers::named("gateways.mqtt.broker", "equipoise-gateway@mqtt", &mqtt.broker));
    }
    let unit = "equipoise-gateway@zenoh";
    if let Some(zenoh) = &gateways.zenoh {
        let hosts = zenoh.connect.iter().filter_map(|endpoint| zenoh_host(endpoint));
        all.extend(hosts.filter_map(|host| Peers::named("gateways.zenoh.connect", unit, host)));
        let mut listens = zenoh.listen.iter().filter_map(|endpoint| zenoh_host(endpoint));
        if listens.any(|host| !is_this_pc(host)) {
            all.push(Peers::sending("gateways.zenoh.listen", unit));
        }
    }
    all
}

/// `192.0.2.30` of `tcp/192.0.2.30:7447`; `None` for a protocol without hosts.
fn zenoh_host(endpoint: &str) -> Option<&str> {
    let (protocol, address) = endpoint.split_once('/')?;
    let address = address.split(['?', '#']).next().unwrap_or(address);
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    ZENOH_PROTOCOLS.contains(&protocol).then(|| host.trim_matches(['[', ']']))
}

/// Whether only this PC is behind an address or name. An unspecified address is not: it admits every peer.
fn is_this_pc(host: &str) -> bool {
    host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.to_canonical().is_loopback())
}

impl Peers {
    fn sending(key: &str, unit: &str) -> Peers {
        Peers { key: key.to_owned(), unit: unit.to_owned(), host: None }
    }

    fn at(key: &str, unit: &str, address: SocketAddr) -> Option<Peers> {
        Peers::named(key, unit, &address.ip().to_canonical().to_string())
    }

    fn named(key: &str, unit: &str, host: &str) -> Option<Peers> {
        let (key, unit) = (key.to_owned(), unit.to_owned());
        (!is_this_pc(host)).then(|| Peers { key, unit, host: Some(host.to_owned()) })
    }

    fn note(&self) -> String {
        let Peers { key, unit, host } = self;
        let edit = format!("with `systemctl edit {unit}`");
        match host {
            None => format!(
                "{key}: the unit {unit} reaches this PC only; for other machines add IPAddressAllow= and their addresses \
                 {edit}"
            ),
            Some(host) => {
                let allow = if host.parse::<IpAddr>().is_ok() { host } else { " and its address" };
                format!(
                    "{key}: {host} is another machine, and the unit {unit} reaches this PC only; add IPAddressAllow={allow} \
                     {edit}"
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notes_with(sections: &str) -> Vec<String> {
        let smallest = super::super::tests::SMALLEST;
        notes(&Config::parse(&format!("{smallest}\n{sections}"), "the test's").unwrap())
    }

    #[test]
    fn units_with_network_sockets_admit_this_pc_only() {
        let units = [
            include_str!("../../systemd/equipoise-adapter@.service"),
            include_str!("../../systemd/equipoise-gateway@.service"),
            include_str!("../../systemd/equipoise-metrics.service"),
            include_str!("../../systemd/equipoise-view.service"),
        ];
        for unit in units {
            let filters: Vec<&str> = unit.lines().filter(|line| line.starts_with("IPAddress")).collect();
            assert_eq!(filters, ["IPAddressDeny=any", "IPAddressAllow=localhost"], "{unit}");
        }
        for unit in [
            include_str!("../../systemd/equipoise.service"),
            include_str!("../../systemd/equipoise-record.service"),
        ] {
            let filters: Vec<&str> = unit.lines().filter(|line| line.starts_with("IPAddress")).collect();
            assert_eq!(filters, ["IPAddressDeny=any"], "{unit}");
            assert!(unit.lines().any(|line| line == "PrivateNetwork=yes"), "{unit}");
        }
        for drop_in in [
            include_str!("../../examples/systemd/adapter-network.conf"),
            include_str!("../../examples/systemd/gateway-network.conf"),
            include_str!("../../examples/systemd/view-network.conf"),
        ] {
            let lines: Vec<&str> = drop_in.lines().filter(|line| !line.starts_with('#')).collect();
            assert!(lines[0] == "[Service]" && lines[1].starts_with("IPAddressAllow="), "{drop_in}");
        }
    }

    #[test]
    fn addresses_of_this_pc_are_admitted() {
        for (host, admitted) in [
            ("127.0.0.1", true),
            ("127.9.9.9", true),
            ("::1", true),
            ("::ffff:127.0.0.1", true),
            ("localhost", true),
            ("10.1.2.3", false),
            ("192.168.1.1", false),
            ("169.254.1.1", false),
            ("fe80::1", false),
            ("0.0.0.0", false),
            ("141.2.3.4", false),
            ("2001:db8::1", false),
            ("broker.plant.example", false),
        ] {
            assert_eq!(is_this_pc(host), admitted, "{host}");
        }
    }

    #[test]
    fn a_device_on_another_machine_is_reported_with_the_drop_in() {
        let config = |address: &str| {
            let mut config = Config::parse(super::super::tests::SMALLEST, "the test's").unwrap();
            config.ground.address = Some(address.parse().unwrap());
            notes(&config)
        };
        assert_eq!(config("127.0.0.1:49152"), [""; 0]);
        for ip in ["192.168.1.1", "141.2.3.4"] {
            let notes = config(&format!("{ip}:49152"));
            let edit = format!("IPAddressAllow={ip} with `systemctl edit equipoise-adapter@ground`");
            assert!(notes.len() == 1 && notes[0].contains(&edit), "{notes:?}");
        }
    }

    #[test]
    fn peers_of_page_and_gateways_are_reported() {
        let here = "[page]\nlisten = \"127.0.0.1:8080\"\n[gateways.udp]\nto = [\"127.0.0.1:7411\"]\n[gateways.rtde]\nrobot = \
                    \"127.0.0.1:30004\"\n[gateways.opcua]\nlisten = \"127.0.0.1:4840\"\n[gateways.mqtt]\nbroker = \
                    \"localhost\"\n[gateways.zenoh]\nlisten = [\"tcp/[::1]:7447\"]\nconnect = [\"tcp/127.0.0.1:7448\"]\n";
        assert_eq!(notes_with(here), [""; 0]);
        let elsewhere = "[page]\nlisten = \"0.0.0.0:8080\"\ntoken_file = \"t\"\n[gateways.udp]\nto = [\"127.0.0.1:7411\", \
                         \"10.0.0.7:7411\"]\n[gateways.rtde]\nrobot = \"10.0.0.8:30004\"\n[gateways.opcua]\nlisten = \
                         \"10.0.0.1:4840\"\nusers_file = \"u\"\n[gateways.mqtt]\nbroker = \"broker.plant.example\"\nca_file = \
                         \"ca\"\n[gateways.zenoh]\nlisten = [\"tcp/0.0.0.0:7447\"]\nconnect = [\"tls/10.0.0.9:7448#x=y\"]\n";
        let expected = [
            "page.listen: the unit equipoise-view reaches this PC only; for other machines",
            "gateways.udp.to: 10.0.0.7 is another machine",
            "gateways.rtde.robot: 10.0.0.8 is another machine",
            "gateways.opcua.listen: the unit equipoise-gateway@opcua reaches this PC only",
            "gateways.mqtt.broker: broker.plant.example is another machine",
            "gateways.zenoh.connect: 10.0.0.9 is another machine",
            "gateways.zenoh.listen: the unit equipoise-gateway@zenoh reaches this PC only",
        ];
        let notes = notes_with(elsewhere);
        assert_eq!(notes.len(), expected.len(), "{notes:#?}");
        for (note, expected) in notes.iter().zip(expected) {
            assert!(note.starts_with(expected), "{note}");
        }
        assert!(notes[4].contains("add IPAddressAllow= and its address with"), "{}", notes[4]);
    }
}
