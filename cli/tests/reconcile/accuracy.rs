//! Content of the blocks, compared with the loop's own numbers and with the simulator's truth.

use std::sync::OnceLock;

use equipoise_config::Config;
use equipoise_core::body::SEGMENTS;
use equipoise_core::cycle::{Inputs, Memory, Tick, step};
use equipoise_core::message::Validity;
use equipoise_discrepancy::block::{Block, LAGS_S, Phase};
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::{Compared, Reconcile};
use equipoise_recording::replay::input::Input;
use equipoise_studies::sensors::{EPOCH_NS, Rig};

use crate::make::{Samples, Script};

fn compared(script: &Script, samples: &Samples) -> Compared {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("session.mcap");
    samples.write(&path, &script.config());
    let input = Input::open(&path).unwrap();
    let config = Config::parse(&script.config(), "test").unwrap();
    let reconcile = Reconcile { input: &input, config: &config, given: Given::default() };
    reconcile.compare(&mut |_| {}).unwrap()
}

/// The ordinary script, its samples and their blocks, made once.
fn ordinary() -> &'static (Script, Samples, Compared) {
    static ORDINARY: OnceLock<(Script, Samples, Compared)> = OnceLock::new();
    ORDINARY.get_or_init(|| {
        let script = Script::ordinary();
        let samples = script.samples();
        let compared = compared(&script, &samples);
        (script, samples, compared)
    })
}

fn residual_m(block: &Block) -> [f64; 2] {
    let observation = &block.observation;
    [0, 1].map(|axis| observation.cop_measured_m[axis] - observation.cop_predicted_m[axis])
}

fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    assert!(count > 0.0, "nothing was looked at");
    f64::sqrt(sum / count)
}

/// Residual of the loop with a frozen worker, over each block: measured minus estimated, without the change of the
/// stance offset since, m.
fn by_the_loop(compared: &Compared, samples: &Samples, config: &Config) -> Vec<(f64, [f64; 2])> {
    let settings = config.settings();
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&settings);
    memory.identification = *compared.identified.worker;
    let offset = |memory: &Memory| {
        let filter = &memory.identification.filter;
        [0, 1].map(|axis| filter.theta_m()[filter.count() + axis])
    };
    let first_m = offset(&memory);
    let (mut suit, mut ground) = (samples.suit.iter().peekable(), samples.ground.iter().peekable());
    let (mut residuals, mut due_ns, mut sample_ns) = (Vec::new(), EPOCH_NS, 0);
    for cycle in 1.. {
        due_ns += 4_000_000;
        let mut inputs = (Vec::new(), Vec::new());
        while let Some(sample) = suit.next_if(|sample| sample.published_ns <= due_ns) {
            inputs.0.push(*sample);
        }
        while let Some(sample) = ground.next_if(|sample| sample.published_ns <= due_ns) {
            inputs.1.push(*sample);
        }
        let inputs = Inputs { suit: &inputs.0, ground: &inputs.1, body: None, command: None };
        let state = *step(&settings, &mut memory, Tick { cycle, due_ns }, inputs);
        let invalid = Validity::INVALIDATES_COP_MEASURED.and(Validity::INVALIDATES_COP_ESTIMATED);
        if state.suit_sample_time_ns != sample_ns
            && state.static_pose == 1
            && !state.validity().any_of(invalid)
        {
            let now_m = offset(&memory);
            let residual_m = [0, 1].map(|axis| {
                state.cop_measured_m[axis] - state.cop_estimated_m[axis] + now_m[axis] - first_m[axis]
            });
            residuals.push(((state.suit_sample_time_ns - EPOCH_NS) as f64 * 1e-9, residual_m));
        }
        sample_ns = state.suit_sample_time_ns;
        if suit.peek().is_none() && ground.peek().is_none() {
            return residuals;
        }
    }
    residuals
}

#[test]
fn static_blocks_have_the_residual_of_the_loop() {
    let (script, samples, compared) = ordinary();
    let config = Config::parse(&script.config(), "test").unwrap();
    let residuals = by_the_loop(compared, samples, &config);
    let session = &compared.session;
    let mut differences = Vec::new();
    for block in session.blocks.iter().filter(|block| block.still) {
        let middle_s = block.observation.time_s;
        let within =
            residuals.iter().filter(|(time_s, _)| (time_s - middle_s).abs() <= 0.5 * session.block_s);
        let within: Vec<[f64; 2]> = within.map(|(_, residual_m)| *residual_m).collect();
        if within.len() < 6 {
            continue;
        }
        for axis in 0..2 {
            let mean_m = within.iter().map(|residual_m| residual_m[axis]).sum::<f64>() / within.len() as f64;
            differences.push(residual_m(block)[axis] - mean_m);
        }
    }
    let (blocks, difference_m) = (differences.len() / 2, rms(differences));
    println!("{blocks} still blocks: {:.3} mm RMS apart", 1e3 * difference_m);
    assert!(blocks > 40 && difference_m < 1e-3, "{blocks} {difference_m}");
}

#[test]
fn accelerations_are_those_of_the_simulated_body() {
    let script = Script::perfect();
    let compared = compared(&script, &script.samples());
    let mut ordered = script.worker();
    let (mut origin, mut centre, mut size) = (Vec::new(), Vec::new(), Vec::new());
    for block in compared.session.blocks.iter().filter(|block| block.phase == Phase::Work) {
        let observation = &block.observation;
        // The same mean and parabola as in the block, which smooth the truth too.
        let step_s = 1.0 / 60.0;
        let times: Vec<f64> = (-6..=6).map(|sample| f64::from(sample) * step_s).collect();
        let mut truth = [[0.0; 3]; SEGMENTS];
        for time_s in &times {
            let at_s = observation.time_s + time_s;
            ordered.until(at_s);
            let motion = ordered.worker.origin_motion(at_s);
            for (sum, [_, acceleration]) in truth.iter_mut().zip(motion) {
                for (sum, value) in sum.iter_mut().zip(acceleration.iter()) {
                    *sum += value / times.len() as f64;
                }
            }
        }
        let pairs = observation.origin_acceleration_m_per_s2.iter().flatten().zip(truth.iter().flatten());
        for (residuals, truth) in pairs {
            origin.push(residuals - truth);
            size.push(*truth);
        }
        let force = |axis: usize| observation.force_measured_n[axis] / observation.mass_kg;
        centre.push(observation.com_acceleration_m_per_s2[2] - (force(2) - 9.81));
        centre.push(observation.com_acceleration_m_per_s2[0] - force(0));
    }
    let (origin, centre, size) = (rms(origin), rms(centre), rms(size));
    println!("origins {origin:.3} m/s² of {size:.3}, centre {centre:.3} m/s²");
    assert!(size > 0.3 && origin < 0.1 * size && centre < 0.1 * size, "{origin} {centre} {size}");
}

#[test]
fn a_suit_that_is_late_is_best_explained_by_its_lag() {
    // Perfect samples repeat themselves while the plate, which is earlier, shows motion: they would be detected as
    // frozen.
    let script = Script { rig: Rig { suit_late_ns: 30_000_000, ..Rig::ORDINARY }, ..Script::ordinary() };
    let late = compared(&script, &script.samples());
    let (_, _, in_time) = ordinary();
    let residual = |compared: &Compared, lag: Option<usize>| {
        rms(compared.session.blocks.iter().filter(|block| !block.still).flat_map(|block| {
            let change = lag.map_or([0.0; 2], |lag| block.by_lag[lag].cop_m);
            let vertical_n = block.observation.force_measured_n[2] - block.observation.force_predicted_n[2];
            let vertical_n = vertical_n - lag.map_or(0.0, |lag| block.by_lag[lag].force_n[2]);
            let [x, y] = residual_m(block);
            [x - change[0], y - change[1], 1e-3 * vertical_n]
        }))
    };
    let by_lag: Vec<f64> = (0..LAGS_S.len()).map(|lag| residual(&late, Some(lag))).collect();
    let best = (0..LAGS_S.len()).min_by(|a, b| by_lag[*a].total_cmp(&by_lag[*b])).unwrap();
    println!("without {:.4}; {:?}", residual(&late, None), LAGS_S.iter().zip(&by_lag).collect::<Vec<_>>());
    assert_eq!(LAGS_S[best], 0.03);
    // The remaining residual is that of a suit without lag.
    let (without, in_time) = (residual(&late, None), residual(in_time, None));
    assert!(by_lag[best] < 1.2 * in_time, "{by_lag:?} {without} {in_time}");
    // Most of the residual that the lag adds to the sensors' noise is removed.
    let added = |residual: f64| (residual * residual - in_time * in_time).max(0.0).sqrt();
    assert!(added(by_lag[best]) < 0.5 * added(without), "{by_lag:?} {without} {in_time}");
}
