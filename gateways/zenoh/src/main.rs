//! `equipoise-gateway-zenoh --config FILE`; `equipoise gateway zenoh` starts it.

use std::process::ExitCode;

use equipoise_gateway_zenoh::ZenohGateway;
use equipoise_gateways::process::{ScheduledGateway, main_of, no_section};

fn main() -> ExitCode {
    main_of("zenoh", |file| {
        let config = file.gateways.zenoh.as_ref().ok_or_else(|| no_section("zenoh"))?;
        let gateway = ZenohGateway::open(&file.station, config)?;
        Ok(ScheduledGateway { gateway: Box::new(gateway), rate_hz: config.rate_hz })
    })
}
