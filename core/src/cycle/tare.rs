//! Readings of the empty plate, subtracted from all its readings.

use bytemuck::{Pod, Zeroable};

use crate::message::ground::{COP_MIN_VERTICAL_N, WRENCH_MAX};
use crate::message::{FootFrame, GroundDevice, GroundSample};

/// Mean wrench of the empty plate, and of each foot's plate if there are two.
///
/// From each foot, the readings of its own plate are subtracted: its vertical force, and the moment that belongs to its
/// CoP. A tare from before the feet were measured has no parts for them: the feet then contradict the total, and are
/// not used until the next tare.
///
/// Insoles on a plate have no zero of their own here: they give the foot load fractions, which apply to the plate's
/// force after the tare.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Tare {
    /// Force, N.
    pub force_n: [f64; 3],
    /// Moment about the world's origin, N m.
    pub moment_nm: [f64; 3],
    /// Vertical force of the left and the right foot's plate, N; zero if feet are not measured.
    pub foot_vertical_n: [f64; 2],
    /// That force times its CoP in the world, of each foot, N m.
    pub foot_lever_nm: [[f64; 2]; 2],
}

/// Whether the feet's forces are fractions of a plate's force.
fn are_fractions(sample: &GroundSample) -> bool {
    let plates = GroundDevice::Plate as u32 | GroundDevice::SecondPlate as u32;
    sample.devices & GroundDevice::Insoles as u32 != 0 && sample.devices & plates != 0
}

/// Force times CoP, by foot and axis; zero for soles, which are not in world coordinates.
fn levers_nm(sample: &GroundSample) -> [[f64; 2]; 2] {
    if sample.foot_frame != FootFrame::World as u32 {
        return [[0.0; 2]; 2];
    }
    [0, 1].map(|foot| sample.foot_cop_m[foot].map(|metres| sample.foot_vertical_n[foot] * metres))
}

impl Tare {
    /// Mean reading of an empty plate over these samples.
    pub(super) fn mean_of<'a>(samples: impl Iterator<Item = &'a GroundSample> + Clone) -> Tare {
        let mut mean = Tare::zeroed();
        let count = samples.clone().count().max(1) as f64;
        let feet = samples.clone().all(|sample| sample.has_feet() && !are_fractions(sample));
        for sample in samples {
            let foot_vertical_n = if feet { sample.foot_vertical_n } else { [0.0; 2] };
            let foot_lever_nm = if feet { levers_nm(sample) } else { [[0.0; 2]; 2] };
            let averaged = |value: f64| value / count;
            mean.add(&Tare {
                force_n: sample.force_n.map(averaged),
                moment_nm: sample.moment_nm.map(averaged),
                foot_vertical_n: foot_vertical_n.map(averaged),
                foot_lever_nm: foot_lever_nm.map(|lever| lever.map(averaged)),
            });
        }
        mean
    }

    /// Adds a tare measured on readings from which this one was already subtracted.
    pub(super) fn add(&mut self, more: &Tare) {
        for (mine, more) in self.numbers_mut().zip(more.numbers()) {
            *mine += more;
        }
    }

    /// A ground sample minus the tare.
    pub(super) fn subtract_from(&self, sample: &GroundSample) -> GroundSample {
        let whole = GroundSample {
            force_n: core::array::from_fn(|axis| sample.force_n[axis] - self.force_n[axis]),
            moment_nm: core::array::from_fn(|axis| sample.moment_nm[axis] - self.moment_nm[axis]),
            ..*sample
        };
        match sample.per_foot {
            1 if are_fractions(sample) => self.scaled_to_plate(whole, sample.force_n[2]),
            1 => self.feet_without_tare(whole),
            _ => whole,
        }
    }

    /// Scales insole forces to the plate's force after the tare.
    fn scaled_to_plate(&self, whole: GroundSample, before_n: f64) -> GroundSample {
        let left = if before_n.abs() > 1e-9 { whole.force_n[2] / before_n } else { 0.0 };
        GroundSample { foot_vertical_n: whole.foot_vertical_n.map(|newtons| newtons * left), ..whole }
    }

    /// Subtracts the tare of each foot's plate.
    fn feet_without_tare(&self, whole: GroundSample) -> GroundSample {
        let foot_vertical_n = [0, 1].map(|foot| whole.foot_vertical_n[foot] - self.foot_vertical_n[foot]);
        if whole.foot_frame != FootFrame::World as u32 || self.foot_lever_nm == [[0.0; 2]; 2] {
            return GroundSample { foot_vertical_n, ..whole };
        }
        let levers_nm = levers_nm(&whole);
        let foot_cop_m = [0, 1].map(|foot| {
            if foot_vertical_n[foot] < COP_MIN_VERTICAL_N {
                return [0.0; 2];
            }
            [0, 1]
                .map(|axis| (levers_nm[foot][axis] - self.foot_lever_nm[foot][axis]) / foot_vertical_n[foot])
        });
        GroundSample { foot_vertical_n, foot_cop_m, ..whole }
    }

    /// Whether every number is within any plate's range; a stored tare is checked before use.
    pub fn is_sound(&self) -> bool {
        self.numbers().all(|number| number.abs() < WRENCH_MAX)
    }

    fn numbers(&self) -> impl Iterator<Item = f64> {
        let feet = self.foot_vertical_n.into_iter().chain(self.foot_lever_nm.into_iter().flatten());
        self.force_n.into_iter().chain(self.moment_nm).chain(feet)
    }

    fn numbers_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        let feet = self.foot_vertical_n.iter_mut().chain(self.foot_lever_nm.iter_mut().flatten());
        self.force_n.iter_mut().chain(&mut self.moment_nm).chain(feet)
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
    fn each_foot_has_the_tare_of_its_own_plate() {
        let empty = [plates([12.0, -3.0]), plates([14.0, -5.0])];
        let tare = Tare::mean_of(empty.iter());
        let standing = tare.subtract_from(&plates([313.0, 396.0]));
        assert_eq!((standing.foot_vertical_n, standing.force_n), ([300.0, 400.0], [0.0, 0.0, 700.0]));
        assert!(standing.has_feet() && tare.is_sound());
        assert!(!Tare { force_n: [0.0, 0.0, -1e6], ..tare }.is_sound());
        assert!(!Tare { foot_lever_nm: [[0.0; 2], [0.0, f64::NAN]], ..tare }.is_sound());
    }

    #[test]
    fn each_foot_s_centre_is_corrected_for_any_tare() {
        // Each plate has its own offset of 70 or 100 N at its own position, and the left one is pulled by 30 N in
        // addition.
        let own = [(70.0, [0.3, 0.2]), (100.0, [-0.2, -0.3])];
        let with = |feet: [(f64, [f64; 2]); 2]| {
            let reported = [0, 1].map(|foot| {
                let ((own_n, own_m), (foot_n, foot_m)) = (own[foot], feet[foot]);
                let all_n = own_n + foot_n;
                (all_n, [0, 1].map(|axis| (own_n * own_m[axis] + foot_n * foot_m[axis]) / all_n))
            });
            GroundSample {
                foot_cop_m: reported.map(|(_, cop_m)| cop_m),
                ..plates(reported.map(|(newtons, _)| newtons))
            }
        };
        let tare = Tare::mean_of([with([(0.0, [0.0; 2]); 2])].iter());
        let feet = [(310.0, [0.05, 0.14]), (390.0, [0.02, -0.11])];
        let standing = tare.subtract_from(&with(feet));
        for (foot, (foot_n, foot_m)) in feet.into_iter().enumerate() {
            assert!((standing.foot_vertical_n[foot] - foot_n).abs() < 1e-9);
            for (reported_m, true_m) in standing.foot_cop_m[foot].into_iter().zip(foot_m) {
                assert!((reported_m - true_m).abs() < 1e-12, "{reported_m} {true_m}");
            }
        }
        let lifted = tare.subtract_from(&with([(0.0, [0.0; 2]), (700.0, [0.02, -0.11])]));
        assert_eq!(lifted.foot_cop_m[0], [0.0; 2]);
    }

    #[test]
    fn insoles_share_what_the_tared_plate_weighs() {
        let devices = GroundDevice::Plate as u32 | GroundDevice::Insoles as u32;
        let on =
            |sample: GroundSample| GroundSample { devices, foot_frame: FootFrame::Insole as u32, ..sample };
        let tare = Tare::mean_of([on(plates([20.0, 20.0]))].iter());
        let standing = tare.subtract_from(&on(plates([185.0, 555.0])));
        assert_eq!((standing.force_n[2], standing.foot_vertical_n), (700.0, [175.0, 525.0]));
        assert!(standing.has_feet());
    }

    #[test]
    fn a_tare_without_feet_makes_the_feet_unavailable() {
        let tare = Tare::mean_of([GroundSample { per_foot: 0, ..plates([40.0, 0.0]) }].iter());
        assert!(!tare.subtract_from(&plates([340.0, 400.0])).has_feet());
    }
}
