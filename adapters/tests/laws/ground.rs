//! Ground samples are valid for any input; parsed records can be written back.

use equipoise_adapters::ground::device::ati_rdt::{AtiRdt, RdtSettings};
use equipoise_adapters::ground::{GroundDevice, GroundProtocol, GroundSettings};
use equipoise_adapters::wire::ati_rdt::{Record, Records, Request};
use equipoise_core::message::GroundSample;

use super::choices::{Choices, pieces};

/// Every number is finite.
pub(crate) fn assert_valid(sample: &GroundSample) {
    assert!(sample.force_n.iter().chain(&sample.moment_nm).all(|number| number.is_finite()));
    assert!(sample.foot_vertical_n.iter().all(|newtons| newtons.is_finite()));
    assert!(sample.foot_cop_m.iter().flatten().all(|metres| metres.is_finite()));
    assert!(sample.surface_z_m.is_finite());
}

/// Parsed records and requests are written with the same bytes; any sequence of datagrams gives valid samples.
pub(crate) fn rdt(bytes: &[u8]) {
    if let Ok(request) = Request::parse(bytes) {
        assert_eq!(request.to_bytes(), bytes);
    }
    if let Ok(records) = Records::parse(bytes) {
        let written: Vec<u8> = records.flat_map(Record::to_bytes).collect();
        assert_eq!(written, bytes);
    }
    datagrams(|| Box::new(AtiRdt::new(RdtSettings::default())), bytes);
}

/// Any sequence of datagrams to a device: two bytes of length and one of time precede each.
pub(crate) fn datagrams(device: impl Fn() -> Box<dyn GroundDevice>, bytes: &[u8]) {
    let mut protocol = GroundProtocol::new(device(), GroundSettings::default());
    let mut choices = Choices::new(bytes);
    let (mut arrival_ns, mut samples, mut reported) = (1_000_000_000_u64, Vec::new(), 0);
    protocol.opened(arrival_ns);
    while !choices.is_empty() {
        let length = usize::from(choices.small() % 2000);
        arrival_ns += u64::from(choices.byte()) * 100_000;
        samples.clear();
        protocol.receive(choices.take(length), arrival_ns, &mut samples);
        for sample in &samples {
            assert_valid(sample);
            reported += 1;
            assert_eq!(sample.sequence, reported);
            assert!(sample.arrival_ns == arrival_ns);
        }
        let _ = (protocol.diagnostic(), protocol.next_action(arrival_ns));
    }
    assert_eq!(protocol.counts().published, reported);
}

/// A byte stream gives the same samples for any division into pieces; the first eight bytes select the pieces.
pub(crate) fn stream(device: impl Fn() -> Box<dyn GroundDevice>, bytes: &[u8]) {
    let (lengths, stream) = bytes.split_at(bytes.len().min(8));
    let whole = samples_of(device(), std::iter::once(stream));
    let parts = samples_of(device(), pieces(stream, lengths));
    assert_eq!(whole, parts);
}

/// Samples of a device for pieces that arrive at the same instant, and its counts; after abandoning a stream, the
/// device counts further data by piece.
fn samples_of<'a>(
    device: Box<dyn GroundDevice>,
    pieces: impl Iterator<Item = &'a [u8]>,
) -> (Vec<GroundSample>, Option<[u64; equipoise_core::message::health::REASONS]>) {
    const NOW_NS: u64 = 1_000_000_000;
    let mut protocol = GroundProtocol::new(device, GroundSettings::default());
    protocol.opened(NOW_NS);
    let mut samples = Vec::new();
    for piece in pieces {
        protocol.receive(piece, NOW_NS, &mut samples);
    }
    samples.iter().for_each(assert_valid);
    // The clock fit depends on the ends of pieces, so times are not compared.
    for sample in &mut samples {
        (sample.sample_time_ns, sample.sample_time_sigma_ns) = (0, 0);
    }
    let counted = protocol.diagnostic().is_none().then_some(protocol.counts().refused);
    (samples, counted)
}
