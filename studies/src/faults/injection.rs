//! Sensor faults without a fault flag, applied to the samples in simulated time.

use equipoise_core::body::{SEGMENTS, Segment};
use equipoise_core::message::{GroundSample, SuitSample};

use super::late_stream::LateStream;
use crate::sensors::simulated_s;

/// Duration of a glitch, s.
const GLITCH_S: f64 = 0.02;
/// Duration of all other faults, s.
const LASTS_S: f64 = 3.0;
/// Delay of a late plate or suit, s.
const LATE_S: f64 = 0.3;
/// Duration of a late suit or of senders that fall behind, s: long enough that the lag is estimated again.
const LATE_LASTS_S: f64 = 20.0;
/// A sender without enough computing time falls behind by this fraction of the time …
const BEHIND_RATE: f64 = 0.15;
/// … and catches up at this rate, so that it is 2 s late after 13.3 s and on time 4 s later.
const CATCH_UP_RATE: f64 = 0.5;
const BEHIND_MAX_S: f64 = 2.0;
/// Silence of a plate before it returns with another gain, s.
const SILENT_S: f64 = 0.5;
/// Rail of a saturated channel, as a fraction of the vertical force at the fault's start.
const RAIL_RATIO: f64 = 1.02;

/// A sensor fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// No fault: the reference.
    None,
    /// The wrench times two, for an instant.
    DoubleGlitch,
    /// Half the wrench, for an instant.
    HalfGlitch,
    /// One sample times five.
    Spike,
    /// The wrench times two.
    Double,
    /// Half the wrench.
    HalfGain,
    /// Gain 20 % too high.
    GainHigh,
    /// Gain 20 % too low.
    GainLow,
    /// The vertical force is limited by a rail.
    Saturated,
    /// The vertical force is at a rail.
    AtTheRail,
    /// The wrench with inverted sign.
    Flipped,
    /// The moments with inverted sign: the centre of pressure is mirrored.
    MomentsFlipped,
    /// One moment with inverted sign.
    OneMomentFlipped,
    /// The channels of two moments swapped.
    MomentsSwapped,
    /// A constant reading.
    FrozenPlate,
    /// One channel is frozen.
    FrozenChannel,
    /// An offset of 300 N from one sample to the next.
    Offset,
    /// All zeros.
    DeadPlate,
    /// 200 N of noise.
    NoisyPlate,
    /// The plate's readings are 0.3 s old: none for 0.3 s, then each that much later under the stamp of its arrival.
    LatePlate,
    /// A constant pose.
    FrozenSuit,
    /// Identity orientation of all segments.
    IdentityQuaternions,
    /// Identity orientation of the arm segments.
    IdentityArms,
    /// One forearm is rotated by 60° about the vertical.
    ForearmTurned,
    /// Left and right are swapped.
    SidesSwapped,
    /// The whole body is displaced by 0.5 m for one sample.
    SuitSpike,
    /// The whole body is displaced by 0.5 m.
    SuitLeap,
    /// The whole body is rotated by 90° about the vertical.
    SuitTurned,
    /// A scale error: all positions times 1.2.
    SuitScaled,
    /// One counter value out of sequence.
    InvalidCounter,
    /// No reading for half a second, then the wrench times 1.5.
    HighAfterGap,
    /// No reading for half a second, then the wrench times two.
    DoubleAfterGap,
    /// The suit's samples arrive 0.3 s later, and the adapter's clock fit stamps them.
    LateSuit,
    /// The suit's sender falls behind by 2 s and catches up.
    SuitBehind,
    /// The plate's sender falls behind by 2 s and catches up.
    PlateBehind,
}

/// State of a fault.
#[derive(Debug, Clone, Default)]
pub struct Injection {
    /// Its start and end, s.
    span_s: [f64; 2],
    ground: Option<GroundSample>,
    suit: Option<SuitSample>,
    earlier: Vec<GroundSample>,
    late_suit: LateStream<SuitSample>,
    late_ground: LateStream<GroundSample>,
}

impl Fault {
    /// Every fault, the row without one first.
    pub const ALL: [Fault; 35] = [
        Fault::None,
        Fault::DoubleGlitch,
        Fault::HalfGlitch,
        Fault::Spike,
        Fault::Double,
        Fault::HalfGain,
        Fault::GainHigh,
        Fault::GainLow,
        Fault::Saturated,
        Fault::AtTheRail,
        Fault::Flipped,
        Fault::MomentsFlipped,
        Fault::OneMomentFlipped,
        Fault::MomentsSwapped,
        Fault::FrozenPlate,
        Fault::FrozenChannel,
        Fault::Offset,
        Fault::DeadPlate,
        Fault::NoisyPlate,
        Fault::LatePlate,
        Fault::FrozenSuit,
        Fault::IdentityQuaternions,
        Fault::IdentityArms,
        Fault::ForearmTurned,
        Fault::SidesSwapped,
        Fault::SuitSpike,
        Fault::SuitLeap,
        Fault::SuitTurned,
        Fault::SuitScaled,
        Fault::InvalidCounter,
        Fault::HighAfterGap,
        Fault::DoubleAfterGap,
        Fault::LateSuit,
        Fault::SuitBehind,
        Fault::PlateBehind,
    ];

    /// Its row in the table.
    pub fn name(self) -> &'static str {
        match self {
            Fault::None => "none",
            Fault::DoubleGlitch => "plate: double for 20 ms",
            Fault::HalfGlitch => "plate: half for 20 ms",
            Fault::Spike => "plate: one sample times five",
            Fault::Double => "plate: double",
            Fault::HalfGain => "plate: half gain",
            Fault::GainHigh => "plate: gain 1.2",
            Fault::GainLow => "plate: gain 0.8",
            Fault::Saturated => "plate: saturated",
            Fault::AtTheRail => "plate: stuck at the rail",
            Fault::Flipped => "plate: flipped",
            Fault::MomentsFlipped => "plate: moments flipped",
            Fault::OneMomentFlipped => "plate: one moment flipped",
            Fault::MomentsSwapped => "plate: moments swapped",
            Fault::FrozenPlate => "plate: frozen",
            Fault::FrozenChannel => "plate: one channel frozen",
            Fault::Offset => "plate: 300 N more",
            Fault::DeadPlate => "plate: zeros",
            Fault::NoisyPlate => "plate: noise of 200 N",
            Fault::LatePlate => "plate: 0.3 s late",
            Fault::FrozenSuit => "suit: frozen",
            Fault::IdentityQuaternions => "suit: identity quaternions",
            Fault::IdentityArms => "suit: identity arms",
            Fault::ForearmTurned => "suit: forearm turned by 60°",
            Fault::SidesSwapped => "suit: sides swapped",
            Fault::SuitSpike => "suit: one sample 0.5 m aside",
            Fault::SuitLeap => "suit: 0.5 m aside",
            Fault::SuitTurned => "suit: turned by 90°",
            Fault::SuitScaled => "suit: places times 1.2",
            Fault::InvalidCounter => "suit: one invalid counter",
            Fault::HighAfterGap => "plate: 0.5 s silent, then gain 1.5",
            Fault::DoubleAfterGap => "plate: 0.5 s silent, then double",
            Fault::LateSuit => "suit: 0.3 s late for 20 s",
            Fault::SuitBehind => "suit: sender falls 2 s behind",
            Fault::PlateBehind => "plate: sender falls 2 s behind",
        }
    }

    /// Its duration, s.
    pub fn lasts_s(self) -> f64 {
        match self {
            Fault::DoubleGlitch | Fault::HalfGlitch => GLITCH_S,
            Fault::LateSuit | Fault::SuitBehind | Fault::PlateBehind => LATE_LASTS_S,
            _ => LASTS_S,
        }
    }

    /// Silence of the ground from the fault's start, s. A delay increases only through a gap, because no sample is
    /// delivered twice.
    fn ground_silent_s(self) -> f64 {
        match self {
            Fault::LatePlate => LATE_S,
            Fault::HighAfterGap | Fault::DoubleAfterGap => SILENT_S,
            _ => 0.0,
        }
    }

    fn on_ground(self, sample: &mut GroundSample, memory: &mut Injection) {
        let first = *memory.ground.get_or_insert(*sample);
        let is_first = first.sequence == sample.sequence;
        let scale = |sample: &mut GroundSample, by: f64| {
            sample.force_n.iter_mut().chain(&mut sample.moment_nm).for_each(|value| *value *= by);
        };
        match self {
            Fault::DoubleGlitch | Fault::Double | Fault::DoubleAfterGap => scale(sample, 2.0),
            Fault::HighAfterGap => scale(sample, 1.5),
            Fault::HalfGlitch | Fault::HalfGain => scale(sample, 0.5),
            Fault::GainHigh => scale(sample, 1.2),
            Fault::GainLow => scale(sample, 0.8),
            Fault::Flipped => scale(sample, -1.0),
            Fault::DeadPlate => scale(sample, 0.0),
            Fault::Spike if is_first => scale(sample, 5.0),
            Fault::Saturated => sample.force_n[2] = sample.force_n[2].min(RAIL_RATIO * first.force_n[2]),
            Fault::AtTheRail => sample.force_n[2] = RAIL_RATIO * first.force_n[2],
            Fault::MomentsFlipped => sample.moment_nm = sample.moment_nm.map(|moment_nm| -moment_nm),
            Fault::OneMomentFlipped => sample.moment_nm[1] *= -1.0,
            Fault::MomentsSwapped => sample.moment_nm.swap(0, 1),
            Fault::FrozenPlate => (sample.force_n, sample.moment_nm) = (first.force_n, first.moment_nm),
            Fault::FrozenChannel => sample.moment_nm[1] = first.moment_nm[1],
            Fault::Offset => sample.force_n[2] += 300.0,
            Fault::NoisyPlate => {
                let sign =
                    if sample.sequence.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 63 == 0 { 1.0 } else { -1.0 };
                sample.force_n[2] += 200.0 * sign;
            }
            _ => {}
        }
    }

    fn on_suit(self, sample: &mut SuitSample, memory: &mut Injection) {
        let first = *memory.suit.get_or_insert(*sample);
        let is_first = first.device_counter == sample.device_counter;
        let aside = |sample: &mut SuitSample| {
            sample.position_m.iter_mut().for_each(|position_m| position_m[1] += 0.5);
        };
        match self {
            Fault::FrozenSuit => {
                (sample.position_m, sample.orientation_wxyz) = (first.position_m, first.orientation_wxyz);
            }
            Fault::IdentityQuaternions => sample.orientation_wxyz = [[1.0, 0.0, 0.0, 0.0]; SEGMENTS],
            Fault::IdentityArms => {
                for segment in Segment::ALL {
                    if (Segment::RightShoulder..=Segment::LeftHand).contains(&segment) {
                        sample.orientation_wxyz[segment.index()] = [1.0, 0.0, 0.0, 0.0];
                    }
                }
            }
            Fault::ForearmTurned => turn(&mut sample.orientation_wxyz[Segment::LeftForearm.index()], 60.0),
            Fault::SidesSwapped => {
                let (position_m, orientation_wxyz) = (sample.position_m, sample.orientation_wxyz);
                for segment in Segment::ALL {
                    let other = segment.mirrored().index();
                    sample.position_m[segment.index()] = position_m[other];
                    sample.orientation_wxyz[segment.index()] = orientation_wxyz[other];
                }
            }
            Fault::SuitSpike if is_first => aside(sample),
            Fault::SuitLeap => aside(sample),
            Fault::SuitTurned => {
                for position_m in &mut sample.position_m {
                    *position_m = [-position_m[1], position_m[0], position_m[2]];
                }
                sample.orientation_wxyz.iter_mut().for_each(|orientation| turn(orientation, 90.0));
            }
            Fault::SuitScaled => {
                sample.position_m.iter_mut().flatten().for_each(|metres| *metres *= 1.2);
            }
            Fault::InvalidCounter if is_first => sample.device_counter = 7,
            _ => {}
        }
    }
}

impl Injection {
    /// Replaces the fault by one that starts at a simulated time, s. The clock fits continue.
    pub fn replace(&mut self, begins_s: f64, fault: Fault) {
        let Injection { late_suit, late_ground, .. } = std::mem::take(self);
        let span_s = [begins_s, begins_s + fault.lasts_s()];
        *self = Injection { span_s, late_suit, late_ground, ..Injection::default() };
    }

    /// Applies the fault to the samples of a time, CLOCK_MONOTONIC ns.
    pub fn put(
        &mut self,
        fault: Fault,
        now_ns: u64,
        suit: &mut Vec<SuitSample>,
        ground: &mut Vec<GroundSample>,
    ) {
        let now_s = simulated_s(now_ns);
        let is_on = (self.span_s[0]..self.span_s[1]).contains(&now_s);
        for sample in ground.iter_mut() {
            if fault == Fault::LatePlate {
                self.earlier.push(*sample);
                let due_ns = due_ns(sample.sample_time_ns);
                let due = self.earlier.partition_point(|earlier| earlier.sample_time_ns <= due_ns);
                if is_on && due > 0 {
                    let old = self.earlier[due - 1];
                    (sample.force_n, sample.moment_nm) = (old.force_n, old.moment_nm);
                }
            } else if is_on {
                fault.on_ground(sample, self);
            }
        }
        if is_on {
            suit.iter_mut().for_each(|sample| fault.on_suit(sample, self));
        }
        let [suit_s, ground_s] = self.late_s(fault, now_s);
        self.late_suit.delay(suit, now_ns, suit_s);
        self.late_ground.delay(ground, now_ns, ground_s);
        if is_on && now_s < self.span_s[0] + fault.ground_silent_s() {
            ground.clear();
        }
    }

    /// Stamp without the fault of the suit's sample that has this one, ns.
    pub fn taken_ns(&self, stamp_ns: u64) -> u64 {
        self.late_suit.taken_ns(stamp_ns).unwrap_or(stamp_ns)
    }

    /// Delay of the samples of suit and ground taken at a time, s; `None` for a stream that the fault does not
    /// delay.
    fn late_s(&self, fault: Fault, now_s: f64) -> [Option<f64>; 2] {
        let [begins_s, ends_s] = self.span_s;
        let since_s = now_s - begins_s;
        let caught_up_s = BEHIND_MAX_S / BEHIND_RATE + BEHIND_MAX_S / CATCH_UP_RATE;
        let behind_s = (BEHIND_RATE * since_s).min(CATCH_UP_RATE * (caught_up_s - since_s)).max(0.0);
        match fault {
            Fault::LateSuit => [Some(if (begins_s..ends_s).contains(&now_s) { LATE_S } else { 0.0 }), None],
            Fault::SuitBehind => [Some(behind_s), None],
            Fault::PlateBehind => [None, Some(behind_s)],
            _ => [None; 2],
        }
    }
}

/// Stamp of the sample that a late stream delivers at a time, ns.
fn due_ns(now_ns: u64) -> u64 {
    now_ns.saturating_sub((LATE_S * 1e9) as u64)
}

/// Rotates an orientation about the world's vertical.
fn turn(wxyz: &mut [f64; 4], by_deg: f64) {
    let half = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, by_deg.to_radians());
    let [w, x, y, z] = *wxyz;
    let turned = half.into_inner() * nalgebra::Quaternion::new(w, x, y, z);
    *wxyz = [turned.w, turned.i, turned.j, turned.k];
}
