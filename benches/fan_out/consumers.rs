//! Consumers: threads of another process, each with its own place on the bus.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{sleep, spawn};
use std::time::Duration;

use crossbeam_channel::{Sender, bounded};
use equipoise_benches::peer::{self, Peer};
use equipoise_bus::{Bus, BusSettings, Channel};
use equipoise_core::message::State;
use equipoise_daemon::realtime::{self, RequestedScheduling};

use crate::station::STATION;

/// A controller's priority, below the daemon's threads.
const PRIORITY: u32 = 50;

/// How a consumer waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Listeners,
    Pollers,
}

impl Kind {
    pub(crate) const ALL: [Kind; 2] = [Kind::Listeners, Kind::Pollers];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Kind::Listeners => "listeners",
            Kind::Pollers => "pollers",
        }
    }
}

/// Starts this number of consumers.
pub(crate) fn start(kind: Kind, count: usize) -> Peer {
    Peer::start("consumers", &[kind.name().to_owned(), count.to_string()]).0
}

/// Ends them; returns the number of states read by all of them together.
pub(crate) fn finish(peer: Peer) -> u64 {
    bytemuck::pod_read_unaligned(&peer.finish())
}

/// Main function of the other process.
pub(crate) fn run(arguments: &[String]) {
    let [kind, count] = arguments else { panic!("consumers have a kind and a number") };
    let listens = kind == Kind::Listeners.name();
    let ends = peer::asked_to_end();
    let count: usize = count.parse().expect("a number");
    let (ready, are_ready) = bounded(count);
    let threads: Vec<_> = (0..count)
        .map(|_| {
            let (ends, ready) = (Arc::clone(&ends), ready.clone());
            spawn(move || consume(listens, &ends, &ready))
        })
        .collect();
    for _ in 0..count {
        are_ready.recv().expect("every consumer begins");
    }
    peer::ready("");
    let taken: u64 = threads.into_iter().map(|thread| thread.join().expect("a consumer ended well")).sum();
    let mut out = std::io::stdout().lock();
    std::io::Write::write_all(&mut out, bytemuck::bytes_of(&taken)).expect("the parent process reads");
}

fn consume(listens: bool, ends: &AtomicBool, ready: &Sender<()>) -> u64 {
    realtime::request("consumer", RequestedScheduling { fifo_priority: PRIORITY, cpu: None });
    let bus = Bus::join(&BusSettings::new(STATION, "consumer")).expect("the bus is there");
    let mut states = bus.subscriber::<State>(8).expect("a place for a subscriber");
    let listener = listens.then(|| bus.listener(Channel::Results).expect("a place for a listener"));
    let _ = ready.send(());
    let mut taken = 0;
    while !ends.load(Ordering::Relaxed) {
        match &listener {
            Some(listener) => drop(listener.wait(Duration::from_millis(50)).expect("the bus is whole")),
            None => sleep(Duration::from_millis(1)),
        }
        let read = |state: &State| {
            black_box(bytemuck::bytes_of(state).iter().fold(0_u8, |sum, byte| sum ^ byte));
        };
        while states.receive_with(read).expect("the bus is whole").is_some() {
            taken += 1;
        }
    }
    taken
}
