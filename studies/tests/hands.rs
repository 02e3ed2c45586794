//! A carried box is 0.30 to 0.45 m wide, as measured on people who lift, and rigid.

use equipoise_core::body::Segment;
use equipoise_simulator::motion::Worker;
use equipoise_studies::clocks::lift_round;
use equipoise_studies::natural::Movements;
use equipoise_studies::restarts::BEGINS_S;
use equipoise_studies::sensors::Rig;
use equipoise_studies::session::Session;
use equipoise_studies::subject::{Subject, map_in_parallel};
use nalgebra::Vector3;

/// Rounding errors of the distance, m.
const TOLERANCE_M: f64 = 1e-5;
/// Carried mass, kg.
const BOX_KG: f64 = 8.0;

type Task = fn(&Subject, &mut Session);

/// Every way in which the studies carry a box, but for the tasks of `back`, which are tested there.
const TASKS: [(&str, Task); 4] = [
    ("natural, early, faults, restarts", |subject, session| {
        let mut movements = Movements::of(subject);
        movements.work(session, BEGINS_S, |_| false);
        session.order(|worker, at_s| worker.lift(BOX_KG, at_s));
        movements.work(session, 60.0, |_| false);
    }),
    ("clocks", |_, session| lift_round(session, true, 0.4, |_, _| {})),
    ("lifting, sources", |_, session| session.lift_at_work(BOX_KG, |_| {})),
    ("paper, coverage", |_, session| session.lift(BOX_KG, |_| {})),
];

/// Distances between the hands while they carry a load, m; negative if the hands are crossed.
fn apart_m(worker: &Worker, until_s: f64) -> Vec<f64> {
    let bodies = (0..(20.0 * until_s) as u32).map(|step| worker.sample(0.05 * f64::from(step)));
    let loaded = bodies.filter(|body| body.load_kg > 0.0);
    loaded
        .map(|body| {
            let apart = body.grip_m[0] - body.grip_m[1];
            let leftwards = body.world_from_segment[Segment::T8.index()] * Vector3::y();
            apart.norm().copysign(apart.dot(&leftwards))
        })
        .collect()
}

#[test]
fn the_hands_are_as_far_apart_as_a_box_is_wide_in_every_task() {
    for (name, task) in TASKS {
        let subjects: Vec<Subject> = (0..25).map(Subject::random).collect();
        let all = map_in_parallel(&subjects, |subject| {
            // The estimator is not tested: few samples.
            let rig = Rig { suit_hz: 20, plate_hz: 20, ..subject.rig() };
            let mut session = Session::with(subject, subject.settings(), rig, subject.habits());
            session.run(0.5, |_| {});
            task(subject, &mut session);
            apart_m(session.worker(), session.now_s())
        });
        let mut count = 0;
        for (subject, apart_m) in subjects.iter().zip(all) {
            let wide_m = subject.habits().hands_apart_m;
            assert!((0.30..0.45).contains(&wide_m));
            for metres in &apart_m {
                assert!(
                    (metres - wide_m).abs() < TOLERANCE_M,
                    "{name}, {subject:?}: {metres} m, not {wide_m}"
                );
            }
            count += apart_m.len();
        }
        assert!(count >= 1000, "{name}: {count} samples with a load");
    }
}
