//! Runs a device in its own thread, with its clock and jitter.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::line::FaultCounts;
use super::load::{Ground, LoadSample, OnFeet};
use super::{Device, HostRequests};
use crate::clock::{DeviceClock, monotonic_ns, sleep_until_ns, span_ns};
use crate::dynamics::Wrench;
use crate::faults::Faults;
use crate::noise::PlateNoise;
use crate::random::Random;
use crate::threads::Threads;

/// Polling interval while no sample is due, s.
const LISTEN_S: f64 = 0.004;

/// Load of the feet at a simulated time, s.
pub type Load = Arc<dyn Fn(f64) -> OnFeet + Send + Sync>;

/// A device's clock and delays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pace {
    /// CLOCK_MONOTONIC at simulated time 0, ns.
    pub start_ns: u64,
    /// Rate error of the device's clock, ppm; positive if fast.
    pub drift_ppm: f64,
    /// Maximum delay from measurement to sending, s.
    pub jitter_s: f64,
    /// White noise of every plate.
    pub noise: Option<PlateNoise>,
    /// Random seed.
    pub seed: u64,
}

/// Commands to the thread, and its counters.
#[derive(Debug, Default)]
struct Orders {
    faults: Option<Faults>,
    plugged: bool,
    silent: bool,
    fault_counts: FaultCounts,
    measured: u64,
}

/// A running device. Dropping it stops it.
pub struct Running {
    config: String,
    orders: Arc<Mutex<Orders>>,
    threads: Threads<()>,
}

impl Running {
    /// Starts a device under a load.
    ///
    /// # Errors
    /// The thread could not be created.
    pub fn start(mut device: Box<dyn Device>, ground: Ground, load: Load, pace: Pace) -> io::Result<Running> {
        let config = device.config();
        let orders = Arc::new(Mutex::new(Orders { plugged: true, ..Orders::default() }));
        let their_orders = Arc::clone(&orders);
        let mut threads = Threads::new();
        threads.spawn("sim-device", move |stop| {
            let random = Random::new(pace.seed, "jitter");
            let mut runner = Runner { ground, load, pace, random, zero: Vec::new(), plugged: true };
            runner.run(&mut *device, &their_orders, stop)
        })?;
        Ok(Running { config, orders, threads })
    }

    fn order<T>(&self, change: impl FnOnce(&mut Orders) -> T) -> T {
        change(&mut self.orders.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// As [`Device::config`].
    pub fn config(&self) -> &str {
        &self.config
    }

    /// Replaces the connection's faults from the next sample on.
    pub fn set_faults(&self, faults: Faults) {
        self.order(|orders| orders.faults = Some(faults));
    }

    /// Disconnects or reconnects the device.
    pub fn plug(&self, plugged: bool) {
        self.order(|orders| orders.plugged = plugged);
    }

    /// Stops or resumes sending; the device stays connected.
    pub fn silence(&self, silent: bool) {
        self.order(|orders| orders.silent = silent);
    }

    /// Counters of the sent samples, up to the last one.
    pub fn fault_counts(&self) -> FaultCounts {
        self.order(|orders| orders.fault_counts)
    }

    /// Samples that it measured, sent or not.
    pub fn measured(&self) -> u64 {
        self.order(|orders| orders.measured)
    }

    /// Stops it.
    ///
    /// # Errors
    /// The error that ended the device early.
    pub fn stop(mut self) -> io::Result<()> {
        self.threads.stop().map(drop)
    }
}

struct Runner {
    ground: Ground,
    load: Load,
    pace: Pace,
    random: Random,
    /// Wrench of each plate at its last zeroing.
    zero: Vec<Wrench>,
    plugged: bool,
}

impl Runner {
    fn run(&mut self, device: &mut dyn Device, orders: &Mutex<Orders>, stop: &AtomicBool) -> io::Result<()> {
        let faster = 1.0 + self.pace.drift_ppm * 1e-6;
        let mut clock = DeviceClock::new(device.rate_hz() * faster);
        // The first sample is taken now, whenever simulated time began.
        let mut number = 0_u32;
        let begun_s = self.now_s();
        while !stop.load(Ordering::Relaxed) {
            let time_s = begun_s + clock.time_s();
            let due_s = time_s + self.pace.jitter_s * self.random.unit();
            while self.now_s() < due_s && !stop.load(Ordering::Relaxed) {
                self.listen(device, orders)?;
                let nap_s = (self.now_s() + LISTEN_S).min(due_s);
                sleep_until_ns(self.pace.start_ns + span_ns(nap_s));
            }
            self.listen(device, orders)?;
            let on_feet = (self.load)(time_s);
            let plates = self.noisy(self.tared(on_feet.on(&self.ground)), number);
            let silent = orders.lock().unwrap_or_else(PoisonError::into_inner).silent;
            if self.plugged && !silent {
                let sample =
                    LoadSample { time_s, number, device_s: time_s * faster, plates, soles: on_feet.soles };
                device.measure(&sample)?;
            }
            let mut reported = orders.lock().unwrap_or_else(PoisonError::into_inner);
            reported.fault_counts = device.fault_counts();
            reported.measured += 1;
            drop(reported);
            number = number.wrapping_add(1);
            clock.advance(device.rate_hz() * faster);
        }
        Ok(())
    }

    fn now_s(&self) -> f64 {
        monotonic_ns().saturating_sub(self.pace.start_ns) as f64 * 1e-9
    }

    fn listen(&mut self, device: &mut dyn Device, orders: &Mutex<Orders>) -> io::Result<()> {
        let (faults, plugged) = {
            let mut orders = orders.lock().unwrap_or_else(PoisonError::into_inner);
            (orders.faults.take(), orders.plugged)
        };
        if let Some(faults) = faults {
            device.set_faults(faults);
        }
        if plugged != self.plugged {
            self.plugged = plugged;
            if plugged {
                self.zero.clear();
                device.plug()?;
            } else {
                device.unplug();
            }
        }
        let now_s = self.now_s();
        let HostRequests { zero } = device.poll(now_s * (1.0 + self.pace.drift_ppm * 1e-6))?;
        if zero {
            self.zero = (self.load)(now_s).on(&self.ground);
        }
        Ok(())
    }

    fn noisy(&self, plates: Vec<Wrench>, number: u32) -> Vec<Wrench> {
        let Some(noise) = self.pace.noise else { return plates };
        let mut random = Random::numbered(self.pace.seed, "plate noise", number);
        plates.into_iter().map(|wrench| noise.on(wrench, &mut random)).collect()
    }

    fn tared(&self, mut plates: Vec<Wrench>) -> Vec<Wrench> {
        for (wrench, zero) in plates.iter_mut().zip(&self.zero) {
            wrench.force_n -= zero.force_n;
            wrench.moment_nm -= zero.moment_nm;
        }
        plates
    }
}
