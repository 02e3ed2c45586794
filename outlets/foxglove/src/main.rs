//! `equipoise-outlet-foxglove`: the program.
#![forbid(unsafe_code)]

use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

use equipoise_outlet_foxglove::FoxgloveOutlet;
use equipoise_outlets::process::{Made, main_of, no_section};

/// If the server ends, the process exits with an error instead of running on without it, so that the service manager
/// restarts it.
fn main() -> ExitCode {
    let ended = Arc::new(OnceLock::new());
    let tell = Arc::clone(&ended);
    let on_end = move |why: String| {
        let _ = tell.set(why);
        // SIGTERM takes the usual way out: the publishing loop returns and releases its resources on the bus.
        let _ = signal_hook::low_level::raise(signal_hook::consts::SIGTERM);
    };
    let code = main_of("foxglove", |file| {
        let config = file.outlets.foxglove.as_ref().ok_or_else(|| no_section("foxglove"))?;
        let outlet = FoxgloveOutlet::start(&file.station, config.listen, on_end)?;
        Ok(Made { outlet: Box::new(outlet), rate_hz: config.rate_hz })
    });
    match ended.get() {
        Some(why) => {
            eprintln!("equipoise-outlet-foxglove: {why}");
            ExitCode::FAILURE
        }
        None => code,
    }
}
