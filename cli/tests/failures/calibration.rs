//! Weighing, registering, stamping and taring, with the real commands on a running station.

use std::path::Path;
use std::time::Instant;

use equipoise_core::message::Validity;
use equipoise_daemon::realtime::now_ns;
use equipoise_simulator::intention::Intention;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::repertoire::LIFTING;
use equipoise_simulator::settings::SecondPlateSettings;
use equipoise_simulator::simulation::OnPlates;
use equipoise_simulator::walk::StandingPosition;
use serde_json::Value;

use crate::adapters::external;
use crate::monitor::Monitor;
use crate::process::{Process, TIMEOUT};
use crate::station::{NAME, Station, simulate};

/// Where the plate really stands.
const PLATE: Plate = Plate {
    origin_m: [0.06, -0.04, -0.05],
    yaw_rad: 0.4363,
    surface_height_m: 0.05,
    counts_per_unit: [1e6; 2],
};
/// The same in words.
const FRAME: &str = "origin_m = [0.06, -0.04, -0.05]\nyaw_deg = 25.0\nsurface_height_m = 0.05\n";

fn configuration(station: &Station, frame: &str) -> String {
    station.configuration().replace("[subject]\n", &format!("[ground.frame]\n{frame}[subject]\n"))
}

/// Does what a command asks for, line by line, until it has ended; its exit code, and what it printed as JSON.
#[track_caller]
fn execute(mut process: Process, mut act: impl FnMut(&str)) -> (Option<i32>, Value, String) {
    let (started, mut done) = (Instant::now(), 0);
    while process.is_running() {
        assert!(started.elapsed() < 3 * TIMEOUT, "it does not end: {}", process.stderr());
        let message = process.stderr();
        // Complete lines only.
        let whole = message.rfind('\n').map_or(0, |end| end + 1);
        for line in message[done.min(whole)..whole].lines() {
            act(line);
        }
        done = whole;
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let report = process.stdout();
    (process.wait().code(), serde_json::from_str(&report).unwrap_or(Value::Null), process.stderr())
}

fn number(report: &Value, pointer: &str) -> f64 {
    report.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("no {pointer} in {report}"))
}

/// Each of these with the sensors in the daemon, and with each sensor in a process of its own.
macro_rules! internal_and_separate_adapters {
    ($($name:ident)*) => {
        $(mod $name {
            use crate::station::Station;

            #[test]
            fn together() {
                super::$name(&Station::new());
            }

            #[test]
            fn separate_adapters() {
                super::$name(&Station::with_separate_adapters());
            }
        })*
    };
}

internal_and_separate_adapters! {
    a_known_mass_is_verified_at_several_positions_and_a_wrong_one_fails
    torques_are_verified_with_a_known_mass_in_the_hands_and_a_wrong_one_fails
    a_rod_measures_the_height_of_the_surface
    the_pose_of_a_misplaced_plate_is_estimated_and_corrected
    stomps_measure_the_delay_of_the_suit
    two_plates_are_tared_together_and_only_while_empty
}

fn a_known_mass_is_verified_at_several_positions_and_a_wrong_one_fails(station: &Station) {
    let mut settings = station.sensors();
    settings.plate.plate = PLATE;
    let person = simulate(&settings);
    person.put_on_plates(OnPlates::Nothing);
    let _daemon = station.daemon(&configuration(station, FRAME));
    let mut monitor = Monitor::open(station);
    monitor.until("both sensors", Monitor::both_fresh);

    // In the plate's own frame.
    let in_world = |[x, y]: [f64; 2]| {
        let (sine, cosine) = PLATE.yaw_rad.sin_cos();
        [PLATE.origin_m[0] + cosine * x - sine * y, PLATE.origin_m[1] + sine * x + cosine * y]
    };
    let mut arguments = vec!["verify", "--mass", "20", "--for", "1", "--json"];
    let places = ["0.2,0.15", "0.2,-0.15", "-0.2,0.1"];
    places.iter().for_each(|place| arguments.extend(["--at", place]));
    let (code, report, message) = execute(station.spawn(&arguments), |line| {
        if let Some((_, rest)) = line.split_once("put the 20 kg at ") {
            let place = rest.split_once(" m").expect("a place").0;
            let (x, y) = place.split_once(", ").expect("two numbers");
            let at_m = in_world([x, y].map(|metres| metres.parse().expect("a number")));
            person.put_on_plates(OnPlates::Mass { mass_kg: 20.1, at_m });
        } else if line.contains("lift it off") {
            person.put_on_plates(OnPlates::Nothing);
        }
    });
    assert_eq!(code, Some(0), "{message}");
    // Half a percent too high; gravity is the simulator's own.
    let gravity_percent = 100.0 * (9.81 / equipoise_core::GRAVITY_M_PER_S2 - 1.0);
    let measured = report["places"].as_array().expect("places");
    let sigma_percent =
        measured.iter().map(|place| 100.0 * number(place, "/mass_sigma_kg") / 20.0).fold(0.0, f64::max);
    let off_percent = (number(&report, "/worst_percent") - 0.5 - gravity_percent).abs();
    assert!(off_percent < 4.0 * sigma_percent, "{off_percent} {sigma_percent} {report}");
    assert_eq!(
        (report["within"].as_bool(), report["places"].as_array().map(Vec::len)),
        (Some(true), Some(3))
    );
    for place in report["places"].as_array().expect("places") {
        assert!(number(place, "/mass_sigma_kg") < 0.05 && number(place, "/cop_sigma_m/0") < 0.002, "{place}");
    }
    for scale in ["scale_x", "scale_y", "turned_rad"] {
        assert!(number(&report, &format!("/geometry/{scale}/value")).abs() < 0.02, "{report}");
    }
    assert!(number(&report, "/geometry/origin_x_m/value").abs() < 0.003, "{report}");

    // A kilogram more than declared; output in words.
    person.put_on_plates(OnPlates::Nothing);
    let process = station.spawn(&["verify", "--mass", "20", "--for", "1"]);
    let (code, _, message) = execute(process, |line| {
        if line.contains("put the 20 kg") {
            person.put_on_plates(OnPlates::Mass { mass_kg: 21.0, at_m: [0.0; 2] });
        }
    });
    assert_eq!(code, Some(1), "{message}");
    let percent = message
        .split_once("the plate is off by +")
        .and_then(|(_, rest)| rest.split_once(" %"))
        .expect("a figure");
    let percent: f64 = percent.0.parse().expect("a number");
    assert!(
        (percent - 5.0 - 1.05 * gravity_percent).abs() < 0.2 && message.contains("counts or units"),
        "{message}"
    );
}

fn torques_are_verified_with_a_known_mass_in_the_hands_and_a_wrong_one_fails(station: &Station) {
    let person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(station);
    monitor.until_poses(&person, 6);
    station.run(&["identify", "stop"]).assert_done();
    monitor.until("the monitoring", |monitor| monitor.state.phase_name() == "monitoring");
    let postures = [&LIFTING[1], &LIFTING[2]];
    // A body leans back under the load: markings are below the point where it is held.
    let marks = postures.map(|posture| {
        person.intend(posture, 0.5);
        person.lift(10.0);
        std::thread::sleep(std::time::Duration::from_millis(2500));
        let load_m = person.truth().load_m;
        person.put_down();
        format!("{:.4},{:.4}", load_m.x, load_m.y)
    });
    let lift = |posture: &Intention| {
        person.intend(posture, 0.5);
        person.lift(10.0);
    };
    let mut holding = None;
    let mut act = |line: &str| {
        if let Some((number, _)) = line.split_once(" of ")
            && line.contains("with both hands")
        {
            let posture = postures[number.parse::<usize>().expect("a number") - 1];
            lift(holding.insert(posture));
        } else if line.contains("put it down") {
            person.put_down();
            holding = None;
        } else if line.contains("clock_unsynchronised") {
            // As the incident says: by motion without a load the latency between the streams is measured again.
            person.put_down();
            for posture in [&LIFTING[0], &Intention::STAND].repeat(6) {
                person.intend(posture, 0.8);
                std::thread::sleep(std::time::Duration::from_millis(900));
            }
            holding.iter().for_each(|posture| lift(posture));
        }
    };
    let command = ["verify", "load", "--for", "2", "--json", "--at", &marks[0]];
    let (code, result, message) =
        execute(station.spawn(&[&command[..], &["--at", &marks[1], "--mass", "10"]].concat()), &mut act);
    assert_eq!(code, Some(0), "{message} {result}");
    for trial in 0..2 {
        let of = |pointer: &str| number(&result, &format!("/trials/{trial}/{pointer}"));
        assert!((of("mass_kg") - 10.0).abs() < 3.0 * of("mass_sigma_kg"), "{result}");
        let [expected_nm, error_nm] =
            ["expected_nm", "error_nm"].map(|key| of(&format!("torques/L5S1/{key}")));
        assert!(expected_nm > 20.0 && error_nm.abs() < 0.25 * expected_nm, "{result}");
    }
    let [near_nm, far_nm] =
        [0, 1].map(|trial| number(&result, &format!("/trials/{trial}/torques/shoulders/expected_nm")));
    assert!(far_nm > 1.3 * near_nm, "{result}");
    let stored = std::fs::read_to_string(station.state_directory().join("subjects/anon-1.load-checks.jsonl"))
        .expect("a file");
    let lines: Vec<Value> = stored.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines, [result]);

    person.put_down();
    let (code, _, message) = execute(station.spawn(&[&command[..], &["--mass", "14"]].concat()), &mut act);
    assert!(code == Some(1) && message.contains("sigma: check the plate"), "{code:?} {message}");
}

fn a_rod_measures_the_height_of_the_surface(station: &Station) {
    let mut settings = station.sensors();
    settings.plate.plate = PLATE;
    let person = simulate(&settings);
    person.put_on_plates(OnPlates::Nothing);
    // The surface was configured without its mat.
    let low = FRAME.replace("surface_height_m = 0.05", "surface_height_m = 0.038");
    let _daemon = station.daemon(&configuration(station, &low));
    let mut monitor = Monitor::open(station);
    monitor.until("both sensors", Monitor::both_fresh);
    let (code, report, message) =
        execute(station.spawn(&["verify", "--rod", "--for", "4", "--json"]), |line| {
            if line.contains("press the rod") {
                person.put_on_plates(OnPlates::Rod { press_n: 300.0, lean_n: 60.0, at_m: [0.1, 0.05] });
            }
        });
    assert_eq!(code, Some(0), "{message}");
    let deviation_m = number(&report, "/higher_m") - 0.012;
    assert!(
        deviation_m.abs() < 4.0 * number(&report, "/tip_sigma_m/2") && deviation_m.abs() < 0.003,
        "{report}"
    );
}

fn the_pose_of_a_misplaced_plate_is_estimated_and_corrected(station: &Station) {
    let mut settings = station.sensors();
    settings.plate.plate = PLATE;
    let person = simulate(&settings);
    let wrong = configuration(station, "origin_m = [0.0, 0.0, -0.05] # by eye\nsurface_height_m = 0.05\n");
    let path = station.write("wrong.toml", &wrong).display().to_string();
    let mut daemon = station.daemon_of("wrong.toml", &[]);
    let mut monitor = Monitor::open(station);
    monitor.until("both sensors", |monitor| monitor.both_fresh() && monitor.state.static_pose == 1);
    let corners_m = [[0.095, 0.095], [0.095, -0.095], [-0.095, -0.095], [-0.095, 0.095]];
    let mut next_m = corners_m.iter();
    let process = station.spawn(&["register", "--places", "5", "--json", "--write", &path]);
    // The worker walks on once a place was taken, however long that took.
    let walk = |line: &str| {
        if line.contains("got it")
            && let Some([x, y]) = next_m.next()
        {
            person.go(2.5, StandingPosition { middle_m: [*x, *y].into(), heading_rad: 0.0 });
        }
    };
    let (code, report, message) = execute(process, walk);
    assert_eq!(code, Some(0), "{message}");
    assert_eq!(message.matches("got it").count(), 5, "{message}");
    println!("{report:#}");
    let frame = &report["frames"]["ground.frame"];
    let (yaw_deg, sigma_deg) = (number(frame, "/yaw_deg"), number(frame, "/yaw_sigma_deg"));
    assert!(sigma_deg < 6.0 && (yaw_deg - 25.0).abs() < 3.0 * sigma_deg, "{yaw_deg} ± {sigma_deg}");
    for axis in 0..2 {
        let (at_m, sigma_m) =
            (number(frame, &format!("/origin_m/{axis}")), number(frame, &format!("/origin_sigma_m/{axis}")));
        // The suit has drifted since it was put on, and the loop's world with it: this is no error of the plate.
        let wandered_m = 0.06;
        assert!((at_m - PLATE.origin_m[axis]).abs() < 3.0 * sigma_m + wandered_m, "{at_m} ± {sigma_m}");
    }

    // The daemon accepts the written file, with all comments kept.
    let written = std::fs::read_to_string(Path::new(&path)).expect("the configuration");
    assert!(written.contains("# by eye") && written.contains("yaw_deg = "), "{written}");
    assert_eq!(daemon.stop(rustix::process::Signal::TERM), Some(0));
    let stopped_ns = now_ns();
    let _daemon = station.daemon_of("wrong.toml", &[]);
    let state = monitor.until("a static person in the new daemon", |monitor| {
        let is_measured = monitor.both_fresh() && !monitor.has(Validity::INVALIDATES_COP_MEASURED);
        monitor.state.time_ns > stopped_ns && is_measured && monitor.state.static_pose == 1
    });
    let truth = person.truth_at((state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9);
    // Relative to the feet, since the suit drifts.
    let feet = [17, 21].map(|foot| [0, 1].map(|axis| state.segment_origin_m[foot][axis]));
    let middle = [0, 1].map(|axis| 0.5 * (feet[0][axis] + feet[1][axis]));
    let true_feet = [17, 21].map(|foot| truth.body.origin_m[foot].xy());
    let true_middle = (true_feet[0] + true_feet[1]) * 0.5;
    for axis in 0..2 {
        let (measured_m, true_m) =
            (state.cop_measured_m[axis] - middle[axis], truth.cop_m[axis] - true_middle[axis]);
        assert!((measured_m - true_m).abs() < 0.05, "{axis}: {measured_m} {true_m}");
    }
}

fn stomps_measure_the_delay_of_the_suit(station: &Station) {
    let mut settings = station.sensors();
    settings.suit.latency_s = 0.045;
    let person = simulate(&settings);
    let path = station.write("late.toml", &station.configuration()).display().to_string();
    let _daemon = station.daemon_of("late.toml", &[]);
    let mut monitor = Monitor::open(station);
    monitor.until("both sensors", Monitor::both_fresh);
    station.run(&["stomp", "--for", "2"]).assert_failed(1, &["the plate measured no stomp"]);
    let process = station.spawn(&["stomp", "--stomps", "3", "--json", "--write", &path]);
    let (code, report, message) = execute(process, |line| {
        if line.starts_with("stand on the plate") {
            person.stomp(5);
        }
    });
    assert_eq!(code, Some(0), "{message}");
    // A delayed command counts several stomps at once.
    let counted = message.lines().filter_map(|line| line.strip_prefix("stomp ")?.strip_suffix(" of 3"));
    assert!(counted.filter_map(|count| count.parse::<usize>().ok()).any(|count| count >= 3), "{message}");
    let (later_ms, sigma_ms) = (number(&report, "/suit_later_ms"), number(&report, "/sigma_ms"));
    println!("45 ms later: found {later_ms:.1} ± {sigma_ms:.1} ms");
    assert!(sigma_ms < 12.0 && (later_ms - 45.0).abs() < 3.0 * sigma_ms, "{report}");
    let written: toml::Table =
        std::fs::read_to_string(&path).expect("the configuration").parse().expect("TOML");
    assert_eq!(written["suit"]["latency_ms"].as_float(), Some(later_ms.round()));
}

fn two_plates_are_tared_together_and_only_while_empty(station: &Station) {
    let second = free_address().expect("a free port");
    let mut settings = station.sensors();
    let plate = Plate { origin_m: [0.0, -0.2, 0.0], ..Plate::default() };
    settings.second_plate =
        Some(SecondPlateSettings { address: second, rate_hz: 200.0, plate, press_m: [[0.0; 2]; 2] });
    let person = simulate(&settings);
    let both = format!(
        "foot = \"left\"\n[ground.second]\nsource = \"ati-rdt\"\naddress = \"{second}\"\ncounts_per_newton = \
         1e6\ncounts_per_newton_metre = 1e6\nfoot = \"right\"\n[ground.second.frame]\norigin_m = [0.0, -0.2, 0.0]\n[subject]\n"
    );
    let _daemon = station.daemon(&station.configuration().replace("[subject]\n", &both));
    let mut monitor = Monitor::open(station);
    monitor.until("the person", |monitor| monitor.both_fresh() && monitor.state.ground_force_n[2] > 600.0);
    let refusal = "N stand on the plate; step off";
    let tare = station.run_until(refusal, &["tare"], |ended| ended.stderr.contains(refusal));
    tare.assert_failed(1, &[refusal]);
    monitor.until("the person as before", |monitor| monitor.state.ground_force_n[2] > 600.0);

    // A box of 3 kg stays on the first plate.
    person.put_on_plates(OnPlates::Mass { mass_kg: 3.0, at_m: [0.05, 0.2] });
    let is = |newtons: f64| {
        move |monitor: &Monitor| {
            monitor.both_fresh() && (monitor.state.ground_force_n[2] - newtons).abs() < 2.5
        }
    };
    monitor.until("the box alone", is(3.0 * 9.81));
    // Just after stepping off, the averaging window for the zero still contains the person.
    monitor.until_tared(station, 2.5);
    person.put_on_plates(OnPlates::Nothing);
    monitor.until("less than zero", is(-3.0 * 9.81));
}

#[test]
fn positions_on_a_plate_of_another_process_are_refused_before_the_measurement() {
    let station = Station::new();
    let _daemon = station.daemon(&external(&station));
    let verify = station.run(&["verify", "--mass", "20", "--at", "0.1,0.1", "--within", "5"]);
    verify.assert_failed(1, &["the plate is read by another process, whose own file holds [ground.frame]"]);
    assert!(!verify.stderr.contains("leave the plate empty"), "{}", verify.stderr);
}

#[test]
fn the_file_of_another_station_is_refused_before_the_measurement() {
    let station = Station::new();
    let text = station.configuration();
    let _daemon = station.daemon(&text);
    let other = text.replace(&format!("station = \"{NAME}\""), "station = \"press-2\"");
    let moved = text.replace("[subject]\n", "[ground.frame]\nyaw_deg = 3.0\n[subject]\n");
    let late = text.replace("[suit]\n", "[suit]\nlatency_ms = 20.0\n");
    for (command, text, part) in [
        ("register", &other, "is the configuration of station press-2, but station bench is measured"),
        ("stomp", &other, "is the configuration of station press-2, but station bench is measured"),
        ("register", &moved, "ground.frame.yaw_deg differs"),
        ("stomp", &late, "suit.latency_ms differs"),
    ] {
        let path = station.write("other.toml", text).display().to_string();
        let refused = station.run(&[command, "--write", &path]);
        refused.assert_failed(1, &[part]);
        assert!(!refused.stderr.contains("stand "), "{}", refused.stderr);
        assert_eq!(std::fs::read_to_string(&path).expect("the file"), *text);
    }
}
