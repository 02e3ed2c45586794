//! Ground samples are sound, whoever made them; records that are read are written again.

use equipoise_adapters::ground::device::ati_rdt::{AtiRdt, RdtSettings};
use equipoise_adapters::ground::{GroundBrain, GroundDevice, GroundSettings};
use equipoise_adapters::wire::ati_rdt::{Record, Records, Request};
use equipoise_core::message::GroundSample;

use super::choices::{Choices, pieces};

/// Every number is finite.
pub(crate) fn sound(sample: &GroundSample) {
    assert!(sample.force_n.iter().chain(&sample.moment_nm).all(|number| number.is_finite()));
    assert!(sample.foot_vertical_n.iter().all(|newtons| newtons.is_finite()));
    assert!(sample.foot_cop_m.iter().flatten().all(|metres| metres.is_finite()));
    assert!(sample.surface_z_m.is_finite());
}

/// Records and requests that are read are written with the same bytes; any sequence of datagrams gives sound samples.
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

/// Any sequence of datagrams to a device: two bytes of length and one of time before each.
pub(crate) fn datagrams(device: impl Fn() -> Box<dyn GroundDevice>, bytes: &[u8]) {
    let mut brain = GroundBrain::new(device(), GroundSettings::default());
    let mut choices = Choices::new(bytes);
    let (mut arrival_ns, mut samples, mut told) = (1_000_000_000_u64, Vec::new(), 0);
    brain.opened(arrival_ns);
    while !choices.is_empty() {
        let length = usize::from(choices.small() % 2000);
        arrival_ns += u64::from(choices.byte()) * 100_000;
        samples.clear();
        brain.receive(choices.take(length), arrival_ns, &mut samples);
        for sample in &samples {
            sound(sample);
            told += 1;
            assert_eq!(sample.sequence, told);
            assert!(sample.arrival_ns == arrival_ns);
        }
        let _ = (brain.trouble(), brain.wants(arrival_ns));
    }
    assert_eq!(brain.counts().published, told);
}

/// A byte stream gives the same samples in whatever pieces it comes; the first eight bytes choose the pieces.
pub(crate) fn stream(device: impl Fn() -> Box<dyn GroundDevice>, bytes: &[u8]) {
    let (lengths, stream) = bytes.split_at(bytes.len().min(8));
    let whole = samples_of(device(), std::iter::once(stream));
    let parts = samples_of(device(), pieces(stream, lengths));
    assert_eq!(whole, parts);
}

/// What a device makes of pieces that come at one instant, and what it counted of them; a stream that it has given up, and
/// says so, counts what comes after by the piece.
fn samples_of<'a>(
    device: Box<dyn GroundDevice>,
    pieces: impl Iterator<Item = &'a [u8]>,
) -> (Vec<GroundSample>, Option<[u64; equipoise_core::message::health::REASONS]>) {
    const NOW_NS: u64 = 1_000_000_000;
    let mut brain = GroundBrain::new(device, GroundSettings::default());
    brain.opened(NOW_NS);
    let mut samples = Vec::new();
    for piece in pieces {
        brain.receive(piece, NOW_NS, &mut samples);
    }
    samples.iter().for_each(sound);
    // The fit of the clock sees where a piece ends; that is no part of the law.
    for sample in &mut samples {
        (sample.sample_time_ns, sample.sample_time_sigma_ns) = (0, 0);
    }
    let counted = brain.trouble().is_none().then_some(brain.counts().refused);
    (samples, counted)
}
