//! Type 23: measurements of each motion tracker (MVN protocol, "Motion tracker kinematics").
//!
//! Items of 44 bytes in the specification's text and in old streams, of 68 in newer ones; the payload size
//! distinguishes them.

use super::Malformed;
use super::header::{DatagramType, Header, Oversized, frame};
use crate::wire::reader::{Reader, write_f32s};

const SHORT: usize = 44;
const LONG: usize = 68;

/// One tracker; only segments with a tracker are sent (17 of a whole body).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerKinematics {
    /// MVN id of the segment with the tracker, from 1.
    pub segment_id: u32,
    /// `suitworld_from_tracker`, scalar first.
    pub orientation_wxyz: [f32; 4],
    /// Acceleration without gravity in the suit's world, m/s².
    pub free_acceleration_m_per_s2: [f32; 3],
    /// Specific force and turn rate in the tracker's frame; only in items of 68 bytes.
    pub inertial: Option<Inertial>,
    /// Magnetic field in the tracker's frame, arbitrary units.
    pub magnetic_field: [f32; 3],
}

/// The raw inertial channels of a tracker, in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertial {
    /// Acceleration with gravity, m/s².
    pub acceleration_m_per_s2: [f32; 3],
    /// Angular velocity, rad/s.
    pub angular_velocity_rad_per_s: [f32; 3],
}

/// The trackers of one datagram, in the order of transmission.
#[derive(Debug, Clone, Copy)]
pub struct Trackers<'a> {
    reader: Reader<'a>,
    long: bool,
}

impl<'a> Trackers<'a> {
    pub(super) fn parse(header: &Header, payload: &'a [u8]) -> Result<Self, Malformed> {
        let items = usize::from(header.items);
        let long = match payload.len() {
            length if length == items * LONG => true,
            length if length == items * SHORT => false,
            payload => {
                return Err(Malformed::Items {
                    datagram_type: header.datagram_type,
                    items: header.items,
                    payload,
                });
            }
        };
        Ok(Trackers { reader: Reader::new(payload), long })
    }
}

impl Iterator for Trackers<'_> {
    type Item = TrackerKinematics;

    fn next(&mut self) -> Option<TrackerKinematics> {
        let reader = &mut self.reader;
        Some(TrackerKinematics {
            segment_id: reader.u32()?,
            orientation_wxyz: reader.f32s()?,
            free_acceleration_m_per_s2: reader.f32s()?,
            inertial: if self.long {
                Some(Inertial {
                    acceleration_m_per_s2: reader.f32s()?,
                    angular_velocity_rad_per_s: reader.f32s()?,
                })
            } else {
                None
            },
            magnetic_field: reader.f32s()?,
        })
    }
}

/// Replaces the contents of `out` with one datagram of type 23.
///
/// Items are long if all trackers have their inertial channels, else short: all items of one datagram have the same
/// size.
///
/// # Errors
/// [`Oversized`] for more than 255 trackers.
pub fn encode(header: &Header, trackers: &[TrackerKinematics], out: &mut Vec<u8>) -> Result<(), Oversized> {
    let long = trackers.iter().all(|tracker| tracker.inertial.is_some());
    frame(header, DatagramType::TRACKER_KINEMATICS, trackers.len(), out, |out| {
        for tracker in trackers {
            out.extend_from_slice(&tracker.segment_id.to_be_bytes());
            write_f32s(&tracker.orientation_wxyz, out);
            write_f32s(&tracker.free_acceleration_m_per_s2, out);
            if let (true, Some(inertial)) = (long, tracker.inertial) {
                write_f32s(&inertial.acceleration_m_per_s2, out);
                write_f32s(&inertial.angular_velocity_rad_per_s, out);
            }
            write_f32s(&tracker.magnetic_field, out);
        }
    })
}

// long     short    object (each item)
// 0–3      0–3      segment_id u32
// 4–19     4–19     orientation_wxyz 4 × f32
// 20–31    20–31    free_acceleration_m_per_s2 3 × f32
// 32–43    –        inertial.acceleration_m_per_s2 3 × f32
// 44–55    –        inertial.angular_velocity_rad_per_s 3 × f32
// 56–67    32–43    magnetic_field 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;

    #[test]
    fn both_sizes_are_read_back() {
        let long = TrackerKinematics {
            segment_id: 9,
            orientation_wxyz: [0.5, -0.5, 0.5, 0.5],
            free_acceleration_m_per_s2: [0.1, 0.2, 0.3],
            inertial: Some(Inertial {
                acceleration_m_per_s2: [0.0, 0.0, 9.81],
                angular_velocity_rad_per_s: [1.0, 2.0, 3.0],
            }),
            magnetic_field: [0.4, 0.0, -0.8],
        };
        let short = TrackerKinematics { inertial: None, ..long };
        for (tracker, size) in [(long, LONG), (short, SHORT)] {
            let mut bytes = Vec::new();
            encode(&Header::new(1, 4, 0), &[tracker; 17], &mut bytes).unwrap();
            assert_eq!(bytes.len(), 24 + 17 * size);
            let Ok(Datagram::TrackerKinematics(_, trackers)) = Datagram::parse(&bytes) else {
                panic!("not read back")
            };
            assert_eq!(trackers.collect::<Vec<_>>(), vec![tracker; 17]);
            bytes.pop();
            assert!(Datagram::parse(&bytes).is_err());
        }
    }
}
