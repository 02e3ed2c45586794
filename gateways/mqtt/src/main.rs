//! `equipoise-gateway-mqtt`: gateway for levels and counts of a station to plant dashboards.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use equipoise_gateway_mqtt::Mqtt;
use equipoise_gateways::process::{ScheduledGateway, main_of, no_section};

fn main() -> ExitCode {
    main_of("mqtt", |file| {
        let config = file.gateways.mqtt.as_ref().ok_or_else(|| no_section("mqtt"))?;
        let gateway = Mqtt::new(&file.station, config)?;
        Ok(ScheduledGateway { gateway: Box::new(gateway), rate_hz: config.rate_hz })
    })
}
