//! Type 13: the null pose of the segments and the points on them (MVN protocol, "Scale").
//!
//! Sent as several datagrams: the first contains the segments, the following ones some of about 123 points each. Its
//! sample counter is 0 and its datagram counter need not be `0x80`, so each datagram is parsed independently and merged
//! by id.

use super::Malformed;
use super::header::{DatagramType, Header, Oversized, frame};
use crate::wire::reader::{Reader, TextFault, write_f32s, write_text};

/// Position of a segment in the null (T) pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NullPoseSegment<'a> {
    /// MVN's name, for example `RightForeArm`. The segment's id is its position in the list, from 1.
    pub name: &'a str,
    /// Origin in the null pose: X forward, Y left, Z up; m.
    pub origin_m: [f32; 3],
}

/// A point on a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentPoint<'a> {
    /// MVN segment id, from 1.
    pub segment_id: u16,
    /// The point's id on that segment, from 1.
    pub point_id: u16,
    /// The point's name, for example `pHeelFoot`.
    pub name: &'a str,
    /// Kind of the point, by MVN's own bits.
    pub flags: u32,
    /// Offset from the segment's origin in the null pose, m.
    pub offset_m: [f32; 3],
}

/// The content of one datagram. Validated on parsing, so the iterators yield all elements.
#[derive(Debug, Clone, Copy)]
pub struct Scale<'a> {
    segment_count: usize,
    point_count: usize,
    segments: Reader<'a>,
    points: Reader<'a>,
}

impl<'a> Scale<'a> {
    pub(super) fn parse(payload: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(payload);
        let segment_count = count(&mut reader, "segment count")?;
        let segments = reader;
        for _ in 0..segment_count {
            read_segment(&mut reader).map_err(|fault| blame(fault, "segment list"))?;
        }
        let point_count = count(&mut reader, "point count")?;
        let points = reader;
        for _ in 0..point_count {
            read_point(&mut reader).map_err(|fault| blame(fault, "point list"))?;
        }
        if !reader.is_empty() {
            return Err(blame(TextFault::TooShort, "point count"));
        }
        Ok(Scale { segment_count, point_count, segments, points })
    }

    /// The segments in id order; empty in all but the first datagram.
    pub fn segments(&self) -> impl Iterator<Item = NullPoseSegment<'a>> + use<'a> {
        let mut reader = self.segments;
        (0..self.segment_count).map_while(move |_| read_segment(&mut reader).ok())
    }

    /// The points of this datagram.
    pub fn points(&self) -> impl Iterator<Item = SegmentPoint<'a>> + use<'a> {
        let mut reader = self.points;
        (0..self.point_count).map_while(move |_| read_point(&mut reader).ok())
    }
}

fn blame(fault: TextFault, field: &'static str) -> Malformed {
    let datagram_type = DatagramType::SCALE;
    match fault {
        TextFault::TooShort => Malformed::Content { datagram_type, field },
        TextFault::NotUtf8 => Malformed::Text { datagram_type, field },
    }
}

fn count(reader: &mut Reader<'_>, field: &'static str) -> Result<usize, Malformed> {
    reader
        .i32()
        .and_then(|count| usize::try_from(count).ok())
        .ok_or_else(|| blame(TextFault::TooShort, field))
}

fn read_segment<'a>(reader: &mut Reader<'a>) -> Result<NullPoseSegment<'a>, TextFault> {
    Ok(NullPoseSegment { name: reader.text()?, origin_m: reader.f32s().ok_or(TextFault::TooShort)? })
}

fn read_point<'a>(reader: &mut Reader<'a>) -> Result<SegmentPoint<'a>, TextFault> {
    let short = TextFault::TooShort;
    Ok(SegmentPoint {
        segment_id: reader.u16().ok_or(short)?,
        point_id: reader.u16().ok_or(short)?,
        name: reader.text()?,
        flags: reader.u32().ok_or(short)?,
        offset_m: reader.f32s().ok_or(short)?,
    })
}

/// Replaces the contents of `out` with one datagram of type 13.
///
/// Real senders leave sample counter, time code and, except in the last datagram, bit 7 of the datagram counter at
/// zero.
///
/// # Errors
/// [`Oversized`] if it does not fit one datagram: send the points in several.
pub fn encode(
    header: &Header,
    segments: &[NullPoseSegment<'_>],
    points: &[SegmentPoint<'_>],
    out: &mut Vec<u8>,
) -> Result<(), Oversized> {
    frame(header, DatagramType::SCALE, 0, out, |out| {
        // Lists beyond i32 exceed a datagram as well; `frame` refuses those by their size.
        out.extend_from_slice(&(segments.len() as i32).to_be_bytes());
        for segment in segments {
            write_text(segment.name, out);
            write_f32s(&segment.origin_m, out);
        }
        out.extend_from_slice(&(points.len() as i32).to_be_bytes());
        for point in points {
            out.extend_from_slice(&point.segment_id.to_be_bytes());
            out.extend_from_slice(&point.point_id.to_be_bytes());
            write_text(point.name, out);
            out.extend_from_slice(&point.flags.to_be_bytes());
            write_f32s(&point.offset_m, out);
        }
    })
}

// object
// segment count i32
//   each: length of the name i32, name, origin_m 3 × f32
// point count i32
//   each: segment_id u16, point_id u16, length of the name i32, name, flags u32, offset_m 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;

    #[test]
    fn what_is_written_is_read() {
        let segments = [
            NullPoseSegment { name: "Pelvis", origin_m: [0.0, 0.0, 1.05] },
            NullPoseSegment { name: "L5", origin_m: [-0.01, 0.0, 1.16] },
        ];
        let points = [SegmentPoint {
            segment_id: 18,
            point_id: 3,
            name: "pHeelFoot",
            flags: 4,
            offset_m: [-0.05, 0.0, -0.1],
        }];
        let mut bytes = Vec::new();
        encode(&Header::new(0, 0, 0), &segments, &points, &mut bytes).unwrap();
        let Ok(Datagram::Scale(_, scale)) = Datagram::parse(&bytes) else { panic!("not read back") };
        assert_eq!(scale.segments().collect::<Vec<_>>(), segments);
        assert_eq!(scale.points().collect::<Vec<_>>(), points);
    }

    #[test]
    fn counts_that_lie_are_refused() {
        assert!(Scale::parse(&[0xff; 8]).is_err());
        assert!(Scale::parse(&[0x7f, 0xff, 0xff, 0xff, 0, 0, 0, 0]).is_err());
        assert!(Scale::parse(&[0, 0, 0, 0, 0, 0, 0, 0, 1]).is_err());
        assert!(Scale::parse(&[0; 8]).is_ok());
    }
}
