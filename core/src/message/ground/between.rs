//! Interpolation between two ground samples.

use super::GroundSample;

impl GroundSample {
    /// Interpolates between this sample and a `later` one, at `fraction` of the interval. Fields that are
    /// not measurements, including the time, are those of the later sample.
    #[must_use]
    pub fn between(&self, later: &GroundSample, fraction: f64) -> GroundSample {
        let blend =
            |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|axis| a[axis] + fraction * (b[axis] - a[axis]));
        let feet = feet(self, later, fraction);
        GroundSample {
            sample_time_sigma_ns: later.sample_time_sigma_ns.max(self.sample_time_sigma_ns),
            device_status: later.device_status | self.device_status,
            force_n: blend(self.force_n, later.force_n),
            moment_nm: blend(self.moment_nm, later.moment_nm),
            not_measured: self.not_measured | later.not_measured,
            devices: self.devices | later.devices,
            per_foot: u32::from(feet.is_some()),
            foot_vertical_n: feet.map_or([0.0; 2], |(vertical_n, _)| vertical_n),
            foot_cop_m: feet.map_or([[0.0; 2]; 2], |(_, cop_m)| cop_m),
            ..*later
        }
    }
}

/// Interpolates both feet's forces (N) and CoPs between two samples that contain them in the same frame. In an
/// insole's frame the foot's motion is excluded: the pose of the foot is applied at the interpolated time. Forces and their moments are
/// linear between two samples, so a CoP is weighted by its force.
fn feet(earlier: &GroundSample, later: &GroundSample, fraction: f64) -> Option<([f64; 2], [[f64; 2]; 2])> {
    if !(earlier.has_feet() && later.has_feet()) || earlier.foot_frame != later.foot_frame {
        return None;
    }
    let [from, to] = [earlier, later].map(|sample| sample.foot_vertical_n);
    let vertical_n = [0, 1].map(|foot| from[foot] + fraction * (to[foot] - from[foot]));
    let cop_m = [0, 1].map(|foot| {
        let weight =
            if vertical_n[foot].abs() > 1e-6 { fraction * to[foot] / vertical_n[foot] } else { fraction }
                .clamp(0.0, 1.0);
        let (a, b) = (earlier.foot_cop_m[foot], later.foot_cop_m[foot]);
        [0, 1].map(|axis| a[axis] + weight * (b[axis] - a[axis]))
    });
    Some((vertical_n, cop_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn plates(vertical_n: [f64; 2], x_m: [f64; 2]) -> GroundSample {
        GroundSample {
            per_foot: 1,
            force_n: [0.0, 0.0, vertical_n[0] + vertical_n[1]],
            foot_vertical_n: vertical_n,
            foot_cop_m: x_m.map(|x| [x, 0.0]),
            ..Zeroable::zeroed()
        }
    }

    #[test]
    fn forces_and_moments_run_straight_and_only_between_samples_that_have_feet() {
        let (earlier, later) = (plates([100.0, 600.0], [0.3, -0.1]), plates([500.0, 240.0], [0.1, 0.2]));
        // A small negative offset of a lifted foot is no force on the person either, and its interpolation may be
        // negative too.
        let below = (plates([-10.0, 600.0], [0.3, -0.1]), plates([-30.0, 240.0], [0.1, 0.2]));
        for (fraction, (earlier, later)) in [0.0, 0.25, 1.0]
            .into_iter()
            .flat_map(|fraction| [(fraction, (earlier, later)), (fraction, below)])
        {
            let (vertical_n, cop_m) = feet(&earlier, &later, fraction).unwrap();
            for foot in 0..2 {
                let at = |a: f64, b: f64| a + fraction * (b - a);
                let [a, b] =
                    [&earlier, &later].map(|one| (one.foot_vertical_n[foot], one.foot_cop_m[foot][0]));
                assert!((vertical_n[foot] - at(a.0, b.0)).abs() < 1e-9);
                assert!((vertical_n[foot] * cop_m[foot][0] - at(a.0 * a.1, b.0 * b.1)).abs() < 1e-9);
            }
        }
        let contradicting = GroundSample { foot_vertical_n: [9.0; 2], ..later };
        let elsewhere = GroundSample { foot_frame: 1, ..later };
        for without in [GroundSample { per_foot: 0, ..later }, contradicting, elsewhere] {
            assert_eq!(feet(&earlier, &without, 0.5), None);
            assert_eq!(feet(&without, &later, 0.5), None);
        }
    }

    #[test]
    fn a_foot_that_is_lifted_has_a_centre_in_between_and_no_nan() {
        let (lifted, standing) = (plates([0.0, 700.0], [0.0, 0.1]), plates([0.0, 700.0], [0.2, 0.1]));
        let (vertical_n, cop_m) = feet(&lifted, &standing, 0.5).unwrap();
        assert_eq!((vertical_n, cop_m[0]), ([0.0, 700.0], [0.1, 0.0]));
        let (_, cop_m) =
            feet(&plates([-5.0, 705.0], [0.0, 0.1]), &plates([5.0, 695.0], [0.2, 0.1]), 0.5).unwrap();
        assert!((0.0..=0.2).contains(&cop_m[0][0]), "{cop_m:?}");
    }
}
