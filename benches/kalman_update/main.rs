//! Duration of the filter's update with one pose, two rows, compared with the two dense textbook forms.
//!
//! `cargo bench -p equipoise-benches --bench kalman_update`; figures in `docs/realtime.md`.

use std::hint::black_box;

use bytemuck::Zeroable;
use equipoise_benches::dense::DenseFilter;
use equipoise_benches::rounds::{Contender, compare};
use equipoise_benches::worker::Worker;
use equipoise_core::kalman::{Filter, STATES};
use equipoise_core::sesc::Phi;
use equipoise_core::sesc::{PARAMETERS, Prior, Reduction, ReductionKind};
use nalgebra::{SMatrix, Vector2};

const POSES: usize = 50;
/// Keeps the covariance at its initial size, so that the millionth update has the same numbers as the first, m².
const PROCESS_M2: f64 = 1e-4;
const R_M2: f64 = 5e-5;

/// Two rows of a pose, and the measurement along them, m.
struct Measurement {
    h: [[f64; STATES]; 2],
    z_m: [f64; 2],
}

fn measurements<const N: usize>() -> Vec<Measurement> {
    let worker = Worker::new();
    let reduction = Reduction::new(ReductionKind::Full, &Phi::of(&worker.skeleton, &worker.body));
    let measurement = |index| {
        let rows = reduction.rows(&worker.pose(index), [0.0; 2]).h;
        let h = rows.map(|row| core::array::from_fn(|at| if at < N { row[at] } else { 0.0 }));
        Measurement { h, z_m: [0.02, -0.01] }
    };
    (0..POSES).map(measurement).collect()
}

fn filter<const N: usize>() -> Box<Filter> {
    let mut prior = Prior { theta_m: [0.0; PARAMETERS], covariance_m2: [[0.0; PARAMETERS]; PARAMETERS] };
    for index in 0..N {
        prior.covariance_m2[index][index] = 0.01;
    }
    let mut filter = Box::new(Filter::zeroed());
    filter.reset(N, &prior);
    filter
}

fn update(filter: &mut Filter, measurement: &Measurement) {
    filter.predict(PROCESS_M2);
    for (h, z_m) in measurement.h.iter().zip(measurement.z_m) {
        black_box(filter.update(h, z_m, R_M2));
    }
}

type Dense<const N: usize> = (SMatrix<f64, 2, N>, Vector2<f64>);

fn dense<const N: usize>(measurement: &Measurement) -> Dense<N> {
    (SMatrix::from_fn(|row, column| measurement.h[row][column]), measurement.z_m.into())
}

/// Ratios are meaningful only if all variants do the same work.
fn check_agreement<const N: usize>(measurements: &[Measurement]) {
    let (mut ours, mut joseph) = (filter::<N>(), Box::new(DenseFilter::<N>::new(0.01)));
    let mut gain_form = joseph.clone();
    for measurement in measurements {
        let (h, z_m) = dense::<N>(measurement);
        update(&mut ours, measurement);
        joseph.predict(PROCESS_M2);
        joseph.update_joseph(&h, &z_m, R_M2);
        gain_form.predict(PROCESS_M2);
        gain_form.update_gain_form(&h, &z_m, R_M2);
    }
    for row in 0..N {
        for (column, value) in ours.covariance_row_m2(row).iter().enumerate() {
            for other in [&joseph, &gain_form] {
                assert!((value - other.covariance_m2[(row, column)]).abs() < 1e-11, "({row}, {column})");
            }
        }
        assert!((ours.theta_m()[row] - joseph.theta_m[row]).abs() < 1e-11, "θ {row}");
    }
}

fn bench<const N: usize>(criterion: &mut criterion::Criterion) {
    let measurements = measurements::<N>();
    check_agreement::<N>(&measurements);
    let rows: Vec<Dense<N>> = measurements.iter().map(dense).collect();
    let (mut ours, mut joseph) = (filter::<N>(), Box::new(DenseFilter::<N>::new(0.01)));
    let mut gain_form = joseph.clone();
    let (mut sparse_feed, mut joseph_feed, mut gain_feed) =
        (measurements.iter().cycle(), rows.iter().cycle(), rows.iter().cycle());
    let mut contenders = [
        Contender::new("core::kalman, two scalar updates", || {
            sparse_feed.by_ref().take(1).for_each(|measurement| update(&mut ours, measurement));
        }),
        Contender::new("nalgebra, dense Joseph", || {
            joseph_feed.by_ref().take(1).for_each(|(h, z_m)| {
                joseph.predict(PROCESS_M2);
                joseph.update_joseph(h, z_m, R_M2);
            });
        }),
        Contender::new("nalgebra, P -= K (P Hᵀ)ᵀ", || {
            gain_feed.by_ref().take(1).for_each(|(h, z_m)| {
                gain_form.predict(PROCESS_M2);
                gain_form.update_gain_form(h, z_m, R_M2);
            });
        }),
    ];
    compare(criterion, &format!("kalman update 2×{N}"), &mut contenders);
}

fn main() {
    let mut criterion = equipoise_benches::criterion();
    bench::<PARAMETERS>(&mut criterion);
    bench::<18>(&mut criterion);
    criterion.final_summary();
}
