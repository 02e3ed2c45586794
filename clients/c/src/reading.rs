//! `equipoise_reading` and `equipoise_early_reading`: a state and an early state as returned to C programs.

use bytemuck::Zeroable;
use equipoise_core::message::{EarlyState, State};

/// An early state with its ages. The layout is `equipoise_early_reading` of the header.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EarlyReading {
    /// The early state.
    pub early: EarlyState,
    /// Time of receipt, CLOCK_MONOTONIC ns.
    pub received_ns: u64,
    /// Time from the due time of its cycle to its return to the program, ns.
    pub age_ns: u64,
    /// Age of the sample of the results, ns.
    pub sample_age_ns: u64,
    /// 1 if it was not returned before.
    pub is_new: u32,
    /// Always zero.
    pub reserved: u32,
}

impl EarlyReading {
    /// Placeholder when there is no early state: all validity flags set, all ages maximal.
    pub fn nothing() -> EarlyReading {
        EarlyReading {
            early: EarlyState { valid: u64::MAX, sample_age_ns: u64::MAX, ..EarlyState::zeroed() },
            received_ns: 0,
            age_ns: u64::MAX,
            sample_age_ns: u64::MAX,
            is_new: 0,
            reserved: 0,
        }
    }
}

impl From<equipoise_client::EarlyReading> for EarlyReading {
    fn from(reading: equipoise_client::EarlyReading) -> EarlyReading {
        EarlyReading {
            early: reading.early,
            received_ns: reading.received_ns,
            age_ns: reading.age_ns,
            sample_age_ns: reading.sample_age_ns,
            is_new: u32::from(reading.is_new),
            reserved: 0,
        }
    }
}

/// A state with its ages and counts. The layout is `equipoise_reading` of the header.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The state.
    pub state: State,
    /// Time of receipt, CLOCK_MONOTONIC ns.
    pub received_ns: u64,
    /// Time from the due time of its cycle to its return to the program, ns.
    pub age_ns: u64,
    /// Age of the sample time of the results, ns; `u64::MAX` before the first.
    pub sample_age_ns: u64,
    /// States that were not returned since the last new one.
    pub missed: u64,
    /// 1 if the daemon has restarted since.
    pub restarted: u32,
    /// 1 if it was not returned before.
    pub is_new: u32,
}

impl Reading {
    /// Placeholder when there is no reading: all validity flags set, all ages maximal. A program that ignores the
    /// result number finds no valid value.
    pub fn nothing() -> Reading {
        Reading {
            state: State {
                valid: u64::MAX,
                suit_age_ns: u64::MAX,
                ground_age_ns: u64::MAX,
                worst_joint: u32::MAX,
                suggested_pose: u32::MAX,
                ..State::zeroed()
            },
            received_ns: 0,
            age_ns: u64::MAX,
            sample_age_ns: u64::MAX,
            missed: 0,
            restarted: 0,
            is_new: 0,
        }
    }
}

impl From<equipoise_client::Reading> for Reading {
    fn from(reading: equipoise_client::Reading) -> Reading {
        Reading {
            state: reading.state,
            received_ns: reading.received_ns,
            age_ns: reading.age_ns,
            sample_age_ns: reading.sample_age_ns.unwrap_or(u64::MAX),
            missed: reading.missed,
            restarted: u32::from(reading.restarted),
            is_new: u32::from(reading.is_new),
        }
    }
}
