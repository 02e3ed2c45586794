//! Faults are named incidents: on the bus, in the journal, in `status` and in `watch`.

use std::net::UdpSocket;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_bus::{Bus, BusSettings, Channel, Event};
use equipoise_core::message::{GroundSample, Incident};
use rustix::process::{Pid, PidfdFlags, PidfdGetfdFlags, Signal, pidfd_getfd, pidfd_open};

use crate::adapters::external;
use crate::eyes::Eyes;
use crate::process::{Process, wait_for};
use crate::station::{NAME, Station};
use crate::streams;

/// The journal's line of an incident.
fn journal(kind: Incident) -> String {
    format!("incident=\"{}\"", kind.name())
}

#[test]
fn silence_is_reported_everywhere_with_its_remedy_and_ends_with_the_next_sample() {
    let station = Station::new();
    let person = station.person();
    let daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until("both sensors", Eyes::both_fresh);
    for (kind, silence) in [
        (Incident::SuitSilent, &(|silent| person.silence_suit(silent)) as &dyn Fn(bool)),
        (Incident::GroundSilent, &|silent| person.silence_plate(silent)),
    ] {
        silence(true);
        eyes.until(kind.name(), |eyes| eyes.goes_on(kind));
        assert!(daemon.stderr().contains(&journal(kind)), "{}", daemon.stderr());
        let text = station.run(&["status"]).done().to_owned();
        assert!(text.contains(&format!("INCIDENT {}", kind.name())), "{text}");
        assert!(text.contains("sends nothing any more: is") && !text.contains("to do:"), "{text}");
        let watched = station.run(&["watch", "--for", "2.5"]).done().to_owned();
        assert!(watched.contains(&format!("{} for ", kind.name())), "{watched}");
        let listed = |status: &serde_json::Value, list: &str| {
            let list = status["incidents"][list].as_array().cloned().unwrap_or_default();
            list.into_iter().find(|incident| incident["name"] == kind.name())
        };
        let status = station.status().expect("the daemon answers");
        let active = listed(&status, "active").expect("it goes on");
        assert!(active["what"].as_str().is_some_and(|what| what.contains("sends nothing")), "{active}");
        silence(false);
        eyes.until("its end", |eyes| !eyes.goes_on(kind));
        let status = station.status().expect("the daemon answers");
        assert_eq!(listed(&status, "past").expect("it was")["begun"], eyes.begun(kind), "{status}");
        assert!(listed(&status, "active").is_none(), "{status}");
    }
    assert!(!daemon.stderr().contains("phase="), "phases are none: {}", daemon.stderr());
}

#[test]
fn a_sensor_that_never_sends_is_reported_with_its_address() {
    let station = Station::new();
    let daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until("both to be missed", |eyes| {
        eyes.goes_on(Incident::SuitSilent) && eyes.goes_on(Incident::GroundSilent)
    });
    let said = daemon.stderr();
    for words in ["the suit has sent nothing yet", &station.suit.to_string(), &station.plate.to_string()] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_paused_stream_that_repeats_itself_is_stale_and_not_silent() {
    let station = Station::new();
    let _daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    let suit = streams::suit(station.suit);
    let last = Arc::new(Mutex::new(Vec::new()));
    eyes.until("the suit", |eyes| eyes.suit().published > 0);
    let kept = Arc::clone(&last);
    suit.slip_in(move |sound| {
        *kept.lock().expect("no panic") = sound.to_vec();
        sound.to_vec()
    });
    wait_for("a datagram", || (!last.lock().expect("no panic").is_empty()).then_some(()));
    drop(suit);
    let (datagram, sender) = (last.lock().expect("no panic").clone(), UdpSocket::bind("127.0.0.1:0"));
    let sender = sender.expect("a socket");
    eyes.until("the repetition to be named", |eyes| {
        let _ = sender.send_to(&datagram, station.suit);
        eyes.goes_on(Incident::SuitStampsStale) && !eyes.goes_on(Incident::SuitSilent)
    });
    let _suit = streams::suit(station.suit);
    eyes.until("its end", |eyes| !eyes.goes_on(Incident::SuitStampsStale));
}

/// The process's UDP sockets, as descriptors of this process; `None`, with a message, where the system does not permit
/// it.
fn udp_sockets_of(process: &Process) -> Option<Vec<OwnedFd>> {
    let id = process.id();
    let table = std::fs::read_to_string(format!("/proc/{id}/net/udp")).expect("the kernel's table");
    let inodes: Vec<&str> = table.lines().skip(1).filter_map(|line| line.split_whitespace().nth(9)).collect();
    let process = pidfd_open(Pid::from_raw(id as i32).expect("a process"), PidfdFlags::empty()).ok()?;
    let mut sockets = Vec::new();
    for entry in std::fs::read_dir(format!("/proc/{id}/fd")).expect("its descriptors").flatten() {
        let target = std::fs::read_link(entry.path()).unwrap_or_default().display().to_string();
        let inode = target.strip_prefix("socket:[").and_then(|rest| rest.strip_suffix(']'));
        if inode.is_some_and(|inode| inodes.contains(&inode)) {
            let number = entry.file_name().to_string_lossy().parse().expect("a number");
            match pidfd_getfd(&process, number, PidfdGetfdFlags::empty()) {
                Ok(socket) => sockets.push(socket),
                Err(error) => {
                    println!("skipped: the kernel does not lend a child's socket: {error}");
                    return None;
                }
            }
        }
    }
    Some(sockets)
}

#[test]
fn an_adapter_whose_socket_dies_is_started_again_and_the_daemon_goes_on() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until_poses(&person, 1);
    let (learnt, cycle) = (eyes.state.poses_used, eyes.state.cycle);
    for round in 1..=2 {
        let Some(sockets) = udp_sockets_of(&daemon) else { return };
        assert_eq!(sockets.len(), 2, "one of the suit, one of the plate");
        for socket in sockets {
            // The kernel returns "not connected", and shuts it down all the same.
            let _ = socket2::Socket::from(socket).shutdown(std::net::Shutdown::Both);
        }
        for down in [Incident::SuitAdapterDown, Incident::GroundAdapterDown] {
            eyes.until(down.name(), |eyes| eyes.begun(down) == round);
            assert!(daemon.stderr().contains(&journal(down)), "{}", daemon.stderr());
            eyes.until("its end", |eyes| !eyes.goes_on(down));
        }
        eyes.until("both sensors again", Eyes::both_fresh);
    }
    assert!(eyes.state.cycle > cycle && eyes.state.poses_used >= learnt, "the same daemon, all the time");
    let said = daemon.stderr();
    assert!(said.contains("was shut down from outside; it is started again in 250ms"), "{said}");
    assert!(said.contains("started again in 500ms"), "the second time it takes longer: {said}");
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn a_daemon_that_stood_still_says_for_how_long() {
    let station = Station::new();
    let daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until("cycles", |eyes| eyes.state.cycle > 10);
    // A stop that falls between the end of one cycle's work and the choice of the next slot skips slots without a late
    // cycle: it is repeated until one falls elsewhere.
    for stops in 1.. {
        let before = eyes.begun(Incident::LoopStalled);
        daemon.send(Signal::STOP);
        std::thread::sleep(Duration::from_millis(400));
        daemon.send(Signal::CONT);
        eyes.until("the stall", |eyes| eyes.begun(Incident::LoopStalled) > before);
        if eyes.begun(Incident::DeadlineMissed) > 0 {
            break;
        }
        assert!(stops < 10, "ten stops and no cycle was late: {}", daemon.stderr());
    }
    assert!(daemon.stderr().contains("the loop stood still for "), "{}", daemon.stderr());
    assert!(!eyes.goes_on(Incident::LoopStalled), "it runs again");
}

#[test]
fn samples_of_another_clock_and_a_flood_of_them_are_named() {
    let station = Station::new();
    let _daemon = station.daemon(&external(&station));
    let mut eyes = Eyes::open(&station);
    let settings = BusSettings { station: NAME.to_owned(), role: "liar".to_owned(), root: station.root() };
    let bus = Bus::join(&settings).expect("the bus");
    let ground = bus.publisher::<GroundSample>().expect("a place");
    let wake = bus.notifier(Channel::Inputs).expect("a place");
    let sample = |ahead_ns: u64| {
        let now_ns = now_monotonic_ns() + ahead_ns;
        let force_n = [0.0, 0.0, 700.0];
        GroundSample { sample_time_ns: now_ns, arrival_ns: now_ns, force_n, ..GroundSample::zeroed() }
    };
    let send = |ahead_ns: u64| {
        ground.send(&sample(ahead_ns)).expect("the bus");
        wake.notify(Event::NewGround).expect("the bus");
    };
    eyes.until("another clock's stamps to be named", |eyes| {
        send(100_000_000_000);
        eyes.goes_on(Incident::ClockTrouble) && eyes.goes_on(Incident::GroundStampsStale)
    });
    eyes.until("both ends", |eyes| {
        send(0);
        !eyes.goes_on(Incident::ClockTrouble) && !eyes.goes_on(Incident::GroundStampsStale)
    });
    assert_eq!(eyes.begun(Incident::InputOverflow), 0);
    eyes.until("the flood", |eyes| {
        for _ in 0..4000 {
            send(0);
        }
        eyes.goes_on(Incident::InputOverflow)
    });
}

#[test]
fn what_real_time_was_refused_is_an_incident_for_as_long_as_the_daemon_runs() {
    let station = Station::new();
    let configuration =
        station.configuration().replace("lock_memory = false", "lock_memory = false\ncpu = 1000");
    let daemon = station.daemon(&configuration);
    let mut eyes = Eyes::open(&station);
    eyes.until("it", |eyes| eyes.goes_on(Incident::RealTimeRefused));
    assert_eq!(eyes.begun(Incident::RealTimeRefused), 1);
    assert!(daemon.stderr().contains("thread loop asked for core 1000"), "{}", daemon.stderr());
}
