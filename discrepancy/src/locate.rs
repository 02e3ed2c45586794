//! Discrepancies beyond noise: time spans, signal, static or moving, and the segment whose orientation correlates with
//! them.

use equipoise_core::body::{SEGMENTS, Segment};
use equipoise_core::effect::Observation;

use crate::constants::{GOES_WITH, SPAN_PIECES, SPANS_MAX, STATIC_OR_MOVING, SUSPICIOUS};
use crate::finding::Suspicion;
use crate::floor::{Floor, root_mean};
use crate::gram::Gram;
use crate::picture::Signal;

/// All suspicious spans, worst first.
pub(crate) fn locate(gram: &Gram<'_>, floor: &Floor, residual: &[[f64; 3]]) -> Vec<Suspicion> {
    let rows = gram.rows;
    let (pieces, blocks_min) = SPAN_PIECES;
    let length = residual.len().div_ceil(pieces).max(blocks_min);
    let mut spans: Vec<Suspicion> = Vec::new();
    for axis in 0..3 {
        let over = |block: usize| residual[block][axis] / floor.sigma[block][axis].max(1e-9);
        let pieces: Vec<Vec<usize>> =
            (0..residual.len()).collect::<Vec<_>>().chunks(length).map(<[usize]>::to_vec).collect();
        let times = |blocks: &[usize]| root_mean(blocks.iter().map(|&block| over(block).powi(2)));
        for run in pieces.chunk_by(|a, b| (times(a) > SUSPICIOUS) == (times(b) > SUSPICIOUS)) {
            let blocks: Vec<usize> = run.concat();
            if times(&blocks) <= SUSPICIOUS {
                continue;
            }
            let half_s = 0.5 * rows.session.block_s;
            let time_s = |block: usize| rows.time_s(rows.work_from + block);
            spans.push(Suspicion {
                from_s: time_s(blocks[0]) - half_s,
                to_s: time_s(blocks[blocks.len() - 1]) + half_s,
                signal: Signal::ALL[axis].name().to_owned(),
                while_: pose_state(gram, &blocks, &over).to_owned(),
                segment: segment(gram, &blocks, &over),
                times_noise: times(&blocks),
            });
        }
    }
    spans.sort_by(|a, b| b.times_noise.total_cmp(&a.times_noise));
    spans.truncate(SPANS_MAX);
    spans
}

/// `still`, `moving`, or `both` where neither is much worse.
fn pose_state(gram: &Gram<'_>, blocks: &[usize], over: &dyn Fn(usize) -> f64) -> &'static str {
    let of = |still: bool| {
        let some =
            blocks.iter().filter(move |&&block| gram.rows.blocks[gram.rows.work_from + block].still == still);
        root_mean(some.map(|&block| over(block).powi(2)))
    };
    match (of(true), of(false)) {
        (still, moving) if still > STATIC_OR_MOVING * moving => "still",
        (still, moving) if moving > STATIC_OR_MOVING * still => "moving",
        _ => "both",
    }
}

/// The segment whose direction in space explains most of the residual's change, if the fraction suffices.
fn segment(gram: &Gram<'_>, blocks: &[usize], over: &dyn Fn(usize) -> f64) -> Option<String> {
    let rows = gram.rows;
    let mean =
        |of: &dyn Fn(usize) -> f64| blocks.iter().map(|&block| of(block)).sum::<f64>() / blocks.len() as f64;
    let middle = mean(over);
    let variance = mean(&|block| (over(block) - middle).powi(2));
    let explained = |segment: usize| {
        (0..3)
            .map(|axis| {
                let feature = |block: usize| {
                    com_contribution_m(&rows.blocks[rows.work_from + block].observation, segment, axis)
                };
                let centre = mean(&feature);
                let spread = mean(&|block| (feature(block) - centre).powi(2));
                let shared = mean(&|block| (feature(block) - centre) * (over(block) - middle));
                if spread > 1e-8 && variance > 1e-9 { shared * shared / (spread * variance) } else { 0.0 }
            })
            .fold(0.0, f64::max)
    };
    let best =
        (0..SEGMENTS).map(|segment| (explained(segment), segment)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let (explained_min, blocks_min) = GOES_WITH;
    (best.0 > explained_min && blocks.len() > blocks_min).then(|| Segment::ALL[best.1].name().to_owned())
}

/// A segment's contribution to the centre of mass on one axis of the world, m.
fn com_contribution_m(seen: &Observation, segment: usize, axis: usize) -> f64 {
    (0..3).map(|k| seen.rotation[segment][axis][k] * seen.phi_m[segment][k]).sum()
}
