use super::*;
use crate::cycle::Settings;
use crate::cycle::tests::bench::Person;
use crate::frame::wxyz;

const MS_NS: u64 = 1_000_000;

/// A plate at 1 kHz with a person of 72 kg who shifts their weight, with noise of 1 N and 1 mm.
struct Plate {
    watch: Plausibility,
    before: Option<GroundSample>,
    millisecond: u64,
    /// The suit is silent from this time on.
    silent_from: u64,
}

impl Plate {
    fn new() -> Plate {
        let mut watch: Plausibility = Zeroable::zeroed();
        // A suit that never repeats a pose.
        watch.poses.readings = 1.0;
        let mut plate = Plate { watch, before: None, millisecond: 1000, silent_from: u64::MAX };
        plate.feed(3000, |_, _| {});
        plate
    }

    fn truth(millisecond: u64) -> GroundSample {
        let turn = millisecond as f64 * 1e-3 * core::f64::consts::TAU;
        let noise = |seed: u64| {
            let bits = (millisecond * 8 + seed).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            (bits >> 40) as f64 / (1 << 24) as f64 - 0.5
        };
        let vertical_n = 706.0 + 120.0 * math::sin_cos(0.7 * turn).0 + 2.0 * noise(1);
        let [x, y] = [0.1 + 0.05 * math::sin_cos(0.4 * turn).0, -0.2 + 0.04 * math::sin_cos(0.3 * turn).0];
        GroundSample {
            sample_time_ns: millisecond * MS_NS,
            force_n: [3.0 * noise(2), 3.0 * noise(3), vertical_n],
            moment_nm: [y * vertical_n + noise(4), -x * vertical_n + noise(5), noise(6)],
            ..Zeroable::zeroed()
        }
    }

    /// Feeds this many milliseconds; returns the number of samples accepted.
    fn feed(&mut self, milliseconds: u64, fault: impl Fn(u64, &mut GroundSample)) -> u64 {
        let mut accepted = 0;
        for index in 0..milliseconds {
            self.millisecond += 1;
            let mut sample = Plate::truth(self.millisecond);
            if self.millisecond < self.silent_from {
                self.watch.newest_reading_ns = self.now_ns();
            }
            fault(index, &mut sample);
            accepted += u64::from(self.watch.check_ground(&sample, self.before.as_ref()));
            self.before = Some(sample);
        }
        accepted
    }

    fn now_ns(&self) -> u64 {
        self.millisecond * MS_NS
    }
}

fn scaled(by: f64) -> impl Fn(u64, &mut GroundSample) {
    move |_, sample| sample.force_n.iter_mut().chain(&mut sample.moment_nm).for_each(|value| *value *= by)
}

#[test]
fn a_plate_under_a_working_subject_is_accepted() {
    assert_eq!(Plate::new().feed(20_000, |_, _| {}), 20_000);
}

#[test]
fn samples_of_one_delivery_are_accepted_before_the_clock_is_synchronised() {
    // A plate at 200 Hz: eight samples wait and arrive 50 µs apart, then the line is still late by some ms.
    for (sigma_ns, since_ns) in [(u64::MAX, 50_000), (6 * MS_NS, 50_000), (6 * MS_NS, 0)] {
        let mut plate = Plate { watch: Zeroable::zeroed(), ..Plate::new() };
        let begun_ns = plate.now_ns();
        let mut accepted = 0;
        for sample in 0..8 {
            accepted += plate.feed(1, |_, ground| {
                *ground = Plate::truth(begun_ns / MS_NS + 5 * sample);
                ground.sample_time_ns = begun_ns + sample * since_ns;
                ground.sample_time_sigma_ns = sigma_ns;
            });
        }
        assert_eq!(accepted, 8, "{sigma_ns} {since_ns}");
    }
}

#[test]
fn a_glitch_is_suspect_from_its_beginning_for_less_than_half_a_second() {
    for by in [2.0, 0.5, 5.0] {
        let mut plate = Plate::new();
        let begun_ns = plate.now_ns() + MS_NS;
        assert_eq!(plate.feed(20, scaled(by)), 0, "{by}");
        assert!(plate.watch.ground.overlaps(begun_ns, begun_ns), "{by}");
        assert!(!plate.watch.ground.overlaps(0, begun_ns - 10 * MS_NS), "what was before is sound");
        plate.feed(450, |_, _| {});
        assert_eq!(plate.feed(1000, |_, _| {}), 1000, "{by}");
    }
}

#[test]
fn a_gain_that_changes_is_suspect_until_it_reverts_or_the_weight_agrees() {
    for by in [2.0, 0.5, 0.8, 1.2] {
        let mut plate = Plate::new();
        assert_eq!(plate.feed(8000, scaled(by)), 0, "{by}");
        plate.feed(2500, |_, _| {});
        assert_eq!(plate.feed(1000, |_, _| {}), 1000, "{by}: it is back");
        plate.feed(8000, scaled(by));
        for _ in 0..120 {
            plate.watch.ingest_weight_agreement(Some(true), 0.01);
        }
        assert!(plate.feed(100, scaled(by)) > 0, "{by}: the weight agrees");
    }
}

#[test]
fn a_tenth_more_from_one_sample_to_the_next_is_suspect() {
    let mut plate = Plate::new();
    assert_eq!(plate.feed(1900, scaled(1.1)), 0);
}

#[test]
fn a_weight_agreement_before_a_jump_does_not_end_it() {
    let mut plate = Plate::new();
    plate.feed(8000, scaled(1.2));
    for _ in 0..300 {
        plate.watch.ingest_weight_agreement(Some(true), 0.01);
    }
    plate.feed(1000, scaled(1.2));
    plate.feed(100, scaled(1.5));
    plate.watch.ingest_weight_agreement(Some(true), 0.01);
    assert_eq!(plate.feed(1000, scaled(1.5)), 0);
}

#[test]
fn a_gap_does_not_end_a_jump() {
    let mut plate = Plate::new();
    plate.feed(1000, scaled(1.5));
    for _ in 0..90 {
        plate.watch.ingest_weight_agreement(Some(true), 0.01);
    }
    plate.millisecond += 500;
    plate.feed(30, scaled(1.5));
    plate.watch.ingest_weight_agreement(Some(true), 0.5);
    assert_eq!(plate.feed(3000, scaled(1.5)), 0, "the agreement before the gap does not count");
    plate.watch.ingest_weight_agreement(Some(true), 0.6);
    assert_eq!(plate.feed(1000, scaled(1.5)), 1000, "the weight agrees");
}

#[test]
fn noise_that_has_ended_does_not_mask_a_jump() {
    let mut plate = Plate::new();
    let noisy = |index: u64, sample: &mut GroundSample| {
        sample.force_n[2] += if index.is_multiple_of(2) { 200.0 } else { -200.0 };
    };
    plate.feed(5000, noisy);
    plate.feed(10_000, |_, _| {});
    assert_eq!(plate.feed(500, scaled(1.2)), 0);
}

#[test]
fn a_centre_of_pressure_that_jumps_is_suspect() {
    let mut plate = Plate::new();
    let mirrored = |_: u64, sample: &mut GroundSample| sample.moment_nm = sample.moment_nm.map(|nm| -nm);
    assert_eq!(plate.feed(4000, mirrored), 0);
}

#[test]
fn one_stuck_channel_is_suspect_while_the_suit_moves_and_not_while_nothing_does() {
    let mut plate = Plate::new();
    let stuck = |_: u64, sample: &mut GroundSample| sample.force_n[2] = 706.0;
    assert!(plate.feed(400, stuck) < 10);
    let mut still = Plate::new();
    still.watch.poses.run = 1;
    assert_eq!(still.feed(400, |_, sample| sample.force_n[0] = 1.5), 400);
    let mut unseen = Plate::new();
    unseen.silent_from = unseen.millisecond;
    unseen.feed(150, |_, _| {});
    // Stuck at the present value: another level would be a jump.
    let level_n = Plate::truth(unseen.millisecond).force_n[2];
    let stuck = |_: u64, sample: &mut GroundSample| sample.force_n[2] = level_n;
    assert_eq!(unseen.feed(400, stuck), 400, "a suit that is silent shows no motion");
}

#[test]
fn a_plate_that_pulls_is_suspect() {
    assert_eq!(Plate::new().feed(100, scaled(-1.0)), 0);
}

/// A suit sample of a person in one of the bench's postures, moved slightly by each number.
fn suit(person: &Person, number: u64) -> SuitSample {
    let pose = person.pose(&crate::cycle::tests::bench::postures()[5]);
    let mut sample: SuitSample = Zeroable::zeroed();
    sample.sample_time_ns = 1_000_000_000 + number * 10 * MS_NS;
    sample.position_m = pose.origin.map(Into::into);
    sample.orientation_wxyz = pose.world_from_segment.map(|rotation| wxyz(&rotation));
    let (drift_m, _) = math::sin_cos(0.05 * number as f64);
    sample.position_m.iter_mut().for_each(|position_m| position_m[0] += 0.02 * drift_m);
    sample
}

fn bones(person: &Person) -> Bones {
    Bones {
        skeleton: person.skeleton,
        limbs_alone: false,
        gap_max_m: JOINT_GAP_MAX_M,
        rms_max_m: GAPS_RMS_MAX_M,
    }
}

/// Feeds 600 poses, then `poses` with a fault; returns how many of those were accepted.
fn accepted(poses: u64, fault: impl Fn(u64, &mut SuitSample)) -> (u64, Plausibility) {
    let (person, mut watch) = (Person::real(), Plausibility::zeroed());
    let (mut before, mut count): (Option<SuitSample>, u64) = (None, 0);
    for number in 0..600 + poses {
        let mut sample = suit(&person, number);
        if number >= 600 {
            fault(number, &mut sample);
        }
        // A plate that shows motion of the body.
        watch.jumps.set_newest_vertical_n(700.0 + 5.0 * number as f64);
        let is_accepted = watch.check_suit(&sample, before.as_ref(), &bones(&person));
        assert!(number >= 600 || is_accepted, "{number}");
        if is_accepted {
            before = Some(sample);
        }
        count += u64::from(number >= 600 && is_accepted);
    }
    (count, watch)
}

#[test]
fn poses_that_repeat_jump_or_break_joints_are_rejected() {
    let still = suit(&Person::real(), 599);
    let frozen = |_: u64, sample: &mut SuitSample| {
        (sample.position_m, sample.orientation_wxyz) = (still.position_m, still.orientation_wxyz);
    };
    let (count, watch) = accepted(100, frozen);
    assert!(count <= 1 && watch.suit.overlaps(0, u64::MAX), "{count} samples of a frozen suit are accepted");
    let twice = |number: u64, sample: &mut SuitSample| {
        if number == 650 {
            let before = suit(&Person::real(), 649);
            (sample.position_m, sample.orientation_wxyz) = (before.position_m, before.orientation_wxyz);
        }
    };
    let (count, watch) = accepted(100, twice);
    assert!(count >= 99 && !watch.suit.overlaps(0, u64::MAX), "a pose that was sent twice is no failure");
    let untwisted = |_: u64, sample: &mut SuitSample| sample.orientation_wxyz = [[1.0, 0.0, 0.0, 0.0]; 23];
    assert_eq!(accepted(100, untwisted).0, 0);
    let larger = |_: u64, sample: &mut SuitSample| {
        sample.position_m.iter_mut().flatten().for_each(|metres| *metres *= 1.2);
    };
    assert_eq!(accepted(100, larger).0, 0);
    let aside = |number: u64, sample: &mut SuitSample| {
        if number == 650 {
            sample.position_m.iter_mut().for_each(|position_m| position_m[1] += 0.5);
        }
    };
    assert_eq!(accepted(100, aside).0, 99, "one sample aside");
}

#[test]
fn a_segment_that_turns_faster_than_any_body_is_suspect() {
    // Arms that hang: no position shows a turn of the forearm about its own axis.
    let turned_at = |number: u64, by_rad: f64| {
        accepted(100, |now, sample| {
            if now >= number {
                let orientation = &mut sample.orientation_wxyz[Segment::LeftForearm.index()];
                let [w, x, y, z] = *orientation;
                let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), by_rad);
                *orientation = wxyz(
                    &(nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
                        * turn),
                );
            }
        })
    };
    // 100 Hz.
    let (count, watch) = turned_at(650, 0.9);
    assert_eq!(count, 100, "the samples are used");
    let at_ns = 1_000_000_000 + 650 * 10 * MS_NS;
    assert!(watch.suit.overlaps(at_ns, at_ns) && !watch.suit.overlaps(at_ns + 1, u64::MAX));
    assert!(!turned_at(650, 0.5).1.suit.overlaps(0, u64::MAX), "an arm can do that");
}

#[test]
fn a_repeated_pose_of_a_moving_body_is_dropped_even_with_a_static_plate() {
    let (person, mut watch) = (Person::real(), Plausibility::zeroed());
    let mut before: Option<SuitSample> = None;
    let mut check_one = |number: u64, moved: u64| {
        let mut sample = suit(&person, 0);
        sample.sample_time_ns += number * 10 * MS_NS;
        sample.position_m.iter_mut().for_each(|position_m| position_m[0] += 0.003 * moved as f64);
        watch.jumps.set_newest_vertical_n(700.0);
        let is_accepted = watch.check_suit(&sample, before.as_ref(), &bones(&person));
        before = if is_accepted { Some(sample) } else { before };
        is_accepted
    };
    assert!((0..600).all(|number| check_one(number, number)));
    let accepted = (600..620).map(|number| u64::from(check_one(number, 599)));
    assert_eq!(accepted.sum::<u64>(), 11, "after 0.1 s it is a body that stands");
}

#[test]
fn a_body_that_stays_after_a_jump_is_in_another_world() {
    let aside = |_: u64, sample: &mut SuitSample| {
        sample.position_m.iter_mut().for_each(|position_m| position_m[1] += 0.5);
    };
    let (count, watch) = accepted(100, aside);
    assert_eq!((count, watch.moved_ns), (99, 1_000_000_000 + 601 * 10 * MS_NS));
    let none = accepted(100, |_, _| {});
    assert_eq!((none.0, none.1.moved_ns), (100, 0));
}

#[test]
fn before_bone_lengths_are_available_nominal_ones_apply() {
    let settings = Settings::for_height(1.77);
    let mut subject = bytemuck::zeroed_box::<Identification>();
    subject.start(&settings);
    let (mut watch, bones) = (Plausibility::zeroed(), Bones::of(&subject, &settings));
    let mut sample = suit(&Person::real(), 0);
    assert!(watch.check_suit(&sample, None, &bones));
    sample.orientation_wxyz = [[1.0, 0.0, 0.0, 0.0]; 23];
    assert!(!watch.check_suit(&sample, None, &bones));
}

#[test]
fn a_second_interval_keeps_the_first_one() {
    let mut span = Span::zeroed();
    assert!(!span.overlaps(0, u64::MAX));
    span.add(100 * MS_NS, 150 * MS_NS);
    span.add(150 * MS_NS + JUMP_HOLDS_NS + 1, 600 * MS_NS);
    for (at_ms, is_suspect) in [(99, false), (120, true), (200, false), (500, true), (601, false)] {
        assert_eq!(span.overlaps(at_ms * MS_NS, at_ms * MS_NS), is_suspect, "{at_ms}");
    }
    assert!(span.is_sound());
}
