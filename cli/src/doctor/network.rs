//! Checks socket buffers and ports.

use equipoise_config::{Config, SuitSourceKind};

use super::Check;
use super::facts::Facts;
use super::ports::Port;
use super::station::StationFacts;

/// Buffer size requested by the adapters: four seconds of all streams.
const BUFFER_WANTED: u64 = 4 << 20;
/// Smaller buffers cannot hold the data of a stall of a quarter of a second.
const BUFFER_MIN: u64 = 256 << 10;

pub(super) fn receive_buffer(facts: &Facts) -> Check {
    const NAME: &str = "socket buffers";
    const FIX: &str = "sysctl -w net.core.rmem_max=4194304 (and a file in /etc/sysctl.d/)";
    match facts.rmem_max {
        None => Check::skipped(NAME, "the kernel does not report net.core.rmem_max"),
        Some(bytes) if bytes < BUFFER_MIN => Check::warn(
            NAME,
            format!(
                "net.core.rmem_max is {} kB: a stall of a quarter of a second loses samples",
                bytes >> 10
            ),
            FIX,
        ),
        Some(bytes) if bytes < BUFFER_WANTED => Check::warn(
            NAME,
            format!("net.core.rmem_max is {} kB; the adapters ask for {}", bytes >> 10, BUFFER_WANTED >> 10),
            FIX,
        ),
        Some(bytes) => Check::ok(NAME, format!("net.core.rmem_max is {} kB", bytes >> 10)),
    }
}

pub(super) fn ports(config: &Config, station: &StationFacts) -> Vec<Check> {
    let mut checks = Vec::new();
    if config.suit.source != SuitSourceKind::External {
        let listens_beyond = !config.suit.listen.ip().is_loopback();
        checks.push(if listens_beyond && !config.suit.allow_remote {
            Check::warn(
                "suit.listen",
                format!("{} is open to other computers, and what they send is refused", config.suit.listen),
                "suit.allow_remote = true, or listen on 127.0.0.1",
            )
        } else {
            port("suit.listen", station.suit_port, &config.suit.listen.to_string(), station)
        });
    }
    if let (Some(page), Some(found)) = (&config.page, station.page_port) {
        checks.push(port("page.listen", found, &page.listen.to_string(), station));
    }
    if let (Some(metrics), Some(found)) = (&config.metrics, station.metrics_port) {
        checks.push(port("metrics.listen", found, &metrics.listen.to_string(), station));
    }
    checks
}

fn port(name: &'static str, found: Port, address: &str, station: &StationFacts) -> Check {
    match (found, station.daemon) {
        (Port::Free, None) => Check::ok(name, format!("{address} is free")),
        (Port::Free, Some(daemon)) => Check::warn(
            name,
            format!(
                "{address} is free, though the daemon runs (process {daemon}): it was started from another file"
            ),
            "restart the daemon with this configuration",
        ),
        (Port::OwnProcess, _) => Check::ok(name, format!("{address} is held by this station")),
        (Port::InUse, _) => Check::fail(
            name,
            format!("{address} is taken by another program"),
            format!("`ss -ulpn` and `ss -tlpn` show which: end it, or choose another {name}"),
        ),
        (Port::AddressUnavailable, _) => Check::fail(
            name,
            format!("{address} is no address of this computer"),
            format!("`ip address` shows those it has; or set {name} to 127.0.0.1"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict::{self, Fail, Ok, Skipped, Warn};
    use super::*;

    #[test]
    fn a_small_buffer_is_reported() {
        let of = |rmem_max| receive_buffer(&Facts { rmem_max, ..Facts::healthy() }).verdict;
        assert_eq!(
            [of(Some(212_992)), of(Some(1 << 20)), of(Some(4 << 20)), of(None)],
            [Warn, Warn, Ok, Skipped]
        );
    }

    #[test]
    fn a_port_is_free_own_or_of_another_process() {
        let of = |found, daemon| -> Verdict {
            let station = StationFacts { daemon, ..StationFacts::default() };
            port("suit.listen", found, "127.0.0.1:9763", &station).verdict
        };
        assert_eq!(of(Port::Free, None), Ok);
        assert_eq!(of(Port::OwnProcess, Some(7)), Ok);
        assert_eq!(of(Port::InUse, Some(7)), Fail);
        assert_eq!(of(Port::Free, Some(7)), Warn);
        assert_eq!(of(Port::InUse, None), Fail);
        assert_eq!(of(Port::AddressUnavailable, None), Fail);
    }
}
