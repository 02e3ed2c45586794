//! The ground's brain: bytes and arrival times in, wrenches in the station's world out. No socket, no clock.
//!
//! [`device`]s know bytes and make [`reading`]s in the sensor's own axes; the one [`receiver`] gives every reading its
//! place, its time and its number, whichever device it comes from. [`channels`] say what plain numbers mean, and
//! [`fusion`] makes one ground of two devices.

pub mod brain;
pub mod channels;
pub mod device;
pub mod frame;
pub mod fusion;
mod lead;
mod order;
pub mod plan;
pub mod reading;
pub mod receiver;
pub mod refusal;

pub use brain::GroundBrain;
pub use channels::{ChannelFault, Channels};
pub use device::{GroundDevice, Want};
pub use frame::{GroundFrame, Measures, SensorAxes, Wrench};
pub use fusion::{Fusion, FusionKind, FusionSettings};
pub use reading::{FootLoad, Load, Reading, Taken, Tick};
pub use receiver::{GroundReceiver, GroundSettings};
pub use refusal::GroundRefusal;
