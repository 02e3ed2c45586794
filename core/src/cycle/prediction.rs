//! Stage `predict_unloaded`: motion of the body without the load, the model's terms, and the uncertainty of both.

use bytemuck::{Pod, Zeroable};

use super::body_motion::{BodyMotion, MotionNoise, NoiseSigma};
use super::differentiate::Instant;
use super::ground::Ground;
use super::identification::Identification;
use super::model_terms::ModelTerms;
use super::settings::{Motion, Settings};
use super::stillness::Stillness;
use crate::math;
use crate::message::Component;
use crate::motion::unloaded::SIGMAS_OF_A_LOAD;
use crate::motion::{Confidence, History, Inertia};
use crate::sesc::centre_of_mass;
use crate::static_pose::PoseStatistics;

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct PredictionState {
    /// Model terms besides the body.
    pub(super) terms: ModelTerms,
    /// Estimated errors of the inertia compensation.
    pub(super) noise: MotionNoise,
}

impl PredictionState {
    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.terms.is_sound() && self.noise.is_sound()
    }
}

/// The unloaded body at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prediction {
    /// Its motion.
    pub(super) body: BodyMotion,
    /// Change of CoP, m, and force, N, by the model's terms.
    pub(super) terms_cop_m: [f64; 2],
    pub(super) terms_force_n: [f64; 3],
    /// Static pose window without the terms; `None` unless the pose is static.
    pub(super) static_pose: Option<PoseStatistics>,
    /// Errors of the inertia compensation.
    pub(super) sigma: NoiseSigma,
    /// Error of the vertical force by activity, N.
    vertical: Confidence,
    /// 1-σ of the external force in this motion, N.
    pub(super) delta_f_sigma_n: f64,
    /// External force above which a load is carried, N.
    pub(super) load_limit_n: f64,
    /// Whether motion and force are both measured.
    pub(super) is_measured: bool,
}

impl Prediction {
    /// 1-σ of the vertical force of a motion with this inertial force, N.
    pub(super) fn vertical_sigma_n(&self, inertia_n: f64) -> f64 {
        self.vertical.sigma(inertia_n)
    }
}

/// Predicts the motion of the unloaded body.
pub(super) fn predict_unloaded(
    settings: &Settings,
    state: &mut PredictionState,
    instant: &Instant,
    ground: &Ground,
    stillness: &Stillness,
    subject: &Identification,
    history: &History,
) -> Prediction {
    let mut observation = state.terms.observe(settings, instant, ground, subject, history);
    let terms_force_n = observation.as_mut().map_or([0.0; 3], |o| ModelTerms::force_n(settings, o));
    let body = match (stillness.inertia, settings.motion) {
        (Some(inertia), Motion::Compensated { .. }) => {
            body_motion(settings, &mut state.noise, instant, ground, &inertia, subject, terms_force_n)
        }
        _ => BodyMotion::REST,
    };
    let (terms_cop_m, terms_force_n) =
        state.terms.apply(settings, observation.as_mut(), instant, &body, subject);
    if !ground.is_suspect() {
        state.noise.update(&body, subject.mass_kg, instant.step_s);
    }
    let sigma = state.noise.sigma();
    let delta_f_sigma_n = delta_f_sigma_n(ground, &sigma);
    Prediction {
        body,
        terms_cop_m,
        terms_force_n,
        static_pose: stillness
            .statistics
            .filter(|_| stillness.is_static)
            .and_then(|window| state.terms.subtract_from(&window, &settings.model)),
        vertical: state.noise.vertical,
        sigma,
        delta_f_sigma_n,
        load_limit_n: load_limit_n(settings, delta_f_sigma_n),
        is_measured: stillness.inertia.is_some() && ground.standing_m.is_some(),
    }
}

/// Predicts the motion of the unloaded body at the newest sample, with the contributions of the model's terms from the
/// newest state. Updates nothing: the instant has no duration.
pub(super) fn predict_early(
    settings: &Settings,
    noise: &MotionNoise,
    instant: &Instant,
    ground: &Ground,
    inertia: &Inertia,
    subject: &Identification,
    (terms_cop_m, terms_force_n): ([f64; 2], [f64; 3]),
) -> Prediction {
    let mut noise = *noise;
    let body = match settings.motion {
        Motion::Compensated { .. } => {
            body_motion(settings, &mut noise, instant, ground, inertia, subject, terms_force_n)
        }
        Motion::Paper => BodyMotion::REST,
    };
    let sigma = noise.sigma();
    let delta_f_sigma_n = delta_f_sigma_n(ground, &sigma);
    Prediction {
        body,
        terms_cop_m,
        terms_force_n,
        static_pose: None,
        vertical: noise.vertical,
        sigma,
        delta_f_sigma_n,
        load_limit_n: load_limit_n(settings, delta_f_sigma_n),
        is_measured: ground.standing_m.is_some(),
    }
}

/// 1-σ of the external force, N.
fn delta_f_sigma_n(ground: &Ground, sigma: &NoiseSigma) -> f64 {
    math::hypot([ground.sigma.force_n, sigma.vertical_n])
}

/// External force above which a load is carried, N.
fn load_limit_n(settings: &Settings, delta_f_sigma_n: f64) -> f64 {
    match settings.motion {
        Motion::Paper => settings.load_threshold_n,
        Motion::Compensated { .. } => settings.load_threshold_n.max(SIGMAS_OF_A_LOAD * delta_f_sigma_n),
    }
}

/// Motion of the body without the load.
///
/// If the plate measures shear, the shear gives the horizontal acceleration more accurately than positions
/// differentiated twice. Persistent shear that no motion explains is an external horizontal force; the suit's
/// acceleration is used then, and also while the plate does not carry the complete body.
fn body_motion(
    settings: &Settings,
    noise: &mut MotionNoise,
    instant: &Instant,
    ground: &Ground,
    inertia: &Inertia,
    subject: &Identification,
    [terms_x_n, terms_y_n, terms_z_n]: [f64; 3],
) -> BodyMotion {
    let snapshot = &instant.snapshot;
    let centre = centre_of_mass(&instant.pose, &subject.phi());
    let floor_m = snapshot.ground().map_or(0.0, |ground| ground.surface_z_m);
    let mut body = BodyMotion::by_suit(inertia, centre.z, floor_m);
    let Some(sample) = snapshot.ground() else { return body };
    let unloaded_n = ground.unloaded_force_n(subject, body.specific_force_m_per_s2);
    let delta_f_n = sample.force_n[2] - terms_z_n - unloaded_n;
    let limit_n = load_limit_n(settings, delta_f_sigma_n(ground, &noise.sigma()));
    let load_kg = if delta_f_n > limit_n { body.load_kg(delta_f_n) } else { 0.0 };
    // Shear is unusable while the heading of the suit is unavailable.
    let is_suspect = ground.is_suspect() || ground.gain_is_doubtful;
    let has_shear = sample.measures(Component::Shear) && !instant.place_is_lost && !is_suspect;
    if !has_shear && !is_suspect {
        noise.reset_external_force();
    }
    let by_shear = body.by_shear(sample.force_n, subject.mass_kg, load_kg);
    // Unless both feet are on the plate, it measures only a part of the body's shear.
    let stands = ground.standing_m.is_some() && delta_f_n > -limit_n;
    if let Some([shear, unexplained]) = by_shear.filter(|_| has_shear && stands) {
        let explained = [terms_x_n, terms_y_n].map(|force_n| force_n / subject.mass_kg);
        noise.update_shear([0, 1].map(|axis| unexplained[axis] - explained[axis]), instant.step_s);
        let bias = noise.shear_bias_m_per_s2();
        if !noise.has_external_force() {
            // A plate that is not level measures shear without motion.
            body.use_acceleration([0, 1].map(|axis| shear[axis] - bias[axis]));
        }
    }
    body
}
