//! Evaluates one aligned sample: pose, static pose detection, and the torques of the load.

use nalgebra::Vector3;

use super::alignment::Aligned;
use super::body_motion::BodyMotion;
use super::ground_rates::Standing;
use super::insoles::GroundSigma;
use super::kept::SHIFT_HOLDS_NS;
use super::memory::Memory;
use super::settings::{Motion, Settings};
use super::{CLOCK_SIGMA_MAX_NS, insoles, sole, support};
use crate::body::{JOINTS, gyration_m2};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::ground::NoCop;
use crate::message::state::{AccelerationSource, NotGiven, SharingSource};
use crate::message::suit::SuitBlocks;
use crate::message::{Component, GroundSample, State, SuitSample, Validity};
use crate::motion::{Build, Inertia, Moment};
use crate::overload::{GRAVITY_M_PER_S2, Level, Levels};
use crate::sesc::centre_of_mass;
use crate::static_pose::{Held, Stillness};

/// Within this multiple of the static pose thresholds the static equations are accurate enough to publish torques.
const NEARLY_STILL: f64 = 3.0;
/// After a gap this long in the suit's samples the subject may stand elsewhere, ns.
const SIGHT_LOST_NS: u64 = 300_000_000;
/// Maximum shear of a static body, as a fraction of its weight; more means an external horizontal force.
const SHEAR_SHARE_MAX: f64 = 0.02;
/// Tolerance for a CoP outside the modelled foot outlines, m.
pub(super) const SUPPORT_MARGIN_M: f64 = 0.02;

impl Memory {
    /// Ingests one aligned sample and processes every snapshot whose window it completes.
    pub(super) fn take_in(&mut self, settings: &Settings, aligned: &Aligned) {
        self.confirm_shift(&aligned.suit, settings);
        self.lose_sight_after_a_gap(&aligned.suit, settings);
        let suit = &self.placing.headed(&aligned.suit);
        let in_suit_world = suit.pose();
        self.worked_ns = suit.sample_time_ns;
        let had_body = self.identification.has_body();
        self.follow_build(&in_suit_world, suit, settings);
        self.identification.learn_skeleton(&in_suit_world, settings);
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
            self.anchor.follow(&in_suit_world)
        };
        let body = *self.identification.anthropometry();
        let mut moment = Moment::new(suit.sample_time_ns, &in_suit_world, &pose, &body);
        (moment.stance, moment.stance_sigma_m) = (self.anchor.stance(), self.anchor.stance_sigma_m());
        moment.both_feet_stand = u64::from(self.anchor.both_feet_stand());
        moment.time_sigma_ns = suit.sample_time_sigma_ns;
        if suit.has(SuitBlocks::CentreOfMass) {
            let ([x, y, z], [shift_x, shift_y]) = (suit.com_m, moment.station_from_suit_m);
            (moment.suit_com_m, moment.has_suit_com) = ([x + shift_x, y + shift_y, z], 1);
        }
        if suit.has(SuitBlocks::LinearKinematics) {
            (moment.acceleration_m_per_s2, moment.has_acceleration) = (suit.acceleration_m_per_s2, 1);
        }
        if let Some(ground) = aligned.ground {
            moment.time_sigma_ns = moment.time_sigma_ns.max(ground.sample_time_sigma_ns);
            let soles = sole::both(&pose, self.build.body(), settings.height_m);
            moment.ground = insoles::place(&ground, &pose, &soles);
            moment.has_ground = 1;
        }
        self.history.push(moment);
        let half_window_ns = settings.half_window_ns();
        let gyration_m2 = gyration_m2(&self.identification.skeleton(), settings.height_m);
        let build = Build { body: &body, gyration_m2: &gyration_m2 };
        // Bounded: the history holds a fixed number of snapshots.
        while let Some((moment, inertia)) = self.history.next(half_window_ns, settings.accelerations, &build)
        {
            self.monitor(settings, &moment, inertia);
        }
    }

    /// After a gap in the samples or a restart of the suit the subject may stand elsewhere.
    fn lose_sight_after_a_gap(&mut self, suit: &SuitSample, settings: &Settings) {
        let gap_ns = suit.sample_time_ns.saturating_sub(self.worked_ns);
        let is_another = self.has_restarted(suit) || self.plausibility.moved_ns == suit.sample_time_ns;
        let is_session = u64::from(suit.session) != self.session;
        let is_restart = self.worked_ns > 0 && (gap_ns > SIGHT_LOST_NS || is_session || is_another);
        self.session = u64::from(suit.session);
        self.suit_counter = u64::from(suit.device_counter);
        if !is_restart {
            return;
        }
        self.history.clear();
        self.window.clear();
        self.unloaded.forget();
        if settings.suit_drifts {
            self.anchor.lose();
            if self.identification.has_body() && is_another {
                self.identification.new_stance(settings);
            } else if self.identification.has_body() {
                self.identification.lose_stance();
            }
            if is_another {
                self.placing.lose(core::f64::consts::PI);
            } else if gap_ns > SHIFT_HOLDS_NS {
                self.placing.lose(settings.suit_orientation_sigma_rad());
            }
        }
    }

    /// Processes one snapshot: pose, static pose detection, and the torques of the load.
    fn monitor(&mut self, settings: &Settings, moment: &Moment, inertia: Option<Inertia>) {
        let half_ns = settings.half_window_ns();
        let mut moment = *moment;
        let by_positions = inertia.is_some_and(|inertia| !inertia.is_by_suit);
        if by_positions
            && settings.motion != Motion::Paper
            && let Some(time_ns) = moment.ground().map(|ground| ground.sample_time_ns)
            && let Some(ground) = self.alignment.ground_around(time_ns, half_ns)
        {
            let pose = moment.pose();
            let soles = sole::both(&pose, self.build.body(), settings.height_m);
            moment.ground = insoles::place(&ground, &pose, &soles);
        }
        let moment = &moment;
        let pose = moment.pose();
        let step_s = moment.time_ns.saturating_sub(self.known.suit_sample_time_ns) as f64 * 1e-9;
        self.known.suit_sample_time_ns = moment.time_ns;
        self.known.group_delay_ns = self.worked_ns.saturating_sub(moment.time_ns);
        self.known.stance = moment.stance as u32;
        self.force_offset.predict(step_s);
        self.follow_weight();
        self.ground_sigma = GroundSigma::of(moment.ground(), &self.force_offset, settings);
        let before = self.standing_before(step_s);
        self.does_not_give(NotGiven::SuitCom, moment.has_suit_com != 1);
        let mut found = Validity::default();
        let unsynchronised = moment.time_sigma_ns > CLOCK_SIGMA_MAX_NS || self.skew.is_off();
        found.raise(Validity::CLOCK_UNSYNCHRONISED, unsynchronised);
        // The results belong to the snapshot, which may predate the body.
        found.raise(Validity::BODY_UNKNOWN, !self.identification.has_body());
        found.raise(Validity::PLACE_UNKNOWN, self.placing.is_lost());

        // A snapshot's time may lie between two samples.
        let period_ns = self.alignment.ground_period_ns();
        let standing = moment
            .ground()
            .copied()
            .and_then(|ground| self.stand_on(&ground, half_ns.max(period_ns), &mut found));
        let is_off = standing.is_none() && !found.any_of(Validity::COP_NOT_MEASURED);
        found.raise(Validity::FEET_OFF_PLATE, is_off);
        let [from_ns, to_ns] = [moment.time_ns.saturating_sub(half_ns), moment.time_ns + half_ns];
        found.raise(Validity::SUIT_IMPLAUSIBLE, self.plausibility.suit.touches(from_ns, to_ns));
        let is_suspect = found.any_of(Validity::IMPLAUSIBLE);
        let standing = standing.filter(|_| !is_suspect);
        let now = standing.map(|cop_m| Standing { vertical_n: moment.ground.force_n[2], cop_m });
        self.add_time_error(moment, before, now, step_s);
        // The plate may have recovered since, but this snapshot has no ground sample, and the last values belong to an
        // earlier one.
        found.raise(Validity::GROUND_STALE, moment.ground().is_none());
        match standing {
            Some(cop_m) => {
                let held = Held {
                    time_ns: moment.time_ns,
                    stance: moment.stance,
                    cop_m,
                    vertical_n: moment.ground.force_n[2],
                    ..bytemuck::Zeroable::zeroed()
                };
                self.window.push(&pose, held, self.alignment.suit_period_ns());
            }
            None => self.window.clear(),
        }
        let stillness = self.window.stillness();
        let is_still = stillness.is_some_and(|window| window.is_still(&settings.still));
        self.known.static_pose = u32::from(is_still);
        let nearly_still = stillness.is_some_and(|window| window.is_within(&settings.still, NEARLY_STILL));
        let motion = match (settings.motion, inertia) {
            (Motion::Paper, _) => Some(Inertia::REST),
            (_, Some(inertia)) if inertia.is_moderate() => Some(inertia),
            (_, None) if nearly_still => Some(Inertia::REST),
            _ => None,
        };
        found.raise(Validity::MOVING, motion.is_none());

        let by_suit = motion.is_some_and(|inertia| inertia.is_by_suit);
        let source = if by_suit { AccelerationSource::Suit } else { AccelerationSource::Positions };
        self.known.acceleration_source = source as u32;

        self.compare_with_suggestion(&pose, is_still, settings);
        if self.identification.has_body() {
            self.identification.follow_stance(moment.stance, moment.stance_sigma_m, settings);
        }
        let mut observation = self.observe(&pose, moment, inertia, settings);
        self.foresee_terms(observation.as_mut(), settings);
        let body = self.body_motion(&pose, moment, (motion, is_suspect), step_s, settings);
        self.apply_terms(observation.as_mut(), &pose, &body, step_s, settings);
        if !is_suspect {
            self.noise.follow(&body, self.identification.mass_kg, step_s);
        }
        if motion.is_some() && standing.is_some() && self.identification.has_body() {
            self.weigh(&pose, moment, &body, step_s, settings);
        }
        self.estimate(&pose, &body, settings);
        // The stance offset applies to everything that is placed on the plate.
        let offset_m = self.identification.stance_offset_m();
        let on_plate = pose.displaced(offset_m);
        self.known.segment_origin_m = on_plate.origin.map(Into::into);
        let [x, y, z] = moment.suit_com_m;
        self.known.suit_com_m = [x + offset_m[0], y + offset_m[1], z];
        if found.any_of(Validity::GROUND_IMPLAUSIBLE) {
            self.compare_weight(moment, &body, step_s, settings);
        }
        let without_terms = stillness.and_then(|window| self.terms.off(&window, &settings.model));
        if let Some(stillness) = without_terms.filter(|_| is_still) {
            self.learn_from_stillness(&on_plate, moment, &body, &stillness, settings);
        }
        if !is_suspect {
            self.overload(&on_plate, &body, moment, step_s, settings, &mut found);
        }
        self.test_lag(moment, &body, motion.is_some() && standing.is_some(), settings);
        found.raise(Validity::CLOCK_UNSYNCHRONISED, self.lag_test.is_off());
        self.expose(&on_plate, &body, settings, found);
        if motion.is_some() && standing.is_some() && !found.any_of(Validity::CLOCK_UNSYNCHRONISED) {
            self.watch_the_residual(&pose, moment, &body, step_s, settings);
        } else {
            self.unloaded.forget();
        }
        self.found = found.0;
    }

    /// Motion of the body without the load.
    ///
    /// If the plate measures shear, the shear gives the horizontal acceleration more accurately than positions
    /// differentiated twice. Persistent shear that no motion explains is an external horizontal force; the suit's
    /// acceleration is used then.
    fn body_motion(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        (inertia, is_suspect): (Option<Inertia>, bool),
        step_s: f64,
        settings: &Settings,
    ) -> BodyMotion {
        let worker = &self.identification;
        let (Some(inertia), Motion::Compensated { .. }) = (inertia, settings.motion) else {
            return BodyMotion::REST;
        };
        let centre = centre_of_mass(pose, &worker.phi());
        let floor_m = moment.ground().map_or(0.0, |ground| ground.surface_z_m);
        let mut body = BodyMotion::by_suit(&inertia, centre.z, floor_m);
        if let Some(ground) = moment.ground() {
            let [terms_x_n, terms_y_n, terms_z_n] = self.terms.force_n;
            let unloaded_n = self.unloaded_force_n(body.specific_force_m_per_s2);
            let delta_f_n = ground.force_n[2] - terms_z_n - unloaded_n;
            let load_kg = if delta_f_n > self.load_limit_n(settings) { body.load_kg(delta_f_n) } else { 0.0 };
            // Shear is unusable while the heading of the suit is unavailable.
            let has_shear = ground.measures(Component::Shear) && !self.placing.is_lost() && !is_suspect;
            if !has_shear && !is_suspect {
                self.noise.forget_push();
            }
            let by_shear = body.by_shear(ground.force_n, worker.mass_kg, load_kg);
            if let Some([shear, missed]) = by_shear.filter(|_| has_shear) {
                let explained = [terms_x_n, terms_y_n].map(|force_n| force_n / worker.mass_kg);
                let missed = [0, 1].map(|axis| missed[axis] - explained[axis]);
                let bias = self.noise.follow_shear(missed, step_s);
                if !self.noise.is_pushed() {
                    // A plate that is not level measures shear without motion.
                    body.believe([0, 1].map(|axis| shear[axis] - bias[axis]));
                }
            }
        }
        body
    }

    /// Whether the readings of an implausible plate match this subject alone, without a load.
    fn compare_weight(&mut self, moment: &Moment, body: &BodyMotion, step_s: f64, settings: &Settings) {
        let worker = &self.identification;
        let is_known = worker.identified == 1 && worker.mass_kg > 0.0 && !self.placing.is_lost();
        let unloaded_n = self.unloaded_force_n(body.specific_force_m_per_s2);
        let off_n = (moment.ground.force_n[2] - self.terms.force_n[2] - unloaded_n).abs();
        let State { cop_measured_m, cop_estimated_m, cop_sigma_m, .. } = self.known;
        let is_there = (0..2).all(|axis| {
            let sigma_m = math::hypot([cop_sigma_m[axis], self.ground_sigma.cop_m]);
            (cop_measured_m[axis] - cop_estimated_m[axis]).abs() < 3.0 * sigma_m
        });
        let agrees = is_known.then_some(off_n < self.load_limit_n(settings) && is_there);
        self.plausibility.hear_of_weight(agrees, step_s);
    }

    /// Computes the centre of mass and the estimated unloaded CoP in this motion, each with its σ.
    fn estimate(&mut self, pose: &Pose<StationWorld>, body: &BodyMotion, settings: &Settings) {
        if !self.identification.has_body() {
            return;
        }
        let rows = self.identification.reduction.rows(pose, body.slope);
        let still = self.identification.predict_cop_m(&rows);
        let known = self.identification.cop_variance_m2(&rows);
        let wander = self.identification.wander_variance_m2(pose, settings);
        let [x, y] = self.identification.stance_offset_m();
        self.known.com_m =
            (centre_of_mass(pose, &self.identification.phi()) + Vector3::new(x, y, 0.0)).into();
        let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
        // Without measured shear, only the suit measures the body's acceleration; the contribution vanishes at rest.
        let unfelt_m = if self.known.not_given & NotGiven::Shear as u32 == 0 {
            0.0
        } else {
            body.leaning_sigma_m(self.noise.moving_acceleration_sigma_m_per_s2())
        };
        let cop_m = [0, 1].map(|axis| still[axis] + body.besides_rows_m(axis) + self.terms.cop_m[axis]);
        self.known.cop_estimated_m = cop_m;
        let headed_m = self.placing.heading_sigma_m(pose, cop_m);
        let variance_m2 = [0, 1].map(|axis: usize| {
            let moving = self.noise.cop[axis].sigma(self.noise.cop_activity_m[axis].height());
            let by_body_m2 = known[axis] + wander[axis] + floor + moving * moving + unfelt_m * unfelt_m;
            by_body_m2 + headed_m[axis] * headed_m[axis]
        });
        self.known.cop_sigma_m = variance_m2.map(math::sqrt);
        self.stance_sigma = self.identification.stance_sigma(&rows, variance_m2);
    }

    /// Updates the filter with one more static pose if no load is carried.
    fn learn_from_stillness(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        body: &BodyMotion,
        stillness: &Stillness,
        settings: &Settings,
    ) {
        let soles = sole::both(pose, self.build.body(), settings.height_m);
        let weight_n = self.unloaded_force_n(GRAVITY_M_PER_S2);
        let worker = &mut self.identification;
        let supported = support::is_supported(pose, stillness.cop_m, &soles, SUPPORT_MARGIN_M);
        if self.placing.is_lost() || !supported || moment.both_feet_stand != 1 || worker.mass_kg <= 0.0 {
            return;
        }
        // The paper has no load threshold.
        let nothing_n = match settings.motion {
            Motion::Paper => settings.still.weight_share * weight_n,
            Motion::Compensated { .. } => {
                (settings.still.weight_share * weight_n).min(settings.load_threshold_n)
            }
        };
        let [x, y] = [0, 1].map(|axis| moment.ground.force_n[axis] - self.terms.force_n[axis]);
        // Only shear reveals an external horizontal force; without shear it stays undetected.
        let leans = moment.ground.measures(Component::Shear)
            && (math::hypot([x, y]) > SHEAR_SHARE_MAX * weight_n || self.noise.is_pushed());
        let unloaded = (stillness.vertical_n - weight_n).abs() < nothing_n && !leans;
        let wanted = worker.has_body() && worker.learning == 1 && !worker.has_used(&self.window, settings);
        if wanted && unloaded {
            let lasting_m =
                [0, 1].map(|axis| math::hypot([self.ground_sigma.lasting_cop_m, body.shift_m(axis)]));
            worker.learn_pose(&self.window, stillness, lasting_m, settings);
        }
    }

    /// Force and centre of pressure of a ground sample; no CoP if nothing stands on the plate or the plate is faulty.
    fn stand_on(&mut self, ground: &GroundSample, around_ns: u64, found: &mut Validity) -> Option<[f64; 2]> {
        let cop = ground.cop_m();
        found.raise(Validity::PLATE_FAULT, matches!(cop, Err(NoCop::DeviceStatus(_))));
        let [from_ns, to_ns] =
            [ground.sample_time_ns.saturating_sub(around_ns), ground.sample_time_ns + around_ns];
        found.raise(Validity::GROUND_IMPLAUSIBLE, self.plausibility.ground.touches(from_ns, to_ns));
        self.known.ground_force_n = ground.force_n;
        self.known.ground_devices = ground.devices;
        self.does_not_give(NotGiven::Shear, !ground.measures(Component::Shear));
        found.raise(Validity::COP_NOT_MEASURED, matches!(cop, Err(NoCop::NotMeasured)));
        self.known.cop_measured_m = cop.unwrap_or_default();
        cop.ok()
    }

    /// Records whether the station's sensors provide a quantity.
    fn does_not_give(&mut self, what: NotGiven, missing: bool) {
        let others = self.known.not_given & !(what as u32);
        self.known.not_given = others | if missing { what as u32 } else { 0 };
    }

    /// Reports the ground measurement while the suit is silent.
    pub(super) fn measure_ground_alone(&mut self) {
        let Some(ground) = self.alignment.newest_ground().copied() else { return };
        let mut found = Validity::MOVING;
        let standing = self.stand_on(&ground, 0, &mut found);
        let is_off = standing.is_none() && !found.any_of(Validity::COP_NOT_MEASURED);
        found.raise(Validity::FEET_OFF_PLATE, is_off);
        self.known.delta_f_n = [0.0, 0.0, ground.force_n[2] - self.unloaded_force_n(GRAVITY_M_PER_S2)];
        self.found = found.0;
    }
}

/// Resets torques, load fractions and levels.
pub(super) fn blank_torques(state: &mut State) {
    state.zeta = [0.0; 2];
    state.sharing_source = SharingSource::Geometry as u32;
    state.eta = [0.0; 2];
    (state.zeta_sigma, state.eta_sigma) = (0.0, 0.0);
    state.load_distance_m = 0.0;
    state.torque_nm = [[0.0; 3]; JOINTS];
    state.torque_sigma_nm = [0.0; JOINTS];
    state.torque_covariance_nm2 = [[0.0; 3]; JOINTS];
    state.joint_level = [Level::None as u32; JOINTS];
}

/// Sets the levels of Table I with hysteresis.
pub(super) fn colour(state: &mut State, settings: &Settings, levels: &mut Levels) {
    for joint in 0..JOINTS {
        let (limit_nm, margin_share) = (state.torque_limit_nm[joint], settings.level_margin_share);
        let magnitude_nm = Vector3::from(state.torque_nm[joint]).norm();
        let sigma_nm = state.torque_sigma_nm[joint];
        let level = levels.next(joint, magnitude_nm, sigma_nm, limit_nm, margin_share);
        state.joint_level[joint] = level as u32;
    }
}
