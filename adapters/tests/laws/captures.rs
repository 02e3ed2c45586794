//! Files of other programs: samples are valid and in order, and a written capture can be read.

use equipoise_adapters::capture::{
    BioWareCapture, BioWareSettings, CsvCapture, MvnxCapture, PcapCapture, PcapWriter, Units,
};
use equipoise_adapters::ground::{GroundFrame, GroundSettings, SensorAxes};

use super::choices::Choices;
use super::{ground, suit};

/// The datagrams of a capture, written as a capture, are read back identically.
pub(crate) fn pcap(bytes: &[u8]) {
    let Ok(mut capture) = PcapCapture::from_bytes(bytes.to_vec()) else { return };
    let read: Vec<_> = capture.by_ref().collect();
    assert!(read.len() as u64 + capture.rejected().total() <= 2 * bytes.len() as u64);
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let mut written = Vec::new();
    for datagram in read {
        assert!(datagram.payload.len() < 1 << 16);
        // The year 2106 and jumbo payloads exceed the format that is written.
        if writer
            .write_udp(datagram.time_ns, datagram.source, datagram.destination, &datagram.payload)
            .is_ok()
        {
            written.push(datagram);
        }
    }
    let mut again = PcapCapture::from_bytes(writer.finish().unwrap()).unwrap();
    let reread: Vec<_> = again.by_ref().collect();
    assert_eq!(reread, written, "{}", again.rejected());
    assert_eq!((again.fault(), again.rejected().total()), (None, 0));
}

/// Motion as `.mvnx`: valid samples in order, and bounded error texts.
pub(crate) fn mvnx(bytes: &[u8]) {
    let mut capture = match MvnxCapture::new(bytes) {
        Ok(capture) => capture,
        Err(error) => return assert!(error.to_string().len() < 2000, "{error}"),
    };
    let mut last_ns = 0;
    for (index, sample) in capture.by_ref().enumerate() {
        suit::assert_valid(&sample);
        assert!(sample.sample_time_ns > last_ns);
        last_ns = sample.sample_time_ns;
        assert_eq!(sample.sequence, index as u64 + 1);
    }
    let origins = capture.subject().null_pose.origins_m.unwrap();
    assert!(origins.iter().flatten().all(|metres| metres.is_finite()));
    assert!(capture.next().is_none(), "the end is the end");
}

/// A plate's text export, with and without declarations.
pub(crate) fn bioware(bytes: &[u8]) {
    let mut choices = Choices::new(bytes);
    let declared = choices.byte();
    let frame = GroundFrame { axes: SensorAxes::ZDown, surface_height_m: 0.05, ..GroundFrame::default() };
    let settings = BioWareSettings {
        ground: GroundSettings { frame, ..GroundSettings::default() },
        units: if declared & 1 == 0 { Units::default() } else { Units::parse("s,N,N.m,m").unwrap() },
        plate: (declared & 2 != 0).then_some(usize::from(declared >> 4)),
        sensor_offsets_m: (declared & 4 != 0).then_some([0.12, 0.2]),
    };
    let mut capture = match BioWareCapture::new(choices.rest(), settings) {
        Ok(capture) => capture,
        Err(error) => return assert!(error.to_string().len() < 40_000, "{error}"),
    };
    let mut last_ns = 0;
    for sample in capture.by_ref() {
        ground::assert_valid(&sample);
        assert!(sample.sample_time_ns > last_ns);
        last_ns = sample.sample_time_ns;
    }
    assert!(capture.next().is_none(), "the end is the end");
}

/// Motion and forces as CSV.
pub(crate) fn csv(bytes: &[u8]) {
    let Ok(capture) = CsvCapture::new(bytes) else { return };
    let mut last_ns = 0;
    for (suit, ground) in capture {
        suit::assert_valid(&suit);
        ground::assert_valid(&ground);
        assert_eq!(suit.sample_time_ns, ground.sample_time_ns);
        assert!(suit.sample_time_ns > last_ns);
        last_ns = suit.sample_time_ns;
    }
}
