//! Names and numbers in a message on whose meaning readers rely: which bit is which invalid reason, which number is
//! which level. They may differ between releases although all fields are the same; a reader would then take an invalid
//! value for a valid one. So they are part of the schema of a service ([`Topic::schema`](crate::Topic::schema)).
//!
//! Recordings contain only the hash of the fields (`Message::SCHEMA_HASH`), so that new names do not make old
//! recordings unreadable.

use equipoise_core::body::{Joint, Segment};
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::layout::fnv1a;
use equipoise_core::message::state::{
    AccelerationSource, FootOutlineSource, Phase, SharingSource, Unavailable,
};
use equipoise_core::message::{GroundDevice, Validity};
use equipoise_core::overload::Level;

/// Takes one entry: its kind, its name, its number.
pub type Each<'a> = &'a mut dyn FnMut(&str, &str, u64);

/// Combines a hash of fields with the entries; unchanged if there are none.
pub(crate) fn folded(fields: u64, words: fn(Each<'_>)) -> u64 {
    let mut hash = fields;
    words(&mut |of, name, number| {
        for text in [of, name] {
            hash = fnv1a(fnv1a(hash, text.as_bytes()), &[0]);
        }
        hash = fnv1a(hash, &number.to_le_bytes());
    });
    hash
}

/// The entries of `State`.
pub(crate) fn of_state(each: Each<'_>) {
    for (reason, name) in Validity::NAMES {
        each("reason", name, reason.0);
    }
    for (set, name) in Validity::FLAG_SETS {
        each("invalidates", name, set.0);
    }
    for (what, name) in Unavailable::NAMES {
        each("unavailable", name, what as u64);
    }
    for (device, name) in GroundDevice::NAMES {
        each("ground", name, device as u64);
    }
    for joint in Joint::ALL {
        each("joint", joint.name(), joint.index() as u64);
    }
    for segment in Segment::ALL {
        each("segment", segment.name(), segment.index() as u64);
    }
    numbered(each, "phase", |number| Phase::from_number(number).map(Phase::name));
    numbered(each, "level", |number| Level::from_number(number).map(Level::name));
    numbered(each, "sharing", |number| SharingSource::from_number(number).map(SharingSource::name));
    numbered(each, "foot_outline", |number| {
        FootOutlineSource::from_number(number).map(FootOutlineSource::name)
    });
    numbered(each, "acceleration", |number| {
        AccelerationSource::from_number(number).map(AccelerationSource::name)
    });
    numbered(each, "body_source", |number| BodySource::from_number(number).map(BodySource::name));
    numbered(each, "body_rejected", |number| BodyRejection::from_number(number).map(BodyRejection::name));
}

/// The entries of `EarlyState`: a subset of those of `State`.
pub(crate) fn of_early_state(each: Each<'_>) {
    for (reason, name) in Validity::NAMES {
        each("reason", name, reason.0);
    }
    for (set, name) in Validity::FLAG_SETS {
        each("invalidates", name, set.0);
    }
    for joint in Joint::ALL {
        each("joint", joint.name(), joint.index() as u64);
    }
    numbered(each, "acceleration", |number| {
        AccelerationSource::from_number(number).map(AccelerationSource::name)
    });
}

fn numbered(each: Each<'_>, of: &str, name_of: impl Fn(u32) -> Option<&'static str>) {
    for (number, name) in (0..).map_while(|number| name_of(number).map(|name| (number, name))) {
        each(of, name, u64::from(number));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Topic;
    use equipoise_core::message::{Message, State, SuitSample};

    #[test]
    fn another_name_number_or_order_is_another_schema() {
        let one = folded(7, |each| each("level", "red", 3));
        let others: [fn(Each<'_>); 4] = [
            |each| each("level", "red", 4),
            |each| each("level", "amber", 3),
            |each| each("reason", "red", 3),
            |each| (each("level", "red", 3), each("level", "above_max", 4)).1,
        ];
        for other in others {
            assert_ne!(folded(7, other), one);
        }
        assert_ne!(folded(8, |each| each("level", "red", 3)), one);
    }

    #[test]
    fn the_words_of_a_state_are_in_its_schema() {
        assert_ne!(State::schema(), State::SCHEMA_HASH);
        assert_eq!(SuitSample::schema(), SuitSample::SCHEMA_HASH, "it has none");
        let mut count = 0;
        of_state(&mut |_, _, _| count += 1);
        let sets = Validity::NAMES.len() + Validity::FLAG_SETS.len();
        assert!(count > sets + Joint::ALL.len() + Segment::ALL.len() + 20, "{count} words");
    }
}
