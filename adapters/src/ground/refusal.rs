//! Why input of a ground device did not become a sample.

use crate::counts::refusals;

refusals! {
    /// Why something the ground's device sent was not used; one list for all devices.
    pub enum GroundRefusal {
        /// Not as long as the device's records are.
        Length = "length",
        /// The same record again.
        Duplicate = "duplicate",
        /// Overtaken by a later record, or a jump of the counter that is not believed yet.
        OutOfOrder = "out_of_order",
        /// The device reports a fault. Handed on with its status, so that no one uses it.
        DeviceStatus = "device_status",
        /// Came from another address than the device's.
        ForeignSender = "foreign_sender",
        /// Bytes that are no part of a frame were passed over until the next one; each run counts once.
        Garbage = "garbage",
        /// A frame whose checksum does not fit.
        Checksum = "checksum",
        /// A line with another number of fields than configured.
        Fields = "fields",
        /// A field that is no number.
        Number = "number",
        /// NaN or infinity.
        NotFinite = "not_finite",
        /// A force or moment that no person exerts: damage that no checksum saw, or a wrong scale.
        Implausible = "implausible",
        /// A line that does not end.
        TooLong = "too_long",
        /// A sound message of a kind that is not read.
        UnknownKind = "unknown_kind",
        /// A frame of a version or layout that is not read.
        Version = "version",
        /// The device says that it lost samples of its own: its buffer ran over.
        Overrun = "overrun",
        /// Cut off: the line was closed, or the next frame began within it.
        Incomplete = "incomplete",
        /// Of two devices that are fused, the other had no sample at that time.
        NoPartner = "no_partner",
    }
}
