//! A simulated person with each foot on its own plate: the fused sample equals the true ground reaction.

use equipoise_adapters::ground::fusion::{Fusion, FusionKind, FusionSettings};
use equipoise_core::message::{GroundDevice, GroundSample};
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::person::Person;
use equipoise_simulator::two_plates::{ground_reaction_per_foot, ground_sample};
use nalgebra::Vector2;

/// Sampling rates of the plates; the second samples slightly later.
const RATES_HZ: [f64; 2] = [1000.0, 610.0];
const PHASE_S: [f64; 2] = [0.0, 0.0007];
/// Position of the load: one ball and one heel.
const PRESS_M: [[f64; 2]; 2] = [[0.11, 0.01], [-0.02, 0.0]];

fn foot(worker: &Worker, device: usize, time_s: f64) -> GroundSample {
    let feet = ground_reaction_per_foot(worker, time_s, PRESS_M.map(Vector2::from));
    let devices = [GroundDevice::Plate, GroundDevice::SecondPlate][device] as u32;
    let wrench = feet[device];
    GroundSample {
        sample_time_ns: (time_s * 1e9) as u64,
        force_n: wrench.force_n.into(),
        moment_nm: wrench.moment_nm.into(),
        devices,
        ..bytemuck::Zeroable::zeroed()
    }
}

#[test]
fn two_plates_with_clocks_of_their_own_are_the_whole_while_a_box_is_lifted() {
    let mut worker = Worker::with_habits(Person::new(3, 1.77, 72.0), 3, Habits::ORDINARY);
    worker.lift_and_show(8.0, 0.2);
    let mut events = Vec::new();
    for device in 0..2 {
        for step in 0..(3.0 * RATES_HZ[device]) as u32 {
            let time_s = 1.0 + PHASE_S[device] + f64::from(step) / RATES_HZ[device];
            events.push((device, foot(&worker, device, time_s)));
        }
    }
    events.sort_by_key(|(_, sample)| sample.sample_time_ns);
    let mut fusion = Fusion::new(FusionSettings::new(FusionKind::TwoPlates { left: Some(0) }, [0; 2]));
    let mut fused = Vec::new();
    for (device, sample) in events {
        let now_ns = sample.sample_time_ns;
        fusion.push(device, sample, now_ns);
        fusion.fused(now_ns, &mut fused);
    }
    assert!(fused.len() > 2950, "{}", fused.len());
    let mut worst = [0.0_f64; 4];
    for reported in fused.iter().step_by(7) {
        let time_s = reported.sample_time_ns as f64 * 1e-9;
        let feet = ground_reaction_per_foot(&worker, time_s, PRESS_M.map(Vector2::from));
        let truth = ground_sample(&feet);
        let off = |reported: &[f64], truth: &[f64]| {
            reported.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        worst[0] = worst[0].max(off(&reported.force_n, &truth.force_n));
        worst[1] = worst[1].max(off(&reported.moment_nm, &truth.moment_nm));
        worst[2] = worst[2].max(off(&reported.cop_m().unwrap(), &truth.cop_m().unwrap()));
        let (by_foot, true_feet) = (reported.feet().unwrap(), truth.feet().unwrap());
        worst[3] = worst[3].max(off(&by_foot.vertical_n, &true_feet.vertical_n));
    }
    println!("worst: {:.3} N, {:.4} N m, {:.6} m, {:.3} N a foot", worst[0], worst[1], worst[2], worst[3]);
    // Bound of the error of linear interpolation over 1.6 ms of this motion.
    assert!(worst[0] < 0.1 && worst[1] < 0.05 && worst[2] < 1e-4 && worst[3] < 0.1, "{worst:?}");
}
