//! Samples of the ground devices: the wrench under the feet.

mod between;

use super::layout::{Message, ZeroCopySend, message};

message! {
    /// Ground reaction on the person: force and moment in the station's world (X forward, Y left, Z up).
    ///
    /// The adapter has converted the device's axes and sign ("action" or "reaction"); the moment is about the world's
    /// origin. Only the ground adapter publishes it.
    as "equipoise/Ground/3", 192 bytes,
    pub struct GroundSample {
        /// Time of the measurement by the stream's clock fit, CLOCK_MONOTONIC ns of the host.
        pub sample_time_ns: u64,
        /// 1-σ of `sample_time_ns`, ns; `u64::MAX` while the clock fit has too few points, or if
        /// the time since the previous sample is unknown.
        pub sample_time_sigma_ns: u64,
        /// Kernel's receive stamp, CLOCK_MONOTONIC ns.
        pub arrival_ns: u64,
        /// Time of publication by the adapter, CLOCK_MONOTONIC ns.
        pub published_ns: u64,
        /// Number of the sample since the adapter's start, from 1.
        pub sequence: u64,
        /// Sample counter of the device (ATI: `ft_sequence`).
        pub device_counter: u32,
        /// Status word of the device; nonzero: the sample is invalid.
        pub device_status: u32,
        /// Increments when the device's counter restarts.
        pub session: u32,
        /// 1 if each foot was measured separately (two plates, insoles): the `foot_` fields are valid.
        pub per_foot: u32,
        /// Force on the person, world axes, N.
        pub force_n: [f64; 3],
        /// Moment on the person about the world's origin, world axes, N m.
        pub moment_nm: [f64; 3],
        /// Height of the walking surface in the world, m.
        pub surface_z_m: f64,
        /// Vertical force under the left and the right foot, N; the sum is `force_n[2]`.
        pub foot_vertical_n: [f64; 2],
        /// Centre of pressure under the left and the right foot, x and y in the frame `foot_frame`, m; zero for a foot
        /// without force.
        pub foot_cop_m: [[f64; 2]; 2],
        /// Components that the devices cannot measure: a union of [`Component`] bits. They are zero and invalid.
        pub not_measured: u32,
        /// Devices in this sample: a union of [`GroundDevice`] bits.
        pub devices: u32,
        /// Frame of `foot_cop_m`: 0 world, 1 insole ([`FootFrame`]).
        pub foot_frame: u32,
        /// Increments when `sample_time_ns` moves relative to the counter by more than 50 ms: the delay has changed, or
        /// the device paused.
        pub clock_epoch: u32,
        /// Always zero; pads the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 2],
    }
}

/// Parts of a wrench that a device may not measure, as bits of `not_measured`. The vertical force is always measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Components of a wrench that a device may not measure, as bits of `not_measured`. The vertical force is always
/// measured.
pub enum Component {
    /// Horizontal force: insoles measure only normal forces.
    Shear = 1,
    /// Moment about the horizontal axes, and thus the centre of pressure in the world.
    Tilt = 1 << 1,
    /// Moment about the vertical axis.
    FreeMoment = 1 << 2,
}

/// What kind of device a sample comes from, as bits of `devices`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Kind of a device, as bits of `devices`.
pub enum GroundDevice {
    /// The force plate of `[ground]`.
    Plate = 1,
    /// The force plate of `[ground.second]`.
    SecondPlate = 1 << 1,
    /// Insoles.
    Insoles = 1 << 2,
}

impl GroundDevice {
    /// All bits with their public names, lowest first.
    pub const NAMES: [(GroundDevice, &'static str); 3] = [
        (GroundDevice::Plate, "plate"),
        (GroundDevice::SecondPlate, "second_plate"),
        (GroundDevice::Insoles, "insoles"),
    ];

    /// Whether a union of these bits is that of insoles without a plate.
    pub fn are_insoles_alone(devices: u32) -> bool {
        let plates = GroundDevice::Plate as u32 | GroundDevice::SecondPlate as u32;
        devices & GroundDevice::Insoles as u32 != 0 && devices & plates == 0
    }
}

/// Frame of each foot's centre of pressure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Frame of each foot's centre of pressure.
pub enum FootFrame {
    /// The station's world.
    World = 0,
    /// Each insole's own frame: origin in its middle, X towards the toes, Y to the left. Only the suit provides the
    /// pose of the feet.
    Insole = 1,
}

/// Reason why a wrench has no centre of pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoCop {
    /// The vertical force is below the threshold: no person is on the plate.
    TooLittleForce {
        /// Vertical force, N.
        vertical_n: f64,
    },
    /// The device reported a fault.
    DeviceStatus(u32),
    /// The devices do not measure it; it may follow from the feet's own centres and positions.
    NotMeasured,
}

/// Ground reaction on each foot: left, right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feet {
    /// Vertical force, N; not negative, with a positive sum.
    pub vertical_n: [f64; 2],
    /// Centre of pressure, world x and y, m; `None` if a foot's force is too small, or if it is in the insole's frame.
    pub cop_m: Option<[[f64; 2]; 2]>,
}

impl Feet {
    /// Fractions of the left and the right foot; their sum is one.
    pub fn fractions(&self) -> [f64; 2] {
        let [left, right] = self.vertical_n;
        [left / (left + right), right / (left + right)]
    }
}

/// Maximum difference between the sum of both feet and the total: the larger of an absolute value, N, and a fraction.
const FEET_SUM_TOLERANCE: (f64, f64) = (5.0, 0.02);

/// Minimum vertical force for a centre of pressure, N; below, it is noise (devices gate at 5 to 10 N).
pub const COP_MIN_VERTICAL_N: f64 = 20.0;

/// Maximum of any plate's range, N and N m.
pub(crate) const WRENCH_MAX: f64 = 1e6;
/// Maximum distance of a plate from the origin, m.
const HEIGHT_MAX_M: f64 = 1e4;

impl GroundSample {
    /// Whether the numbers are possible for a plate: finite, and within any plate's range.
    pub fn is_possible(&self) -> bool {
        self.is_finite()
            && self.force_n.iter().chain(&self.moment_nm).all(|value| value.abs() < WRENCH_MAX)
            && self.surface_z_m.abs() < HEIGHT_MAX_M
    }

    /// Whether the devices measure a component.
    pub fn measures(&self, component: Component) -> bool {
        self.not_measured & component as u32 == 0
    }

    /// This sample with zero for each unmeasured component.
    #[must_use]
    pub fn mask_unmeasured(mut self) -> GroundSample {
        if !self.measures(Component::Shear) {
            (self.force_n[0], self.force_n[1]) = (0.0, 0.0);
        }
        if !self.measures(Component::Tilt) {
            (self.moment_nm[0], self.moment_nm[1]) = (0.0, 0.0);
        }
        if !self.measures(Component::FreeMoment) {
            self.moment_nm[2] = 0.0;
        }
        self
    }

    /// Whether insoles measured it, and no plate.
    pub fn is_by_insoles_alone(&self) -> bool {
        GroundDevice::are_insoles_alone(self.devices)
    }

    /// Whether each foot was measured separately and consistently with the total: finite, with the same sum.
    pub fn has_feet(&self) -> bool {
        let [left, right] = self.foot_vertical_n;
        let (newtons, fraction) = FEET_SUM_TOLERANCE;
        // The comparison is false for NaN.
        self.per_foot == 1
            && (left + right - self.force_n[2]).abs() <= newtons.max(fraction * self.force_n[2].abs())
            && self.foot_cop_m.iter().flatten().all(|metres| metres.is_finite())
    }

    /// Force on each foot; `None` if it was not measured, is inconsistent with the total, or no person is on the plate.
    pub fn feet(&self) -> Option<Feet> {
        if !self.has_feet() || self.cop_m().is_err() {
            return None;
        }
        let vertical_n = self.foot_vertical_n.map(|newtons| newtons.max(0.0));
        let in_the_world = self.foot_frame == FootFrame::World as u32;
        let both_press = vertical_n.iter().all(|newtons| *newtons >= COP_MIN_VERTICAL_N);
        Some(Feet { vertical_n, cop_m: (both_press && in_the_world).then_some(self.foot_cop_m) })
    }

    /// Centre of pressure on the walking surface, world x and y, m.
    ///
    /// For force F and moment M about the origin, acting at height z: `x = (z·Fx − My)/Fz`, `y = (Mx + z·Fy)/Fz`.
    ///
    /// # Errors
    /// A [`NoCop`] when too little force acts or the device reports a fault.
    pub fn cop_m(&self) -> Result<[f64; 2], NoCop> {
        if self.device_status != 0 {
            return Err(NoCop::DeviceStatus(self.device_status));
        }
        if !self.measures(Component::Tilt) {
            return Err(NoCop::NotMeasured);
        }
        let [fx, fy, fz] = self.force_n;
        let [mx, my, _] = self.moment_nm;
        // The comparison is false for NaN, which gives no CoP either.
        if fz >= COP_MIN_VERTICAL_N {
            Ok([(self.surface_z_m * fx - my) / fz, (mx + self.surface_z_m * fy) / fz])
        } else {
            Err(NoCop::TooLittleForce { vertical_n: fz })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_force_through_a_point_has_its_cop_there() {
        let (point, force) = ([0.12, -0.07, 0.03], [13.0, -8.0, 700.0]);
        let moment = [
            point[1] * force[2] - point[2] * force[1],
            point[2] * force[0] - point[0] * force[2],
            point[0] * force[1] - point[1] * force[0],
        ];
        let sample =
            GroundSample { force_n: force, moment_nm: moment, surface_z_m: 0.03, ..Zeroable::zeroed() };
        let cop = sample.cop_m().unwrap();
        assert!((cop[0] - 0.12).abs() < 1e-12 && (cop[1] + 0.07).abs() < 1e-12, "{cop:?}");
    }

    #[test]
    fn unmeasured_components_are_zero_and_the_rest_stays() {
        let sample =
            GroundSample { force_n: [1.0, 2.0, 3.0], moment_nm: [4.0, 5.0, 6.0], ..Zeroable::zeroed() };
        let left = |not_measured: u32| {
            let left = GroundSample { not_measured, ..sample }.mask_unmeasured();
            (left.force_n, left.moment_nm)
        };
        assert_eq!(left(0), (sample.force_n, sample.moment_nm));
        assert_eq!(left(Component::Shear as u32), ([0.0, 0.0, 3.0], sample.moment_nm));
        assert_eq!(left(Component::Tilt as u32), (sample.force_n, [0.0, 0.0, 6.0]));
        assert_eq!(left(7), ([0.0, 0.0, 3.0], [0.0; 3]));
    }

    #[test]
    fn no_force_no_cop() {
        let mut sample: GroundSample = Zeroable::zeroed();
        assert_eq!(sample.cop_m(), Err(NoCop::TooLittleForce { vertical_n: 0.0 }));
        sample.force_n[2] = f64::NAN;
        assert!(sample.cop_m().is_err());
        sample.force_n[2] = 700.0;
        sample.not_measured = Component::Tilt as u32;
        assert_eq!(sample.cop_m(), Err(NoCop::NotMeasured));
        sample.device_status = 0x8000_0000;
        assert_eq!(sample.cop_m(), Err(NoCop::DeviceStatus(0x8000_0000)));
    }

    #[test]
    fn feet_that_contradict_the_total_are_rejected() {
        let sample = GroundSample {
            per_foot: 1,
            force_n: [0.0, 0.0, 700.0],
            foot_vertical_n: [301.0, 400.0],
            foot_cop_m: [[0.0, 0.1], [0.0, -0.1]],
            ..Zeroable::zeroed()
        };
        assert_eq!(sample.feet().unwrap().cop_m, Some(sample.foot_cop_m));
        let one_foot = GroundSample { foot_vertical_n: [-2.0, 702.0], ..sample };
        assert_eq!(one_foot.feet(), Some(Feet { vertical_n: [0.0, 702.0], cop_m: None }));
        assert_eq!(one_foot.feet().unwrap().fractions(), [0.0, 1.0]);
        let contradicting = [
            GroundSample { per_foot: 0, ..sample },
            GroundSample { foot_vertical_n: [330.0, 400.0], ..sample },
            GroundSample { foot_vertical_n: [f64::NAN, 400.0], ..sample },
            GroundSample { foot_cop_m: [[0.0, f64::NAN], [0.0; 2]], ..sample },
            GroundSample { device_status: 1, ..sample },
            GroundSample { force_n: [0.0; 3], foot_vertical_n: [0.0; 2], ..sample },
        ];
        for sample in contradicting {
            assert_eq!(sample.feet(), None, "{sample:?}");
        }
    }
}
