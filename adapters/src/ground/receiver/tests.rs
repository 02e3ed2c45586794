use super::*;
use crate::ground::frame::Wrench;

const NS_PER_MS: u64 = 1_000_000;

fn reading(force_n: f64, sequence: Option<u32>) -> DecoderEvent {
    let tick = sequence.map_or(Tick::Uncounted, Tick::Counter);
    let load = Load::Wrench(Wrench { force_n: [0.0, 0.0, force_n], moment_nm: [0.0; 3] });
    DecoderEvent::Reading(Reading { sequence, tick, device_counter: 0, status: 0, load })
}

/// One delivery every 10 ms.
fn run(events: impl IntoIterator<Item = DecoderEvent>) -> (Vec<GroundSample>, GroundReceiver) {
    let (mut receiver, mut samples) = (GroundReceiver::new(GroundSettings::default()), Vec::new());
    for (index, event) in events.into_iter().enumerate() {
        let mut decoded = Decoded { events: vec![event], block_latency_ns: None };
        receiver.receive(&mut decoded, 1000 * NS_PER_MS + index as u64 * 10 * NS_PER_MS, &mut samples);
    }
    (samples, receiver)
}

#[test]
fn readings_of_no_use_take_their_time_where_nothing_but_their_coming_counts() {
    let refused = |index: usize| index % 50 >= 45;
    let force_n = |index: usize| match index % 50 {
        45 | 47 => f64::NAN,
        46 => f64::INFINITY,
        48 | 49 => 1e6,
        _ => -700.0,
    };
    let (samples, receiver) = run((0..400).map(|index| reading(force_n(index), None)));
    let used: Vec<usize> = (0..400).filter(|index| !refused(*index)).collect();
    assert_eq!((samples.len(), receiver.counts().lost), (used.len(), 0));
    for sample in &samples {
        let off_ns = sample.sample_time_ns.abs_diff(sample.arrival_ns);
        assert!(off_ns < NS_PER_MS, "{off_ns} ns off at {}", sample.arrival_ns);
    }
    assert!(samples.iter().all(|sample| sample.session == 0));
}

#[test]
fn a_reading_of_no_use_is_refused_and_not_lost() {
    let (samples, receiver) = run([
        reading(-700.0, Some(10)),
        reading(f64::NAN, Some(11)),
        reading(-700.0, Some(12)),
        reading(1e6, Some(14)),
        reading(1e6, Some(14)),
        reading(-700.0, Some(15)),
    ]);
    let refused = |refusal: GroundRefusal| receiver.counts().refused[refusal.index()];
    assert_eq!((samples.len(), receiver.counts().lost), (3, 1), "13 never came");
    assert_eq!((refused(GroundRefusal::NotFinite), refused(GroundRefusal::Implausible)), (1, 1));
    assert_eq!(refused(GroundRefusal::Duplicate), 1);
}

#[test]
fn a_counter_that_jumps_ahead_begins_a_clock_epoch_and_no_session() {
    let jump = |index: u32| if index < 300 { index } else { index + 100 };
    let (samples, _) = run((0..600).map(|index| reading(-700.0, Some(jump(index)))));
    for (index, sample) in samples.iter().enumerate() {
        assert_eq!((sample.clock_epoch, sample.session), (u32::from(index >= 300), 0), "{index}");
    }
}
