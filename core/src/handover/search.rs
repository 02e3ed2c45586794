//! Search for the place of a part, and the slope of its handles, with the lowest limit ratio of the worst joint.

use nalgebra::Vector3;

use super::experience::{Experience, LimitRatio};
use super::{Body, FootPlacement, Infeasible, Part, predict};
use crate::body::Joint;

/// Region of the places from the middle between the ankles on the floor: forward, to the left, up, from and to, m.
pub type Region = [[f64; 2]; 3];

/// The places in front of a standing worker.
pub const REGION_M: Region = [[0.3, 0.7], [-0.4, 0.4], [0.6, 1.5]];
/// Spacing of the places, m: half of that over which the overload changes by its σ.
pub const SPACING_M: f64 = 0.05;

/// Slopes of the handles ([`Part::slope_rad`]): 0, 30 and 60°, rad. Steeper handles exceed the range of the wrists in most
/// postures.
pub const SLOPES_RAD: [f64; 3] = [0.0, core::f64::consts::FRAC_PI_6, core::f64::consts::FRAC_PI_3];

/// The places of a region at [`SPACING_M`], its bounds included, m.
pub fn places(region_m: Region) -> impl Iterator<Item = Vector3<f64>> {
    let steps = region_m.map(steps);
    let along = move |axis: usize| {
        (0..=steps[axis]).map(move |step| region_m[axis][0] + f64::from(step as u32) * SPACING_M)
    };
    along(2).flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| Vector3::new(x, y, z))))
}

/// Number of steps between the bounds of an axis.
const fn steps([low, high]: [f64; 2]) -> usize {
    ((high - low) / SPACING_M + 0.5) as usize
}

/// A worker who stands somewhere, and a part.
#[derive(Debug, Clone, Copy)]
pub struct Planning<'a> {
    /// The worker's body.
    pub body: &'a Body,
    /// Stature, m.
    pub height_m: f64,
    /// The feet.
    pub feet: &'a FootPlacement,
    /// The part; a search changes the slope of its handles.
    pub part: &'a Part,
    /// Earlier handovers to this worker.
    pub experience: &'a Experience,
}

/// A place of the part, with the prediction for it.
#[derive(Debug, Clone, Copy)]
pub struct PlacePrediction {
    /// Relative to the feet, as [`FootPlacement::place_m`], m.
    pub place_m: Vector3<f64>,
    /// In the station's world, m.
    pub position_m: Vector3<f64>,
    /// Slope of the handles, rad ([`Part::slope_rad`]).
    pub slope_rad: Option<f64>,
    /// The prediction.
    pub predicted: Predicted,
}

/// The worst joint and its limit ratio.
pub type Predicted = Result<(Joint, LimitRatio), Infeasible>;

impl PlacePrediction {
    /// The feasible place with the lowest limit ratio.
    pub fn lowest(places: impl Iterator<Item = PlacePrediction>) -> Option<PlacePrediction> {
        places.filter(|place| place.predicted.is_ok()).min_by(|a, b| a.value().total_cmp(&b.value()))
    }

    /// The limit ratio; infinite where the part cannot be held.
    fn value(&self) -> f64 {
        self.predicted.map_or(f64::INFINITY, |(_, ratio)| ratio.value)
    }
}

/// Strides of the search, in steps of the map.
const STRIDES: [usize; 3] = [4, 2, 1];
/// Number of coarse places from which the search descends.
const STARTS: usize = 3;
const STEPS: [usize; 3] = [steps(REGION_M[0]), steps(REGION_M[1]), steps(REGION_M[2])];
const PLACES: usize = (STEPS[0] + 1) * (STEPS[1] + 1) * (STEPS[2] + 1);

/// Steps from the lower bounds of the region.
type Cell = [usize; 3];

impl Planning<'_> {
    /// The prediction at a place (relative to the feet, m), with this slope of the handles, corrected by experience.
    pub fn at(&self, place_m: Vector3<f64>, slope_rad: Option<f64>) -> PlacePrediction {
        let position_m = self.feet.world_m(place_m, self.height_m);
        let predicted = predict(self.body, self.feet, &self.part.with_slope(slope_rad), position_m);
        let predicted = predicted.map(|it| (it.worst, self.experience.correct(place_m, it.worst_ratio)));
        PlacePrediction { place_m, position_m, slope_rad, predicted }
    }

    /// The place of [`REGION_M`] and the slope of [`SLOPES_RAD`] with the lowest limit ratio that the search finds; `None`
    /// if no starting place of the search is feasible.
    pub fn best(&self) -> Option<PlacePrediction> {
        PlacePrediction::lowest(SLOPES_RAD.iter().filter_map(|slope_rad| self.best_with(*slope_rad)))
    }

    /// The prediction at a place with the slope of [`SLOPES_RAD`] that has the lowest limit ratio there, or the first one
    /// if none is feasible.
    pub fn at_best_slope(&self, place_m: Vector3<f64>) -> PlacePrediction {
        let all = SLOPES_RAD.map(|slope_rad| self.at(place_m, Some(slope_rad)));
        PlacePrediction::lowest(all.into_iter()).unwrap_or(all[0])
    }

    /// The best place with this slope, from coarse to fine. If no place of the coarsest stride is feasible, the search
    /// starts from the next finer one; `None` if that has no feasible place either.
    fn best_with(&self, slope_rad: f64) -> Option<PlacePrediction> {
        let mut map = Map { planning: self, slope_rad, value: [f64::NAN; PLACES] };
        // If no coarse place is feasible, the next stride bounds the time of a request: one of 2³ times as many places.
        let starts =
            STRIDES[..2].iter().map(|stride| map.lowest(*stride)).find(|starts| starts[0].1.is_finite())?;
        let feasible = starts.into_iter().filter(|(_, value)| value.is_finite());
        let found = feasible.map(|start| map.descend(start)).min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(self.at(place_of(found.0), Some(slope_rad)))
    }
}

/// The place of a cell, m.
fn place_of(cell: Cell) -> Vector3<f64> {
    Vector3::from(core::array::from_fn(|axis| REGION_M[axis][0] + cell[axis] as f64 * SPACING_M))
}

/// Limit ratios by cell; NaN where none is computed yet.
struct Map<'a> {
    planning: &'a Planning<'a>,
    slope_rad: f64,
    value: [f64; PLACES],
}

impl Map<'_> {
    /// The places with the lowest values among every `stride`th along each axis; infinite values are infeasible places.
    fn lowest(&mut self, stride: usize) -> [(Cell, f64); STARTS] {
        let mut lowest = [([0; 3], f64::INFINITY); STARTS];
        for x in (0..=STEPS[0]).step_by(stride) {
            for y in (0..=STEPS[1]).step_by(stride) {
                for z in (0..=STEPS[2]).step_by(stride) {
                    let found = ([x, y, z], self.value([x, y, z]));
                    if found.1 < lowest[STARTS - 1].1 {
                        lowest[STARTS - 1] = found;
                        lowest.sort_unstable_by(|a, b| a.1.total_cmp(&b.1));
                    }
                }
            }
        }
        lowest
    }

    fn value(&mut self, cell: Cell) -> f64 {
        let index = (cell[2] * (STEPS[1] + 1) + cell[1]) * (STEPS[0] + 1) + cell[0];
        if self.value[index].is_nan() {
            self.value[index] = self.planning.at(place_of(cell), Some(self.slope_rad)).value();
        }
        self.value[index]
    }

    /// Moves to the lowest neighbour until none is lower, with each stride.
    fn descend(&mut self, mut at: (Cell, f64)) -> (Cell, f64) {
        for stride in &STRIDES[1..] {
            loop {
                let mut lowest = at;
                for axis in 0..3 {
                    for moved in [at.0[axis].checked_sub(*stride), Some(at.0[axis] + stride)] {
                        let Some(moved) = moved.filter(|moved| *moved <= STEPS[axis]) else { continue };
                        let mut cell = at.0;
                        cell[axis] = moved;
                        let value = self.value(cell);
                        if value < lowest.1 {
                            lowest = (cell, value);
                        }
                    }
                }
                if lowest.0 == at.0 {
                    break;
                }
                at = lowest;
            }
        }
        at
    }
}
