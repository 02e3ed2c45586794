//! `equipoise status`: prints the current state of a running daemon.

mod incidents;

use std::io::Write;
use std::time::{Duration, Instant};

use equipoise_adapters::ground::GroundRefusal;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_bus::{Bus, Participant};
use equipoise_config::Config;
use equipoise_config::model::suggestion;
use equipoise_config::model_file::Ask;
use equipoise_config::model_file::ModelFile;
use equipoise_core::message::{AdapterHealth, GroundSample, Incidents, State};
use equipoise_core::time::seconds;
use equipoise_daemon::realtime::now_ns;
use equipoise_station::status::{self, PageStatus, Status, ThreadStatus};
use equipoise_view::state_json::StateJson;
use equipoise_view::terminal::dashboard;
use equipoise_view::words;

use self::incidents::IncidentReport;
use super::{Outcome, StationArgument};
use crate::calibration::latency::{self, Latencies};
use crate::client;
use crate::page_feed::PAGE_ROLE;
use crate::provenance::Provenance;

/// Timeout for adapter health and incidents: the first ones are published a second after the start.
const HEALTH_TIMEOUT: Duration = Duration::from_millis(1200);

/// Width of the screen.
const COLUMNS: usize = 80;

/// Show the current state of a running daemon, on one screen
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise status --json | jq .state.phase")]
pub(super) struct Arguments {
    #[command(flatten)]
    station: StationArgument,
    /// Show details too: threads, memory, counts of the adapters, time alignment
    #[arg(long)]
    all: bool,
    /// As JSON, with all details
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let station = &arguments.station.station;
    let bus = client::join(station, "status")?;
    let mut health = bus.subscriber::<AdapterHealth>(8)?;
    let mut board = bus.subscriber::<Incidents>(1)?;
    let mut ground = bus.subscriber::<GroundSample>(1)?;
    let state = client::newest_state(&bus)?;
    let (mut adapters, started): (Vec<AdapterHealth>, _) = (Vec::new(), Instant::now());
    let mut incidents = None;
    while started.elapsed() < HEALTH_TIMEOUT && (adapters.len() < 2 || incidents.is_none()) {
        incidents = board.latest()?.or(incidents);
        while let Some(report) = health.receive()? {
            adapters.retain(|other| other.stream != report.stream);
            adapters.push(report);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    adapters.sort_by_key(|adapter| adapter.stream);
    let (facts, page) = (status::read(station), running_page(&bus));
    // The history holds the last sample of a plate that is silent now; its age reveals that.
    let ground = ground.latest()?.map(|sample| Provenance::of(&sample));
    let incidents = incidents.map(|incidents| {
        let sentences = facts.as_ref().map(|facts| facts.incidents.clone()).unwrap_or_default();
        IncidentReport::new(&incidents, &sentences, now_ns())
    });
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let state = serde_json::to_value(StateJson::new(&state, seconds(state.time_ns)))?;
        let adapters: Vec<_> = adapters.iter().map(adapter_json).collect();
        let text = serde_json::json!({
            "daemon": facts, "state": state, "adapters": adapters, "incidents": incidents, "page": page,
            "ground": ground
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&text)?)?;
    } else {
        let pose = suggestion(&state, requested_pose(facts.as_ref()).as_ref());
        write!(out, "{}", dashboard(&state, station, pose.as_deref()))?;
        writeln!(out, "  body    {}", words::body(&state))?;
        for adapter in &adapters {
            writeln!(out, "{}", adapter_line(adapter, arguments.all))?;
        }
        if let Some(ground) = ground.filter(|ground| arguments.all || !ground.is_one_plate()) {
            ground.write(&mut out)?;
        }
        if let Some(incidents) = &incidents {
            incidents.write(&mut out, arguments.all)?;
        }
        let skew = skew(&state, facts.as_ref().and_then(active_configuration).as_ref());
        if let Some((line, _)) = skew.filter(|(_, is_significant)| arguments.all || *is_significant) {
            writeln!(out, "  time    {line}")?;
        }
        if let Some(facts) = &facts {
            write_facts(&mut out, facts, arguments.all)?;
        }
        if let Some(page) = &page {
            let token = if page.needs_token { "; it needs its token" } else { "" };
            writeln!(out, "  page {}, process {}{token}", page.url, page.process_id)?;
        }
    }
    Ok(Outcome::Done)
}

/// Address of the station's page, if the process that published it is still on the bus.
fn running_page(bus: &Bus) -> Option<PageStatus> {
    let page = status::read_page(bus.station())?;
    let participants = bus.participants().ok()?;
    let serves = |one: &Participant| one.role == PAGE_ROLE && one.process_id == page.process_id;
    participants.iter().any(serves).then_some(page)
}

/// The pose requested by the daemon's model file, if any.
pub(super) fn requested_pose(facts: Option<&Status>) -> Option<Ask> {
    let text = &facts?.model_toml;
    ModelFile::parse(text, "the daemon's model").ok()?.ask
}

/// The configuration that the daemon runs with.
fn active_configuration(facts: &Status) -> Option<Config> {
    Config::parse(&facts.config_toml, "the daemon's configuration").ok()
}

/// Estimate of the skew between both streams with the setting that removes it, and whether it is significant; `None` until
/// there is an estimate.
fn skew(state: &State, config: Option<&Config>) -> Option<(String, bool)> {
    let (skew_ms, sigma_ms) = (1e3 * state.suit_skew_s, 1e3 * state.suit_skew_sigma_s);
    if sigma_ms <= 0.0 {
        return None;
    }
    let off_ms = skew_ms.abs().round();
    if skew_ms.abs() <= 2.0 * sigma_ms || off_ms < 1.0 {
        return Some((format!("suit and ground agree within {:.0} ms", (2.0 * sigma_ms).max(1.0)), false));
    }
    let relation = if skew_ms > 0.0 { "later" } else { "earlier" };
    let found = format!("suit {off_ms:.0} ± {sigma_ms:.0} ms {relation} than the ground");
    let Some(config) = config else {
        let table = if skew_ms > 0.0 { "suit" } else { "ground" };
        return Some((format!("{found}: add {off_ms:.0} to [{table}] latency_ms"), true));
    };
    let before = Latencies { suit_ms: config.suit.latency_ms, ground_ms: config.ground.latency_ms };
    let set = latency::advice(config, before, before.without_skew(skew_ms.signum() * off_ms))?;
    Some((format!("{found}: {set}"), true))
}

/// An adapter's name and the names of its reasons.
pub(super) fn reasons(adapter: &AdapterHealth) -> (&'static str, &'static [&'static str]) {
    match adapter.stream {
        1 => ("suit", SuitRefusal::NAMES),
        _ => ("ground", GroundRefusal::NAMES),
    }
}

pub(super) fn refused(adapter: &AdapterHealth) -> impl Iterator<Item = (&'static str, u64)> {
    let (_, names) = reasons(adapter);
    names.iter().copied().zip(adapter.refused).filter(|(_, count)| *count > 0)
}

fn adapter_json(adapter: &AdapterHealth) -> serde_json::Value {
    serde_json::json!({
        "stream": reasons(adapter).0,
        "process_id": adapter.process_id,
        "received": adapter.received,
        "published": adapter.published,
        "lost": adapter.lost,
        "rate_hz": adapter.rate_hz,
        "block_latency_ns": adapter.block_latency_ns,
        "refused": refused(adapter).collect::<std::collections::BTreeMap<_, _>>(),
    })
}

/// One line on an adapter; the counts of its refusals by reason if `all` is set or they fit into the screen's width.
fn adapter_line(adapter: &AdapterHealth, all: bool) -> String {
    let AdapterHealth { rate_hz, received, published, lost, .. } = adapter;
    let mut line = format!("  {:<7} {rate_hz:.0} Hz, ", reasons(adapter).0);
    if all {
        line += &format!("{received} received, ");
    }
    line += &format!("{published} published, {lost} lost");
    if adapter.block_latency_ns > 0 {
        line += &format!(", in blocks of {:.0} ms", adapter.block_latency_ns as f64 * 1e-6);
    }
    let by_reason: String = refused(adapter).map(|(reason, count)| format!(", {count} {reason}")).collect();
    if all || (line.len() + by_reason.len()) <= COLUMNS {
        return line + &by_reason;
    }
    let total: u64 = refused(adapter).map(|(_, count)| count).sum();
    format!("{line}, {total} refused (--all)")
}

fn write_thread(out: &mut impl Write, thread: &ThreadStatus) -> std::io::Result<()> {
    let ThreadStatus { thread: name, id, policy, granted_fifo, cpus, .. } = thread;
    let requested = match (thread.has_asked, thread.asked_fifo) {
        (false, _) => "nothing".to_owned(),
        (true, 0) => "other".to_owned(),
        (true, priority) => format!("fifo {priority}"),
    };
    let requested = thread.asked_cpu.map_or(requested.clone(), |cpu| format!("{requested} on core {cpu}"));
    let granted = if *granted_fifo > 0 { format!("fifo {granted_fifo}") } else { policy.clone() };
    write!(out, "  thread {name:<12} {id:>7}  asked {requested}, granted {granted}, cores {cpus:?}")?;
    if let Some(slack_ns) = thread.timer_slack_ns {
        write!(out, ", slack {slack_ns} ns")?;
    }
    writeln!(
        out,
        "; {} minor and {} major faults, lost its core {} times",
        thread.minor_faults, thread.major_faults, thread.involuntary_switches
    )
}

fn write_facts(out: &mut impl Write, facts: &Status, all: bool) -> std::io::Result<()> {
    if let Some(suspicion) = &facts.model_mismatch {
        writeln!(out, "  model   {suspicion}")?;
    }
    if let Some(reason) = &facts.weighing {
        writeln!(out, "  mass    {reason}")?;
    }
    if !all {
        return Ok(());
    }
    writeln!(out, "  version {}, process {}, memory {}", facts.version, facts.process_id, facts.memory_lock)?;
    let memory = facts.memory;
    // Locked memory counts every mapping, shared memory once for each; resident memory counts each page once.
    let locked = if memory.is_locked() { "all of it locked" } else { "not all of it locked" };
    writeln!(out, "  memory  {} KiB resident, {locked}", memory.resident_kib)?;
    for thread in &facts.threads {
        write_thread(out, thread)?;
    }
    if let Some([minor, major]) = facts.loop_faults {
        writeln!(out, "  loop    {minor} minor and {major} major page faults since its warm-up")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_are_summed_up_where_their_reasons_do_not_fit() {
        let mut adapter: AdapterHealth = bytemuck::Zeroable::zeroed();
        (adapter.stream, adapter.rate_hz, adapter.received, adapter.published) = (1, 60.0, 123, 120);
        adapter.refused[..2].copy_from_slice(&[2, 1]);
        let [first, second] = [0, 1].map(|index| SuitRefusal::NAMES[index]);
        let line = format!("  suit    60 Hz, 120 published, 0 lost, 2 {first}, 1 {second}");
        assert_eq!(adapter_line(&adapter, false), line);
        adapter.refused[..8].fill(1);
        assert_eq!(
            adapter_line(&adapter, false),
            "  suit    60 Hz, 120 published, 0 lost, 8 refused (--all)"
        );
        let all = adapter_line(&adapter, true);
        assert!(all.contains("123 received") && all.contains(&format!("1 {first}, 1 {second}")), "{all}");
    }

    #[test]
    fn a_skew_is_printed_with_the_setting_that_removes_it() {
        let advice = |skew_ms: f64, sigma_ms: f64, config: Option<&Config>| {
            let mut state: State = bytemuck::Zeroable::zeroed();
            (state.suit_skew_s, state.suit_skew_sigma_s) = (1e-3 * skew_ms, 1e-3 * sigma_ms);
            skew(&state, config).map(|(line, _)| line)
        };
        let config = |[suit_ms, ground_ms]: [f64; 2], suit: &str, more: &str| {
            let text = format!(
                "station = \"s\"\n[suit]\nsource = \"{suit}\"\nlatency_ms = {suit_ms:?}\n[ground]\nsource = \"ati-rdt\"\n\
                 latency_ms = {ground_ms:?}\n{more}[subject]\nid = \"a\"\nheight_m = 1.7\n"
            );
            Config::parse(&text, "the test's").unwrap()
        };
        let (plain, set) = (config([0.0, 0.0], "mvn-udp", ""), config([20.0, 1.5], "mvn-udp", ""));
        let (plain, set) = (Some(&plain), Some(&set));
        assert_eq!(advice(0.0, 0.0, plain), None, "the motion has not shown it");
        let message = "suit 12 ± 2 ms later than the ground: set [suit] latency_ms = 12";
        assert_eq!(advice(12.2, 2.1, plain).as_deref(), Some(message));
        assert!(
            advice(12.2, 2.1, set).unwrap().ends_with("later than the ground: set [suit] latency_ms = 32")
        );
        assert!(
            advice(-12.2, 2.1, set).unwrap().ends_with("earlier than the ground: set [suit] latency_ms = 8")
        );
        assert!(advice(-30.0, 2.1, set).unwrap().ends_with("set [ground] latency_ms = 31.5"));
        assert!(advice(-30.0, 2.1, None).unwrap().ends_with("add 30 to [ground] latency_ms"));
        let external = config([20.0, 1.5], "external", "");
        let message = "add 12 to [suit] latency_ms in the configurations of the suit adapter and the daemon, and \
                       restart both";
        assert!(advice(12.2, 2.1, Some(&external)).unwrap().ends_with(message));
        let two = config(
            [0.0, 1.5],
            "mvn-udp",
            "foot = \"left\"\n[ground.second]\nsource = \"ati-rdt\"\naddress = \"127.0.0.1:49153\"\nlatency_ms = 4.0\nfoot = \"right\"\n",
        );
        let message = "set [ground] latency_ms = 31.5 and [ground.second] latency_ms = 34";
        assert!(advice(-30.0, 2.1, Some(&two)).unwrap().ends_with(message));
        assert_eq!(advice(3.0, 2.0, plain).unwrap(), "suit and ground agree within 4 ms");
    }
}
