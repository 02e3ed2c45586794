//! The ground's brain: records and arrival times in, wrenches in the station's world out. No socket, no clock.

pub mod frame;
pub mod rdt;

pub use frame::{GroundFrame, Measures, Wrench};
pub use rdt::{RdtReceiver, RdtRefusal, RdtSettings};
