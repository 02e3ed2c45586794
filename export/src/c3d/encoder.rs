//! The bytes of a C3D file: header, parameters, frames of floating-point numbers in little-endian order.
//!
//! Format: The C3D File Format User Guide, <https://www.c3d.org/HTML/>. Blocks of 512 bytes: the header, the parameters
//! (groups with negative identifiers, their parameters with the positive ones), and the frames. A frame has four numbers
//! per point (x, y, z, and a word with camera mask and residual: −1 for an invalid point) and one number per analog
//! channel.

use std::io::{self, Write};

const BLOCK: usize = 512;
/// First bytes of a C3D file: the parameters begin at block 2, and the format's number.
const MAGIC: [u8; 2] = [2, 80];
/// Number format: IEEE, little-endian ("Intel").
const PROCESSOR: u8 = 84;
/// Blocks of parameters, in one byte.
const PARAMETER_BLOCKS_MAX: usize = 255;
/// Largest number of frames of a 16-bit counter; a larger one is stored in further parameters.
pub(super) const FRAMES_MAX: usize = 65_535;
/// Scale of residuals, mm; negative: coordinates are floating-point numbers.
pub(super) const SCALE: f32 = -0.1;

/// Sizes of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    /// Points per frame.
    pub(super) points: usize,
    /// Analog channels; one sample per frame.
    pub(super) channels: usize,
    /// Number of frames.
    pub(super) frames: usize,
    /// Frames per second.
    pub(super) rate_hz: f32,
}

/// A value of a parameter. Arrays have their dimensions, the fastest first.
#[derive(Debug)]
pub(super) enum Value {
    Integer(i16),
    Real(f32),
    Text(String),
    Integers(Vec<i16>, Vec<u8>),
    Reals(Vec<f32>, Vec<u8>),
    Texts(Vec<String>),
}

/// Parameters of a group.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) name: &'static str,
    pub(super) description: &'static str,
    pub(super) parameters: Vec<(&'static str, Value)>,
}

/// Writes header and parameters; `groups` receives the number of the block at which the frames begin.
pub(super) fn write_head(
    out: &mut impl Write,
    sizes: Sizes,
    groups: impl Fn(i16) -> Vec<Group>,
) -> io::Result<()> {
    let too_long = || io::Error::new(io::ErrorKind::InvalidInput, "too many parameters for a C3D file");
    // The number of blocks does not depend on the value stored for it.
    let blocks = parameter_bytes(&groups(0))?.len().div_ceil(BLOCK);
    if blocks > PARAMETER_BLOCKS_MAX {
        return Err(too_long());
    }
    let first_data_block = u16::try_from(blocks + 2).map_err(|_| too_long())?;
    let mut header = [0; BLOCK];
    let mut at = 0;
    let mut put = |bytes: &[u8]| {
        header[at..at + bytes.len()].copy_from_slice(bytes);
        at += bytes.len();
    };
    put(&MAGIC);
    put(&count(sizes.points)?.to_le_bytes());
    put(&count(sizes.channels)?.to_le_bytes());
    put(&1_u16.to_le_bytes());
    put(&count(sizes.frames.min(FRAMES_MAX))?.to_le_bytes());
    put(&0_u16.to_le_bytes());
    put(&SCALE.to_le_bytes());
    put(&first_data_block.to_le_bytes());
    put(&u16::from(sizes.channels > 0).to_le_bytes());
    put(&sizes.rate_hz.to_le_bytes());
    out.write_all(&header)?;
    let mut parameters = parameter_bytes(&groups(first_data_block.cast_signed()))?;
    parameters.resize(blocks * BLOCK, 0);
    parameters[2] = blocks as u8;
    out.write_all(&parameters)
}

/// Writes a point in mm; an invalid one has NaN and becomes zeros with the residual −1.
pub(super) fn write_point(out: &mut impl Write, point: [f64; 3]) -> io::Result<()> {
    let is_valid = point.iter().all(|coordinate| coordinate.is_finite());
    let (point, residual) = if is_valid { (point, 0.0_f32) } else { ([0.0; 3], -1.0) };
    for coordinate in point {
        out.write_all(&(coordinate as f32).to_le_bytes())?;
    }
    out.write_all(&residual.to_le_bytes())
}

/// Writes a sample of an analog channel; the format has no mark of an invalid one, so it is NaN.
pub(super) fn write_sample(out: &mut impl Write, sample: f64) -> io::Result<()> {
    out.write_all(&(sample as f32).to_le_bytes())
}

fn count(value: usize) -> io::Result<u16> {
    u16::try_from(value)
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "too many points or channels"))
}

/// The parameter section without its last padding.
fn parameter_bytes(groups: &[Group]) -> io::Result<Vec<u8>> {
    let mut bytes = vec![1, MAGIC[1], 0, PROCESSOR];
    for (index, group) in groups.iter().enumerate() {
        let id = index as i8 + 1;
        let mut content = vec![group.description.len() as u8];
        content.extend(group.description.as_bytes());
        record(&mut bytes, group.name, -id, &content);
        for (name, value) in &group.parameters {
            record(&mut bytes, name, id, &value_bytes(value)?);
        }
    }
    // A record without a name ends the section.
    bytes.extend([0, 0]);
    Ok(bytes)
}

/// A group or parameter: lengths, name, offset to the next record, content.
fn record(bytes: &mut Vec<u8>, name: &str, id: i8, content: &[u8]) {
    bytes.extend([name.len() as u8, id.cast_unsigned()]);
    bytes.extend(name.as_bytes());
    // Counted from the offset itself.
    bytes.extend((content.len() as u16 + 2).to_le_bytes());
    bytes.extend(content);
}

/// Type, dimensions and data of a parameter, and an empty description.
fn value_bytes(value: &Value) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut begin = |kind: i8, dimensions: &[u8]| {
        bytes.extend([kind.cast_unsigned(), dimensions.len() as u8]);
        bytes.extend(dimensions);
    };
    match value {
        Value::Integer(value) => {
            begin(2, &[]);
            bytes.extend(value.to_le_bytes());
        }
        Value::Real(value) => {
            begin(4, &[]);
            bytes.extend(value.to_le_bytes());
        }
        Value::Text(text) => {
            begin(-1, &[dimension(text.len())?]);
            bytes.extend(text.as_bytes());
        }
        Value::Integers(values, dimensions) => {
            begin(2, dimensions);
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
        Value::Reals(values, dimensions) => {
            begin(4, dimensions);
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
        Value::Texts(texts) => {
            let width = texts.iter().map(String::len).max().unwrap_or(0);
            begin(-1, &[dimension(width)?, dimension(texts.len())?]);
            bytes.extend(texts.iter().flat_map(|text| format!("{text:width$}").into_bytes()));
        }
    }
    bytes.push(0);
    Ok(bytes)
}

fn dimension(length: usize) -> io::Result<u8> {
    let too_long = |_| io::Error::new(io::ErrorKind::InvalidInput, "a text of a C3D file is too long");
    u8::try_from(length).map_err(too_long)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_has_the_layout_of_the_user_guide() {
        let sizes = Sizes { points: 2, channels: 1, frames: 70_000, rate_hz: 100.0 };
        let groups = |data: i16| {
            let parameters = vec![
                ("DATA_START", Value::Integer(data)),
                ("LABELS", Value::Texts(vec!["A".to_owned(), "Elbow".to_owned()])),
            ];
            vec![Group { name: "POINT", description: "points", parameters }]
        };
        let mut bytes = Vec::new();
        write_head(&mut bytes, sizes, groups).unwrap();
        assert_eq!(bytes.len(), 2 * BLOCK);
        let word = |index: usize| u16::from_le_bytes([bytes[2 * index], bytes[2 * index + 1]]);
        assert_eq!([word(1), word(2), word(3), word(4)], [2, 1, 1, 65_535]);
        assert_eq!([word(8), word(9)], [3, 1]);
        let section = &bytes[BLOCK..];
        assert_eq!(section[..4], [1, 80, 1, 84]);
        // Group, then parameters; each offset leads from itself to the next record.
        let (mut at, mut names) = (4, Vec::new());
        while section[at] != 0 {
            let name = at + 2..at + 2 + usize::from(section[at]);
            let offset = usize::from(u16::from_le_bytes([section[name.end], section[name.end + 1]]));
            names.push((
                section[at + 1].cast_signed(),
                String::from_utf8_lossy(&section[name.clone()]).into_owned(),
            ));
            at = name.end + offset;
        }
        let expected = [(-1, "POINT"), (1, "DATA_START"), (1, "LABELS")];
        assert_eq!(names, expected.map(|(id, name)| (id, name.to_owned())));
        assert!(section.windows(10).any(|window| window == b"A    Elbow"));
    }

    #[test]
    fn an_invalid_point_has_a_negative_residual() {
        let words = |point: [f64; 3]| {
            let mut bytes = Vec::new();
            write_point(&mut bytes, point).unwrap();
            let words: Vec<f32> =
                bytes.chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect();
            words
        };
        assert_eq!(words([1.0, -2.0, 3.5]), [1.0, -2.0, 3.5, 0.0]);
        assert_eq!(words([1.0, f64::NAN, 3.5]), [0.0, 0.0, 0.0, -1.0]);
    }
}
