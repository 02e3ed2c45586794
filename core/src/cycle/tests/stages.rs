//! Unit tests of single stages.

use super::*;
use crate::cycle::align::AlignState;
use crate::cycle::ground::{Ground, GroundState};
use crate::cycle::identify::Identified;
use crate::cycle::load_in_hands::hold_load;
use crate::cycle::loading::{Carrying, ExternalForce, LoadState};
use crate::cycle::placement::Placement;
use crate::cycle::prediction::{Prediction, PredictionState};
use crate::cycle::stillness::Stillness;
use crate::frame::Pose;
use crate::motion::{History, Unloaded};
use crate::static_pose::{WINDOW, Window};

const PERIOD_NS: u64 = 10_000_000;

/// A subject with bone lengths and a mass, who stands on the plate, and the state of every stage.
struct StageFixture {
    settings: Settings,
    person: Person,
    streams: Streams,
    subject: Box<Identification>,
    align: Box<AlignState>,
    placement: Box<Placement>,
    history: Box<History>,
    ground: Box<GroundState>,
    window: Box<Window>,
    prediction: Box<PredictionState>,
    load: Box<LoadState>,
    time_ns: u64,
    shear_n: f64,
}

impl StageFixture {
    fn new() -> StageFixture {
        let settings = Settings {
            sex: crate::body::Sex::Male,
            mass_kg: Some(MASS_KG),
            ..Settings::for_height(HEIGHT_M)
        };
        let person = Person::real();
        StageFixture {
            subject: filter_updates::subject(&person, &settings),
            settings,
            person,
            streams: Streams {
                suit_period_ns: PERIOD_NS,
                ground_period_ns: PERIOD_NS,
                lag_sigma_s: 0.0,
                lag_is_off: false,
                suit_suspect: Zeroable::zeroed(),
                ground_suspect: Zeroable::zeroed(),
                ground_gap_ns: 0,
                ground_resumed_ns: 0,
                ground_late_ns: 0,
                moved_ns: 0,
            },
            align: bytemuck::zeroed_box(),
            placement: bytemuck::zeroed_box(),
            history: bytemuck::zeroed_box(),
            ground: bytemuck::zeroed_box(),
            window: bytemuck::zeroed_box(),
            prediction: bytemuck::zeroed_box(),
            load: bytemuck::zeroed_box(),
            time_ns: NS_PER_S,
            shear_n: 0.0,
        }
    }

    /// The next instant, once the samples after it arrived; the plate carries `vertical_n`.
    fn instant(&mut self, vertical_n: Option<f64>) -> Instant {
        loop {
            self.time_ns += PERIOD_NS;
            let pose = self.person.pose(&postures()[0]);
            let in_suit_world = Pose::new(pose.origin, pose.world_from_segment);
            let body = self.subject.anthropometry();
            let mut snapshot = Snapshot::new(self.time_ns, &in_suit_world, &pose, body);
            snapshot.both_feet_stand = 1;
            if let Some(vertical_n) = vertical_n {
                snapshot.has_ground = 1;
                snapshot.ground = GroundSample {
                    sample_time_ns: self.time_ns,
                    force_n: [self.shear_n, 0.0, vertical_n],
                    moment_nm: [0.0, -0.05 * vertical_n, 0.0],
                    ..Zeroable::zeroed()
                };
            }
            self.history.push(snapshot);
            let next = differentiate(
                &self.settings,
                &mut self.history,
                &self.align,
                &self.placement,
                &self.subject,
                None,
            );
            if let Some(instant) = next {
                return instant;
            }
        }
    }

    fn measured(&mut self, vertical_n: Option<f64>) -> (Instant, Ground) {
        let instant = self.instant(vertical_n);
        let ground = measure_ground(&self.settings, &mut self.ground, &instant, &self.subject, &self.streams);
        (instant, ground)
    }

    fn predicted(&mut self, vertical_n: Option<f64>) -> (Instant, Ground, Stillness, Prediction) {
        let (instant, ground) = self.measured(vertical_n);
        let stillness = detect_static(&self.settings, &mut self.window, &instant, &ground, &self.streams);
        let prediction = predict_unloaded(
            &self.settings,
            &mut self.prediction,
            &instant,
            &ground,
            &stillness,
            &self.subject,
            &self.history,
        );
        (instant, ground, stillness, prediction)
    }
}

const WEIGHT_N: f64 = MASS_KG * GRAVITY_M_PER_S2;

#[test]
fn a_silent_ground_holds_its_last_reading_and_is_stale() {
    let mut fixture = StageFixture::new();
    let (_, before) = fixture.measured(Some(WEIGHT_N));
    assert_eq!(before.invalid, Validity::default());
    assert_eq!(before.standing_m, Some([0.05, 0.0]));
    for _ in 0..8 {
        fixture.measured(Some(WEIGHT_N));
    }
    let mut last = fixture.measured(None).1;
    for _ in 0..8 {
        last = fixture.measured(None).1;
    }
    assert_eq!(last.reading.force_n, before.reading.force_n);
    assert_eq!(last.standing_m, None);
    assert_eq!(last.invalid, Validity::GROUND_STALE.and(Validity::FEET_OFF_PLATE));
}

#[test]
fn an_implausible_ground_has_a_reading_and_no_standing_subject() {
    let mut fixture = StageFixture::new();
    let (instant, _) = fixture.measured(Some(WEIGHT_N));
    fixture.streams.ground_suspect.add(instant.snapshot.time_ns, instant.snapshot.time_ns + NS_PER_S);
    let (_, ground) = fixture.measured(Some(WEIGHT_N));
    assert!(ground.is_suspect() && ground.is_implausible() && ground.standing_m.is_none());
    assert_eq!(ground.reading.force_n[2], WEIGHT_N);
}

#[test]
fn a_pose_is_static_once_the_window_is_full_and_not_without_a_standing_subject() {
    let mut fixture = StageFixture::new();
    let mut still = false;
    for _ in 0..2 * WINDOW {
        still = fixture.predicted(Some(WEIGHT_N)).2.is_static;
    }
    assert!(still && fixture.window.is_full());
    for _ in 0..10 {
        still = fixture.predicted(None).2.is_static;
    }
    assert!(!still && !fixture.window.is_full());
}

#[test]
fn a_load_is_the_force_beyond_the_prediction_and_unknown_while_a_sensor_is_implausible() {
    let mut fixture = StageFixture::new();
    for (added_n, expected) in [(0.0, Validity::BELOW_LOAD_THRESHOLD), (60.0, Validity::default())] {
        for _ in 0..20 {
            fixture.predicted(Some(WEIGHT_N + added_n));
        }
        let (instant, ground, _, prediction) = fixture.predicted(Some(WEIGHT_N + added_n));
        let subject = weigh(&fixture.settings, &mut fixture.subject, &instant, &ground, &prediction);
        let estimate = estimate_cop(&fixture.settings, &instant, &prediction, subject);
        let subject = update_from_static_pose(
            &fixture.settings,
            &mut fixture.subject,
            &fixture.window,
            &instant,
            &ground,
            &prediction,
            &estimate,
        );
        let loading = overload(
            &fixture.settings,
            (&mut fixture.load, &Unloaded::zeroed()),
            &instant,
            &ground,
            &prediction,
            &estimate,
            subject,
        );
        let found = loading.unwrap();
        assert!((found.delta_f_n - added_n).abs() < 1e-6, "{}", found.delta_f_n);
        assert!(found.invalid.any_of(expected) || expected == Validity::default());
        assert_eq!(found.load.is_some(), added_n > 0.0);
        let suspect = Ground { invalid: Validity::SUIT_IMPLAUSIBLE, ..ground };
        let none = overload(
            &fixture.settings,
            (&mut fixture.load, &Unloaded::zeroed()),
            &instant,
            &suspect,
            &prediction,
            &estimate,
            subject,
        );
        assert!(
            none.is_none() && Validity::INVALIDATES_DELTA_F.any_of(suspect.invalid),
            "the last one is invalid"
        );
    }
}

#[test]
fn the_constant_shear_of_a_plate_is_that_under_a_standing_subject() {
    let mut fixture = StageFixture::new();
    fixture.shear_n = 20.0;
    let mut shear_bias_after_10_s = |vertical_n: f64| {
        for _ in 0..1000 {
            fixture.predicted(Some(vertical_n));
        }
        fixture.prediction.noise.shear_bias_m_per_s2()[0]
    };
    // The first step onto the plate.
    assert_eq!(shear_bias_after_10_s(0.3 * WEIGHT_N), 0.0);
    let standing = shear_bias_after_10_s(WEIGHT_N) * MASS_KG;
    assert!((10.0..20.0).contains(&standing), "{standing} N");
}

#[test]
fn sigma_contains_the_error_of_the_suit_s_acceleration_unless_shear_is_used() {
    let sigma_m = |shear_n: f64| {
        let mut fixture = StageFixture::new();
        fixture.shear_n = shear_n;
        for _ in 0..300 {
            fixture.predicted(Some(WEIGHT_N));
        }
        fixture.prediction.noise.horizontal_activity_m_per_s2.update(2.0, 0.01);
        let (instant, ground, _, prediction) = fixture.predicted(Some(WEIGHT_N));
        assert_eq!(prediction.body.slope_is_measured, shear_n < 25.0);
        let subject = weigh(&fixture.settings, &mut fixture.subject, &instant, &ground, &prediction);
        estimate_cop(&fixture.settings, &instant, &prediction, subject).cop_sigma_m[0]
    };
    let (sigma_with_shear, sigma_with_external_force) = (sigma_m(5.0), sigma_m(60.0));
    assert!(
        sigma_with_external_force > sigma_with_shear + 0.005,
        "{sigma_with_shear} {sigma_with_external_force}"
    );
}

#[test]
fn sigma_of_the_distance_of_a_load_from_the_hands_contains_that_of_their_position() {
    let mut fixture = StageFixture::new();
    for _ in 0..20 {
        fixture.predicted(Some(WEIGHT_N + 60.0));
    }
    let (instant, ground, _, prediction) = fixture.predicted(Some(WEIGHT_N + 60.0));
    let subject = weigh(&fixture.settings, &mut fixture.subject, &instant, &ground, &prediction);
    let mut estimate = estimate_cop(&fixture.settings, &instant, &prediction, subject);
    let subject = Identified::newest(&fixture.subject);
    let mut sigma_m = |rest_m: f64| {
        estimate.stance.rest_m = [rest_m; 2];
        let force = ExternalForce { vertical_n: WEIGHT_N + 60.0, delta_f_n: 60.0, sigma_n: 2.0 };
        let carrying = Carrying {
            instant: &instant,
            ground: &ground,
            prediction: &prediction,
            estimate: &estimate,
            subject,
            force,
        };
        hold_load(&fixture.settings, &fixture.load.position, &carrying).residual_m[0].sigma
    };
    let (without, with) = (sigma_m(0.0), sigma_m(0.5));
    assert!((with * with - without * without - 0.25).abs() < 1e-9, "{without} {with}");
}

#[test]
fn a_handover_is_planned_without_the_error_of_the_stance() {
    let mut fixture = StageFixture::new();
    let sigma_m = |subject: &Identification| subject.handover_body(&fixture.settings, [0.0; 22]).cop_sigma_m;
    let before_m = sigma_m(&fixture.subject);
    fixture.subject.reset_stance_offset([0.04; 2]);
    assert_eq!(sigma_m(&fixture.subject), before_m);
}
