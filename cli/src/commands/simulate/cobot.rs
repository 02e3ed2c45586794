//! A simulated cobot with an RTDE server, in a process of its own.

use std::net::SocketAddr;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_simulator::cobot::program::CobotSettings;
use equipoise_simulator::cobot::server::Cobot;

use super::super::{Outcome, stop_on_signals};

/// How often the motion is printed.
const PRINT_EVERY: Duration = Duration::from_secs(1);

/// Options of the simulated cobot.
#[derive(Debug, clap::Args)]
pub(super) struct CobotArguments {
    /// Serve a simulated UR10e with the program of handover.script there by RTDE, instead of a person
    #[arg(long, value_name = "ADDRESS", conflicts_with_all = ["play", "ground", "plate", "suit_tcp"])]
    cobot: Option<SocketAddr>,
    /// Position of its base in the station's world, m
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "1.15,0,0.75",
        requires = "cobot",
        allow_hyphen_values = true
    )]
    cobot_base: String,
    /// Turn of its base about the vertical, degrees; its −X axis points to the worker
    #[arg(
        long,
        value_name = "DEGREES",
        default_value_t = 0.0,
        requires = "cobot",
        allow_hyphen_values = true
    )]
    cobot_yaw: f64,
}

impl CobotArguments {
    /// Address of the RTDE server.
    pub(super) fn address(&self) -> Option<SocketAddr> {
        self.cobot
    }
}

pub(super) fn run(
    arguments: &CobotArguments,
    address: SocketAddr,
    seconds: Option<f64>,
) -> anyhow::Result<Outcome> {
    let numbers: Vec<f64> =
        arguments.cobot_base.split(',').map(|part| part.trim().parse().unwrap_or(f64::NAN)).collect();
    let base_m = <[f64; 3]>::try_from(numbers).ok().filter(|numbers| numbers.iter().all(|m| m.is_finite()));
    let Some(base_m) = base_m else {
        bail!("--cobot-base {} is not three numbers, such as 1.15,0,0.75", arguments.cobot_base);
    };
    if !arguments.cobot_yaw.is_finite() {
        bail!("--cobot-yaw {} is not an angle in degrees, such as 90", arguments.cobot_yaw);
    }
    let settings = CobotSettings::at(base_m, arguments.cobot_yaw.to_radians());
    let stop = stop_on_signals()?;
    let cobot = Cobot::start(settings, address).with_context(|| format!("the cobot at {address}"))?;
    println!("cobot: RTDE at {}; {}", cobot.address(), super::ENDS);
    let (started, mut printed) = (Instant::now(), Instant::now());
    while !stop.load(Ordering::Relaxed)
        && seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds)
    {
        if printed.elapsed() >= PRINT_EVERY {
            printed += PRINT_EVERY;
            let now = cobot.snapshot();
            let [x, y, z] = now.tcp_m.into();
            println!("{:?} tcp_m={x:.3},{y:.3},{z:.3} tcp_m_per_s={:.3}", now.activity, now.tcp_m_per_s);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    cobot.stop()?;
    Ok(Outcome::Done)
}
