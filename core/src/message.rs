//! Messages of the bus: their quantities, units and names.
//!
//! Each message is plain old data (`repr(C)`, no padding, no bool, no pointer), so its bytes in shared memory, in a
//! recording and in a C header are the same. [`layout::Message::FIELDS`] defines their meaning; everything that must
//! agree with them (schema hash, recording schema, client headers) is generated from that table.

pub mod command;
pub mod consumer_receipt;
pub mod cycle_record;
pub mod early_state;
pub mod ground;
pub mod handover;
pub mod health;
pub mod incident;
pub mod layout;
pub mod printable;
pub mod state;
pub mod suit;
pub mod suit_body;
pub mod validity;

pub use command::{Command, CommandKind, Reply};
pub use consumer_receipt::ConsumerReceipt;
pub use cycle_record::CycleRecord;
pub use early_state::EarlyState;
pub use ground::{Component, FootFrame, GroundDevice, GroundSample};
pub use handover::{HandoverPlan, HandoverRequest};
pub use health::AdapterHealth;
pub use incident::{Incident, Incidents};
pub use layout::Message;
pub use printable::Printable;
pub use state::State;
pub use suit::SuitSample;
pub use suit_body::SuitBody;
pub use validity::Validity;
