//! Cost for the loop of saving, twice a second, the state that must survive it, compared with a copy of its whole
//! memory.
//!
//! With warm caches, and with caches filled by other work, as in the loop. `cargo bench -p equipoise-benches --bench
//! keep`; figures in `docs/realtime.md`.

use std::hint::black_box;
use std::time::Instant;

use equipoise_benches::rounds::{Contender, compare, quantile};
use equipoise_benches::worker::{HEIGHT_M, Worker};
use equipoise_core::cycle::{Checkpoint, Memory, Settings, StoredState};
use equipoise_core::frame::{Pose, SuitWorld};
use equipoise_core::pose_suggestion::Performed;
use equipoise_core::sesc::PARAMETERS;

/// Larger than any cache, bytes.
const OTHER_WORK: usize = 128 << 20;
const COLD_ROUNDS: usize = 200;
/// As many as in a long identification.
const POSES: u64 = 25;

/// A memory with a body and used poses.
fn memory() -> Box<Memory> {
    let settings = Settings::for_height(HEIGHT_M);
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&settings);
    let pose = Worker::new().pose(0);
    let pose: Pose<SuitWorld> = Pose::new(pose.origin, pose.world_from_segment);
    while !memory.identification.has_body() {
        memory.identification.update_skeleton(&pose, &settings);
    }
    let mut kept = bytemuck::zeroed_box();
    memory.identification.store(&mut kept);
    kept.performed = Performed::of(POSES, (0..POSES).map(|pose| [0.1 * pose as f64; PARAMETERS]));
    assert!(memory.identification.restore(&kept, &settings), "a worker that fits");
    memory
}

fn cold_us(other: &mut [u8], mut run: impl FnMut()) -> Vec<f64> {
    let mut times = Vec::new();
    for round in 0..COLD_ROUNDS {
        other.iter_mut().step_by(64).for_each(|byte| *byte = round as u8);
        black_box(&mut *other);
        let begun = Instant::now();
        run();
        times.push(begun.elapsed().as_secs_f64() * 1e6);
    }
    times.sort_by(f64::total_cmp);
    times
}

fn main() {
    let mut criterion = equipoise_benches::criterion();
    let (memory, settings) = (memory(), Settings::for_height(HEIGHT_M));
    let (mut kept, mut checkpoint) =
        (bytemuck::zeroed_box::<StoredState>(), bytemuck::zeroed_box::<Checkpoint>());
    let mut contenders = [
        Contender::new("StoredState::copy_from", || {
            black_box(&mut kept).copy_from(black_box(&memory), &settings);
        }),
        Contender::new("Checkpoint::take", || black_box(&mut checkpoint).take(1, black_box(&memory))),
    ];
    let medians_us = compare(&mut criterion, "copy what survives", &mut contenders);
    if let [kept_us, checkpoint_us] = medians_us[..] {
        println!("copy of what is kept ÷ whole checkpoint: {:.3}", kept_us / checkpoint_us);
    }
    drop(contenders);
    criterion.final_summary();
    if !equipoise_benches::is_measured() {
        return;
    }
    let mut other = vec![0; OTHER_WORK];
    let cold = [
        (
            "StoredState::copy_from",
            cold_us(&mut other, || black_box(&mut kept).copy_from(black_box(&memory), &settings)),
        ),
        ("Checkpoint::take", cold_us(&mut other, || black_box(&mut checkpoint).take(1, black_box(&memory)))),
    ];
    println!(
        "cold caches: {COLD_ROUNDS} times each; {} and {} bytes",
        size_of::<StoredState>(),
        size_of::<Checkpoint>()
    );
    for (name, times) in cold {
        println!("{name:<38} p50 {:>7.1} µs   p99 {:>7.1} µs", quantile(&times, 0.5), quantile(&times, 0.99));
    }
}
