//! The consumer: another process that reads every byte of each state and records the time.

use std::hint::black_box;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use equipoise_benches::peer::{self, Peer};
use equipoise_bus::{Bus, BusSettings, Channel};
use equipoise_config::WaitStrategy;
use equipoise_core::message::State;
use equipoise_daemon::realtime::{self, RequestedScheduling, now_ns};

use crate::carrier::{Carrier, Socket, WAKE_AT_LEAST};

/// A controller's priority, below the daemon's threads.
const PRIORITY: u32 = 50;
/// Maximum number of recorded states.
const NOTES: usize = 1 << 20;

/// The parent's handle of the consumer.
pub(crate) struct Consumer(Peer);

impl Consumer {
    /// Starts one; also returns the address of its socket, if it has one.
    pub(crate) fn start(
        station: &str,
        carrier: Carrier,
        waiting: WaitStrategy,
        cpu: Option<usize>,
        place: &str,
    ) -> (Consumer, String) {
        let polls = (waiting == WaitStrategy::Polling).to_string();
        let cpu = cpu.map_or("any".to_owned(), |cpu| cpu.to_string());
        let arguments = [station, carrier.name(), &polls, &cpu, place].map(str::to_owned);
        let (peer, address) = Peer::start("consumer", &arguments);
        (Consumer(peer), address)
    }

    /// Ends it; returns the time at which it had read each cycle's state, and the number of bytes read.
    pub(crate) fn finish(self) -> (Vec<(u64, u64)>, u64) {
        let words: Vec<u64> = self.0.finish().chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
        let (bytes, notes) = words.split_last().expect("it said how many bytes it read");
        (notes.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect(), *bytes)
    }
}

/// Main function of the consumer.
pub(crate) fn run(arguments: &[String]) {
    let [station, carrier, polls, cpu, place] = arguments else { panic!("a consumer has five arguments") };
    let waiting = if polls == "true" { WaitStrategy::Polling } else { WaitStrategy::Sleeping };
    let ends = peer::asked_to_end();
    realtime::request("consumer", RequestedScheduling { fifo_priority: PRIORITY, cpu: cpu.parse().ok() });
    let mut notes = Notes { words: vec![0; 2 * NOTES], used: 0, bytes: 0 };
    // The first write to a page would cause a page fault in the middle of the path.
    notes.words.fill(1);
    let ended = || ends.load(Ordering::Relaxed);
    match Carrier::named(carrier) {
        Carrier::Bus => from_the_bus(station, waiting, &mut notes, ended),
        carrier => {
            let (socket, address) = Socket::receiver(carrier, &PathBuf::from(place), waiting);
            peer::ready(&address);
            let mut state: State = bytemuck::Zeroable::zeroed();
            while !ended() {
                if socket.receive(bytemuck::bytes_of_mut(&mut state)) {
                    notes.take(&state);
                }
            }
        }
    }
    notes.tell();
}

fn from_the_bus(station: &str, waiting: WaitStrategy, notes: &mut Notes, ended: impl Fn() -> bool) {
    let bus = Bus::join(&BusSettings::new(station, "consumer")).expect("the bus is there");
    let mut states = bus.subscriber::<State>(8).expect("a place for a subscriber");
    let listener = (waiting == WaitStrategy::Sleeping)
        .then(|| bus.listener(Channel::Results).expect("a place for a listener"));
    peer::ready("");
    while !ended() {
        if let Some(listener) = &listener {
            listener.wait(WAKE_AT_LEAST).expect("the bus is whole");
        }
        while states.receive_with(|state| notes.take(state)).expect("the bus is whole").is_some() {}
    }
}

struct Notes {
    words: Vec<u64>,
    used: usize,
    bytes: u64,
}

impl Notes {
    fn take(&mut self, state: &State) {
        let bytes = bytemuck::bytes_of(state);
        black_box(bytemuck::cast_slice::<u8, u64>(bytes).iter().fold(0, |sum: u64, word| sum ^ word));
        let read_ns = now_ns();
        self.bytes += bytes.len() as u64;
        if let Some(place) = self.words.get_mut(self.used..self.used + 2) {
            place.copy_from_slice(&[state.cycle, read_ns]);
            self.used += 2;
        }
    }

    fn tell(&mut self) {
        self.words.truncate(self.used);
        self.words.push(self.bytes);
        let mut out = std::io::stdout().lock();
        std::io::Write::write_all(&mut out, bytemuck::cast_slice(&self.words))
            .expect("the parent process reads");
    }
}

/// Time for both ends of the path to connect.
pub(crate) const SETTLE: Duration = Duration::from_millis(30);
