//! Stage `differentiate`: releases a snapshot from the history once the samples of half a window after it arrived, with
//! the accelerations at its time.

use super::align::AlignState;
use super::identification::Identification;
use super::placement::Placement;
use super::settings::{Motion, Settings};
use super::{foot_outline, insoles};
use crate::body::gyration_m2;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::SuitBody;
use crate::motion::{History, Inertia, MassDistribution, Snapshot};

/// Body and ground at one time, to which all later stages refer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instant {
    /// The snapshot.
    pub(super) snapshot: Snapshot,
    /// Its pose.
    pub(super) pose: Pose<StationWorld>,
    /// Accelerations; `None` without samples on both sides.
    pub(super) inertia: Option<Inertia>,
    /// Time since the previous instant, s.
    pub(super) step_s: f64,
    /// Body dimensions reported by the suit, if they were accepted.
    pub(super) suit_body: Option<SuitBody>,
    /// Whether position or heading of the body on the plate are unavailable.
    pub(super) place_is_lost: bool,
    /// 1-σ of the heading, rad.
    pub(super) heading_sigma_rad: f64,
}

impl Instant {
    /// Whether both feet stand.
    pub(super) fn both_feet_stand(&self) -> bool {
        self.snapshot.both_feet_stand == 1
    }

    /// 1-σ of a segment's orientation in the station world, rad.
    pub(super) fn orientation_sigma_rad(&self, settings: &Settings) -> f64 {
        math::hypot([settings.suit_orientation_sigma_rad(), self.heading_sigma_rad])
    }
}

/// The next snapshot whose window is complete.
pub(super) fn differentiate(
    settings: &Settings,
    history: &mut History,
    align: &AlignState,
    placement: &Placement,
    subject: &Identification,
    suit_body: Option<&SuitBody>,
) -> Option<Instant> {
    let before_ns = history.released_ns();
    let half_ns = settings.half_window_ns();
    let gyration_m2 = gyration_m2(&subject.skeleton(), settings.height_m);
    let masses = MassDistribution { body: subject.anthropometry(), gyration_m2: &gyration_m2 };
    let (mut snapshot, inertia) = history.next(half_ns, settings.accelerations, &masses)?;
    let pose = snapshot.pose();
    // The force that belongs to accelerations by positions is the mean over the same window.
    let by_positions = inertia.filter(|inertia| !inertia.is_by_suit && settings.motion != Motion::Paper);
    if let Some(inertia) = by_positions
        && let Some(time_ns) = snapshot.ground().map(|ground| ground.sample_time_ns)
        && let Some(ground) = align.alignment.ground_around(time_ns, inertia.half_window_ns)
    {
        let outlines = foot_outline::both(&pose, suit_body, settings.height_m);
        snapshot.ground = insoles::to_world(&ground, &pose, &outlines);
    }
    Some(Instant {
        snapshot,
        pose,
        inertia,
        step_s: snapshot.time_ns.saturating_sub(before_ns) as f64 * 1e-9,
        suit_body: suit_body.copied(),
        place_is_lost: placement.registration.is_lost(),
        heading_sigma_rad: placement.registration.heading_sigma_rad(),
    })
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::boxed::Box;

    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::GRAVITY_M_PER_S2;
    use crate::body::{SEGMENTS, Skeleton};
    use crate::cycle::settings::Accelerations;
    use crate::frame::SuitWorld;
    use crate::message::GroundSample;

    const MS_NS: u64 = 1_000_000;
    const SUIT_PERIOD_NS: u64 = 4_166_667;
    const MASS_KG: f64 = 80.0;
    const OMEGA: f64 = 3.0 * core::f64::consts::TAU;
    const AMPLITUDE_M: f64 = 0.01;

    /// A wrench of a body that oscillates up and down.
    fn ground_at(time_ns: u64) -> GroundSample {
        let acceleration = -AMPLITUDE_M * OMEGA * OMEGA * math::sin_cos(OMEGA * time_ns as f64 * 1e-9).0;
        GroundSample {
            sample_time_ns: time_ns,
            force_n: [0.0, 0.0, MASS_KG * (GRAVITY_M_PER_S2 + acceleration)],
            ..bytemuck::Zeroable::zeroed()
        }
    }

    fn pose_at(time_ns: u64) -> Pose<SuitWorld> {
        let up_m = 0.95 + AMPLITUDE_M * math::sin_cos(OMEGA * time_ns as f64 * 1e-9).0;
        let origin = Skeleton::nominal(1.77).t_pose_m().map(|at| Vector3::from(at) + up_m * Vector3::z());
        Pose::new(origin, [UnitQuaternion::identity(); SEGMENTS])
    }

    /// Largest difference between force and inertia in two seconds, as a fraction of the true inertia, with a suit of 240
    /// Hz that is `late_ns` later than the plate. `None` without accelerations.
    fn unbalanced(half_window_ns: u64, late_ns: u64) -> Option<f64> {
        let settings = Settings {
            motion: Motion::Compensated { half_window_ns },
            accelerations: Accelerations::Positions,
            ..Settings::for_height(1.77)
        };
        let mut subject = bytemuck::zeroed_box::<Identification>();
        subject.start(&settings);
        while !subject.has_body() {
            subject.update_skeleton(&pose_at(0), &settings);
        }
        let mut align = bytemuck::zeroed_box::<AlignState>();
        let placement = bytemuck::zeroed_box::<Placement>();
        let mut history: Box<History> = bytemuck::zeroed_box();
        let (mut suit_ns, mut worst) = (0, None);
        for now_ns in (1..3000).map(|millisecond| millisecond * MS_NS) {
            align.alignment.push_ground(&ground_at(now_ns));
            if now_ns < suit_ns + SUIT_PERIOD_NS + late_ns {
                continue;
            }
            suit_ns += SUIT_PERIOD_NS;
            let pose = pose_at(suit_ns);
            let mut snapshot =
                Snapshot::new(suit_ns, &pose, &pose.shifted(Vector3::zeros()), subject.anthropometry());
            (snapshot.ground, snapshot.has_ground) = (ground_at(suit_ns), 1);
            history.push(snapshot);
            while let Some(instant) =
                differentiate(&settings, &mut history, &align, &placement, &subject, None)
            {
                let Some(inertia) = instant.inertia.filter(|_| suit_ns > 1000 * MS_NS) else { continue };
                let force = instant.snapshot.ground.force_n[2] / MASS_KG;
                let off = (force - GRAVITY_M_PER_S2 - inertia.acceleration_m_per_s2[2]).abs();
                worst = Some(off.max(worst.unwrap_or(0.0)));
            }
        }
        worst.map(|off: f64| off / (AMPLITUDE_M * OMEGA * OMEGA))
    }

    #[test]
    fn force_and_inertia_pass_the_same_filter() {
        // At 240 Hz the history stores 129 ms on either side of a snapshot: less than the second window.
        for (half_window_ns, late_ns) in [(70, 0), (250, 0), (70, 500), (250, 500)] {
            let off = unbalanced(half_window_ns * MS_NS, late_ns * MS_NS).unwrap();
            assert!(off < 0.05, "{half_window_ns} ms, suit {late_ns} ms late: {off}");
        }
    }
}
