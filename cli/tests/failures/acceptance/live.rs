//! Live, over the sensors' own wires: a daemon with the model shows the gap shrink, and one without detects by itself
//! that its model no longer explains the worker.

use std::path::Path;
use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusSettings, Channel, Event};
use equipoise_config::Config;
use equipoise_core::cycle::Identification;
use equipoise_core::message::{State, Validity};
use equipoise_daemon::profile::Profile;
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::Reconcile;
use equipoise_recording::replay::input::Input;
use equipoise_simulator::faults::Faults;
use equipoise_simulator::motion::Habits;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::player::{PlayerHandle, PlayerSettings, Recorded, play};
use equipoise_simulator::ports::free_address;
use equipoise_studies::sensors::simulated_s;

use crate::common::Station;
use crate::make::{Samples, Script, session};
use crate::process::wait_for;

/// Time before the load is taken, in which clocks are fitted and the feet's place is estimated, s.
const BEFORE_S: f64 = 7.0;
/// Time from the start of the grasp until the load hangs, s.
const GRASPED_S: f64 = 2.0;

/// The identified worker from the script's poses.
fn identified(script: &Script, samples: &Samples) -> Box<Identification> {
    let directory = tempfile::tempdir().unwrap();
    let recording = directory.path().join("session.mcap");
    samples.write(&recording, &script.config());
    let (input, config) =
        (Input::open(&recording).unwrap(), Config::parse(&script.config(), "test").unwrap());
    let reconcile = Reconcile { input: &input, config: &config, given: Given::default() };
    reconcile.compare(&mut |_| {}).unwrap().identified.worker
}

/// A station with an identified worker that receives part of the session, live.
struct Live {
    station: Station,
    bus: Bus,
    _player: PlayerHandle,
}

impl Live {
    fn of(
        script: &Script,
        samples: &Samples,
        worker: &Identification,
        span_s: [f64; 2],
        model: Option<&Path>,
    ) -> Live {
        let within = |time_ns: u64| (span_s[0]..span_s[1]).contains(&simulated_s(time_ns));
        let suit = samples.suit.iter().filter(|sample| within(sample.sample_time_ns));
        let suit = suit.map(|sample| (simulated_s(sample.sample_time_ns), Recorded::Suit(Box::new(*sample))));
        let ground = samples.ground.iter().filter(|sample| within(sample.sample_time_ns));
        let ground = ground.map(|sample| (simulated_s(sample.sample_time_ns), Recorded::Ground(*sample)));
        let mut played: Vec<(f64, Recorded)> = suit.chain(ground).collect();
        played.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let listen = free_address().unwrap();
        let settings = PlayerSettings {
            suit_target: listen,
            plate_address: "127.0.0.1:0".parse().unwrap(),
            plate: Plate::default(),
            speed: 1.0,
            wait_for_client: true,
            faults: Faults::default(),
            seed: 1,
        };
        let player = play(played, settings).unwrap();
        let config = script
            .config()
            .replace(
                "[suit]",
                &format!(
                    "[loop]\nrate_hz = 200\npriority = 0\nlock_memory = false\n[suit]\nlisten = \"{listen}\""
                ),
            )
            .replace("[ground]", &format!("[ground]\naddress = \"{}\"", player.plate_address()));
        let build = Config::parse(&config, "test").unwrap().subject.build();
        let options = model.map_or(Vec::new(), |model| vec!["--model", model.to_str().unwrap()]);
        let station = Station::start_with(&config, &options, |state| {
            let mut stored = bytemuck::zeroed_box();
            worker.store(&mut stored);
            let profile =
                Profile::of("anon-1", build, &stored, &bytemuck::Zeroable::zeroed(), &Default::default(), 0)
                    .unwrap();
            std::fs::create_dir_all(state.join("subjects")).unwrap();
            std::fs::write(state.join("subjects/anon-1.toml"), profile.to_toml().unwrap()).unwrap();
        });
        let root = station.file("bus");
        let bus =
            Bus::join(&BusSettings { station: "test".to_owned(), role: "test".to_owned(), root }).unwrap();
        Live { station, bus, _player: player }
    }

    /// Residuals of every state of an identified worker between two times in seconds after the first: centre of
    /// pressure (m), force (N).
    fn residuals(&self, from_s: f64, to_s: f64) -> Vec<[f64; 2]> {
        const WITHOUT: Validity = Validity::INVALIDATES_COP_MEASURED
            .and(Validity::INVALIDATES_COP_ESTIMATED)
            .and(Validity::INVALIDATES_DELTA_F)
            .and(Validity::NOT_IDENTIFIED)
            .and(Validity::MODEL_CHANGED);
        let mut states = self.bus.subscriber::<State>(256).unwrap();
        let (mut values, mut first_ns, mut last_ns, started) = (Vec::new(), None, 0, Instant::now());
        while started.elapsed().as_secs_f64() < to_s {
            while let Some(state) = states.receive().unwrap() {
                let time_ns = state.suit_sample_time_ns;
                if time_ns == 0 {
                    continue;
                }
                let since_s = (time_ns - *first_ns.get_or_insert(time_ns)) as f64 * 1e-9;
                let is_new = time_ns > last_ns && state.cop_sigma_m[0] > 0.0;
                if is_new && since_s > from_s && !state.validity().any_of(WITHOUT) {
                    last_ns = time_ns;
                    let deviation_m =
                        [0, 1].map(|axis| state.cop_measured_m[axis] - state.cop_estimated_m[axis]);
                    values.push([deviation_m[0].hypot(deviation_m[1]), state.delta_f_n[2].abs()]);
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        values
    }

    /// The suspected effect that the daemon announces by its event within this time in seconds; `None` if there was
    /// none.
    fn suspicion(&self, seconds: f64) -> Option<String> {
        let listener = self.bus.listener(Channel::Results).unwrap();
        let started = Instant::now();
        while started.elapsed().as_secs_f64() < seconds {
            let events = listener.wait(Duration::from_millis(200)).unwrap();
            if events.contains(Event::ModelMismatch) {
                // The status is written shortly after.
                return Some(wait_for("the suspicion in the status", || {
                    let output = self.station.command("status").arg("--json").output().unwrap();
                    let report: serde_json::Value = serde_json::from_slice(&output.stdout).ok()?;
                    report["daemon"]["model_mismatch"].as_str().map(str::to_owned)
                }));
            }
        }
        None
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn a_live_daemon_with_the_model_reduces_the_residual() {
    let session = session();
    let (script, samples) = (&session.script, &session.script.samples());
    let worker = identified(script, samples);
    let span_s = [script.lift_s() - BEFORE_S, script.lift_s() + 23.0];
    let model = session.model();
    let [without, with] = std::thread::scope(|scope| {
        [None, Some(model.as_path())]
            .map(|model| {
                let worker = &worker;
                scope.spawn(move || {
                    Live::of(script, samples, worker, span_s, model)
                        .residuals(BEFORE_S + GRASPED_S, span_s[1] - span_s[0])
                })
            })
            .map(|run| run.join().unwrap())
    });
    println!("{} and {} moments", without.len(), with.len());
    assert!(without.len() > 200 && with.len() > 200);
    for (what, signal, ratio_max) in [("CoP", 0, 0.6), ("vertical force", 1, 0.3)] {
        let [without, with] =
            [&without, &with].map(|all| median(all.iter().map(|one| one[signal]).collect()));
        println!("{what}: median {without:.4} without the model, {with:.4} with it");
        assert!(with < ratio_max * without, "{what}: {without} {with}");
    }
}

/// Below half the load threshold, so that no overload is published: the model is wrong.
const UNDETECTED_KG: f64 = 0.7;

#[test]
fn a_live_daemon_reports_that_its_model_no_longer_fits() {
    let mut script = Script { carried_kg: UNDETECTED_KG, work_s: 62.0, varied: true, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    script.habits = Habits { right_hand_fraction: 1.0, ..script.habits };
    let clean = Script { carried_kg: 0.0, ..script };
    let (samples, clean_samples) = (script.samples(), clean.samples());
    let worker = identified(&clean, &clean_samples);
    // Long enough before the load for the offset of the vertical force: a load that is there from the start is
    // indistinguishable from clothing.
    let span_s = [script.lift_s() - 8.0, script.length_s()];
    let [disturbed, clean] = std::thread::scope(|scope| {
        [(&script, &samples), (&clean, &clean_samples)]
            .map(|(script, samples)| {
                let worker = &worker;
                scope.spawn(move || {
                    Live::of(script, samples, worker, span_s, None).suspicion(span_s[1] - span_s[0])
                })
            })
            .map(|run| run.join().unwrap())
    });
    assert_eq!(clean, None, "nothing is wrong there");
    let report = disturbed.expect("an event");
    assert!(report.contains("no longer explains") && report.contains("vertical force"), "{report}");
    assert!(report.contains("above what is predicted"), "{report}");
    assert!(report.contains("holding still") || report.contains("moving"), "{report}");
}
