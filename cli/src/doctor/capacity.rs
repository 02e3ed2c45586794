//! Checks the data of suit and plate: the stream's types and rate, and the force on the empty plate.

use equipoise_config::{Config, SuitSourceKind};

use super::Check;
use super::ports::Port;
use super::station::{StationFacts, Streamed};

/// Computing accelerations of a working person requires this sampling rate.
const SUIT_RATE_MIN_HZ: f64 = 55.0;
/// A larger force on the empty plate shifts the centre of pressure of a light subject by a centimetre.
const EMPTY_FORCE_MAX_N: f64 = 5.0;

/// Name of the check of the suit's data.
pub(super) const SUIT: &str = "MVN stream";
/// Name of the check of the plate's data.
pub(super) const PLATE: &str = "plate";

pub(super) fn suit(config: &Config, station: &StationFacts) -> Check {
    const NAME: &str = SUIT;
    let Some(streamed) = &station.streamed else {
        return match (config.suit.source, station.daemon) {
            (SuitSourceKind::External, None) => {
                Check::skipped(NAME, "no daemon runs, and another process receives the suit")
            }
            (_, None) if station.suit_port != Port::Free => {
                Check::skipped(NAME, "no daemon runs, and suit.listen is not free")
            }
            _ => Check::warn(
                NAME,
                "nothing was heard",
                format!(
                    "in MVN's Network Streamer: Host this computer, Port {}, Protocol {}, the box of the pose \
                     quaternion (02) ticked, the stream on",
                    config.suit.listen.port(),
                    if config.suit.source == SuitSourceKind::MvnTcp { "TCP" } else { "UDP" },
                ),
            ),
        };
    };
    let Streamed { rate_hz, quaternions, substitute, others, avatars, refused, .. } = streamed;
    let avatar = config.suit.avatar;
    let mut found = format!("{rate_hz:.0} samples a second");
    if !others.is_empty() {
        found.push_str(&format!(", with {}", others.join(", ")));
    }
    if !avatars.is_empty() && !avatars.contains(&avatar) {
        let ids: Vec<String> = avatars.iter().map(u8::to_string).collect();
        return Check::fail(
            NAME,
            format!("character {avatar} is not among those sent: {}", ids.join(", ")),
            format!(
                "suit.avatar = {}, or another Avatar in the Network Streamer",
                ids.first().map_or("0", |s| s)
            ),
        );
    }
    if !quaternions && substitute.is_none() {
        return Check::fail(
            NAME,
            format!("no pose is sent{}", refusals(refused)),
            "tick the box of the pose quaternion (02) in the Network Streamer",
        );
    }
    if let (false, Some(substitute)) = (quaternions, substitute) {
        return Check::warn(
            NAME,
            format!("{found}; poses as {substitute} only"),
            "tick the box of the pose quaternion (02) in the Network Streamer: it is what is best tried, and has no poles",
        );
    }
    if *rate_hz < SUIT_RATE_MIN_HZ {
        return Check::warn(NAME, found, "raise the Stream rate in the Network Streamer: 60 Hz at the least");
    }
    if !refused.is_empty() {
        let fix = "`equipoise status` shows the reasons; docs/operation.md explains them";
        return Check::warn(NAME, format!("{found}{}", refusals(refused)), fix);
    }
    Check::ok(NAME, found)
}

fn refusals(refused: &[(String, u64)]) -> String {
    let counts: Vec<String> = refused.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
    if counts.is_empty() { String::new() } else { format!("; refused: {}", counts.join(", ")) }
}

pub(super) fn plate(config: &Config, station: &StationFacts) -> Check {
    const NAME: &str = PLATE;
    if station.daemon.is_none() {
        return Check::skipped(NAME, "no daemon runs");
    }
    let ground = &station.ground;
    match station.plate_force_n {
        None => Check::warn(
            NAME,
            "nothing is heard of it, or it reports a fault",
            format!("is it on, and is {} right? `equipoise status` says more", config.ground.location()),
        ),
        Some(newtons) if newtons.abs() >= equipoise_core::cycle::memory::EMPTY_PLATE_N => Check::skipped(
            NAME,
            format!("{newtons:.0} N: a person stands on it, step off to check its zero{ground}"),
        ),
        Some(newtons) if newtons.abs() > EMPTY_FORCE_MAX_N => Check::warn(
            NAME,
            format!("empty, it shows {newtons:.1} N{ground}"),
            "step off, then: `equipoise tare`",
        ),
        Some(newtons) => Check::ok(NAME, format!("empty, it shows {newtons:.1} N{ground}")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict::{self, Fail, Ok, Skipped, Warn};
    use super::*;

    fn config() -> Config {
        let text = "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[ground]\nsource = \"external\"\n[subject]\nid = \
                    \"a\"\nheight_m = 1.7\n";
        Config::parse(text, "test").unwrap()
    }

    fn of(streamed: Option<Streamed>) -> Check {
        suit(&config(), &StationFacts { streamed, ..StationFacts::default() })
    }

    fn healthy() -> Streamed {
        Streamed { rate_hz: 60.0, quaternions: true, avatars: vec![0], ..Streamed::default() }
    }

    #[test]
    fn a_stream_is_evaluated_by_its_received_samples() {
        assert_eq!(of(Some(healthy())).verdict, Ok);
        assert_eq!(of(None).verdict, Warn);
        let occupied = StationFacts { suit_port: Port::InUse, ..StationFacts::default() };
        assert_eq!(suit(&config(), &occupied).verdict, Skipped);
        let slow = of(Some(Streamed { rate_hz: 30.0, ..healthy() }));
        assert!(slow.verdict == Warn && slow.fix.unwrap().contains("Stream rate"));
        let euler =
            of(Some(Streamed { quaternions: false, substitute: Some("Euler angles (01)"), ..healthy() }));
        assert!(euler.verdict == Warn && euler.fix.unwrap().contains("(02)"));
        let none = of(Some(Streamed { quaternions: false, ..healthy() }));
        assert!(none.verdict == Fail && none.fix.unwrap().contains("tick the box"));
        let other = of(Some(Streamed { avatars: vec![2], ..healthy() }));
        assert!(other.verdict == Fail && other.fix.unwrap().contains("suit.avatar = 2"));
        let refused = of(Some(Streamed { refused: vec![("length".to_owned(), 3)], ..healthy() }));
        assert!(refused.verdict == Warn && refused.found.contains("3 length"));
    }

    #[test]
    fn unavailable_quantities_of_a_plate_are_reported() {
        let ground = " (insoles; not measured: shear and free moment)".to_owned();
        let facts =
            StationFacts { daemon: Some(1), plate_force_n: Some(0.0), ground, ..StationFacts::default() };
        assert_eq!(
            plate(&config(), &facts).found,
            "empty, it shows 0.0 N (insoles; not measured: shear and free moment)"
        );
    }

    #[test]
    fn an_empty_plate_measures_zero_or_is_tared() {
        let of = |daemon, plate_force_n| -> Verdict {
            plate(&config(), &StationFacts { daemon, plate_force_n, ..StationFacts::default() }).verdict
        };
        assert_eq!(of(Some(7), Some(1.0)), Ok);
        assert_eq!(of(Some(7), Some(-30.0)), Warn);
        assert_eq!(of(Some(7), Some(706.0)), Skipped);
        assert_eq!(of(Some(7), None), Warn);
        assert_eq!(of(None, None), Skipped);
    }
}
