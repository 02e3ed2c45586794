//! `equipoise doctor`: checks this computer for obstacles to real time, and how to fix each.
//!
//! [`facts`] reads the computer, [`station`] the station, [`suit_facts`] the suit's port; the other modules evaluate the
//! facts and read nothing.

mod capacity;
mod directories;
pub mod facts;
mod machine;
mod network;
pub mod ports;
pub mod station;
pub mod suit;
pub mod suit_facts;

use serde::Serialize;

pub use facts::Facts;
pub use station::StationFacts;
pub use suit::evaluate_suit;
pub use suit_facts::SuitFacts;

use equipoise_config::Config;

/// How a check came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As it should be.
    Ok,
    /// Not examined.
    Skipped,
    /// It works, but not as well as it could.
    Warn,
    /// It will not work.
    Fail,
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Check {
    /// What was looked at.
    pub name: &'static str,
    /// How it came out.
    pub verdict: Verdict,
    /// What was found.
    pub found: String,
    /// What to do if the check failed or warns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fix: Option<String>,
}

impl Check {
    fn ok(name: &'static str, found: impl Into<String>) -> Check {
        Check { name, verdict: Verdict::Ok, found: found.into(), fix: None }
    }

    /// Not examined, for a reason.
    fn skipped(name: &'static str, reason: impl Into<String>) -> Check {
        Check { verdict: Verdict::Skipped, ..Check::ok(name, reason) }
    }

    fn warn(name: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Check {
        Check { name, verdict: Verdict::Warn, found: found.into(), fix: Some(fix.into()) }
    }

    fn fail(name: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Check {
        Check { name, verdict: Verdict::Fail, found: found.into(), fix: Some(fix.into()) }
    }
}

/// Names of the checks that need a configuration and the bus.
const STATION: [&str; 3] = ["ports", capacity::SUIT, capacity::PLATE];

/// All checks, in the order in which a person would fix things. Without a configuration the computer is checked with the
/// defaults. `station` is the configuration with the observed station, or why the station was not examined.
pub fn evaluate(
    facts: &Facts,
    config: Option<&Config>,
    station: Result<(&Config, &StationFacts), &str>,
) -> Vec<Check> {
    let tick = config.map(|config| config.tick.clone()).unwrap_or_default();
    let runs = station.is_ok_and(|(_, station)| station.daemon.is_some());
    let mut checks = vec![
        machine::user(facts),
        machine::real_time(facts, &tick),
        machine::throttling(facts),
        machine::memory_lock(facts, &tick),
        machine::governor(facts),
        machine::core(facts, &tick),
        machine::preemption(facts),
        machine::clock_source(facts),
        directories::bus_root(facts),
        directories::shared_memory(facts, runs),
        directories::remove_ipc(facts),
        directories::state_directory(facts),
        network::receive_buffer(facts),
    ];
    match station {
        Ok((config, station)) => {
            checks.extend(network::ports(config, station));
            checks.extend([capacity::suit(config, station), capacity::plate(config, station)]);
        }
        Err(reason) => checks.extend(STATION.map(|name| Check::skipped(name, reason))),
    }
    checks
}
