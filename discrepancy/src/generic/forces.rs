//! Forces and springs at points of the body.

use equipoise_core::effect::{Columns, Effect, Place};

use super::library::Entry;
use super::words;
use crate::rows::Rows;

/// A force, and a spring to an arbitrary point, at every segment.
pub(super) fn all(rows: &Rows<'_>) -> Vec<Entry> {
    let mut list = Vec::new();
    for place in Effect::SegmentHeading.places() {
        let Place::Segment(segment) = *place else { continue };
        let name = words(segment);
        let at = |block: usize| rows.blocks[block].observation.origin_m[segment.index()];
        let pushed = format!("a force on the {name}");
        list.push(Entry::of(rows, pushed, &[30.0; 3], |block| force(rows, block, at(block))));
        let pulled = format!("a spring that pulls at the {name}");
        let sigma = [30.0, 30.0, 30.0, 60.0];
        list.push(Entry::of(rows, pulled, &sigma, |block| spring(rows, block, at(block))));
    }
    list.into_iter().map(Entry::like_the_catalogue).collect()
}

/// A force in the world's axes at a point of the body, N.
fn force(rows: &Rows<'_>, block: usize, at_m: [f64; 3]) -> Columns {
    let seen = &rows.blocks[block].observation;
    let under_m = if seen.slope_is_measured { seen.com_m[2] } else { seen.floor_m };
    let weight_n = seen.force_predicted_n[2];
    let mut columns = Columns::zero(3);
    columns.cop_m[0] = [(at_m[2] - under_m) / weight_n, 0.0];
    columns.cop_m[1] = [0.0, (at_m[2] - under_m) / weight_n];
    columns.cop_m[2] = [0, 1].map(|axis| -(at_m[axis] - seen.cop_predicted_m[axis]) / weight_n);
    for axis in 0..3 {
        columns.force_n[axis][axis] = -1.0;
    }
    columns
}

/// A force and a stiffness, N/m, towards the world's origin: together a spring to an arbitrary point.
fn spring(rows: &Rows<'_>, block: usize, at_m: [f64; 3]) -> Columns {
    let mut columns = force(rows, block, at_m);
    columns.count = 4;
    let (cop_m, force_n) = columns.times(&[-at_m[0], -at_m[1], -at_m[2], 0.0]);
    (columns.cop_m[3], columns.force_n[3]) = (cop_m, force_n);
    columns
}
