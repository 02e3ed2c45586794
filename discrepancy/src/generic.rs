//! What nothing in the catalogue explains, in words of the body: a library of generic terms, searched sparsely by the same
//! evidence.

use equipoise_core::body::{Segment, Side};
use equipoise_core::effect::{Columns, Effect, Place};

use crate::finding::Generic;
use crate::gram::{Gram, direction, score};
use crate::noise::kernels::norm;
use crate::rows::Rows;
use crate::select::Selection;

/// Most generic terms that are told.
const TOLD_MAX: usize = 3;

/// What a generic term must gain beyond the threshold, in log odds, for there being so many; clean sessions stay below.
const SEARCHED: f64 = 2.0;

/// What the library says.
#[derive(Debug, Clone, Default)]
pub(crate) struct Generics {
    /// Terms that explain what the catalogue leaves, best first.
    pub(crate) after: Vec<Generic>,
    /// Log Bayes factor of as many generic terms as effects were named (at least one) without the catalogue.
    pub(crate) alone: f64,
    /// Log Bayes factor of the best single term that is unlike everything in the catalogue, without the catalogue.
    pub(crate) unlike: f64,
}

/// A term of the library.
struct Entry {
    what: String,
    /// Whether nothing in the catalogue is a part of it.
    is_unlike: bool,
    columns: Vec<Vec<f64>>,
    sigma: Vec<f64>,
}

/// Searches the library.
pub(crate) fn look(gram: &Gram<'_>, selection: &Selection, threshold: f64) -> Generics {
    let owned = library(gram);
    let library: Vec<&Entry> = owned.iter().collect();
    let least = threshold + SEARCHED;
    let terms = selection.terms();
    let alone = greedy(gram, &library, &[], least, terms.len().max(1));
    let after = greedy(gram, &library, &terms, least, TOLD_MAX);
    let unlike: Vec<&Entry> = library.iter().copied().filter(|entry| entry.is_unlike).collect();
    let unlike = greedy(gram, &unlike, &[], least, 1).first().map_or(0.0, |generic| generic.log_odds);
    Generics { after, unlike, alone: alone.iter().map(|generic| generic.log_odds).sum() }
}

fn greedy(gram: &Gram<'_>, library: &[&Entry], accepted: &[usize], least: f64, most: usize) -> Vec<Generic> {
    let (mut directions, residual) = if accepted.is_empty() {
        (Vec::new(), gram.residual.clone())
    } else {
        gram.directions_given(accepted)
    };
    let mut found = Vec::new();
    while found.len() < most {
        let best = library
            .iter()
            .map(|&entry| {
                let mean = vec![0.0; entry.sigma.len()];
                (score(&entry.columns, &directions, &residual, &mean, &entry.sigma), entry)
            })
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((log_odds, entry)) = best.filter(|(log_odds, _)| *log_odds > least) else { break };
        found.push(Generic { what: entry.what.clone(), log_odds });
        for (column, &sigma) in entry.columns.iter().zip(&entry.sigma) {
            directions.push(direction(column, sigma, &directions));
        }
    }
    found
}

/// All generic terms, in the work.
fn library(gram: &Gram<'_>) -> Vec<Entry> {
    let mut list = Vec::new();
    for place in Effect::SegmentHeading.places() {
        if let Place::Segment(segment) = *place {
            list.extend(of_segment(gram, segment));
        }
    }
    list.extend(of_joints(gram));
    list.extend(of_plate(gram));
    list
}

/// Joints that leave their place as they bend: a suit's bones meet in points, a body's glide.
fn of_joints(gram: &Gram<'_>) -> Vec<Entry> {
    let rows = gram.rows;
    let mut list = Vec::new();
    let seen = |block: usize| &rows.blocks[block].observation;
    for side in Side::BOTH {
        let (upper, fore) = if side == Side::Left {
            (Segment::LeftUpperArm, Segment::LeftForearm)
        } else {
            (Segment::RightUpperArm, Segment::RightForearm)
        };
        let what = format!("the {} leaves its joint as the arm is raised", words(upper));
        list.push(entry(gram, what, &[0.002; 3], |block| {
            let origin_m = &seen(block).origin_m;
            let trunk = &seen(block).rotation[Segment::T8.index()];
            let along = [0, 1, 2].map(|k| origin_m[fore.index()][k] - origin_m[upper.index()][k]);
            let up: f64 = (0..3).map(|k| trunk[k][2] * along[k]).sum::<f64>() / norm(along).max(0.05);
            shifted(rows, block, trunk, 1.0 + up)
        }));
    }
    list.push(entry(
        gram,
        "the spine bends elsewhere than the suit thinks".to_owned(),
        &[0.01; 3],
        |block| {
            let bend: f64 = [Segment::L5, Segment::L3, Segment::T12, Segment::T8]
                .iter()
                .map(|segment| rows.blocks[block].joint_rad[segment.index()][1])
                .sum();
            shifted(rows, block, &seen(block).rotation[Segment::Pelvis.index()], bend)
        },
    ));
    list
}

/// The centre of mass is moved along the axes of a segment by so much per metre.
fn shifted(rows: &Rows<'_>, block: usize, rotation: &[[f64; 3]; 3], size: f64) -> Columns {
    let mut columns = Columns::zero(3);
    for (axis, cop_m) in columns.cop_m.iter_mut().enumerate().take(3) {
        *cop_m = rows.on_cop(block, rotation.map(|row| size * row[axis]));
    }
    columns
}

fn entry(gram: &Gram<'_>, what: String, sigma: &[f64], of: impl Fn(usize) -> Columns) -> Entry {
    let from = gram.rows.work_from;
    let count = sigma.len();
    let columns = gram.whitened(count, |block| if block < from { Columns::zero(count) } else { of(block) });
    Entry { what, is_unlike: true, columns, sigma: sigma.to_vec() }
}

fn of_segment(gram: &Gram<'_>, segment: Segment) -> Vec<Entry> {
    let rows = gram.rows;
    let name = words(segment);
    let at = |block: usize| rows.blocks[block].observation.origin_m[segment.index()];
    let mut list = vec![
        entry(gram, format!("a force on the {name}"), &[30.0; 3], |block| force(rows, block, at(block))),
        entry(gram, format!("a spring that pulls at the {name}"), &[30.0, 30.0, 30.0, 60.0], |block| {
            spring(rows, block, at(block))
        }),
        entry(gram, format!("heading of the {name}, growing with time"), &[0.1], |block| {
            let minutes = (rows.time_s(block) - rows.session.spans_s.work[0]) / 60.0;
            turned(rows, block, segment, [[0.0, 0.0, minutes]].as_slice())
        }),
    ];
    list[..2].iter_mut().for_each(|entry| entry.is_unlike = false);
    for (joint, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let what = format!("the sensor on the {name} slips as its joint turns about {axis}");
        list.push(entry(gram, what, &[0.15; 3], |block| {
            let size = rows.blocks[block].joint_rad[segment.index()][joint];
            let rotation = &rows.blocks[block].observation.rotation[segment.index()];
            let turns: Vec<[f64; 3]> =
                (0..3).map(|along| [0, 1, 2].map(|k| rotation[k][along] * size)).collect();
            turned(rows, block, segment, &turns)
        }));
    }
    list.extend(slips(gram, segment, &name));
    list.extend(near_places(gram, segment));
    list
}

/// A sensor that follows only part of its joint's turn, and one that turns aside the more the joint is bent.
fn slips(gram: &Gram<'_>, segment: Segment, name: &str) -> Vec<Entry> {
    let rows = gram.rows;
    let bent = |block: usize| rows.blocks[block].joint_rad[segment.index()];
    let axes = |block: usize| rows.blocks[block].observation.rotation[segment.index()];
    let lags = format!("the sensor on the {name} follows its joint only in part");
    let aside = format!("the sensor on the {name} slips the more its joint is bent");
    vec![
        entry(gram, lags, &[0.15], |block| {
            let turn = axes(block).map(|row| (0..3).map(|k| row[k] * bent(block)[k]).sum());
            turned(rows, block, segment, &[turn])
        }),
        entry(gram, aside, &[0.15; 3], |block| {
            let size = norm(bent(block));
            let turns: Vec<[f64; 3]> = (0..3).map(|along| axes(block).map(|row| row[along] * size)).collect();
            turned(rows, block, segment, &turns)
        }),
    ]
}

/// Headings that go wrong where a hand is: iron.
fn near_places(gram: &Gram<'_>, segment: Segment) -> Vec<Entry> {
    let rows = gram.rows;
    let mut list = Vec::new();
    for side in Side::BOTH {
        if segment.mirrored() != segment && !is_on(segment, side) {
            continue;
        }
        let at = |block: usize| rows.blocks[block].observation.origin_m[side.hand().index()];
        for centre in centres(rows, &at) {
            let [x, y, z] = centre;
            let what = format!(
                "heading of the {}, while the {} is near ({x:.1}, {y:.1}, {z:.1}) m",
                words(segment),
                words(side.hand())
            );
            list.push(entry(gram, what, &[0.4], |block| {
                let hand = at(block);
                let apart2: f64 = (0..3).map(|k| (hand[k] - centre[k]).powi(2)).sum();
                let near = (-apart2 / (2.0 * 0.25 * 0.25)).exp();
                turned(rows, block, segment, &[[0.0, 0.0, near]])
            }));
        }
    }
    list
}

fn of_plate(gram: &Gram<'_>) -> Vec<Entry> {
    let rows = gram.rows;
    let pair = |x: [f64; 2], y: [f64; 2]| {
        let mut columns = Columns::zero(2);
        (columns.cop_m[0], columns.cop_m[1]) = (x, y);
        columns
    };
    let seen = |block: usize| &rows.blocks[block].observation;
    let mut list = vec![
        entry(gram, "the centre of pressure hangs back behind its motion".to_owned(), &[0.01; 2], |block| {
            let [x, y] = cop_way(rows, block);
            pair([x, 0.0], [0.0, y])
        }),
        entry(
            gram,
            "the centre of pressure is off in proportion to the body's speed".to_owned(),
            &[0.02; 2],
            |block| {
                let [x, y, _] = rows.blocks[block].com_velocity_m_per_s;
                pair([x, 0.0], [0.0, y])
            },
        ),
        entry(gram, "the centre of pressure goes through a linear map".to_owned(), &[0.05; 4], |block| {
            let [x, y] = seen(block).cop_predicted_m;
            let mut columns = Columns::zero(4);
            (columns.cop_m[0], columns.cop_m[1]) = ([x, 0.0], [y, 0.0]);
            (columns.cop_m[2], columns.cop_m[3]) = ([0.0, x], [0.0, y]);
            columns
        }),
        entry(
            gram,
            "the vertical force depends on where the person stands".to_owned(),
            &[0.01, 0.1, 0.1],
            |block| {
                let [x, y] = seen(block).cop_predicted_m;
                let force_n = seen(block).force_predicted_n[2];
                let mut columns = Columns::zero(3);
                columns.force_n[0][2] = force_n;
                columns.force_n[1][2] = force_n * x;
                columns.force_n[2][2] = force_n * y;
                columns
            },
        ),
    ];
    list[1..].iter_mut().for_each(|entry| entry.is_unlike = false);
    for (a, b, what) in [(0, 0, "forward squared"), (0, 1, "forward times left"), (1, 1, "left squared")] {
        let what = format!("the centre of pressure is bent: {what}");
        list.push(entry(gram, what, &[0.5; 2], |block| {
            let cop_m = seen(block).cop_predicted_m;
            let square = cop_m[a] * cop_m[b];
            pair([square, 0.0], [0.0, square])
        }));
    }
    list
}

/// Which way the centre of pressure has come to a block, per axis in \[−1, 1\]: what hangs back depends on it.
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

/// A force and a stiffness, N/m, towards the world's origin: together a spring that ends anywhere.
fn spring(rows: &Rows<'_>, block: usize, at_m: [f64; 3]) -> Columns {
    let mut columns = force(rows, block, at_m);
    columns.count = 4;
    let (cop_m, force_n) = columns.times(&[-at_m[0], -at_m[1], -at_m[2], 0.0]);
    (columns.cop_m[3], columns.force_n[3]) = (cop_m, force_n);
    columns
}

/// A segment seen turned by vectors in the world's axes, rad per unit: undone.
fn turned(rows: &Rows<'_>, block: usize, segment: Segment, turns: &[[f64; 3]]) -> Columns {
    let mut columns = Columns::zero(turns.len());
    for (k, &turn) in turns.iter().enumerate() {
        (columns.cop_m[k], columns.force_n[k]) = rows.turned_by(block, segment.index(), turn);
    }
    columns
}

/// Half a dozen places where a point of the body was, far from each other.
fn centres(rows: &Rows<'_>, at: &dyn Fn(usize) -> [f64; 3]) -> Vec<[f64; 3]> {
    let apart2 = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>();
    let mut centres: Vec<[f64; 3]> = Vec::new();
    for _ in 0..8 {
        let farthest = (rows.work_from..rows.len()).map(at).max_by(|&a, &b| {
            let near = |p| centres.iter().map(|&c| apart2(p, c)).fold(1e9, f64::min);
            near(a).total_cmp(&near(b))
        });
        let Some(farthest) = farthest else { break };
        centres.push(farthest);
    }
    centres
}

fn is_on(segment: Segment, side: Side) -> bool {
    segment.name().starts_with(if side == Side::Left { "Left" } else { "Right" })
}

/// A segment for people: "right forearm".
pub(crate) fn words(segment: Segment) -> String {
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
