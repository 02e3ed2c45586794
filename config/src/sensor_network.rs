//! Sensors that the shipped unit `equipoise-adapter@` cannot reach without a drop-in: its `IPAddressAllow=` admits this
//! PC and private networks.

use std::net::IpAddr;

use super::Config;

/// Addresses admitted by the unit, in its notation.
#[cfg(test)]
const ADMITTED: &str =
    "localhost link-local multicast 255.255.255.255 10.0.0.0/8 172.16.0.0/12 192.168.0.0/16 fc00::/7";

/// Notes for `equipoise check`, one for each address that needs a drop-in; without effect outside systemd.
pub fn notes(config: &Config) -> Vec<String> {
    let mut notes = Vec::new();
    if config.suit.source.transport().is_some() && config.suit.allow_remote {
        notes.push(of_senders("suit"));
    }
    let devices = [("ground", Some(&config.ground)), ("ground.second", config.ground.second.as_deref())];
    for (table, device) in devices.into_iter().filter_map(|(table, device)| Some((table, device?))) {
        if device.allow_remote {
            notes.push(of_senders(table));
        }
        if let Some(ip) = device.address.map(|address| address.ip()).filter(|ip| !is_admitted(*ip)) {
            notes.push(format!(
                "{table}.address: {ip} is outside private networks, and the unit equipoise-adapter@ground cannot reach it; \
                 add IPAddressAllow={ip} with `systemctl edit equipoise-adapter@ground`"
            ));
        }
    }
    notes
}

fn of_senders(table: &str) -> String {
    let stream = table.split('.').next().unwrap_or(table);
    format!(
        "{table}.allow_remote: the unit equipoise-adapter@{stream} receives from private networks; for a sender with a \
         public address add IPAddressAllow= with `systemctl edit equipoise-adapter@{stream}`"
    )
}

fn is_admitted(ip: IpAddr) -> bool {
    match ip.to_canonical() {
        IpAddr::V4(ip) => {
            ip.is_loopback()
                || ip.is_private()
                || ip.is_link_local()
                || ip.is_multicast()
                || ip.is_broadcast()
                || ip.is_unspecified()
        }
        IpAddr::V6(ip) => {
            ip.is_loopback()
                || ip.is_unique_local()
                || ip.is_unicast_link_local()
                || ip.is_multicast()
                || ip.is_unspecified()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_admits_addresses_that_are_not_reported() {
        let unit = include_str!("../../systemd/equipoise-adapter@.service");
        assert!(unit.lines().any(|line| line == format!("IPAddressAllow={ADMITTED}")), "{unit}");
        for (ip, admitted) in [
            ("127.0.0.1", true),
            ("10.1.2.3", true),
            ("172.31.0.1", true),
            ("172.32.0.1", false),
            ("192.168.1.1", true),
            ("169.254.1.1", true),
            ("141.2.3.4", false),
            ("::ffff:192.168.1.1", true),
            ("fe80::1", true),
            ("fd12::1", true),
            ("2001:db8::1", false),
        ] {
            assert_eq!(is_admitted(ip.parse().unwrap()), admitted, "{ip}");
        }
    }

    #[test]
    fn a_device_with_a_public_address_is_reported_with_the_drop_in() {
        let smallest = super::super::tests::SMALLEST;
        let config = |address: &str| {
            let mut config = Config::parse(smallest, "the test's").unwrap();
            config.ground.address = Some(address.parse().unwrap());
            notes(&config)
        };
        assert_eq!(config("192.168.1.1:49152"), Vec::<String>::new());
        let notes = config("141.2.3.4:49152");
        assert!(notes.len() == 1 && notes[0].contains("IPAddressAllow=141.2.3.4"), "{notes:?}");
    }
}
