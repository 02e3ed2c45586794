//! Suit samples are valid for any input.

use equipoise_adapters::suit::{SuitAssembler, SuitSettings};
use equipoise_core::message::SuitSample;

use super::choices::Choices;
use super::seeds::{self, Part};

/// Every number is finite, every orientation a rotation.
pub(crate) fn assert_valid(sample: &SuitSample) {
    for quaternion in sample.orientation_wxyz {
        let norm: f64 = quaternion.iter().map(|part| part * part).sum();
        assert!((norm - 1.0).abs() < 1e-9, "{quaternion:?}");
    }
    let vectors = [
        sample.position_m,
        sample.velocity_m_per_s,
        sample.acceleration_m_per_s2,
        sample.angular_velocity_rad_per_s,
    ];
    assert!(vectors.iter().flatten().flatten().all(|number| number.is_finite()));
    assert!(sample.joint_angle_deg.iter().flatten().chain(&sample.com_m).all(|number| number.is_finite()));
}

/// Any sequence of datagrams, valid, damaged, late, duplicated or of another format: samples are valid and numbered,
/// their sessions do not decrease, and every datagram is counted.
pub(crate) fn assembler(bytes: &[u8]) {
    let mut choices = Choices::new(bytes);
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    let (mut arrival_ns, mut counter, mut fed) = (1_000_000_000_u64, 0_u32, 0_u64);
    let mut before: Option<SuitSample> = None;
    while !choices.is_empty() && fed < 2000 {
        let kind = choices.byte();
        arrival_ns += u64::from(choices.byte()) * 500_000;
        counter = match choices.byte() {
            step @ 0..=200 => counter.wrapping_add(u32::from(step % 4)),
            201..=220 => counter.wrapping_sub(2),
            _ => u32::from(choices.small()) << 16,
        };
        let datagram = if kind == u8::MAX {
            let length = usize::from(choices.small() % 1000);
            choices.take(length).to_vec()
        } else {
            let part = Part::ALL[usize::from(kind) % Part::ALL.len()];
            let mut datagram = seeds::part(part, counter, f64::from(counter) / 240.0);
            // Two thirds are unmodified.
            for _ in 0..choices.byte() / 86 {
                let at = usize::from(choices.small()) % datagram.len();
                datagram[at] = choices.byte();
            }
            datagram
        };
        fed += 1;
        let mut sample = assembler.receive(&datagram, arrival_ns);
        while let Some(complete) = sample {
            assert_valid(&complete);
            if let Some(before) = before {
                assert_eq!(complete.sequence, before.sequence + 1);
                assert!(complete.session >= before.session);
                assert!(complete.arrival_ns >= before.arrival_ns);
            }
            before = Some(complete);
            sample = assembler.take_ready();
        }
    }
    let counts = assembler.counts();
    assert_eq!(counts.received, fed);
    assert_eq!(counts.published, before.map_or(0, |sample| sample.sequence));
}
