//! Validity of each value of a message: the rules of the JSON, for every field by name.

use equipoise_adapters::recording::Entry;
use equipoise_core::message::ground::Component;
use equipoise_core::message::state::Unavailable;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{CycleRecord, GroundSample, Message, State, SuitSample, Validity};

/// A message type that can be exported.
pub trait Exported: Message {
    /// Names of additional text columns.
    const TEXTS: &'static [&'static str] = &[];

    /// The message, if an entry of a recording has this type.
    fn of(entry: &Entry) -> Option<&Self>;

    /// Time of the row, CLOCK_MONOTONIC ns.
    fn row_time_ns(&self) -> u64;

    /// Whether one element of a field is valid.
    fn is_available(&self, field: &str, index: usize) -> bool;

    /// The text columns, in the order of [`Exported::TEXTS`].
    fn texts(&self) -> Vec<String> {
        Vec::new()
    }
}

impl Exported for State {
    const TEXTS: &'static [&'static str] = &["phase_name", "valid_names"];

    fn of(entry: &Entry) -> Option<&State> {
        if let Entry::State(message) = entry { Some(message) } else { None }
    }

    fn row_time_ns(&self) -> u64 {
        self.time_ns
    }

    fn texts(&self) -> Vec<String> {
        let names: Vec<&str> = self.validity().names().collect();
        vec![self.phase_name().to_owned(), names.join(" ")]
    }

    fn is_available(&self, field: &str, index: usize) -> bool {
        let unless = |invalidating: Validity| !self.validity().any_of(invalidating);
        match field {
            "suit_sample_time_ns" | "suit_age_ns" => self.suit_sample_time_ns != 0,
            "ground_age_ns" => self.ground_age_ns != u64::MAX,
            "published_ns" => self.published_ns != 0,
            "suggested_pose" => self.suggested_pose != u32::MAX,
            "pose_mismatch_rad" => self.pose_mismatch_rad().is_some(),
            "worst_joint" => unless(Validity::INVALIDATES_TORQUES) && self.worst_joint != u32::MAX,
            "mass_kg" => unless(Validity::MASS_UNKNOWN),
            "cop_measured_m" => unless(Validity::INVALIDATES_COP_MEASURED),
            "cop_measured_sigma_m" => {
                unless(Validity::INVALIDATES_COP_MEASURED)
                    && self.cop_measured_sigma_m.iter().all(|sigma| *sigma > 0.0)
            }
            "cop_estimated_m" | "cop_sigma_m" => unless(Validity::INVALIDATES_COP_ESTIMATED),
            "com_m" | "acceleration_source" => unless(Validity::INVALIDATES_COM),
            "suit_com_m" => self.suit_com_m().is_some(),
            // Insoles measure the vertical force only.
            "ground_force_n" => {
                unless(Validity::INVALIDATES_GROUND_FORCE)
                    && (index == 2 || self.provides(Unavailable::Shear))
            }
            "ground_devices" => unless(Validity::INVALIDATES_GROUND_FORCE),
            "delta_f_n" => unless(Validity::INVALIDATES_DELTA_F),
            "delta_f_sigma_n" => unless(Validity::INVALIDATES_DELTA_F) && self.delta_f_sigma_n > 0.0,
            "lifted_mass_kg" | "lifted_mass_sigma_kg" => unless(Validity::INVALIDATES_LIFTED_MASS),
            "load_hand_distance_m" => unless(Validity::INVALIDATES_LOAD_HAND_DISTANCE),
            "foot_load_fraction"
            | "foot_load_fraction_sigma"
            | "sharing_source"
            | "hand_load_fraction"
            | "hand_load_fraction_sigma"
            | "reach_m"
            | "reach_sigma_m"
            | "joint_level"
            | "torque_nm"
            | "torque_sigma_nm"
            | "torque_covariance_nm2" => unless(Validity::INVALIDATES_TORQUES),
            // Zero: the joint has no limit.
            "torque_limit_nm" => unless(Validity::INVALIDATES_TORQUES) && self.torque_limit_nm[index] > 0.0,
            "advice_direction" | "advice_gain_nm_per_cm" => {
                unless(Validity::INVALIDATES_TORQUES) && self.advice_direction != [0.0; 3]
            }
            "l5s1_moment_nm" | "l5s1_moment_sigma_nm" | "l5s1_compression_n" | "l5s1_compression_sigma_n" => {
                unless(Validity::INVALIDATES_LOW_BACK)
            }
            // Zero: not computed yet.
            "variance_max_m2" => self.variance_max_m2 > 0.0,
            "predicted_cop_sigma_m" => self.predicted_cop_sigma_m > 0.0,
            "nis" => self.nis > 0.0,
            "prior_inflation" => self.prior_inflation > 0.0,
            "suit_skew_s" | "suit_skew_sigma_s" => self.suit_skew_sigma_s > 0.0,
            "segment_origin_m" => self.segment_origin_m().is_some(),
            _ => true,
        }
    }
}

impl Exported for SuitSample {
    fn of(entry: &Entry) -> Option<&SuitSample> {
        if let Entry::Suit(message) = entry { Some(message) } else { None }
    }

    fn row_time_ns(&self) -> u64 {
        self.sample_time_ns
    }

    fn is_available(&self, field: &str, _: usize) -> bool {
        match field {
            "sample_time_sigma_ns" => self.sample_time_sigma_ns != u64::MAX,
            "velocity_m_per_s" | "acceleration_m_per_s2" => self.has(SuitBlocks::LinearKinematics),
            "angular_velocity_rad_per_s" => self.has(SuitBlocks::AngularKinematics),
            "joint_angle_deg" => self.has(SuitBlocks::JointAngles),
            "com_m" => self.has(SuitBlocks::CentreOfMass),
            _ => true,
        }
    }
}

impl Exported for GroundSample {
    fn of(entry: &Entry) -> Option<&GroundSample> {
        if let Entry::Ground(message) = entry { Some(message) } else { None }
    }

    fn row_time_ns(&self) -> u64 {
        self.sample_time_ns
    }

    fn is_available(&self, field: &str, index: usize) -> bool {
        let sound = self.device_status == 0;
        let measures = |component: Component| self.not_measured & component as u32 == 0;
        let each = sound && self.per_foot != 0;
        match (field, index) {
            ("sample_time_sigma_ns", _) => self.sample_time_sigma_ns != u64::MAX,
            ("force_n", 2) => sound,
            ("force_n", _) => sound && measures(Component::Shear),
            ("moment_nm", 2) => sound && measures(Component::FreeMoment),
            ("moment_nm", _) => sound && measures(Component::Tilt),
            ("foot_vertical_n", _) => each,
            ("foot_frame", _) => self.per_foot != 0,
            // A foot without force has no centre of pressure.
            ("foot_cop_m", _) => each && self.foot_vertical_n[index / 2] != 0.0,
            _ => true,
        }
    }
}

impl Exported for CycleRecord {
    fn of(entry: &Entry) -> Option<&CycleRecord> {
        if let Entry::Cycle(message) = entry { Some(message) } else { None }
    }

    fn row_time_ns(&self) -> u64 {
        self.due_ns
    }

    fn is_available(&self, field: &str, _: usize) -> bool {
        match field {
            "woken_ns" => self.woken_ns != 0,
            "compute_start_ns" => self.compute_start_ns != 0,
            "compute_end_ns" => self.compute_end_ns != 0,
            "publish_start_ns" => self.publish_start_ns != 0,
            "published_ns" => self.published_ns != 0,
            "suit_sample_time_ns" => self.suit_sample_time_ns != 0,
            "suit_arrival_ns" => self.suit_arrival_ns != 0,
            "suit_published_ns" => self.suit_published_ns != 0,
            "suit_ingress_ns" => self.suit_ingress_ns != 0,
            "ground_sample_time_ns" => self.ground_sample_time_ns != 0,
            "ground_arrival_ns" => self.ground_arrival_ns != 0,
            "ground_published_ns" => self.ground_published_ns != 0,
            "ground_ingress_ns" => self.ground_ingress_ns != 0,
            "suit_first" | "suit_last" => self.suit_taken > 0,
            "ground_first" | "ground_last" => self.ground_taken > 0,
            "command_argument" => self.command != 0,
            "body_published_ns" => self.body_published_ns != 0,
            _ => true,
        }
    }
}
