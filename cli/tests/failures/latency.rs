//! The end of the path: consumers that report, join, leave and send invalid receipts, as displayed by `equipoise
//! latency`.

use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusSettings, Publisher};
use equipoise_core::message::ConsumerReceipt;
use equipoise_latency::Stage;
use rustix::process::Signal;
use serde_json::Value;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{NAME, Station};

/// A consumer inside the test that receives states and reports receipts.
struct Consumer {
    monitor: Monitor,
    reports: Publisher<ConsumerReceipt>,
    report: Box<ConsumerReceipt>,
    // Field order: ports are dropped before the node they belong to.
    _bus: Bus,
}

impl Consumer {
    fn join(station: &Station, name: &str) -> Consumer {
        let settings = BusSettings { station: NAME.to_owned(), role: name.to_owned(), root: station.root() };
        let bus = Bus::join(&settings).expect("the bus");
        let mut report: Box<ConsumerReceipt> = Box::new(ConsumerReceipt::zeroed());
        report.consumer[..name.len()].copy_from_slice(name.as_bytes());
        (report.process_id, report.since_ns) = (std::process::id(), equipoise_daemon::realtime::now_ns());
        Consumer {
            monitor: Monitor::open(station),
            reports: bus.publisher().expect("a place"),
            report,
            _bus: bus,
        }
    }

    /// Reads the newest state once and reports.
    fn update(&mut self) {
        let before = self.monitor.state.cycle;
        let state = *self.monitor.update();
        let now_ns = equipoise_daemon::realtime::now_ns();
        if state.cycle > before {
            let missed = if before == 0 { 0 } else { state.cycle - before - 1 };
            self.report.enter(now_ns, &state, missed, None);
        }
        self.report.time_ns = now_ns;
        self.reports.send(&self.report).expect("the bus");
    }
}

fn row<'a>(report: &'a Value, name: &str) -> &'a Value {
    let consumers = report["consumers"].as_array().expect("consumers").iter();
    let rows = report["stages"].as_array().expect("stages").iter();
    let rows = rows.chain(consumers.flat_map(|one| one["stages"].as_array().expect("their stages")));
    let found = rows.filter(|row| row["stage"] == name).collect::<Vec<_>>();
    assert_eq!(found.len(), 1, "{name} in {report}");
    found[0]
}

#[test]
fn the_path_is_reported_to_the_last_consumer() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut controller = Consumer::join(&station, "controller-1");
    controller.monitor.until("both sensors", Monitor::both_fresh);
    // Its history before the measurement must not count.
    controller.report.published_to_consumer[400] = 1_000_000;
    controller.report.states = 1_000_000;
    let file = station.file("path.hlog").to_string_lossy().into_owned();
    let mut latency = station.spawn(&["latency", "--for", "3", "--json", "--hlog", &file]);
    let mut updates = 0;
    while latency.is_running() {
        controller.update();
        updates += 1;
        std::thread::sleep(Duration::from_millis(20));
    }
    let code = latency.wait().code();
    assert!(matches!(code, Some(0 | 3)), "{code:?} {}", latency.stderr());
    let report: Value = serde_json::from_str(&latency.stdout()).expect("JSON");

    // Every stage of the path has been measured, without missing stamps.
    for stage in Stage::ALL {
        let row = row(&report, stage.name());
        assert!(row["count"].as_u64() > Some(0), "{row}");
        assert_eq!(row["missing"], 0, "{row}");
    }
    for name in ["self.receipt", "self.from_due", "self.from_suit", "controller-1.receipt"] {
        let row = row(&report, name);
        assert!(row["count"].as_u64() > Some(0), "{row}");
        let percentiles = ["p50_ns", "p90_ns", "p99_ns", "p99_9_ns", "p99_99_ns", "max_ns"];
        let values: Vec<u64> = percentiles.iter().map(|key| row[key].as_u64().expect("ns")).collect();
        assert!(values.is_sorted(), "{row}");
    }
    let own = row(&report, "self.from_due")["p50_ns"].as_u64();
    assert!(own >= row(&report, "self.receipt")["p50_ns"].as_u64(), "a part is longer than its whole");
    let consumers = report["consumers"].as_array().expect("consumers");
    assert_eq!(consumers[0]["consumer"], "controller-1");
    assert_eq!(consumers[0]["process_id"], std::process::id());
    let states = consumers[0]["states"].as_u64().expect("a count");
    assert!(states > 0 && states <= updates, "{states} of {updates} looks");
    // 200 cycles a second, and one read each 20 ms.
    assert!(consumers[0]["states_missed"].as_u64() > Some(states), "{report}");

    let log = std::fs::read_to_string(&file).expect("the log");
    let tags = |name: &str| log.lines().filter(|line| line.starts_with(&format!("Tag={name},"))).count();
    for name in ["controller-1.receipt", "self.from_suit", "ground.ingress", "egress.publish"] {
        assert_eq!(tags(name), 1, "{name}");
    }
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
}

#[test]
fn a_measurement_without_receipts_reports_the_other_stages() {
    let station = Station::new();
    let _daemon = station.daemon(&station.configuration());
    // Two processes may read the reports.
    let mut readers = [0, 1].map(|_| station.spawn(&["latency", "--for", "600"]));
    let settings = BusSettings { station: NAME.to_owned(), role: "test".to_owned(), root: station.root() };
    let bus = Bus::join(&settings).expect("the bus");
    wait_for("both readers", || bus.subscriber::<ConsumerReceipt>(1).is_err().then_some(()));
    let ended = station.run(&["latency", "--for", "3"]);
    assert!(matches!(ended.code, Some(0 | 3)), "{}", ended.stderr);
    assert!(ended.stderr.contains("what consumers report is not shown"), "{}", ended.stderr);
    assert!(ended.stdout.contains("self.receipt"), "{}", ended.stdout);
    for reader in &mut readers {
        assert!(matches!(reader.stop(Signal::TERM), Some(0 | 3)), "{}", reader.stderr());
    }
}
