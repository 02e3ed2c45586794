//! `equipoise_reading`: what the C program is handed.

use bytemuck::Zeroable;
use equipoise_core::message::State;

/// A state, with what a controller must know about it. The layout is `equipoise_reading` of the header.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The state.
    pub state: State,
    /// When it was picked up, CLOCK_MONOTONIC.
    pub picked_up_ns: u64,
    /// How long ago its cycle was due, when it was handed out.
    pub age_ns: u64,
    /// How old the moment is that torques are about; `u64::MAX` before the first.
    pub moment_age_ns: u64,
    /// States since the last new one that were not handed out.
    pub missed: u64,
    /// 1 if the daemon was started anew since.
    pub restarted: u32,
    /// 1 if it was not handed out before.
    pub is_new: u32,
}

impl Reading {
    /// What stands in the place of a reading when there is none: every reason raised, as old as can be. Who forgets to
    /// look at the outcome finds no value that may be used.
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
            picked_up_ns: 0,
            age_ns: u64::MAX,
            moment_age_ns: u64::MAX,
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
            picked_up_ns: reading.picked_up_ns,
            age_ns: reading.age_ns,
            moment_age_ns: reading.moment_age_ns.unwrap_or(u64::MAX),
            missed: reading.missed,
            restarted: u32::from(reading.restarted),
            is_new: u32::from(reading.is_new),
        }
    }
}
