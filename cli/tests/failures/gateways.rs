//! A gateway in interaction with the service manager and a peer.

use std::net::UdpSocket;
use std::os::unix::net::UnixDatagram;

use rustix::process::Signal;

use crate::process::TIMEOUT;
use crate::station::Station;

#[test]
fn a_gateway_notifies_systemd_of_ready_watchdog_and_stopping() {
    let station = Station::new();
    let socket = station.file("notify");
    let notified = UnixDatagram::bind(&socket).expect("a socket");
    notified.set_read_timeout(Some(TIMEOUT)).expect("a timeout");
    let receive = || {
        let mut received = [0; 4096];
        let length = notified.recv(&mut received).expect("a notification of the gateway");
        String::from_utf8_lossy(&received[..length]).into_owned()
    };
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a peer");
    peer.set_read_timeout(Some(TIMEOUT)).expect("a timeout");
    let to = peer.local_addr().expect("its address");
    let section = format!("[gateways.udp]\nto = [\"{to}\"]\nrate_hz = 50\n");
    let path = station.write("gateways.toml", &(station.configuration() + &section));

    let arguments = ["gateway", "udp", "--config", &path.to_string_lossy()];
    let mut gateway = station.spawn_with(&arguments, &[("NOTIFY_SOCKET", socket.as_os_str())]);
    assert!(receive().contains("READY=1"));
    let mut datagram = [0; 2048];
    assert!(peer.recv(&mut datagram).expect("a datagram without a state") > 0);
    for _ in 0..2 {
        assert!(receive().contains("WATCHDOG=1"), "{}", gateway.stderr());
    }
    assert_eq!(gateway.stop(Signal::TERM), Some(0), "{}", gateway.stderr());
    while !receive().contains("STOPPING=1") {}
}
