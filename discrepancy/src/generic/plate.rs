//! Generic effects of a plate or an insole that the catalogue lacks.

use equipoise_core::effect::Columns;

use super::library::Entry;
use crate::rows::Rows;

/// Hysteresis, and position-dependent errors of the centre of pressure.
pub(super) fn all(rows: &Rows<'_>) -> Vec<Entry> {
    let seen = |block: usize| &rows.blocks[block].observation;
    let entry = |what: &str, sigma: &[f64], of: &dyn Fn(usize) -> Columns| {
        Entry::of(rows, what.to_owned(), sigma, of)
    };
    let mut list = vec![
        entry("the centre of pressure lags behind its own motion", &[0.01; 2], &|block| {
            let [x, y] = cop_way(rows, block);
            pair([x, 0.0], [0.0, y])
        }),
        entry("the centre of pressure is off in proportion to the body's speed", &[0.02; 2], &|block| {
            let [x, y, _] = rows.blocks[block].com_velocity_m_per_s;
            pair([x, 0.0], [0.0, y])
        })
        .like_the_catalogue(),
        entry("the centre of pressure goes through a linear map", &[0.05; 4], &|block| {
            let [x, y] = seen(block).cop_predicted_m;
            let mut columns = Columns::zero(4);
            (columns.cop_m[0], columns.cop_m[1]) = ([x, 0.0], [y, 0.0]);
            (columns.cop_m[2], columns.cop_m[3]) = ([0.0, x], [0.0, y]);
            columns
        })
        .like_the_catalogue(),
        entry("the vertical force depends on where the person stands", &[0.01, 0.1, 0.1], &|block| {
            let [x, y] = seen(block).cop_predicted_m;
            let force_n = seen(block).force_predicted_n[2];
            let mut columns = Columns::zero(3);
            columns.force_n[0][2] = force_n;
            columns.force_n[1][2] = force_n * x;
            columns.force_n[2][2] = force_n * y;
            columns
        })
        .like_the_catalogue(),
    ];
    for (a, b, what) in [(0, 0, "forward squared"), (0, 1, "forward times left"), (1, 1, "left squared")] {
        let what = format!("the centre of pressure is bent: {what}");
        list.push(entry(&what, &[0.5; 2], &|block| {
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
fn cop_way(rows: &Rows<'_>, block: usize) -> [f64; 2] {
    let seen = |block: usize| rows.blocks[block].observation.cop_predicted_m;
    let mut way = [0.0; 2];
    for (axis, way) in way.iter_mut().enumerate() {
        let (mut moved, mut age) = (0.0, 1.0);
        for earlier in (rows.work_from + 1..=block).rev().take(12) {
            moved += age * (seen(earlier)[axis] - seen(earlier - 1)[axis]);
            age *= 0.75;
        }
        *way = (moved / 0.01).tanh();
    }
    way
}
