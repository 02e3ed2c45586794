//! Types with identity and time: 12 (name), 13 (null pose), 25 (time of day).

use super::{ONLY_DATAGRAM, Stamp, TooLong, floats, text};

/// Points that fit one datagram of type 13 with the longest names.
const POINTS_OF_A_DATAGRAM: usize = 32;

/// Type 12: lines of `tag:value`.
///
/// # Errors
/// [`TooLong`].
pub fn meta(stamp: &Stamp, tags: &[(&str, &str)]) -> Result<Vec<u8>, TooLong> {
    let lines: String = tags.iter().map(|(tag, value)| format!("{tag}:{value}\n")).collect();
    let mut payload = Vec::new();
    text(&mut payload, &lines);
    stamp.datagram(b"12", ONLY_DATAGRAM, 1, &payload)
}

/// Type 25: the sender's time of day, UTC, `HH:MM:SS.mmm`; old versions send it without its length.
///
/// # Errors
/// [`TooLong`].
pub fn time_of_day(stamp: &Stamp, time_of_day_ms: u32, with_length: bool) -> Result<Vec<u8>, TooLong> {
    let (seconds, milliseconds) = (time_of_day_ms / 1000 % 86_400, time_of_day_ms % 1000);
    let (hour, minute, second) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    let written = format!("{hour:02}:{minute:02}:{second:02}.{milliseconds:03}");
    let mut payload = Vec::new();
    if with_length {
        text(&mut payload, &written);
    } else {
        payload.extend_from_slice(written.as_bytes());
    }
    stamp.datagram(b"25", ONLY_DATAGRAM, 1, &payload)
}

/// A point fixed to a segment.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Its segment.
    pub segment_id: u16,
    /// Its number among the segment's points, from 1.
    pub point_id: u16,
    /// For example `pHeelFoot`.
    pub name: String,
    /// Characteristics; the meaning of the bits is undocumented.
    pub flags: u32,
    /// From the segment's origin in the null pose, m.
    pub offset_m: [f32; 3],
}

/// Type 13: the null pose, in several datagrams. The first has the segments (name, origin in m, Z up) and no point, the
/// following have points and no segment. Counters and times are those that MVN sends: sample 0 and no end mark on the
/// last.
///
/// # Errors
/// [`TooLong`].
pub fn null_pose(
    stamp: &Stamp,
    segments: &[(&str, [f32; 3])],
    points: &[Point],
) -> Result<Vec<Vec<u8>>, TooLong> {
    let stamp = Stamp { sample_counter: 0, time_code_ms: 0, ..*stamp };
    let mut payload = (segments.len() as u32).to_be_bytes().to_vec();
    for (name, origin_m) in segments {
        text(&mut payload, name);
        floats(&mut payload, origin_m);
    }
    payload.extend_from_slice(&0_u32.to_be_bytes());
    let mut datagrams = vec![stamp.datagram(b"13", 0, 0, &payload)?];
    for (number, some) in (1..).zip(points.chunks(POINTS_OF_A_DATAGRAM)) {
        let mut payload = vec![0; 4];
        payload.extend_from_slice(&(some.len() as u32).to_be_bytes());
        for point in some {
            payload.extend_from_slice(&point.segment_id.to_be_bytes());
            payload.extend_from_slice(&point.point_id.to_be_bytes());
            text(&mut payload, &point.name);
            payload.extend_from_slice(&point.flags.to_be_bytes());
            floats(&mut payload, &point.offset_m);
        }
        datagrams.push(stamp.datagram(b"13", number, 0, &payload)?);
    }
    Ok(datagrams)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_of_day_has_twelve_letters() {
        let stamp = Stamp::of_a_body(0, 0, 0);
        let at_ms = ((15 * 60 + 59) * 60 + 46) * 1000 + 272;
        let new = time_of_day(&stamp, at_ms, true).unwrap();
        assert_eq!(&new[24..], b"\0\0\0\x0c15:59:46.272");
        assert_eq!(time_of_day(&stamp, at_ms, false).unwrap()[24..], new[28..]);
    }

    #[test]
    fn a_null_poses_datagrams_have_segments_or_points() {
        let point = |id| Point {
            segment_id: 18,
            point_id: id,
            name: "pRightHeelFoot".into(),
            flags: 0,
            offset_m: [-0.06, 0.0, -0.08],
        };
        let points: Vec<_> = (1..=70).map(point).collect();
        let stamp = Stamp::of_a_body(9, 150, 0);
        let datagrams = null_pose(&stamp, &[("Pelvis", [0.0, 0.0, 1.0])], &points).unwrap();
        assert_eq!(datagrams.len(), 4);
        assert!(
            datagrams.iter().enumerate().all(|(i, bytes)| bytes[10] == i as u8 && bytes[6..10] == [0; 4])
        );
        assert_eq!(datagrams[0].len(), 24 + 4 + 4 + 6 + 12 + 4);
        assert_eq!(datagrams[3][24..32], [0, 0, 0, 0, 0, 0, 0, 6]);
    }
}
