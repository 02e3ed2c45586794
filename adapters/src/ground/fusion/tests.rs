use super::*;
use bytemuck::Zeroable;
use proptest::prelude::*;

const NS_PER_MS: u64 = 1_000_000;

fn plate(device: DeviceKind, time_ns: u64, force_n: [f64; 3], at_m: [f64; 2]) -> GroundSample {
    let [x, y] = at_m;
    let [fx, fy, fz] = force_n;
    GroundSample {
        sample_time_ns: time_ns,
        sample_time_sigma_ns: 3000,
        arrival_ns: time_ns + NS_PER_MS,
        force_n,
        moment_nm: [y * fz, -x * fz, x * fy - y * fx],
        devices: device as u32,
        ..Zeroable::zeroed()
    }
}

fn first(time_ns: u64, vertical_n: f64) -> GroundSample {
    plate(DeviceKind::Plate, time_ns, [0.0, 0.0, vertical_n], [0.02, 0.15])
}

fn second(time_ns: u64, vertical_n: f64) -> GroundSample {
    plate(DeviceKind::SecondPlate, time_ns, [0.0, 0.0, vertical_n], [0.05, -0.14])
}

fn insoles(time_ns: u64, vertical_n: [f64; 2]) -> GroundSample {
    GroundSample {
        sample_time_ns: time_ns,
        sample_time_sigma_ns: 4000,
        force_n: [0.0, 0.0, vertical_n[0] + vertical_n[1]],
        per_foot: 1,
        foot_vertical_n: vertical_n,
        foot_cop_m: [[0.01, 0.004], [-0.02, 0.003]],
        foot_frame: FootFrame::Insole as u32,
        not_measured: Component::Shear as u32 | Component::Tilt as u32 | Component::FreeMoment as u32,
        devices: DeviceKind::Insoles as u32,
        ..Zeroable::zeroed()
    }
}

fn two_plates() -> Fusion {
    Fusion::new(FusionSettings::new(FusionKind::TwoPlates { left: Some(0) }, [0; 2]))
}

fn plate_and_insoles() -> Fusion {
    Fusion::new(FusionSettings::new(FusionKind::PlateAndInsoles, [0; 2]))
}

fn fused(fusion: &mut Fusion, now_ns: u64) -> Vec<GroundSample> {
    let mut samples = Vec::new();
    fusion.fused(now_ns, &mut samples);
    samples
}

fn without_partner(fusion: &Fusion) -> u64 {
    fusion.counts().refused[GroundRefusal::NoPartner.index()]
}

#[test]
fn the_sum_has_the_feet_of_its_parts_and_says_whose_they_are() {
    let mut fusion = two_plates();
    fusion.push(
        0,
        GroundSample { device_counter: 7, session: 2, clock_epoch: 4, ..first(10 * NS_PER_MS, 300.0) },
        11 * NS_PER_MS,
    );
    assert!(fused(&mut fusion, 11 * NS_PER_MS).is_empty(), "a part is not the whole");
    fusion.push(1, second(9 * NS_PER_MS, 400.0), 11 * NS_PER_MS);
    assert!(fused(&mut fusion, 11 * NS_PER_MS).is_empty(), "not held");
    fusion.push(
        1,
        GroundSample { session: 1, clock_epoch: 5, ..second(11 * NS_PER_MS, 420.0) },
        12 * NS_PER_MS,
    );
    let [whole] = fused(&mut fusion, 12 * NS_PER_MS)[..] else { panic!("one sample") };
    assert_eq!((whole.sample_time_ns, whole.force_n), (10 * NS_PER_MS, [0.0, 0.0, 710.0]));
    assert_eq!((whole.foot_vertical_n, whole.per_foot), ([300.0, 410.0], 1));
    assert_eq!(whole.devices, DeviceKind::Plate as u32 | DeviceKind::SecondPlate as u32);
    assert_eq!((whole.device_counter, whole.session, whole.clock_epoch, whole.sequence), (7, 3, 9, 1));
    // Combined σ of both, which are independent.
    assert_eq!(whole.sample_time_sigma_ns, 4243);
    for (foot, at_m) in [[0.02, 0.15], [0.05, -0.14]].into_iter().enumerate() {
        let [x, y] = whole.foot_cop_m[foot];
        assert!((x - at_m[0]).abs() < 1e-12 && (y - at_m[1]).abs() < 1e-12);
    }
    assert!(whole.feet().is_some());
}

#[test]
fn without_feet_there_is_only_the_sum_and_the_right_foot_may_come_first() {
    let mut sum = Fusion::new(FusionSettings::new(FusionKind::TwoPlates { left: None }, [0; 2]));
    let mut right_first = Fusion::new(FusionSettings::new(FusionKind::TwoPlates { left: Some(1) }, [0; 2]));
    for fusion in [&mut sum, &mut right_first] {
        fusion.push(1, second(10 * NS_PER_MS, 400.0), 10 * NS_PER_MS);
        fusion.push(0, first(10 * NS_PER_MS, 300.0), 10 * NS_PER_MS);
    }
    let whole = fused(&mut sum, 10 * NS_PER_MS)[0];
    assert_eq!((whole.force_n[2], whole.per_foot, whole.foot_vertical_n), (700.0, 0, [0.0; 2]));
    assert_eq!(fused(&mut right_first, 10 * NS_PER_MS)[0].foot_vertical_n, [400.0, 300.0]);
}

#[test]
fn one_plate_of_two_is_never_the_whole() {
    let mut fusion = two_plates();
    let mut fused_count = 0;
    // The second device is disconnected from 0.5 s to 1.5 s; both send every 2 ms.
    for step in 0..1000 {
        let now_ns = (1000 + 2 * step) * NS_PER_MS;
        fusion.push(0, first(now_ns, 300.0), now_ns);
        if !(250..750).contains(&step) {
            fusion.push(1, second(now_ns, 400.0), now_ns);
        }
        for whole in fused(&mut fusion, now_ns) {
            assert_eq!(whole.force_n[2], 700.0);
            fused_count += 1;
        }
    }
    // The samples of the silence, including those whose wait extends beyond its end.
    assert_eq!((fused_count, without_partner(&fusion)), (500, 500));
    assert_eq!(fusion.counts().published, 500);
}

#[test]
fn the_first_device_silent_leaves_nothing_of_the_second() {
    let mut fusion = two_plates();
    for step in 0..500 {
        fusion.push(1, second(step * NS_PER_MS, 400.0), step * NS_PER_MS);
        assert!(fused(&mut fusion, step * NS_PER_MS).is_empty());
    }
}

#[test]
fn the_wait_is_bounded_and_as_long_as_the_second_is_known_to_be_late() {
    let kind = FusionKind::TwoPlates { left: None };
    for (latency_ns, wait_ns) in
        [([0, 0], WAIT_NS), ([0, 80 * NS_PER_MS], WAIT_NS + 80 * NS_PER_MS), ([80 * NS_PER_MS, 0], WAIT_NS)]
    {
        let mut fusion = Fusion::new(FusionSettings::new(kind, latency_ns));
        fusion.push(0, first(0, 300.0), 0);
        assert!(fused(&mut fusion, wait_ns - 1).is_empty());
        assert_eq!(without_partner(&fusion), 0);
        assert!(fused(&mut fusion, wait_ns).is_empty());
        assert_eq!(without_partner(&fusion), 1);
    }
}

#[test]
fn what_one_does_not_measure_or_reports_as_a_fault_is_so_of_the_sum() {
    let mut fusion = two_plates();
    let shear = Component::Shear as u32;
    fusion.push(0, GroundSample { not_measured: shear, ..first(NS_PER_MS, 300.0) }, NS_PER_MS);
    fusion.push(1, GroundSample { device_status: 4, ..second(NS_PER_MS, 400.0) }, NS_PER_MS);
    let whole = fused(&mut fusion, NS_PER_MS)[0];
    assert_eq!((whole.not_measured, whole.device_status), (shear, 4));
    assert!(whole.cop_m().is_err() && whole.feet().is_none());
    let untimed = GroundSample { sample_time_sigma_ns: u64::MAX, ..first(2 * NS_PER_MS, 300.0) };
    fusion.push(0, untimed, 2 * NS_PER_MS);
    fusion.push(1, second(2 * NS_PER_MS, 400.0), 2 * NS_PER_MS);
    assert_eq!(fused(&mut fusion, 2 * NS_PER_MS)[0].sample_time_sigma_ns, u64::MAX);
}

#[test]
fn a_restarted_device_may_step_back_and_a_second_sample_of_the_same_time_may_not() {
    let mut fusion = two_plates();
    fusion.push(1, second(100 * NS_PER_MS, 400.0), 100 * NS_PER_MS);
    fusion.push(1, second(100 * NS_PER_MS, 400.0), 100 * NS_PER_MS);
    assert_eq!(fusion.counts().refused[GroundRefusal::OutOfOrder.index()], 1);
    for time_ns in [50 * NS_PER_MS, 52 * NS_PER_MS] {
        fusion.push(1, GroundSample { session: 1, ..second(time_ns, 400.0) }, 100 * NS_PER_MS);
    }
    fusion.push(0, first(51 * NS_PER_MS, 300.0), 100 * NS_PER_MS);
    assert_eq!(fused(&mut fusion, 100 * NS_PER_MS)[0].force_n[2], 700.0);
}

#[test]
fn insoles_share_what_the_plate_weighs() {
    let mut fusion = plate_and_insoles();
    fusion.push(
        0,
        GroundSample { force_n: [5.0, -3.0, 700.0], ..first(10 * NS_PER_MS, 0.0) },
        10 * NS_PER_MS,
    );
    // The insoles measure a tenth too little, and only the vertical force.
    for time_ns in [5 * NS_PER_MS, 15 * NS_PER_MS] {
        fusion.push(1, insoles(time_ns, [210.0, 420.0]), 15 * NS_PER_MS);
    }
    let whole = fused(&mut fusion, 15 * NS_PER_MS)[0];
    assert_eq!((whole.force_n, whole.not_measured), ([5.0, -3.0, 700.0], 0));
    assert!((whole.foot_vertical_n[0] - 233.333).abs() < 1e-3);
    assert!((whole.foot_vertical_n[1] - 466.667).abs() < 1e-3);
    assert_eq!((whole.foot_frame, whole.foot_cop_m[0]), (FootFrame::Insole as u32, [0.01, 0.004]));
    assert!(whole.has_feet());
    assert_eq!(whole.devices, DeviceKind::Plate as u32 | DeviceKind::Insoles as u32);
}

#[test]
fn a_plate_whose_insoles_are_off_is_still_the_whole_and_says_that_it_is_alone() {
    let mut fusion = plate_and_insoles();
    for time_ns in [5 * NS_PER_MS, 15 * NS_PER_MS] {
        fusion.push(1, insoles(time_ns, [0.0; 2]), 15 * NS_PER_MS);
    }
    fusion.push(0, first(10 * NS_PER_MS, 700.0), 15 * NS_PER_MS);
    let shoes_off = fused(&mut fusion, 15 * NS_PER_MS)[0];
    assert_eq!((shoes_off.force_n[2], shoes_off.per_foot), (700.0, 0));
    assert_eq!(shoes_off.devices, DeviceKind::Plate as u32);
    // Silent insoles: waited for at first, then no longer.
    fusion.push(0, first(20 * NS_PER_MS, 700.0), 20 * NS_PER_MS);
    assert!(fused(&mut fusion, 21 * NS_PER_MS).is_empty());
    let late = fused(&mut fusion, 20 * NS_PER_MS + WAIT_NS);
    assert_eq!((late.len(), without_partner(&fusion)), (1, 1));
    fusion.push(0, first(400 * NS_PER_MS, 700.0), 400 * NS_PER_MS);
    let alone = fused(&mut fusion, 400 * NS_PER_MS)[0];
    assert_eq!((alone.devices, alone.per_foot), (DeviceKind::Plate as u32, 0));
    // Nothing on the plate: both devices agree, so a tare has data of both feet.
    fusion.push(1, insoles(420 * NS_PER_MS, [0.0; 2]), 420 * NS_PER_MS);
    fusion.push(0, first(420 * NS_PER_MS, 12.0), 420 * NS_PER_MS);
    let empty = fused(&mut fusion, 420 * NS_PER_MS)[0];
    assert!(empty.has_feet() && empty.foot_vertical_n == [6.0, 6.0]);
}

proptest! {
    /// For arbitrary transmissions, the sum at a time equals the sum of both lines at that time, and every sample of
    /// the first device is either published or counted.
    #[test]
    fn lines_are_summed_exactly_and_nothing_is_lost_uncounted(
        phase_us in 0..5000_u64, period_us in 1000..9000_u64, slopes in proptest::array::uniform2(-200.0..200.0),
        late_us in 0..20_000_u64, lost in proptest::collection::vec(proptest::bool::weighted(0.2), 200),
    ) {
        let mut fusion = two_plates();
        let line = |device: usize, time_ns: u64| 350.0 + slopes[device] * time_ns as f64 * 1e-9;
        let mut events = Vec::new();
        for step in 0..400_u64 {
            let time_ns = step * NS_PER_MS;
            events.push((time_ns, 0, first(time_ns, line(0, time_ns))));
        }
        for (step, lost) in lost.iter().enumerate() {
            let time_ns = (phase_us + step as u64 * period_us) * 1000;
            if !lost {
                events.push((time_ns + late_us * 1000, 1, second(time_ns, line(1, time_ns))));
            }
        }
        events.sort_by_key(|(now_ns, device, _)| (*now_ns, *device));
        let (mut fused_count, mut before_ns) = (0, None);
        let mut samples = Vec::new();
        for (now_ns, device, sample) in events {
            fusion.push(device, sample, now_ns);
            fusion.fused(now_ns, &mut samples);
        }
        fusion.fused(u64::MAX, &mut samples);
        for whole in samples {
            fused_count += 1;
            let expected = line(0, whole.sample_time_ns) + line(1, whole.sample_time_ns);
            prop_assert!((whole.force_n[2] - expected).abs() < 1e-9);
            prop_assert!(before_ns.is_none_or(|before_ns| before_ns < whole.sample_time_ns));
            before_ns = Some(whole.sample_time_ns);
        }
        prop_assert_eq!(fused_count + without_partner(&fusion), 400);
    }
}

#[test]
fn a_fault_of_the_insoles_leaves_the_plate_valid() {
    let mut fusion = plate_and_insoles();
    for time_ns in [10 * NS_PER_MS, 20 * NS_PER_MS] {
        let status = u32::from(time_ns == 20 * NS_PER_MS);
        fusion.push(
            1,
            GroundSample { device_status: status, ..insoles(time_ns, [300.0, 400.0]) },
            25 * NS_PER_MS,
        );
    }
    for time_ns in [10 * NS_PER_MS, 15 * NS_PER_MS] {
        fusion.push(0, first(time_ns, 700.0), 25 * NS_PER_MS);
    }
    let [both, alone] = fused(&mut fusion, 25 * NS_PER_MS)[..] else { panic!("two samples") };
    assert_eq!((both.device_status, both.per_foot), (0, 1));
    assert_eq!((alone.device_status, alone.per_foot), (0, 0), "between a sample and a faulty one");
    assert_eq!((alone.devices, alone.force_n[2]), (DeviceKind::Plate as u32, 700.0));
    assert_eq!(without_partner(&fusion), 1);
}

#[test]
fn the_session_of_the_whole_never_falls_and_the_clock_epoch_is_the_plate_s_however_often_the_insoles_fail() {
    let mut fusion = plate_and_insoles();
    let mut sessions = Vec::new();
    for index in 0..400u64 {
        let now_ns = 1000 * NS_PER_MS + index * 10 * NS_PER_MS;
        let session = (index / 100) as u32;
        // Insoles that restart after every second and are silent for half of it.
        if index % 100 < 50 {
            let clock_epoch = 2 * session;
            fusion.push(1, GroundSample { session, clock_epoch, ..insoles(now_ns, [300.0, 400.0]) }, now_ns);
        }
        fusion.push(0, first(now_ns - 5 * NS_PER_MS, 700.0), now_ns);
        for sample in fused(&mut fusion, now_ns) {
            assert_eq!(sample.clock_epoch, 0);
            sessions.push((sample.session, sample.per_foot));
        }
    }
    assert!(sessions.is_sorted_by_key(|(session, _)| *session), "{sessions:?}");
    assert_eq!(sessions.last().map(|(session, _)| *session), Some(3));
    assert!([0, 1].iter().all(|feet| sessions.iter().any(|(_, per_foot)| per_foot == feet)));
}

/// The loop's own alignment uses the same function.
#[test]
fn a_lifted_foot_whose_zero_is_off_has_the_centre_of_its_moments() {
    let mut fusion = plate_and_insoles();
    let sole = |time_ns, left_n, x_m| GroundSample {
        foot_cop_m: [[x_m, 0.0], [0.0; 2]],
        ..insoles(time_ns, [left_n, 700.0])
    };
    fusion.push(1, sole(0, -10.0, 0.1), NS_PER_MS);
    fusion.push(1, sole(10 * NS_PER_MS, -30.0, 0.3), 11 * NS_PER_MS);
    fusion.push(0, first(5 * NS_PER_MS, 700.0), 11 * NS_PER_MS);
    let [whole] = fused(&mut fusion, 11 * NS_PER_MS)[..] else { panic!("one sample") };
    // (-10 × 0.1 - 30 × 0.3) ÷ (-10 - 30)
    assert!((whole.foot_cop_m[0][0] - 0.25).abs() < 1e-12, "{:?}", whole.foot_cop_m);
}
