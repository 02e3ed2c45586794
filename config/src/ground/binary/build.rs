//! Builds the adapter's settings from the section `[ground.binary]`, or reports its errors.

use equipoise_adapters::ground::device::binary::{BinarySettings, Count, Field, Scans, Time};
use equipoise_adapters::wire::checksum::{Checksum, NAMES};
use equipoise_adapters::wire::frame::{
    ChecksumField, Endian, FormFault, FrameForm, Length, Number, NumberPosition, Tag,
};
use toml::Spanned;

use super::{
    BinaryConfig, CountConfig, CrcConfig, EndianConfig, FieldConfig, NumberConfig, NumberType, TagConfig,
    TimeConfig, section,
};
use crate::ground::channels::{self, Names};
use crate::ground::description_error::nearest;
use crate::ground::numbers::{FACTORS, LengthConfig, ModulusConfig, SUMMANDS, is_factor, is_summand};
use crate::ground::transport::TransportKind;
use crate::ground::{DescriptionError, GroundConfig};

/// Maximum plausible number of scans in a frame.
const SCANS_MAX: usize = 10_000;

/// The full dotted key.
fn key(name: &str) -> String {
    format!("ground.binary.{name}")
}

pub(super) fn settings(ground: &GroundConfig) -> Result<BinarySettings, DescriptionError> {
    let config = section(ground)?;
    let datagrams = config.transport == TransportKind::Udp;
    let form = form(config, datagrams)?;
    check_numbering(config)?;
    let scans = scans(config, &form)?;
    let fields = fields(config, &form)?;
    let names: Vec<String> = config.fields.iter().map(|entry| entry.get_ref().name.clone()).collect();
    let mut lookup = Names::new(&names);
    let channels = channels::channels(ground, &mut lookup)?;
    if let Some(entry) = lookup
        .unused()
        .next()
        .and_then(|unused| config.fields.iter().find(|entry| entry.get_ref().name == unused))
    {
        let what = format!("[ground.channels] does not use `{}`; leave it out", entry.get_ref().name);
        return Err(DescriptionError::at(entry, key("fields"), what));
    }
    let tag_of = |name: &str, config_tag: &Option<TagConfig>| match config_tag {
        Some(tag) => tag_named(&key(name), tag, config.endian)
            .and_then(|tag| within(&form, name, tag.place).map(|_| Some(tag))),
        None => Ok(None),
    };
    let status = match &config.status {
        Some(NumberConfig { at, number, mask }) => {
            let place = unsigned("status", place(*at, *number, *mask, config.endian))?;
            Some(within(&form, "status", place)?)
        }
        None => None,
    };
    let time = time(config, &form)?;
    let message = |hex: &[u8]| (!hex.is_empty()).then(|| hex.to_vec());
    Ok(BinarySettings {
        datagrams,
        fields,
        channels,
        scans,
        sequence: count(config, &form, "sequence", config.sequence.as_ref())?,
        counter: count(config, &form, "counter", config.counter.as_ref())?,
        time,
        rate_hz: config.rate_hz,
        status,
        trigger: tag_of("trigger", &config.trigger)?,
        request: message(&config.send_on_open),
        close_command: message(&config.send_on_close),
        form,
    })
}

/// The place, if every frame contains it.
fn within(form: &FrameForm, name: &str, place: NumberPosition) -> Result<NumberPosition, DescriptionError> {
    form.check_place(place)
        .map(|()| place)
        .map_err(|fault| DescriptionError::new(key(name), fault.to_string()))
}

fn count(
    config: &BinaryConfig,
    form: &FrameForm,
    name: &str,
    count: Option<&CountConfig>,
) -> Result<Option<Count>, DescriptionError> {
    let Some(count) = count else { return Ok(None) };
    let place = place(count.at, count.number, count.mask, config.endian);
    let bits = place.mask.count_ones().min(8 * place.number.bytes() as u32);
    let modulus = match count.modulus {
        Some(modulus) => modulus.checked_of_bits(&key(name), bits)?,
        None => ModulusConfig::of_bits(bits),
    };
    Ok(Some(Count { place: within(form, name, unsigned(name, place)?)?, modulus }))
}

fn time(config: &BinaryConfig, form: &FrameForm) -> Result<Option<Time>, DescriptionError> {
    let Some(TimeConfig { at, number, unit }) = &config.time else { return Ok(None) };
    let place = within(form, "time", place(*at, *number, None, config.endian))?;
    if !place.number.is_unsigned() && !matches!(place.number, Number::F32 | Number::F64) {
        return Err(DescriptionError::new(key("time"), "a time has no sign: u8 to u64, f32 or f64"));
    }
    Ok(Some(Time { place, unit_ns: unit.ns() }))
}

/// Checks which numbering fields may be combined.
fn check_numbering(config: &BinaryConfig) -> Result<(), DescriptionError> {
    if config.counter.is_some() && config.sequence.is_none() {
        let what = "counts measurements, sent or not, and reveals no loss; if each of them is sent, call it `sequence`";
        return Err(DescriptionError::new(key("counter"), what));
    }
    if config.counter.is_some() && config.time.is_some() {
        return Err(DescriptionError::new(key("counter"), "time and counter are two clocks; leave one out"));
    }
    if let Some(rate_hz) = config.rate_hz {
        if config.sequence.is_some() || config.time.is_some() {
            let what = "is for a device that counts nothing; with sequence or time it is not needed";
            return Err(DescriptionError::new(key("rate_hz"), what));
        }
        if !(0.1..=100_000.0).contains(&rate_hz) {
            return Err(DescriptionError::new(
                key("rate_hz"),
                format!("{rate_hz} is not from 0.1 to 100000"),
            ));
        }
    }
    if config.scans.is_some() && config.sequence.is_none() {
        return Err(DescriptionError::new(
            key("scans"),
            "several readings in one frame need a `sequence`, or they have no time",
        ));
    }
    if config.scans.is_some() && (config.time.is_some() || config.counter.is_some()) {
        let what = "dates the frame and not each of its readings; leave it out: `sequence` counts them all";
        return Err(DescriptionError::new(key(if config.time.is_some() { "time" } else { "counter" }), what));
    }
    Ok(())
}

fn form(config: &BinaryConfig, datagrams: bool) -> Result<FrameForm, DescriptionError> {
    let length = match &config.length {
        LengthConfig::Fixed(bytes) => Length::Fixed(*bytes),
        LengthConfig::InFrame { at, number, plus, most } => {
            Length::InHead { place: place(*at, *number, None, config.endian), plus: *plus, most: *most }
        }
    };
    let tags = config.tags.iter().map(|entry| {
        let tag = tag_named(&key("tags"), entry.get_ref(), config.endian);
        tag.map_err(|error| DescriptionError { span: Some(entry.span()), ..error })
    });
    let untagged =
        FrameForm { sync: config.sync.to_vec(), length, tags: Vec::new(), kind: None, checksum: None };
    let fault = |name: &str| {
        let key = key(name);
        move |fault: FormFault| DescriptionError::new(key, fault.to_string())
    };
    untagged.check(false).map_err(fault("length"))?;
    let tagged = FrameForm { tags: tags.collect::<Result<_, _>>()?, ..untagged };
    for (entry, tag) in config.tags.iter().zip(&tagged.tags) {
        tagged
            .check_place(tag.place)
            .map_err(|fault| DescriptionError::at(entry, key("tags"), fault.to_string()))?;
    }
    let kind = config.kind.as_ref().map(|kind| tag_named(&key("kind"), kind, config.endian)).transpose()?;
    let of_kind = FrameForm { kind, ..tagged };
    of_kind.check(false).map_err(fault("kind"))?;
    let checksum = config.crc.as_ref().map(|crc| summed(crc, config.endian)).transpose()?;
    let form = FrameForm { checksum, ..of_kind };
    form.check(false).map_err(fault("crc"))?;
    form.check(!datagrams).map_err(fault("sync"))?;
    Ok(form)
}

fn summed(crc: &CrcConfig, endian: EndianConfig) -> Result<ChecksumField, DescriptionError> {
    let CrcConfig { name, from, to, at, endian: own } = crc;
    let Some(checksum) = Checksum::named(name) else {
        let hint = nearest(name, NAMES.iter().flat_map(|names| names.iter().copied()));
        return Err(DescriptionError::new(
            key("crc"),
            format!("no checksum that is offered is called `{name}`{hint}"),
        ));
    };
    Ok(ChecksumField { checksum, from: *from, to: *to, at: *at, endian: own.unwrap_or(endian).into() })
}

fn scans(config: &BinaryConfig, form: &FrameForm) -> Result<Scans, DescriptionError> {
    let Some(scans) = &config.scans else { return Ok(Scans { count: 1, bytes: 0 }) };
    let Length::Fixed(length) = form.length else {
        return Err(DescriptionError::new(
            key("scans"),
            "several readings in one frame need frames of one length",
        ));
    };
    if !(1..=SCANS_MAX).contains(&scans.count) || scans.bytes == 0 || scans.bytes > length {
        let what = format!("count is 1 to {SCANS_MAX}, and bytes what one of them takes");
        return Err(DescriptionError::new(key("scans"), what));
    }
    Ok(Scans { count: scans.count, bytes: scans.bytes })
}

/// All fields. A copied line with an unchanged position would give two channels the same number.
fn fields(config: &BinaryConfig, form: &FrameForm) -> Result<Vec<Field>, DescriptionError> {
    let all =
        config.fields.iter().map(|entry| field(config, form, entry)).collect::<Result<Vec<Field>, _>>()?;
    for (index, entry) in config.fields.iter().enumerate() {
        let other =
            all[..index].iter().position(|other| have_common_bits(form, other.place, all[index].place));
        if let Some(other) = other {
            let (name, other) = (&entry.get_ref().name, &config.fields[other].get_ref().name);
            let what = format!("field `{name}` overlaps `{other}`; change `at` or `mask`");
            return Err(DescriptionError::at(entry, key("fields"), what));
        }
    }
    Ok(all)
}

/// Whether two numbers certainly have common bits: in frames of any length, positions from the beginning and from the end
/// cannot be compared, nor masks of numbers that only overlap.
fn have_common_bits(form: &FrameForm, one: NumberPosition, other: NumberPosition) -> bool {
    let (Some(bytes), Some(of_other)) = (one.range(form.most()), other.range(form.most())) else {
        return false;
    };
    let are_comparable = matches!(form.length, Length::Fixed(_)) || (one.at < 0) == (other.at < 0);
    let overlap = bytes.start < of_other.end && of_other.start < bytes.end;
    let have_own_bits = if bytes == of_other && one.endian == other.endian {
        one.mask & other.mask == 0
    } else {
        one.mask != u64::MAX || other.mask != u64::MAX
    };
    are_comparable && overlap && !have_own_bits
}

fn field(
    config: &BinaryConfig,
    form: &FrameForm,
    entry: &Spanned<FieldConfig>,
) -> Result<Field, DescriptionError> {
    let FieldConfig { name, at, number, mask, endian, scale, per, offset } = entry.get_ref();
    let wrong = |what: String| DescriptionError::at(entry, key("fields"), format!("`{name}`: {what}"));
    if config.fields.iter().filter(|other| other.get_ref().name == *name).count() > 1 {
        return Err(wrong("two fields have this name".to_owned()));
    }
    if !(is_factor(*scale) && is_factor(*per) && is_summand(*offset)) {
        return Err(wrong(format!(
            "scale is {scale:?}, per {per:?} and offset {offset:?}; scale and per are {FACTORS}, offset {SUMMANDS}"
        )));
    }
    let place = place(*at, *number, *mask, endian.unwrap_or(config.endian));
    if mask.is_some() && (!place.number.is_unsigned() || *mask == Some(0) || !has_its_bits_only(place)) {
        let what = "mask requires an unsigned type, at least one set bit and none outside the type's width";
        return Err(wrong(what.to_owned()));
    }
    let (count, bytes) = config.scans.as_ref().map_or((1, 0), |scans| (scans.count, scans.bytes));
    let last = count
        .checked_sub(1)
        .and_then(|before| before.checked_mul(bytes))
        .and_then(|bytes| place.moved(bytes));
    let fits = last.map_or(Err(FormFault::Beyond(form.most())), |last| form.check_place(last));
    fits.and_then(|()| form.check_place(place)).map_err(|fault| wrong(fault.to_string()))?;
    Ok(Field { place, scale: *scale, per: *per, offset: *offset })
}

fn place(at: i32, number: NumberType, mask: Option<u32>, endian: EndianConfig) -> NumberPosition {
    NumberPosition {
        mask: mask.map_or(u64::MAX, u64::from),
        ..NumberPosition::new(at, number.into(), endian.into())
    }
}

/// Whether the mask has no bits beyond the number, which are never set: a status would report no fault.
fn has_its_bits_only(place: NumberPosition) -> bool {
    let beyond = place.mask.checked_shr(8 * place.number.bytes() as u32).unwrap_or(0);
    // All bits: there is no mask.
    place.mask == u64::MAX || beyond == 0
}

fn unsigned(name: &str, place: NumberPosition) -> Result<NumberPosition, DescriptionError> {
    if place.number.is_unsigned() && place.mask != 0 && has_its_bits_only(place) {
        return Ok(place);
    }
    Err(DescriptionError::new(
        key(name),
        "requires an unsigned type, u8 to u64; mask: at least one set bit and none outside the type's width",
    ))
}

fn tag_named(key: &str, tag: &TagConfig, endian: EndianConfig) -> Result<Tag, DescriptionError> {
    let place = place(tag.at, tag.number, tag.mask, endian);
    let can_be = |value: &u32| u64::from(*value) & place.mask == u64::from(*value);
    let is_number = place.number.is_unsigned() && has_its_bits_only(place);
    if !is_number || tag.is.is_empty() || !tag.is.iter().all(can_be) {
        let what = "requires an unsigned type and, in `is`, one or more values without bits outside the mask or type";
        return Err(DescriptionError::new(key, what));
    }
    Ok(Tag { place, values: tag.is.iter().copied().map(u64::from).collect() })
}

impl From<EndianConfig> for Endian {
    fn from(config: EndianConfig) -> Endian {
        match config {
            EndianConfig::Little => Endian::Little,
            EndianConfig::Big => Endian::Big,
        }
    }
}

impl From<NumberType> for Number {
    fn from(config: NumberType) -> Number {
        match config {
            NumberType::U8 => Number::U8,
            NumberType::I8 => Number::I8,
            NumberType::U16 => Number::U16,
            NumberType::I16 => Number::I16,
            NumberType::U24 => Number::U24,
            NumberType::I24 => Number::I24,
            NumberType::U32 => Number::U32,
            NumberType::I32 => Number::I32,
            NumberType::U64 => Number::U64,
            NumberType::I64 => Number::I64,
            NumberType::F32 => Number::F32,
            NumberType::F64 => Number::F64,
        }
    }
}
