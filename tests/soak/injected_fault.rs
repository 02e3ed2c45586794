//! Faults of a station.

/// A kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InjectedFault {
    Loss,
    Reorder,
    Duplicates,
    Truncation,
    Garbage,
    NotANumber,
    ForeignAvatar,
    RateUp,
    RateDown,
    SuitUnplugged,
    PlateUnplugged,
    BothUnplugged,
    SuitRestarts,
    PlateRestarts,
    CounterLeapsAhead,
    CounterLeapsBack,
    PlateFault,
    ConsumerStorm,
    SuitAdapterKilled,
    GroundAdapterKilled,
    DaemonStopped,
    /// An adapter with its clock ahead by this many seconds, or behind if negative.
    OtherClock(i32),
}

use InjectedFault::*;

const ALL: [InjectedFault; 25] = [
    Loss,
    Reorder,
    Duplicates,
    Truncation,
    Garbage,
    NotANumber,
    ForeignAvatar,
    RateUp,
    RateDown,
    SuitUnplugged,
    PlateUnplugged,
    BothUnplugged,
    SuitRestarts,
    PlateRestarts,
    CounterLeapsAhead,
    CounterLeapsBack,
    PlateFault,
    ConsumerStorm,
    SuitAdapterKilled,
    GroundAdapterKilled,
    DaemonStopped,
    OtherClock(1),
    OtherClock(1000),
    OtherClock(-1),
    OtherClock(-10),
];

impl InjectedFault {
    /// All kinds once, in an order that follows from the seed.
    pub(crate) fn shuffled(seed: u64) -> Vec<InjectedFault> {
        let (mut all, mut random) = (ALL.to_vec(), seed.wrapping_mul(2).wrapping_add(1));
        for place in (1..all.len()).rev() {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            all.swap(place, (random >> 33) as usize % (place + 1));
        }
        all
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Loss => "loss",
            Reorder => "reorder",
            Duplicates => "duplicates",
            Truncation => "truncation",
            Garbage => "garbage",
            NotANumber => "not a number",
            ForeignAvatar => "foreign avatar",
            RateUp => "suit faster",
            RateDown => "suit slower",
            SuitUnplugged => "suit unplugged",
            PlateUnplugged => "plate unplugged",
            BothUnplugged => "both unplugged",
            SuitRestarts => "suit restarts",
            PlateRestarts => "plate restarts",
            CounterLeapsAhead => "suit's counter leaps ahead",
            CounterLeapsBack => "suit's counter leaps back",
            PlateFault => "plate fault",
            ConsumerStorm => "consumer storm",
            SuitAdapterKilled => "suit adapter killed",
            GroundAdapterKilled => "ground adapter killed",
            DaemonStopped => "daemon stopped for 1 s",
            OtherClock(1) => "adapter 1 s ahead",
            OtherClock(-1) => "adapter 1 s behind",
            OtherClock(shift_s) if shift_s < 0 => "adapter far behind",
            OtherClock(_) => "adapter far ahead",
        }
    }
}
