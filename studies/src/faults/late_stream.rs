//! A stream whose samples arrive late, under the stamps that the adapter's clock fit gives them.

use std::collections::VecDeque;

use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_core::time::ClockFit;

/// Stored stamps: 2 s at 240 Hz, longer than a state's age.
const STAMPED_MAX: usize = 480;

/// Fields that the adapter sets from a sample's counter and arrival.
pub(super) trait Stamped: Copy {
    /// Device counter and stamp, ns.
    fn counter_and_stamp(&self) -> (u64, u64);
    /// The sample with this arrival, and the stamp, its 1-σ (ns) and the epoch of a clock fit.
    fn stamped(self, arrival_ns: u64, stamp_and_sigma_ns: (u64, u64), clock_epoch: u32) -> Self;
}

macro_rules! stamped {
    ($Sample:ty) => {
        impl Stamped for $Sample {
            fn counter_and_stamp(&self) -> (u64, u64) {
                (u64::from(self.device_counter), self.sample_time_ns)
            }

            fn stamped(self, arrival_ns: u64, (stamp_ns, sigma_ns): (u64, u64), clock_epoch: u32) -> Self {
                Self {
                    arrival_ns,
                    clock_epoch,
                    sample_time_ns: stamp_ns,
                    sample_time_sigma_ns: sigma_ns,
                    ..self
                }
            }
        }
    };
}

stamped!(SuitSample);
stamped!(GroundSample);

/// Samples that have not arrived, and the clock fit of those that have.
#[derive(Debug, Clone)]
pub(super) struct LateStream<Sample> {
    /// With the time of arrival, ns.
    in_flight: VecDeque<(u64, Sample)>,
    clock: ClockFit,
    /// Stamps of the last samples, and the times at which they were taken, ns.
    taken: VecDeque<[u64; 2]>,
}

impl<Sample> Default for LateStream<Sample> {
    fn default() -> Self {
        LateStream { in_flight: VecDeque::new(), clock: ClockFit::new(), taken: VecDeque::new() }
    }
}

impl<Sample: Stamped> LateStream<Sample> {
    /// Time at which the sample with this stamp was taken, ns.
    pub(super) fn taken_ns(&self, stamp_ns: u64) -> Option<u64> {
        self.taken.iter().find(|[stamp, _]| *stamp == stamp_ns).map(|[_, taken_ns]| *taken_ns)
    }

    /// Replaces the samples taken now by those that arrive now, in order. Before the first delay nothing changes.
    pub(super) fn delay(&mut self, samples: &mut Vec<Sample>, now_ns: u64, late_s: Option<f64>) {
        if late_s.is_none() && self.taken.is_empty() {
            return;
        }
        let late_s = late_s.unwrap_or(0.0);
        for sample in samples.drain(..) {
            let earlier_ns = self.in_flight.back().map_or(0, |(arrival_ns, _)| *arrival_ns);
            let arrival_ns = sample.counter_and_stamp().1 + (late_s * 1e9) as u64;
            self.in_flight.push_back((arrival_ns.max(earlier_ns), sample));
        }
        while let Some((arrival_ns, sample)) =
            self.in_flight.pop_front_if(|(arrival_ns, _)| *arrival_ns <= now_ns)
        {
            let (counter, taken_ns) = sample.counter_and_stamp();
            self.clock.observe(counter, arrival_ns);
            let stamp = self.clock.estimate(counter);
            let stamp = stamp.map_or((arrival_ns, u64::MAX), |stamp| (stamp.host_ns, stamp.sigma_ns));
            self.taken.truncate(STAMPED_MAX - 1);
            self.taken.push_front([stamp.0, taken_ns]);
            samples.push(sample.stamped(arrival_ns, stamp, self.clock.epoch()));
        }
    }
}
