//! `equipoise-outlet-foxglove`: the program.
#![forbid(unsafe_code)]

use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

use equipoise_outlet_foxglove::FoxgloveOutlet;
use equipoise_outlets::process::{Made, main_of, no_section};

/// Whoever watches the program starts it again; until then it tells nobody that it serves.
fn main() -> ExitCode {
    let ended = Arc::new(OnceLock::new());
    let tell = Arc::clone(&ended);
    let on_end = move |why: String| {
        let _ = tell.set(why);
        // The way of every end: the loop of beats leaves, and takes the bus's things along.
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
