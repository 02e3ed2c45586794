//! `equipoise-gateway-opcua`: gateway for a station's states to PLCs and MES.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use equipoise_gateway_opcua::OpcUa;
use equipoise_gateways::process::{ScheduledGateway, main_of, no_section};

fn main() -> ExitCode {
    main_of("opcua", |file| {
        let config = file.gateways.opcua.as_ref().ok_or_else(|| no_section("opcua"))?;
        // Without its server the process is useless: it exits, and the service manager restarts it.
        let on_end = |what: String| {
            tracing::error!("the server has ended: {what}");
            std::process::exit(1);
        };
        let gateway = OpcUa::new(&file.station, config, on_end)?;
        tracing::info!("serving at opc.tcp://{}/", gateway.address());
        Ok(ScheduledGateway { gateway: Box::new(gateway), rate_hz: config.rate_hz })
    })
}
