//! Hours of faults against the truth: whatever happens to cables, devices, adapters and consumers, no wrong value is
//! ever reported as valid; and the daemon neither grows nor leaks nor fails to recover.
//!
//! `SOAK_SECONDS` and `SOAK_SEED` set duration and random seed; docs/realtime.md defines "wrong". The same faults in
//! simulated time: the study `faults`, whose short form is part of `cargo test`.

#[path = "../../cli/tests/failures/process.rs"]
mod process;
#[path = "../../cli/tests/failures/station.rs"]
#[expect(dead_code, reason = "the soak needs a part of it")]
mod station;

mod checker;
mod injected_fault;
mod resources;
mod rig;

use std::time::{Duration, Instant};

use injected_fault::InjectedFault;
use rig::Rig;

/// A number of the environment, or the default.
fn number(variable: &str, otherwise: u64) -> u64 {
    match std::env::var(variable) {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("{variable} is no number: {text}")),
        Err(_) => otherwise,
    }
}

#[test]
#[ignore = "needs a machine with little other load, so that a verdict is possible; .ci/soak runs it"]
fn no_fault_gives_a_wrong_valid_value() {
    let (long, seed) = (Duration::from_secs(number("SOAK_SECONDS", 4)), number("SOAK_SEED", 1));
    let mut rig = Rig::start(seed);
    rig.identify();
    println!("seed {seed}: identified with {} poses", rig.checker.state.poses_used);
    let started = Instant::now();
    let mut events = 0;
    'soak: loop {
        for fault in InjectedFault::shuffled(seed.wrapping_add(events)) {
            if started.elapsed() > long {
                break 'soak;
            }
            rig.checker.during = fault.name();
            let begun = Instant::now();
            rig.inject(fault);
            let took = rig.recover(fault);
            println!(
                "{:>7.1} s {:<28} recovered after {:.1} s",
                begun.duration_since(started).as_secs_f64(),
                fault.name(),
                took.as_secs_f64()
            );
            events += 1;
        }
    }
    rig.end(events);
}
