//! Position of the load in the hands: hand load fractions η, and distance ahead of the grips.

use nalgebra::Vector3;

use super::loading::Carrying;
use super::settings::{Motion, Settings};
use crate::body::{Segment, Side};
use crate::frame::{Pose, StationWorld};
use crate::kalman::STATES;
use crate::math;
use crate::overload;
use crate::overload::load_position::{
    ANOTHER_GRIP_SIGMAS, ByModel, EVEN_SIGMA, GRIP_SIGMA_M, LoadPosition, Measured,
};
use crate::overload::sharing::{TOO_CLOSE_M, project};

/// Position of a load in the hands.
pub(super) struct LoadInHands {
    /// Point of action of each hand's fraction of the load, m.
    pub(super) grip_m: [Vector3<f64>; 2],
    /// Hand load fractions.
    pub(super) eta: [f64; 2],
    pub(super) eta_sigma: f64,
    /// 1-σ of the load's distance ahead of the grips, a horizontal vector, m.
    pub(super) ahead_sigma_m: [f64; 2],
    /// 1-σ of the load's position in the hands, world x and y, m.
    pub(super) position_sigma_m: [f64; 2],
    /// Load position by the two CoPs minus the position in the hands, world x and y, m.
    pub(super) residual_m: [Measured; 2],
    /// Their length if they contradict each other, m; otherwise 0.
    pub(super) contradiction_m: f64,
    /// Horizontal force that accelerates the load, N.
    pub(super) swing_n: [f64; 2],
    /// Distance of the load from the line between the grips, by the two CoPs, and its 1-σ, m.
    pub(super) distance_m: f64,
    pub(super) distance_sigma_m: f64,
}

/// Position of the load by the two CoPs.
struct ByCops {
    grip_m: [Vector3<f64>; 2],
    /// Grips, world x and y, m.
    between: [[f64; 2]; 2],
    /// Horizontal acceleration of the load, m/s².
    swing: [f64; 2],
    /// World x and y, m, and 1-σ.
    load_m: [f64; 2],
    sigma_m: [f64; 2],
}

/// Axes of a load in the hands, horizontal unit vectors.
struct HandAxes {
    /// From the left to the right hand; for hands close together, the direction of the pelvis.
    aside: [f64; 2],
    /// Away from the body.
    ahead: [f64; 2],
    /// Distance between the hands, m, and the middle between them.
    apart_m: f64,
    middle: [f64; 2],
}

/// Locates the load in the hands.
pub(super) fn locate_load(
    settings: &Settings,
    position: &mut LoadPosition,
    carrying: &Carrying<'_>,
) -> LoadInHands {
    let cops = ByCops::of(settings, position.eta(), carrying);
    let axes = HandAxes::of(&carrying.estimate.on_plate, &cops);
    if settings.motion == Motion::Paper {
        return cops.on_line(&axes);
    }
    update_position(position, carrying, &cops, &axes);
    cops.in_hands(position, carrying, &axes)
}

/// The load at its present mean position in the hands, which is not updated.
pub(super) fn hold_load(
    settings: &Settings,
    position: &LoadPosition,
    carrying: &Carrying<'_>,
) -> LoadInHands {
    let cops = ByCops::of(settings, position.eta(), carrying);
    let axes = HandAxes::of(&carrying.estimate.on_plate, &cops);
    if settings.motion == Motion::Paper {
        return cops.on_line(&axes);
    }
    cops.in_hands(position, carrying, &axes)
}

impl ByCops {
    fn of(settings: &Settings, eta: [f64; 2], carrying: &Carrying<'_>) -> ByCops {
        let Carrying { instant, ground, prediction, estimate, subject, force } = *carrying;
        let (pose, body) = (&estimate.on_plate, &prediction.body);
        let table = subject.anthropometry();
        let grip_m: [Vector3<f64>; 2] =
            Side::BOTH.map(|side| pose.point_on(side.hand(), table.grip_m(side.hand())));
        let (vertical_n, delta_f_n, weight_n) = (force.vertical_n, force.delta_f_n, force.weight_n());
        let height_m = eta[0] * grip_m[0].z + eta[1] * grip_m[1].z - instant.snapshot.ground.surface_z_m;
        // Acceleration of the load: of the hands, weighted by their load fractions.
        let acceleration = |axis: usize| {
            let [left, right] = body.hand_acceleration_m_per_s2;
            eta[0] * left[axis] + eta[1] * right[axis]
        };
        let is_paper = settings.motion == Motion::Paper;
        let swing = if is_paper { [0.0; 2] } else { [acceleration(0), acceleration(1)] };
        // The CoP of an accelerated load at x is x − z ẍ/(g + z̈).
        let load_m: [f64; 2] = core::array::from_fn(|axis| {
            let by_cops_m =
                (ground.reading.cop_m[axis] * vertical_n - estimate.cop_m[axis] * weight_n) / delta_f_n;
            by_cops_m + height_m * swing[axis] / body.load_weight_m_per_s2()
        });
        // Uncertainty of the load's position: that of the two CoPs, magnified by weight over load, and that of the
        // hands.
        let chain_m = instant.orientation_sigma_rad(settings) * settings.height_m;
        let sigma_m: [f64; 2] = core::array::from_fn(|axis| {
            let by_estimate_m = estimate.cop_sigma_m[axis] * weight_n / delta_f_n;
            let by_measurement_m = ground.sigma.cop_m * vertical_n / delta_f_n;
            let by_force_m = (load_m[axis] - estimate.cop_m[axis]) * force.sigma_n / delta_f_n;
            math::hypot([math::hypot([by_estimate_m, by_measurement_m]), math::hypot([by_force_m, chain_m])])
        });
        ByCops { grip_m, between: grip_m.map(|grip| [grip.x, grip.y]), swing, load_m, sigma_m }
    }

    fn distance_sigma_m(&self) -> f64 {
        self.sigma_m[0].max(self.sigma_m[1])
    }

    /// The load on the line between the hands, as in the paper.
    fn on_line(&self, axes: &HandAxes) -> LoadInHands {
        let (right_hand, distance_m) = project(self.load_m, self.between);
        let distance_sigma_m = self.distance_sigma_m();
        LoadInHands {
            grip_m: self.grip_m,
            eta: [1.0 - right_hand, right_hand],
            eta_sigma: (distance_sigma_m / axes.apart_m.max(1e-3)).min(0.5),
            ahead_sigma_m: [0.0; 2],
            position_sigma_m: [0.0; 2],
            residual_m: [Measured { value: 0.0, sigma: f64::INFINITY }; 2],
            contradiction_m: 0.0,
            swing_n: [0.0; 2],
            distance_m,
            distance_sigma_m,
        }
    }

    /// The load at its mean position in the hands.
    fn in_hands(&self, position: &LoadPosition, carrying: &Carrying<'_>, axes: &HandAxes) -> LoadInHands {
        let ByCops { grip_m, between, swing, load_m, sigma_m } = self;
        let (aside, ahead, apart_m) = (axes.aside, axes.ahead, axes.apart_m);
        let [ahead_m, ahead_sigma_m] = position.ahead_m();
        let offset = Vector3::new(ahead[0] * ahead_m, ahead[1] * ahead_m, 0.0);
        let (eta, eta_sigma) = (position.eta(), position.eta_sigma());
        let ahead_sigma_m = ahead.map(|part| part * ahead_sigma_m);
        let pose = &carrying.estimate.on_plate;
        let of_hands_m2 = Side::BOTH.map(|side| overload::grip_covariance_m2(pose, side, GRIP_SIGMA_M));
        let position_sigma_m: [f64; 2] = core::array::from_fn(|axis| {
            let aside_sigma_m = aside[axis] * eta_sigma * apart_m;
            // Independent on both hands; xx and yy of the covariance.
            let grip_m2: f64 = (0..2).map(|hand| eta[hand] * eta[hand] * of_hands_m2[hand][2 * axis]).sum();
            let hands_sigma_m = math::hypot([aside_sigma_m, ahead_sigma_m[axis]]);
            math::hypot([hands_sigma_m, math::sqrt(grip_m2)])
        });
        let residual_m: [Measured; 2] = core::array::from_fn(|axis| {
            let in_hands_m = eta[0] * between[0][axis] + eta[1] * between[1][axis] + offset[axis];
            // The part of the body's position error that is independent of Ĉ_wo displaces the hands only.
            let place_sigma_m = carrying.estimate.stance.rest_m[axis];
            let sigma = math::hypot([math::hypot([sigma_m[axis], place_sigma_m]), position_sigma_m[axis]]);
            Measured { value: load_m[axis] - in_hands_m, sigma }
        });
        // The assumed grip is wrong, or a CoP is: the fractions are then unknown by as much.
        let is_contradiction = residual_m.iter().any(|residual| residual.is_beyond(ANOTHER_GRIP_SIGMAS));
        let contradiction_m =
            if is_contradiction { math::hypot(residual_m.map(|residual| residual.value)) } else { 0.0 };
        let eta_sigma = math::hypot([eta_sigma, contradiction_m / apart_m.max(TOO_CLOSE_M)]).min(EVEN_SIGMA);
        let load_kg = carrying.prediction.body.load_kg(carrying.force.delta_f_n);
        let (_, distance_m) = project(*load_m, *between);
        LoadInHands {
            grip_m: grip_m.map(|grip_m| grip_m + offset),
            eta,
            eta_sigma,
            ahead_sigma_m,
            position_sigma_m,
            residual_m,
            contradiction_m,
            swing_n: swing.map(|acceleration| load_kg * acceleration),
            distance_m,
            distance_sigma_m: self.distance_sigma_m(),
        }
    }
}

impl HandAxes {
    fn of(pose: &Pose<StationWorld>, cops: &ByCops) -> HandAxes {
        let apart = cops.grip_m[1] - cops.grip_m[0];
        let apart_m = math::hypot([apart.x, apart.y]);
        let aside = if apart_m < TOO_CLOSE_M {
            let right = pose.world_from_segment[0] * -Vector3::y();
            [right.x, right.y].map(|part| part / math::hypot([right.x, right.y]).max(1e-9))
        } else {
            [apart.x / apart_m, apart.y / apart_m]
        };
        let middle = [0, 1].map(|axis: usize| 0.5 * (cops.between[0][axis] + cops.between[1][axis]));
        // Away from the body, also if the hands cross.
        let pelvis = pose.origin_of(Segment::Pelvis);
        let is_away = aside[0] * (middle[1] - pelvis.y) - aside[1] * (middle[0] - pelvis.x) >= 0.0;
        let ahead = if is_away { [-aside[1], aside[0]] } else { [aside[1], -aside[0]] };
        HandAxes { aside, ahead, apart_m, middle }
    }
}

/// Updates the mean position of the load in the hands.
fn update_position(position: &mut LoadPosition, carrying: &Carrying<'_>, cops: &ByCops, axes: &HandAxes) {
    let Carrying { instant, prediction, estimate, subject, force, .. } = *carrying;
    let rows = subject.reduction.rows(&estimate.on_plate, prediction.body.slope);
    let cop_rows: [[f64; STATES]; 2] = [0, 1].map(|axis| subject.with_stance(&rows, axis));
    let magnified = force.weight_n() / force.delta_f_n;
    let by_model_m2 = subject.cop_variance_m2(&rows).map(|cop_m2| cop_m2 * magnified * magnified);
    let rest_m2 =
        [0, 1].map(|axis: usize| (cops.sigma_m[axis] * cops.sigma_m[axis] - by_model_m2[axis]).max(0.0));
    // The load's position along a direction from the middle between the grips, per unit.
    let along = |direction: [f64; 2], unit_m: f64| {
        let value: f64 = (0..2).map(|axis| direction[axis] * (cops.load_m[axis] - axes.middle[axis])).sum();
        let rest_m2: f64 = (0..2).map(|axis| direction[axis] * direction[axis] * rest_m2[axis]).sum();
        let parts = direction.map(|part| -part * magnified / unit_m);
        let mut row: [f64; STATES] =
            core::array::from_fn(|state| parts[0] * cop_rows[0][state] + parts[1] * cop_rows[1][state]);
        // The stance offset also displaces the grips.
        for (axis, part) in direction.into_iter().enumerate() {
            row[subject.reduction.count() + axis] -= part / unit_m;
        }
        ByModel { measured: Measured { value: value / unit_m, sigma: math::sqrt(rest_m2) / unit_m }, row }
    };
    let from_middle = along(axes.aside, axes.apart_m);
    let right = ByModel {
        measured: Measured { value: 0.5 + from_middle.measured.value, ..from_middle.measured },
        ..from_middle
    };
    let are_together = axes.apart_m < TOO_CLOSE_M;
    position.update((!are_together).then_some(&right), &along(axes.ahead, 1.0), instant.step_s, |row| {
        subject.filter.times_covariance(row)
    });
}
