//! The simulator's RTDE controller (`equipoise_simulator::cobot::rtde`), without an arm.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;

pub(crate) use equipoise_simulator::cobot::rtde::{Controller, package, serve, text};

/// Starts a controller on a free port.
pub(crate) fn start() -> (Arc<Controller>, SocketAddr) {
    equipoise_simulator::cobot::rtde::start().unwrap()
}

/// Not a test: with `EQUIPOISE_RTDE_CONTROLLER` set to an address, serves a controller that prints its registers until
/// it is killed.
#[test]
fn serves() {
    let Some(address) = std::env::var_os("EQUIPOISE_RTDE_CONTROLLER") else { return };
    let controller = Arc::new(Controller::default());
    serve(Arc::clone(&controller), TcpListener::bind(address.to_str().unwrap()).unwrap());
    loop {
        let inputs = controller.inputs.lock().unwrap().clone();
        let words: Vec<_> = inputs.iter().map(|(name, value)| format!("{name}={value}")).collect();
        println!("packages={} {}", controller.packages.load(Ordering::SeqCst), words.join(" "));
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
}
