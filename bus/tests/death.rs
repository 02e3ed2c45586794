//! Readers and writers that are killed.
#![expect(clippy::unwrap_used, reason = "a test may panic, and so may its helpers")]

mod common;

use bytemuck::Zeroable;
use common::{PATIENCE, join, kill, parents_bus, root, spawn_child, until};
use equipoise_bus::root::shared_memory_prefix;
use equipoise_bus::{BusError, Channel, Event};
use equipoise_core::message::{Command, Reply, State};
use std::time::{Duration, Instant};

fn state(cycle: u64) -> State {
    State { cycle, ..State::zeroed() }
}

/// Not a test: the main function of a child, which runs until it is killed or times out.
#[test]
fn child_reads() {
    let Some(bus) = parents_bus("child") else { return };
    let mut states = bus.subscriber::<State>(4).unwrap();
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        states.latest().unwrap();
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Not a test: see [`child_reads`].
#[test]
fn child_writes() {
    let Some(bus) = parents_bus("child") else { return };
    let (publisher, notifier) = (bus.publisher::<State>().unwrap(), bus.notifier(Channel::Results).unwrap());
    let mut server = bus.command_server().unwrap();
    let start = Instant::now();
    let process = u64::from(std::process::id());
    while start.elapsed() < PATIENCE {
        publisher.send(&state(process)).unwrap();
        notifier.notify(Event::NewState).unwrap();
        while server.poll(|_| Reply { cycle: process, ..Reply::zeroed() }).unwrap() {}
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_killed_reader_is_not_noticed_until_it_is_cleaned_up() {
    let root = root();
    let bus = join(root.path(), "writer");
    let publisher = bus.publisher::<State>().unwrap();
    for round in 0..3 {
        let child = spawn_child("child_reads", root.path());
        until("the reader is there", || publisher.send(&state(round)).unwrap() == 1);
        kill(child);
        for cycle in 0..1000 {
            publisher.send(&state(cycle)).unwrap();
        }
        assert_eq!(publisher.subscriber_count(), 1, "no other process cleans up");
        // Only one clean-up at a time runs in a process, and the test that runs in parallel cleans up too.
        until("it is cleaned up", || bus.clean_up_dead_nodes() == 1);
        assert_eq!(publisher.subscriber_count(), 0);
        assert_eq!(publisher.send(&state(0)).unwrap(), 0);
    }
}

#[test]
fn a_daemon_killed_and_restarted_is_found_by_running_peers() {
    let root = root();
    let bus = join(root.path(), "reader");
    let mut states = bus.subscriber::<State>(4).unwrap();
    let events = bus.listener(Channel::Results).unwrap();
    let client = bus.command_client().unwrap();
    // More restarts than there are publisher ports: each restart frees a port.
    for _ in 0..4 {
        let child = spawn_child("child_writes", root.path());
        let process = u64::from(child.id());
        until("its states arrive", || states.latest().unwrap().is_some_and(|state| state.cycle == process));
        until("its events arrive", || events.wait(PATIENCE).unwrap().contains(Event::NewState));
        assert_eq!(client.ask(&Command::zeroed(), PATIENCE).unwrap().cycle, process);
        assert!(matches!(bus.command_server().unwrap_err(), BusError::Full { what: "daemon", .. }));
        kill(child);
        let error = client.ask(&Command::zeroed(), Duration::from_millis(20)).unwrap_err();
        assert!(matches!(error, BusError::NoAnswer { .. } | BusError::NoDaemon { .. }), "{error}");
        while states.latest().unwrap().is_some() {}
    }
    until("its death is reported", || {
        bus.clean_up_dead_nodes();
        events.wait(Duration::from_millis(5)).unwrap().contains(Event::NotifierDied)
    });
    bus.command_server().unwrap();
}

/// A process that is killed while it joins leaves a directory that iceoryx2 does not list as a dead node.
#[test]
fn what_was_killed_while_it_joined_is_cleared_away_once_it_is_old() {
    let root = root();
    let bus = join(root.path(), "cleaner");
    let half_made = root.path().join("nodes").join("4711");
    std::fs::create_dir_all(&half_made).unwrap();
    std::fs::write(half_made.join("node.details"), "").unwrap();
    bus.clean_up_dead_nodes();
    assert!(half_made.exists(), "it may still be on its way");
    let long_ago = std::time::SystemTime::now() - Duration::from_secs(60);
    std::fs::File::open(&half_made).unwrap().set_modified(long_ago).unwrap();
    until("it is cleared away", || {
        bus.clean_up_dead_nodes();
        !half_made.exists()
    });
    assert_eq!(bus.participants().unwrap().len(), 1, "the living stay");
}

/// A reader is killed between creating the memory of a connection and setting its size: iceoryx2 would wait for ever.
#[test]
fn an_unfinished_connection_does_not_prevent_cleanup() {
    let root = root();
    let bus = join(root.path(), "writer");
    let publisher = bus.publisher::<State>().unwrap();
    let child = spawn_child("child_reads", root.path());
    until("the reader is there", || publisher.send(&state(1)).unwrap() == 1);
    let name = connections(root.path()).swap_remove(0);
    // prefix, service_writer_reader.connection: the same reader, with another writer.
    let (writer, reader) = name.rsplit_once('_').unwrap();
    let empty = std::path::Path::new("/dev/shm").join(format!("{writer}7_{reader}"));
    std::fs::write(&empty, "").unwrap();
    kill(child);
    let (done, is_done) = crossbeam_channel::bounded(1);
    let path = root.path().to_owned();
    std::thread::spawn(move || {
        let cleaner = join(&path, "cleaner");
        until("the reader is cleared away", || cleaner.clean_up_dead_nodes() == 1);
        done.send(()).unwrap();
    });
    is_done.recv_timeout(2 * PATIENCE).expect("it waits for ever");
    assert!(!empty.exists());
    assert_eq!(publisher.subscriber_count(), 0);
}

/// A subscriber is killed between creating a connection and registering in it: iceoryx2 knows no user that would remove it.
#[test]
fn a_connection_of_a_subscriber_that_never_registered_is_removed() {
    let root = root();
    let bus = join(root.path(), "publisher");
    let publisher = bus.publisher::<State>().unwrap();
    let (_client, _server) = (bus.command_client().unwrap(), bus.command_server().unwrap());
    let mut states = bus.subscriber::<State>(4).unwrap();
    publisher.send(&state(1)).unwrap();
    let live = connections(root.path());
    assert!(live.len() >= 2, "of the states and of the commands: {live:?}");
    let (same_publisher, _) = live[0].rsplit_once('_').unwrap();
    let orphaned = format!("{same_publisher}_4711.connection");
    std::fs::write(std::path::Path::new("/dev/shm").join(&orphaned), "x").unwrap();
    until("it is removed", || {
        bus.clean_up_dead_nodes();
        !connections(root.path()).contains(&orphaned)
    });
    assert_eq!(connections(root.path()), live);
    assert_eq!(states.latest().unwrap().unwrap().cycle, 1);
}

/// Names of the connections in shared memory.
fn connections(root: &std::path::Path) -> Vec<String> {
    let prefix = shared_memory_prefix(root);
    let names = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|file| file.file_name());
    let ours = |name: &String| name.starts_with(&prefix) && name.ends_with(".connection");
    let mut names: Vec<String> = names.filter_map(|name| name.into_string().ok()).filter(ours).collect();
    names.sort();
    names
}
