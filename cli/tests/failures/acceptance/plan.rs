//! `plan handover`: the map of a stored subject, and what is refused.

use equipoise_simulator::simulation::SimulationHandle;
use serde_json::Value;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{Output, Station};

/// `plan handover` of a part of 6 kg.
struct Plan<'a> {
    station: &'a Station,
    /// Path of the configuration.
    config: String,
}

impl Plan<'_> {
    fn run(&self, more: &[&str]) -> Output {
        self.station.run(&[&["plan", "handover", "--config", &self.config, "--mass", "6"], more].concat())
    }

    /// For a second after the change of the model there is no plan, nor while the suit's or the plate's data are late.
    fn live(&self, more: &[&str]) -> String {
        wait_for("a plan", || {
            let output = self.run(&[&["--live"], more].concat());
            (output.code == Some(0)).then_some(output.stdout)
        })
    }

    fn wait_for_profile(&self, what: &str, condition: impl Fn(&str) -> bool) {
        wait_for(what, || {
            let text = std::fs::read_to_string(self.station.profile("anon-1")).ok()?;
            condition(&text).then_some(())
        });
    }
}

#[test]
fn the_best_place_of_an_identified_worker_is_printed_and_others_are_refused() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    wait_for("a profile", || station.profile("anon-1").exists().then_some(()));
    let config = station.write("plan.toml", &station.configuration()).display().to_string();
    let plan = Plan { station: &station, config };
    // With --live late data are reported first.
    for source in [&[][..], &["--live"]] {
        wait_for("the refusal", || {
            let unfinished = plan.run(source);
            assert_eq!(unfinished.code, Some(1));
            unfinished.stderr.contains("anon-1 is not identified yet").then_some(())
        });
    }
    station.run(&["identify", "stop"]).assert_done();
    station.run(&["subject", "save"]).assert_done();
    plan.wait_for_profile("an identified profile", |text| text.contains("identified = true"));
    assert_corrected_by_a_measured_handover(&plan, &person);
    let now = plan.live(&["--now", "0.55,0,0.9"]);
    assert!(now.contains("\nnow   0.55 m forward") && now.contains("\ngain  "), "{now}");
    wait_for("the other subject's refusal", || {
        let elsewhere = plan.run(&["--live", "--subject", "anon-2"]);
        elsewhere.stderr.contains("anon-2 is not the subject at the station, anon-1").then_some(())
    });
    daemon.kill();
    let dead = plan.run(&["--live"]);
    assert_eq!(dead.code, Some(1));
    // Which of the two depends on whether another process has cleared the killed daemon's services away.
    let is_said =
        ["no daemon runs", "the daemon did not answer"].iter().any(|said| dead.stderr.contains(said));
    assert!(is_said, "{}", dead.stderr);
    assert_map_and_file_agree_with_the_plan(&plan);
    assert_invalid_requests_are_refused(&plan);
}

/// Without a hold in a static pose nothing is learnt; with one the prediction is corrected.
fn assert_corrected_by_a_measured_handover(plan: &Plan, person: &SimulationHandle) {
    assert!(plan.live(&[]).contains("corrected by 0 measured handovers"));
    person.lift(6.0);
    plan.wait_for_profile("a measured handover", |text| text.matches("[[handover]]").count() == 1);
    person.put_down();
    // The person stands at the origin of the station's world, facing X; left and right are nearly equivalent.
    let [running, stored]: [Value; 2] =
        [plan.live(&["--json"]), plan.run(&["--json"]).assert_done().to_owned()]
            .map(|text| serde_json::from_str(&text).expect("JSON"));
    for axis in 0..3 {
        let at_m = |plan: &Value| plan["position_m"][axis].as_f64().expect("a coordinate");
        let [live_m, stored_m] =
            [&running, &stored].map(|plan| if axis == 1 { at_m(plan).abs() } else { at_m(plan) });
        assert!((live_m - stored_m).abs() < 0.2, "{live_m} {stored_m}");
    }
    assert_eq!([&running, &stored].map(|plan| plan["handovers"].as_u64()), [Some(1); 2]);
}

fn assert_map_and_file_agree_with_the_plan(plan: &Plan) {
    let (csv, picture) = (plan.station.file("map.csv"), plan.station.file("map.svg"));
    let [csv_path, picture_path] = [&csv, &picture].map(|path| path.to_string_lossy().into_owned());
    let printed =
        plan.run(&["--now", "0.55,0,0.9", "--json", "--csv", &csv_path, "--picture", &picture_path]);
    let text = printed.assert_done().to_owned();
    let printed: Value = serde_json::from_str(&text).expect("JSON");
    let limit_ratio = |spot: &Value| spot["limit_ratio"].as_f64();
    let map = printed["map"].as_array().expect("a map");
    let least = map.iter().filter_map(limit_ratio).fold(f64::INFINITY, f64::min);
    assert_eq!(printed["worst_limit_ratio"].as_f64(), Some(least));
    assert!(limit_ratio(&printed["now"]) > Some(least), "{}", printed["now"]);
    let lines = std::fs::read_to_string(csv).expect("the map");
    assert_eq!(lines.lines().count(), map.len() + 1);
    // A controller reads only the best place, by its keys.
    let out = plan.station.file("plan.json");
    plan.run(&["--out", &out.to_string_lossy()]).assert_done();
    let written: Value = serde_json::from_slice(&std::fs::read(out).expect("a plan")).expect("JSON");
    for key in ["position_m", "worst_limit_ratio", "worst_limit_ratio_sigma"] {
        assert_eq!(written[key], printed[key]);
        assert_eq!(text.matches(&format!("\"{key}\"")).count(), 1, "{key}");
    }
    let drawn = std::fs::read_to_string(picture).expect("a picture");
    assert!(drawn.starts_with("<svg") && drawn.contains(&format!(">{:.0}</text>", 100.0 * least)));
}

fn assert_invalid_requests_are_refused(plan: &Plan) {
    plan.station
        .copy_profile("anon-1", "anon-3", |profile| drop(profile.insert("mass_kg".to_owned(), 0.0.into())));
    let weightless = plan.run(&["--subject", "anon-3"]);
    assert_eq!(weightless.code, Some(1));
    assert!(weightless.stderr.contains("the mass of anon-3 is not known"), "{}", weightless.stderr);
    let unknown = plan.run(&["--subject", "anon-9"]);
    assert!(unknown.code == Some(1) && unknown.stderr.contains("there is no profile anon-9"));
    for wrong in [["--now", "1,2"], ["--width", "-1"], ["--mass", "900"]] {
        let refused =
            plan.station.run(&[&["plan", "handover", "--config", &plan.config][..], &wrong].concat());
        assert_eq!(refused.code, Some(2), "{wrong:?}");
    }
}
