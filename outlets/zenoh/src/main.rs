//! `equipoise-outlet-zenoh --config FILE`; `equipoise outlet zenoh` starts it.

use std::process::ExitCode;

use equipoise_outlet_zenoh::ZenohOutlet;
use equipoise_outlets::process::{Made, main_of, no_section};

fn main() -> ExitCode {
    main_of("zenoh", |file| {
        let config = file.outlets.zenoh.as_ref().ok_or_else(|| no_section("zenoh"))?;
        let outlet = ZenohOutlet::open(&file.station, config)?;
        Ok(Made { outlet: Box::new(outlet), rate_hz: config.rate_hz })
    })
}
