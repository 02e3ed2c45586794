//! Values that arrive in the registers, and behaviour of the gateway when the controller rejects it.

use std::collections::BTreeMap;
use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use equipoise_client::NoReading;
use equipoise_core::body::Joint;
use equipoise_core::message::Validity;
use equipoise_gateways::Gateway;
use equipoise_gateways::config::RtdeConfig;
use equipoise_gateways::gateway::Latest;
use equipoise_gateways::rtde::Rtde;
use equipoise_simulator::ports::free_address;

use super::controller::{Controller, package, start, text};
use crate::states::{reading, reasons, state};

/// Test time-out, far above the expected duration; not a measurement.
const PATIENCE: Duration = Duration::from_secs(90);

fn config(robot: SocketAddr, registers: &str) -> RtdeConfig {
    toml::from_str(&format!("robot = \"{robot}\"\n{registers}")).unwrap()
}

/// Sends until the controller has received a package with this state.
fn send_until_accepted(
    gateway: &mut Rtde,
    controller: &Controller,
    latest: &Latest,
) -> BTreeMap<String, f64> {
    let (begun, before) = (Instant::now(), controller.packages.load(SeqCst));
    while controller.packages.load(SeqCst) < before + 1 {
        gateway.send(latest);
        assert!(begun.elapsed() < PATIENCE, "no package arrives: {}", gateway.tally());
        std::thread::sleep(Duration::from_millis(2));
    }
    // Wait until the last package sent arrives; another follows, since one is dropped if the controller was quiet.
    loop {
        gateway.send(latest);
        let (sent, packages) = (Instant::now(), gateway.tally().sent + gateway.tally().lost);
        while sent.elapsed() < Duration::from_secs(1) {
            let inputs = controller.inputs.lock().unwrap().clone();
            if inputs["input_int_register_24"] >= packages as f64 {
                return inputs;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(begun.elapsed() < PATIENCE, "package {packages} does not arrive: {}", gateway.tally());
    }
}

fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|value| value * value).sum::<f64>().sqrt()
}

#[test]
fn the_registers_hold_the_state() {
    let (controller, robot) = start();
    let mut gateway = Rtde::new(&config(robot, "")).unwrap();
    let state = state();
    let inputs = send_until_accepted(&mut gateway, &controller, &Ok(reading(state)));
    let worst_nm = length(state.torque_nm[21]);
    for (name, value) in [
        ("int_register_25", 1.0),
        ("int_register_26", 0.0),
        ("int_register_27", f64::from((1 << Validity::FLAG_SETS.len()) - 1)),
        ("int_register_28", 5.0),
        ("int_register_29", 21.0),
        ("double_register_24", 0.001_234_567),
        ("double_register_25", 0.071_234_567),
        ("double_register_26", worst_nm),
        ("double_register_27", worst_nm / state.torque_limit_nm[21]),
        ("double_register_28", state.lifted_mass_kg),
        ("double_register_29", state.reach_m),
    ] {
        let received = inputs[&format!("input_{name}")];
        assert!((received - value).abs() < 1e-12 * value.abs().max(1.0), "{name}: {received}, not {value}");
    }
    assert_eq!(inputs.len(), 12);
    assert_eq!(gateway.tally().peers, 1);
}

#[test]
fn the_sequence_grows_with_every_package() {
    let (controller, robot) = start();
    let mut gateway = Rtde::new(&config(robot, "")).unwrap();
    let mut before = 0.0;
    for _ in 0..20 {
        let inputs = send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
        assert!(inputs["input_int_register_24"] > before);
        before = inputs["input_int_register_24"];
    }
}

#[test]
fn what_a_reason_spoils_is_zero_and_has_no_bit_of_usable() {
    let (controller, robot) = start();
    let registers = "registers = { sequence = 24, state = 25, valid = 26, usable = 27, worst_level = 28, worst_joint = \
                     29, level_jL5S1 = 30, worst_torque_nm = 24, lifted_mass_kg = 25, torque_jL5S1_nm = 26, delta_fz_n \
                     = 27, fatigue_jL5S1 = 47 }"
        .replace("jL5S1", Joint::ALL[0].name());
    let mut gateway = Rtde::new(&config(robot, &registers)).unwrap();
    for valid in reasons() {
        let mut state = state();
        (state.valid, state.joint_level[0]) = (valid.0, 2);
        let inputs = send_until_accepted(&mut gateway, &controller, &Ok(reading(state)));
        let register = |kind: &str, number: u8| inputs[&format!("input_{kind}_register_{number}")];
        assert_eq!(register("int", 26), valid.0 as f64);
        for (bit, (invalidating, name)) in Validity::FLAG_SETS.iter().enumerate() {
            let may = register("int", 27) as u32 >> bit & 1 == 1;
            assert_eq!(may, !valid.any_of(*invalidating), "{name}");
        }
        for (number, kind, invalidating) in [
            (28, "int", Validity::INVALIDATES_TORQUES),
            (30, "int", Validity::INVALIDATES_TORQUES),
            (24, "double", Validity::INVALIDATES_TORQUES),
            (26, "double", Validity::INVALIDATES_TORQUES),
            (25, "double", Validity::INVALIDATES_LIFTED_MASS),
            (27, "double", Validity::INVALIDATES_DELTA_F),
        ] {
            assert_eq!(
                register(kind, number) != 0.0,
                !valid.any_of(invalidating),
                "{kind} {number} with {}",
                valid.0
            );
        }
        assert_eq!(register("int", 29) < 0.0, valid != Validity::default());
        assert_eq!(register("double", 47), state.fatigue[0], "fatigue is never withheld");
    }
}

#[test]
fn the_sigma_of_each_value_is_written_or_withheld_with_it() {
    let (controller, robot) = start();
    let registers = "registers = { sequence = 24, state = 25, reach_sigma_m = 24, delta_fz_sigma_n = 25, \
                     l5s1_compression_sigma_n = 26, sigma_jL5S1_nm = 27 }"
        .replace("jL5S1", Joint::ALL[0].name());
    let mut gateway = Rtde::new(&config(robot, &registers)).unwrap();
    for valid in [Validity::default(), Validity::BELOW_LOAD_THRESHOLD, Validity::GROUND_STALE] {
        let mut state = state();
        state.valid = valid.0;
        let inputs = send_until_accepted(&mut gateway, &controller, &Ok(reading(state)));
        for (number, sigma, invalidating) in [
            (24, state.reach_sigma_m, Validity::INVALIDATES_TORQUES),
            (25, state.delta_f_sigma_n, Validity::INVALIDATES_DELTA_F),
            (26, state.l5s1_compression_sigma_n, Validity::INVALIDATES_LOW_BACK),
            (27, state.torque_sigma_nm[0], Validity::INVALIDATES_TORQUES),
        ] {
            let written = inputs[&format!("input_double_register_{number}")];
            let expected = if valid.any_of(invalidating) { 0.0 } else { sigma };
            assert_eq!(written, expected, "register {number} with {}", valid.0);
        }
    }
}

#[test]
fn without_a_state_the_reason_is_written_and_the_values_go() {
    let (controller, robot) = start();
    let mut gateway = Rtde::new(&config(robot, "")).unwrap();
    send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
    let ms = Duration::from_millis;
    for (why, number) in [
        (NoReading::Silent { silent: ms(700) }, 2.0),
        (NoReading::Stale { age: ms(40), stale_after: ms(25) }, 3.0),
        (NoReading::OtherClock { ahead: ms(9000) }, 4.0),
    ] {
        let inputs = send_until_accepted(&mut gateway, &controller, &Err(why));
        assert_eq!(inputs["input_int_register_25"], number);
        for (name, value) in [
            ("int_register_26", -1.0),
            ("int_register_27", 0.0),
            ("int_register_28", 0.0),
            ("int_register_29", -1.0),
            ("double_register_24", -1.0),
            ("double_register_25", -1.0),
            ("double_register_26", 0.0),
            ("double_register_28", 0.0),
        ] {
            assert_eq!(inputs[&format!("input_{name}")], value, "{name}");
        }
    }
}

#[test]
fn another_start_of_the_daemon_is_published_and_is_retained_without_states() {
    let (controller, robot) = start();
    let registers = "registers = { sequence = 24, state = 25, daemon_life = 26 }";
    let mut gateway = Rtde::new(&config(robot, registers)).unwrap();
    let silent = || Err(NoReading::Silent { silent: Duration::from_secs(1) });
    let of_start = |daemon_life| Ok(equipoise_client::Reading { daemon_life, ..reading(state()) });
    for (latest, expected) in
        [(silent(), 0.0), (of_start(1), 1.0), (silent(), 1.0), (of_start(2), 2.0), (of_start(2), 2.0)]
    {
        let inputs = send_until_accepted(&mut gateway, &controller, &latest);
        assert_eq!(inputs["input_int_register_26"], expected);
    }
}

/// Sends until a condition holds.
fn send_until(gateway: &mut Rtde, what: &str, mut is_so: impl FnMut(&Rtde) -> bool) {
    let begun = Instant::now();
    while !is_so(gateway) {
        gateway.send(&Ok(reading(state())));
        assert!(begun.elapsed() < PATIENCE, "in vain until {what}: {}", gateway.tally());
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_register_of_another_client_is_not_taken_and_tried_again() {
    let (controller, robot) = start();
    let mut first = Rtde::new(&config(robot, "")).unwrap();
    send_until_accepted(&mut first, &controller, &Ok(reading(state())));
    let mut second = Rtde::new(&config(robot, "")).unwrap();
    send_until(&mut second, "it was refused", |_| controller.clients.load(SeqCst) >= 3);
    assert_eq!((second.tally().sent, second.tally().peers), (0, 0));
    assert!(second.tally().lost > 0);
    // Other registers are still available.
    let others = "registers = { sequence = 40, state = 41 }";
    let mut third = Rtde::new(&config(robot, others)).unwrap();
    send_until(&mut third, "it writes others", |third| third.tally().peers == 1);
    drop(first);
    send_until(&mut second, "the registers are free", |second| second.tally().peers == 1);
}

#[test]
fn refusals_do_no_harm_and_end() {
    type Refusal = fn(&Controller) -> &std::sync::atomic::AtomicBool;
    let refusals: [Refusal; 2] = [|controller| &controller.is_old, |controller| &controller.refuses_start];
    for refusal in refusals {
        let (controller, robot) = start();
        refusal(&controller).store(true, SeqCst);
        let mut gateway = Rtde::new(&config(robot, "")).unwrap();
        send_until(&mut gateway, "it was refused twice", |_| controller.clients.load(SeqCst) >= 2);
        assert_eq!((gateway.tally().sent, controller.packages.load(SeqCst)), (0, 0));
        refusal(&controller).store(false, SeqCst);
        send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
    }
}

#[test]
fn a_controller_that_comes_late_or_leaves_is_found_again() {
    let robot = free_address().unwrap();
    let mut gateway = Rtde::new(&config(robot, "")).unwrap();
    for _ in 0..50 {
        gateway.send(&Ok(reading(state())));
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(gateway.tally().lost, 50);
    let controller = Arc::new(Controller::default());
    super::controller::serve(Arc::clone(&controller), TcpListener::bind(robot).unwrap());
    send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
    controller.leaves.store(true, SeqCst);
    send_until(&mut gateway, "its leaving is noticed", |gateway| gateway.tally().peers == 0);
    controller.leaves.store(false, SeqCst);
    send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
}

/// Sends at the rate of a station until the connection is closed; returns how many packages were sent and how many lost
/// meanwhile.
fn send_until_disconnected(gateway: &mut Rtde) -> (u64, u64) {
    let (begun, before) = (Instant::now(), gateway.tally());
    while gateway.tally().peers == 1 {
        gateway.send(&Ok(reading(state())));
        assert!(begun.elapsed() < PATIENCE, "it is never left: {}", gateway.tally());
        std::thread::sleep(Duration::from_millis(2));
    }
    (gateway.tally().sent - before.sent, gateway.tally().lost - before.lost)
}

/// Repeats a test until more than one package was dropped before the gateway disconnected: a busy machine may stall
/// between the last waiting package and the end.
fn until_dropped(test: impl Fn() -> u64) {
    assert!((0..10).any(|_| test() > 1), "none of ten controllers was left with packages dropped");
}

#[test]
fn a_controller_that_hangs_is_left_before_its_buffers_are_full_of_what_is_old() {
    until_dropped(|| {
        let (controller, robot) = start();
        controller.hangs.store(true, SeqCst);
        let mut gateway = Rtde::new(&config(robot, "")).unwrap();
        send_until(&mut gateway, "it started", |gateway| gateway.tally().peers == 1);
        let (sent, lost) = send_until_disconnected(&mut gateway);
        assert!(sent < 500, "{sent} packages wait for it, {lost} were dropped");
        assert_eq!(controller.packages.load(SeqCst), 0);
        controller.hangs.store(false, SeqCst);
        send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
        lost
    });
}

#[test]
fn a_controller_without_a_sign_of_life_is_left() {
    until_dropped(|| {
        let (controller, robot) = start();
        let mut gateway = Rtde::new(&config(robot, "")).unwrap();
        send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
        let is_sending = |_: &Rtde| controller.packages_sent.load(SeqCst) > 10;
        send_until(&mut gateway, "the controller sends data", is_sending);
        controller.is_mute.store(true, SeqCst);
        let (_, lost) = send_until_disconnected(&mut gateway);
        controller.is_mute.store(false, SeqCst);
        send_until_accepted(&mut gateway, &controller, &Ok(reading(state())));
        lost
    });
}

/// A peer that keeps sending `chatter`, a few bytes at a time, and never the expected answer.
fn chatterer(chatter: Vec<u8>) -> (Arc<AtomicU64>, SocketAddr) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let robot = listener.local_addr().unwrap();
    let clients = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&clients);
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            count.fetch_add(1, SeqCst);
            let chatter = chatter.clone();
            std::thread::spawn(move || {
                while chatter.chunks(4).all(|bytes| stream.write_all(bytes).is_ok()) {
                    std::thread::sleep(Duration::from_millis(20));
                }
            });
        }
    });
    (clients, robot)
}

#[test]
fn a_peer_that_talks_but_never_answers_is_left_and_dialled_again() {
    let text = package(b'M', &text("still busy", "RTDE", 2));
    // A package that never ends, although each of its bytes arrives in time.
    let endless = [&[0xff, 0xff, b'V'][..], &[0; 61]].concat();
    let talks = [text, endless].map(chatterer);
    std::thread::scope(|scope| {
        for (clients, robot) in &talks {
            scope.spawn(move || {
                let mut gateway = Rtde::new(&config(*robot, "")).unwrap();
                send_until(&mut gateway, "it is dialled again", |_| clients.load(SeqCst) >= 2);
                assert_eq!((gateway.tally().sent, gateway.tally().peers), (0, 0));
            });
        }
    });
}

#[test]
fn registers_that_cannot_be_are_refused_by_name() {
    for (registers, why) in [
        ("{ sequence = 24, state = 23 }", "24 to 47"),
        ("{ sequence = 24, state = 48 }", "24 to 47"),
        ("{ sequence = 24, state = 24 }", "both in input_int_register_24"),
        ("{ sequence = 24, age_s = 24 }", "state is missing"),
        ("{ state = 24 }", "sequence is missing"),
        ("{ sequence = 24, state = 25, weight = 26 }", "no value \"weight\""),
    ] {
        let config = config("127.0.0.1:1".parse().unwrap(), &format!("registers = {registers}"));
        let error = Rtde::new(&config).unwrap_err().to_string();
        assert!(error.contains(why), "{registers}: {error}");
    }
}
