use super::*;
use nalgebra::{SMatrix, SVector};

const N: usize = 7;

/// A small generator, so that the tests need no crate: xorshift mapped to (−1, 1).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn row(&mut self) -> [f64; PARAMETERS] {
        let mut row = [0.0; PARAMETERS];
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
/// another algorithm for the same answer, which cannot lose positivity.
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
    assert_eq!(filter.update(&[f64::INFINITY; PARAMETERS], 1.0, 0.1), None);
    assert_eq!(filter.theta_m, before);
}

#[test]
fn the_innovations_of_a_true_model_have_the_variance_they_predict() {
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
