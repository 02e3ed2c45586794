//! Metric families and their names: seconds and metres, `_total` for counters.

use std::fmt;

use equipoise_core::body::{JOINTS, Joint};
use equipoise_core::message::state::Phase;
use equipoise_core::message::{AdapterHealth, CycleRecord, Incident, Incidents, State, Validity};
use equipoise_core::time::{NS_PER_S, seconds};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::{Registry, Unit};

use crate::is_current;
use crate::state_json::level_name;

/// A state or cycle record older than this is not current: its values are left out.
const OLD_NS: u64 = NS_PER_S;
/// The same for adapter health and incidents, which are published once a second.
const OLD_REPORT_NS: u64 = 5 * NS_PER_S / 2;
/// Number of levels of a joint, `Level::None` included.
const LEVELS: usize = 6;

/// Number of cycles per joint and level.
pub type JointCycles = [[u64; LEVELS]; JOINTS];

/// Health of one stream's adapter, and the names of its refusal reasons.
#[derive(Debug, Clone)]
pub struct Stream {
    /// `suit` or `ground`.
    pub name: &'static str,
    /// Newest health message of the adapter.
    pub health: Option<AdapterHealth>,
    /// Names of the refusal reasons, in order.
    pub reasons: &'static [&'static str],
}

/// Input of a scrape.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Now, CLOCK_MONOTONIC.
    pub now_ns: u64,
    /// The station.
    pub station: String,
    /// Version of the program.
    pub version: &'static str,
    /// The newest state.
    pub state: Option<State>,
    /// The newest cycle record.
    pub record: Option<CycleRecord>,
    /// Suit and ground.
    pub streams: [Stream; 2],
    /// The incidents.
    pub incidents: Option<Incidents>,
    /// Levels counted since the start.
    pub joint_cycles: JointCycles,
}

/// The whole response in OpenMetrics format.
pub(super) fn open_metrics(snapshot: &Snapshot) -> Result<String, fmt::Error> {
    let station = ("station".into(), snapshot.station.clone().into());
    let mut registry = Registry::with_prefix_and_labels("equipoise", [station].into_iter());
    registry.register_collector(Box::new(snapshot.clone()));
    let mut answer = String::new();
    text::encode(&mut answer, &registry)?;
    Ok(answer)
}

/// One sample of a family: labels and value.
type Sample<'a, T, const N: usize> = ([(&'static str, &'a str); N], T);

/// Writes metric families, leaving out those without samples.
struct Families<'a>(DescriptorEncoder<'a>);

impl Families<'_> {
    fn counters<const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        samples: &[Sample<'_, u64, N>],
    ) -> fmt::Result {
        if samples.is_empty() {
            return Ok(());
        }
        let mut family = self.0.encode_descriptor(name, help, None, MetricType::Counter)?;
        for (labels, value) in samples {
            let none = None::<&prometheus_client::metrics::exemplar::Exemplar<[(&str, &str); 0], u64>>;
            match N {
                0 => family.encode_counter(value, none)?,
                _ => family.encode_family(labels)?.encode_counter(value, none)?,
            }
        }
        Ok(())
    }

    fn counter(&mut self, name: &str, help: &str, value: Option<u64>) -> fmt::Result {
        self.counters(name, help, value.map(|value| ([], value)).as_slice())
    }

    fn gauges<const N: usize>(
        &mut self,
        (name, unit): (&str, Option<Unit>),
        help: &str,
        samples: &[Sample<'_, f64, N>],
    ) -> fmt::Result {
        if samples.is_empty() {
            return Ok(());
        }
        let mut family = self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Gauge)?;
        for (labels, value) in samples {
            match N {
                0 => family.encode_gauge(value)?,
                _ => family.encode_family(labels)?.encode_gauge(value)?,
            }
        }
        Ok(())
    }

    fn gauge(&mut self, name: (&str, Option<Unit>), help: &str, value: Option<f64>) -> fmt::Result {
        self.gauges(name, help, value.map(|value| ([], value)).as_slice())
    }
}

impl Collector for Snapshot {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let build = [("version", self.version)];
        encoder
            .encode_descriptor("build", "Version of the program", None, MetricType::Info)?
            .encode_info(&build)?;
        let mut families = Families(encoder);
        self.cycles(&mut families)?;
        self.adapters(&mut families)?;
        self.incidents(&mut families)?;
        self.now(&mut families)?;
        self.joints(&mut families)
    }
}

impl Snapshot {
    fn cycles(&self, families: &mut Families<'_>) -> fmt::Result {
        let of = |count: fn(&CycleRecord) -> u64| self.record.as_ref().map(count);
        families.counter("cycles", "Cycles begun", of(|record| record.cycle))?;
        let help = "Slots of the schedule that passed without a cycle";
        families.counter("slots_skipped", help, of(|record| record.slots_skipped))?;
        let help = "Cycles whose state was ready only after the next was due";
        families.counter("deadlines_missed", help, of(|record| record.deadlines_missed))?;
        let help = "Samples lost because the ring before the loop was full";
        families.counter("input_samples_dropped", help, of(|record| record.input_dropped))?;
        let help = "Samples the loop refused: not plausible, or their time did not advance";
        families.counter("input_samples_refused", help, of(|record| record.input_refused))?;
        let help = "States lost because the ring behind the loop was full";
        families.counter("output_states_dropped", help, of(|record| record.output_dropped))?;
        let current = self.record.filter(|record| is_current(record.due_ns, self.now_ns, OLD_NS));
        let period_s = current.map(|record| seconds(record.period_ns));
        families.gauge(("cycle_period", Some(Unit::Seconds)), "Length of one cycle", period_s)
    }

    fn adapters(&self, families: &mut Families<'_>) -> fmt::Result {
        let reporting = || self.streams.iter().filter_map(|stream| Some((stream, stream.health?)));
        let of = |count: fn(&AdapterHealth) -> u64| -> Vec<_> {
            reporting().map(|(stream, health)| ([("stream", stream.name)], count(&health))).collect()
        };
        let help = "Datagrams or records that an adapter took from the wire since it was started";
        families.counters("adapter_received", help, &of(|health| health.received))?;
        let help = "Samples that an adapter published since it was started";
        families.counters("adapter_samples_published", help, &of(|health| health.published))?;
        let help = "Samples that the device sent and the adapter never saw";
        families.counters("adapter_samples_lost", help, &of(|health| health.lost))?;
        let refused: Vec<_> = reporting()
            .flat_map(|(stream, health)| {
                stream
                    .reasons
                    .iter()
                    .zip(health.refused)
                    .map(move |(reason, count)| ([("stream", stream.name), ("reason", *reason)], count))
            })
            .collect();
        families.counters("adapter_refused", "What an adapter refused, by reason", &refused)?;
        let current =
            || reporting().filter(|(_, health)| is_current(health.time_ns, self.now_ns, OLD_REPORT_NS));
        let rates: Vec<_> =
            current().map(|(stream, health)| ([("stream", stream.name)], health.rate_hz)).collect();
        let unit = Unit::Other("hertz".to_owned());
        families.gauges(("adapter_rate", Some(unit)), "Samples a second over the last second", &rates)?;
        let blocks: Vec<_> = current()
            .filter(|(_, health)| health.block_latency_ns > 0)
            .map(|(stream, health)| ([("stream", stream.name)], seconds(health.block_latency_ns)))
            .collect();
        let help =
            "How long a device gathers samples before it sends them; absent if it sends each by itself";
        families.gauges(("adapter_block_latency", Some(Unit::Seconds)), help, &blocks)
    }

    fn incidents(&self, families: &mut Families<'_>) -> fmt::Result {
        let Some(board) = &self.incidents else { return Ok(()) };
        let kinds = || Incident::ALL.iter().copied();
        let begun: Vec<_> =
            kinds().map(|kind| ([("incident", kind.name())], board.begun[kind as usize])).collect();
        families.counters("incidents", "How often each kind of incident has begun", &begun)?;
        if !is_current(board.time_ns, self.now_ns, OLD_REPORT_NS) {
            return Ok(());
        }
        let is_active = |kind: Incident| f64::from(u8::from(board.active & (1 << kind as u32) != 0));
        let active: Vec<_> = kinds().map(|kind| ([("incident", kind.name())], is_active(kind))).collect();
        families.gauges(("incident_active", None), "1 while an incident goes on", &active)
    }

    /// Metrics of the newest state; if it is old, only that it is.
    fn now(&self, families: &mut Families<'_>) -> fmt::Result {
        let fresh = self.state.filter(|state| is_current(state.time_ns, self.now_ns, OLD_NS));
        let is_fresh = f64::from(u8::from(fresh.is_some()));
        let help = "1 while states are published; else their values are left out";
        families.gauge(("publishing", None), help, Some(is_fresh))?;
        let Some(state) = fresh else { return Ok(()) };
        let ages: Vec<_> = [("suit", state.suit_age_ns), ("ground", state.ground_age_ns)]
            .into_iter()
            .filter(|(_, age_ns)| *age_ns < u64::MAX)
            .map(|(stream, age_ns)| ([("stream", stream)], seconds(age_ns)))
            .collect();
        families.gauges(("sample_age", Some(Unit::Seconds)), "Age of the newest sample in use", &ages)?;
        let phases: Vec<_> = (0..)
            .map_while(Phase::from_number)
            .map(|phase| ([("phase", phase.name())], f64::from(u8::from(state.phase == phase as u32))))
            .collect();
        families.gauges(("phase", None), "1 for the phase the pipeline is in", &phases)?;
        let withheld: Vec<_> = Validity::NAMES
            .iter()
            .map(|(reason, name)| {
                ([("reason", *name)], f64::from(u8::from(Validity(state.valid).any_of(*reason))))
            })
            .collect();
        let help = "1 while a reason holds why some values must not be used";
        families.gauges(("withheld", None), help, &withheld)?;
        families.gauge(
            ("poses_used", None),
            "Held poses that were learnt",
            Some(f64::from(state.poses_used)),
        )?;
        let sigma_m = Some(state.predicted_cop_sigma_m).filter(|sigma_m| *sigma_m > 0.0);
        let help = "Standard deviation of the predicted centre of pressure over the poses of the library";
        families.gauge(("predicted_cop_sigma", Some(Unit::Meters)), help, sigma_m)
    }

    fn joints(&self, families: &mut Families<'_>) -> fmt::Result {
        let mut samples = Vec::new();
        for (joint, levels) in Joint::ALL.iter().zip(&self.joint_cycles) {
            for (number, count) in levels.iter().enumerate() {
                samples.push(([("joint", joint.name()), ("level", level_name(number as u32))], *count));
            }
        }
        let help = "Cycles per joint and overload level; `none`: not evaluated";
        families.counters("joint_level_cycles", help, &samples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn snapshot() -> Snapshot {
        let stream = |name| Stream { name, health: None, reasons: &["length"] };
        Snapshot {
            now_ns: 10 * NS_PER_S,
            station: "bench".to_owned(),
            version: "1.2.3",
            state: None,
            record: None,
            streams: [stream("suit"), stream("ground")],
            incidents: None,
            joint_cycles: [[0; LEVELS]; JOINTS],
        }
    }

    #[test]
    fn a_family_of_which_nothing_is_known_is_left_out() {
        let text = open_metrics(&snapshot()).unwrap();
        assert!(text.contains("equipoise_build_info{station=\"bench\",version=\"1.2.3\"} 1\n"), "{text}");
        assert!(text.contains("equipoise_publishing{station=\"bench\"} 0"), "{text}");
        for absent in ["cycles", "adapter", "incident", "phase", "sample_age"] {
            assert!(!text.contains(&format!("equipoise_{absent}")), "{absent}: {text}");
        }
    }

    #[test]
    fn counts_have_totals_and_units_stand_last() {
        let mut known = snapshot();
        let mut board = Incidents { time_ns: known.now_ns, ..Incidents::zeroed() };
        board.begun[Incident::GroundSilent as usize] = 4;
        board.active = 1 << Incident::GroundSilent as u32;
        known.incidents = Some(board);
        let due_ns = known.now_ns;
        known.record = Some(CycleRecord { cycle: 77, period_ns: 1_000_000, due_ns, ..CycleRecord::zeroed() });
        let mut health = AdapterHealth { received: 9, time_ns: known.now_ns, ..AdapterHealth::zeroed() };
        health.refused[0] = 2;
        health.block_latency_ns = 40_000_000;
        known.streams[0].health = Some(health);
        let mut state = State { time_ns: known.now_ns, suit_age_ns: 5_000_000, ..State::zeroed() };
        (state.ground_age_ns, state.phase, state.predicted_cop_sigma_m) = (u64::MAX, 2, 0.004);
        known.state = Some(state);
        known.joint_cycles[0][3] = 6;
        let text = open_metrics(&known).unwrap();
        let document = include_str!("../../../docs/operation.md");
        let plain = super::super::plain::of_open_metrics(&text);
        for name in plain.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()) {
            assert!(document.contains(&format!("`{name}`")), "docs/operation.md lacks {name}");
        }
        for line in [
            "equipoise_cycles_total{station=\"bench\"} 77",
            "equipoise_cycle_period_seconds{station=\"bench\"} 0.001",
            "equipoise_adapter_refused_total{station=\"bench\",stream=\"suit\",reason=\"length\"} 2",
            "equipoise_adapter_block_latency_seconds{station=\"bench\",stream=\"suit\"} 0.04",
            "equipoise_incidents_total{station=\"bench\",incident=\"ground_silent\"} 4",
            "equipoise_incident_active{station=\"bench\",incident=\"ground_silent\"} 1.0",
            "equipoise_sample_age_seconds{station=\"bench\",stream=\"suit\"} 0.005",
            "equipoise_phase{station=\"bench\",phase=\"monitoring\"} 1.0",
        ] {
            assert!(text.lines().any(|reporting| reporting == line), "{line}\n{text}");
        }
        assert!(text.contains("level=\"red\"} 6\n"), "{text}");
        assert!(!text.contains("stream=\"ground\""), "nothing is known of it: {text}");

        // Counters are served for old messages, values are not.
        let check = |now_ns: u64, values: &[(&str, bool)]| {
            let text = open_metrics(&Snapshot { now_ns, ..known.clone() }).unwrap();
            assert!(text.contains("equipoise_publishing{station=\"bench\"} 0"), "{text}");
            assert!(text.contains("cycles_total") && text.contains("incidents_total"), "{text}");
            for (name, served) in values {
                assert_eq!(text.contains(name), *served, "{name}: {text}");
            }
        };
        let values = ["sample_age", "cycle_period", "incident_active", "block_latency", "adapter_rate"];
        let served = |served: [bool; 5]| std::array::from_fn::<_, 5, _>(|i| (values[i], served[i]));
        check(due_ns + 2 * NS_PER_S, &served([false, false, true, true, true]));
        check(due_ns + 3 * NS_PER_S, &served([false; 5]));
        // The clock of another time namespace.
        check(due_ns - 1, &served([false; 5]));
    }
}
