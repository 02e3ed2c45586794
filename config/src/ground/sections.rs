//! Rejects sections and keys of other sources and transports, which would have no effect.

use super::transport::TransportKind;
use super::{DescriptionError, GroundConfig, GroundSourceKind};

/// Checks the keys of single devices.
pub(super) fn check(ground: &GroundConfig) -> Result<(), DescriptionError> {
    refuse(ground, &sections(ground))
}

/// Checks the keys of the connection, after the check that those required are present.
pub(super) fn check_connection(ground: &GroundConfig) -> Result<(), DescriptionError> {
    refuse(ground, &connections(ground))
}

/// If another process reads the device, every key is allowed: the files of both may differ in `source` only.
fn refuse(ground: &GroundConfig, keys: &[Key]) -> Result<(), DescriptionError> {
    if ground.source == GroundSourceKind::External {
        return Ok(());
    }
    match keys.iter().find(|(_, is_present, belongs, _)| *is_present && !belongs) {
        Some((key, _, _, of)) => Err(DescriptionError::new(*key, format!("is for {of}; leave it out"))),
        None => Ok(()),
    }
}

/// A key, whether it is present, whether the source uses it, and a description of the sources that use it.
type Key = (&'static str, bool, bool, &'static str);

/// Keys of single devices.
fn sections(ground: &GroundConfig) -> [Key; 13] {
    use GroundSourceKind::{
        AmtiSerial, AtiRdt, Binary, BotaSerial, KistlerLabamp, Lsl, MoticonUdp, Qtm, TecGihan, Text,
    };
    let is = |source: GroundSourceKind| ground.source == source;
    let (ati, text, binary) = ("source = \"ati-rdt\"", "source = \"text\"", "source = \"binary\"");
    let either = "source = \"text\" or \"binary\"";
    [
        ("ground.counts_per_newton", ground.counts_per_newton.is_some(), is(AtiRdt), ati),
        ("ground.counts_per_newton_metre", ground.counts_per_newton_metre.is_some(), is(AtiRdt), ati),
        ("ground.ati", ground.ati.is_some(), is(AtiRdt), ati),
        ("ground.amti", ground.amti.is_some(), is(AmtiSerial), "source = \"amti-serial\""),
        ("ground.bota", ground.bota.is_some(), is(BotaSerial), "source = \"bota-serial\""),
        ("ground.labamp", ground.labamp.is_some(), is(KistlerLabamp), "source = \"kistler-labamp\""),
        ("ground.tec_gihan", ground.tec_gihan.is_some(), is(TecGihan), "source = \"tec-gihan\""),
        ("ground.moticon", ground.moticon.is_some(), is(MoticonUdp), "source = \"moticon-udp\""),
        ("ground.qtm", ground.qtm.is_some(), is(Qtm), "source = \"qtm\""),
        ("ground.lsl", ground.lsl.is_some(), is(Lsl), "source = \"lsl\""),
        ("ground.text", ground.text.is_some(), is(Text), text),
        ("ground.binary", ground.binary.is_some(), is(Binary), binary),
        ("ground.channels", ground.channels.is_some(), is(Text) || is(Binary), either),
    ]
}

/// Keys of the connection to the device.
fn connections(ground: &GroundConfig) -> [Key; 5] {
    use GroundSourceKind::{
        AmtiSerial, AtiRdt, BotaSerial, KistlerLabamp, Lsl, MoticonUdp, Qtm, TecGihan, Text,
    };
    let of_lines = ground.text.as_ref().filter(|_| ground.source == Text).map(|text| text.transport);
    let of_frames = ground
        .binary
        .as_ref()
        .filter(|_| ground.source == GroundSourceKind::Binary)
        .map(|binary| binary.transport);
    let transport = of_lines.or(of_frames);
    let is = |kind: TransportKind| transport == Some(kind);
    let source = ground.source;
    let serial = is(TransportKind::Serial) || matches!(source, AmtiSerial | BotaSerial | TecGihan);
    let address = is(TransportKind::Udp)
        || is(TransportKind::Tcp)
        || matches!(source, AtiRdt | KistlerLabamp | Lsl | Qtm);
    let listen = is(TransportKind::Udp) || source == MoticonUdp;
    // An LSL stream without an address is searched on the network.
    let remote = source == MoticonUdp || source == Lsl || is(TransportKind::Udp) && ground.listen.is_some();
    let file = is(TransportKind::File);
    [
        ("ground.serial", ground.serial.is_some(), serial, "devices on a serial line"),
        ("ground.address", ground.address.is_some(), address, "devices that are reached over the network"),
        ("ground.listen", ground.listen.is_some(), listen, "devices that send datagrams without a request"),
        (
            "ground.allow_remote",
            ground.allow_remote,
            remote,
            "devices that send to `listen`, and source = \"lsl\"",
        ),
        (
            "ground.file",
            ground.file.is_some(),
            file,
            "source = \"text\" or \"binary\" with transport = \"file\"",
        ),
    ]
}
