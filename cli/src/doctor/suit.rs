//! `equipoise doctor suit`: derives the required settings of MVN's Network Streamer from the data that arrive.

mod bus;
mod data_types;

use std::net::SocketAddr;

use equipoise_adapters::source::MvnTransport;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_adapters::suit::survey::{Character, Survey};
use equipoise_adapters::wire::mvn::DatagramType;
use equipoise_config::suit::Up;
use equipoise_config::{Config, SuitConfig};

use super::Check;
use super::ports::Port;
use super::suit_facts::{SuitFacts, SuitObservation};

/// Computing accelerations of a working person requires this sampling rate.
const RATE_MIN_HZ: f64 = 55.0;
/// A higher loss leaves gaps that disturb the accelerations.
const LOST_FRACTION_MAX: f64 = 0.01;
/// A reason is reported if it affects at least this fraction of all datagrams; every start causes a few.
const REFUSED_FRACTION_MIN: f64 = 0.01;

/// Diagnoses of a suit, in the order in which to fix them.
pub fn evaluate_suit(config: &Config, facts: &SuitFacts) -> Vec<Check> {
    let suit = &config.suit;
    let mut checks: Vec<Check> = port(config, facts).into_iter().collect();
    match &facts.observed {
        SuitObservation::Nothing(None) => {}
        SuitObservation::Nothing(Some(reason)) => {
            checks.push(Check::fail("listening", reason.clone(), "fix that, then run this again"));
        }
        SuitObservation::OnTheBus(observation) => {
            checks.extend(bus::evaluate(config, observation, facts.time));
        }
        SuitObservation::AtThePort(survey) if survey.is_silent() => {
            let found = format!("nothing was heard for {} s", facts.time.as_secs_f64());
            checks.push(Check::fail("sender", found, no_data_check(suit)));
        }
        SuitObservation::AtThePort(survey) => checks.extend(evaluate_survey(suit, survey, facts)),
    }
    checks
}

fn protocol(suit: &SuitConfig) -> &'static str {
    if suit.source.transport() == Some(MvnTransport::Tcp) { "TCP" } else { "UDP" }
}

fn port(config: &Config, facts: &SuitFacts) -> Option<Check> {
    const NAME: &str = "suit.listen";
    let suit = &config.suit;
    suit.source.transport()?;
    let place = format!("{} {}", protocol(suit), suit.listen);
    Some(match (facts.port, &facts.holder) {
        (Port::Free, _) => {
            Check::ok(NAME, format!("{place}, listened on for {} s", facts.time.as_secs_f64()))
        }
        (Port::OwnProcess, _) => {
            Check::ok(NAME, format!("{place} is held by station {}: it was asked instead", config.station))
        }
        (Port::AddressUnavailable, _) => Check::fail(
            NAME,
            format!("{} is no address of this computer", suit.listen.ip()),
            "`ip address` shows those it has; 0.0.0.0 is all of them",
        ),
        (Port::InUse, Some(holder)) => Check::fail(
            NAME,
            format!("{place} is taken by {} (process {})", holder.program, holder.process_id),
            "end it: only one program can listen there; or choose another port, here and in MVN",
        ),
        (Port::InUse, None) => Check::fail(
            NAME,
            format!("{place} is taken by a program of another user"),
            "`sudo ss -ulpn` and `sudo ss -tlpn` show which: end it, or choose another port, here and in MVN",
        ),
    })
}

/// The likely causes, most frequent first.
fn no_data_check(suit: &SuitConfig) -> String {
    let host = host_for(suit.listen);
    let mut advice = format!(
        "in MVN: Options > Network Streamer: Host = {host}, Port = {}, Protocol = {}, the box \"{}\" ticked, the stream \
         switched on, a recording or a live suit playing",
        suit.listen.port(),
        protocol(suit),
        data_types::POSE,
    );
    if suit.listen.ip().is_loopback() {
        advice.push_str(&format!(
            "; if MVN runs on another PC: suit.listen = \"0.0.0.0:{}\" (now only this PC is heard), suit.allow_remote = \
             true",
            suit.listen.port()
        ));
    } else {
        advice.push_str("; both PCs in one network, and no firewall that keeps the port shut");
    }
    if protocol(suit) == "TCP" {
        advice.push_str("; MVN connects when its stream is switched on: switch it off and on again");
    }
    advice
}

fn host_for(listen: SocketAddr) -> String {
    if listen.ip().is_unspecified() { "this computer's address".to_owned() } else { listen.ip().to_string() }
}

fn evaluate_survey(suit: &SuitConfig, survey: &Survey, facts: &SuitFacts) -> Vec<Check> {
    let seconds = facts.time.as_secs_f64().max(1e-3);
    let mut checks = vec![sender(suit, survey, seconds)];
    if survey.senders.is_empty() {
        return checks;
    }
    checks.extend(unreadable(survey));
    checks.push(characters(suit, survey));
    let Some(character) = survey.characters.get(&suit.avatar).filter(|one| !one.is_object()) else {
        return checks;
    };
    checks.extend(data_types::evaluate(character, seconds));
    checks.extend(samples(character));
    checks.extend(up(suit, character));
    checks.extend(props_and_gloves(character));
    let total = character.types.values().map(|stream| stream.datagrams).sum();
    checks.extend(refusals(character.refused().map(|(reason, count)| (reason.name(), count)), total));
    checks
}

fn sender(suit: &SuitConfig, survey: &Survey, seconds: f64) -> Check {
    const NAME: &str = "sender";
    let names = |counts: &std::collections::BTreeMap<std::net::IpAddr, u64>| -> String {
        counts.keys().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    };
    let away = names(&survey.turned_away);
    let allow = "suit.allow_remote = true, if that is the PC with MVN";
    if survey.senders.is_empty() {
        return Check::fail(NAME, format!("what {away} sends was turned away"), allow);
    }
    let datagrams: u64 = survey.senders.values().sum();
    let found = format!(
        "{}: {:.0} datagrams a second, {:.0} kB/s",
        names(&survey.senders),
        datagrams as f64 / seconds,
        survey.bytes as f64 / seconds / 1e3
    );
    if survey.senders.len() > 1 {
        let fix = "let all but one send elsewhere: the daemon keeps to one until it is silent for a second";
        return Check::warn(NAME, found, fix);
    }
    match survey.turned_away.is_empty() {
        true => Check::ok(NAME, found),
        false if suit.allow_remote => {
            Check::warn(NAME, format!("{found}; {away} was turned away"), "one at a time")
        }
        false => Check::warn(NAME, format!("{found}; what {away} sends was turned away"), allow),
    }
}

fn unreadable(survey: &Survey) -> Option<Check> {
    const NAME: &str = "readable";
    let datagrams: u64 = survey.senders.values().sum();
    let reasons = list_counts(survey.unreadable.iter().map(|(reason, count)| (*reason, *count)));
    if survey.characters.is_empty() {
        let fix = "another program sends to this port: end it, or choose another port, here and in MVN";
        return Some(Check::fail(NAME, format!("nothing that came is MVN's: {reasons}"), fix));
    }
    let bad: u64 = survey.unreadable.values().sum();
    let is_significant = bad as f64 > REFUSED_FRACTION_MIN * datagrams as f64;
    is_significant.then(|| {
        let fix = "does something else send to this port, or does the network cut datagrams (length)?";
        Check::warn(
            NAME,
            format!("{bad} of {datagrams} datagrams are not MVN's or are damaged: {reasons}"),
            fix,
        )
    })
}

fn characters(suit: &SuitConfig, survey: &Survey) -> Check {
    const NAME: &str = "characters";
    let names = |objects: bool| -> Vec<String> {
        let those = survey.characters.iter().filter(|(_, one)| one.is_object() == objects);
        those
            .map(|(avatar, one)| match one.name() {
                Some(name) => format!("{avatar} ({name})"),
                None => avatar.to_string(),
            })
            .collect()
    };
    let (people, objects) = (names(false), names(true));
    let mut found = if people.is_empty() { "no person".to_owned() } else { people.join(", ") };
    if !objects.is_empty() {
        found.push_str(&format!("; objects, which are not used: {}", objects.join(", ")));
    }
    let required: Vec<u8> =
        [suit.avatar].into_iter().chain(suit.forwarded.iter().map(|other| other.avatar)).collect();
    let is_present = |avatar: &u8| survey.characters.get(avatar).is_some_and(|one| !one.is_object());
    let first = survey.characters.iter().find(|(_, one)| !one.is_object());
    if let Some(missing) = required.iter().find(|avatar| !is_present(avatar)) {
        let key = if *missing == suit.avatar { "suit.avatar" } else { "suit.forwarded" };
        let fix = match first {
            Some((avatar, _)) if key == "suit.avatar" => {
                format!("suit.avatar = {avatar}, or another Avatar in the Network Streamer")
            }
            _ => "in MVN a stream sends one avatar: add one for it, with the same Host and Port".to_owned(),
        };
        return Check::fail(NAME, format!("{found}; {missing} ({key}) is not among them"), fix);
    }
    let unused: Vec<String> = survey
        .characters
        .iter()
        .filter(|(avatar, one)| !required.contains(avatar) && !one.is_object())
        .map(|(avatar, _)| avatar.to_string())
        .collect();
    if unused.is_empty() {
        return Check::ok(NAME, format!("{found}; {} is this station's", suit.avatar));
    }
    Check::warn(
        NAME,
        format!("{found}; {} belongs to no station", unused.join(", ")),
        "give each a station with suit.forwarded (docs/sensors/mvn.md), or do not send it",
    )
}

/// Checks rate, loss, and whether MVN is paused.
fn samples(character: &Character) -> Option<Check> {
    const NAME: &str = "samples";
    let (kind, stream) = character.pose()?;
    let mut found = format!("{:.1} a second", stream.rate_hz());
    if let (Some(rate_hz), Some(stride)) = (character.suit_rate_hz(), stream.stride()) {
        found.push_str(&format!(" of the suit's {rate_hz:.0}"));
        if stride > 1 {
            found.push_str(&format!(" (one of {stride} is sent)"));
        }
    }
    found.push_str(&format!(", {} lost, {} repeated", stream.lost, stream.repeated));
    if stream.repeated > stream.samples {
        return Some(Check::warn(
            NAME,
            format!("{found}: the same sample of type {kind} again and again"),
            "MVN is paused and \"Send Paused\" is on: go on with the suit or the recording. What is repeated is not used",
        ));
    }
    if stream.lost as f64 > LOST_FRACTION_MAX * (stream.samples + stream.lost) as f64 {
        return Some(Check::warn(
            NAME,
            found,
            "a cable instead of wireless, MVN 2024 or later (older ones drop datagrams themselves), Protocol TCP \
             (source = \"mvn-tcp\"), or fewer boxes",
        ));
    }
    if stream.samples > 1 && stream.rate_hz() < RATE_MIN_HZ {
        return Some(Check::warn(
            NAME,
            found,
            "raise the Stream rate in the Network Streamer: 60 Hz at the least",
        ));
    }
    Some(Check::ok(NAME, found))
}

fn up(suit: &SuitConfig, character: &Character) -> Option<Check> {
    const NAME: &str = "up axis";
    let [z, y, neither] = character.upright;
    let of = |axis: &str, other: u64| format!("{axis} points up in {} of {} poses", other, z + y + neither);
    if z + y + neither == 0 {
        return None;
    }
    Some(match (z >= y, suit.up_axis) {
        _ if z + y == 0 => Check::warn(
            NAME,
            "the body stands along no axis: head and pelvis are not above the feet",
            "let the worker stand; such poses are refused (upside_down)",
        ),
        (true, Up::Z) => Check::ok(NAME, of("Z", z)),
        (false, Up::Y) => Check::ok(NAME, format!("{}, as suit.up_axis says", of("Y", y))),
        (false, Up::Z) => Check::fail(
            NAME,
            format!("{}: all are refused (upside_down)", of("Y", y)),
            "suit.up_axis = \"y\", or let MVN send with Z up",
        ),
        (true, Up::Y) => Check::fail(
            NAME,
            format!("{}: all are refused (upside_down)", of("Z", z)),
            "suit.up_axis = \"z\", or without that line: MVN sends with Z up",
        ),
    })
}

fn props_and_gloves(character: &Character) -> Option<Check> {
    let layout = character.layout().filter(|layout| layout.props + layout.fingers > 0)?;
    Some(Check::ok(
        "props and gloves",
        format!(
            "{} props and {} finger segments come with the body; they are not used",
            layout.props, layout.fingers
        ),
    ))
}

/// Frequent refusal reasons, with advice for the first that has a remedy.
fn refusals<'a>(refused: impl Iterator<Item = (&'a str, u64)>, total: u64) -> Option<Check> {
    // Reported by other checks: other characters by name, duplicates with the samples.
    let reported_elsewhere = [SuitRefusal::OtherAvatar.name(), SuitRefusal::Duplicate.name()];
    let significant: Vec<(&str, u64)> = refused
        .filter(|(reason, count)| {
            *count as f64 > REFUSED_FRACTION_MIN * total as f64 && !reported_elsewhere.contains(reason)
        })
        .collect();
    let advice = |reason: &str| match reason {
        "upside_down" => Some("see \"up axis\""),
        "missing_segment" => Some("the character is no whole body: choose another suit.avatar"),
        "foreign_sender" => Some("suit.allow_remote = true, if that is the PC with MVN"),
        "no_pose" => Some("tick the box of the pose quaternion (02); if it is, datagrams are lost"),
        "unknown_type" => Some("harmless; take the tick off the box of a type that Equipoise does not know"),
        "length" | "items" | "content" => Some("datagrams are cut off, or MVN is older than 2018"),
        "late" => Some("datagrams of one sample are torn apart on their way: a cable instead of wireless"),
        _ => None,
    };
    let fix = significant
        .iter()
        .find_map(|(reason, _)| advice(reason))
        .unwrap_or("docs/sensors/mvn.md says what each means");
    (!significant.is_empty()).then(|| Check::warn("refused", list_counts(significant.into_iter()), fix))
}

fn list_counts<'a>(counts: impl Iterator<Item = (&'a str, u64)>) -> String {
    counts.map(|(reason, count)| format!("{count} {reason}")).collect::<Vec<_>>().join(", ")
}

/// The short name of a type with its number, used as title of a check.
fn title(kind: DatagramType) -> &'static str {
    data_types::DATA_TYPES.iter().find(|one| one.kind == kind).map_or("other types", |one| one.title)
}

#[cfg(test)]
mod tests;
