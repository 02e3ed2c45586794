//! Number of suits that one core could read: a second of MVN's full stream (240 Hz; types 02, 20 to 25) through the
//! assembler, compared with a copy of the same bytes, which every receiver has to make.
//!
//! `cargo bench -p equipoise-benches --bench suit_stream`; figures in `docs/realtime.md`.

mod stream;

use std::hint::black_box;

use equipoise_adapters::suit::{SuitAssembler, SuitSettings};
use equipoise_adapters::wire::mvn::StreamCutter;
use equipoise_benches::rounds::{Contender, compare};

use stream::{RATE_HZ, Stream};

/// Required throughput, seconds of stream per second of one core.
const WANTED: f64 = 100.0;

/// Feeds a second of datagrams; returns the number of samples.
fn assemble(assembler: &mut SuitAssembler, stream: &mut Stream) -> usize {
    let mut samples = 0;
    for (datagram, arrival_ns) in stream.next_second() {
        let mut sample = assembler.receive(datagram, arrival_ns);
        while let Some(complete) = sample {
            black_box(&complete);
            samples += 1;
            sample = assembler.take_ready();
        }
    }
    samples
}

/// Ratios are meaningful only if everything is read: every sample arrives, with every block, and nothing is refused.
fn check(gloves: bool) {
    let (mut assembler, mut stream) = (SuitAssembler::new(SuitSettings::default()), Stream::new(gloves));
    for second in 0..3 {
        let samples = assemble(&mut assembler, &mut stream);
        // The first samples wait for a following one, until the set of types is known.
        assert!(samples + 1 >= RATE_HZ, "{samples} samples in second {second}");
    }
    let counts = assembler.counts();
    assert_eq!((counts.lost, counts.refused.iter().sum::<u64>()), (0, 0), "{counts:?}");
    let (mut cutter, mut cuts) = (StreamCutter::new(), 0);
    cut(&mut cutter, &stream.bytes(), &mut |_| cuts += 1);
    assert_eq!((cuts, cutter.skipped_bytes()), (stream.datagrams(), 0));
}

/// Cuts a second of a byte stream that arrives in pieces of TCP size.
fn cut(cutter: &mut StreamCutter, bytes: &[u8], each: &mut dyn FnMut(&[u8])) {
    for piece in bytes.chunks(1448) {
        cutter.push(piece);
        while cutter.advance().is_some() {
            each(cutter.datagram());
        }
    }
}

fn bench(criterion: &mut criterion::Criterion, gloves: bool) {
    check(gloves);
    let (mut assembler, mut fed) = (SuitAssembler::new(SuitSettings::default()), Stream::new(gloves));
    let mut copied = Stream::new(gloves);
    let datagrams = fed.datagrams();
    let mut buffer = vec![0u8; 65_536];
    let (mut cutter, bytes) = (StreamCutter::new(), Stream::new(gloves).bytes());
    let mut contenders = [
        Contender::new("SuitAssembler, a second of datagrams", || {
            black_box(assemble(&mut assembler, &mut fed));
        }),
        Contender::new("memcpy of the same bytes", || {
            for (datagram, _) in copied.next_second() {
                buffer[..datagram.len()].copy_from_slice(datagram);
                black_box(&mut buffer);
            }
        }),
        Contender::new("StreamCutter, the same as a byte stream", || {
            cut(&mut cutter, &bytes, &mut |datagram| {
                black_box(datagram);
            });
        }),
    ];
    let with = if gloves { "with gloves" } else { "without gloves" };
    let medians_us = compare(criterion, &format!("suit stream, {with}"), &mut contenders);
    let [assembled_us, copied_us, cut_us] = medians_us[..] else { return };
    let kilobytes = bytes.len() as f64 / 1e3;
    let times = |us: f64| 1e6 / us;
    println!(
        "{with}: {datagrams} datagrams, {kilobytes:.0} kB a second; one core reads {:.0} × real time from datagrams, {:.0} × \
         from a byte stream; {:.1} × memcpy ({WANTED:.0} × wanted: {})\n",
        times(assembled_us),
        times(assembled_us + cut_us),
        assembled_us / copied_us,
        if times(assembled_us + cut_us) >= WANTED { "yes" } else { "no" }
    );
}

fn main() {
    let mut criterion = equipoise_benches::criterion();
    bench(&mut criterion, false);
    bench(&mut criterion, true);
    criterion.final_summary();
}
