//! `equipoise-outlet-opcua`: gateway for a station's states to PLCs and MES.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use equipoise_outlet_opcua::OpcUa;
use equipoise_outlets::process::{Made, main_of, no_section};

fn main() -> ExitCode {
    main_of("opcua", |file| {
        let config = file.outlets.opcua.as_ref().ok_or_else(|| no_section("opcua"))?;
        // Without its server the process is useless: it exits, and the service manager restarts it.
        let on_end = |what: String| {
            tracing::error!("the server has ended: {what}");
            std::process::exit(1);
        };
        let outlet = OpcUa::new(&file.station, config, on_end)?;
        tracing::info!("serving at opc.tcp://{}/", outlet.address());
        Ok(Made { outlet: Box::new(outlet), rate_hz: config.rate_hz })
    })
}
