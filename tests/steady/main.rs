//! Steady state: no allocation, no release, no page fault and no lost slot, for any duration.
//!
//! `accelerated`: the loop itself, on a clock that runs faster than real time, over millions of cycles. `under_churn`:
//! the whole daemon in real time while consumers join, leave and are killed, sensors disconnect and return, the page is
//! reloaded and recorders start and stop. `every_work`: the loop in real time while all kinds of its work occur.
//! `real_input` is here because its bounds assume that few other tests disturb the loop. Lengths come from the
//! environment; `.ci/steady` uses longer ones: `STEADY_CYCLES`, `STEADY_SECONDS`, `STEADY_CONSUMERS`.

#[path = "../../cli/tests/common/mod.rs"]
mod common;
#[path = "../../cli/tests/failures/process.rs"]
mod process;
#[path = "../../cli/tests/failures/station.rs"]
#[expect(dead_code, reason = "the suite needs a part of it")]
mod station;

mod accelerated;
mod churn;
mod consumers;
mod counting_alloc;
mod every_work;
mod real_input;
mod under_churn;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use equipoise_daemon::tick::Observer;

/// A number of the environment, or the one for `cargo test`.
fn number(variable: &str, otherwise: u64) -> u64 {
    match std::env::var(variable) {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("{variable} is no number: {text}")),
        Err(_) => otherwise,
    }
}

/// Arms the loop's own thread from the end of its warm-up on, and returns the counts.
#[derive(Debug, Clone, Default)]
struct Watch {
    warm_cycles: u64,
    armed_cycles: Arc<AtomicU64>,
    allocations: Arc<AtomicU64>,
    frees: Arc<AtomicU64>,
    disarm: Arc<AtomicBool>,
}

impl Watch {
    fn after(warm_cycles: u64) -> Watch {
        Watch { warm_cycles, ..Watch::default() }
    }

    fn armed_cycles(&self) -> u64 {
        self.armed_cycles.load(Ordering::Relaxed)
    }

    fn touched(&self) -> (u64, u64) {
        (self.allocations.load(Ordering::Relaxed), self.frees.load(Ordering::Relaxed))
    }
}

impl Observer for Watch {
    fn cycle_begins(&mut self, cycle: u64) {
        let armed = cycle > self.warm_cycles && !self.disarm.load(Ordering::Relaxed);
        counting_alloc::arm(armed);
        let touched = counting_alloc::touched();
        self.allocations.store(touched.allocations, Ordering::Relaxed);
        self.frees.store(touched.frees, Ordering::Relaxed);
        self.armed_cycles.fetch_add(u64::from(armed), Ordering::Relaxed);
    }
}
