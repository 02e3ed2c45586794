//! Sources: sockets with the kernel's receive stamps and other connections to devices, which drive the sans-IO state
//! machines of [`crate::suit`] and [`crate::ground`].
//!
//! One engine for each kind of stream ([`ground`], [`mvn`]), one [`transport`] for each kind of connection; [`fused`]
//! runs two ground engines.

pub mod error;
pub mod file_line;
pub mod fused;
pub mod ground;
pub mod http;
pub mod labamp;
pub mod lsl;
pub mod mvn;
pub mod mvn_survey;
pub mod netft_line;
pub mod serial_line;
pub mod tcp_line;
pub mod tcp_socket;
pub mod transport;
pub mod udp;
pub mod udp_line;

pub use error::SourceError;
pub use file_line::FileLine;
pub use fused::FusedSource;
pub use ground::GroundSource;
pub use http::HttpClient;
pub use labamp::{LabAmpLine, LabAmpLineSettings};
pub use lsl::{LslLine, LslLineSettings};
pub use mvn::{MvnSettings, MvnTransport, SuitSource};
pub use mvn_survey::survey;
pub use netft_line::{NetFtLine, NetFtLineSettings};
pub use serial_line::{Flow, LineSettings, SerialLine};
pub use tcp_line::TcpLine;
pub use tcp_socket::TcpSocket;
pub use transport::{Incoming, Transport};
pub use udp::{OneSender, StampedUdpSocket};
pub use udp_line::UdpLine;
