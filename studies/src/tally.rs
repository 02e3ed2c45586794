//! Sums over samples: root mean squares, fractions, quantiles, and the joints that are reported as a group.

use equipoise_core::body::{JOINTS, Joint};
use nalgebra::Vector3;

/// Display names of joint groups, and MVN's names; left and right count together.
pub const GROUPS: [(&str, &[&str]); 7] = [
    ("hip", &["LeftHip", "RightHip"]),
    ("knee", &["LeftKnee", "RightKnee"]),
    ("ankle", &["LeftAnkle", "RightAnkle"]),
    ("shoulder", &["LeftShoulder", "RightShoulder"]),
    ("elbow", &["LeftElbow", "RightElbow"]),
    ("wrist", &["LeftWrist", "RightWrist"]),
    ("back", &["L5S1", "L4L3", "L1T12", "T9T8"]),
];

/// Indices of a group's joints.
pub fn joints_of(group: usize) -> impl Iterator<Item = usize> {
    GROUPS[group].1.iter().filter_map(|name| Joint::named(name)).map(Joint::index)
}

/// A mean and a root mean square of one quantity.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sums {
    /// Number of values.
    pub count: u64,
    sum: f64,
    squares: f64,
}

impl Sums {
    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.squares += value * value;
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &Sums) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    /// Mean; `None` if empty.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    /// Root mean square; `None` if empty.
    pub fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64).sqrt())
    }
}

/// Torques of one group of joints, estimated and true.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TorqueSums {
    /// Estimated magnitude, N m.
    pub published_nm: Sums,
    /// True magnitude, N m.
    pub true_nm: Sums,
    /// Length of the difference of the vectors, N m.
    pub error_nm: Sums,
    /// Reported σ, N m.
    pub sigma_nm: Sums,
}

impl TorqueSums {
    fn add(&mut self, published_nm: Vector3<f64>, true_nm: Vector3<f64>, sigma_nm: f64) {
        self.published_nm.add(published_nm.norm());
        self.true_nm.add(true_nm.norm());
        self.error_nm.add((published_nm - true_nm).norm());
        self.sigma_nm.add(sigma_nm);
    }

    fn merge(&mut self, other: &TorqueSums) {
        self.published_nm.merge(&other.published_nm);
        self.true_nm.merge(&other.true_nm);
        self.error_nm.merge(&other.error_nm);
        self.sigma_nm.merge(&other.sigma_nm);
    }
}

/// [`TorqueSums`] of every group of [`GROUPS`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ByGroup(pub [TorqueSums; GROUPS.len()]);

impl ByGroup {
    /// Adds all joints of one sample: estimate, its σ, and truth.
    pub fn add(
        &mut self,
        published_nm: &[[f64; 3]; JOINTS],
        sigma_nm: &[f64; JOINTS],
        true_nm: &[Vector3<f64>; JOINTS],
    ) {
        for (group, sums) in self.0.iter_mut().enumerate() {
            for joint in joints_of(group) {
                sums.add(Vector3::from(published_nm[joint]), true_nm[joint], sigma_nm[joint]);
            }
        }
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &ByGroup) {
        for (sums, others) in self.0.iter_mut().zip(&other.0) {
            sums.merge(others);
        }
    }
}

/// How often an error lay within its own σ.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Coverage {
    /// Number of errors with a σ.
    pub count: u64,
    within: [u64; 2],
    ratio: Sums,
}

impl Coverage {
    /// Adds an error; one without a σ is not counted.
    pub fn add(&mut self, error: f64, sigma: f64) {
        if sigma <= 0.0 {
            return;
        }
        let ratio = error.abs() / sigma;
        self.count += 1;
        self.within[0] += u64::from(ratio <= 1.0);
        self.within[1] += u64::from(ratio <= 2.0);
        self.ratio.add(ratio);
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &Coverage) {
        self.count += other.count;
        for (sum, others) in self.within.iter_mut().zip(other.within) {
            *sum += others;
        }
        self.ratio.merge(&other.ratio);
    }

    /// The sum of several.
    pub fn of_all(several: &[Coverage]) -> Coverage {
        let mut all = Coverage::default();
        several.iter().for_each(|coverage| all.merge(coverage));
        all
    }

    /// Standard error of the mean fraction within 1σ over subjects, in percent; `None` for fewer than two of them.
    pub fn standard_error_percent(subjects: &[Coverage]) -> Option<f64> {
        let mut sums = Sums::default();
        subjects.iter().filter_map(|coverage| coverage.percent()[0]).for_each(|percent| sums.add(percent));
        let (mean, rms, count) = (sums.mean()?, sums.rms()?, sums.count as f64);
        (sums.count > 1).then(|| ((rms * rms - mean * mean).max(0.0) / (count - 1.0)).sqrt())
    }

    /// Fraction within 1σ and within 2σ, in percent.
    pub fn percent(&self) -> [Option<f64>; 2] {
        self.within.map(|within| percent(within, self.count))
    }

    /// Root mean square of error over σ: 1 if σ is correct.
    pub fn ratio_rms(&self) -> Option<f64> {
        self.ratio.rms()
    }
}

/// Coverage of a vector with two components by its covariance: along each axis, and by the Mahalanobis distance.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PlanarCoverage {
    /// Of both axes, each error over its own σ.
    pub by_axis: Coverage,
    /// By the distance: within the ellipse that contains 68.3 %, and that which contains 95.4 % of a normal error.
    pub by_distance: Coverage,
}

impl PlanarCoverage {
    /// Adds an error with its covariance: xx, xy, yy.
    pub fn add(&mut self, [x, y]: [f64; 2], [xx, xy, yy]: [f64; 3]) {
        let determinant = xx * yy - xy * xy;
        if xx <= 0.0 || yy <= 0.0 || determinant <= 0.0 {
            return;
        }
        self.by_axis.add(x, xx.sqrt());
        self.by_axis.add(y, yy.sqrt());
        let square = (x * x * yy - 2.0 * x * y * xy + y * y * xx) / determinant;
        // χ² with two degrees of freedom as the normal deviate of the same probability: P = 1 − exp(−d²/2).
        self.by_distance.add(normal_deviate((-0.5 * square).exp()), 1.0);
    }
}

/// Number of σ that a normal error exceeds with this two-sided probability.
///
/// Abramowitz and Stegun, *Handbook of Mathematical Functions*, 26.2.23; off by less than 4.5e-4.
fn normal_deviate(beyond: f64) -> f64 {
    let t = (-2.0 * (0.5 * beyond).max(f64::MIN_POSITIVE).ln()).sqrt();
    let above = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let below = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    (t - above / below).max(0.0)
}

/// A fraction in percent; `None` if the whole is zero.
pub fn percent(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| 100.0 * part as f64 / whole as f64)
}

/// Lower quartile, median and upper quartile: of n ordered values the ones at ¼, ½ and ¾ of n − 1, rounded.
pub fn quartiles(mut values: Vec<f64>) -> Option<[f64; 3]> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some([0.25, 0.5, 0.75].map(|probability| values[(probability * last as f64).round() as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_of_a_group_is_a_joint() {
        for (group, (name, joints)) in GROUPS.iter().enumerate() {
            assert_eq!(joints_of(group).count(), joints.len(), "{name}");
        }
    }

    #[test]
    fn sums_taken_apart_and_merged_are_the_sums() {
        let (mut whole, mut parts) = (Sums::default(), [Sums::default(); 2]);
        for index in 0..9_usize {
            whole.add(index as f64);
            parts[index % 2].add(index as f64);
        }
        parts[0].merge(&parts[1].clone());
        assert_eq!(parts[0], whole);
        assert_eq!(whole.mean(), Some(4.0));
        assert_eq!(Sums::default().rms(), None);
    }

    #[test]
    fn exact_values_have_no_error() {
        let truth: [Vector3<f64>; JOINTS] =
            std::array::from_fn(|joint| Vector3::new(joint as f64, -2.0, 0.5));
        let mut sums = ByGroup::default();
        sums.add(&truth.map(Into::into), &[1.0; JOINTS], &truth);
        for group in &sums.0 {
            assert_eq!(group.error_nm.rms(), Some(0.0));
            assert_eq!(group.published_nm, group.true_nm);
        }
    }

    #[test]
    fn coverage_counts_what_lies_within() {
        let mut coverage = Coverage::default();
        for error in [-0.5, 0.9, -1.5, 3.0] {
            coverage.add(error, 1.0);
        }
        coverage.add(1.0, 0.0);
        assert_eq!((coverage.count, coverage.percent()), (4, [Some(50.0), Some(75.0)]));
    }

    #[test]
    fn the_standard_error_counts_subjects_and_not_samples() {
        let subject = |within: usize, samples: usize| {
            let mut coverage = Coverage::default();
            (0..samples).for_each(|index| coverage.add(if index < within { 0.5 } else { 1.5 }, 1.0));
            coverage
        };
        // 100 %, 50 % and 0 %: a standard deviation of 50 %.
        let three = [subject(1000, 1000), subject(5, 10), subject(0, 10)];
        let error = Coverage::standard_error_percent(&three).unwrap();
        assert!((error - 50.0 / 3.0_f64.sqrt()).abs() < 1e-9, "{error}");
        assert_eq!(Coverage::standard_error_percent(&three[..1]), None);
        assert_eq!(Coverage::of_all(&three).count, 1020);
    }

    #[test]
    fn the_ellipse_of_one_sigma_holds_what_one_sigma_holds() {
        for (beyond, deviate) in [(0.317_31, 1.0), (0.045_50, 2.0), (0.002_70, 3.0)] {
            assert!((normal_deviate(beyond) - deviate).abs() < 1e-3, "{beyond}");
        }
        let mut coverage = PlanarCoverage::default();
        // Relative to an ellipse, an error along its long axis is small, and one across it is not.
        let covariance = [1.0, 0.9, 1.0];
        coverage.add([0.9, 0.9], covariance);
        assert_eq!(coverage.by_distance.percent(), [Some(100.0), Some(100.0)]);
        coverage.add([0.9, -0.9], covariance);
        assert_eq!(coverage.by_distance.percent(), [Some(50.0), Some(50.0)]);
        assert_eq!(coverage.by_axis.percent()[0], Some(100.0));
    }

    #[test]
    fn quartiles_are_values_that_occurred() {
        assert_eq!(quartiles(vec![5.0, 1.0, 3.0, 2.0, 4.0]), Some([2.0, 3.0, 4.0]));
        assert_eq!(quartiles(Vec::new()), None);
    }
}
