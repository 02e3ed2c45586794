//! `equipoise-gateway-foxglove`: the program.
#![forbid(unsafe_code)]

use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

use equipoise_gateway_foxglove::FoxgloveGateway;
use equipoise_gateways::process::{ScheduledGateway, main_of, no_section};

/// If the server ends, the process exits with an error instead of running on without it, so that the service manager
/// restarts it.
fn main() -> ExitCode {
    let ended = Arc::new(OnceLock::new());
    let set_reason = Arc::clone(&ended);
    let on_end = move |why: String| {
        let _ = set_reason.set(why);
        // SIGTERM ends the program normally: the publishing loop returns and releases its resources on the bus.
        let _ = signal_hook::low_level::raise(signal_hook::consts::SIGTERM);
    };
    let code = main_of("foxglove", |file| {
        let config = file.gateways.foxglove.as_ref().ok_or_else(|| no_section("foxglove"))?;
        let gateway = FoxgloveGateway::start(&file.station, config.listen, on_end)?;
        Ok(ScheduledGateway { gateway: Box::new(gateway), rate_hz: config.rate_hz })
    });
    match ended.get() {
        Some(why) => {
            eprintln!("equipoise-gateway-foxglove: {why}");
            ExitCode::FAILURE
        }
        None => code,
    }
}
