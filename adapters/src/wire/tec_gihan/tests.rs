use super::*;
use proptest::prelude::*;

#[test]
fn the_known_sample_is_scaled() {
    // From the vectors in tests/data/plate_vectors.json: 50 counts of 200 N m are not exactly 1/3 N m.
    let bytes = [0x64, 0, 0x38, 0xff, 0x98, 0x3a, 0x2c, 1, 0x70, 0xfe, 0x32, 0];
    let scales = FullScales::parse(
        "1500,1500,3000,300,300,200, 3000,3000,6000,600,600,400,5000,5000,10000,1000,1000,600",
    )
    .unwrap();
    let block: Vec<u8> =
        bytes.iter().copied().cycle().take(block_size(1, Rate::of_hz(120).unwrap())).collect();
    let samples: Vec<_> = plate_samples(&block, 0, Rate::of_hz(120).unwrap()).collect();
    assert_eq!(samples.len(), 12);
    let near =
        |got: [f64; 6], want: [f64; 6]| got.iter().zip(want).all(|(got, want)| (got - want).abs() < 1e-12);
    assert!(near(scales.scaled(Range::Kn3, samples[11]), [5.0, -10.0, 1500.0, 3.0, -4.0, 1.0 / 3.0]));
    assert!(near(
        scales.scaled(Range::Kn10, samples[0])[..6].try_into().unwrap(),
        [50.0 / 3.0, -100.0 / 3.0, 5000.0, 10.0, -40.0 / 3.0, 1.0]
    ));
}

#[test]
fn lines_and_answers_are_the_makers() {
    let line = |line: Line| String::from_utf8(line.to_bytes()).unwrap();
    assert_eq!(line(Line::SetRate(Rate::of_hz(2500).unwrap())), "SPS_2.5K\n");
    assert_eq!(line(Line::SetRange(Range::Kn10)), "RANGE_10kN\n");
    assert_eq!(line(Line::FullScales(106)), "FP_0106_GETFS\n");
    assert_eq!(line(Line::SurfaceHeight(12_345)), "FP_12345_GET_AZ0\n");
    assert_eq!(line(Line::NextBlock), "DT\n");
    assert_eq!(Line::State.answer("idle\r"), Some(Answer::State(State::Idle)));
    assert_eq!(Line::State.answer("12AX"), Some(Answer::State(State::Busy)));
    assert_eq!(Line::State.answer("FPERR_3"), Some(Answer::State(State::Error)));
    assert_eq!(Line::State.answer("?"), None);
    assert_eq!(Line::SetRate(Rate::ALL[0]).answer("SPS_OK"), Some(Answer::Done));
    assert_eq!(Line::PlateCount.answer("FPCOUNT_2"), Some(Answer::Number(2)));
    assert_eq!(Line::PlateCount.answer("FPCOUNT_x"), None);
    assert_eq!(Line::PlateSerial(1).answer("FPSERIAL_1_0106"), Some(Answer::Number(106)));
    assert_eq!(Line::PlateSerial(1).answer("FPSERIAL_0_0106"), None);
    assert_eq!(Line::SurfaceHeight(1).answer("AZ0_-0.037"), Some(Answer::Metres(-0.037)));
    assert_eq!(Line::SurfaceHeight(1).answer("AZ0_nan"), None);
    for wrong in ["", "1,2", "0,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1", "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1"] {
        assert_eq!(FullScales::parse(wrong), None, "{wrong}");
    }
}

#[test]
fn blocks_last_as_long_as_the_maker_says() {
    for (hz, ms) in [(10_000, 10), (1000, 100), (250, 400), (240, 100), (120, 100)] {
        assert_eq!(Rate::of_hz(hz).unwrap().block_ns(), ms * 1_000_000);
    }
    assert_eq!(Rate::of_hz(999), None);
}

proptest! {
    #[test]
    fn every_plate_has_its_own_samples(counts in proptest::collection::vec(any::<i16>(), 3 * 12 * 6)) {
        let rate = Rate::of_hz(120).unwrap();
        let block: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
        for plate in 0..3 {
            let got: Vec<i16> = plate_samples(&block, plate, rate).flatten().collect();
            prop_assert_eq!(&got[..], &counts[plate as usize * 72..][..72]);
        }
        prop_assert_eq!(plate_samples(&block, 3, rate).count(), 0);
        prop_assert_eq!(plate_samples(&block[..100], 0, rate).count(), 0);
    }

    #[test]
    fn anything_may_be_answered(text: String) {
        for line in [Line::State, Line::PlateCount, Line::PlateSerial(0), Line::SurfaceHeight(1), Line::FullScales(1)] {
            let _ = line.answer(&text);
            let _ = line.answer(&format!("FS_{text}"));
        }
    }
}
