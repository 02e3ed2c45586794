//! Evaluates one aligned sample: pose, static pose detection, and the torques of the load.

use nalgebra::Vector3;

use super::alignment::Aligned;
use super::body_motion::BodyMotion;
use super::ground_rates::PlateReading;
use super::insoles::GroundSigma;
use super::memory::Memory;
use super::settings::{Motion, Settings};
use super::stored_state::SHIFT_VALID_NS;
use super::{CLOCK_SIGMA_MAX_NS, foot_outline, insoles, support};
use crate::body::{JOINTS, gyration_m2};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::ground::NoCop;
use crate::message::state::{AccelerationSource, SharingSource, Unavailable};
use crate::message::suit::SuitBlocks;
use crate::message::{Component, GroundSample, State, SuitSample, Validity};
use crate::motion::{Inertia, MassDistribution, Snapshot};
use crate::overload::{GRAVITY_M_PER_S2, Level, Levels};
use crate::sesc::centre_of_mass;
use crate::static_pose::{PoseStatistics, WindowSample};

/// Within this multiple of the static pose thresholds the static equations are accurate enough to publish torques.
const NEARLY_STATIC: f64 = 3.0;
/// After a gap this long in the suit's samples the subject may stand elsewhere, ns.
const GAP_RESET_NS: u64 = 300_000_000;
/// Maximum shear of a static body, as a fraction of its weight; more means an external horizontal force.
const SHEAR_SHARE_MAX: f64 = 0.02;
/// Tolerance for a CoP outside the modelled foot outlines, m.
pub(super) const SUPPORT_MARGIN_M: f64 = 0.02;

impl Memory {
    /// Ingests one aligned sample and processes every snapshot whose window it completes.
    pub(super) fn ingest_aligned(&mut self, settings: &Settings, aligned: &Aligned) {
        self.confirm_shift(&aligned.suit, settings);
        self.reset_after_gap(&aligned.suit, settings);
        let suit = &self.registration.rotated_to_station(&aligned.suit);
        let in_suit_world = suit.pose();
        self.processed_ns = suit.sample_time_ns;
        let had_body = self.identification.has_body();
        self.update_body(&in_suit_world, suit, settings);
        self.identification.update_skeleton(&in_suit_world, settings);
        if !had_body && self.identification.has_body() {
            // The change to another body model would otherwise look like a leap of the centre of mass.
            self.history.clear();
        }
        let in_suit_world = if self.identification.has_body() && settings.motion != Motion::Paper {
            in_suit_world.halfway_along(&self.identification.skeleton())
        } else {
            in_suit_world
        };
        let pose = if settings.suit_drifts {
            self.anchor.hold(&in_suit_world)
        } else {
            self.anchor.track(&in_suit_world)
        };
        let body = *self.identification.anthropometry();
        let mut snapshot = Snapshot::new(suit.sample_time_ns, &in_suit_world, &pose, &body);
        (snapshot.stance, snapshot.stance_sigma_m) = (self.anchor.stance(), self.anchor.stance_sigma_m());
        snapshot.both_feet_stand = u64::from(self.anchor.both_feet_stand());
        snapshot.time_sigma_ns = suit.sample_time_sigma_ns;
        if suit.has(SuitBlocks::CentreOfMass) {
            let ([x, y, z], [shift_x, shift_y]) = (suit.com_m, snapshot.station_from_suit_m);
            (snapshot.suit_com_m, snapshot.has_suit_com) = ([x + shift_x, y + shift_y, z], 1);
        }
        if suit.has(SuitBlocks::LinearKinematics) {
            (snapshot.acceleration_m_per_s2, snapshot.has_acceleration) = (suit.acceleration_m_per_s2, 1);
        }
        if let Some(ground) = aligned.ground {
            snapshot.time_sigma_ns = snapshot.time_sigma_ns.max(ground.sample_time_sigma_ns);
            let outlines = foot_outline::both(&pose, self.reported_body.body(), settings.height_m);
            snapshot.ground = insoles::to_world(&ground, &pose, &outlines);
            snapshot.has_ground = 1;
        }
        self.history.push(snapshot);
        let half_window_ns = settings.half_window_ns();
        let gyration_m2 = gyration_m2(&self.identification.skeleton(), settings.height_m);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        // Bounded: the history holds a fixed number of snapshots.
        while let Some((snapshot, inertia)) =
            self.history.next(half_window_ns, settings.accelerations, &masses)
        {
            self.process_snapshot(settings, &snapshot, inertia);
        }
    }

    /// After a gap in the samples or a restart of the suit the subject may stand elsewhere.
    fn reset_after_gap(&mut self, suit: &SuitSample, settings: &Settings) {
        let gap_ns = suit.sample_time_ns.saturating_sub(self.processed_ns);
        let is_new_world = self.has_restarted(suit) || self.plausibility.moved_ns == suit.sample_time_ns;
        let is_new_session = u64::from(suit.session) != self.session;
        let is_restart = self.processed_ns > 0 && (gap_ns > GAP_RESET_NS || is_new_session || is_new_world);
        self.session = u64::from(suit.session);
        self.suit_counter = u64::from(suit.device_counter);
        if !is_restart {
            return;
        }
        self.history.clear();
        self.window.clear();
        self.unloaded.clear();
        if settings.suit_drifts {
            self.anchor.mark_lost();
            if self.identification.has_body() && is_new_world {
                self.identification.new_stance(settings);
            } else if self.identification.has_body() {
                self.identification.widen_stance_offset();
            }
            if is_new_world {
                self.registration.mark_lost(core::f64::consts::PI);
            } else if gap_ns > SHIFT_VALID_NS {
                self.registration.mark_lost(settings.suit_orientation_sigma_rad());
            }
        }
    }

    /// Processes one snapshot: pose, static pose detection, and the torques of the load.
    fn process_snapshot(&mut self, settings: &Settings, snapshot: &Snapshot, inertia: Option<Inertia>) {
        let half_ns = settings.half_window_ns();
        let mut snapshot = *snapshot;
        let by_positions = inertia.is_some_and(|inertia| !inertia.is_by_suit);
        if by_positions
            && settings.motion != Motion::Paper
            && let Some(time_ns) = snapshot.ground().map(|ground| ground.sample_time_ns)
            && let Some(ground) = self.alignment.ground_around(time_ns, half_ns)
        {
            let pose = snapshot.pose();
            let outlines = foot_outline::both(&pose, self.reported_body.body(), settings.height_m);
            snapshot.ground = insoles::to_world(&ground, &pose, &outlines);
        }
        let snapshot = &snapshot;
        let pose = snapshot.pose();
        let step_s = snapshot.time_ns.saturating_sub(self.estimate.suit_sample_time_ns) as f64 * 1e-9;
        self.estimate.suit_sample_time_ns = snapshot.time_ns;
        self.estimate.group_delay_ns = self.processed_ns.saturating_sub(snapshot.time_ns);
        self.estimate.stance = snapshot.stance as u32;
        self.force_offset.predict(step_s);
        self.apply_mass_to_force_offset();
        self.ground_sigma = GroundSigma::of(snapshot.ground(), &self.force_offset, settings);
        let before = self.previous_reading(step_s);
        self.set_unavailable(Unavailable::SuitCom, snapshot.has_suit_com != 1);
        let mut invalid = Validity::default();
        let unsynchronised = snapshot.time_sigma_ns > CLOCK_SIGMA_MAX_NS || self.skew.is_off();
        invalid.raise(Validity::CLOCK_UNSYNCHRONISED, unsynchronised);
        // The results belong to the snapshot, which may predate the body.
        invalid.raise(Validity::BODY_UNKNOWN, !self.identification.has_body());
        invalid.raise(Validity::POSITION_UNKNOWN, self.registration.is_lost());

        // A snapshot's time may lie between two samples.
        let period_ns = self.alignment.ground_period_ns();
        let standing = snapshot
            .ground()
            .copied()
            .and_then(|ground| self.apply_ground(&ground, half_ns.max(period_ns), &mut invalid));
        let is_off = standing.is_none() && !invalid.any_of(Validity::COP_NOT_MEASURED);
        invalid.raise(Validity::FEET_OFF_PLATE, is_off);
        let [from_ns, to_ns] = [snapshot.time_ns.saturating_sub(half_ns), snapshot.time_ns + half_ns];
        invalid.raise(Validity::SUIT_IMPLAUSIBLE, self.plausibility.suit.overlaps(from_ns, to_ns));
        let is_suspect = invalid.any_of(Validity::IMPLAUSIBLE);
        let standing = standing.filter(|_| !is_suspect);
        let now = standing.map(|cop_m| PlateReading { vertical_n: snapshot.ground.force_n[2], cop_m });
        self.add_time_error(snapshot, before, now, step_s);
        // The plate may have recovered since, but this snapshot has no ground sample, and the last values belong to an
        // earlier one.
        invalid.raise(Validity::GROUND_STALE, snapshot.ground().is_none());
        match standing {
            Some(cop_m) => {
                let sample = WindowSample {
                    time_ns: snapshot.time_ns,
                    stance: snapshot.stance,
                    cop_m,
                    vertical_n: snapshot.ground.force_n[2],
                    ..bytemuck::Zeroable::zeroed()
                };
                self.window.push(&pose, sample, self.alignment.suit_period_ns());
            }
            None => self.window.clear(),
        }
        let statistics = self.window.statistics();
        let is_static = statistics.is_some_and(|window| window.is_static(&settings.static_pose));
        self.estimate.static_pose = u32::from(is_static);
        let nearly_static =
            statistics.is_some_and(|window| window.is_within(&settings.static_pose, NEARLY_STATIC));
        let motion = match (settings.motion, inertia) {
            (Motion::Paper, _) => Some(Inertia::REST),
            (_, Some(inertia)) if inertia.is_moderate() => Some(inertia),
            (_, None) if nearly_static => Some(Inertia::REST),
            _ => None,
        };
        invalid.raise(Validity::MOVING, motion.is_none());

        let by_suit = motion.is_some_and(|inertia| inertia.is_by_suit);
        let source = if by_suit { AccelerationSource::Suit } else { AccelerationSource::Positions };
        self.estimate.acceleration_source = source as u32;

        self.compare_with_suggestion(&pose, is_static, settings);
        if self.identification.has_body() {
            self.identification.update_stance(snapshot.stance, snapshot.stance_sigma_m, settings);
        }
        let mut observation = self.observe(&pose, snapshot, inertia, settings);
        self.predict_terms(observation.as_mut(), settings);
        let body = self.body_motion(&pose, snapshot, (motion, is_suspect), step_s, settings);
        self.apply_terms(observation.as_mut(), &pose, &body, step_s, settings);
        if !is_suspect {
            self.noise.update(&body, self.identification.mass_kg, step_s);
        }
        if motion.is_some() && standing.is_some() && self.identification.has_body() {
            self.weigh(&pose, snapshot, &body, step_s, settings);
        }
        self.estimate_cop(&pose, &body, settings);
        // The stance offset applies to everything that is placed on the plate.
        let offset_m = self.identification.stance_offset_m();
        let on_plate = pose.displaced(offset_m);
        self.estimate.segment_origin_m = on_plate.origin.map(Into::into);
        let [x, y, z] = snapshot.suit_com_m;
        self.estimate.suit_com_m = [x + offset_m[0], y + offset_m[1], z];
        if invalid.any_of(Validity::GROUND_IMPLAUSIBLE) {
            self.compare_weight(snapshot, &body, step_s, settings);
        }
        let without_terms = statistics.and_then(|window| self.terms.subtract_from(&window, &settings.model));
        if let Some(statistics) = without_terms.filter(|_| is_static) {
            self.update_from_static_pose(&on_plate, snapshot, &body, &statistics, settings);
        }
        if !is_suspect {
            self.overload(&on_plate, &body, snapshot, step_s, settings, &mut invalid);
        }
        self.test_lag(snapshot, &body, motion.is_some() && standing.is_some(), settings);
        invalid.raise(Validity::CLOCK_UNSYNCHRONISED, self.lag_test.is_off());
        self.update_exposure(&on_plate, &body, settings, invalid);
        if motion.is_some() && standing.is_some() && !invalid.any_of(Validity::CLOCK_UNSYNCHRONISED) {
            self.update_from_residual(&pose, snapshot, &body, step_s, settings);
        } else {
            self.unloaded.clear();
        }
        self.invalid = invalid.0;
    }

    /// Motion of the body without the load.
    ///
    /// If the plate measures shear, the shear gives the horizontal acceleration more accurately than positions
    /// differentiated twice. Persistent shear that no motion explains is an external horizontal force; the suit's
    /// acceleration is used then.
    fn body_motion(
        &mut self,
        pose: &Pose<StationWorld>,
        snapshot: &Snapshot,
        (inertia, is_suspect): (Option<Inertia>, bool),
        step_s: f64,
        settings: &Settings,
    ) -> BodyMotion {
        let subject = &self.identification;
        let (Some(inertia), Motion::Compensated { .. }) = (inertia, settings.motion) else {
            return BodyMotion::REST;
        };
        let centre = centre_of_mass(pose, &subject.phi());
        let floor_m = snapshot.ground().map_or(0.0, |ground| ground.surface_z_m);
        let mut body = BodyMotion::by_suit(&inertia, centre.z, floor_m);
        if let Some(ground) = snapshot.ground() {
            let [terms_x_n, terms_y_n, terms_z_n] = self.terms.force_n;
            let unloaded_n = self.unloaded_force_n(body.specific_force_m_per_s2);
            let delta_f_n = ground.force_n[2] - terms_z_n - unloaded_n;
            let load_kg = if delta_f_n > self.load_limit_n(settings) { body.load_kg(delta_f_n) } else { 0.0 };
            // Shear is unusable while the heading of the suit is unavailable.
            let has_shear = ground.measures(Component::Shear) && !self.registration.is_lost() && !is_suspect;
            if !has_shear && !is_suspect {
                self.noise.reset_external_force();
            }
            let by_shear = body.by_shear(ground.force_n, subject.mass_kg, load_kg);
            if let Some([shear, unexplained]) = by_shear.filter(|_| has_shear) {
                let explained = [terms_x_n, terms_y_n].map(|force_n| force_n / subject.mass_kg);
                let unexplained = [0, 1].map(|axis| unexplained[axis] - explained[axis]);
                let bias = self.noise.update_shear(unexplained, step_s);
                if !self.noise.has_external_force() {
                    // A plate that is not level measures shear without motion.
                    body.use_acceleration([0, 1].map(|axis| shear[axis] - bias[axis]));
                }
            }
        }
        body
    }

    /// Whether the readings of an implausible plate match this subject alone, without a load.
    fn compare_weight(&mut self, snapshot: &Snapshot, body: &BodyMotion, step_s: f64, settings: &Settings) {
        let subject = &self.identification;
        let is_identified = subject.identified == 1 && subject.mass_kg > 0.0 && !self.registration.is_lost();
        let unloaded_n = self.unloaded_force_n(body.specific_force_m_per_s2);
        let off_n = (snapshot.ground.force_n[2] - self.terms.force_n[2] - unloaded_n).abs();
        let State { cop_measured_m, cop_estimated_m, cop_sigma_m, .. } = self.estimate;
        let cop_agrees = (0..2).all(|axis| {
            let sigma_m = math::hypot([cop_sigma_m[axis], self.ground_sigma.cop_m]);
            (cop_measured_m[axis] - cop_estimated_m[axis]).abs() < 3.0 * sigma_m
        });
        let agrees = is_identified.then_some(off_n < self.load_limit_n(settings) && cop_agrees);
        self.plausibility.ingest_weight_agreement(agrees, step_s);
    }

    /// Computes the centre of mass and the estimated unloaded CoP in this motion, each with its σ.
    fn estimate_cop(&mut self, pose: &Pose<StationWorld>, body: &BodyMotion, settings: &Settings) {
        if !self.identification.has_body() {
            return;
        }
        let rows = self.identification.reduction.rows(pose, body.slope);
        let static_m = self.identification.predict_cop_m(&rows);
        let theta_m2 = self.identification.cop_variance_m2(&rows);
        let drift_m2 = self.identification.drift_variance_m2(pose, settings);
        let [x, y] = self.identification.stance_offset_m();
        self.estimate.com_m =
            (centre_of_mass(pose, &self.identification.phi()) + Vector3::new(x, y, 0.0)).into();
        let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
        // Without measured shear, only the suit measures the body's acceleration; the contribution vanishes at rest.
        let unmeasured_m = if self.estimate.unavailable & Unavailable::Shear as u32 == 0 {
            0.0
        } else {
            body.cop_sigma_by_acceleration_m(self.noise.moving_acceleration_sigma_m_per_s2())
        };
        let cop_m = [0, 1].map(|axis| static_m[axis] + body.cop_beyond_rows_m(axis) + self.terms.cop_m[axis]);
        self.estimate.cop_estimated_m = cop_m;
        let heading_m = self.registration.heading_sigma_m(pose, cop_m);
        let variance_m2 = [0, 1].map(|axis: usize| {
            let moving = self.noise.cop[axis].sigma(self.noise.cop_activity_m[axis].height());
            let by_body_m2 =
                theta_m2[axis] + drift_m2[axis] + floor + moving * moving + unmeasured_m * unmeasured_m;
            by_body_m2 + heading_m[axis] * heading_m[axis]
        });
        self.estimate.cop_sigma_m = variance_m2.map(math::sqrt);
        self.stance_sigma = self.identification.stance_sigma(&rows, variance_m2);
    }

    /// Updates the filter with one more static pose if no load is carried.
    fn update_from_static_pose(
        &mut self,
        pose: &Pose<StationWorld>,
        snapshot: &Snapshot,
        body: &BodyMotion,
        statistics: &PoseStatistics,
        settings: &Settings,
    ) {
        let outlines = foot_outline::both(pose, self.reported_body.body(), settings.height_m);
        let weight_n = self.unloaded_force_n(GRAVITY_M_PER_S2);
        let subject = &mut self.identification;
        let supported = support::is_supported(pose, statistics.cop_m, &outlines, SUPPORT_MARGIN_M);
        if self.registration.is_lost()
            || !supported
            || snapshot.both_feet_stand != 1
            || subject.mass_kg <= 0.0
        {
            return;
        }
        // The paper has no load threshold.
        let tolerance_n = match settings.motion {
            Motion::Paper => settings.static_pose.weight_share * weight_n,
            Motion::Compensated { .. } => {
                (settings.static_pose.weight_share * weight_n).min(settings.load_threshold_n)
            }
        };
        let [x, y] = [0, 1].map(|axis| snapshot.ground.force_n[axis] - self.terms.force_n[axis]);
        // Only shear reveals an external horizontal force; without shear it stays undetected.
        let has_external_force = snapshot.ground.measures(Component::Shear)
            && (math::hypot([x, y]) > SHEAR_SHARE_MAX * weight_n || self.noise.has_external_force());
        let unloaded = (statistics.vertical_n - weight_n).abs() < tolerance_n && !has_external_force;
        let wanted =
            subject.has_body() && subject.identifying == 1 && !subject.has_used(&self.window, settings);
        if wanted && unloaded {
            let lasting_m =
                [0, 1].map(|axis| math::hypot([self.ground_sigma.lasting_cop_m, body.shift_m(axis)]));
            subject.update_from_pose(&self.window, statistics, lasting_m, settings);
        }
    }

    /// Force and centre of pressure of a ground sample; no CoP if nothing stands on the plate or the plate is faulty.
    fn apply_ground(
        &mut self,
        ground: &GroundSample,
        around_ns: u64,
        invalid: &mut Validity,
    ) -> Option<[f64; 2]> {
        let cop = ground.cop_m();
        invalid.raise(Validity::PLATE_FAULT, matches!(cop, Err(NoCop::DeviceStatus(_))));
        let [from_ns, to_ns] =
            [ground.sample_time_ns.saturating_sub(around_ns), ground.sample_time_ns + around_ns];
        invalid.raise(Validity::GROUND_IMPLAUSIBLE, self.plausibility.ground.overlaps(from_ns, to_ns));
        self.estimate.ground_force_n = ground.force_n;
        self.estimate.ground_devices = ground.devices;
        self.set_unavailable(Unavailable::Shear, !ground.measures(Component::Shear));
        invalid.raise(Validity::COP_NOT_MEASURED, matches!(cop, Err(NoCop::NotMeasured)));
        self.estimate.cop_measured_m = cop.unwrap_or_default();
        cop.ok()
    }

    /// Records whether the station's sensors provide a quantity.
    fn set_unavailable(&mut self, what: Unavailable, missing: bool) {
        let others = self.estimate.unavailable & !(what as u32);
        self.estimate.unavailable = others | if missing { what as u32 } else { 0 };
    }

    /// Reports the ground measurement while the suit is silent.
    pub(super) fn apply_ground_alone(&mut self) {
        let Some(ground) = self.alignment.newest_ground().copied() else { return };
        let mut invalid = Validity::MOVING;
        let standing = self.apply_ground(&ground, 0, &mut invalid);
        let is_off = standing.is_none() && !invalid.any_of(Validity::COP_NOT_MEASURED);
        invalid.raise(Validity::FEET_OFF_PLATE, is_off);
        self.estimate.delta_f_n = [0.0, 0.0, ground.force_n[2] - self.unloaded_force_n(GRAVITY_M_PER_S2)];
        self.invalid = invalid.0;
    }
}

/// Resets torques, load fractions and levels.
pub(super) fn mask_torques(state: &mut State) {
    state.foot_load_fraction = [0.0; 2];
    state.sharing_source = SharingSource::Geometry as u32;
    state.hand_load_fraction = [0.0; 2];
    (state.foot_load_fraction_sigma, state.hand_load_fraction_sigma) = (0.0, 0.0);
    state.load_hand_distance_m = 0.0;
    state.torque_nm = [[0.0; 3]; JOINTS];
    state.torque_sigma_nm = [0.0; JOINTS];
    state.torque_covariance_nm2 = [[0.0; 3]; JOINTS];
    state.joint_level = [Level::None as u32; JOINTS];
}

/// Sets the levels of Table I with hysteresis.
pub(super) fn set_levels(state: &mut State, settings: &Settings, levels: &mut Levels) {
    for joint in 0..JOINTS {
        let (limit_nm, margin_share) = (state.torque_limit_nm[joint], settings.level_margin_share);
        let magnitude_nm = Vector3::from(state.torque_nm[joint]).norm();
        let sigma_nm = state.torque_sigma_nm[joint];
        let level = levels.next(joint, magnitude_nm, sigma_nm, limit_nm, margin_share);
        state.joint_level[joint] = level as u32;
    }
}
