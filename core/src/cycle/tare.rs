//! What an empty plate shows, taken off all that it shows.

use bytemuck::{Pod, Zeroable};

use crate::message::GroundSample;

/// Mean wrench of the empty plate, and of each foot's plate where there are two.
///
/// Each foot's vertical force loses what its own plate showed. Its centre of pressure stays as it was told: an empty
/// plate does not say where its small force acts. The common centre, which is tared exactly, puts the two right again
/// ([`crate::overload::Sharing::with_feet`]). A tare that was taken before feet were measured has no parts for them:
/// then the feet contradict the whole, and are not believed until the next tare.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Tare {
    /// Force, N.
    pub force_n: [f64; 3],
    /// Moment about the world's origin, N m.
    pub moment_nm: [f64; 3],
    /// Vertical force of the left and the right foot's plate, N; zero if feet are not measured.
    pub foot_vertical_n: [f64; 2],
}

impl Tare {
    /// The mean of what an empty plate shows in these samples.
    pub(super) fn shown_by<'a>(samples: impl Iterator<Item = &'a GroundSample> + Clone) -> Tare {
        let mut mean = Tare::zeroed();
        let count = samples.clone().count().max(1) as f64;
        let feet = samples.clone().all(GroundSample::has_feet);
        for sample in samples {
            let foot_vertical_n = if feet { sample.foot_vertical_n } else { [0.0; 2] };
            let share = |value: f64| value / count;
            mean.add(&Tare {
                force_n: sample.force_n.map(share),
                moment_nm: sample.moment_nm.map(share),
                foot_vertical_n: foot_vertical_n.map(share),
            });
        }
        mean
    }

    /// Adds what was found after this one was taken off already.
    pub(super) fn add(&mut self, more: &Tare) {
        for (mine, more) in self.numbers_mut().zip(more.numbers()) {
            *mine += more;
        }
    }

    /// A ground sample less this.
    pub(super) fn off(&self, sample: &GroundSample) -> GroundSample {
        GroundSample {
            force_n: core::array::from_fn(|axis| sample.force_n[axis] - self.force_n[axis]),
            moment_nm: core::array::from_fn(|axis| sample.moment_nm[axis] - self.moment_nm[axis]),
            foot_vertical_n: [0, 1].map(|foot| match sample.per_foot {
                1 => sample.foot_vertical_n[foot] - self.foot_vertical_n[foot],
                _ => sample.foot_vertical_n[foot],
            }),
            ..*sample
        }
    }

    /// Whether every number is finite; a stored tare is checked before use.
    pub fn is_sound(&self) -> bool {
        self.numbers().all(f64::is_finite)
    }

    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.force_n.into_iter().chain(self.moment_nm).chain(self.foot_vertical_n)
    }

    fn numbers_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        self.force_n.iter_mut().chain(&mut self.moment_nm).chain(&mut self.foot_vertical_n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plates(vertical_n: [f64; 2]) -> GroundSample {
        GroundSample {
            per_foot: 1,
            force_n: [1.0, 0.0, vertical_n[0] + vertical_n[1]],
            foot_vertical_n: vertical_n,
            ..Zeroable::zeroed()
        }
    }

    #[test]
    fn each_foot_loses_what_its_own_plate_showed() {
        let empty = [plates([12.0, -3.0]), plates([14.0, -5.0])];
        let tare = Tare::shown_by(empty.iter());
        let standing = tare.off(&plates([313.0, 396.0]));
        assert_eq!((standing.foot_vertical_n, standing.force_n), ([300.0, 400.0], [0.0, 0.0, 700.0]));
        assert!(standing.has_feet() && tare.is_sound());
    }

    #[test]
    fn a_tare_without_feet_leaves_feet_that_are_not_believed() {
        let tare = Tare::shown_by([GroundSample { per_foot: 0, ..plates([40.0, 0.0]) }].iter());
        assert!(!tare.off(&plates([340.0, 400.0])).has_feet());
    }
}
