//! Duration of the torques of 22 joints, compared with Eq. 15 with its Jacobians written out.
//!
//! The dense version computes no σ; the core's does. `cargo bench -p equipoise-benches --bench overload`; figures in
//! `docs/realtime.md`.

use std::hint::black_box;

use equipoise_benches::dense;
use equipoise_benches::rounds::{Contender, compare};
use equipoise_benches::worker::Worker;
use equipoise_core::body::JOINTS;
use equipoise_core::overload::torques;

const POSES: usize = 50;

fn main() {
    let worker = Worker::new();
    let poses: Vec<_> = (0..POSES).map(|index| worker.pose(index)).collect();
    let loaded: Vec<_> = poses.iter().map(|pose| (pose, worker.loading(pose))).collect();
    for (pose, (loading, sigma)) in &loaded {
        for (ours, dense) in torques(pose, loading, sigma).iter().zip(dense::torques(pose, loading)) {
            assert!((ours.torque_nm - dense).norm() < 1e-9, "{} is not {dense}", ours.torque_nm);
        }
    }
    let (mut feed, mut dense_feed) = (loaded.iter().cycle(), loaded.iter().cycle());
    let mut contenders = [
        Contender::new("core::overload, with σ", || {
            feed.by_ref().take(1).for_each(|(pose, (loading, sigma))| {
                black_box(torques(pose, loading, sigma));
            });
        }),
        Contender::new("nalgebra, six Jacobians 3×66, no σ", || {
            dense_feed.by_ref().take(1).for_each(|(pose, (loading, _))| {
                black_box(dense::torques(pose, loading));
            });
        }),
    ];
    let mut criterion = equipoise_benches::criterion();
    let medians_us = compare(&mut criterion, "overload 22 joints", &mut contenders);
    if let Some(ours_us) = medians_us.first() {
        // An average, not the cost of one additional joint: the body always has all of them.
        println!("{:.0} ns a joint: the whole divided by {JOINTS}\n", 1e3 * ours_us / JOINTS as f64);
    }
    criterion.final_summary();
}
