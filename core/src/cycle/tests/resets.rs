//! What a command resets: no result of another model, subject or setting remains.

use super::*;
use crate::cycle::memory::SubjectState;
use crate::motion::ForceSigma;

const LOAD_KG: f64 = 8.0;

/// An identified subject who carries a box in one hand.
fn carrying(person: &Person) -> (Bench, Posture, Vector3<f64>) {
    static CARRYING: std::sync::OnceLock<(Bench, Posture, Vector3<f64>)> = std::sync::OnceLock::new();
    let carrying = CARRYING.get_or_init(|| {
        let mut bench = Bench::identified();
        let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
        bench.hold(person, &posture, None, 2500);
        let pose = person.pose(&posture);
        let at = pose.point_on(Side::Left.hand(), person.body.grip_m(Side::Left.hand()));
        bench.hold(person, &posture, Some((LOAD_KG, at)), 3000);
        (bench, posture, at)
    });
    carrying.clone()
}

#[test]
fn a_command_that_changes_the_model_resets_the_position_of_the_load() {
    let person = Person::real();
    for command in
        [CommandKind::IdentifyStop, CommandKind::IdentifyReset, CommandKind::Reload, CommandKind::SubjectLoad]
    {
        let (mut bench, ..) = carrying(&person);
        assert!(bench.memory.load.position.eta()[0] > 0.6, "{:?}", bench.memory.load.position.eta());
        bench.command(command);
        assert_eq!(bench.memory.load.position.eta(), [0.5; 2], "{command:?}");
    }
}

#[test]
fn another_subject_starts_without_a_load_and_without_a_force_offset() {
    let person = Person::real();
    let (mut bench, ..) = carrying(&person);
    let sigma = ForceSigma { at_rest_n: 2.0, by_motion_n: 0.0 };
    for _ in 0..500 {
        bench.memory.ground.force_offset.update(10.0, 0.01, sigma);
    }
    assert!(bench.memory.ground.force_offset.mean_n() > 5.0);
    // The same mass, so that only the command resets the offset.
    let subject = SubjectState { identification: bench.memory.identification, exposure: Zeroable::zeroed() };
    bench.memory.replace_subject(&subject);
    bench.command(CommandKind::SubjectLoad);
    let mut started = bench.memory.load;
    started.start_subject();
    assert_eq!(bytemuck::bytes_of(&bench.memory.load), bytemuck::bytes_of(&started));
    bench.memory.ground.force_offset.apply_mass(MASS_KG, 5.0);
    assert_eq!(bench.memory.ground.force_offset.mean_n(), 0.0);
}

#[test]
fn a_reset_moves_the_stance_offset_into_the_anchor_and_keeps_its_uncertainty() {
    let person = Person::real();
    let upright = stand(0, 0, [-80, 0, 0], [80, 0, 0], 0);
    let another_subject = |bench: &mut Bench| {
        let mut subject = bytemuck::zeroed_box::<SubjectState>();
        subject.identification.start(&bench.settings);
        bench.memory.replace_subject(&subject);
        bench.command(CommandKind::SubjectLoad);
    };
    let null_pose = |bench: &mut Bench| {
        let origin_m = person.skeleton.t_pose_m().map(|[x, y, z]| [x, y, z + 0.95]);
        bench.suit_body = Some(SuitBody { origin_m, ..Zeroable::zeroed() });
        bench.hold(&person, &upright, None, 20);
        assert_eq!(bench.memory.identification.body_source(), BodySource::NullPose);
    };
    type Reset<'a> = &'a dyn Fn(&mut Bench);
    let resets: [(&str, Reset<'_>); 5] = [
        ("identify reset", &|bench| bench.command(CommandKind::IdentifyReset)),
        ("reload before the first measurement", &|bench| bench.command(CommandKind::Reload)),
        ("another subject", &another_subject),
        ("null pose", &null_pose),
        ("first lag", &|bench| {
            let settings = bench.settings;
            reset_unaligned(&settings, &mut bench.memory, true);
        }),
    ];
    for (name, reset) in resets {
        let mut bench = Bench::new(|settings| settings.start_identifying = false);
        bench.hold(&person, &upright, None, 400);
        bench.set_stance_offset([0.02, -0.01]);
        bench.memory.identification.widen_stance_offset_to([0.01; 2]);
        let before_m = bench.memory.station_from_suit_m();
        reset(&mut bench);
        let (after_m, subject) = (bench.memory.station_from_suit_m(), &bench.memory.identification);
        assert_eq!(subject.stance_offset_m(), [0.0; 2], "{name}");
        for (axis, offset_m) in [0.02, -0.01].into_iter().enumerate() {
            assert!((before_m[axis] - offset_m).abs() < 1e-6, "{before_m:?}");
            assert!((after_m[axis] - before_m[axis]).abs() < 1e-9, "{name}: {after_m:?} {before_m:?}");
            assert!(subject.stance_variance_m2()[axis] > 0.0099, "{name}");
        }
    }
}

#[test]
fn a_reload_keeps_the_measured_errors_of_motion_unless_the_differentiation_changed() {
    let person = Person::real();
    let is_reset = |change: fn(&mut Settings)| {
        let (mut bench, posture, at) = carrying(&person);
        assert_eq!(bench.memory.early().calibrated, 1);
        bench.memory.prediction.noise.horizontal_activity_m_per_s2.update(1.0, 0.01);
        change(&mut bench.settings);
        bench.command(CommandKind::Reload);
        let noise_is_zero = bytemuck::bytes_of(&bench.memory.prediction.noise).iter().all(|byte| *byte == 0);
        bench.hold(&person, &posture, Some((LOAD_KG, at)), 300);
        (noise_is_zero, bench.memory.early().calibrated == 0)
    };
    assert_eq!(is_reset(|settings| settings.load_threshold_n = 20.0), (false, false));
    assert_eq!(is_reset(|settings| settings.accelerations = Accelerations::Positions), (true, true));
    let wider =
        |settings: &mut Settings| settings.motion = Motion::Compensated { half_window_ns: 90_000_000 };
    assert_eq!(is_reset(wider), (true, true));
}

#[test]
fn a_new_shift_begins_after_a_pause_of_four_hours() {
    let person = Person::real();
    let published = |pause_ns: u64| {
        let (mut bench, posture, _) = carrying(&person);
        bench.hold(&person, &posture, None, 1500);
        let state = *bench.state();
        assert!(
            state.lifts == 1 && state.dose_damage > 0.0 && state.fatigue.iter().any(|value| *value > 0.0)
        );
        bench.now_ns += pause_ns;
        bench.hold(&person, &posture, None, 1500);
        (bench.state().lifts, bench.state().dose_damage, bench.state().fatigue)
    };
    let (lifts, damage, fatigue) = published(3 * 3600 * NS_PER_S + 3000 * NS_PER_S);
    assert!(lifts == 1 && damage > 0.0 && fatigue.iter().any(|value| *value > 0.0));
    assert_eq!(published(4 * 3600 * NS_PER_S), (0, 0.0, [0.0; 22]));
}
