//! Streams a recording over the sensors' protocols, as if it were live: samples of a suit and a plate.

use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};

use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{GroundSample, SuitSample};
use nalgebra::Vector3;

use crate::clock::{monotonic_ns, sleep_until_ns, span_ns};
use crate::dynamics::Wrench;
use crate::faults::Faults;
use crate::plate::Plate;
use crate::plate_server::PlateServer;
use crate::suit_sender::SuitSender;
use crate::threads::Threads;
use crate::wire::SuitFrame;

/// Polling interval for requests to the plate while nothing is due, s.
const LISTEN_S: f64 = 0.005;

/// One sample of a recording.
#[derive(Debug, Clone)]
pub enum Recorded {
    /// Of the suit.
    Suit(Box<SuitSample>),
    /// Of the plate.
    Ground(GroundSample),
}

/// Addresses and speed of the playback.
#[derive(Debug, Clone, PartialEq)]
pub struct PlayerSettings {
    /// Destination of the suit's datagrams.
    pub suit_target: SocketAddr,
    /// Address at which the plate receives requests; port 0 for any free one.
    pub plate_address: SocketAddr,
    /// Pose and scale of the plate.
    pub plate: Plate,
    /// 1 is real time, 2 twice as fast.
    pub speed: f64,
    /// Start only once a client has requested records from the plate, so that the beginning is not lost.
    pub wait_for_client: bool,
    /// The network's faults.
    pub faults: Faults,
    /// Random seed of the faults.
    pub seed: u64,
}

/// Streams samples of `(time in seconds, sample)`, ordered by time, in its own thread.
///
/// # Errors
/// Those of the sockets.
pub fn play<Recording>(recording: Recording, settings: PlayerSettings) -> io::Result<PlayerHandle>
where
    Recording: IntoIterator<Item = (f64, Recorded)> + Send + 'static,
{
    let server = PlateServer::bind(settings.plate_address, settings.faults, settings.seed.wrapping_add(1))?;
    let sender = SuitSender::new(settings.suit_target, settings.faults, settings.seed)?;
    let plate_address = server.address();
    let mut threads = Threads::new();
    threads.spawn("player", move |stop| {
        Player { server, sender, settings, stop, played: [0; 2] }.run(recording)
    })?;
    Ok(PlayerHandle { plate_address, threads })
}

struct Player<'a> {
    server: PlateServer,
    sender: SuitSender,
    settings: PlayerSettings,
    stop: &'a AtomicBool,
    /// Samples of suit and plate so far.
    played: [u32; 2],
}

impl Player<'_> {
    fn run(&mut self, recording: impl IntoIterator<Item = (f64, Recorded)>) -> io::Result<[u32; 2]> {
        while self.settings.wait_for_client && !self.server.has_client() && !self.stopped() {
            self.listen_until(monotonic_ns() + span_ns(LISTEN_S));
        }
        let mut zero = None;
        for (time_s, sample) in recording {
            let (first_s, start_ns) = *zero.get_or_insert_with(|| (time_s, monotonic_ns()));
            self.listen_until(start_ns + span_ns((time_s - first_s) / self.settings.speed));
            if self.stopped() {
                break;
            }
            match sample {
                Recorded::Suit(sample) => self.play_suit(&sample)?,
                Recorded::Ground(sample) => self.play_ground(&sample)?,
            }
        }
        Ok(self.played)
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Sleeps in short intervals, since a request may arrive at any time.
    fn listen_until(&mut self, due_ns: u64) {
        loop {
            // A recording cannot be zeroed.
            let _ = self.server.poll();
            let nap_ns = monotonic_ns() + span_ns(LISTEN_S);
            sleep_until_ns(due_ns.min(nap_ns));
            if due_ns <= nap_ns || self.stopped() {
                return;
            }
        }
    }

    fn play_suit(&mut self, sample: &SuitSample) -> io::Result<()> {
        self.played[0] += 1;
        self.sender.send(&SuitFrame {
            sample_counter: sample.device_counter,
            time_code_ms: sample.device_time_ms,
            avatar: sample.avatar as u8,
            position_m: sample.position_m,
            orientation_wxyz: sample.orientation_wxyz,
            motion: sample.has(SuitBlocks::LinearKinematics).then(|| {
                std::array::from_fn(|i| [sample.velocity_m_per_s[i], sample.acceleration_m_per_s2[i]])
            }),
            joint_angle_deg: sample.has(SuitBlocks::JointAngles).then_some(sample.joint_angle_deg),
            com_m: sample.has(SuitBlocks::CentreOfMass).then_some(sample.com_m),
            ..SuitFrame::default()
        })
    }

    fn play_ground(&mut self, sample: &GroundSample) -> io::Result<()> {
        self.played[1] += 1;
        let on_person =
            Wrench { force_n: Vector3::from(sample.force_n), moment_nm: Vector3::from(sample.moment_nm) };
        let wrench = self.settings.plate.sensor_wrench(&on_person);
        let record = self.settings.plate.record(&wrench, sample.device_counter, sample.device_status);
        self.server.send(record)
    }
}

/// A recording in playback. Dropping it stops it.
#[derive(Debug)]
pub struct PlayerHandle {
    plate_address: SocketAddr,
    threads: Threads<[u32; 2]>,
}

impl PlayerHandle {
    /// Address of the plate.
    pub fn plate_address(&self) -> SocketAddr {
        self.plate_address
    }

    /// Whether playback is complete.
    pub fn is_finished(&self) -> bool {
        self.threads.are_finished()
    }

    /// Waits for the end; returns the numbers of samples of suit and plate.
    ///
    /// # Errors
    /// The error that ended it early.
    pub fn wait(mut self) -> io::Result<[u32; 2]> {
        self.threads.join().map(|played| played.first().copied().unwrap_or_default())
    }

    /// Stops now; returns the numbers of samples of suit and plate.
    ///
    /// # Errors
    /// The error that ended it early.
    pub fn stop(mut self) -> io::Result<[u32; 2]> {
        self.threads.stop().map(|played| played.first().copied().unwrap_or_default())
    }
}
