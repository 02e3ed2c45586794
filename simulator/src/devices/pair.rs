//! Two devices that form one ground device for the daemon: adjacent plates with a foot on each, or a plate and insoles.

use std::io;

use super::load::LoadSample;
use super::{Device, FaultCounts, HostRequests};
use crate::faults::Faults;

/// Two devices that measure together.
pub struct Pair {
    devices: [Box<dyn Device>; 2],
    /// Each is under one foot.
    of_feet: bool,
}

impl Pair {
    /// Of two devices with one plate each, left and right, of the same rate.
    pub fn new(left: Box<dyn Device>, right: Box<dyn Device>) -> Pair {
        Pair { devices: [left, right], of_feet: true }
    }

    /// A plate under both feet, and insoles in the shoes; of the same rate.
    pub fn with_insoles(plate: Box<dyn Device>, insoles: Box<dyn Device>) -> Pair {
        Pair { devices: [plate, insoles], of_feet: false }
    }
}

/// Turns one device's section into that of one foot.
fn of_foot(config: &str, foot: &str) -> String {
    config.replacen("\n", &format!("\nfoot = \"{foot}\"\n"), 1)
}

impl Device for Pair {
    fn poll(&mut self, device_now_s: f64) -> io::Result<HostRequests> {
        let [left, right] = &mut self.devices;
        let zero = left.poll(device_now_s)?.zero | right.poll(device_now_s)?.zero;
        Ok(HostRequests { zero })
    }

    fn rate_hz(&self) -> f64 {
        self.devices[0].rate_hz()
    }

    fn measure(&mut self, sample: &LoadSample) -> io::Result<()> {
        for (k, device) in self.devices.iter_mut().enumerate() {
            let plates = sample.plates.get(k).or(sample.plates.last()).copied().into_iter().collect();
            device.measure(&LoadSample { plates, ..sample.clone() })?;
        }
        Ok(())
    }

    fn fault_counts(&self) -> FaultCounts {
        self.devices[0].fault_counts() + self.devices[1].fault_counts()
    }

    fn set_faults(&mut self, faults: Faults) {
        self.devices.iter_mut().for_each(|device| device.set_faults(faults));
    }

    fn unplug(&mut self) {
        self.devices.iter_mut().for_each(|device| device.unplug());
    }

    fn plug(&mut self) -> io::Result<()> {
        self.devices.iter_mut().try_for_each(|device| device.plug())
    }

    fn config(&self) -> String {
        let mut sections = [0, 1].map(|k| self.devices[k].config());
        if self.of_feet {
            sections = [of_foot(&sections[0], "left"), of_foot(&sections[1], "right")];
        }
        let [first, second] = sections;
        format!("{first}\n{}", second.replace("[ground", "[ground.second"))
    }
}
