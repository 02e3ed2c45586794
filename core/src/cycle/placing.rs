//! Where the suit's world lies on the plate, found anew when it is lost.
//!
//! A suit that is started anew has another origin and another heading; one that was silent for long has drifted. The body
//! is the same: while nothing is carried, the centre of pressure that the suit lets expect and the measured one are the
//! same point, and measured shear over the mass is the acceleration that the suit shows. Pairs of them tell place and heading
//! ([`PlanarFit`]), the heading by what the worker moves. Until both are known, nothing that needs them is told or learnt.
//! After that the fit goes on until the heading is known as well as a segment's orientation.
//!
//! Most suits keep their heading, for they find north. So a heading that is the old one is believed sooner: beforehand it is
//! as likely as all others together.

use core::array;

use bytemuck::{Pod, Zeroable};

use super::body_motion::BodyMotion;
use super::identification::REGISTRATION_SIGMA_M;
use super::memory::Memory;
use super::residual::{MOTION_ROW_EVERY_NS, ROWS_PER_INDEPENDENT};
use super::settings::Settings;
use crate::anchor::STANCE_SIGMA_M;
use crate::body::Side;
use crate::frame::{Pose, StationWorld, Turn};
use crate::math;
use crate::message::{Component, GroundSample, State, SuitSample};
use crate::motion::Moment;
use crate::registration::PlanarFit;
use crate::sesc::PARAMETERS;

/// While the feet stand, the centre of pressure stays within this of where it was most of the time, m: half a foot's length forth
/// and back, half a pace aside.
const STANCE_REACH_M: f64 = 0.10;

/// The centres of pressure may be so far apart, m: three σ of a place that is known at all …
const APART_MAX_M: f64 = 3.0 * REGISTRATION_SIGMA_M;
/// … for so many rows in a row: two seconds.
const ROWS_APART_MAX: u64 = 20;

/// What is wrong with the model in a pose stays wrong while that lasts: pairs of one squat or one reach, of two seconds, say as
/// much of it as one.
const ROWS_PER_POSE: f64 = 20.0;

/// From these odds on the heading is the old one.
const SURE_ODDS: f64 = 20.0;

/// How far the suit's place and heading are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
enum Known {
    /// As well as they will be.
    Well = 0,
    /// Well enough to be used; the heading becomes better.
    Roughly = 1,
    /// They are sought.
    Not = 2,
}

/// The suit's heading, and the search for it and for the suit's place.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Placing {
    /// From the suit's world to the station's, about the vertical, rad.
    station_from_suit_rad: f64,
    /// 1-σ of it beyond what was configured, rad.
    sigma_rad: f64,
    /// A [`Known`].
    known: u64,
    /// What the search began with: 1-σ of the heading, rad.
    begun_sigma_rad: f64,
    /// 1-σ of the heading before the search, rad.
    old_sigma_rad: f64,
    /// By how much the heading was changed since the search began, rad.
    turned_rad: f64,
    fit: PlanarFit,
    /// Time of the last pair, ns.
    paired_ns: u64,
    /// Stance of the last pair.
    stance: u64,
    /// What θ's errors do to the expected centre of pressure of the first pair, as the suit is turned now: rows x and y.
    first_rows: [[f64; PARAMETERS]; 2],
    /// Pairs that contradicted those before them, in a row.
    contradictions: u64,
    /// Rows in a row whose centres of pressure were too far apart for this place.
    apart: u64,
}

impl Placing {
    /// Whether place or heading are not known.
    pub(super) fn is_lost(&self) -> bool {
        self.known == Known::Not as u64
    }

    /// From the suit's world to the station's, about the vertical, rad.
    pub(super) fn station_from_suit_rad(&self) -> f64 {
        self.station_from_suit_rad
    }

    /// 1-σ of the heading, rad: 0 while it is the one that was configured, π while it is not known.
    pub(super) fn sigma_rad(&self) -> f64 {
        if self.is_lost() { core::f64::consts::PI } else { self.sigma_rad }
    }

    /// 1-σ of a centre of pressure by the heading's, m: the stance's offset holds between the feet, and an error of the heading
    /// turns about there.
    pub(super) fn heading_sigma_m(&self, pose: &Pose<StationWorld>, cop_m: [f64; 2]) -> [f64; 2] {
        let between = 0.5 * (pose.origin_of(Side::Left.foot()) + pose.origin_of(Side::Right.foot()));
        let [ahead_m, beside_m] = [cop_m[0] - between.x, cop_m[1] - between.y];
        [beside_m, ahead_m].map(|lever_m| lever_m.abs() * self.sigma_rad())
    }

    /// The place is not known any more, and the heading is known to `sigma_rad`.
    pub(super) fn lose(&mut self, sigma_rad: f64) {
        if !self.is_lost() {
            self.old_sigma_rad = self.sigma_rad;
        }
        self.known = Known::Not as u64;
        self.begun_sigma_rad = sigma_rad;
        self.contradictions = 0;
        self.turned_rad = 0.0;
        self.fit.start(sigma_rad);
    }

    /// If the heading is the one before the search, which is as likely beforehand as all others together: takes it as that,
    /// give or take what it was known to and `orientation_sigma_rad`. Only where all others were possible.
    fn believe_the_old_heading(&mut self, orientation_sigma_rad: f64) {
        // The fit is from the plate's axes to the suit's, as they are turned now.
        let off_rad = math::wrapped(self.fit.heading_rad() - self.turned_rad);
        let old_sigma_rad = math::hypot([self.old_sigma_rad, orientation_sigma_rad]);
        let sigma_rad = self.fit.heading_sigma_rad();
        let off_sigma_rad = math::hypot([sigma_rad, old_sigma_rad]);
        let deviation = off_rad / off_sigma_rad;
        // The normal density over the uniform one, 1/2π.
        let odds =
            math::sqrt(core::f64::consts::TAU) / off_sigma_rad * math::exp(-0.5 * deviation * deviation);
        let is_open = self.begun_sigma_rad >= core::f64::consts::PI && sigma_rad > old_sigma_rad;
        if is_open && self.fit.has_begun() && odds >= SURE_ODDS {
            self.fit.believe_heading(self.turned_rad, old_sigma_rad);
        }
    }

    /// Takes in how far measured and expected centre of pressure are apart, m. Apart for long, the place is another.
    fn watch(&mut self, apart_m: f64) {
        self.apart = if apart_m > APART_MAX_M { self.apart + 1 } else { 0 };
        if self.apart >= ROWS_APART_MAX {
            self.apart = 0;
            self.lose(core::f64::consts::PI);
        }
    }

    /// Takes up a heading that was found before, with its σ.
    pub(super) fn resume(&mut self, station_from_suit_rad: f64, sigma_rad: f64) {
        *self = Placing { station_from_suit_rad, sigma_rad, ..Zeroable::zeroed() };
        if sigma_rad >= core::f64::consts::PI {
            self.lose(sigma_rad);
        } else if sigma_rad > 0.0 {
            self.known = Known::Roughly as u64;
            self.begun_sigma_rad = sigma_rad;
            self.fit.start(sigma_rad);
        }
    }

    /// The sample with the station's heading.
    pub(super) fn headed(&self, suit: &SuitSample) -> SuitSample {
        if self.station_from_suit_rad == 0.0 {
            *suit
        } else {
            suit.turned(Turn::by(self.station_from_suit_rad))
        }
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let Placing { station_from_suit_rad, sigma_rad, begun_sigma_rad, old_sigma_rad, turned_rad, .. } =
            *self;
        let angles = [station_from_suit_rad, sigma_rad, begun_sigma_rad, old_sigma_rad, turned_rad];
        angles.iter().chain(self.first_rows.iter().flatten()).all(|number| number.is_finite())
            && self.known <= Known::Not as u64
            && self.fit.is_sound()
    }

    /// Takes in where the body's centre of pressure is and where it is expected. Contradictions that last begin the search
    /// anew: what was paired before was of another place.
    fn pair(&mut self, measured_m: [f64; 2], expected_m: [f64; 2], variance_m2: [f64; 2]) {
        if self.fit.take_in(measured_m, expected_m, variance_m2) {
            self.contradictions = 0;
            return;
        }
        self.contradictions += 1;
        if self.contradictions as f64 > ROWS_PER_INDEPENDENT {
            self.contradictions = 0;
            self.fit.start(self.begun_sigma_rad);
        }
    }
}

impl Memory {
    /// 1-σ of a segment's orientation in the station's world, rad.
    pub(super) fn orientation_sigma_rad(&self, settings: &Settings) -> f64 {
        math::hypot([settings.suit_orientation_sigma_rad(), self.placing.sigma_rad()])
    }

    /// One moment without a load: pairs the two centres of pressure, and puts the suit's world in place once it is known.
    pub(super) fn seek_the_place(
        &mut self,
        pose: &Pose<StationWorld>,
        moment: &Moment,
        body: &BodyMotion,
        settings: &Settings,
    ) {
        if moment.ground().is_some_and(GroundSample::is_by_insoles_alone) {
            // Their place is the suit's, wherever that is.
            self.placing.known = Known::Well as u64;
            return;
        }
        let due = moment.time_ns.saturating_sub(self.placing.paired_ns) >= MOTION_ROW_EVERY_NS;
        if !settings.suit_drifts || !due || moment.both_feet_stand != 1 {
            return;
        }
        let known = self.placing.known;
        if known != Known::Not as u64 {
            let State { cop_measured_m, cop_estimated_m, .. } = self.known;
            self.placing.watch(math::hypot([0, 1].map(|axis| cop_measured_m[axis] - cop_estimated_m[axis])));
        }
        if known == Known::Well as u64 {
            self.placing.paired_ns = moment.time_ns;
            return;
        }
        if moment.stance != self.placing.stance {
            self.placing.fit.wander(STANCE_SIGMA_M * STANCE_SIGMA_M);
        }
        (self.placing.paired_ns, self.placing.stance) = (moment.time_ns, moment.stance);
        let worker = &self.identification;
        let rows = worker.reduction.rows(pose, body.slope);
        if !self.placing.fit.has_begun() {
            self.placing.first_rows = rows.h;
        }
        // An error of θ moves the first pair as well: it is one of the place. What it changes with the pose is one of the pair.
        let first = &self.placing.first_rows;
        let since_first =
            [0, 1].map(|axis: usize| array::from_fn(|index| rows.h[axis][index] - first[axis][index]));
        let of_first_m2 = worker.parameter_variance_m2(first);
        let (of_body_m2, wander_m2) =
            (worker.parameter_variance_m2(&since_first), worker.wander_variance_m2(pose, settings));
        let unfelt_m = body.leaning_sigma_m(self.noise.moving_acceleration_sigma_m_per_s2());
        let variance_m2 = [0, 1].map(|axis: usize| {
            let moving_m = self.noise.cop[axis].sigma(self.noise.cop_activity_m[axis].height());
            let plate_m = self.ground_sigma.cop_m;
            let of_motion_m2 = moving_m * moving_m + plate_m * plate_m + unfelt_m * unfelt_m;
            let of_pose_m2 = of_body_m2[axis] + wander_m2[axis];
            ROWS_PER_INDEPENDENT * of_motion_m2 + ROWS_PER_POSE * of_pose_m2
        });
        let offset_m = worker.stance_offset_m();
        let expected_m = [0, 1].map(|axis| self.known.cop_estimated_m[axis] - offset_m[axis]);
        let measured_m = self.known.cop_measured_m;
        self.placing.pair(measured_m, expected_m, variance_m2);
        let [shear_x_n, shear_y_n, _] = moment.ground.force_n;
        if moment.ground.measures(Component::Shear) && (shear_x_n, shear_y_n) != (0.0, 0.0) {
            let by_plate = [shear_x_n, shear_y_n].map(|shear_n| shear_n / self.identification.mass_kg);
            let [x, y, _] = body.suit_acceleration_m_per_s2;
            let sigma = self.noise.acceleration_sigma_m_per_s2();
            self.placing.fit.take_in_vector(by_plate, [x, y], [ROWS_PER_INDEPENDENT * sigma * sigma; 2]);
        }
        self.placing.believe_the_old_heading(settings.suit_orientation_sigma_rad());
        let fit = &self.placing.fit;
        let (sigma_rad, fit_m2) = (fit.heading_sigma_rad(), fit.variance_m2(measured_m));
        let at_m2 = [0, 1].map(|axis| fit_m2[axis] + of_first_m2[axis]);
        let reach_m = STANCE_REACH_M * sigma_rad;
        let is_known = fit.is_rigid()
            && at_m2.iter().all(|at_m2| math::hypot([math::sqrt(*at_m2), reach_m]) <= REGISTRATION_SIGMA_M);
        let is_better = known == Known::Not as u64 || sigma_rad <= 0.5 * self.placing.sigma_rad;
        if is_known && is_better {
            self.move_into_place(measured_m, at_m2, settings);
        }
    }

    /// Turns and moves the suit's world to where the fit has it; where the body is now comes to lie at `measured_m`.
    fn move_into_place(&mut self, measured_m: [f64; 2], at_m2: [f64; 2], settings: &Settings) {
        let placing = &mut self.placing;
        // The fit is from the plate's axes to the suit's.
        let heading_rad = -placing.fit.heading_rad();
        let turn = Turn::by(heading_rad);
        let turned_m = turn.of(placing.fit.image_m(measured_m));
        let by_m = [0, 1].map(|axis| measured_m[axis] - turned_m[axis]);
        placing.fit.follow(turn, by_m);
        let [x, y] = placing.first_rows;
        for (index, (x, y)) in x.into_iter().zip(y).enumerate() {
            [placing.first_rows[0][index], placing.first_rows[1][index]] = turn.of([x, y]);
        }
        placing.station_from_suit_rad = math::wrapped(placing.station_from_suit_rad + heading_rad);
        placing.turned_rad = math::wrapped(placing.turned_rad + heading_rad);
        placing.sigma_rad = placing.fit.heading_sigma_rad();
        let is_well = placing.sigma_rad <= settings.suit_orientation_sigma_rad();
        placing.known = if is_well { Known::Well } else { Known::Roughly } as u64;
        self.anchor.move_world(turn, by_m);
        self.identification.stand_within(at_m2);
        // What they hold is of another heading.
        self.history.clear();
        self.window.clear();
    }
}
