//! `[suit]`, `[ground]`, `[ground.frame]`: where the samples come from.

use std::net::SocketAddr;

use equipoise_core::cycle::Settings;
use serde::{Deserialize, Serialize};

use super::method::{Checked, between};

/// No stream is dated back by more, ms.
const LATENCY_MAX_MS: f64 = 1000.0;
/// The loop keeps the plate's last half second (at 1 kHz) for a suit that is late …
const SUIT_LATER_MAX_MS: f64 = 400.0;
/// … and some 60 ms of the suit (at 240 Hz) for a plate that is.
const GROUND_LATER_MAX_MS: f64 = 50.0;

/// `[suit]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuitConfig {
    /// How samples come in.
    pub source: SuitSourceKind,
    /// Address to listen on; MVN's default port is 9763.
    #[serde(default = "mvn_default")]
    pub listen: SocketAddr,
    /// Which MVN character is the worker.
    #[serde(default)]
    pub avatar: u8,
    /// Whether its position drifts; `drifts` where not given, `absolute` for motion and forces in one CSV.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<SuitPosition>,
    /// 1-σ per axis of how far each sensor's axes are off its segment's, degrees.
    #[serde(default = "misalignment_default")]
    pub misalignment_deg: f64,
    /// 1-σ per axis of how each segment's orientation wanders over minutes, degrees.
    #[serde(default = "wander_default")]
    pub wander_deg: f64,
    /// Constant delay from a pose to its datagram (fusion, radio), ms: taken off every sample time.
    #[serde(default)]
    pub latency_ms: f64,
    /// Take datagrams from other machines; without it only this machine may send.
    #[serde(default)]
    pub allow_remote: bool,
}

/// What the suit's position in its world is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SuitPosition {
    /// It wanders by centimetres, as with inertial suits: the standing feet are held to the floor.
    Drifts,
    /// It is measured in the plate's world, as with optical markers.
    Absolute,
}

/// How suit samples come in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SuitSourceKind {
    /// MVN's network streamer over UDP.
    MvnUdp,
    /// Another process publishes them: `equipoise adapter suit`.
    External,
}

fn misalignment_default() -> f64 {
    0.6
}

fn wander_default() -> f64 {
    0.3
}

impl SuitConfig {
    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.suit_misalignment_rad = self.misalignment_deg.to_radians();
        settings.suit_wander_rad = self.wander_deg.to_radians();
        settings.suit_latency_ns = self.latency_ns();
    }

    /// `latency_ms` as a span.
    pub fn latency_ns(&self) -> u64 {
        span_ns(self.latency_ms)
    }

    pub(super) fn check(&self) -> Checked {
        between("suit.latency_ms", self.latency_ms, 0.0, LATENCY_MAX_MS)?;
        between("suit.misalignment_deg", self.misalignment_deg, 0.0, 45.0)?;
        between("suit.wander_deg", self.wander_deg, 0.0, 45.0)
    }
}

fn mvn_default() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 9763))
}

/// `[ground]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundConfig {
    /// How samples come in.
    pub source: GroundSourceKind,
    /// The device.
    #[serde(default = "rdt_default")]
    pub address: SocketAddr,
    /// The device's counts per newton (its page `netftapi2.xml`, `cfgcpf`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts_per_newton: Option<f64>,
    /// The device's counts per newton metre (`cfgcpt`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts_per_newton_metre: Option<f64>,
    /// Whether the device reports the force on itself or on the person.
    #[serde(default)]
    pub measures: Measures,
    /// Constant delay from a force to its datagram (the device's filter), ms: taken off every sample time.
    #[serde(default)]
    pub latency_ms: f64,
    /// The plate in the suit's world.
    #[serde(default)]
    pub frame: FrameConfig,
}

/// How ground samples come in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundSourceKind {
    /// ATI's raw data transfer over UDP (Net F/T, Axia).
    AtiRdt,
    /// Another process publishes them: `equipoise adapter ground`.
    External,
}

/// Whose force is measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measures {
    /// The force on the sensor.
    #[default]
    Action,
    /// The force on the person.
    Reaction,
}

fn rdt_default() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 49152))
}

/// `[ground.frame]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FrameConfig {
    /// The sensor's origin in the suit's world, m.
    pub origin_m: [f64; 3],
    /// How far the plate is turned to the left, degrees.
    pub yaw_deg: f64,
    /// Walking surface above the sensor's origin, m.
    pub surface_height_m: f64,
}

/// Milliseconds as a span; a value that was checked is neither negative nor too large.
fn span_ns(milliseconds: f64) -> u64 {
    (milliseconds * 1e6).round() as u64
}

/// What the alignment of both streams can bridge.
pub(super) fn check_latencies(suit: &SuitConfig, ground: &GroundConfig) -> Checked {
    let later_ms = suit.latency_ms - ground.latency_ms;
    if (-GROUND_LATER_MAX_MS..=SUIT_LATER_MAX_MS).contains(&later_ms) {
        return Ok(());
    }
    let field = if later_ms > 0.0 { "suit.latency_ms" } else { "ground.latency_ms" };
    Err((
        field,
        format!(
            "the streams are {:.0} ms apart; the suit may be {SUIT_LATER_MAX_MS:.0} ms later than the ground, the \
             ground {GROUND_LATER_MAX_MS:.0} ms later than the suit",
            later_ms.abs()
        ),
    ))
}

impl GroundConfig {
    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.ground_latency_ns = self.latency_ns();
    }

    /// `latency_ms` as a span.
    pub fn latency_ns(&self) -> u64 {
        span_ns(self.latency_ms)
    }

    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        if self.source == GroundSourceKind::AtiRdt {
            for (field, counts) in [
                ("ground.counts_per_newton", self.counts_per_newton),
                ("ground.counts_per_newton_metre", self.counts_per_newton_metre),
            ] {
                match counts {
                    None => {
                        return Err((
                            field,
                            "must be given for an ATI device; its page netftapi2.xml shows it as cfgcpf and cfgcpt"
                                .to_owned(),
                        ));
                    }
                    Some(counts) if counts > 0.0 && counts.is_finite() => {}
                    Some(counts) => return Err((field, format!("{counts} is not a positive number"))),
                }
            }
        }
        between("ground.latency_ms", self.latency_ms, 0.0, LATENCY_MAX_MS)?;
        let frame = &self.frame;
        let numbers = frame.origin_m.iter().chain([&frame.yaw_deg, &frame.surface_height_m]);
        if numbers.clone().any(|value| !value.is_finite()) {
            return Err(("ground.frame", "every number must be finite".to_owned()));
        }
        if frame.origin_m.iter().any(|metres| metres.abs() > 100.0) || frame.surface_height_m.abs() > 2.0 {
            return Err(("ground.frame", "metres are expected; a plate 100 m away is a mistake".to_owned()));
        }
        Ok(())
    }
}
