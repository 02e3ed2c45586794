use super::*;
use nalgebra::{SMatrix, SVector};

const N: usize = 7;

/// A small generator without a crate: xorshift mapped to (−1, 1).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn row(&mut self) -> [f64; STATES] {
        let mut row = [0.0; STATES];
        row[..N].fill_with(|| self.next());
        row
    }
}

fn unsure_filter() -> Filter {
    let mut prior = Prior { theta_m: [0.0; PARAMETERS], covariance_m2: [[0.0; PARAMETERS]; PARAMETERS] };
    for index in 0..N {
        prior.covariance_m2[index][index] = 1.0 + index as f64;
    }
    let mut filter: Filter = Zeroable::zeroed();
    filter.reset(N, &prior);
    filter
}

/// Bierman's UD update (G. J. Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, ch. V):
/// another algorithm for the same result, which cannot lose positive definiteness.
struct UdFilter {
    theta: SVector<f64, N>,
    u: SMatrix<f64, N, N>,
    d: SVector<f64, N>,
}

impl UdFilter {
    fn update(&mut self, h: &SVector<f64, N>, z: f64, r: f64) {
        let residual = z - h.dot(&self.theta);
        let f = self.u.transpose() * h;
        let v = self.d.component_mul(&f);
        let mut gain = SVector::<f64, N>::zeros();
        let mut alpha = r;
        for j in 0..N {
            let before = alpha;
            alpha += f[j] * v[j];
            let lambda = -f[j] / before;
            self.d[j] *= before / alpha;
            for i in 0..j {
                let old = self.u[(i, j)];
                self.u[(i, j)] = old + lambda * gain[i];
                gain[i] += old * v[j];
            }
            gain[j] = v[j];
        }
        self.theta += gain * (residual / alpha);
    }
}

#[test]
fn joseph_and_bierman_agree() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(7));
    let mut ud = UdFilter {
        theta: SVector::zeros(),
        u: SMatrix::identity(),
        d: SVector::from_fn(|index, _| 1.0 + index as f64),
    };
    for _ in 0..200 {
        let (h, z) = (noise.row(), noise.next());
        filter.update(&h, z, 0.01).unwrap();
        ud.update(&SVector::from_fn(|index, _| h[index]), z, 0.01);
    }
    let p = ud.u * SMatrix::from_diagonal(&ud.d) * ud.u.transpose();
    for row in 0..N {
        assert!((filter.theta_m()[row] - ud.theta[row]).abs() < 1e-10);
        for column in 0..N {
            assert!((filter.covariance_m2[row][column] - p[(row, column)]).abs() < 1e-10);
        }
    }
}

#[test]
fn many_updates_are_one_least_squares_problem() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(11));
    let mut information =
        SMatrix::<f64, N, N>::from_fn(|i, j| if i == j { 1.0 / (1.0 + i as f64) } else { 0.0 });
    let mut right = SVector::<f64, N>::zeros();
    for _ in 0..50 {
        let (h, z) = (noise.row(), noise.next());
        filter.update(&h, z, 0.2).unwrap();
        let h = SVector::<f64, N>::from_fn(|index, _| h[index]);
        information += h * h.transpose() / 0.2;
        right += h * (z / 0.2);
    }
    let covariance = information.try_inverse().unwrap();
    let theta = covariance * right;
    for row in 0..N {
        assert!((filter.theta_m()[row] - theta[row]).abs() < 1e-10);
        assert!((filter.variance_m2(row) - covariance[(row, row)]).abs() < 1e-10);
    }
}

#[test]
fn the_covariance_stays_symmetric_and_positive_over_a_million_sharp_updates() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(3));
    for _ in 0..1_000_000 {
        let h = noise.row();
        filter.update(&h, 0.0, 1e-9).unwrap();
    }
    assert!(filter.is_sound());
    for row in 0..N {
        assert!(filter.variance_m2(row) > 0.0);
        for column in 0..N {
            assert_eq!(filter.covariance_m2[row][column], filter.covariance_m2[column][row]);
        }
    }
}

#[test]
fn a_bad_measurement_changes_nothing() {
    let mut filter = unsure_filter();
    let before = filter.theta_m;
    let h = Noise(5).row();
    assert_eq!(filter.update(&h, f64::NAN, 0.1), None);
    assert_eq!(filter.update(&h, 1.0, 0.0), None);
    assert_eq!(filter.update(&[f64::INFINITY; STATES], 1.0, 0.1), None);
    assert_eq!(filter.theta_m, before);
}

#[test]
fn innovations_of_a_true_model_have_their_predicted_variance() {
    let mut noise = Noise(17);
    let truth: [f64; N] = core::array::from_fn(|_| noise.next());
    let (mut filter, mut sum) = (unsure_filter(), 0.0);
    let poses = 4000;
    for _ in 0..poses {
        let h = noise.row();
        // Uniform noise on (−1, 1) has the variance 1/3.
        let z = h.iter().zip(truth).map(|(h, truth)| h * truth).sum::<f64>() + noise.next();
        sum += filter.update(&h, z, 1.0 / 3.0).unwrap().normalised_square();
    }
    let mean_nis = sum / f64::from(poses);
    assert!((0.9..1.1).contains(&mean_nis), "{mean_nis}");
}

/// Whether the Cholesky factor exists.
fn is_positive_definite(filter: &Filter) -> bool {
    SMatrix::<f64, N, N>::from_fn(|row, column| filter.covariance_m2[row][column]).cholesky().is_some()
}

#[test]
fn badly_scaled_measurements_leave_the_covariance_positive_definite() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(23));
    let mut ud = UdFilter {
        theta: SVector::zeros(),
        u: SMatrix::identity(),
        d: SVector::from_fn(|index, _| 1.0 + index as f64),
    };
    // Eight decades of row lengths, six of parameter scales within a row, eight of variances.
    for round in 0..10_000 {
        let mut h = noise.row();
        let length = 10f64.powf(4.0 * noise.next());
        for value in &mut h[..N] {
            *value *= length * 10f64.powf(3.0 * noise.next());
        }
        let (z, r_m2) = (noise.next() * length, 10f64.powf(4.0 * noise.next()));
        filter.update(&h, z, r_m2).unwrap();
        ud.update(&SVector::from_fn(|index, _| h[index]), z, r_m2);
        assert!(is_positive_definite(&filter), "round {round}");
    }
    assert!(filter.is_sound());
    let p = ud.u * SMatrix::from_diagonal(&ud.d) * ud.u.transpose();
    for row in 0..N {
        for column in 0..N {
            let scale = (p[(row, row)] * p[(column, column)]).sqrt();
            let apart = (filter.covariance_m2[row][column] - p[(row, column)]).abs() / scale;
            assert!(apart < 1e-6, "{row}, {column}: {apart}");
        }
    }
}

#[test]
fn no_measurement_is_so_sharp_that_the_covariance_collapses() {
    let mut filter = unsure_filter();
    let mut h = [0.0; STATES];
    h[..N].fill(1.0);
    for _ in 0..100 {
        let before: [f64; N] = core::array::from_fn(|index| filter.variance_m2(index));
        let innovation = filter.update(&h, 0.0, 1e-30).unwrap();
        for (index, before) in before.into_iter().enumerate() {
            assert!(filter.variance_m2(index) >= before * (1e-30 / innovation.variance_m2));
        }
        assert!(filter.is_sound() && is_positive_definite(&filter));
    }
}

#[test]
fn every_count_of_parameters_is_updated_like_a_dense_filter() {
    // Counts on both sides of the blocks of four rows and four lanes, up to the maximum.
    for count in [0, 1, 2, 3, 4, 5, 16, 18, 42, PARAMETERS] {
        let mut noise = Noise(31);
        let mut prior = Prior { theta_m: [0.0; PARAMETERS], covariance_m2: [[0.0; PARAMETERS]; PARAMETERS] };
        for index in 0..count {
            prior.covariance_m2[index][index] = 1.0;
        }
        let mut filter: Filter = Zeroable::zeroed();
        filter.reset(count, &prior);
        filter.reset_state(count, 0.5);
        filter.reset_state(count + 1, 0.25);
        let mut dense = SMatrix::<f64, STATES, STATES>::zeros();
        dense.view_mut((0, 0), (count, count)).fill_with_identity();
        dense[(count, count)] = 0.5;
        dense[(count + 1, count + 1)] = 0.25;
        for _ in 0..5 {
            let mut h = [0.0; STATES];
            h[..count + NUISANCE].fill_with(|| noise.next());
            let row = SMatrix::<f64, 1, STATES>::from(h);
            let s = (row * dense * row.transpose())[0] + 0.1;
            let gain = dense * row.transpose() / s;
            dense -= gain * row * dense;
            assert!((filter.projected_variance_m2(&h) + 0.1 - s).abs() < 1e-12);
            filter.update(&h, 0.3, 0.1).unwrap();
        }
        for (row, values) in filter.covariance_m2.iter().enumerate() {
            for (column, value) in values.iter().enumerate() {
                assert!((value - dense[(row, column)]).abs() < 1e-12, "{count}: {row}, {column}");
            }
        }
    }
}

#[test]
fn inflation_scales_the_covariance_of_theta_alone() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(41));
    filter.reset_state(N, 0.3);
    let mut h = noise.row();
    h[N] = 1.0;
    filter.update(&h, 0.4, 0.1).unwrap();
    let before = filter;
    filter.inflate(2.25);
    assert_eq!(filter.theta_m, before.theta_m);
    for (row, was) in filter.covariance_m2.iter().zip(&before.covariance_m2).take(N) {
        assert_eq!(row[..N], was.map(|entry| 2.25 * entry)[..N]);
        assert!(
            (row[N] - 1.5 * was[N]).abs() < 1e-15 && was[N] != 0.0,
            "the correlation with the stance stays"
        );
    }
    assert_eq!(filter.variance_m2(N), before.variance_m2(N));
    let inflated = filter;
    for factor in [0.0, 0.99, -3.0, 1.0, f64::NAN, f64::INFINITY] {
        filter.inflate(factor);
        assert_eq!(filter.covariance_m2, inflated.covariance_m2, "{factor}");
    }
    assert!(filter.is_sound());
}

#[test]
fn the_covariance_of_two_rows_matches_the_variance_of_their_sum() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(43));
    filter.update(&noise.row(), 0.4, 0.1).unwrap();
    let (h1, h2) = (noise.row(), noise.row());
    let [xx, xy, yy] = filter.covariance_of(&h1, &h2);
    assert_eq!([xx, yy], [&h1, &h2].map(|h| filter.projected_variance_m2(h)));
    let sum = core::array::from_fn(|index| h1[index] + h2[index]);
    assert!((filter.projected_variance_m2(&sum) - (xx + 2.0 * xy + yy)).abs() < 1e-12);
    assert!((filter.covariance_of(&h2, &h1)[1] - xy).abs() < 1e-12);
}

#[test]
fn restoring_makes_a_rounded_covariance_symmetric() {
    let mut filter: Filter = Zeroable::zeroed();
    assert!(filter.restore(&[0.1, 0.2], &[1.0, 0.5, 0.5 + 1e-14, 1.0]));
    assert_eq!(filter.covariance_row_m2(1), [0.5, 1.0]);
    assert!(!filter.restore(&[0.1, 0.2], &[1.0, 0.5, 0.6, 1.0]));
}

#[test]
fn a_reset_state_equals_one_never_updated() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(47));
    filter.reset_state(N, 0.3);
    let mut h = noise.row();
    h[N] = 1.0;
    for _ in 0..20 {
        filter.update(&h, 0.4, 0.1).unwrap();
    }
    let before = filter;
    assert!(filter.theta_m()[N] != 0.0 && filter.variance_m2(N) < 0.3);
    filter.reset_state(N, 0.3);
    assert!(filter.is_sound());
    assert_eq!((filter.theta_m()[N], filter.variance_m2(N)), (0.0, 0.3));
    assert!((0..N).all(|row| filter.covariance_m2[row][N] == 0.0 && filter.covariance_m2[N][row] == 0.0));
    for row in 0..N {
        assert_eq!(filter.theta_m[row], before.theta_m[row]);
        assert_eq!(filter.covariance_m2[row][..N], before.covariance_m2[row][..N]);
    }
}

#[test]
fn squares_of_one_row_after_the_other_add_up_to_that_of_both_together() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(53));
    let (h1, h2, z, r) = (noise.row(), noise.row(), [0.7, -0.4], [0.1, 0.3]);
    let [xx, xy, yy] = filter.covariance_of(&h1, &h2);
    let (a, b) = (z[0] - filter.project(&h1), z[1] - filter.project(&h2));
    let (xx, yy) = (xx + r[0], yy + r[1]);
    let joint = (a * a * yy - 2.0 * a * b * xy + b * b * xx) / (xx * yy - xy * xy);
    let one = filter.update(&h1, z[0], r[0]).unwrap().normalised_square();
    let other = filter.update(&h2, z[1], r[1]).unwrap().normalised_square();
    assert!((one + other - joint).abs() < 1e-12 * joint);
}

#[test]
fn the_spread_given_the_nuisance_is_that_after_measuring_it_exactly() {
    let (mut filter, mut noise) = (unsure_filter(), Noise(59));
    let exact = filter;
    let mut h = [0.0; PARAMETERS];
    h[..N].fill_with(|| noise.next());
    filter.reset_state(N, 0.3);
    filter.reset_state(N + 1, 0.2);
    for axis in [0, 1, 0, 1] {
        let mut row = noise.row();
        row[N + axis] = 1.0;
        filter.update(&row, 0.4, 0.1).unwrap();
    }
    let expected_spread = filter.spread_given_nuisance_m2(&h);
    let mut row = [0.0; STATES];
    row[..N].copy_from_slice(&h[..N]);
    let mut measured = filter;
    for axis in 0..2 {
        let mut nuisance = [0.0; STATES];
        nuisance[N + axis] = 1.0;
        measured.update(&nuisance, 0.0, 1e-14).unwrap();
    }
    for (expected_spread, after) in expected_spread.iter().zip(measured.times_covariance(&row)).take(N) {
        assert!((expected_spread - after).abs() < 1e-9, "{expected_spread} {after}");
    }
    // For known nuisance states nothing is subtracted.
    assert_eq!(exact.spread_given_nuisance_m2(&h), exact.times_covariance(&row));
}
