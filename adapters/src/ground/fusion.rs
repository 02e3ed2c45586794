//! Two devices at once: their samples by time to one ground, with what each contributed said in it.
//!
//! Each device has its own clock, and both clocks are tied to the host's by their own fits; so samples are brought
//! together by sample time and never by arrival. The first device sets the pace. The second is interpolated between
//! its two neighbours in time, never held and never extrapolated: a sample of the first waits for its partner, for a
//! bounded time.
//!
//! What one of two plates feels is not what the person gets from the ground, so without a partner there is no sample.
//! A plate beside insoles does feel the whole: without them its sample goes on, and says so in `devices`.

mod queue;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use equipoise_core::message::ground::COP_MIN_VERTICAL_N;
use equipoise_core::message::{Component, FootFrame, GroundDevice as DeviceKind, GroundSample};

use super::refusal::GroundRefusal;
use crate::counts::Counts;
use queue::{Found, Partners};

/// How long a sample of the first device waits for its partner, beside what the second is known to be later, ns.
pub const WAIT_NS: u64 = 50_000_000;
/// Surfaces that differ by more are no common floor, m: with a tenth of the weight as shear this moves the common centre
/// of pressure by half a millimetre.
pub const SURFACES_AGREE_M: f64 = 0.005;
/// Insoles that were silent for so long are not waited for, ns.
const SILENT_NS: u64 = 200_000_000;
/// Less than this is no force at all, N.
const PRESSED_N: f64 = 1.0;
/// More samples than a second of the fastest device are not kept waiting.
const WAITING_MAX: usize = 20_000;

/// What the two devices are to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FusionKind {
    /// Two plates, each of which bears a part of the person.
    TwoPlates {
        /// Which of them (0 or 1) is under the left foot, if each is under one foot.
        left: Option<usize>,
    },
    /// A plate that bears the whole person, who wears insoles.
    PlateAndInsoles,
}

/// What the two devices are to each other, and how long one waits for the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FusionSettings {
    /// What they are.
    pub kind: FusionKind,
    /// How long a sample of the first waits, from its coming, ns.
    pub wait_ns: u64,
}

impl FusionSettings {
    /// The usual wait, and as much longer as the second device's constant delay is above the first's, ns.
    pub fn new(kind: FusionKind, latency_ns: [u64; 2]) -> FusionSettings {
        let [first_ns, second_ns] = latency_ns;
        FusionSettings { kind, wait_ns: WAIT_NS + second_ns.saturating_sub(first_ns) }
    }
}

/// Brings two streams of placed samples together.
#[derive(Debug)]
pub struct Fusion {
    settings: FusionSettings,
    /// Samples of the first device, and until when each waits.
    waiting: VecDeque<(GroundSample, u64)>,
    partners: Partners,
    /// Of the second device's sample that was used last: sessions of both add up, whether or not it has a part in this one.
    second_session: u32,
    counts: Counts,
}

impl Fusion {
    /// Nothing has come yet.
    pub fn new(settings: FusionSettings) -> Fusion {
        let (waiting, partners) = (VecDeque::new(), Partners::default());
        Fusion { settings, waiting, partners, second_session: 0, counts: Counts::default() }
    }

    /// Takes in a sample of the first device (0) or of the second.
    pub fn push(&mut self, device: usize, sample: GroundSample, now_ns: u64) {
        if device > 0 {
            if !self.partners.push(sample, now_ns) {
                self.counts.refuse(GroundRefusal::OutOfOrder.index());
            }
            return;
        }
        if self.waiting.len() == WAITING_MAX {
            self.waiting.pop_front();
            self.counts.refuse(GroundRefusal::NoPartner.index());
        }
        self.waiting.push_back((sample, now_ns.saturating_add(self.settings.wait_ns)));
    }

    /// Appends what is whole by now, oldest first. To be asked whenever something was taken in, and some times within
    /// [`WAIT_NS`] anyway.
    pub fn fused(&mut self, now_ns: u64, samples: &mut Vec<GroundSample>) {
        while let Some(&(first, until_ns)) = self.waiting.front() {
            let found = self.partners.at(first.sample_time_ns);
            if matches!(found, Found::NotYet) && now_ns < until_ns && self.is_awaited(now_ns) {
                return;
            }
            self.waiting.pop_front();
            let whole = match found {
                Found::Partner(second) => {
                    self.second_session = second.session;
                    Some(self.together(&first, &second))
                }
                Found::NotYet | Found::Nothing => {
                    self.counts.refuse(GroundRefusal::NoPartner.index());
                    let session = first.session.wrapping_add(self.second_session);
                    (self.settings.kind == FusionKind::PlateAndInsoles)
                        .then_some(GroundSample { session, ..first })
                }
            };
            if let Some(whole) = whole {
                self.counts.published += 1;
                samples.push(GroundSample { sequence: self.counts.published, ..whole });
            }
        }
    }

    /// Samples that were published, and what was refused for want of a partner or order.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Whether a partner may still come. A plate needs no insoles to be whole, so those that fell silent are not waited for:
    /// each sample would only get older.
    fn is_awaited(&self, now_ns: u64) -> bool {
        self.settings.kind != FusionKind::PlateAndInsoles
            || self.partners.came_ns().is_some_and(|came_ns| now_ns.saturating_sub(came_ns) < SILENT_NS)
    }

    fn together(&self, first: &GroundSample, second: &GroundSample) -> GroundSample {
        let both = GroundSample {
            sample_time_sigma_ns: joint_sigma_ns(first.sample_time_sigma_ns, second.sample_time_sigma_ns),
            arrival_ns: first.arrival_ns.max(second.arrival_ns),
            device_status: first.device_status | second.device_status,
            session: first.session.wrapping_add(second.session),
            devices: first.devices | second.devices,
            ..*first
        };
        match self.settings.kind {
            FusionKind::TwoPlates { left } => sum(both, [first, second], left),
            FusionKind::PlateAndInsoles => shared_by_insoles(both, second),
        }
    }
}

/// The sum of both wrenches, about the world's origin as each of them.
fn sum(both: GroundSample, parts: [&GroundSample; 2], left: Option<usize>) -> GroundSample {
    let [first, second] = parts;
    let added = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|axis| a[axis] + b[axis]);
    let whole = GroundSample {
        force_n: added(first.force_n, second.force_n),
        moment_nm: added(first.moment_nm, second.moment_nm),
        // A part that one of them does not measure is missing in the sum.
        not_measured: first.not_measured | second.not_measured,
        ..both
    };
    match left {
        Some(left) if whole.measures(Component::Tilt) => {
            let feet = [parts[left.min(1)], parts[1 - left.min(1)]];
            GroundSample {
                per_foot: 1,
                foot_vertical_n: feet.map(|plate| plate.force_n[2]),
                foot_cop_m: feet.map(centre_m),
                foot_frame: FootFrame::World as u32,
                ..whole
            }
        }
        _ => GroundSample { per_foot: 0, foot_vertical_n: [0.0; 2], foot_cop_m: [[0.0; 2]; 2], ..whole },
    }
}

/// Where a plate is pressed, zero where it is not. Told of small forces, too, where it is noise and nobody may use it: a tare
/// that is to come needs force times centre as it is, however much the empty plate shows.
fn centre_m(plate: &GroundSample) -> [f64; 2] {
    let ([fx, fy, fz], [mx, my, _], z) = (plate.force_n, plate.moment_nm, plate.surface_z_m);
    if fz.abs() < PRESSED_N { [0.0; 2] } else { [(z * fx - my) / fz, (mx + z * fy) / fz] }
}

/// The plate's wrench; the insoles say how the feet share its vertical part, and where each is pressed. They weigh less
/// well than a plate, so only their proportion counts.
fn shared_by_insoles(both: GroundSample, insoles: &GroundSample) -> GroundSample {
    let felt_n = insoles.foot_vertical_n.map(|newtons| newtons.max(0.0));
    let sum_n = felt_n[0] + felt_n[1];
    // An empty plate under empty insoles agrees as well; a person on the plate whose insoles feel nobody has them off.
    if insoles.per_foot != 1 || (sum_n < COP_MIN_VERTICAL_N && both.force_n[2] >= COP_MIN_VERTICAL_N) {
        return GroundSample { devices: both.devices & !insoles.devices, ..both };
    }
    let share = if sum_n > 0.0 { felt_n.map(|newtons| newtons / sum_n) } else { [0.5; 2] };
    GroundSample {
        per_foot: 1,
        foot_vertical_n: share.map(|share| share * both.force_n[2]),
        foot_cop_m: insoles.foot_cop_m,
        foot_frame: insoles.foot_frame,
        ..both
    }
}

/// 1-σ of a time that is two devices' at once; unknown if either is.
fn joint_sigma_ns(first_ns: u64, second_ns: u64) -> u64 {
    if first_ns == u64::MAX || second_ns == u64::MAX {
        return u64::MAX;
    }
    (first_ns as f64).hypot(second_ns as f64).ceil() as u64
}

/// What the second plate of two is called in a sample.
pub fn as_second(device: DeviceKind) -> DeviceKind {
    match device {
        DeviceKind::Plate => DeviceKind::SecondPlate,
        other => other,
    }
}
