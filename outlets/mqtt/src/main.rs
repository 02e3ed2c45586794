//! `equipoise-outlet-mqtt`: gateway for levels and counts of a station to plant dashboards.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use equipoise_outlet_mqtt::Mqtt;
use equipoise_outlets::process::{Made, main_of, no_section};

fn main() -> ExitCode {
    main_of("mqtt", |file| {
        let config = file.outlets.mqtt.as_ref().ok_or_else(|| no_section("mqtt"))?;
        let outlet = Mqtt::new(&file.station, config)?;
        Ok(Made { outlet: Box::new(outlet), rate_hz: config.rate_hz })
    })
}
