//! Components that the ground's devices do not measure are never used.

use super::*;
use crate::message::state::Unavailable;

fn bench_after_poses(shear_n: Option<[f64; 2]>) -> Bench {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.unmeasured_shear_n = shear_n;
    for (index, posture) in postures().into_iter().enumerate().take(8) {
        bench.hold(&person, &posture, None, 700);
        // Natural motion between two poses is included.
        if index == 4 {
            let at = lifted_box(&person, &posture);
            bench.hold(&person, &posture, Some((6.0, at)), 300);
        }
    }
    bench
}

#[test]
fn unmeasured_shear_is_never_read() {
    let (zero, nonsense) = (bench_after_poses(Some([0.0; 2])), bench_after_poses(Some([260.0, -190.0])));
    assert!(bytemuck::bytes_of(zero.state()) == bytemuck::bytes_of(nonsense.state()));
    assert!(bytemuck::bytes_of(&*zero.memory) == bytemuck::bytes_of(&*nonsense.memory));
    assert!(!zero.state().provides(Unavailable::Shear) && zero.state().poses_used > 2);
    assert_eq!(nonsense.state().ground_force_n[..2], [0.0; 2]);
}

#[test]
fn at_rest_missing_shear_does_not_increase_sigma() {
    let (person, posture) = (Person::real(), stand(10, 0, [-80, 0, 0], [80, 0, 0], 0));
    let published = |shear_n| {
        let mut bench = Bench::new(|_| {});
        bench.unmeasured_shear_n = shear_n;
        bench.hold(&person, &posture, None, 900);
        (bench.state().poses_used, bench.state().cop_sigma_m)
    };
    let (with, without) = (published(None), published(Some([0.0; 2])));
    assert_eq!(with.0, without.0);
    for axis in 0..2 {
        assert!((with.1[axis] - without.1[axis]).abs() < 1e-4, "{with:?} {without:?}");
    }
}
