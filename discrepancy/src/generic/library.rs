//! The library: terms by their columns at every block of the work, and those that are forces on the body or errors of
//! the plate.

use equipoise_core::body::Segment;
use equipoise_core::effect::{Columns, Effect, Place};

use super::{regions, shifts};
use crate::constants::{
    COP_MAP, FORCE_MAP, GENERIC_FORCE_N, GENERIC_STIFFNESS_N_PER_M, HYSTERESIS, MODEL_ERROR,
};
use crate::rows::Rows;

/// A term of the library.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    /// Description.
    pub(crate) what: String,
    /// Whether it is an error of the suit: evidence must then come from the centre of pressure, since accelerations
    /// alone are weak evidence.
    pub(crate) is_suit_error: bool,
    /// Deviation from its equation, as [`MODEL_ERROR`].
    pub(crate) model_error: (f64, u32),
    /// Prior size of each parameter, 1-σ.
    pub(crate) sigma: Vec<f64>,
    /// Its columns, one for each block of the work.
    pub(crate) columns: Vec<Columns>,
}

impl Entry {
    /// An entry defined block by block.
    pub(crate) fn of(rows: &Rows<'_>, what: String, sigma: &[f64], of: impl Fn(usize) -> Columns) -> Entry {
        let columns = (rows.work_from..rows.len()).map(of).collect();
        let [_, model_error] = MODEL_ERROR;
        Entry { what, is_suit_error: false, model_error, sigma: sigma.to_vec(), columns }
    }

    /// The same entry, marked as a force, which varies like a contact.
    fn into_force(self) -> Entry {
        let [model_error, _] = MODEL_ERROR;
        Entry { model_error, ..self }
    }

    /// The same entry, marked as an error of the suit.
    pub(crate) fn into_suit_error(self) -> Entry {
        Entry { is_suit_error: true, ..self }
    }
}

/// All generic terms, in the work.
pub(crate) fn all(rows: &Rows<'_>) -> Vec<Entry> {
    let neighbours = shifts::Neighbours::of(rows);
    let mut list: Vec<Entry> = forces(rows).into_iter().map(Entry::into_force).collect();
    list.extend(shifts::joints(&neighbours));
    list.extend(shifts::slips(&neighbours).into_iter().map(Entry::into_suit_error));
    list.extend(regions::all(&neighbours).into_iter().map(Entry::into_suit_error));
    list.extend(plate_errors(rows));
    list
}

/// A force, and a spring to an arbitrary point, at every segment.
fn forces(rows: &Rows<'_>) -> Vec<Entry> {
    let mut list = Vec::new();
    for place in Effect::SegmentHeading.places() {
        let Place::Segment(segment) = *place else { continue };
        let name = display_name(segment);
        let at = |block: usize| rows.blocks[block].observation.origin_m[segment.index()];
        let what = format!("a force on the {name}");
        list.push(Entry::of(rows, what, &[GENERIC_FORCE_N; 3], |block| force(rows, block, at(block))));
        let what = format!("a spring attached to the {name}");
        let sigma = [GENERIC_FORCE_N, GENERIC_FORCE_N, GENERIC_FORCE_N, GENERIC_STIFFNESS_N_PER_M];
        list.push(Entry::of(rows, what, &sigma, |block| spring(rows, block, at(block))));
    }
    list
}

/// A force in the world's axes at a point of the body, N, as in the catalogue: its arm is relative to the centre of
/// pressure of the chain, without the offset of the stance, and the vertical force is the measured one.
fn force(rows: &Rows<'_>, block: usize, at_m: [f64; 3]) -> Columns {
    let seen = &rows.blocks[block].observation;
    let height_m = seen.com_m[2] - seen.floor_m;
    let chain_cop_m =
        [0, 1].map(|axis| seen.com_m[axis] - seen.slope[axis] * height_m + seen.turning_m[axis]);
    let [x_m, y_m] = [0, 1].map(|axis| at_m[axis] - chain_cop_m[axis]);
    // Measured shear contains the force as if it acted at the centre of mass.
    let up_m = at_m[2] - if seen.slope_is_measured { seen.com_m[2] } else { seen.floor_m };
    let vertical_n = seen.force_measured_n[2];
    let mut columns = Columns::zero(3);
    columns.cop_m[0] = [up_m / vertical_n, 0.0];
    columns.cop_m[1] = [0.0, up_m / vertical_n];
    columns.cop_m[2] = [-x_m / vertical_n, -y_m / vertical_n];
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

/// Errors of a plate or an insole that the catalogue lacks: hysteresis, and errors that depend on the position.
fn plate_errors(rows: &Rows<'_>) -> Vec<Entry> {
    let [hysteresis_m, speed_s, linear, quadratic_per_m] = COP_MAP;
    let seen = |block: usize| &rows.blocks[block].observation;
    let entry = |what: &str, sigma: &[f64], of: &dyn Fn(usize) -> Columns| {
        Entry::of(rows, what.to_owned(), sigma, of)
    };
    let mut list = vec![
        entry("a hysteresis of the centre of pressure", &[hysteresis_m; 2], &|block| {
            let [x, y] = cop_direction(rows, block);
            pair([x, 0.0], [0.0, y])
        }),
        entry("an error of the centre of pressure proportional to speed", &[speed_s; 2], &|block| {
            let [x, y, _] = rows.blocks[block].com_velocity_m_per_s;
            pair([x, 0.0], [0.0, y])
        }),
        entry("a linear map of the centre of pressure", &[linear; 4], &|block| {
            let [x, y] = seen(block).cop_predicted_m;
            let mut columns = Columns::zero(4);
            (columns.cop_m[0], columns.cop_m[1]) = ([x, 0.0], [y, 0.0]);
            (columns.cop_m[2], columns.cop_m[3]) = ([0.0, x], [0.0, y]);
            columns
        }),
        entry("an error of the vertical force that depends on position", &FORCE_MAP, &|block| {
            let [x, y] = seen(block).cop_predicted_m;
            let force_n = seen(block).force_predicted_n[2];
            let mut columns = Columns::zero(3);
            columns.force_n[0][2] = force_n;
            columns.force_n[1][2] = force_n * x;
            columns.force_n[2][2] = force_n * y;
            columns
        }),
    ];
    for (a, b, what) in [(0, 0, "forward squared"), (0, 1, "forward times left"), (1, 1, "left squared")] {
        let what = format!("a quadratic error of the centre of pressure: {what}");
        list.push(entry(&what, &[quadratic_per_m; 2], &|block| {
            let cop_m = seen(block).cop_predicted_m;
            let square = cop_m[a] * cop_m[b];
            pair([square, 0.0], [0.0, square])
        }));
    }
    list
}

fn pair(x: [f64; 2], y: [f64; 2]) -> Columns {
    let mut columns = Columns::zero(2);
    (columns.cop_m[0], columns.cop_m[1]) = (x, y);
    columns
}

/// Recent direction of motion of the centre of pressure at a block, per axis in \[−1, 1\]: hysteresis depends on it.
fn cop_direction(rows: &Rows<'_>, block: usize) -> [f64; 2] {
    let seen = |block: usize| rows.blocks[block].observation.cop_predicted_m;
    let (blocks, decay, saturation_m) = HYSTERESIS;
    [0, 1].map(|axis| {
        let (mut moved_m, mut weight) = (0.0, 1.0);
        for earlier in (rows.work_from + 1..=block).rev().take(blocks) {
            moved_m += weight * (seen(earlier)[axis] - seen(earlier - 1)[axis]);
            weight *= decay;
        }
        (moved_m / saturation_m).tanh()
    })
}

/// Display name of a segment: "right forearm".
pub(super) fn display_name(segment: Segment) -> String {
    let name = segment.name();
    let mut text = String::new();
    for (index, letter) in name.char_indices() {
        if letter.is_uppercase() && index > 0 && text.len() > 2 {
            text.push(' ');
        }
        text.push(letter.to_ascii_lowercase());
    }
    match segment {
        Segment::T8 => "upper trunk".to_owned(),
        Segment::L5 | Segment::L3 | Segment::T12 => "lower trunk".to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::Side;

    use super::*;
    use crate::candidate::{Candidate, Scope};
    use crate::support::clean;

    #[test]
    fn a_force_acts_as_a_contact_in_the_catalogue() {
        let mut session = clean(5);
        for block in &mut session.blocks {
            let seen = &mut block.observation;
            for (axis, shift_m) in [0.03, -0.02].into_iter().enumerate() {
                seen.cop_predicted_m[axis] += shift_m;
                seen.cop_measured_m[axis] += shift_m;
            }
            seen.force_measured_n[2] += 60.0;
        }
        for is_measured in [true, false] {
            session.blocks.iter_mut().for_each(|block| block.observation.slope_is_measured = is_measured);
            let rows = Rows::of(&session);
            let contact = Candidate::new(Effect::HandContact, Place::Hand(Side::Right), 0.0, Scope::Work);
            for block in rows.work_from..rows.len() {
                let seen = &rows.blocks[block].observation;
                let hand = Side::Right.hand().index();
                let [_, grip_m] = seen.grip_m;
                let grip_m = [0, 1, 2].map(|axis| {
                    let from_origin_m = (0..3).map(|k| seen.rotation[hand][axis][k] * grip_m[k]).sum::<f64>();
                    seen.origin_m[hand][axis] + from_origin_m
                });
                let (of_library, of_catalogue) = (force(&rows, block, grip_m), contact.columns(&rows, block));
                for k in 0..3 {
                    let off_m = |axis: usize| of_library.cop_m[k][axis] - of_catalogue.cop_m[k][axis];
                    assert!((0..2).all(|axis| off_m(axis).abs() < 1e-12), "{of_library:?} {of_catalogue:?}");
                    assert_eq!(of_library.force_n[k], of_catalogue.force_n[k]);
                }
            }
        }
    }
}
