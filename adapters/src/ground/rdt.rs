//! ATI RDT records to ground samples.

use super::frame::{GroundFrame, Measures, Wrench};
use crate::counts::{Counts, refusals};
use crate::sequence::{Place, Sequence};
use crate::wire::ati_rdt::{Record, Records};
use bytemuck::Zeroable;
use equipoise_core::message::GroundSample;
use equipoise_core::time::ClockFit;

/// Devices send at 7912 Hz at most; this leaves room.
const MAX_RATE_HZ: u64 = 20_000;

refusals! {
    /// Why something the plate sent was not used.
    pub enum RdtRefusal {
        /// Not a whole number of records.
        Length = "length",
        /// The same record again.
        Duplicate = "duplicate",
        /// Overtaken by a later record, or a jump of the counter that is not believed yet.
        OutOfOrder = "out_of_order",
        /// The device reports a fault. Handed on with its status, so that no one uses it.
        DeviceStatus = "device_status",
        /// Came from another address than the device's.
        ForeignSender = "foreign_sender",
    }
}

/// Scale, sign and place of the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RdtSettings {
    /// `cfgcpf` of the device's `netftapi2.xml`; its unit of force must be N.
    pub counts_per_newton: f64,
    /// `cfgcpt` of the device's `netftapi2.xml`; its unit of torque must be N m.
    pub counts_per_newton_metre: f64,
    /// Which side of the contact.
    pub measures: Measures,
    /// Where it stands.
    pub frame: GroundFrame,
    /// Constant part of the delay from a sample to its datagram, ns: the clock fit cannot see it, so it is taken off
    /// every sample time.
    pub latency_ns: u64,
}

impl Default for RdtSettings {
    fn default() -> Self {
        RdtSettings {
            counts_per_newton: 1e6,
            counts_per_newton_metre: 1e6,
            measures: Measures::default(),
            frame: GroundFrame::default(),
            latency_ns: 0,
        }
    }
}

/// Makes samples of the records of one device.
#[derive(Debug, Clone)]
pub struct RdtReceiver {
    settings: RdtSettings,
    rdt_sequence: Sequence,
    clock: ClockFit,
    /// The last `ft_sequence` as sent and unwrapped.
    device: Option<(u32, u64)>,
    session: u32,
    counts: Counts,
}

impl RdtReceiver {
    /// A receiver that has seen nothing yet.
    pub fn new(settings: RdtSettings) -> Self {
        RdtReceiver {
            settings,
            rdt_sequence: Sequence::new(MAX_RATE_HZ),
            clock: ClockFit::new(),
            device: None,
            session: 0,
            counts: Counts::default(),
        }
    }

    /// Takes in one datagram and appends its samples to `samples`, oldest first.
    ///
    /// `arrival_ns` is the kernel's receive stamp on CLOCK_MONOTONIC. `published_ns` is left at 0 for whoever publishes.
    pub fn receive(&mut self, datagram: &[u8], arrival_ns: u64, samples: &mut Vec<GroundSample>) {
        let Ok(records) = Records::parse(datagram) else {
            self.refuse_datagram(RdtRefusal::Length);
            return;
        };
        let first = samples.len();
        for record in records {
            self.counts.received += 1;
            match self.accept(&record, arrival_ns) {
                Ok(sample) => samples.push(sample),
                Err(refusal) => self.refuse(refusal),
            }
        }
        // The records of one datagram waited for the last of them: only that one says when the datagram was sent.
        if let Some((_, unwrapped)) = self.device
            && samples.len() > first
        {
            self.clock.observe(unwrapped, arrival_ns);
        }
        for sample in samples.iter_mut().skip(first) {
            self.stamp(sample);
        }
    }

    /// The stream was asked to start anew: whatever counter comes next is the first.
    pub fn stream_restarted(&mut self) {
        self.rdt_sequence.forget();
    }

    /// What was counted so far; `refused` in the order of [`RdtRefusal`].
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Counts a datagram that was refused before it came here, at the socket.
    pub fn refuse_datagram(&mut self, refusal: RdtRefusal) {
        self.counts.received += 1;
        self.refuse(refusal);
    }

    fn refuse(&mut self, refusal: RdtRefusal) {
        self.counts.refuse(refusal.index());
    }

    fn accept(&mut self, record: &Record, arrival_ns: u64) -> Result<GroundSample, RdtRefusal> {
        match self.rdt_sequence.place(record.rdt_sequence, arrival_ns) {
            Place::Same => return Err(RdtRefusal::Duplicate),
            Place::Old => return Err(RdtRefusal::OutOfOrder),
            Place::Next { gap } => self.counts.lost += u64::from(gap - 1),
            Place::First | Place::NewSession => {}
        }
        self.follow_device(record.ft_sequence);
        self.counts.published += 1;
        if record.status != 0 {
            self.refuse(RdtRefusal::DeviceStatus);
        }
        let settings = &self.settings;
        let sensor = Wrench {
            force_n: record.force_counts.map(|counts| f64::from(counts) / settings.counts_per_newton),
            moment_nm: record
                .torque_counts
                .map(|counts| f64::from(counts) / settings.counts_per_newton_metre),
        };
        let person = settings.frame.person_from_sensor(sensor, settings.measures);
        Ok(GroundSample {
            arrival_ns,
            sequence: self.counts.published,
            device_counter: record.ft_sequence,
            device_status: record.status,
            session: self.session,
            force_n: person.force_n,
            moment_nm: person.moment_nm,
            surface_z_m: settings.frame.surface_z_m(),
            ..GroundSample::zeroed()
        })
    }

    /// Unwraps the device's own counter. It runs on while streams come and go; if it falls, the device was restarted.
    fn follow_device(&mut self, ft_sequence: u32) {
        self.device = Some(match self.device {
            None => (ft_sequence, u64::from(ft_sequence)),
            Some((before, unwrapped)) => {
                let steps = ft_sequence.wrapping_sub(before);
                if steps.cast_signed() > 0 {
                    (ft_sequence, unwrapped + u64::from(steps))
                } else {
                    self.session += 1;
                    self.clock.restart();
                    (ft_sequence, u64::from(ft_sequence))
                }
            }
        });
    }

    fn stamp(&mut self, sample: &mut GroundSample) {
        let unwrapped = self.device.map_or(0, |(newest, unwrapped)| {
            unwrapped - u64::from(newest.wrapping_sub(sample.device_counter)).min(unwrapped)
        });
        (sample.sample_time_ns, sample.sample_time_sigma_ns) = match self.clock.estimate(unwrapped) {
            Some(estimate) => (estimate.host_ns, estimate.sigma_ns),
            None => (sample.arrival_ns, u64::MAX),
        };
        sample.sample_time_ns = sample.sample_time_ns.saturating_sub(self.settings.latency_ns);
    }
}

#[cfg(test)]
mod tests;
