//! Ground devices: converts bytes and arrival times to wrenches in the station's world. Does no I/O and reads no clock.
//!
//! [`device`]s decode bytes to [`reading`]s in the sensor's own axes; the [`receiver`], common to all devices, adds the
//! pose, the sample time and the sequence number. [`channels`] defines the meaning of plain numbers, and [`fusion`]
//! combines two devices.

pub mod channels;
pub mod device;
pub mod frame;
pub mod fusion;
mod lead;
mod order;
pub mod plan;
pub mod protocol;
pub mod reading;
pub mod receiver;
pub mod refusal;

pub use channels::{ChannelFault, Channels};
pub use device::{Action, GroundDevice};
pub use frame::{GroundFrame, Measures, SensorAxes, Wrench};
pub use fusion::{Fusion, FusionKind, FusionSettings};
pub use protocol::GroundProtocol;
pub use reading::{Decoded, FootLoad, Load, Reading, Tick};
pub use receiver::{GroundReceiver, GroundSettings};
pub use refusal::GroundRefusal;
