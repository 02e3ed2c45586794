//! Network captures: every link layer, fragments, truncated and damaged files.

use std::net::SocketAddr;

use equipoise_adapters::capture::{PcapCapture, PcapError, PcapWriter, UdpDatagram};
use etherparse::{IpFragOffset, IpNumber, Ipv4Header, PacketBuilder, VlanId};
use proptest::prelude::*;

const SOURCE: &str = "192.168.0.7:51000";
const DESTINATION: &str = "192.168.0.9:9763";

fn address(text: &str) -> SocketAddr {
    text.parse().unwrap()
}

fn ipv4_packet(payload: &[u8]) -> Vec<u8> {
    let mut packet = Vec::new();
    PacketBuilder::ipv4([192, 168, 0, 7], [192, 168, 0, 9], 64)
        .udp(51000, 9763)
        .write(&mut packet, payload)
        .unwrap();
    packet
}

/// A classic `.pcap`, microseconds, in either byte order.
fn pcap(link_type: u32, packets: &[Vec<u8>], big_endian: bool) -> Vec<u8> {
    let word = |value: u32| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let half = |value: u16| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let mut bytes = word(0xa1b2_c3d4).to_vec();
    bytes.extend([half(2), half(4)].concat());
    bytes.extend([word(0), word(0), word(65_535), word(link_type)].concat());
    for (index, packet) in packets.iter().enumerate() {
        let length = word(packet.len() as u32);
        bytes.extend([word(100), word(index as u32), length, length].concat());
        bytes.extend(packet);
    }
    bytes
}

/// A `.pcapng` with nanosecond stamps on one interface.
fn pcapng(link_type: u16, packets: &[Vec<u8>]) -> Vec<u8> {
    fn block(kind: u32, body: &[u8]) -> Vec<u8> {
        let padded = body.len().next_multiple_of(4);
        let length = (12 + padded as u32).to_le_bytes();
        let mut block = [kind.to_le_bytes(), length].concat();
        block.extend(body);
        block.resize(8 + padded, 0);
        block.extend(length);
        block
    }
    let mut section = 0x1a2b_3c4d_u32.to_le_bytes().to_vec();
    section.extend([1, 0, 0, 0]);
    section.extend(u64::MAX.to_le_bytes());
    let mut bytes = block(0x0a0d_0d0a, &section);
    let mut interface = link_type.to_le_bytes().to_vec();
    interface.extend([0, 0, 0, 0, 0, 0]);
    // if_tsresol = 10^-9, then the end of the options.
    interface.extend([9, 0, 1, 0, 9, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend(block(1, &interface));
    for (index, packet) in packets.iter().enumerate() {
        let time_ns = 5_000_000_000_u64 + index as u64;
        let mut body = [0_u32, (time_ns >> 32) as u32, time_ns as u32].map(u32::to_le_bytes).concat();
        body.extend([(packet.len() as u32).to_le_bytes(), (packet.len() as u32).to_le_bytes()].concat());
        body.extend(packet);
        bytes.extend(block(6, &body));
    }
    bytes
}

fn only(bytes: Vec<u8>) -> UdpDatagram {
    let mut capture = PcapCapture::from_bytes(bytes).unwrap();
    let datagrams: Vec<_> = capture.by_ref().collect();
    assert!(capture.rejected().is_empty(), "{}", capture.rejected());
    assert_eq!(capture.fault(), None);
    let [datagram] = &datagrams[..] else { panic!("{datagrams:?}") };
    assert_eq!((datagram.source, datagram.destination), (address(SOURCE), address(DESTINATION)));
    datagram.clone()
}

#[test]
fn what_is_written_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.pcap");
    let mut writer = PcapWriter::create(&path).unwrap();
    let pairs = [(SOURCE, DESTINATION), ("[::1]:7", "[fe80::2]:9")];
    for (index, (source, destination)) in pairs.into_iter().enumerate() {
        let time_ns = 1_700_000_000_123_456_789 + index as u64;
        writer.write_udp(time_ns, address(source), address(destination), &[index as u8; 1_500]).unwrap();
    }
    assert!(writer.write_udp(0, address(SOURCE), address("[::1]:7"), b"").is_err());
    assert!(writer.write_udp(0, address(SOURCE), address(DESTINATION), &[0; 70_000]).is_err());
    assert!(writer.write_udp(u64::MAX, address(SOURCE), address(DESTINATION), b"").is_err());
    writer.finish().unwrap();
    let datagrams: Vec<_> = PcapCapture::open(&path).unwrap().collect();
    assert_eq!(datagrams.len(), 2);
    for (index, (datagram, (source, destination))) in datagrams.iter().zip(pairs).enumerate() {
        assert_eq!(datagram.time_ns, 1_700_000_000_123_456_789 + index as u64);
        assert_eq!((datagram.source, datagram.destination), (address(source), address(destination)));
        assert_eq!(datagram.payload, [index as u8; 1_500]);
    }
}

#[test]
fn every_link_layer_gives_the_same_datagram() {
    let ip = ipv4_packet(b"MXTP02");
    // With this many VLAN tags, as added by a switch's mirror port.
    let ethernet = |tags: u16| {
        let mut packet = Vec::new();
        let builder = PacketBuilder::ethernet2([1; 6], [2; 6]);
        let [from, to] = [[192, 168, 0, 7], [192, 168, 0, 9]];
        let id = |number| VlanId::try_new(number).unwrap();
        let builder = match tags {
            0 => builder.ipv4(from, to, 64),
            1 => builder.single_vlan(id(17)).ipv4(from, to, 64),
            _ => builder.double_vlan(id(17), id(18)).ipv4(from, to, 64),
        };
        builder.udp(51000, 9763).write(&mut packet, b"MXTP02").unwrap();
        // Ethernet pads short frames; the padding is not part of the payload.
        packet.resize(packet.len().max(60), 0);
        packet
    };
    let with_head = |head: &[u8]| [head, &ip[..]].concat();
    let mut sll = vec![0; 14];
    sll.extend([8, 0]);
    let mut sll2 = vec![8, 0];
    sll2.extend([0; 18]);
    // The header announces a VLAN tag, and the tag announces IPv4.
    let tagged = |ether_type_at: usize, head: &[u8]| {
        let mut head = head.to_vec();
        head[ether_type_at..ether_type_at + 2].copy_from_slice(&[0x81, 0]);
        head.extend([0, 17, 8, 0]);
        head
    };
    let files = [
        (1, ethernet(0)),
        (1, ethernet(1)),
        (1, ethernet(2)),
        (0, with_head(&[2, 0, 0, 0])),
        (0, with_head(&[0, 0, 0, 2])),
        (108, with_head(&[0, 0, 0, 2])),
        (101, ip.clone()),
        (12, ip.clone()),
        (14, ip.clone()),
        (228, ip.clone()),
        (113, with_head(&sll)),
        (113, with_head(&tagged(14, &sll))),
        (276, with_head(&sll2)),
        (276, with_head(&tagged(0, &sll2))),
    ];
    for (link_type, packet) in files {
        for big_endian in [false, true] {
            let datagram = only(pcap(link_type, std::slice::from_ref(&packet), big_endian));
            assert_eq!(datagram.payload, b"MXTP02", "link type {link_type}");
            assert_eq!(datagram.time_ns, 100_000_000_000);
        }
        let datagram = only(pcapng(link_type as u16, &[packet]));
        assert_eq!((datagram.payload.as_slice(), datagram.time_ns), (&b"MXTP02"[..], 5_000_000_000));
    }
}

#[test]
fn ipv6_comes_on_every_link_layer_too() {
    let (from, to) = ("[fe80::1]:51000", "[fe80::2]:9763");
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    writer.write_udp(7, address(from), address(to), b"MXTP02").unwrap();
    let written = writer.finish().unwrap();
    // After the headers of file and packet.
    let ip = written[24 + 16..].to_vec();
    let behind = |head: &[u8]| [head, &ip[..]].concat();
    let ethernet = [&[1; 12][..], &[0x86, 0xdd]].concat();
    let sll = [&[0; 14][..], &[0x86, 0xdd]].concat();
    let sll2 = [&[0x86, 0xdd][..], &[0; 18]].concat();
    let files = [
        (1, behind(&ethernet)),
        (0, behind(&[30, 0, 0, 0])),
        (101, ip.clone()),
        (229, ip.clone()),
        (113, behind(&sll)),
        (276, behind(&sll2)),
    ];
    for (link_type, packet) in files {
        let mut capture = PcapCapture::from_bytes(pcap(link_type, &[packet], false)).unwrap();
        let datagrams: Vec<_> = capture.by_ref().collect();
        let [datagram] = &datagrams[..] else { panic!("{link_type}: {}", capture.rejected()) };
        assert_eq!((datagram.source, datagram.destination), (address(from), address(to)));
        assert_eq!(datagram.payload, b"MXTP02");
    }
}

fn fragments(payload: &[u8], identification: u16) -> Vec<Vec<u8>> {
    let whole = ipv4_packet(payload);
    let body = &whole[20..];
    let mut packets: Vec<Vec<u8>> = Vec::new();
    for (index, part) in body.chunks(1_480).enumerate() {
        let mut header =
            Ipv4Header::new(part.len() as u16, 64, IpNumber::UDP, [192, 168, 0, 7], [192, 168, 0, 9])
                .unwrap();
        header.identification = identification;
        header.dont_fragment = false;
        header.fragment_offset = IpFragOffset::try_new((index * 1_480 / 8) as u16).unwrap();
        header.more_fragments = (index + 1) * 1_480 < body.len();
        header.header_checksum = header.calc_header_checksum();
        let mut packet = Vec::new();
        header.write(&mut packet).unwrap();
        packet.extend(part);
        packets.push(packet);
    }
    packets
}

#[test]
fn fragments_are_put_together_in_any_order() {
    let payload: Vec<u8> = (0..4_000_u32).map(|n| n as u8).collect();
    let mut packets = fragments(&payload, 77);
    assert_eq!(packets.len(), 3);
    assert_eq!(only(pcap(101, &packets, false)).payload, payload);
    packets.reverse();
    assert_eq!(only(pcap(101, &packets, false)).payload, payload);

    packets.pop();
    let mut capture = PcapCapture::from_bytes(pcap(101, &packets, false)).unwrap();
    assert_eq!(capture.by_ref().count(), 0);
    assert_eq!(capture.rejected().of("fragments_missing"), 1);
}

/// CPU time of this thread, s.
fn thread_cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

#[test]
fn the_time_for_fragments_of_one_datagram_is_proportional_to_their_number() {
    // 8 bytes at every second multiple of 8, again and again: no two places are adjacent, and the last fragment never
    // arrives.
    let fragment = |number: usize| {
        let mut header = Ipv4Header::new(8, 64, IpNumber::UDP, [192, 168, 0, 7], [192, 168, 0, 9]).unwrap();
        header.dont_fragment = false;
        header.more_fragments = true;
        header.fragment_offset = IpFragOffset::try_new((number % 4095 * 2) as u16).unwrap();
        let mut packet = Vec::new();
        header.write(&mut packet).unwrap();
        packet.extend([0; 8]);
        packet
    };
    let cost_s = |count: usize| {
        let bytes = pcap(101, &(0..count).map(fragment).collect::<Vec<_>>(), false);
        let begun_s = thread_cpu_s();
        let mut capture = PcapCapture::from_bytes(bytes).unwrap();
        assert_eq!(capture.by_ref().count(), 0);
        assert_eq!(capture.rejected().to_string(), format!("1 fragments_missing (first at packet {count})"));
        thread_cpu_s() - begun_s
    };
    // The first 4095 fragments cost less than the others. Quadratic in their number, the ratio would be 16.
    let [few_s, many_s] = [8192, 4 * 8192].map(cost_s);
    assert!(many_s < 10.0 * few_s, "{few_s} s, {many_s} s");
}

#[test]
fn other_packets_are_counted_by_reason() {
    let mut tcp = Vec::new();
    PacketBuilder::ipv4([1; 4], [2; 4], 64).tcp(1, 2, 3, 4).write(&mut tcp, b"x").unwrap();
    let packets = [tcp, vec![0x45, 0], ipv4_packet(b"ok"), vec![]];
    let mut capture = PcapCapture::from_bytes(pcap(101, &packets, false)).unwrap();
    assert_eq!(capture.by_ref().count(), 1);
    assert_eq!(
        capture.rejected().to_string(),
        "2 malformed (first at packet 2), 1 not_udp (first at packet 1)"
    );
    let mut capture = PcapCapture::from_bytes(pcap(147, &[ipv4_packet(b"")], false)).unwrap();
    assert_eq!(capture.by_ref().count(), 0);
    assert_eq!(capture.rejected().of("unknown_link_type"), 1);
}

#[test]
fn a_file_cut_anywhere_gives_what_stands_before_the_cut() {
    let packets: Vec<_> = (0..5_u8).map(|n| ipv4_packet(&[n; 30])).collect();
    for whole in [pcap(101, &packets, false), pcapng(101, &packets)] {
        let expected: Vec<_> = PcapCapture::from_bytes(whole.clone()).unwrap().collect();
        assert_eq!(expected.len(), 5);
        for length in 0..whole.len() {
            let Ok(mut capture) = PcapCapture::from_bytes(whole[..length].to_vec()) else {
                assert!(length < 24, "cut at {length}");
                continue;
            };
            let datagrams: Vec<_> = capture.by_ref().collect();
            assert!(expected.starts_with(&datagrams), "cut at {length}");
            match capture.fault() {
                None => {}
                Some(PcapError::Truncated { packets, .. }) => assert_eq!(*packets, datagrams.len() as u64),
                Some(other) => panic!("cut at {length}: {other}"),
            }
        }
    }
}

#[test]
fn something_else_is_named() {
    let error = PcapCapture::from_bytes(b"t_s,Pelvis_px_m".to_vec()).unwrap_err().to_string();
    assert!(error.contains("t_s,Pelvis") && error.contains(".pcapng"), "{error}");
}

proptest! {
    #[test]
    fn damage_never_panics(at in 0_usize..600, value: u8, more in proptest::collection::vec(any::<u8>(), 0..64)) {
        let packets: Vec<_> = (0..4_u8).map(|n| ipv4_packet(&[n; 30])).collect();
        for mut bytes in [pcap(1, &packets, true), pcap(101, &packets, false), pcapng(101, &packets)] {
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.extend(&more);
            if let Ok(mut capture) = PcapCapture::from_bytes(bytes) {
                let _ = capture.by_ref().count();
            }
        }
    }
}
