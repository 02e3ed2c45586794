//! The early state: results about the newest suit sample, without the delay of the state.

use super::layout::{ZeroCopySend, message};
use super::validity::Validity;
use crate::body::JOINTS;

message! {
    /// Result about the newest suit sample whose wrench has arrived. All vectors are in the station's world: X forward,
    /// Y left, Z up, origin of the station.
    ///
    /// [`State`](super::State) lies half a motion window and the wait for its samples behind; it is more accurate. The
    /// load's position in the hands, the force offset and the mass of the load are those of the newest state. Each σ
    /// contains the measured difference between early states and the states of the same samples.
    ///
    /// A value is valid only if no flag that invalidates it ([`Validity`]) is raised in `valid`; invalid values are
    /// zero. No value is NaN.
    as "equipoise/EarlyState/1", 960 bytes,
    pub struct EarlyState {
        /// Number of the cycle that computed or last invalidated it: `State::cycle`.
        pub cycle: u64,
        /// Due time of that cycle, CLOCK_MONOTONIC ns.
        pub time_ns: u64,
        /// Sample time that the results refer to, CLOCK_MONOTONIC ns; 0 before the first sample.
        pub sample_time_ns: u64,
        /// Age of that sample at `time_ns`, ns.
        pub sample_age_ns: u64,
        /// Invalid reasons: bits of [`Validity`]; 0 if all values are valid.
        pub valid: u64,
        /// Source of the body's accelerations: a `core::message::state::AccelerationSource`.
        pub acceleration_source: u32,
        /// 1 once enough early states were compared with the states of the same samples.
        pub calibrated: u32,
        /// Estimated centre of mass of the unloaded body, world, m.
        pub com_m: [f64; 3],
        /// Centre of pressure of the same motion without the load, by the identified model, world x and y, m.
        pub cop_estimated_m: [f64; 2],
        /// 1-σ of `cop_estimated_m` per axis, m.
        pub cop_sigma_m: [f64; 2],
        /// External force: measured ground reaction minus that of the unloaded body in the same motion, world axes, N;
        /// x and y: always 0, not published.
        pub delta_f_n: [f64; 3],
        /// 1-σ of the vertical component of `delta_f_n`, N.
        pub delta_f_sigma_n: f64,
        /// Grip of the left and the right hand, world, m; valid with `com_m`.
        pub hand_m: [[f64; 3]; 2],
        /// Velocity of the grips, world, m/s; valid with `cop_estimated_m`, because without enough samples
        /// there is none.
        pub hand_velocity_m_per_s: [[f64; 3]; 2],
        /// Mass of the load in the hands, kg.
        pub lifted_mass_kg: f64,
        /// 1-σ of `lifted_mass_kg`, kg.
        pub lifted_mass_sigma_kg: f64,
        /// Overload torque of each joint (Eq. 15), world axes, N m.
        pub torque_nm: [[f64; 3]; JOINTS],
        /// 1-σ of the magnitude of each overload torque, N m.
        pub torque_sigma_nm: [f64; JOINTS],
        /// Time at which egress passed the early state to the bus, CLOCK_MONOTONIC ns; 0 within the loop. The only
        /// field that differs in a replay.
        pub published_ns: u64,
    }
}

impl EarlyState {
    /// Invalid reasons of this early state.
    pub fn validity(&self) -> Validity {
        Validity(self.valid)
    }

    /// `value`, or `None` if a flag of `invalidating` is raised.
    pub fn unless<T>(&self, invalidating: Validity, value: T) -> Option<T> {
        (!self.validity().any_of(invalidating)).then_some(value)
    }

    /// Sets invalid values to zero.
    pub(crate) fn mask_invalid(&mut self) {
        let valid = self.validity();
        if valid.any_of(Validity::INVALIDATES_COM) {
            self.com_m = [0.0; 3];
            self.hand_m = [[0.0; 3]; 2];
        }
        if valid.any_of(Validity::INVALIDATES_COP_ESTIMATED) {
            (self.cop_estimated_m, self.cop_sigma_m) = ([0.0; 2], [0.0; 2]);
            self.hand_velocity_m_per_s = [[0.0; 3]; 2];
        }
        if valid.any_of(Validity::INVALIDATES_DELTA_F) {
            (self.delta_f_n, self.delta_f_sigma_n) = ([0.0; 3], 0.0);
        }
        if valid.any_of(Validity::INVALIDATES_LIFTED_MASS) {
            (self.lifted_mass_kg, self.lifted_mass_sigma_kg) = (0.0, 0.0);
        }
        if valid.any_of(Validity::INVALIDATES_TORQUES) {
            (self.torque_nm, self.torque_sigma_nm) = ([[0.0; 3]; JOINTS], [0.0; JOINTS]);
        }
    }
}
