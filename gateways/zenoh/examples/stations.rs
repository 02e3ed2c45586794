//! Many stations' gateways in one process, without daemons, to test the load of a router and a dashboard:
//! `stations ENDPOINT COUNT RATE_HZ SECONDS`.

use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use bytemuck::Zeroable;
use equipoise_client::Reading;
use equipoise_core::body::JOINTS;
use equipoise_core::message::State;
use equipoise_gateway_zenoh::ZenohGateway;
use equipoise_gateways::config::ZenohConfig;
use equipoise_gateways::drive::Schedule;
use equipoise_gateways::{Gateway, Latest};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [endpoint, count, rate_hz, seconds] = arguments.as_slice() else {
        anyhow::bail!("usage: stations ENDPOINT COUNT RATE_HZ SECONDS");
    };
    let (count, rate_hz): (u32, f64) = (count.parse().context("COUNT")?, rate_hz.parse().context("RATE_HZ")?);
    let config = ZenohConfig {
        connect: vec![endpoint.clone()],
        listen: Vec::new(),
        rate_hz,
        json_rate_hz: rate_hz,
        ros_domain_id: 0,
        body: false,
        file: None,
    };
    // Each station has a session and a link of its own, as if on separate machines.
    let mut gateways = std::thread::scope(|scope| {
        let open = |number| ZenohGateway::open(&format!("simulated-{number}"), &config);
        let opening: Vec<_> = (1..=count).map(|number| scope.spawn(move || open(number))).collect();
        let joined =
            opening.into_iter().map(|thread| thread.join().map_err(|_| anyhow!("a thread has failed"))?);
        joined.collect::<anyhow::Result<Vec<_>>>()
    })?;
    let end = Instant::now() + Duration::from_secs_f64(seconds.parse().context("SECONDS")?);
    // Stations take turns: each tick publishes one station.
    let mut beats = Schedule::new(rate_hz * f64::from(count), Instant::now());
    for beat in 0.. {
        std::thread::sleep(beats.wait(Instant::now()));
        if Instant::now() >= end {
            break;
        }
        gateways[beat % count as usize].send(&full(beat as u64));
        beats.done(Instant::now());
    }
    println!("{}", gateways.iter().map(|gateway| gateway.tally().sent).sum::<u64>());
    Ok(())
}

/// The longest message: all values valid, as at a station that is identified and loaded.
fn full(cycle: u64) -> Latest {
    let state = State { cycle, phase: 2, torque_limit_nm: [100.0; JOINTS], ..State::zeroed() };
    let sample_age_ns = Some(0);
    Ok(Reading {
        state,
        received_ns: 0,
        age_ns: 0,
        sample_age_ns,
        missed: 0,
        restarted: false,
        daemon_life: 1,
        is_new: true,
    })
}
