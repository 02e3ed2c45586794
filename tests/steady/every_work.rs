//! Warm, the loop neither allocates nor frees memory, while processes join and leave.
//!
//! A counting allocator is armed on the loop's own thread, from inside the loop, after a warm-up; then sensors stream,
//! static poses and motion samples update the filter, a box is lifted and accumulates exposure, a model with terms of
//! every kind runs, subscribers stay, join and leave, and checkpoints are requested, over 100 000 cycles.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusSettings};
use equipoise_config::Config;
use equipoise_config::model::LoadedModel;
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{Command, State, Validity};
use equipoise_daemon::pipeline::Pipeline;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};

use crate::{Watch, counting_alloc};

const RATE_HZ: u32 = 4000;
const WARM_CYCLES: u64 = 4000;
const ARMED_CYCLES: u64 = 100_000;
/// Lifted once identification has ended.
const BOX_KG: f64 = 8.0;
/// More than the duration of `lift_and_show`; one that overtakes the previous only prolongs it.
const LIFT_LASTS: Duration = Duration::from_secs(17);

fn config(station: &str, suit: SocketAddr, plate: SocketAddr) -> Config {
    let text = format!(
        "station = \"{station}\"\n[loop]\nrate_hz = {RATE_HZ}\nlock_memory = false\n[suit]\nsource = \"mvn-udp\"\nlisten = \
         \"{suit}\"\n[ground]\nsource = \"ati-rdt\"\naddress = \"{plate}\"\ncounts_per_newton = 1e6\n\
         counts_per_newton_metre = 1e6\n[subject]\nid = \"t\"\nheight_m = 1.77\nsave_profile = false\n\
         [identification]\nposes_min = 2\nstop_cop_sigma_mm = 20\npassive = true\n[latency]\nflight_cycles = 0\n"
    );
    let mut config = Config::parse(&text, "the test's configuration").expect("a good configuration");
    config.loaded_model =
        Some(LoadedModel::parse(MODEL.to_owned(), "the test's model".to_owned()).expect("a good model"));
    config
}

/// A term of every kind: columns with and without motion, time, a filter, a lag; each too small to disturb the rest.
/// And a requested pose.
const MODEL: &str = r#"version = 1
[ask]
between = ["worn_mass T8", "hand_load both"]
pose = "both arms up"
turn_deg = 90.0
separation_sigma = 3.0
[[effect]]
name = "worn_mass"
where = { segment = "T8" }
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { mass_kg = { value = 0.02, sigma = 0.01, unit = "kg" }, mx_kg_m = { value = 0.002, sigma = 0.01, unit = "kg m" } }
[[effect]]
name = "hand_load"
where = { hand = "both" }
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { mass_kg = { value = 0.02, sigma = 0.01, unit = "kg" } }
[[effect]]
name = "plate_drift"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { tau_s = { value = 20.0, sigma = 1.0, unit = "s" }, ax_m = { value = 0.0005, sigma = 0.001, unit = "m" } }
[[effect]]
name = "segment_heading"
where = { segment = "RightForearm" }
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { psi_rad = { value = 0.005, sigma = 0.01, unit = "rad" } }
[[effect]]
name = "periodic_sway"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { hz = { value = 0.3, sigma = 0.01, unit = "Hz" }, sine_x_m = { value = 0.0003, sigma = 0.001, unit = "m" } }
[[effect]]
name = "plate_lowpass"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { cutoff_hz = { value = 80.0, sigma = 1.0, unit = "Hz" } }
[[effect]]
name = "suit_lag"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { tau_s = { value = 0.001, sigma = 0.001, unit = "s" } }
"#;

/// Loop activity observed by the permanent subscriber.
#[derive(Debug, Default)]
struct Activity {
    states: u64,
    poses: u32,
    motion_samples: u32,
    torques: u64,
    fatigue: f64,
    asked: u64,
}

impl Activity {
    fn record(&mut self, state: &State) {
        self.states += 1;
        self.poses = self.poses.max(state.poses_used);
        self.motion_samples = self.motion_samples.max(state.motion_samples_used);
        self.asked += u64::from(state.converged == 1 && state.suggested_pose != u32::MAX);
        self.torques += u64::from(!state.validity().any_of(Validity::INVALIDATES_TORQUES));
        self.fatigue = state.fatigue.iter().copied().fold(self.fatigue, f64::max);
    }

    fn is_complete(&self) -> bool {
        self.states > 0
            && self.poses >= 2
            && self.motion_samples > 0
            && self.torques > 100
            && self.fatigue > 0.0
            && self.asked > 0
    }
}

/// Poses are held, then a box is lifted; subscribers join and leave, checkpoints are requested, the configuration is
/// reloaded, until all kinds of the loop's work have occurred and it has been armed long enough.
fn keep_busy(
    station: &str,
    person: &SimulationHandle,
    watch: &Watch,
    mut reload: impl FnMut(usize),
) -> Activity {
    let bus = Bus::join(&BusSettings::new(station, "test")).expect("the bus");
    let mut subscriber = bus.subscriber::<State>(64).expect("a subscriber");
    let client = bus.command_client().expect("a client");
    let (started, mut activity, mut round, mut phase) = (Instant::now(), Activity::default(), 0_usize, 0);
    let mut lifted_at: Option<Instant> = None;
    while watch.armed_cycles() < ARMED_CYCLES || !activity.is_complete() {
        assert!(
            started.elapsed() < Duration::from_secs(600),
            "timeout: an activity did not occur: {activity:?}"
        );
        drop(bus.subscriber::<State>(8).expect("a passing subscriber"));
        while let Some(state) = subscriber.receive().expect("the bus") {
            activity.record(&state);
            phase = state.phase;
        }
        if round.is_multiple_of(200) {
            if phase == Phase::Monitoring as u32 {
                if lifted_at.is_none_or(|at| at.elapsed() > LIFT_LASTS) {
                    person.lift_and_show(BOX_KG);
                    lifted_at = Some(Instant::now());
                }
            } else {
                person.take_pose(round / 200).expect("a pose of the library");
            }
            let command = Command { kind: CommandKind::Checkpoint as u32, ..Command::zeroed() };
            client.ask(&command, Duration::from_secs(5)).expect("an answer");
        }
        if round % 200 == 100 {
            reload(round);
        }
        round += 1;
        std::thread::sleep(Duration::from_millis(20));
    }
    activity
}

#[test]
fn the_loop_neither_allocates_nor_frees_in_100_000_cycles() {
    let station = format!("no-alloc-{}", std::process::id());
    let suit = free_address().unwrap();
    let mut simulated = SimulationSettings::default();
    simulated.suit.target = suit;
    simulated.plate.address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let person = Simulation::start(simulated).expect("a simulated person");

    let watch = Watch::after(WARM_CYCLES);
    let config = config(&station, suit, person.plate_address());
    let pipeline = Pipeline::start_observed(&config, Box::new(watch.clone())).expect("a pipeline");
    let worked = keep_busy(&station, &person, &watch, |round| {
        let mut other = config.clone();
        other.overload.threshold_n = if round % 400 == 100 { 16.0 } else { 15.0 };
        // This resets the model's terms as well.
        pipeline.reload(Ok(other)).expect("a good configuration");
    });
    watch.disarm.store(true, Ordering::Relaxed);
    // The loop checks the flag once a cycle.
    std::thread::sleep(Duration::from_millis(50));
    let touched = watch.touched();
    let summary = pipeline.stop().expect("an orderly end");
    person.stop().expect("an orderly end of the simulation");

    assert_eq!(touched, (0, 0), "the loop touched the heap");
    assert!(watch.armed_cycles() >= ARMED_CYCLES);
    println!("{worked:?}");
    assert!(summary.cycles.adds_up, "{:?}", summary.cycles);
}

#[test]
fn the_counter_counts() {
    counting_alloc::arm(true);
    drop(std::hint::black_box(Box::new(7)));
    counting_alloc::arm(false);
    drop(std::hint::black_box(Box::new(7)));
    let touched = counting_alloc::touched();
    assert_eq!((touched.allocations, touched.frees), (1, 1));
}
