//! Heading errors in a region of the room, caused by iron.

use equipoise_core::body::{Segment, Side};
use equipoise_core::effect::{Effect, Place};

use super::library::{Entry, display_name};
use super::shifts::{Neighbours, Posture};
use crate::constants::{FIELD_M, REGION_CENTRES, REGION_HEADING_RAD, REGION_REACH_M};

/// Every segment on its own, and each arm as a whole.
pub(super) fn all(neighbours: &Neighbours<'_>) -> Vec<Entry> {
    let mut list = Vec::new();
    for place in Effect::SegmentHeading.places() {
        if let Place::Segment(segment) = *place {
            let is_of_an_arm = segment.is_distal_to(Segment::T8) && segment.mirrored() != segment;
            list.extend(of(neighbours, &display_name(segment), &[segment], is_of_an_arm));
        }
    }
    for side in Side::BOTH {
        let arm = if side == Side::Left {
            [Segment::LeftUpperArm, Segment::LeftForearm, Segment::LeftHand]
        } else {
            [Segment::RightUpperArm, Segment::RightForearm, Segment::RightHand]
        };
        let name = if side == Side::Left { "left arm" } else { "right arm" };
        list.extend(of(neighbours, name, &arm, true));
    }
    list
}

/// Some segments, each disturbed at its own position; centres are among the positions of the middle one.
fn of(neighbours: &Neighbours<'_>, name: &str, segments: &[Segment], is_of_an_arm: bool) -> Vec<Entry> {
    let kind = usize::from(!is_of_an_arm);
    let middle = segments[segments.len() / 2];
    let points: Vec<[f64; 3]> = neighbours.work().map(|posture| at(posture, middle)).collect();
    let mut list = Vec::new();
    let (counts, _) = REGION_CENTRES;
    let centres = centres(&points, counts[kind]);
    for &centre in &centres {
        for &reach_m in REGION_REACH_M[kind] {
            let [x, y, z] = centre;
            let what = format!("a heading error of the {name} near ({x:.1}, {y:.1}, {z:.1}) m");
            list.push(neighbours.entry(middle, what, [REGION_HEADING_RAD], |posture| {
                let near =
                    |segment| (-0.5 * apart2(at(posture, segment), centre) / (reach_m * reach_m)).exp();
                [sum(segments
                    .iter()
                    .map(|&segment| posture.rotated_back(segment, [0.0, 0.0, near(segment)])))]
            }));
        }
    }
    if let Some(origin) = mean(&points) {
        let what = format!("a heading error of the {name} that depends on its position");
        list.push(neighbours.entry(middle, what, [REGION_HEADING_RAD; 4], |posture| {
            std::array::from_fn(|k| {
                sum(segments.iter().map(|&segment| {
                    let by = if k == 3 { 1.0 } else { (at(posture, segment)[k] - origin[k]) / FIELD_M };
                    posture.rotated_back(segment, [0.0, 0.0, by])
                }))
            })
        }));
    }
    list
}

fn at(posture: &Posture<'_>, segment: Segment) -> [f64; 3] {
    posture.block.observation.origin_m[segment.index()]
}

/// A few centres among the positions of a point of the body: initially far from each other, then each moved to the
/// middle of its nearest positions.
fn centres(points: &[[f64; 3]], count: usize) -> Vec<[f64; 3]> {
    let mut centres: Vec<[f64; 3]> = Vec::new();
    for _ in 0..count {
        let lonely = |point: &[f64; 3]| centres.iter().map(|&c| apart2(*point, c)).fold(1e9, f64::min);
        let farthest = points.iter().max_by(|a, b| lonely(a).total_cmp(&lonely(b))).copied();
        centres.extend(farthest);
    }
    let (_, iterations) = REGION_CENTRES;
    for _ in 0..iterations {
        let nearest = |point: [f64; 3]| {
            let near =
                |a: &usize, b: &usize| apart2(point, centres[*a]).total_cmp(&apart2(point, centres[*b]));
            (0..centres.len()).min_by(near)
        };
        let owners: Vec<Option<usize>> = points.iter().map(|&point| nearest(point)).collect();
        let middles = (0..centres.len()).map(|centre| {
            let own: Vec<[f64; 3]> = points
                .iter()
                .zip(&owners)
                .filter(|(_, own)| **own == Some(centre))
                .map(|(p, _)| *p)
                .collect();
            mean(&own).unwrap_or(centres[centre])
        });
        centres = middles.collect();
    }
    centres
}

fn mean(points: &[[f64; 3]]) -> Option<[f64; 3]> {
    let all = sum(points.iter().copied());
    (!points.is_empty()).then(|| all.map(|sum| sum / points.len() as f64))
}

fn sum(vectors: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    vectors.fold([0.0; 3], |sum, vector| [0, 1, 2].map(|k| sum[k] + vector[k]))
}

fn apart2(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum()
}
