//! Why input of a ground device did not become a sample.

use crate::counts::refusals;

refusals! {
    /// Why input of a ground device was not used; one list for all devices.
    pub enum GroundRefusal {
        /// The length differs from that of the device's records.
        Length = "length",
        /// A duplicate record.
        Duplicate = "duplicate",
        /// Overtaken by a later record, or a jump of the counter that is not accepted yet.
        OutOfOrder = "out_of_order",
        /// The device reports a fault. The sample is published with the status, which forbids its use.
        DeviceStatus = "device_status",
        /// The sender is not the device.
        ForeignSender = "foreign_sender",
        /// Bytes that are no part of a frame were skipped up to the next one; each run counts once.
        Garbage = "garbage",
        /// A frame whose checksum does not match.
        Checksum = "checksum",
        /// A line with another number of fields than configured.
        Fields = "fields",
        /// A field that is not a number.
        Number = "number",
        /// NaN or infinity.
        NotFinite = "not_finite",
        /// A force or moment that no person exerts: undetected data corruption, or a wrong scale.
        Implausible = "implausible",
        /// A line that exceeds the maximum length.
        TooLong = "too_long",
        /// A valid message of an unsupported kind.
        UnknownKind = "unknown_kind",
        /// A frame of an unsupported version or layout.
        Version = "version",
        /// The device reports that its buffer overflowed and samples were lost.
        Overrun = "overrun",
        /// Truncated: the line was closed, or the next frame began within it.
        Incomplete = "incomplete",
        /// Of two devices that are fused, the other had no sample at that time.
        NoPartner = "no_partner",
    }
}
