//! The doors: sockets with the kernel's receive stamps, driving the sans-IO brains of [`crate::suit`] and
//! [`crate::ground`].

pub mod ati_rdt;
pub mod mvn_udp;
pub mod udp;

pub use ati_rdt::{RdtSource, RdtSourceSettings};
pub use mvn_udp::{MvnUdpSettings, MvnUdpSource};
pub use udp::{SourceError, UdpDoor};
