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
use crate::monitor::Monitor;
use crate::process::{Process, wait_for};
use crate::station::{NAME, Station};
use crate::streams;

/// The journal's line of an incident.
fn journal(kind: Incident) -> String {
    format!("incident=\"{}\"", kind.name())
}

#[test]
fn silence_is_reported_by_all_interfaces_with_its_remedy_and_ends_with_the_next_sample() {
    let station = Station::new();
    let person = station.person();
    let daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    for (kind, silence) in [
        (Incident::SuitSilent, &(|silent| person.silence_suit(silent)) as &dyn Fn(bool)),
        (Incident::GroundSilent, &|silent| person.silence_plate(silent)),
    ] {
        silence(true);
        monitor.until(kind.name(), |monitor| monitor.is_active(kind));
        wait_for("the journal's line", || daemon.stderr().contains(&journal(kind)).then_some(()));
        let line = format!("INCIDENT {}", kind.name());
        let text = station.run_until(&line, &["status"], |ended| ended.stdout.contains(&line));
        let text = text.assert_done();
        assert!(text.contains("sends nothing any more: is") && !text.contains("to do:"), "{text}");
        let line = format!("{} for ", kind.name());
        station
            .run_until(&line, &["watch", "--for", "2.5"], |ended| ended.stdout.contains(&line))
            .assert_done();
        let listed = |status: &serde_json::Value, list: &str| {
            let list = status["incidents"][list].as_array().cloned().unwrap_or_default();
            list.into_iter().find(|incident| incident["name"] == kind.name())
        };
        let is_active = |status: &serde_json::Value| listed(status, "active").is_some();
        let status = station.status_when("it goes on", is_active);
        let active = listed(&status, "active").expect("it was there");
        assert!(active["message"].as_str().is_some_and(|what| what.contains("sends nothing")), "{active}");
        silence(false);
        monitor.until("its end", |monitor| !monitor.is_active(kind));
        wait_for("it among the past, with its number of begins", || {
            monitor.update();
            let status = station.status().filter(|status| listed(status, "active").is_none())?;
            (listed(&status, "past")?["count"] == monitor.count(kind)).then_some(())
        });
    }
    assert!(!daemon.stderr().contains("phase="), "phases are none: {}", daemon.stderr());
}

#[test]
fn a_sensor_that_never_sends_is_reported_with_its_address() {
    let station = Station::new();
    let daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both to be missed", |monitor| {
        monitor.is_active(Incident::SuitSilent) && monitor.is_active(Incident::GroundSilent)
    });
    let message = daemon.stderr();
    for lines in ["the suit has sent nothing yet", &station.suit.to_string(), &station.plate.to_string()] {
        assert!(message.contains(lines), "{lines}: {message}");
    }
}

#[test]
fn a_repeating_stream_is_stale_and_not_silent() {
    let station = Station::new();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    let suit = streams::suit(station.suit);
    let last = Arc::new(Mutex::new(Vec::new()));
    monitor.until("the suit", |monitor| monitor.suit().published > 0);
    let shared = Arc::clone(&last);
    suit.slip_in(move |valid| {
        *shared.lock().expect("no panic") = valid.to_vec();
        valid.to_vec()
    });
    wait_for("a datagram", || (!last.lock().expect("no panic").is_empty()).then_some(()));
    drop(suit);
    let (datagram, sender) = (last.lock().expect("no panic").clone(), UdpSocket::bind("127.0.0.1:0"));
    let sender = sender.expect("a socket");
    monitor.until("the repetition to be named", |monitor| {
        let _ = sender.send_to(&datagram, station.suit);
        monitor.is_active(Incident::SuitStampsStale) && !monitor.is_active(Incident::SuitSilent)
    });
    let _suit = streams::suit(station.suit);
    monitor.until("its end", |monitor| !monitor.is_active(Incident::SuitStampsStale));
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
fn an_adapter_whose_socket_fails_is_restarted_and_the_daemon_continues() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    let (poses, cycle) = (monitor.state.poses_used, monitor.state.cycle);
    for _ in 0..2 {
        let downs = [Incident::SuitAdapterDown, Incident::GroundAdapterDown];
        monitor.update();
        let before = downs.map(|down| monitor.count(down));
        // One of the suit, one of the plate.
        let both = wait_for("both sockets", || match udp_sockets_of(&daemon) {
            Some(sockets) if sockets.len() != 2 => None,
            found => Some(found),
        });
        let Some(sockets) = both else { return };
        for socket in sockets {
            // The kernel returns "not connected", and shuts it down all the same.
            let _ = socket2::Socket::from(socket).shutdown(std::net::Shutdown::Both);
        }
        for (down, before) in downs.into_iter().zip(before) {
            // A plate that is late on a busy machine counts too.
            monitor.until(down.name(), |monitor| monitor.count(down) > before);
            assert!(daemon.stderr().contains(&journal(down)), "{}", daemon.stderr());
            monitor.until("its end", |monitor| !monitor.is_active(down));
        }
        monitor.until("both sensors again", Monitor::both_fresh);
    }
    assert!(
        monitor.state.cycle > cycle && monitor.state.poses_used >= poses,
        "the same daemon, all the time"
    );
    let message = daemon.stderr();
    assert!(message.contains("was shut down from outside; it is started again in 250ms"), "{message}");
    assert!(message.contains("started again in 500ms"), "the second time it takes longer: {message}");
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn a_stalled_loop_is_reported_with_its_duration() {
    let station = Station::new();
    let daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("cycles", |monitor| monitor.state.cycle > 10);
    // A stop that falls between the end of one cycle's work and the choice of the next slot skips slots without a late
    // cycle: it is repeated until one falls elsewhere.
    for stops in 1.. {
        let before = monitor.count(Incident::LoopStalled);
        daemon.send(Signal::STOP);
        std::thread::sleep(Duration::from_millis(400));
        daemon.send(Signal::CONT);
        monitor.until("the stall", |monitor| monitor.count(Incident::LoopStalled) > before);
        if monitor.count(Incident::DeadlineMissed) > 0 {
            break;
        }
        assert!(stops < 10, "ten stops and no cycle was late: {}", daemon.stderr());
    }
    assert!(daemon.stderr().contains("the loop stood still for "), "{}", daemon.stderr());
    monitor.until("the end of the stall", |monitor| !monitor.is_active(Incident::LoopStalled));
}

#[test]
fn samples_of_another_clock_and_an_overflow_are_reported() {
    let station = Station::new();
    let _daemon = station.daemon(&external(&station));
    let mut monitor = Monitor::open(&station);
    let settings = BusSettings { station: NAME.to_owned(), role: "clock".to_owned(), root: station.root() };
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
    monitor.until("another clock's stamps to be named", |monitor| {
        send(100_000_000_000);
        monitor.is_active(Incident::ClockFault) && monitor.is_active(Incident::GroundStampsStale)
    });
    monitor.until("both ends", |monitor| {
        send(0);
        !monitor.is_active(Incident::ClockFault) && !monitor.is_active(Incident::GroundStampsStale)
    });
    assert_eq!(monitor.count(Incident::InputOverflow), 0);
    monitor.until("the flood", |monitor| {
        for _ in 0..4000 {
            send(0);
        }
        monitor.is_active(Incident::InputOverflow)
    });
}

#[test]
fn refused_scheduling_is_an_incident_while_the_daemon_runs() {
    let station = Station::new();
    let configuration =
        station.configuration().replace("lock_memory = false", "lock_memory = false\ncpu = 1000");
    let daemon = station.daemon(&configuration);
    let mut monitor = Monitor::open(&station);
    monitor.until("it", |monitor| monitor.is_active(Incident::RealTimeRefused));
    assert_eq!(monitor.count(Incident::RealTimeRefused), 1);
    assert!(daemon.stderr().contains("thread loop asked for core 1000"), "{}", daemon.stderr());
}
