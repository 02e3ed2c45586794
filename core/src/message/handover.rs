//! Request for a place of a part in front of the worker, and the plan.

use super::layout::{ZeroCopySend, message};

message! {
    /// A request for the place at which a part relieves the worker.
    as "equipoise/HandoverRequest/1", 64 bytes,
    pub struct HandoverRequest {
        /// Mass of the part, kg, 0.1 to 50.
        pub mass_kg: f64,
        /// 1-σ of the mass, kg.
        pub mass_sigma_kg: f64,
        /// Distance between the grips, m, 0 to 1.
        pub width_m: f64,
        /// Where the part is handed over now: middle between the grips, in the frame `current_frame`, m.
        pub current_m: [f64; 3],
        /// A [`CurrentFrame`].
        pub current_frame: u32,
        /// 1 if the handles have the slope `current_slope_rad` there; 0: handles that turn with the hands.
        pub current_is_sloped: u32,
        /// Slope of the handles at the current place, as [`HandoverPlan::slope_rad`].
        pub current_slope_rad: f64,
    }
}

message! {
    /// The plan of a [`HandoverRequest`]. Places are of the middle between the grips.
    as "equipoise/HandoverPlan/2", 256 bytes,
    pub struct HandoverPlan {
        /// A [`HandoverRefusal`]; unless it is 0, all values after `subject` are zero.
        pub refused: u32,
        /// Always zero.
        pub reserved: u32,
        /// Cycle of the state with the feet and the fatigue of the plan; 0 before the first state.
        pub cycle: u64,
        /// Sample time of that state, CLOCK_MONOTONIC ns.
        pub sample_time_ns: u64,
        /// Invalid reasons of that state, bits of [`super::Validity`].
        pub valid: u64,
        /// Pseudonym of the subject, UTF-8, padded with zeros.
        pub subject: [u8; 64],
        /// Number of measured handovers that correct the prediction.
        pub handovers: u32,
        /// Index of the worst joint at the best place.
        pub worst_joint: u32,
        /// Best place, station's world, m.
        pub position_m: [f64; 3],
        /// Best place relative to the feet: forward and to the left of the middle between the ankles, above the floor, m.
        pub place_m: [f64; 3],
        /// Predicted limit ratio of the worst joint at the best place: overload over τ_max.
        pub limit_ratio: f64,
        /// 1-σ of `limit_ratio`.
        pub limit_ratio_sigma: f64,
        /// The same at the current place; 0 unless `current_status` is 1.
        pub current_limit_ratio: f64,
        /// 1-σ of `current_limit_ratio`.
        pub current_limit_ratio_sigma: f64,
        /// A [`CurrentStatus`].
        pub current_status: u32,
        /// Index of the worst joint at the current place.
        pub current_worst_joint: u32,
        /// Slope of the handles at the best place: how far hands that follow them point below the horizontal, rad.
        pub slope_rad: f64,
        /// Heading of the feet: angle from the station's X axis about the vertical, rad. The handles slope about the
        /// worker's lateral axis, which is the station's Y axis turned by this.
        pub feet_heading_rad: f64,
        /// Always zero; the fields fill a multiple of 64 bytes.
        pub unused: [u64; 6],
    }
}

/// Frame of the current place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum CurrentFrame {
    /// There is no current place.
    None = 0,
    /// The station's world.
    Station = 1,
    /// Relative to the feet, as [`HandoverPlan::place_m`].
    Feet = 2,
}

impl CurrentFrame {
    /// Frame with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<CurrentFrame> {
        [CurrentFrame::None, CurrentFrame::Station, CurrentFrame::Feet].into_iter().nth(number as usize)
    }
}

/// Prediction at the current place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum CurrentStatus {
    /// There is no current place.
    None = 0,
    /// The limit ratio is predicted.
    Predicted = 1,
    /// The hands do not reach it.
    OutOfReach = 2,
    /// The worker would lose balance there.
    OutOfBalance = 3,
}

impl CurrentStatus {
    /// Status with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<CurrentStatus> {
        use CurrentStatus as Status;
        [Status::None, Status::Predicted, Status::OutOfReach, Status::OutOfBalance]
            .into_iter()
            .nth(number as usize)
    }
}

/// Why there is no plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum HandoverRefusal {
    /// There is a plan.
    None = 0,
    /// A number of the request is out of range.
    Request = 1,
    /// The subject is not identified.
    NotIdentified = 2,
    /// The subject's mass is unavailable.
    MassUnknown = 3,
    /// No state is newer than 50 ms.
    Stale = 4,
    /// The feet's positions are invalid, or the subject has just changed: `valid` has the reasons.
    Invalid = 5,
    /// The part can be held nowhere in the region.
    Infeasible = 6,
}

impl HandoverRefusal {
    /// All reasons, and none, by number.
    pub const ALL: [HandoverRefusal; 7] = [
        HandoverRefusal::None,
        HandoverRefusal::Request,
        HandoverRefusal::NotIdentified,
        HandoverRefusal::MassUnknown,
        HandoverRefusal::Stale,
        HandoverRefusal::Invalid,
        HandoverRefusal::Infeasible,
    ];

    /// Reason with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<HandoverRefusal> {
        Self::ALL.into_iter().nth(number as usize)
    }
}
