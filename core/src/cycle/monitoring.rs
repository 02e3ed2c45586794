//! What one moment says: where the body is, whether it holds still, what the load does to the joints.

use nalgebra::Vector3;

use super::alignment::Aligned;
use super::body_motion::BodyMotion;
use super::memory::Memory;
use super::settings::{Method, Motion, Settings};
use super::{CLOCK_SIGMA_MAX_NS, NO_POSE, support};
use crate::body::{JOINTS, Side, gyration_m2};
use crate::frame::{Pose, StationWorld, wxyz};
use crate::math;
use crate::message::ground::NoCop;
use crate::message::state::SharingSource;
use crate::message::{GroundSample, State, Validity};
use crate::motion::{Build, Inertia, Moment};
use crate::overload::{
    self, GRAVITY_M_PER_S2, Level, Levels, Loading, LoadingSigma, Sharing, Swing, sharing,
};
use crate::sesc::centre_of_mass;
use crate::static_pose::{Held, Stillness, rms_joint_angle};

/// Within this multiple of the stillness thresholds the static equations are good enough to publish torques.
const NEARLY_STILL: f64 = 3.0;
/// What a plate may show that is taken for a worker's mass, kg.
const BODY_MASS_KG: core::ops::RangeInclusive<f64> = 25.0..=250.0;
/// A force is a load if it is so many σ from nothing.
const SIGMAS_OF_A_LOAD: f64 = 2.5;
/// Moments in motion enter the filter at most so often, ns …
const MOTION_ROW_EVERY_NS: u64 = 100_000_000;
/// … and so many of them say as much as one: errors of a motion last about half a second.
const ROWS_PER_INDEPENDENT: f64 = 5.0;
/// Two degrees of freedom exceed this once in a thousand times.
const NIS_OF_A_BLUNDER: f64 = 13.8;
/// 1-σ of where a load is in the hands, as seen from the joints: grips differ, and so do sensors on arms, m.
const GRIP_SIGMA_M: f64 = 0.02;
/// 1-σ of where a joint is above the floor, m.
const JOINT_SIGMA_M: f64 = 0.010;
/// The CoP may lie this far outside the modelled soles, m.
const SUPPORT_MARGIN_M: f64 = 0.02;

impl Memory {
    /// Takes in one aligned sample and works through every moment whose window it fills.
    pub(super) fn take_in(&mut self, settings: &Settings, aligned: &Aligned) {
        let suit = &aligned.suit;
        let in_suit_world = suit.pose();
        self.worked_ns = suit.sample_time_ns;
        self.identification.learn_skeleton(&in_suit_world, settings);
        let pose = if settings.suit_drifts {
            self.anchor.hold(&in_suit_world)
        } else {
            self.anchor.follow(&in_suit_world)
        };
        let body = *self.identification.anthropometry();
        let mut moment = Moment::new(suit.sample_time_ns, &in_suit_world, &pose, &body);
        moment.stance = self.anchor.stance();
        moment.both_feet_stand = u64::from(self.anchor.both_feet_stand());
        moment.time_sigma_ns = suit.sample_time_sigma_ns;
        if let Some(ground) = aligned.ground {
            moment.time_sigma_ns = moment.time_sigma_ns.max(ground.sample_time_sigma_ns);
            moment.ground = ground;
            moment.has_ground = 1;
        }
        self.history.push(moment);
        let half_window_ns = match settings.motion {
            Motion::Compensated { half_window_ns } => half_window_ns,
            Motion::Paper => 0,
        };
        let gyration_m2 = gyration_m2(&self.identification.skeleton(), settings.height_m);
        let build = Build { body: &body, gyration_m2: &gyration_m2 };
        // Bounded: the history holds a fixed number of moments.
        while let Some((moment, inertia)) = self.history.next(half_window_ns, &build) {
            self.monitor(settings, &moment, inertia);
        }
    }

    /// Works through one moment: where the body is, whether it holds still, what the load does to the joints.
    fn monitor(&mut self, settings: &Settings, moment: &Moment, inertia: Option<Inertia>) {
        let pose = moment.pose();
        let step_s = moment.time_ns.saturating_sub(self.known.suit_sample_time_ns) as f64 * 1e-9;
        self.known.suit_sample_time_ns = moment.time_ns;
        self.known.group_delay_ns = self.worked_ns.saturating_sub(moment.time_ns);
        self.known.stance = moment.stance as u32;
        self.known.segment_origin_m = moment.origin_m;
        let mut found = Validity::default();
        found.raise(Validity::CLOCK_UNSYNCHRONISED, moment.time_sigma_ns > CLOCK_SIGMA_MAX_NS);

        let standing = moment.ground().copied().and_then(|ground| self.stand_on(&ground, &mut found));
        found.raise(Validity::FEET_OFF_PLATE, standing.is_none());
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

        self.compare_with_suggestion(&pose, settings);
        if self.identification.has_body() {
            self.identification.follow_stance(moment.stance, settings);
        }
        let body = self.body_motion(&pose, moment, motion, step_s, settings);
        self.noise.follow(&body, self.identification.mass_kg, step_s);
        self.estimate(&pose, &body, settings);
        if let Some(stillness) = stillness.filter(|_| is_still) {
            self.learn_from_stillness(&pose, moment, &stillness, settings);
        }
        self.overload(&pose, &body, moment, settings, &mut found);
        self.expose(&pose, settings, found);
        if motion.is_some() && standing.is_some() {
            self.watch_the_residual(&pose, moment, &body, step_s, settings);
        } else {
            self.unloaded.forget();
        }
        self.found = found.0;
    }

    /// How the body alone moves.
    ///
    /// Where the plate measures shear, that tells the horizontal acceleration better than positions differentiated
    /// twice do. But shear that lasts and that no motion explains is a push; then the suit is believed.
    fn body_motion(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        inertia: Option<Inertia>,
        step_s: f64,
        settings: &Settings,
    ) -> BodyMotion {
        let worker = &self.identification;
        let (Some(inertia), Motion::Compensated { .. }) = (inertia, settings.motion) else {
            return BodyMotion::REST;
        };
        let centre = centre_of_mass(pose, &worker.phi());
        let floor_m = moment.ground().map_or(0.0, |ground| ground.surface_z_m);
        let mut body = BodyMotion::by_suit(&inertia, centre.z - floor_m);
        if let Some(ground) = moment.ground() {
            let delta_f_n = ground.force_n[2] - worker.mass_kg * body.specific_force_m_per_s2;
            let load_kg = if delta_f_n > self.load_limit_n(settings) { body.load_kg(delta_f_n) } else { 0.0 };
            if let Some([shear, missed]) = body.by_shear(ground.force_n, worker.mass_kg, load_kg)
                && !self.noise.is_pushed(missed, step_s)
            {
                body.believe(shear);
            }
        }
        body
    }

    /// Centre of mass, and the centre of pressure that the body alone would have in this motion, each with its σ.
    fn estimate(&mut self, pose: &Pose<StationWorld>, body: &BodyMotion, settings: &Settings) {
        if !self.identification.has_body() {
            return;
        }
        let rows = self.identification.reduction.rows(pose, body.slope);
        let still = self.identification.predict_cop_m(&rows);
        let known = self.identification.cop_variance_m2(&rows);
        let wander = self.identification.wander_variance_m2(pose, settings);
        self.known.com_m = centre_of_mass(pose, &self.identification.phi()).into();
        let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
        for axis in 0..2 {
            self.known.cop_estimated_m[axis] = still[axis] + body.turning_m[axis];
            let moving = self.noise.cop[axis].sigma(self.noise.cop_activity_m[axis].height());
            let variance = known[axis] + wander[axis] + floor + moving * moving;
            self.known.cop_sigma_m[axis] = math::sqrt(variance);
        }
    }

    fn compare_with_suggestion(&mut self, pose: &Pose<StationWorld>, settings: &Settings) {
        self.known.pose_mismatch_rad = match settings.library.get(self.identification.suggested as usize) {
            Some(posture) if self.identification.suggested != NO_POSE => {
                let joints = |rotations: [nalgebra::UnitQuaternion<f64>; JOINTS]| rotations.map(|r| wxyz(&r));
                rms_joint_angle(&joints(pose.joint_rotations()), &joints(posture.joint_rotations()))
            }
            _ => 0.0,
        };
    }

    /// While nothing is carried, what is left over says how good the compensation is; and motion teaches the filter.
    fn watch_the_residual(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        body: &BodyMotion,
        step_s: f64,
        settings: &Settings,
    ) {
        let mass_kg = self.identification.mass_kg;
        if mass_kg <= 0.0 || !self.identification.has_body() {
            return;
        }
        let [delta_f_n, sigma_n] = [self.known.delta_f_n[2], self.known.delta_f_sigma_n];
        if !self.unloaded.watch(delta_f_n, step_s, settings.load_threshold_n, sigma_n) {
            return;
        }
        self.learn_errors(settings);
        if self.wants_motion(moment, settings) {
            self.learn_motion(pose, moment, body, settings);
        }
    }

    /// How wrong the compensation is, while nothing but the body is there to explain.
    fn learn_errors(&mut self, settings: &Settings) {
        let noise = &mut self.noise;
        let activity_n = noise.vertical_activity_n.height();
        noise.vertical.learn(self.known.delta_f_n[2], activity_n, settings.force_sigma_n);
        for axis in 0..2 {
            let activity_m = noise.cop_activity_m[axis].height();
            let [sigma_m, moving_m] = [self.known.cop_sigma_m[axis], noise.cop[axis].sigma(activity_m)];
            let at_rest_m = math::sqrt((sigma_m * sigma_m - moving_m * moving_m).max(0.0));
            let error_m = self.known.cop_measured_m[axis] - self.known.cop_estimated_m[axis];
            noise.cop[axis].learn(error_m, activity_m, at_rest_m);
        }
    }

    /// Whether a moment in motion may teach the filter: asked for, in one stance, and the last one not just before.
    fn wants_motion(&self, moment: &Moment, settings: &Settings) -> bool {
        let worker = &self.identification;
        let asked = worker.learning == 1 || (settings.passive && worker.identified == 1);
        settings.method == Method::StaticAndDynamic
            && asked
            && self.known.static_pose == 0
            && (moment.both_feet_stand == 1 || !settings.suit_drifts)
            && moment.time_ns.saturating_sub(self.motion_learnt_ns) >= MOTION_ROW_EVERY_NS
    }

    /// The moment rows `(B_xy − s B_z) Φ = CoP − x0_xy + s x0_z − turning` (DESIGN §4), with R grown by the motion.
    fn learn_motion(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        body: &BodyMotion,
        settings: &Settings,
    ) {
        self.motion_learnt_ns = moment.time_ns;
        let rows = self.identification.reduction.rows(pose, body.slope);
        let wander = self.identification.wander_variance_m2(pose, settings);
        let cop_m = core::array::from_fn(|axis| self.known.cop_measured_m[axis] - body.turning_m[axis]);
        let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
        let variance_m2 = core::array::from_fn(|axis| {
            let moving_m = self.noise.cop[axis].sigma(self.noise.cop_activity_m[axis].height());
            ROWS_PER_INDEPENDENT * (wander[axis] + floor + moving_m * moving_m)
        });
        let predicted_m = self.identification.predict_cop_m(&rows);
        let known_m2 = self.identification.cop_variance_m2(&rows);
        let nis: f64 = (0..2)
            .map(|axis| {
                let innovation_m: f64 = cop_m[axis] - predicted_m[axis];
                innovation_m * innovation_m / (known_m2[axis] + variance_m2[axis])
            })
            .sum();
        // A touch or a stumble is no news about this body.
        if nis < NIS_OF_A_BLUNDER && self.identification.take_in(&rows, cop_m, variance_m2).is_some() {
            self.known.motion_samples_used = self.known.motion_samples_used.saturating_add(1);
        }
    }

    /// A still worker shows the mass, if it is not known, and then one more pose.
    fn learn_from_stillness(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        stillness: &Stillness,
        settings: &Settings,
    ) {
        let worker = &mut self.identification;
        let supported = support::is_supported(pose, stillness.cop_m, settings.height_m, SUPPORT_MARGIN_M);
        if !supported || moment.both_feet_stand != 1 {
            return;
        }
        let shown_kg = stillness.vertical_n / GRAVITY_M_PER_S2;
        if worker.mass_kg <= 0.0 && BODY_MASS_KG.contains(&shown_kg) {
            worker.mass_kg = shown_kg;
        }
        let weight_n = worker.mass_kg * GRAVITY_M_PER_S2;
        let unloaded = (stillness.vertical_n - weight_n).abs() < settings.still.weight_share * weight_n;
        let wanted = worker.has_body() && worker.learning == 1 && !worker.has_used(&self.window, settings);
        if wanted && unloaded {
            worker.learn_pose(&self.window, stillness, settings);
        }
    }

    /// 1-σ of the external force in this motion, N.
    fn delta_f_sigma_n(&self, settings: &Settings) -> f64 {
        let by_motion_n = self.noise.vertical.sigma(self.noise.vertical_activity_n.height());
        math::hypot([settings.force_sigma_n, by_motion_n])
    }

    /// From which external force on something is carried, N.
    fn load_limit_n(&self, settings: &Settings) -> f64 {
        settings.load_threshold_n.max(SIGMAS_OF_A_LOAD * self.delta_f_sigma_n(settings))
    }

    /// Eq. 14 and 15; `feet` where each was measured by itself.
    fn overload(
        &mut self,
        pose: &Pose<StationWorld>,
        body: &BodyMotion,
        moment: &Moment,
        settings: &Settings,
        found: &mut Validity,
    ) {
        let feet = moment.ground().and_then(GroundSample::feet);
        let worker = &self.identification;
        let vertical_n = self.known.ground_force_n[2];
        let delta_f_n = vertical_n - worker.mass_kg * body.specific_force_m_per_s2;
        self.known.delta_f_n = [0.0, 0.0, delta_f_n];
        self.known.delta_f_sigma_n = self.delta_f_sigma_n(settings);
        let loaded = delta_f_n.abs() >= self.load_limit_n(settings);
        found.raise(Validity::BELOW_LOAD_THRESHOLD, !loaded);
        if !loaded || !worker.has_body() || found.any_of(Validity::FEET_OFF_PLATE) {
            return;
        }
        let table = worker.anthropometry();
        let grip_m: [Vector3<f64>; 2] =
            Side::BOTH.map(|side| pose.point_on(side.hand(), table.grip_m(side.hand())));
        let (cop_measured_m, cop_estimated_m) = (self.known.cop_measured_m, self.known.cop_estimated_m);
        let by_geometry =
            Sharing::from_geometry(pose, cop_measured_m, cop_estimated_m, vertical_n, delta_f_n, &grip_m);
        let (sharing, source, zeta_sigma) = match feet {
            Some(feet) => {
                let sigma = (settings.force_sigma_n / vertical_n).min(0.5);
                (by_geometry.with_feet(&feet, cop_measured_m), SharingSource::Measured, sigma)
            }
            None => (by_geometry, SharingSource::Geometry, Sharing::zeta_sigma_by_geometry(pose)),
        };
        // The load's place is known as well as the two centres of pressure, magnified by weight over load.
        let place_sigma_m = self.known.cop_sigma_m.iter().copied().fold(0.0, f64::max)
            * (vertical_n - delta_f_n)
            / delta_f_n.abs();
        let between_hands_m = (grip_m[0] - grip_m[1]).xy().norm();
        let eta_sigma = place_sigma_m / between_hands_m.max(1e-3);
        let (sharing, eta_sigma, swing_n) = if settings.motion == Motion::Paper {
            (sharing.as_in_the_paper(), eta_sigma.min(0.5), [0.0; 2])
        } else {
            let (sharing, eta_sigma) = sharing.with_both_hands(eta_sigma);
            let load_kg = body.load_kg(delta_f_n);
            let [x, y, _] = body.hands_acceleration_m_per_s2();
            (sharing, eta_sigma, [load_kg * x, load_kg * y])
        };
        let loading = Loading {
            cop_measured_m,
            cop_estimated_m,
            vertical_n,
            delta_f_n,
            grip_m,
            sharing,
            swing: Swing { force_n: swing_n, surface_z_m: moment.ground.surface_z_m },
        };
        let sigma = LoadingSigma {
            cop_measured_m: settings.cop_sigma_m,
            cop_estimated_m: self.known.cop_sigma_m,
            delta_f_n: self.known.delta_f_sigma_n,
            eta: eta_sigma,
            zeta: zeta_sigma,
            foot_without_load_m: if feet.is_some() { sharing::FOOT_WITHOUT_LOAD_SIGMA_M } else { 0.0 },
            grip_m: GRIP_SIGMA_M,
            joint_m: JOINT_SIGMA_M,
        };
        found.raise(
            Validity::LOAD_NOT_AT_HANDS,
            sharing.load_distance_m > settings.load_distance_max_m + 2.0 * place_sigma_m,
        );
        self.known.zeta = sharing.zeta;
        self.known.sharing_source = source as u32;
        self.known.eta = sharing.eta;
        self.known.load_distance_m = sharing.load_distance_m;
        for (joint, torque) in overload::torques(pose, &loading, &sigma).into_iter().enumerate() {
            self.known.torque_nm[joint] = torque.torque_nm.into();
            self.known.torque_sigma_nm[joint] = torque.sigma_nm;
        }
    }

    /// Force and centre of pressure of a ground sample; no centre while nobody stands there or the plate is faulty.
    fn stand_on(&mut self, ground: &GroundSample, found: &mut Validity) -> Option<[f64; 2]> {
        let cop = ground.cop_m();
        found.raise(Validity::PLATE_FAULT, matches!(cop, Err(NoCop::DeviceStatus(_))));
        self.known.ground_force_n = ground.force_n;
        self.known.cop_measured_m = cop.unwrap_or_default();
        cop.ok()
    }

    /// While the suit is silent the ground is still measured.
    pub(super) fn measure_ground_alone(&mut self) {
        let Some(ground) = self.alignment.newest_ground().copied() else { return };
        let mut found = Validity::MOVING;
        let standing = self.stand_on(&ground, &mut found);
        found.raise(Validity::FEET_OFF_PLATE, standing.is_none());
        let weight_n = self.identification.mass_kg * GRAVITY_M_PER_S2;
        self.known.delta_f_n = [0.0, 0.0, ground.force_n[2] - weight_n];
        self.found = found.0;
    }
}

/// No torque, no shares, no colours.
pub(super) fn blank_torques(state: &mut State) {
    state.zeta = [0.0; 2];
    state.sharing_source = SharingSource::Geometry as u32;
    state.eta = [0.0; 2];
    state.load_distance_m = 0.0;
    state.torque_nm = [[0.0; 3]; JOINTS];
    state.torque_sigma_nm = [0.0; JOINTS];
    state.joint_level = [Level::None as u32; JOINTS];
}

/// Table I, without flicker.
pub(super) fn colour(state: &mut State, settings: &Settings, levels: &mut Levels) {
    for joint in 0..JOINTS {
        let (limit_nm, margin_share) = (settings.limits.0[joint], settings.level_margin_share);
        let magnitude_nm = Vector3::from(state.torque_nm[joint]).norm();
        let sigma_nm = state.torque_sigma_nm[joint];
        let level = levels.next(joint, magnitude_nm, sigma_nm, limit_nm, margin_share);
        state.joint_level[joint] = level as u32;
    }
}
