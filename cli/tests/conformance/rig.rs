//! One device and one host, and the samples received so far.

use std::time::{Duration, Instant};

use equipoise_simulator::clock::monotonic_ns;
use equipoise_simulator::devices::running::{Pace, Running};
use equipoise_simulator::faults::{FaultCounts, Faults};

use crate::cases::{Built, Case};
use crate::host::{Host, Sample, Tolerance};
use crate::person::Person;

/// Time limit of every wait.
const TIMEOUT: Duration = Duration::from_secs(90);

pub(crate) struct Rig<'a> {
    pub(crate) host: Host,
    pub(crate) device: Running,
    pub(crate) samples: Vec<Sample>,
    pub(crate) person: &'a Person,
    pub(crate) start_ns: u64,
    pub(crate) tolerance: Tolerance,
    /// Names and links of the device.
    _folder: tempfile::TempDir,
}

impl<'a> Rig<'a> {
    pub(crate) fn start(case: &Case, person: &'a std::sync::Arc<Person>) -> Result<Rig<'a>, String> {
        Rig::start_with(case, person, |section| section)
    }

    /// With another section of the configuration than the device's own.
    pub(crate) fn start_with(
        case: &Case,
        person: &'a std::sync::Arc<Person>,
        other: impl FnOnce(String) -> String,
    ) -> Result<Rig<'a>, String> {
        let folder = tempfile::tempdir().unwrap();
        let Built { device, ground } = (case.build)(folder.path(), person);
        let section = other(device.config());
        let start_ns = monotonic_ns();
        let pace = Pace { start_ns, drift_ppm: 40.0, jitter_s: case.jitter_s, noise: None, seed: 5 };
        // The host opens first if the device sends unsolicited, and second if the device answers.
        let device =
            Running::start(device, ground, person.load(), pace).map_err(|error| error.to_string())?;
        let host = Host::open(&section)?;
        let tolerance = Tolerance { force_n: case.tolerance.0, cop_m: case.tolerance.1, feet: case.feet };
        Ok(Rig { host, device, samples: Vec::new(), person, start_ns, tolerance, _folder: folder })
    }

    /// Receives until a condition holds.
    pub(crate) fn until(&mut self, what: &str, so: impl Fn(&Rig<'_>) -> bool) -> Result<(), String> {
        let started = Instant::now();
        while !so(self) {
            let received = self.host.receive()?;
            self.samples.extend(received);
            if started.elapsed() > TIMEOUT {
                let fault = self.host.fault().unwrap_or_else(|| "no fault".into());
                return Err(format!(
                    "waited in vain for {what}: {} samples, {:?}, {fault}, device {:?}",
                    self.samples.len(),
                    self.host.refused(),
                    self.device.fault_counts(),
                ));
            }
        }
        Ok(())
    }

    /// Receives this many more samples.
    pub(crate) fn more(&mut self, what: &str, count: usize) -> Result<(), String> {
        let sufficient = self.samples.len() + count;
        self.until(what, |rig| rig.samples.len() >= sufficient)
    }

    /// Receives this many more samples with a fitted time.
    pub(crate) fn more_timed(&mut self, what: &str, count: usize) -> Result<(), String> {
        let from = self.samples.len();
        self.until(what, |rig| rig.samples[from..].iter().filter(|sample| sample.is_timed()).count() >= count)
    }

    /// Receives while the device measures this many more samples.
    pub(crate) fn while_measured(&mut self, what: &str, count: u64) -> Result<(), String> {
        let sufficient = self.device.measured() + count;
        self.until(what, |rig| rig.device.measured() >= sufficient)
    }

    /// Deviations of the samples from an index on.
    pub(crate) fn wrong_since(&self, first: usize) -> Option<String> {
        let mut timed = self.samples[first..].iter().filter(|sample| sample.is_timed()).peekable();
        if timed.peek().is_none() {
            return Some("no sample has a time: nothing was compared".into());
        }
        timed.find_map(|sample| sample.wrong(self.person, self.start_ns, &self.tolerance))
    }

    /// Counts of both sides: lost by the host, and those of the injected faults.
    pub(crate) fn lost(&mut self) -> (u64, FaultCounts) {
        (self.host.health().lost, self.device.fault_counts())
    }

    pub(crate) fn set_faults(&self, faults: Faults) {
        self.device.set_faults(faults);
    }
}
