//! Hand-made sensors: valid samples at a steady rate, with bad ones inserted by a test.

use std::io::Write;
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use equipoise_adapters::wire::ati_rdt::{Command, Record, Request};
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::{Suit, SuitNoise};
use equipoise_simulator::person::Person;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame};

use crate::process::wait_for;

/// Samples per second of the suit.
const SUIT_RATE_HZ: f64 = 60.0;
/// Body weight on the plate, counts; the plate reports the force on itself.
const WEIGHT_COUNTS: i32 = -706_000_000;

/// Makes a bad datagram from the preceding valid one.
type Fault = Box<dyn FnMut(&[u8]) -> Vec<u8> + Send>;

/// Pending bad datagrams; one is sent after each valid one.
#[derive(Clone, Default)]
struct Faults(Arc<Mutex<std::collections::VecDeque<Fault>>>);

impl Faults {
    fn next(&self, valid: &[u8]) -> Option<Vec<u8>> {
        self.0.lock().expect("no test panics here").pop_front().map(|mut fault| fault(valid))
    }
}

/// A sensor's thread; ends when dropped.
pub(crate) struct Stream {
    faults: Faults,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Stream {
    fn start(run: impl FnOnce(Faults, &AtomicBool) + Send + 'static) -> Stream {
        let (faults, stop) = (Faults::default(), Arc::new(AtomicBool::new(false)));
        let (stream_faults, stopping) = (faults.clone(), Arc::clone(&stop));
        let thread = std::thread::spawn(move || run(stream_faults, &stopping));
        Stream { faults, stop, thread: Some(thread) }
    }

    /// Inserts the result of `fault`, applied to a valid datagram, after it.
    pub(crate) fn slip_in(&self, fault: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static) {
        self.faults.0.lock().expect("no stream panics").push_back(Box::new(fault));
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A suit that sends type 02 alone: one datagram a sample, each published at once.
pub(crate) fn suit(target: SocketAddr) -> Stream {
    suit_of(target, 0)
}

/// The same as another character.
pub(crate) fn suit_of(target: SocketAddr, avatar: u8) -> Stream {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    // The listener may be absent, and some datagrams are too long to send: both errors are irrelevant here.
    Stream::start(move |faults, stop| {
        run_suit(avatar, &faults, stop, |bytes| drop(socket.send_to(bytes, target)));
    })
}

/// The same over TCP, as several characters on one connection; reconnects after each disconnection.
pub(crate) fn suits_over_tcp(target: SocketAddr, avatars: &'static [u8]) -> Stream {
    Stream::start(move |faults, stop| {
        let mut connection: Option<TcpStream> = None;
        run_suit(0, &faults, stop, |bytes| {
            let mut all = Vec::new();
            for avatar in avatars {
                all.extend_from_slice(bytes);
                let begin = all.len() - bytes.len();
                if let Some(place) = all.get_mut(begin + 16) {
                    *place = *avatar;
                }
            }
            connection = connection.take().or_else(|| TcpStream::connect(target).ok());
            if connection.as_mut().is_some_and(|stream| stream.write_all(&all).is_err()) {
                connection = None;
            }
        });
    })
}

fn run_suit(avatar: u8, faults: &Faults, stop: &AtomicBool, mut send: impl FnMut(&[u8])) {
    let worker = Worker::with_habits(Person::nominal(1.77, 72.0), 1, Habits::NONE);
    // A suit that repeats itself would be detected as frozen.
    let suit = Suit::new(SuitNoise::ORDINARY, 1);
    let streams = Streams::NONE;
    // Starts high enough for a step back.
    for number in 1000.. {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let frame = frame(&worker, &suit, SuitWorld::default(), streams, avatar, (number, SUIT_RATE_HZ));
        let valid = frame.datagrams().expect("a body has 23 segments").remove(0);
        send(&valid);
        if let Some(bad) = faults.next(&valid) {
            send(&bad);
        }
        std::thread::sleep(Duration::from_secs_f64(1.0 / SUIT_RATE_HZ));
    }
}

/// A plate with a person of 72 kg standing on it.
pub(crate) struct FakePlate {
    pub(crate) stream: Stream,
    /// Address of the client that requested records.
    client: Arc<Mutex<Option<SocketAddr>>>,
}

impl FakePlate {
    pub(crate) fn start(address: SocketAddr) -> FakePlate {
        // A process that seeks a free port binds it for an instant.
        let socket = wait_for("the plate's port", || UdpSocket::bind(address).ok());
        socket.set_read_timeout(Some(Duration::from_millis(4))).expect("a socket");
        let client = Arc::default();
        let address = Arc::clone(&client);
        let stream = Stream::start(move |faults, stop| run_plate(&socket, &address, &faults, stop));
        FakePlate { stream, client }
    }

    /// Address of the client that requested records.
    pub(crate) fn client(&self) -> Option<SocketAddr> {
        *self.client.lock().expect("no plate panics")
    }
}

fn run_plate(socket: &UdpSocket, address: &Mutex<Option<SocketAddr>>, faults: &Faults, stop: &AtomicBool) {
    let (mut rdt_sequence, mut ft_sequence) = (0, 5000);
    while !stop.load(Ordering::Relaxed) {
        let mut bytes = [0; 64];
        // The pause between two records is this read's timeout.
        if let Ok((length, sender)) = socket.recv_from(&mut bytes)
            && let Ok(request) = Request::parse(&bytes[..length])
        {
            rdt_sequence = 0;
            *address.lock().expect("no test panics here") =
                (request.command != Command::Stop).then_some(sender);
        }
        ft_sequence += 1;
        let Some(client) = *address.lock().expect("no test panics here") else { continue };
        rdt_sequence += 1;
        let record = Record {
            rdt_sequence,
            ft_sequence,
            status: 0,
            // A plate that repeats itself would be detected as frozen too.
            force_counts: [0, 0, WEIGHT_COUNTS + (ft_sequence % 2) as i32],
            torque_counts: [0; 3],
        };
        let valid = record.to_bytes();
        let _ = socket.send_to(&valid, client);
        if let Some(bad) = faults.next(&valid) {
            let _ = socket.send_to(&bad, client);
        }
    }
}
