//! Simulated foot that falls on a floor with springs and dampers, measured by a plate and by a suit with another clock.

use super::*;
use proptest::prelude::*;

const NS_PER_MS: i64 = 1_000_000;
/// Integration step, s.
const STEP_S: f64 = 5e-5;

/// Acceleration from weight and leg while the foot is on the floor: a foot that was stamped down does not leap.
const LEG_M_PER_S2: f64 = 100.0;

/// Mass behind the foot (kg), its speed (m/s), stiffness (N/m) and damping (N s/m) of shoe and floor.
#[derive(Debug, Clone, Copy)]
struct Contact {
    mass_kg: f64,
    speed_m_per_s: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

const USUAL: Contact =
    Contact { mass_kg: 5.0, speed_m_per_s: 1.5, stiffness_n_per_m: 80e3, damping_n_s_per_m: 300.0 };

/// One second of a stomp: the foot is raised, falls from 0.35 s to 0.5 s, hits, and stays.
struct Stomp {
    upward_m_per_s: Vec<f64>,
    vertical_n: Vec<f64>,
}

impl Stomp {
    fn with(contact: Contact) -> Stomp {
        let (mut upward_m_per_s, mut vertical_n) = (Vec::new(), Vec::new());
        let (mut velocity, mut depth_m) = (-contact.speed_m_per_s, 0.0_f64);
        for step in 0..20_000 {
            let time_s = f64::from(step) * STEP_S;
            let (mut speed, mut force_n) = (0.0, 600.0);
            if (0.35..0.5).contains(&time_s) {
                speed = -contact.speed_m_per_s * (time_s - 0.35) / 0.15;
            } else if time_s >= 0.5 {
                let squeezed = depth_m.max(0.0);
                // No suction; the damping increases over the first 2 mm, as in a heel pad.
                let push_n = (contact.stiffness_n_per_m * squeezed
                    - contact.damping_n_s_per_m * velocity * (squeezed / 0.002).min(1.0))
                .max(0.0);
                velocity += (push_n / contact.mass_kg - LEG_M_PER_S2) * STEP_S;
                depth_m -= velocity * STEP_S;
                speed = velocity;
                force_n += push_n;
            }
            upward_m_per_s.push(speed);
            vertical_n.push(force_n);
        }
        Stomp { upward_m_per_s, vertical_n }
    }

    fn at(values: &[f64], time_s: f64) -> f64 {
        values[((time_s.max(0.0) / STEP_S) as usize).min(values.len() - 1)]
    }
}

/// Both streams of a session with stomps at these seconds, with a suit clock `offset_ns` behind the plate's.
fn session(contact: Contact, stomps_s: &[f64], suit_hz: f64, offset_ns: i64) -> (Vec<Force>, Vec<Feet>) {
    let stomp = Stomp::with(contact);
    let length_s = stomps_s.iter().fold(0.0, |a: f64, b| a.max(*b)) + 2.0;
    let now = |values: &[f64], rest: f64, time_s: f64| {
        let running = stomps_s.iter().find(|begin| (0.0..1.0).contains(&(time_s - **begin)));
        running.map_or(rest, |begin| Stomp::at(values, time_s - begin))
    };
    let ns = |time_s: f64| (time_s * 1e9) as i64 + 100_000 * NS_PER_MS;
    let mut hum = 0.7_f64;
    let plate = (0..(length_s * 1000.0) as usize).map(|index| {
        let time_s = index as f64 / 1000.0;
        // A chaotic sequence in place of noise: 3 N.
        hum = 3.9 * hum * (1.0 - hum);
        let vertical_n = now(&stomp.vertical_n, 600.0, time_s) + 12.0 * (hum - 0.5);
        Force { time_ns: ns(time_s) as u64, vertical_n }
    });
    let feet = (0..(length_s * suit_hz) as usize).map(|index| {
        let time_s = (index as f64 + 0.37) / suit_hz;
        let upward_m_per_s = [0.0, now(&stomp.upward_m_per_s, 0.0, time_s)];
        Feet { time_ns: (ns(time_s) - offset_ns) as u64, upward_m_per_s }
    });
    (plate.collect(), feet.collect())
}

#[test]
fn a_leg_that_is_thrown_down_lightens_the_plate_before_it_lands() {
    let begins_s = [1.0, 2.9, 4.3, 6.6];
    let light =
        Contact { mass_kg: 3.0, speed_m_per_s: 1.0, stiffness_n_per_m: 40e3, damping_n_s_per_m: 100.0 };
    for suit_hz in [60.0, 240.0] {
        let (mut plate, feet) = session(light, &begins_s, suit_hz, 40 * NS_PER_MS);
        for force in &mut plate {
            let time_s = (force.time_ns as i64 - 100_000 * NS_PER_MS) as f64 * 1e-9;
            let thrown = begins_s.iter().any(|begin_s| (0.42..0.455).contains(&(time_s - begin_s)));
            force.vertical_n -= if thrown { 200.0 } else { 0.0 };
        }
        let result = estimate(&plate, &feet, &settings()).unwrap();
        let off_ns = result.offset_ns - 40 * NS_PER_MS;
        assert!(
            off_ns.abs() < 2 * result.sigma_ns.cast_signed(),
            "{suit_hz} Hz: {off_ns} ns off, {result:?}"
        );
    }
}

fn settings() -> StompSettings {
    StompSettings::default()
}

#[test]
fn a_foot_on_many_grounds() {
    let contact = |mass_kg, speed_m_per_s, stiffness_n_per_m, damping_n_s_per_m| Contact {
        mass_kg,
        speed_m_per_s,
        stiffness_n_per_m,
        damping_n_s_per_m,
    };
    let contacts = [
        contact(3.0, 1.0, 40e3, 100.0),
        USUAL,
        contact(5.0, 2.5, 150e3, 300.0),
        contact(8.0, 1.5, 30e3, 200.0),
        contact(10.0, 2.0, 60e3, 500.0),
        contact(4.0, 1.2, 120e3, 100.0),
    ];
    let mut square_sum = 0.0;
    let mut count = 0.0;
    for contact in contacts {
        for suit_hz in [60.0, 120.0, 240.0] {
            let (plate, feet) = session(contact, &[0.0, 1.3, 2.9], suit_hz, 83 * NS_PER_MS);
            let found = estimate(&plate, &feet, &settings()).unwrap();
            assert_eq!(
                (found.stomps, found.plate_hits, found.foot_stops),
                (3, 3, 3),
                "{contact:?} {suit_hz}"
            );
            let off_ns = (found.offset_ns - 83 * NS_PER_MS) as f64;
            assert!(off_ns.abs() < 3.0 * found.sigma_ns as f64, "{contact:?} {suit_hz} Hz: {found:?}");
            println!("{contact:?}, {suit_hz} Hz: off by {:.2} ms", off_ns / 1e6);
            square_sum += off_ns * off_ns;
            count += 1.0;
        }
    }
    let rms_ns = f64::sqrt(square_sum / count);
    println!("off by {:.2} ms (root mean square)", rms_ns / 1e6);
    assert!(rms_ns < CONTACT_SIGMA_NS / 2.0, "{rms_ns}");
}

#[test]
fn heights_do_as_well_as_velocities() {
    let (plate, feet) = session(USUAL, &[0.0, 1.3, 2.9], 120.0, -40 * NS_PER_MS);
    let mut height_m = 0.3;
    let heights: Vec<_> = feet
        .iter()
        .map(|feet| {
            height_m += feet.upward_m_per_s[1] / 120.0;
            (feet.time_ns, [0.1, height_m])
        })
        .collect();
    let found = estimate(&plate, &feet_of_heights(&heights), &settings()).unwrap();
    assert_eq!(found.stomps, 3);
    assert!((found.offset_ns + 40 * NS_PER_MS).unsigned_abs() < 3 * found.sigma_ns, "{found:?}");
}

#[test]
fn one_stomp_is_enough_and_says_less() {
    let (plate, feet) = session(USUAL, &[0.4], 240.0, 20 * NS_PER_MS);
    let one = estimate(&plate, &feet, &settings()).unwrap();
    let (plate, feet) = session(USUAL, &[0.4, 1.7, 3.4, 4.6], 240.0, 20 * NS_PER_MS);
    let four = estimate(&plate, &feet, &settings()).unwrap();
    assert_eq!((one.stomps, four.stomps, one.residual_ns), (1, 4, 0));
    assert!(one.sigma_ns > four.sigma_ns, "{} {}", one.sigma_ns, four.sigma_ns);
}

#[test]
fn a_regular_beat_is_refused() {
    let (plate, feet) = session(USUAL, &[0.0, 1.0, 2.0, 3.0], 240.0, 0);
    // The plate's data contain only the last three stomps, the suit's only the first three.
    let plate: Vec<_> = plate.into_iter().filter(|force| force.time_ns > 101_000_000_000).collect();
    let feet: Vec<_> = feet.into_iter().filter(|feet| feet.time_ns < 103_000_000_000).collect();
    let wide = StompSettings { offset_max_ns: 10_000_000_000, ..settings() };
    // All three fit with a shift of one beat, and the data cannot exclude it: the beat should be irregular.
    let found = estimate(&plate, &feet, &wide).unwrap();
    assert!(found.stomps == 3 && (found.offset_ns - 1000 * NS_PER_MS).abs() < 12 * NS_PER_MS, "{found:?}");
    let one: Vec<_> = plate.iter().copied().filter(|force| force.time_ns < 102_300_000_000).collect();
    let Err(StompRefusal::Ambiguous { stomps, .. }) = estimate(&one, &feet, &wide) else {
        panic!("{:?}", estimate(&one, &feet, &wide));
    };
    assert_eq!(stomps, 1);
    // The limit of the offset decides.
    let near = StompSettings { offset_max_ns: 500_000_000, ..settings() };
    assert!(estimate(&one, &feet, &near).unwrap().offset_ns.abs() < 12 * NS_PER_MS);
}

#[test]
fn what_is_no_stomp_is_said() {
    let (plate, feet) = session(USUAL, &[0.5], 240.0, 0);
    let quiet: Vec<_> = plate.iter().map(|force| Force { vertical_n: 600.0, ..*force }).collect();
    let result = estimate(&quiet, &feet, &settings()).unwrap_err();
    assert!(matches!(result, StompRefusal::NoHit { largest_n: 0.0, .. }), "{result}");
    // Sitting down on the plate is slow.
    let slow: Vec<_> = plate
        .iter()
        .enumerate()
        .map(|(index, force)| Force { vertical_n: (index as f64 * 0.8).min(600.0), ..*force })
        .collect();
    assert!(matches!(estimate(&slow, &feet, &settings()), Err(StompRefusal::NoHit { .. })));
    let gentle: Vec<_> =
        feet.iter().map(|f| Feet { upward_m_per_s: f.upward_m_per_s.map(|v| v * 0.2), ..*f }).collect();
    let result = estimate(&plate, &gentle, &settings()).unwrap_err();
    assert!(matches!(result, StompRefusal::NoStop { .. }), "{result}");
    assert!(result.to_string().contains("m/s at most"), "{result}");
    let late: Vec<_> = feet.iter().map(|f| Feet { time_ns: f.time_ns + 5_000_000_000, ..*f }).collect();
    let result = estimate(&plate, &late, &settings()).unwrap_err();
    assert!(matches!(result, StompRefusal::TooFarApart { .. }), "{result}");
    let (other, _) = session(USUAL, &[0.5, 2.0, 3.7, 5.1], 240.0, 0);
    let result =
        estimate(&other, &feet, &StompSettings { offset_max_ns: 400_000_000, ..settings() }).unwrap_err();
    assert_eq!(result, StompRefusal::MostlyUnseen { stomps: 1, plate_hits: 4 });
    assert!(matches!(estimate(&[], &[], &settings()), Err(StompRefusal::NoHit { .. })));
}

#[test]
fn a_stomp_in_a_gap_is_not_used() {
    let (mut plate, feet) = session(USUAL, &[0.0, 1.3, 2.9], 240.0, 0);
    let hit_ns = 100_510_000_000_u64;
    plate.retain(|force| force.time_ns.abs_diff(hit_ns) > 100 * NS_PER_MS as u64);
    let found = estimate(&plate, &feet, &settings()).unwrap();
    assert_eq!((found.stomps, found.plate_hits, found.foot_stops), (2, 2, 3));
}

#[test]
fn long_pauses_do_not_make_a_stream_coarse() {
    let (plate, feet) = session(USUAL, &[0.0, 1.3, 2.9], 240.0, 0);
    let usual = estimate(&plate, &feet, &settings()).unwrap();
    // One sample every ten seconds before and after, more than during the stomps.
    let pauses = (1..=plate.len() as u64).map(|index| index * 10_000_000_000);
    let (before, after): (Vec<u64>, Vec<u64>) = pauses.partition(|time_ns| *time_ns < plate[0].time_ns);
    let force = |time_ns: &u64| Force { time_ns: *time_ns, vertical_n: 600.0 };
    let foot = |time_ns: &u64| Feet { time_ns: *time_ns, upward_m_per_s: [0.0; 2] };
    let after: Vec<u64> =
        after.into_iter().filter(|time_ns| *time_ns > plate[plate.len() - 1].time_ns).collect();
    let plate: Vec<_> = before.iter().map(force).chain(plate).chain(after.iter().map(force)).collect();
    let feet: Vec<_> = before.iter().map(foot).chain(feet).chain(after.iter().map(foot)).collect();
    assert_eq!(estimate(&plate, &feet, &settings()), Ok(usual));
}

#[test]
fn stomps_at_the_end_of_time_are_stomps_like_others() {
    let (mut plate, mut feet) = session(USUAL, &[0.0, 1.3, 2.9], 240.0, 0);
    // The plate's last hit is closer to the end than hits are to each other.
    plate.retain(|force| force.time_ns < 103_460_000_000);
    feet.retain(|feet| feet.time_ns < 103_460_000_000);
    let usual = estimate(&plate, &feet, &settings()).unwrap();
    assert_eq!(usual.stomps, 3);
    let left_ns = u64::MAX - plate.iter().map(|force| force.time_ns).max().unwrap();
    plate.iter_mut().for_each(|force| force.time_ns += left_ns);
    feet.iter_mut().for_each(|feet| feet.time_ns = feet.time_ns.saturating_add(left_ns));
    let last = estimate(&plate, &feet, &settings()).unwrap();
    assert_eq!((last.stomps, last.plate_hits, last.foot_stops), (3, usual.plate_hits, usual.foot_stops));
    assert!((last.offset_ns - usual.offset_ns).abs() <= 1, "{last:?} {usual:?}");
    // The clocks are farther apart than the largest offset.
    let (_, feet) = session(USUAL, &[0.0, 1.3, 2.9], 240.0, 0);
    assert!(matches!(estimate(&plate, &feet, &settings()), Err(StompRefusal::TooFarApart { .. })));
    // A hit at the end of the data.
    let times = [u64::MAX - 1_000_000, u64::MAX];
    let plate =
        [(times[0], 0.0), (times[1], 1000.0)].map(|(time_ns, vertical_n)| Force { time_ns, vertical_n });
    let feet = times.map(|time_ns| Feet { time_ns, upward_m_per_s: [-2.0, 0.0] });
    assert!(estimate(&plate, &feet, &settings()).is_err());
}

proptest! {
    /// A shift of one clock changes the offset by the same amount and nothing else.
    #[test]
    fn the_offset_follows_the_clock(shift_ms in -900_i64..900) {
        let (plate, feet) = session(USUAL, &[0.0, 1.3, 2.9], 240.0, 0);
        let still = estimate(&plate, &feet, &settings()).unwrap();
        let moved: Vec<_> = feet
            .iter()
            .map(|feet| Feet { time_ns: feet.time_ns.saturating_add_signed(-shift_ms * NS_PER_MS), ..*feet })
            .collect();
        let found = estimate(&plate, &moved, &settings()).unwrap();
        // Rounding to whole nanoseconds is towards zero.
        prop_assert!((found.offset_ns - still.offset_ns - shift_ms * NS_PER_MS).abs() <= 1, "{found:?} {still:?}");
        prop_assert_eq!(StompOffset { offset_ns: 0, ..found }, StompOffset { offset_ns: 0, ..still });
    }

    /// For arbitrary numbers and times: no panic, and an offset within the limit.
    #[test]
    fn anything_is_borne(
        plate in proptest::collection::vec((any::<u64>(), any::<f64>()), 0..60),
        feet in proptest::collection::vec((any::<u64>(), any::<[f64; 2]>()), 0..60),
        near: bool,
    ) {
        let time_ns = |ns: u64| if near { ns % 1_000_000_000 } else { ns };
        let plate: Vec<_> =
            plate.into_iter().map(|(ns, vertical_n)| Force { time_ns: time_ns(ns), vertical_n }).collect();
        let heights: Vec<_> = feet.iter().map(|(ns, heights)| (time_ns(*ns), *heights)).collect();
        let feet: Vec<_> = feet
            .iter()
            .map(|(ns, upward_m_per_s)| Feet { time_ns: time_ns(*ns), upward_m_per_s: *upward_m_per_s })
            .collect();
        for feet in [feet, feet_of_heights(&heights)] {
            if let Ok(found) = estimate(&plate, &feet, &settings()) {
                prop_assert!(found.offset_ns.unsigned_abs() <= settings().offset_max_ns);
            }
        }
    }
}
