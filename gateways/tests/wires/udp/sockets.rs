//! Real sockets: every address gets every datagram, and no address blocks another.

use std::net::{SocketAddr, UdpSocket};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use equipoise_client::{NoReading, Reading};
use equipoise_gateways::Gateway;
use equipoise_gateways::udp::Udp;
use equipoise_gateways::udp::encode::CRC;
use equipoise_simulator::ports::free_address;

use crate::states::{reading, state};

fn receiver() -> (UdpSocket, SocketAddr) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(90))).unwrap();
    let address = socket.local_addr().unwrap();
    (socket, address)
}

fn received(socket: &UdpSocket) -> Vec<u8> {
    let mut bytes = [0; 2000];
    let count = socket.recv(&mut bytes).unwrap();
    bytes[..count].to_vec()
}

fn sequence(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes[48..56].try_into().unwrap())
}

#[test]
fn all_receivers_get_the_same_and_one_that_refuses_is_counted() {
    let (one, two) = (receiver(), receiver());
    // The receiver is closed, so datagrams to it are refused.
    let refusing = receiver().1;
    let mut gateway = Udp::new("cell-7", &[one.1, refusing, two.1]);
    for number in 1..=50 {
        gateway.send(&Ok(reading(state())));
        let (left, right) = (received(&one.0), received(&two.0));
        assert_eq!(left, right);
        assert_eq!(sequence(&left), number);
        let end = left.len() - 4;
        assert_eq!(CRC.checksum(&left[..end]).to_le_bytes(), left[end..]);
    }
    let tally = gateway.tally();
    assert_eq!(tally.peers, 2);
    assert!(tally.sent >= 100, "{tally}");
    assert!(tally.lost >= 25, "loopback reports at once that no process listens: {tally}");
}

#[test]
fn each_datagram_contains_the_number_of_the_daemons_starts() {
    let (socket, address) = receiver();
    let mut gateway = Udp::new("cell-7", &[address]);
    let silent = || Err(NoReading::Silent { silent: Duration::from_millis(40) });
    let after_starts = |daemon_life| Ok(Reading { daemon_life, ..reading(state()) });
    for (latest, starts) in [
        (silent(), 0),
        (after_starts(1), 1),
        (after_starts(1), 1),
        (silent(), 1),
        (after_starts(2), 2),
        (after_starts(2), 2),
        (silent(), 2),
    ] {
        gateway.send(&latest);
        let bytes = received(&socket);
        assert_eq!(u16::from_le_bytes(bytes[178..180].try_into().unwrap()), starts);
    }
}

#[test]
fn who_comes_back_gets_the_next_one() {
    let address = free_address().unwrap();
    let mut gateway = Udp::new("cell-7", &[address]);
    for _ in 0..10 {
        gateway.send(&Ok(reading(state())));
    }
    assert_eq!(gateway.tally().peers, 0);
    let socket = UdpSocket::bind(address).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(90))).unwrap();
    gateway.send(&Ok(reading(state())));
    assert_eq!(sequence(&received(&socket)), 11);
}

#[test]
fn a_receiver_that_does_not_read_delays_no_other() {
    let (stuck, reading_one) = (receiver(), receiver());
    let mut gateway = Udp::new("cell-7", &[stuck.1, reading_one.1]);
    // Far more than any socket buffer holds.
    for number in 1..=20_000 {
        gateway.send(&Ok(reading(state())));
        assert_eq!(sequence(&received(&reading_one.0)), number);
    }
    let _still_there = stuck;
}

#[test]
fn an_address_without_a_way_is_counted_and_the_others_are_served() {
    let (socket, address) = receiver();
    // 100::/64 is a discard-only prefix: sending either fails or is lost, depending on the machine's routes.
    let nowhere: SocketAddr = "[100::1]:9".parse().unwrap();
    let mut gateway = Udp::new("cell-7", &[nowhere, address]);
    for number in 1..=10 {
        gateway.send(&Ok(reading(state())));
        assert_eq!(sequence(&received(&socket)), number);
    }
    let tally = gateway.tally();
    assert_eq!(tally.sent + tally.lost, 20, "{tally}");
}

/// Changes the links of its network namespace.
#[test]
#[ignore = "needs a network namespace of its own: .ci/run udp-address"]
fn after_a_change_of_the_machines_address_it_sends_again() {
    let ip = |command: &str| {
        assert!(Command::new("ip").args(command.split(' ')).status().unwrap().success(), "ip {command}");
    };
    for command in [
        "link add name here type veth peer name there",
        "link set here up",
        "link set there up",
        "address add 10.99.0.5/24 dev here",
    ] {
        ip(command);
    }
    let mut gateway = Udp::new("cell-7", &["10.99.0.9:7411".parse().unwrap()]);
    let mut tell = || {
        gateway.send(&Ok(reading(state())));
        gateway.tally()
    };
    assert_eq!(tell().sent, 1);
    ip("address del 10.99.0.5/24 dev here");
    ip("address add 10.99.0.6/24 dev here");
    let begun = Instant::now();
    while tell().sent < 10 {
        assert!(begun.elapsed() < Duration::from_secs(90), "{}", tell());
        sleep(Duration::from_millis(20));
    }
    assert!(tell().lost > 0, "the change was not noticed");
}
