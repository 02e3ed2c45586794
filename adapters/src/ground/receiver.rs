//! Converts readings of any device to ground samples: order, loss, time, frame.

use super::frame::{GroundFrame, Measures};
use super::reading::{Decoded, DecoderEvent, Load, Reading, Tick};
use super::refusal::GroundRefusal;
use crate::counts::Counts;
use crate::sequence::{Sequence, SequencePosition};
use bytemuck::Zeroable;
use equipoise_core::message::{Component, FootFrame, GroundDevice as DeviceKind, GroundSample};
use equipoise_core::time::ClockFit;

/// Devices send at 7912 Hz at most; this leaves a margin.
const MAX_RATE_HZ: u64 = 20_000;
/// Plausibility limit, N or N m: ten people who jump.
const LARGEST: f64 = 1e5;

/// Sign, pose and constant delay of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundSettings {
    /// Side of the contact.
    pub measures: Measures,
    /// Pose of the sensor.
    pub frame: GroundFrame,
    /// Constant part of the delay from sample to arrival, ns: unobservable for the clock fit, so it is subtracted from
    /// every sample time.
    pub latency_ns: u64,
    /// Kind of the device.
    pub device: DeviceKind,
}

impl Default for GroundSettings {
    fn default() -> Self {
        GroundSettings {
            measures: Measures::default(),
            frame: GroundFrame::default(),
            latency_ns: 0,
            device: DeviceKind::Plate,
        }
    }
}

/// Converts readings of one device to samples.
#[derive(Debug, Clone)]
pub struct GroundReceiver {
    settings: GroundSettings,
    sequence: Sequence,
    clock: ClockFit,
    /// The last tick, raw and unwrapped.
    newest: Option<(Tick, u64)>,
    session: u32,
    counts: Counts,
    block_latency_ns: u64,
    /// Unwrapped ticks of the samples in work, index by index.
    ticks: Vec<u64>,
}

impl GroundReceiver {
    /// Creates a receiver before any data.
    pub fn new(settings: GroundSettings) -> Self {
        GroundReceiver {
            settings,
            sequence: Sequence::new(MAX_RATE_HZ),
            clock: ClockFit::new(),
            newest: None,
            session: 0,
            counts: Counts::default(),
            block_latency_ns: 0,
            ticks: Vec::new(),
        }
    }

    /// Drains `decoded`, the contents of one delivery, and appends its samples to `samples`, oldest first.
    ///
    /// `arrival_ns` is the delivery's arrival on CLOCK_MONOTONIC. `published_ns` is left at 0 for the publisher to set.
    pub fn receive(&mut self, decoded: &mut Decoded, arrival_ns: u64, samples: &mut Vec<GroundSample>) {
        self.block_latency_ns = decoded.block_latency_ns.take().unwrap_or(self.block_latency_ns);
        let first = samples.len();
        self.ticks.clear();
        for event in decoded.events.drain(..) {
            match event {
                DecoderEvent::Reading(reading) => {
                    self.counts.received += 1;
                    match self.accept(&reading, arrival_ns) {
                        Ok(sample) => samples.push(sample),
                        Err(refusal) => self.counts.refuse(refusal.index()),
                    }
                }
                DecoderEvent::Refused(refusal) => self.refuse(refusal),
                DecoderEvent::Lost(readings) => self.skip(readings),
                DecoderEvent::Restarted => self.restart(),
                DecoderEvent::Rebooted => self.begin_clock(),
            }
        }
        // The readings of one delivery waited for the last of them, so only that one's tick marks the time of sending.
        if let Some(newest) = self.ticks.last() {
            self.clock.observe(*newest, arrival_ns);
        }
        for (sample, tick) in samples.iter_mut().skip(first).zip(&self.ticks) {
            (sample.sample_time_ns, sample.sample_time_sigma_ns) = match self.clock.estimate(*tick) {
                Some(estimate) => (estimate.host_ns, estimate.sigma_ns),
                None => (sample.arrival_ns, u64::MAX),
            };
            sample.sample_time_ns = sample.sample_time_ns.saturating_sub(self.settings.latency_ns);
            // Readings that are lost without a number appear as delay.
            let is_counted = !matches!(self.newest, Some((Tick::Uncounted, _)));
            sample.clock_epoch = if is_counted { self.clock.epoch() } else { 0 };
        }
    }

    /// Counts since the start; `refused` in the order of [`GroundRefusal`].
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Duration of the blocks in which the device collects readings, ns; 0 if it sends each by itself.
    pub fn block_latency_ns(&self) -> u64 {
        self.block_latency_ns
    }

    /// Counts input that was refused before decoding.
    pub fn refuse(&mut self, refusal: GroundRefusal) {
        self.counts.received += 1;
        self.counts.refuse(refusal.index());
    }

    /// Begins a new stream. A device's own clock continues across it; where readings are merely counted, the new count
    /// is unrelated to the old one.
    pub(super) fn restart(&mut self) {
        self.sequence.reset();
        if let Some((Tick::Uncounted, _)) = self.newest {
            self.begin_clock();
        }
    }

    /// Begins a new session: the device's clock is unrelated to its earlier values.
    fn begin_clock(&mut self) {
        if self.newest.take().is_some() {
            self.session += 1;
            self.clock.restart();
        }
    }

    fn skip(&mut self, readings: u32) {
        self.counts.lost += u64::from(readings);
        self.pass(readings);
    }

    /// Accounts for measured readings without a sample: merely counted readings still advance the time.
    fn pass(&mut self, readings: u32) {
        if let Some((Tick::Uncounted, tick)) = &mut self.newest {
            *tick += u64::from(readings);
        }
    }

    fn accept(&mut self, reading: &Reading, arrival_ns: u64) -> Result<GroundSample, GroundRefusal> {
        // A reading that is refused below was not lost: it counts in the sequence.
        if let Some(sequence) = reading.sequence {
            match self.sequence.classify(sequence, arrival_ns) {
                SequencePosition::Same => return Err(GroundRefusal::Duplicate),
                SequencePosition::Old => return Err(GroundRefusal::OutOfOrder),
                SequencePosition::Next { gap } => self.counts.lost += u64::from(gap - 1),
                SequencePosition::First | SequencePosition::NewSession => {}
            }
        }
        if let Err(refusal) = believable(&reading.load) {
            if reading.tick == Tick::Uncounted {
                self.pass(1);
            }
            return Err(refusal);
        }
        let tick = self.follow(reading.tick);
        self.ticks.push(tick);
        self.counts.published += 1;
        if reading.status != 0 {
            self.counts.refuse(GroundRefusal::DeviceStatus.index());
        }
        let sample = GroundSample {
            arrival_ns,
            sequence: self.counts.published,
            device_counter: reading.device_counter,
            device_status: reading.status,
            session: self.session,
            surface_z_m: self.settings.frame.surface_z_m(),
            devices: self.settings.device as u32,
            ..GroundSample::zeroed()
        };
        Ok(self.placed(sample, &reading.load))
    }

    /// The sample with the measured quantities, in the station's world as far as one device provides them.
    fn placed(&self, sample: GroundSample, load: &Load) -> GroundSample {
        match load {
            Load::Wrench(sensor) => {
                let person = self.settings.frame.person_from_sensor(*sensor, self.settings.measures);
                GroundSample { force_n: person.force_n, moment_nm: person.moment_nm, ..sample }
            }
            Load::Part { wrench, not_measured } => {
                // After rotation and translation, components that were not measured have no meaning.
                let whole = self.placed(sample, &Load::Wrench(*wrench));
                GroundSample { not_measured: *not_measured, ..whole }.mask_unmeasured()
            }
            Load::Insoles(feet) => GroundSample {
                per_foot: 1,
                force_n: [0.0, 0.0, feet[0].vertical_n + feet[1].vertical_n],
                foot_vertical_n: feet.map(|foot| foot.vertical_n),
                foot_cop_m: feet.map(|foot| foot.cop_m),
                foot_frame: FootFrame::Insole as u32,
                not_measured: Component::Shear as u32 | Component::Tilt as u32 | Component::FreeMoment as u32,
                ..sample
            },
        }
    }

    /// Unwraps the device's clock. It continues across streams; a decrease means that the device was restarted.
    fn follow(&mut self, tick: Tick) -> u64 {
        let unwrapped = match (tick, self.newest) {
            (Tick::Counter(now), Some((Tick::Counter(before), unwrapped))) => {
                let steps = now.wrapping_sub(before);
                (steps.cast_signed() >= 0).then(|| unwrapped + u64::from(steps))
            }
            // As with a counter, a coarse clock may be constant between two readings whose order follows from their
            // numbers.
            (Tick::Time(now), Some((Tick::Time(before), _))) => (now >= before).then_some(now),
            (Tick::Uncounted, Some((Tick::Uncounted, before))) => Some(before + 1),
            (Tick::Counter(first), None) => Some(u64::from(first)),
            (Tick::Time(first), None) => Some(first),
            (Tick::Uncounted, None) => Some(0),
            // A device does not change its kind of clock; if it does, it is another device.
            _ => None,
        };
        let unwrapped = unwrapped.unwrap_or_else(|| {
            self.session += 1;
            self.clock.restart();
            match tick {
                Tick::Counter(now) => u64::from(now),
                Tick::Time(now) => now,
                Tick::Uncounted => 0,
            }
        });
        self.newest = Some((tick, unwrapped));
        unwrapped
    }
}

/// Whether a person can have exerted this load.
fn believable(load: &Load) -> Result<(), GroundRefusal> {
    if !load.is_finite() {
        Err(GroundRefusal::NotFinite)
    } else if !load.is_within(LARGEST) {
        Err(GroundRefusal::Implausible)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests;
