//! Any device under the simulated person's feet, at any place.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_simulator::devices::Device;
use equipoise_simulator::devices::amti::Amti;
use equipoise_simulator::devices::ati_rdt::AtiRdt;
use equipoise_simulator::devices::binary::Binary;
use equipoise_simulator::devices::bota::Bota;
use equipoise_simulator::devices::labamp::LabAmp;
use equipoise_simulator::devices::line::Line;
use equipoise_simulator::devices::load::{Ground, Mounting};
use equipoise_simulator::devices::lsl::Lsl;
use equipoise_simulator::devices::moticon::Moticon;
use equipoise_simulator::devices::pair::Pair;
use equipoise_simulator::devices::port::Port;
use equipoise_simulator::devices::qtm::Qtm;
use equipoise_simulator::devices::running::{Load, Pace, Running};
use equipoise_simulator::devices::serial::SerialPort;
use equipoise_simulator::devices::tcp::TcpPort;
use equipoise_simulator::devices::tec_gihan::TecGihan;
use equipoise_simulator::devices::text::Text;
use equipoise_simulator::devices::udp::UdpPort;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::wires;
use equipoise_simulator::wires::text::Style;

/// What measures the force under the feet, by the names of `ground.source`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Kind {
    AtiRdt,
    AmtiSerial,
    BotaSerial,
    KistlerLabamp,
    TecGihan,
    MoticonUdp,
    Qtm,
    Lsl,
    Text,
    Binary,
}

/// Half the distance of two plates' middles, m.
const HALF_APART_M: f64 = 0.2;
/// Thickness of a plate, m, if the manufacturer states one.
const THICK_M: f64 = 0.04;
/// Samples a second of devices that let their owner choose.
const RATE_HZ: f64 = 200.0;
/// Length and width of the insoles, m.
const INSOLE_M: [f64; 2] = [0.28, 0.095];

/// A place as people write it.
#[derive(Debug, Clone, PartialEq)]
enum Site {
    Udp(SocketAddr),
    Tcp(SocketAddr),
    Serial(PathBuf),
}

impl Kind {
    /// Default address or port.
    fn default_site(self) -> Site {
        let local = |port| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
        match self {
            Kind::AtiRdt => Site::Udp(local(wires::ati_rdt::DEFAULT_PORT)),
            Kind::KistlerLabamp => Site::Tcp(local(8080)),
            Kind::MoticonUdp => Site::Udp(local(8888)),
            Kind::Qtm => Site::Tcp(local(wires::qtm::PORT)),
            Kind::Lsl => Site::Tcp(local(0)),
            Kind::AmtiSerial | Kind::BotaSerial | Kind::TecGihan | Kind::Text | Kind::Binary => {
                Site::Serial(std::env::temp_dir().join("equipoise-plate"))
            }
        }
    }

    /// Z points down, by the maker's own formulae.
    fn z_down(self) -> bool {
        matches!(self, Kind::AmtiSerial | Kind::KistlerLabamp | Kind::TecGihan | Kind::Qtm)
    }

    fn device(self, site: &Site, mounting: Mounting, seed: u64) -> anyhow::Result<Box<dyn Device>> {
        let line = || Ok::<Line, anyhow::Error>(Line::new(site.port()?, seed));
        Ok(match (self, site) {
            (Kind::AtiRdt, Site::Udp(address)) => {
                let page = SocketAddr::new(address.ip(), 0);
                let family = wires::ati_rdt::Family::NetFt;
                Box::new(AtiRdt::bind(*address, page, mounting, family, 1000.0, seed)?)
            }
            (Kind::KistlerLabamp, Site::Tcp(address)) => {
                Box::new(LabAmp::bind(*address, mounting, 62_500.0, seed)?)
            }
            (Kind::Lsl, Site::Tcp(address)) => {
                Box::new(Lsl::bind("Simulated plate", *address, mounting, RATE_HZ, true, seed)?)
            }
            (Kind::MoticonUdp, Site::Udp(_)) => {
                Box::new(Moticon::new(line()?, &wires::moticon::ALL, 100.0, INSOLE_M))
            }
            (Kind::Qtm, Site::Tcp(_)) => Box::new(Qtm::new(line()?, 1, mounting)),
            (Kind::AmtiSerial, Site::Serial(_)) => Box::new(Amti::new(line()?, 1, mounting)),
            (Kind::BotaSerial, Site::Serial(_)) => Box::new(Bota::new(line()?, mounting)),
            (Kind::TecGihan, Site::Serial(_)) => Box::new(TecGihan::new(line()?, 1, mounting)),
            (Kind::Text, _) => Box::new(Text::new(line()?, Style::default(), RATE_HZ, mounting)),
            (Kind::Binary, _) => Box::new(Binary::new(line()?, RATE_HZ, mounting)),
            (_, site) => bail!("--ground-address: this device is not to be had at {site}"),
        })
    }
}

impl core::fmt::Display for Site {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Site::Udp(address) => write!(f, "udp:{address}"),
            Site::Tcp(address) => write!(f, "tcp:{address}"),
            Site::Serial(name) => write!(f, "the serial line {}", name.display()),
        }
    }
}

impl Site {
    /// As it is written; an address alone means what the device usually has.
    fn parse(text: &str, kind: Kind) -> anyhow::Result<Site> {
        let address = |text: &str| {
            text.parse()
                .with_context(|| format!("--ground-address: {text} is no address such as 127.0.0.1:8888"))
        };
        if let Some(rest) = text.strip_prefix("udp:") {
            return Ok(Site::Udp(address(rest)?));
        }
        if let Some(rest) = text.strip_prefix("tcp:") {
            return Ok(Site::Tcp(address(rest)?));
        }
        match (text.parse(), kind.default_site()) {
            (Ok(target), Site::Udp(_)) => Ok(Site::Udp(target)),
            (Ok(target), Site::Tcp(_) | Site::Serial(_)) => Ok(Site::Tcp(target)),
            // A daemon in another working directory could not resolve a relative name.
            (Err(_), _) => Ok(Site::Serial(std::path::absolute(text)?)),
        }
    }

    /// That of the second device.
    fn next(&self) -> Site {
        let one_on = |address: &SocketAddr| match address.port() {
            // Port 0 again selects any free port.
            0 => *address,
            port => SocketAddr::new(address.ip(), port.wrapping_add(1)),
        };
        match self {
            Site::Udp(address) => Site::Udp(one_on(address)),
            Site::Tcp(address) => Site::Tcp(one_on(address)),
            Site::Serial(name) => {
                let mut name = name.clone().into_os_string();
                name.push("-2");
                Site::Serial(name.into())
            }
        }
    }

    fn port(&self) -> anyhow::Result<Box<dyn Port>> {
        Ok(match self {
            Site::Udp(address) => Box::new(UdpPort::to(*address)?),
            Site::Tcp(address) => Box::new(TcpPort::bind(*address)?),
            Site::Serial(name) => Box::new(serial(name)?),
        })
    }
}

fn serial(name: &Path) -> anyhow::Result<SerialPort> {
    // The device itself defines its rate, so any value is suitable.
    SerialPort::new(name, 9600).with_context(|| {
        format!("{}: the line's name cannot be made; is another simulator there?", name.display())
    })
}

/// Starts the device, or two.
pub(super) fn start(
    kind: Kind,
    place: Option<&str>,
    two: bool,
    load: Load,
    pace: Pace,
) -> anyhow::Result<Running> {
    let site = place.map_or_else(|| Ok(kind.default_site()), |text| Site::parse(text, kind))?;
    let mounting = |y_m: f64| {
        let plate = Plate { origin_m: [0.0, y_m, -THICK_M], surface_height_m: THICK_M, ..Plate::default() };
        Mounting { plate, z_down: kind.z_down(), reaction: false }
    };
    let made = |site: &Site, mounting, seed| {
        kind.device(site, mounting, seed).with_context(|| format!("the device at {site}"))
    };
    let (device, ground) = if two {
        if kind == Kind::MoticonUdp {
            bail!("--two: a pair of insoles is under both feet already");
        }
        let both = [HALF_APART_M, -HALF_APART_M].map(mounting);
        let [left, right] = both;
        let left = made(&site, left, pace.seed)?;
        let right = made(&site.next(), right, pace.seed.wrapping_add(1))?;
        (Box::new(Pair::new(left, right)) as Box<dyn Device>, Ground::Two(both))
    } else {
        let mounting = mounting(0.0);
        (made(&site, mounting, pace.seed)?, Ground::One(mounting))
    };
    Ok(Running::start(device, ground, load, pace)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_is_an_address_of_its_kind_or_a_name() {
        let parsed = |text: &str, kind| Site::parse(text, kind).unwrap();
        let target: SocketAddr = "127.0.0.1:9000".parse().unwrap();
        assert_eq!(parsed("127.0.0.1:9000", Kind::AtiRdt), Site::Udp(target));
        assert_eq!(parsed("127.0.0.1:9000", Kind::Qtm), Site::Tcp(target));
        assert_eq!(parsed("udp:127.0.0.1:9000", Kind::Text), Site::Udp(target));
        assert_eq!(parsed("/tmp/plate", Kind::Text), Site::Serial("/tmp/plate".into()));
        assert_eq!(parsed("/tmp/plate", Kind::Text).next(), Site::Serial("/tmp/plate-2".into()));
        assert!(Site::parse("udp:nowhere", Kind::Text).is_err());
        let wrong = Kind::Qtm.device(&Site::Serial("/tmp/plate".into()), Mounting::default(), 1);
        assert!(wrong.is_err_and(|error| error.to_string().contains("serial line")));
    }
}
