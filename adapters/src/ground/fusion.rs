//! Fuses two devices by sample time to one ground sample, which lists the contributing devices.
//!
//! Each device has its own clock, and a separate fit maps each clock to the host's; samples are therefore matched by
//! sample time, never by arrival. The first device sets the rate. The second is interpolated between its two neighbours
//! in time, never held and never extrapolated: a sample of the first device waits for its partner, for a bounded time.
//!
//! One of two plates measures only a part of the ground reaction, so a sample without a partner is dropped. A plate
//! used with insoles measures all of it: if they are silent or report a fault, its sample is published, and `devices`
//! reports their absence.

mod queue;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use equipoise_core::message::ground::COP_MIN_VERTICAL_N;
use equipoise_core::message::{Component, FootFrame, GroundDevice as DeviceKind, GroundSample};

use super::refusal::GroundRefusal;
use crate::counts::Counts;
use queue::{PartnerLookup, Partners};

/// Wait of a first device's sample for its partner, in addition to the second device's larger constant delay, ns.
pub const WAIT_NS: u64 = 50_000_000;
/// Tolerance between the surface heights of two plates, m: with shear of a tenth of the weight it moves the common
/// centre of pressure by 0.5 mm.
pub const SURFACES_AGREE_M: f64 = 0.005;
/// Insoles that were silent for this long are not waited for, ns.
const SILENT_NS: u64 = 200_000_000;
/// A smaller force counts as none, N.
const PRESSED_N: f64 = 1.0;
/// Limit of waiting samples: more than a second of the fastest device.
const WAITING_MAX: usize = 20_000;

/// Relation of the two devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FusionKind {
    /// Two plates, each of which carries a part of the person.
    TwoPlates {
        /// Index of the plate under the left foot (0 or 1), if each plate is under one foot.
        left: Option<usize>,
    },
    /// A plate that carries the whole person, who wears insoles.
    PlateAndInsoles,
}

/// Relation of the two devices, and the wait of one for the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FusionSettings {
    /// Relation of the devices.
    pub kind: FusionKind,
    /// Wait of a first device's sample from its arrival, ns.
    pub wait_ns: u64,
}

impl FusionSettings {
    /// The default wait, extended by the excess of the second device's constant delay over the first's, ns.
    pub fn new(kind: FusionKind, latency_ns: [u64; 2]) -> FusionSettings {
        let [first_ns, second_ns] = latency_ns;
        FusionSettings { kind, wait_ns: WAIT_NS + second_ns.saturating_sub(first_ns) }
    }
}

/// Fuses two streams of samples in the world frame.
#[derive(Debug)]
pub struct Fusion {
    settings: FusionSettings,
    /// Samples of the first device, and the end of the wait of each.
    waiting: VecDeque<(GroundSample, u64)>,
    partners: Partners,
    /// Session of the second device's sample used last: the sessions of both are summed, whether or not the second
    /// device contributes.
    second_session: u32,
    counts: Counts,
}

impl Fusion {
    /// Creates a fusion without samples.
    pub fn new(settings: FusionSettings) -> Fusion {
        let (waiting, partners) = (VecDeque::new(), Partners::default());
        Fusion { settings, waiting, partners, second_session: 0, counts: Counts::default() }
    }

    /// Adds a sample of the first device (0) or of the second.
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

    /// Appends the samples that are complete, oldest first. To be called after each [`Self::push`], and several times
    /// within [`WAIT_NS`] in any case.
    pub fn fused(&mut self, now_ns: u64, samples: &mut Vec<GroundSample>) {
        while let Some(&(first, until_ns)) = self.waiting.front() {
            let partner = self.partners.at(first.sample_time_ns);
            if matches!(partner, PartnerLookup::NotYet) && now_ns < until_ns && self.is_awaited(now_ns) {
                return;
            }
            self.waiting.pop_front();
            let whole = match partner {
                // A fault of the insoles does not invalidate the plate.
                PartnerLookup::Partner(second) if self.is_plate_alone(&second) => {
                    self.second_session = second.session;
                    self.without_partner(&first)
                }
                PartnerLookup::Partner(second) => {
                    self.second_session = second.session;
                    Some(self.together(&first, &second))
                }
                PartnerLookup::NotYet | PartnerLookup::Nothing => self.without_partner(&first),
            };
            if let Some(whole) = whole {
                self.counts.published += 1;
                samples.push(GroundSample { sequence: self.counts.published, ..whole });
            }
        }
    }

    /// Count of published samples, and of those refused for lack of a partner or of order.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Whether a partner may still arrive. A plate is complete without insoles, so silent ones are not waited for: the
    /// wait would only delay each sample.
    fn is_awaited(&self, now_ns: u64) -> bool {
        self.settings.kind != FusionKind::PlateAndInsoles
            || self
                .partners
                .last_arrival_ns()
                .is_some_and(|last_arrival_ns| now_ns.saturating_sub(last_arrival_ns) < SILENT_NS)
    }

    /// Whether a plate's partner is a sample of faulty insoles.
    fn is_plate_alone(&self, second: &GroundSample) -> bool {
        self.settings.kind == FusionKind::PlateAndInsoles && second.device_status != 0
    }

    /// The sample of a plate without insoles; `None` with two plates.
    fn without_partner(&mut self, first: &GroundSample) -> Option<GroundSample> {
        self.counts.refuse(GroundRefusal::NoPartner.index());
        let session = first.session.wrapping_add(self.second_session);
        (self.settings.kind == FusionKind::PlateAndInsoles).then_some(GroundSample { session, ..*first })
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

/// The sum of both wrenches, all about the world's origin.
fn sum(both: GroundSample, parts: [&GroundSample; 2], left: Option<usize>) -> GroundSample {
    let [first, second] = parts;
    let added = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|axis| a[axis] + b[axis]);
    let whole = GroundSample {
        clock_epoch: first.clock_epoch.wrapping_add(second.clock_epoch),
        force_n: added(first.force_n, second.force_n),
        moment_nm: added(first.moment_nm, second.moment_nm),
        // A component that one of them does not measure is unavailable in the sum.
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

/// Centre of pressure of a plate, zero without force. It is also returned for small forces, where it is noise and must
/// not be used directly: a later tare needs the unmodified product of force and centre, even if the empty plate shows
/// an offset.
fn centre_m(plate: &GroundSample) -> [f64; 2] {
    let ([fx, fy, fz], [mx, my, _], z) = (plate.force_n, plate.moment_nm, plate.surface_z_m);
    if fz.abs() < PRESSED_N { [0.0; 2] } else { [(z * fx - my) / fz, (mx + z * fy) / fz] }
}

/// The plate's wrench; the insoles provide the feet's fractions of its vertical component, and each foot's centre.
/// Insoles measure force less accurately than a plate, so only their ratio is used.
fn shared_by_insoles(both: GroundSample, insoles: &GroundSample) -> GroundSample {
    let insole_n = insoles.foot_vertical_n.map(|newtons| newtons.max(0.0));
    let sum_n = insole_n[0] + insole_n[1];
    // An empty plate with unloaded insoles is consistent; a loaded plate with unloaded insoles means that they are not
    // worn.
    if insoles.per_foot != 1 || (sum_n < COP_MIN_VERTICAL_N && both.force_n[2] >= COP_MIN_VERTICAL_N) {
        return GroundSample { devices: both.devices & !insoles.devices, ..both };
    }
    let fraction = if sum_n > 0.0 { insole_n.map(|newtons| newtons / sum_n) } else { [0.5; 2] };
    GroundSample {
        per_foot: 1,
        foot_vertical_n: fraction.map(|fraction| fraction * both.force_n[2]),
        foot_cop_m: insoles.foot_cop_m,
        foot_frame: insoles.foot_frame,
        ..both
    }
}

/// 1-σ of the time of a fused sample; unknown if either device's is.
fn joint_sigma_ns(first_ns: u64, second_ns: u64) -> u64 {
    if first_ns == u64::MAX || second_ns == u64::MAX {
        return u64::MAX;
    }
    (first_ns as f64).hypot(second_ns as f64).ceil() as u64
}

/// Device kind of the second of two plates in a sample.
pub fn as_second(device: DeviceKind) -> DeviceKind {
    match device {
        DeviceKind::Plate => DeviceKind::SecondPlate,
        other => other,
    }
}
