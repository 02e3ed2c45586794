//! Stages of the path from a sensor to the published state: the single table of their names and definitions.
//!
//! A stage is the difference of two stamps of a [`CycleRecord`] (ns, CLOCK_MONOTONIC). Consecutive stages add up to the
//! total latency.

use equipoise_core::message::CycleRecord;

/// Which cycles have a value for a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Applies {
    /// Every cycle.
    Always,
    /// Cycles that ingested a new suit sample; the others repeat the stamps of an old one.
    SuitTaken,
    /// Cycles that ingested a new ground sample.
    GroundTaken,
}

/// Why the value of a stage that applies to the cycle is unavailable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotRecorded {
    /// One of the two stamps is 0: it was not recorded.
    Missing,
    /// The end precedes the begin (sensor stages: the fitted sample time is later than the arrival).
    Reversed,
}

/// Duration of a stage in one cycle, ns; `None` where the stage does not apply to the cycle.
pub type StageTime = Option<Result<u64, NotRecorded>>;

type Stamp = fn(&CycleRecord) -> u64;

macro_rules! stages {
    ($($(#[$doc:meta])* $Stage:ident = $name:literal, $applies:ident: $from:ident => $to:ident;)*) => {
        /// One stage of the path. The number is the index in every array.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Stage {
            $(
                $(#[$doc])*
                #[doc = concat!("`", stringify!($to), " − ", stringify!($from), "` of the cycle record.")]
                $Stage,
            )*
        }

        impl Stage {
            /// All stages in the order of the path.
            pub const ALL: [Stage; Stage::COUNT] = [$(Stage::$Stage),*];
            /// Number of stages.
            pub const COUNT: usize = [$($name),*].len();

            /// The public name: the tag in `.hlog` files and the row in reports.
            pub const fn name(self) -> &'static str {
                match self { $(Stage::$Stage => $name,)* }
            }

            /// Its definition `FROM -> TO`, by the names of two fields of the cycle record.
            pub const fn definition(self) -> &'static str {
                match self { $(Stage::$Stage => concat!(stringify!($from), " -> ", stringify!($to)),)* }
            }

            fn stamps(self) -> (Applies, Stamp, Stamp) {
                match self { $(Stage::$Stage => (Applies::$applies, |r| r.$from, |r| r.$to),)* }
            }
        }
    };
}

stages! {
    /// Processing in the suit's software and the network, except a configured constant latency.
    SuitTransport = "suit.transport", SuitTaken: suit_sample_time_ns => suit_arrival_ns;
    /// The suit adapter: from the kernel's receive stamp to the bus.
    SuitAdapter = "suit.adapter", SuitTaken: suit_arrival_ns => suit_published_ns;
    /// The bus and the wake-up of ingress.
    SuitIngress = "suit.ingress", SuitTaken: suit_published_ns => suit_ingress_ns;
    /// The ring and the wait for the next cycle.
    SuitWait = "suit.wait", SuitTaken: suit_ingress_ns => compute_start_ns;
    /// The whole path: age of the newest suit sample when the state of its first cycle is published. The torques of
    /// that state describe an instant `group_delay_ns` earlier, because accelerations need later samples.
    SuitToState = "suit.to_state", SuitTaken: suit_sample_time_ns => published_ns;
    /// Processing in the device and the network, except a configured constant latency.
    GroundTransport = "ground.transport", GroundTaken: ground_sample_time_ns => ground_arrival_ns;
    /// The ground adapter: from the kernel's receive stamp to the bus.
    GroundAdapter = "ground.adapter", GroundTaken: ground_arrival_ns => ground_published_ns;
    /// The bus and the wake-up of ingress.
    GroundIngress = "ground.ingress", GroundTaken: ground_published_ns => ground_ingress_ns;
    /// The ring and the wait for the next cycle.
    GroundWait = "ground.wait", GroundTaken: ground_ingress_ns => compute_start_ns;
    /// The whole path: age of the newest ground sample when the state of its first cycle is published.
    GroundToState = "ground.to_state", GroundTaken: ground_sample_time_ns => published_ns;
    /// Wake-up latency relative to the schedule, not to the previous wake-up.
    LoopWake = "loop.wake", Always: due_ns => woken_ns;
    /// Reading samples and commands from the rings.
    LoopIntake = "loop.intake", Always: woken_ns => compute_start_ns;
    /// `core::cycle` itself.
    LoopCompute = "loop.compute", Always: compute_start_ns => compute_end_ns;
    /// The ring to egress and the wake-up of egress.
    EgressWake = "egress.wake", Always: compute_end_ns => publish_start_ns;
    /// Publishing the state on the bus.
    EgressPublish = "egress.publish", Always: publish_start_ns => published_ns;
    /// From the scheduled time to the published state.
    LoopToState = "loop.to_state", Always: due_ns => published_ns;
}

impl Stage {
    /// Index in arrays.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Whether the stage starts at the scheduled time. Such a stage also has one value per skipped period, which avoids
    /// coordinated omission.
    pub const fn starts_when_due(self) -> bool {
        matches!(self, Stage::LoopWake | Stage::LoopToState)
    }

    /// Whether the stage is not the sum of others.
    pub const fn is_elementary(self) -> bool {
        !matches!(self, Stage::SuitToState | Stage::GroundToState | Stage::LoopToState)
    }

    /// Begin and end of the stage in one cycle, CLOCK_MONOTONIC ns; `None` where it does not apply to the cycle.
    pub fn span_ns(self, record: &CycleRecord) -> Option<Result<(u64, u64), NotRecorded>> {
        let (applies, from, to) = self.stamps();
        let applies = match applies {
            Applies::Always => true,
            Applies::SuitTaken => record.suit_taken > 0,
            Applies::GroundTaken => record.ground_taken > 0,
        };
        applies.then(|| match (from(record), to(record)) {
            (0, _) | (_, 0) => Err(NotRecorded::Missing),
            (from_ns, to_ns) if to_ns < from_ns => Err(NotRecorded::Reversed),
            span_ns => Ok(span_ns),
        })
    }

    /// Duration of the stage in one cycle, ns.
    pub fn time_ns(self, record: &CycleRecord) -> StageTime {
        self.span_ns(record).map(|span_ns| span_ns.map(|(from_ns, to_ns)| to_ns - from_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn names_are_distinct_and_fit_a_hlog_tag() {
        for (index, stage) in Stage::ALL.into_iter().enumerate() {
            assert_eq!(stage.index(), index);
            assert!(!stage.name().contains([',', ' ', '\n']));
            assert!(Stage::ALL[..index].iter().all(|other| other.name() != stage.name()));
        }
    }

    #[test]
    fn the_stages_of_one_sensor_sum_to_the_path() {
        let record = CycleRecord {
            suit_sample_time_ns: 100,
            suit_arrival_ns: 170,
            suit_published_ns: 190,
            suit_ingress_ns: 200,
            compute_start_ns: 1_020,
            compute_end_ns: 1_050,
            publish_start_ns: 1_075,
            published_ns: 1_080,
            suit_taken: 1,
            ..Zeroable::zeroed()
        };
        let ns = |stage: Stage| stage.time_ns(&record).unwrap().unwrap();
        let sensor = [Stage::SuitTransport, Stage::SuitAdapter, Stage::SuitIngress, Stage::SuitWait];
        let cycle = [Stage::LoopCompute, Stage::EgressWake, Stage::EgressPublish];
        let sum: u64 = sensor.into_iter().chain(cycle).map(ns).sum();
        assert_eq!(sum, ns(Stage::SuitToState));
    }

    #[test]
    fn missing_reversed_and_unused_are_distinguished() {
        let mut record = CycleRecord { due_ns: 50, woken_ns: 40, ..Zeroable::zeroed() };
        assert_eq!(Stage::LoopWake.time_ns(&record), Some(Err(NotRecorded::Reversed)));
        assert_eq!(Stage::LoopCompute.time_ns(&record), Some(Err(NotRecorded::Missing)));
        assert_eq!(Stage::SuitTransport.time_ns(&record), None);
        record.suit_taken = 1;
        assert_eq!(Stage::SuitTransport.time_ns(&record), Some(Err(NotRecorded::Missing)));
    }
}
