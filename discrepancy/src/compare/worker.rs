//! The identified subject, in the form that the comparison requires.

use equipoise_core::anchor::LIFTED_M;
use equipoise_core::body::{Anthropometry, SEGMENTS, Side, gyration_m2};
use equipoise_core::cycle::support::bearing_feet;
use equipoise_core::cycle::{Identification, Settings, foot_outline};
use equipoise_core::motion::Snapshot;
use equipoise_core::sesc::{Phi, ReductionKind};

use crate::constants::{CHAIN_ERROR_M, SUPPORT_MARGIN_M};
use crate::session::PARAMETERS;

/// An identified subject.
#[derive(Debug, Clone, Copy)]
pub struct Worker {
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Stature, m.
    pub height_m: f64,
    /// The chain's parameters.
    pub phi: Phi,
    /// Whether the anchor holds the body at its standing feet, because the suit's position drifts.
    pub feet_hold: bool,
    /// Constant offset of the centre of pressure from that of the chain, due to the plate's place in the suit's world,
    /// m.
    pub offset_m: [f64; 2],
    /// The table scaled to this subject's segment lengths.
    pub body: Anthropometry,
    /// Squares of the radii of gyration about each segment's axes, m².
    pub gyration_m2: [[f64; 3]; SEGMENTS],
}

impl Worker {
    /// The identified subject; `None` while segment lengths or mass are unavailable.
    pub fn of(learnt: &Identification, settings: &Settings) -> Option<Worker> {
        let count = learnt.filter.count();
        let offset_m = [0, 1].map(|axis| learnt.filter.theta_m()[count + axis]);
        (learnt.has_body() && learnt.mass_kg > 0.0).then(|| Worker {
            mass_kg: learnt.mass_kg,
            height_m: settings.height_m,
            phi: learnt.phi(),
            feet_hold: settings.suit_drifts,
            offset_m,
            body: *learnt.anthropometry(),
            gyration_m2: gyration_m2(&learnt.skeleton(), settings.height_m),
        })
    }

    /// Whether both feet stand. An error of a leg's sensor raises an ankle like a lifted foot, but does not move the CoP
    /// below the other foot: the higher foot stands if the lower one alone cannot support the load.
    pub(super) fn stands_on_both_feet(&self, snapshot: &Snapshot) -> bool {
        if snapshot.both_feet_stand == 1 {
            return true;
        }
        let pose = snapshot.pose();
        let [left_m, right_m] = Side::BOTH.map(|side| pose.origin_of(side.foot()).z);
        let cop_m = snapshot.ground().and_then(|ground| ground.cop_m().ok());
        cop_m.filter(|_| (left_m - right_m).abs() > LIFTED_M).is_some_and(|cop_m| {
            let relative_m = [0, 1].map(|axis| cop_m[axis] - self.offset_m[axis]);
            let outlines = foot_outline::both(&pose, None, self.height_m);
            bearing_feet(&pose, relative_m, &outlines, SUPPORT_MARGIN_M) == [true; 2]
        })
    }

    /// Grip points, hand axes, m: left, right.
    pub(super) fn grip_m(&self) -> [[f64; 3]; 2] {
        Side::BOTH.map(|side| self.body.grip_m(side.hand()))
    }
}

/// Prior covariance of all 69 parameters before any pose, m², row by row: the table's spread, the soft constraints, the
/// suit's misalignment, inflated as the first poses require, and the chain's model error.
pub fn prior_covariance_m2(learnt: &Identification, settings: &Settings) -> Vec<f64> {
    let mut prior = Box::new(*learnt);
    let inflation = learnt.prior_inflation();
    prior.reset_to_prior(&Settings { reduction: ReductionKind::Full, ..*settings });
    let mut covariance_m2 = vec![0.0; PARAMETERS * PARAMETERS];
    for (row, values) in covariance_m2.chunks_exact_mut(PARAMETERS).enumerate() {
        let prior_m2 = prior.filter.covariance_row_m2(row);
        for (value, prior_m2) in values.iter_mut().zip(prior_m2) {
            *value = inflation * prior_m2;
        }
        values[row] += CHAIN_ERROR_M * CHAIN_ERROR_M;
    }
    covariance_m2
}
