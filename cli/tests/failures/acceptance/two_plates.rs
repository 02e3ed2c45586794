//! Each foot on its own plate: two devices, one ground.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use equipoise_adapters::ground::GroundRefusal;
use equipoise_core::body::Joint;
use equipoise_core::message::state::SharingSource;
use equipoise_core::message::{Incident, Validity};
use equipoise_simulator::devices::line::Line;
use equipoise_simulator::devices::load::{Ground, Mounting};
use equipoise_simulator::devices::moticon::Moticon;
use equipoise_simulator::devices::running::{Pace, Running};
use equipoise_simulator::devices::udp::UdpPort;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SecondPlateSettings;
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_simulator::wires::moticon::ALL;
use nalgebra::Vector3;

use crate::monitor::Monitor;
use crate::process::{TIMEOUT, wait_for};
use crate::station::{NAME, Station, simulate};

/// Poses of both plates: origin (m), rotation (degrees), height of the surface above the origin (m).
const POSITIONS: [([f64; 3], f64, f64); 2] =
    [([0.05, 0.21, -0.045], 12.0, 0.045), ([-0.02, -0.2, -0.03], -90.0, 0.03)];
/// Poses for the identification: torques of the legs depend on the ground, not on their number.
const POSES: u32 = 3;
/// Duration of a lift with its demonstration.
const LIFT: Duration = Duration::from_secs(14);
/// Minimum number of samples with torques.
const SAMPLES_MIN: f64 = 100.0;

/// A station whose person has each foot on its own plate, and its configuration.
struct TwoPlates {
    station: Station,
    second: SocketAddr,
}

impl TwoPlates {
    fn new() -> TwoPlates {
        TwoPlates { station: Station::new(), second: free_address().expect("a free port") }
    }

    fn person(&self) -> SimulationHandle {
        let mut settings = self.station.sensors();
        let plate = |which: usize| {
            let (origin_m, yaw_deg, surface_height_m) = POSITIONS[which];
            let counts_per_unit = [1e6; 2];
            let yaw_rad = f64::to_radians(yaw_deg);
            equipoise_simulator::plate::Plate { origin_m, yaw_rad, surface_height_m, counts_per_unit }
        };
        settings.plate.plate = plate(0);
        let (address, press_m) = (self.second, [[0.0; 2]; 2]);
        settings.second_plate =
            Some(SecondPlateSettings { address, rate_hz: 190.0, plate: plate(1), press_m });
        simulate(&settings)
    }

    fn configuration(&self) -> String {
        let frame = |which: usize| {
            let (origin_m, yaw_deg, surface_height_m) = POSITIONS[which];
            format!(
                "origin_m = {origin_m:?}\nyaw_deg = {yaw_deg:?}\nsurface_height_m = {surface_height_m:?}\n"
            )
        };
        let second = format!(
            "foot = \"left\"\n[ground.frame]\n{}[ground.second]\nsource = \"ati-rdt\"\naddress = \"{}\"\ncounts_per_newton = \
             1e6\ncounts_per_newton_metre = 1e6\nfoot = \"right\"\n[ground.second.frame]\n{}[subject]\n",
            frame(0),
            self.second,
            frame(1)
        );
        self.station.configuration().replace("[subject]\n", &second)
    }
}

/// Root mean square error of the legs' torques while a box is lifted, N m, and the number of samples.
fn legs_error_nm(
    station: &Station,
    monitor: &mut Monitor,
    person: &SimulationHandle,
    source: SharingSource,
) -> (f64, f64) {
    monitor.until_poses(person, POSES);
    station.run(&["identify", "stop"]).assert_done();
    monitor.until("the monitoring", |monitor| monitor.state.phase_name() == "monitoring");
    let legs: Vec<Joint> = Joint::ALL
        .into_iter()
        .filter(|joint| ["Hip", "Knee", "Ankle"].iter().any(|name| joint.name().ends_with(name)))
        .collect();
    let (started, mut lifted, mut before_ns) = (Instant::now(), None::<Instant>, 0);
    let (mut square_nm2, mut samples, mut as_expected) = (0.0, 0.0, 0.0);
    loop {
        if lifted.is_none_or(|at| at.elapsed() > LIFT) {
            // Repeated where a busy machine has too few usable samples of one.
            if lifted.is_some() && (samples > SAMPLES_MIN || started.elapsed() > TIMEOUT) {
                break;
            }
            person.lift_and_show(8.0);
            lifted = Some(Instant::now());
        }
        let state = *monitor.update();
        if state.suit_sample_time_ns != before_ns && !state.validity().any_of(Validity::INVALIDATES_TORQUES) {
            as_expected += f64::from(u8::from(state.sharing_source == source as u32));
            let time_s = (state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9;
            let truth = person.truth_at(time_s);
            for joint in legs.iter().map(|joint| joint.index()) {
                let error_nm = Vector3::from(state.torque_nm[joint]) - truth.overload_in_motion_nm[joint];
                square_nm2 += error_nm.norm_squared() / legs.len() as f64;
            }
            samples += 1.0;
        }
        before_ns = state.suit_sample_time_ns;
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(as_expected > 0.9 * samples, "{source:?} in {as_expected} of {samples} samples");
    (f64::sqrt(square_nm2 / f64::max(samples, 1.0)), samples)
}

#[test]
fn two_plates_measure_each_foot_and_improve_leg_torques() {
    let one = std::thread::spawn(|| {
        let station = Station::new();
        let person = station.person();
        let _daemon = station.daemon(&station.configuration());
        let mut monitor = Monitor::open(&station);
        let error = legs_error_nm(&station, &mut monitor, &person, SharingSource::Geometry);
        station.status_when("the plate in the status", |status| {
            status["ground"]["devices"] == serde_json::json!(["plate"])
        });
        error
    });
    let two = TwoPlates::new();
    let person = two.person();
    let _daemon = two.station.daemon(&two.configuration());
    let mut monitor = Monitor::open(&two.station);
    let (two_nm, two_samples) = legs_error_nm(&two.station, &mut monitor, &person, SharingSource::Measured);
    let status = two.station.status_when("both plates in the status", |status| {
        status["ground"]["devices"] == serde_json::json!(["plate", "second_plate"])
    });
    assert_eq!(status["ground"]["per_foot"], true, "{status}");
    // The sum over both feet is the person's weight, at the person's centre of pressure.
    let state = monitor.until("a measured force", |monitor| {
        monitor.both_fresh() && !monitor.has(Validity::INVALIDATES_GROUND_FORCE)
    });
    let truth = person.truth_at((state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9);
    assert!((state.ground_force_n[2] - truth.ground.force_n.z).abs() < 15.0, "{:?}", state.ground_force_n);
    let line = "feet    on plate and second plate, each measured by itself";
    two.station.run_until(line, &["status"], |ended| ended.stdout.contains(line)).assert_done();

    let (one_nm, one_samples) = one.join().expect("the station with one plate");
    println!(
        "legs while lifting: one plate {one_nm:.2} N m ({one_samples}), two {two_nm:.2} N m ({two_samples})"
    );
    assert!(one_samples > SAMPLES_MIN && two_samples > SAMPLES_MIN, "{one_samples} {two_samples}");
    assert!(two_nm < 0.7 * one_nm, "{one_nm} → {two_nm} N m");
}

#[test]
fn insoles_on_a_plate_share_its_force_and_it_continues_without_them() {
    let station = Station::new();
    let person = station.person();
    let listen = free_address().expect("a free port");
    let port = UdpPort::to(listen).expect("the insoles' end");
    let insoles = Moticon::new(Line::new(Box::new(port), 1), &ALL, 100.0, [0.28, 0.095]);
    let pace = Pace { start_ns: person.start_ns(), ..Pace::default() };
    let ground = Ground::One(Mounting::default());
    let insoles = Running::start(Box::new(insoles), ground, person.load(), pace).expect("insoles");
    let second = format!(
        "[ground.second]\nsource = \"moticon-udp\"\nlisten = \"{listen}\"\n[ground.second.moticon]\nlength_m = 0.28\nwidth_m = \
         0.095\ny_to = \"lateral\"\n[subject]\n"
    );
    let _daemon = station.daemon(&station.configuration().replace("[subject]\n", &second));
    let mut monitor = Monitor::open(&station);
    // Load fractions are reported only with a load, which requires an identified subject.
    monitor.until_poses(&person, 1);
    station.run(&["identify", "stop"]).assert_done();
    person.lift(8.0);
    monitor.until("shares that are measured", |monitor| {
        monitor.both_fresh() && monitor.state.sharing_source == 1
    });
    let state = monitor.until("a still person", |monitor| {
        let is_measured = monitor.both_fresh() && !monitor.has(Validity::INVALIDATES_GROUND_FORCE);
        is_measured && monitor.state.sharing_source == 1 && monitor.state.static_pose == 1
    });
    let truth = person.truth_at((state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9);
    assert!(
        (state.ground_force_n[2] - truth.ground.force_n.z).abs() < 15.0,
        "the plate's: {:?}",
        state.ground_force_n
    );
    let ([left, _], [_, [true_left, _]]) = (state.foot_load_fraction, truth.foot_load_fraction);
    assert!((left - true_left).abs() < 0.03, "{left} {true_left}");
    let expected = serde_json::json!({
        "devices": ["plate", "insoles"], "per_foot": true, "foot_frame": "sole", "not_measured": []
    });
    station.status_when("plate and insoles in the status", |status| status["ground"] == expected);

    insoles.silence(true);
    monitor.until("geometry", |monitor| {
        monitor.both_fresh() && monitor.state.sharing_source == 0 && monitor.state.foot_load_fraction[0] > 0.0
    });
    monitor.until("the reason", |monitor| monitor.is_active(Incident::GroundAdapterDown));
    // The plate is whole without them. A busy machine delays the plate as well now and then.
    wait_for("half a second with a centre of pressure", || {
        let mut is_valid = true;
        monitor.during(Duration::from_millis(500), |monitor| {
            is_valid &= !monitor.has(Validity::INVALIDATES_COP_MEASURED);
        });
        is_valid.then_some(())
    });
    station.status_when("the plate alone in the status", |status| {
        status["ground"]["devices"] == serde_json::json!(["plate"])
    });
    insoles.silence(false);
    monitor.until("shares again", |monitor| monitor.both_fresh() && monitor.state.sharing_source == 1);
    monitor.until("the end of the incident", |monitor| !monitor.is_active(Incident::GroundAdapterDown));
}

#[test]
fn one_unplugged_plate_of_two_invalidates_the_ground_until_it_recovers() {
    let two = TwoPlates::new();
    let person = two.person();
    let mut daemon = two.station.daemon(&two.configuration());
    let mut monitor = Monitor::open(&two.station);
    monitor
        .until("the whole person", |monitor| monitor.both_fresh() && monitor.state.ground_force_n[2] > 600.0);
    for silence in [SimulationHandle::silence_second_plate, SimulationHandle::silence_plate] {
        silence(&person, true);
        monitor.until("the ground's silence", |monitor| {
            // Half of the person's weight is not reported meanwhile.
            let vertical_n = monitor.state.ground_force_n[2];
            assert!(vertical_n == 0.0 || vertical_n > 600.0, "{vertical_n} N");
            monitor.has(Validity::GROUND_STALE)
        });
        monitor.until("the reason", |monitor| monitor.is_active(Incident::GroundAdapterDown));
        monitor
            .during(Duration::from_millis(300), |monitor| assert_eq!(monitor.state.ground_force_n, [0.0; 3]));
        silence(&person, false);
        monitor.until("the ground again", |monitor| {
            monitor.both_fresh() && monitor.state.ground_force_n[2] > 600.0
        });
        monitor.until("the end of the incident", |monitor| !monitor.is_active(Incident::GroundAdapterDown));
    }
    let message = daemon.stderr();
    for place in
        [format!("ground.second.address = {}", two.second), format!("ground.address = {}", two.station.plate)]
    {
        assert!(message.contains(&format!("{place} sends nothing")), "{place} is not in {message}");
    }
    monitor.until("the counts", |monitor| monitor.ground_refused(GroundRefusal::NoPartner) > 50);
    assert!(daemon.is_running());

    // A person stands there.
    let refusal = "stand on the plate; step off";
    let tare = ["tare", "--station", NAME];
    let tare = two.station.run_until(refusal, &tare, |ended| ended.stderr.contains(refusal));
    tare.assert_failed(1, &[refusal]);
}
