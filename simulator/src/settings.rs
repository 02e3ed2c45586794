//! Settings of a simulation: person, suit, plate, network.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use crate::faults::Faults;
use crate::motion::Habits;
use crate::noise::{PlateNoise, SuitNoise, ZeroDrift};
use crate::plate::Plate;
use crate::realism::Realism;
use crate::suit_sender::{Streams, SuitWorld};
use crate::wires;

/// Settings of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationSettings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Stature, m.
    pub height_m: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Deviations of the person from the commanded motion.
    pub habits: Habits,
    /// The suit.
    pub suit: SuitSettings,
    /// The plate.
    pub plate: PlateSettings,
    /// A second plate; each foot then stands on a separate plate.
    pub second_plate: Option<SecondPlateSettings>,
}

/// Settings of the suit.
#[derive(Debug, Clone, PartialEq)]
pub struct SuitSettings {
    /// Destination of MVN's stream: the receiver's address.
    pub target: SocketAddr,
    /// Over TCP, connecting to the receiver, instead of UDP.
    pub tcp: bool,
    /// Samples per second, 60 to 240.
    pub rate_hz: f64,
    /// Character id.
    pub avatar: u8,
    /// From a sample's time to its sending, s.
    pub latency_s: f64,
    /// The suit's world in the station's.
    pub world: SuitWorld,
    /// Optional datagrams.
    pub streams: Streams,
    /// Its errors.
    pub noise: SuitNoise,
    /// Faults of the network.
    pub faults: Faults,
}

/// Settings of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateSettings {
    /// Address at which the plate receives requests; port 0 for any free one.
    pub address: SocketAddr,
    /// Samples per second.
    pub rate_hz: f64,
    /// From a sample's time to its sending, s; also of the second plate.
    pub latency_s: f64,
    /// Pose and scale of the plate.
    pub plate: Plate,
    /// Its errors.
    pub noise: PlateNoise,
    /// Drift of its zero since the start or the last reset; also of the second plate.
    pub zero: ZeroDrift,
    /// Faults of the network.
    pub faults: Faults,
}

/// A second plate with the first one's noise: the right foot stands on it, the left one alone on the first.
#[derive(Debug, Clone, PartialEq)]
pub struct SecondPlateSettings {
    /// Address at which it receives requests.
    pub address: SocketAddr,
    /// Samples per second.
    pub rate_hz: f64,
    /// Pose and scale; its surface is as high as the first one's.
    pub plate: Plate,
    /// Pressure points of the left and right foot, from their ankles along the world's axes, m.
    pub press_m: [[f64; 2]; 2],
}

impl SimulationSettings {
    /// The same with the habits of the person with this seed, and with a plate that is late, whose clock drifts and
    /// whose zero drifts ([`Realism::REALISTIC`]).
    #[must_use]
    pub fn realistic(mut self, seed: u64) -> SimulationSettings {
        let clocks = Realism::REALISTIC.clocks(seed);
        self.seed = seed;
        self.habits = Realism::REALISTIC.habits(seed);
        self.plate.latency_s = clocks.plate_late_s;
        self.plate.rate_hz *= 1.0 + 1e-6 * clocks.plate_drift_ppm;
        self.plate.zero = Realism::REALISTIC.zero_drift(seed, 0);
        self
    }
}

impl Default for SimulationSettings {
    /// A person of 1.77 m and 72 kg with realistic contacts and soft tissue ([`Realism::REALISTIC`]) in an ordinary
    /// suit on a good plate, on loopback and default ports.
    fn default() -> SimulationSettings {
        let loopback = |port| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
        SimulationSettings {
            seed: 1,
            height_m: 1.77,
            mass_kg: 72.0,
            habits: Realism::REALISTIC.habits(1),
            suit: SuitSettings {
                target: loopback(wires::mvn::DEFAULT_PORT),
                tcp: false,
                rate_hz: 60.0,
                avatar: 0,
                latency_s: 0.0,
                world: SuitWorld::default(),
                streams: Streams::default(),
                noise: Realism::REALISTIC.suit_noise(),
                faults: Faults::default(),
            },
            plate: PlateSettings {
                address: loopback(wires::ati_rdt::DEFAULT_PORT),
                rate_hz: 1000.0,
                latency_s: 0.0,
                plate: Plate::default(),
                noise: PlateNoise::ORDINARY,
                zero: ZeroDrift::NONE,
                faults: Faults::default(),
            },
            second_plate: None,
        }
    }
}
