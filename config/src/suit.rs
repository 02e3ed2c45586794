//! `[suit]`: the source of suit samples.

use std::net::SocketAddr;

use equipoise_adapters::source::{MvnSettings, MvnTransport, SourceError};
use equipoise_adapters::suit::{SuitSettings, UpAxis};
use equipoise_core::cycle::Settings;
use serde::{Deserialize, Serialize};

use super::latencies::{LATENCY_MAX_MS, span_ns};
use super::method::{Checked, between};

/// `[suit]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuitConfig {
    /// Source of samples.
    pub source: SuitSourceKind,
    /// Listening address; MVN's default port is 9763.
    #[serde(default = "mvn_default")]
    pub listen: SocketAddr,
    /// MVN character of the subject.
    #[serde(default)]
    pub avatar: u8,
    /// Whether its position drifts; by default `drifts`, or `absolute` for motion and forces in one CSV.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<SuitPosition>,
    /// 1-σ per axis of the misalignment between each sensor and its segment, degrees.
    #[serde(default = "misalignment_default")]
    pub misalignment_deg: f64,
    /// 1-σ per axis of the drift of each segment's orientation over minutes, degrees.
    #[serde(default = "orientation_drift_default")]
    #[serde(alias = "wander_deg")]
    pub orientation_drift_deg: f64,
    /// Constant delay from a pose to its datagram (fusion, radio), ms: subtracted from every sample time.
    #[serde(default)]
    pub latency_ms: f64,
    /// Accept datagrams from other machines; otherwise only from this machine.
    #[serde(default)]
    pub allow_remote: bool,
    /// Upward axis of MVN's pose quaternions (type 02).
    #[serde(default)]
    #[serde(alias = "up")]
    pub up_axis: Up,
    /// Other suits on the same port, each for another station of this computer with `suit.source = "external"`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(alias = "others")]
    pub forwarded: Vec<ForwardedSuit>,
}

/// One of `suit.forwarded`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForwardedSuit {
    /// MVN character.
    pub avatar: u8,
    /// Station that receives the suit's samples.
    pub station: String,
}

/// Upward axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Up {
    /// X forward, Y left, Z up: MVN's default.
    #[default]
    Z,
    /// X left, Y up, Z forward.
    Y,
}

impl Up {
    /// The adapter's setting.
    pub fn axis(self) -> UpAxis {
        match self {
            Up::Z => UpAxis::Z,
            Up::Y => UpAxis::Y,
        }
    }
}

/// Quality of the suit's position in its world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SuitPosition {
    /// It drifts by centimetres, as with inertial suits: the standing feet are held to the floor.
    Drifts,
    /// It is measured in the plate's world, as with optical markers.
    Absolute,
}

/// Source of suit samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SuitSourceKind {
    /// MVN's network streamer over UDP.
    MvnUdp,
    /// MVN's network streamer over TCP; it connects to us.
    MvnTcp,
    /// Another process publishes them: `equipoise adapter suit`.
    External,
}

impl SuitSourceKind {
    /// Transport of MVN's datagrams; `None` for another source.
    pub fn transport(self) -> Option<MvnTransport> {
        match self {
            SuitSourceKind::MvnUdp => Some(MvnTransport::Udp),
            SuitSourceKind::MvnTcp => Some(MvnTransport::Tcp),
            SuitSourceKind::External => None,
        }
    }
}

fn misalignment_default() -> f64 {
    0.6
}

fn orientation_drift_default() -> f64 {
    0.3
}

impl SuitConfig {
    /// Character, vertical axis and constant delay of the adapter.
    pub fn settings(&self) -> SuitSettings {
        SuitSettings {
            avatar: self.avatar,
            up: self.up_axis.axis(),
            latency_ns: self.latency_ns(),
            ..SuitSettings::default()
        }
    }

    /// Transport, address and character of the adapter.
    ///
    /// # Errors
    /// The samples come from another process.
    pub fn mvn_settings(&self) -> Result<MvnSettings, SourceError> {
        let transport = self.source.transport().ok_or_else(|| {
            SourceError::Unusable("suit.source is \"external\": another process publishes it".to_owned())
        })?;
        Ok(MvnSettings {
            transport,
            listen: self.listen,
            allow_remote: self.allow_remote,
            suit: self.settings(),
            others: self.forwarded.iter().map(|other| other.avatar).collect(),
            ..MvnSettings::default()
        })
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.suit_misalignment_rad = self.misalignment_deg.to_radians();
        settings.suit_drift_rad = self.orientation_drift_deg.to_radians();
        settings.suit_latency_ns = self.latency_ns();
    }

    /// `latency_ms` in ns.
    pub fn latency_ns(&self) -> u64 {
        span_ns(self.latency_ms)
    }

    pub(super) fn check(&self) -> Checked {
        between("suit.latency_ms", self.latency_ms, 0.0, LATENCY_MAX_MS)?;
        between("suit.misalignment_deg", self.misalignment_deg, 0.0, 45.0)?;
        between("suit.orientation_drift_deg", self.orientation_drift_deg, 0.0, 45.0)
    }

    /// Checks the forwarded suits.
    pub(super) fn check_others(&self, station: &str) -> Checked {
        let wrong = |what: String| Err(("suit.forwarded", what));
        if !self.forwarded.is_empty() && self.source == SuitSourceKind::External {
            return wrong(
                "with source = \"external\" no datagrams come here; give it to the adapter's file".to_owned(),
            );
        }
        let (mut avatars, mut stations) = (vec![self.avatar], vec![station]);
        for ForwardedSuit { avatar, station } in &self.forwarded {
            if !super::name_is_plain(station) {
                return wrong(format!("station {station:?}: use 1 to 32 letters, digits, '-' or '_'"));
            }
            if avatars.contains(avatar) {
                return wrong(format!(
                    "avatar {avatar} is named twice; suit.avatar = {} is this station's",
                    self.avatar
                ));
            }
            if stations.contains(&station.as_str()) {
                return wrong(format!(
                    "station {station:?} gets two workers; each needs a station of its own"
                ));
            }
            avatars.push(*avatar);
            stations.push(station);
        }
        Ok(())
    }
}

fn mvn_default() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 9763))
}
