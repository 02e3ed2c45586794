//! Stage `register`: registration of the suit world on the plate, a search that starts again when the registration is lost.
//!
//! A restarted suit has another origin and another heading; a suit that was silent for long has drifted. The body is
//! unchanged: while nothing is carried, the CoP predicted from the suit and the measured CoP are the same point, and
//! measured shear divided by the mass is the acceleration that the suit measures. Pairs of them determine position and
//! heading ([`PlanarFit`]), the heading from the subject's movements. Until both are determined, no result that needs
//! them is published and no measurement that needs them updates the filter. After that the fit continues until the
//! heading is as accurate as a segment's orientation.
//!
//! Most suits keep their heading, because they measure magnetic north. So the previous heading is accepted earlier: its
//! prior probability equals that of all others together.

use core::array;

use bytemuck::{Pod, Zeroable};

use super::body_motion::NoiseSigma;
use super::identification::{Identification, REGISTRATION_SIGMA_M};
use super::outputs::Outputs;
use super::residual::{MOTION_ROW_EVERY_NS, ROWS_PER_INDEPENDENT};
use super::settings::Settings;
use crate::body::Side;
use crate::frame::{Pose, StationWorld, Turn};
use crate::math;
use crate::message::{Component, GroundSample, SuitSample};
use crate::registration::PlanarFit;
use crate::sesc::PARAMETERS;

/// While the feet stand, the CoP stays within this distance of its usual position, m: half a foot's length forwards and
/// backwards, half a pace sideways. The root mean square of a uniform distribution is this over √3.
const STANCE_REACH_M: f64 = 0.10;

/// Maximum distance between measured and predicted CoP, m: three σ of a registration that counts as determined …
const DISTANCE_MAX_M: f64 = 3.0 * REGISTRATION_SIGMA_M;
/// … and the number of consecutive rows beyond it: two seconds.
const ROWS_DISTANT_MAX: u64 = 20;

/// Model errors of a pose last as long as the pose: pairs within the two seconds of a squat or a reach carry the
/// information of one pair.
const ROWS_PER_POSE: f64 = 20.0;

/// Odds above which the previous heading is accepted.
const ACCEPT_ODDS: f64 = 20.0;

/// Quality of the suit's registration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
enum RegistrationQuality {
    /// Converged.
    Converged = 0,
    /// Usable; the heading is still being refined.
    Refining = 1,
    /// Unavailable; the search is running.
    Lost = 2,
}

/// The suit's heading, and the search for heading and position.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct RegistrationEstimator {
    /// Rotation from the suit world to the station world, about the vertical, rad.
    station_from_suit_rad: f64,
    /// Its 1-σ beyond the configured uncertainty, rad.
    sigma_rad: f64,
    /// A [`RegistrationQuality`].
    quality: u64,
    /// 1 while insoles alone measure the ground.
    is_unneeded: u64,
    /// 1-σ of the heading at the start of the search, rad.
    initial_sigma_rad: f64,
    /// 1-σ of the heading before the search, rad.
    previous_sigma_rad: f64,
    /// Change of the heading since the search began, rad.
    turned_rad: f64,
    fit: PlanarFit,
    /// Time of the last pair, ns.
    paired_ns: u64,
    /// The anchor's stance.
    stance: u64,
    /// Sensitivity of the first pair's predicted CoP to θ, with the suit in its present heading: rows x and y.
    first_rows: [[f64; PARAMETERS]; 2],
    /// Number of consecutive pairs that contradicted the earlier ones.
    contradictions: u64,
    /// Number of consecutive rows in which the distance between the CoPs was too large for this registration.
    rows_distant: u64,
}

impl RegistrationEstimator {
    /// Whether position or heading is needed but unavailable.
    pub(super) fn is_lost(&self) -> bool {
        self.is_searching() && self.is_unneeded == 0
    }

    fn is_searching(&self) -> bool {
        self.quality == RegistrationQuality::Lost as u64
    }

    /// Rotation from the suit world to the station world, about the vertical, rad.
    pub(super) fn station_from_suit_rad(&self) -> f64 {
        self.station_from_suit_rad
    }

    /// 1-σ of the heading, rad: 0 for the configured heading, π while the heading is unavailable.
    pub(super) fn sigma_rad(&self) -> f64 {
        if self.is_searching() { core::f64::consts::PI } else { self.sigma_rad }
    }

    /// 1-σ of the heading as it affects the results, rad: 0 while no heading is needed.
    pub(super) fn heading_sigma_rad(&self) -> f64 {
        if self.is_unneeded == 1 { 0.0 } else { self.sigma_rad() }
    }

    /// Ingests which devices measure the ground: insoles alone measure in the suit world, so no registration is needed.
    pub(super) fn ingest_ground(&mut self, ground: &GroundSample) {
        self.is_unneeded = u64::from(ground.is_by_insoles_alone());
    }

    /// Ingests the anchor's stance of a snapshot, with the 1-σ of its position relative to the previous stance, m.
    /// Each step adds its own error, also without pairs while a load is carried.
    pub(super) fn ingest_stance(&mut self, stance: u64, [x_m, y_m]: [f64; 2]) {
        if stance != self.stance {
            self.stance = stance;
            self.fit.add_process_noise(x_m.max(y_m) * x_m.max(y_m));
        }
    }

    /// Moves the suit world in the station world, m: the pairs so far move with it.
    pub(super) fn displace(&mut self, by_m: [f64; 2]) {
        self.fit.transform(Turn::by(0.0), by_m);
    }

    /// Marks the registration as lost; the 1-σ of the heading is then `sigma_rad`, or the present one if that is larger:
    /// a gap during a search does not reveal the heading.
    pub(super) fn mark_lost(&mut self, sigma_rad: f64) {
        let present_rad = if self.is_searching() {
            self.initial_sigma_rad
        } else {
            self.previous_sigma_rad = self.sigma_rad;
            self.sigma_rad
        };
        self.initial_sigma_rad = sigma_rad.max(present_rad);
        self.quality = RegistrationQuality::Lost as u64;
        self.contradictions = 0;
        self.turned_rad = 0.0;
        self.fit.start(self.initial_sigma_rad);
    }

    /// If the fit agrees with the heading before the search, whose prior probability equals that of all others
    /// together: fuses the fit with that heading, with its previous uncertainty and `orientation_sigma_rad` combined.
    /// Applies only if the search covers all headings.
    fn fuse_previous_heading(&mut self, orientation_sigma_rad: f64) {
        // The fit maps the plate's axes to the suit's, in their present rotation.
        let off_rad = math::wrapped(self.fit.heading_rad() - self.turned_rad);
        let previous_sigma_rad = math::hypot([self.previous_sigma_rad, orientation_sigma_rad]);
        let sigma_rad = self.fit.heading_sigma_rad();
        let off_sigma_rad = math::hypot([sigma_rad, previous_sigma_rad]);
        let deviation = off_rad / off_sigma_rad;
        // Ratio of the normal density to the uniform one, 1/2π.
        let odds =
            math::sqrt(core::f64::consts::TAU) / off_sigma_rad * math::exp(-0.5 * deviation * deviation);
        let is_open = self.initial_sigma_rad >= core::f64::consts::PI && sigma_rad > previous_sigma_rad;
        if is_open && self.fit.has_begun() && odds >= ACCEPT_ODDS {
            self.fit.ingest_heading(self.turned_rad, previous_sigma_rad);
        }
    }

    /// Ingests the distance between measured and predicted CoP, m. A persistently large distance means that the
    /// registration is lost.
    fn check_distance(&mut self, distance_m: f64) {
        self.rows_distant = if distance_m > DISTANCE_MAX_M { self.rows_distant + 1 } else { 0 };
        if self.rows_distant >= ROWS_DISTANT_MAX {
            self.rows_distant = 0;
            self.mark_lost(core::f64::consts::PI);
        }
    }

    /// Resumes with a stored heading and its σ.
    pub(super) fn resume(&mut self, station_from_suit_rad: f64, sigma_rad: f64) {
        *self = RegistrationEstimator { station_from_suit_rad, sigma_rad, ..Zeroable::zeroed() };
        if sigma_rad >= core::f64::consts::PI {
            self.mark_lost(sigma_rad);
        } else if sigma_rad > 0.0 {
            self.quality = RegistrationQuality::Refining as u64;
            self.initial_sigma_rad = sigma_rad;
            self.fit.start(sigma_rad);
        }
    }

    /// Rotates the sample to the heading of the station world.
    pub(super) fn rotated_to_station(&self, suit: &SuitSample) -> SuitSample {
        if self.station_from_suit_rad == 0.0 {
            *suit
        } else {
            suit.turned(Turn::by(self.station_from_suit_rad))
        }
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let RegistrationEstimator {
            station_from_suit_rad,
            sigma_rad,
            initial_sigma_rad,
            previous_sigma_rad,
            turned_rad,
            ..
        } = *self;
        let angles = [station_from_suit_rad, sigma_rad, initial_sigma_rad, previous_sigma_rad, turned_rad];
        angles.iter().chain(self.first_rows.iter().flatten()).all(|number| number.is_finite())
            && self.quality <= RegistrationQuality::Lost as u64
            && self.is_unneeded <= 1
            && self.fit.is_sound()
    }

    /// Ingests a measured and a predicted CoP. Persistent contradictions restart the search, because the earlier pairs
    /// belong to another registration.
    fn ingest_pair(&mut self, measured_m: [f64; 2], expected_m: [f64; 2], variance_m2: [f64; 2]) {
        if self.fit.ingest_pair(measured_m, expected_m, variance_m2) {
            self.contradictions = 0;
            return;
        }
        self.contradictions += 1;
        if self.contradictions as f64 > ROWS_PER_INDEPENDENT {
            self.contradictions = 0;
            self.fit.start(self.initial_sigma_rad);
        }
    }
}

/// A new registration of the suit world on the plate.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewRegistration {
    /// Rotation about the station's origin, then shift, m.
    pub(super) turn: Turn,
    pub(super) by_m: [f64; 2],
    /// Variance of the body's position, m².
    pub(super) at_m2: [f64; 2],
}

/// Processes one instant without a load: pairs the two CoPs. `sigma`: errors of the compensation, with the residual of
/// this instant. Returns a registration once the fit has converged.
pub(super) fn register(
    settings: &Settings,
    state: &mut RegistrationEstimator,
    outputs: &Outputs<'_>,
    sigma: &NoiseSigma,
    subject: &Identification,
) -> Option<NewRegistration> {
    let snapshot = &outputs.instant.snapshot;
    if snapshot.ground().is_some_and(GroundSample::is_by_insoles_alone) {
        return None;
    }
    let due = snapshot.time_ns.saturating_sub(state.paired_ns) >= MOTION_ROW_EVERY_NS;
    if !settings.suit_drifts || !due || !outputs.instant.both_feet_stand() {
        return None;
    }
    let (measured_m, estimated_m) = (outputs.ground.reading.cop_m, outputs.estimate.cop_m);
    let quality = state.quality;
    if settings.watch_registration && quality != RegistrationQuality::Lost as u64 {
        state.check_distance(math::hypot([0, 1].map(|axis| measured_m[axis] - estimated_m[axis])));
    }
    if quality == RegistrationQuality::Converged as u64 {
        state.paired_ns = snapshot.time_ns;
        return None;
    }
    let of_first_m2 = state.pair(settings, outputs, sigma, subject);
    state.fuse_previous_heading(settings.suit_orientation_sigma_rad());
    let (sigma_rad, fit_m2) = (state.fit.heading_sigma_rad(), state.fit.variance_m2(measured_m));
    let at_m2 = [0, 1].map(|axis| fit_m2[axis] + of_first_m2[axis]);
    let reach_m = STANCE_REACH_M / math::sqrt(3.0) * sigma_rad;
    let is_determined = state.fit.is_rigid()
        && at_m2.iter().all(|at_m2| math::hypot([math::sqrt(*at_m2), reach_m]) <= REGISTRATION_SIGMA_M);
    let is_better = quality == RegistrationQuality::Lost as u64 || sigma_rad <= 0.5 * state.sigma_rad;
    (is_determined && is_better).then(|| {
        let (turn, by_m) = state.adopt_fit(measured_m, settings);
        NewRegistration { turn, by_m, at_m2 }
    })
}

impl RegistrationEstimator {
    /// Ingests the CoPs and accelerations of an instant. Returns the variance of the first pair's position by θ, m².
    fn pair(
        &mut self,
        settings: &Settings,
        outputs: &Outputs<'_>,
        sigma: &NoiseSigma,
        subject: &Identification,
    ) -> [f64; 2] {
        let Outputs { instant, ground, prediction, estimate, .. } = *outputs;
        let (snapshot, body) = (&instant.snapshot, &prediction.body);
        self.paired_ns = snapshot.time_ns;
        let rows = subject.reduction.rows(&instant.pose, body.slope);
        if !self.fit.has_begun() {
            self.first_rows = rows.h;
        }
        // An error of θ also shifts the first pair, which makes it an error of the position. Only its change with the
        // pose is an error of the pair.
        let first = &self.first_rows;
        let since_first =
            [0, 1].map(|axis: usize| array::from_fn(|index| rows.h[axis][index] - first[axis][index]));
        let of_first_m2 = subject.parameter_variance_m2(first);
        let of_body_m2 = subject.parameter_variance_m2(&since_first);
        let drift_m2 = subject.drift_variance_m2(&instant.pose, settings);
        let unmeasured_m = body.cop_sigma_by_acceleration_m(sigma.moving_acceleration_m_per_s2);
        let variance_m2 = [0, 1].map(|axis: usize| {
            let (moving_m, plate_m) = (sigma.cop_m[axis], ground.sigma.cop_m);
            let of_motion_m2 = moving_m * moving_m + plate_m * plate_m + unmeasured_m * unmeasured_m;
            let of_pose_m2 = of_body_m2[axis] + drift_m2[axis];
            ROWS_PER_INDEPENDENT * of_motion_m2 + ROWS_PER_POSE * of_pose_m2
        });
        let offset_m = subject.stance_offset_m();
        let expected_m = [0, 1].map(|axis| estimate.cop_m[axis] - offset_m[axis]);
        self.ingest_pair(ground.reading.cop_m, expected_m, variance_m2);
        let [shear_x_n, shear_y_n, _] = snapshot.ground.force_n;
        if snapshot.ground.measures(Component::Shear) && (shear_x_n, shear_y_n) != (0.0, 0.0) {
            let by_plate = [shear_x_n, shear_y_n].map(|shear_n| shear_n / subject.mass_kg);
            let [x, y, _] = body.suit_acceleration_m_per_s2;
            let sigma = sigma.acceleration_m_per_s2();
            self.fit.ingest_vector(by_plate, [x, y], [ROWS_PER_INDEPENDENT * sigma * sigma; 2]);
        }
        of_first_m2
    }

    /// Adopts the fitted registration; the body's present CoP becomes `measured_m`. Returns the rotation and the shift
    /// of the suit world, m.
    fn adopt_fit(&mut self, measured_m: [f64; 2], settings: &Settings) -> (Turn, [f64; 2]) {
        // The fit maps the plate's axes to the suit's.
        let heading_rad = -self.fit.heading_rad();
        let turn = Turn::by(heading_rad);
        let turned_m = turn.of(self.fit.image_m(measured_m));
        let by_m = [0, 1].map(|axis| measured_m[axis] - turned_m[axis]);
        self.fit.transform(turn, by_m);
        let [x, y] = self.first_rows;
        for (index, (x, y)) in x.into_iter().zip(y).enumerate() {
            [self.first_rows[0][index], self.first_rows[1][index]] = turn.of([x, y]);
        }
        self.station_from_suit_rad = math::wrapped(self.station_from_suit_rad + heading_rad);
        self.turned_rad = math::wrapped(self.turned_rad + heading_rad);
        self.sigma_rad = self.fit.heading_sigma_rad();
        let is_converged = self.sigma_rad <= settings.suit_orientation_sigma_rad();
        self.quality =
            if is_converged { RegistrationQuality::Converged } else { RegistrationQuality::Refining } as u64;
        (turn, by_m)
    }
}

/// 1-σ of a CoP caused by the heading, m: the stance offset applies between the feet, so an error of the heading rotates
/// about that point.
pub(super) fn heading_sigma_m(pose: &Pose<StationWorld>, cop_m: [f64; 2], sigma_rad: f64) -> [f64; 2] {
    let between = 0.5 * (pose.origin_of(Side::Left.foot()) + pose.origin_of(Side::Right.foot()));
    let [ahead_m, sideways_m] = [cop_m[0] - between.x, cop_m[1] - between.y];
    [sideways_m, ahead_m].map(|lever_m| lever_m.abs() * sigma_rad)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;
    use crate::anchor::STANCE_SIGMA_M;
    use crate::body::{SEGMENTS, Skeleton};
    use crate::cycle::alignment::Aligned;
    use crate::cycle::placement::{Placement, anchor, follow};
    use crate::cycle::streams::Streams;

    const PERIOD_NS: u64 = 10_000_000;

    /// Samples of a body that walks on the spot: the left foot is lifted and put down this many times.
    fn walk(placement: &mut Placement, steps: u64) {
        let (settings, subject) = (Settings::for_height(1.77), bytemuck::zeroed_box::<Identification>());
        let streams = Streams {
            suit_period_ns: PERIOD_NS,
            ground_period_ns: PERIOD_NS,
            lag_sigma_s: 0.0,
            lag_is_off: false,
            suit_suspect: Zeroable::zeroed(),
            ground_suspect: Zeroable::zeroed(),
            ground_gap_ns: 0,
            ground_resumed_ns: 0,
            ground_late_ns: 0,
            moved_ns: 0,
        };
        for sample in 0..=2 * steps {
            let mut suit = SuitSample::zeroed();
            suit.sample_time_ns = (100 + sample) * PERIOD_NS;
            suit.orientation_wxyz = [[1.0, 0.0, 0.0, 0.0]; SEGMENTS];
            suit.position_m = Skeleton::nominal(1.77).t_pose_m().map(|[x, y, z]| [x, y, z + 0.96]);
            for segment in [Side::Left.foot(), Side::Left.toe()] {
                suit.position_m[segment.index()][2] += if sample % 2 == 1 { 0.1 } else { 0.0 };
            }
            let followed = follow(&settings, placement, &Aligned { suit, ground: None }, &streams);
            anchor(&settings, placement, &followed, &subject, None);
        }
    }

    #[test]
    fn each_step_without_a_pair_adds_its_error_to_the_fit() {
        let mut placement = bytemuck::zeroed_box::<Placement>();
        placement.registration.mark_lost(0.01);
        assert!(placement.registration.fit.ingest_pair([0.0; 2], [0.0; 2], [1e-6; 2]));
        walk(&mut placement, 10);
        assert_eq!(placement.anchor.stance(), 10);
        let expected_m2 = 1e-6 + 10.0 * STANCE_SIGMA_M * STANCE_SIGMA_M;
        for variance_m2 in placement.registration.fit.variance_m2([0.0; 2]) {
            assert!((variance_m2 - expected_m2).abs() < 1e-12, "{variance_m2} {expected_m2}");
        }
    }

    #[test]
    fn pairs_move_with_the_suit_world() {
        let mut estimator = RegistrationEstimator::zeroed();
        estimator.mark_lost(0.01);
        for x_m in [0.0, 0.1] {
            assert!(estimator.fit.ingest_pair([x_m, 0.0], [x_m, 0.2], [1e-6; 2]));
        }
        estimator.displace([0.5, -0.3]);
        let [x_m, y_m] = estimator.fit.image_m([0.1, 0.0]);
        assert!((x_m - 0.6).abs() < 1e-9 && (y_m + 0.1).abs() < 1e-9, "{x_m} {y_m}");
    }

    #[test]
    fn a_gap_during_a_search_does_not_reveal_the_heading() {
        let gap_sigma_rad = 0.012;
        let after = |start: &dyn Fn(&mut RegistrationEstimator)| {
            let mut estimator = RegistrationEstimator::zeroed();
            start(&mut estimator);
            estimator.mark_lost(gap_sigma_rad);
            estimator.initial_sigma_rad
        };
        assert_eq!(after(&|_| {}), gap_sigma_rad);
        assert_eq!(after(&|estimator| estimator.mark_lost(PI)), PI);
        assert_eq!(after(&|estimator| estimator.resume(0.3, PI)), PI);
        assert_eq!(after(&|estimator| estimator.resume(0.3, 0.5)), 0.5, "while it is refined");
    }
}
