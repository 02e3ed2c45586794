//! What a header must say of this library, in one number.

use crate::{EarlyReading, Options, Outcome, Reading};
use equipoise_bus::Topic;
use equipoise_core::message::layout::fnv1a;
use equipoise_core::message::{EarlyState, State};
use std::mem::offset_of;

/// `EQUIPOISE_LAYOUT` of the header: a hash of the fields of state and early state, of every name and number in it (reasons and the values
/// they invalidate, levels, joints), of the outcomes, and of offsets and sizes in the structs of the interface.
pub fn layout() -> u64 {
    let mut hash = State::schema();
    let mut fold =
        |name: &str, number: u64| hash = fnv1a(fnv1a(hash, name.as_bytes()), &number.to_le_bytes());
    fold("early", EarlyState::schema());
    for (name, number) in structs() {
        fold(name, number as u64);
    }
    for (outcome, name) in Outcome::ALL {
        fold(name, outcome as u64);
    }
    hash
}

fn structs() -> Vec<(&'static str, usize)> {
    let mut places = Vec::new();
    macro_rules! places {
        ($($Type:ident { $($field:ident),* })*) => {
            $(// Without one of the fields this does not compile.
              let _every_field_is_named = |$Type { $($field: _),* }: $Type| ();
              places.push((stringify!($Type), size_of::<$Type>()));
              $(places.push((stringify!($field), offset_of!($Type, $field)));)*)*
        };
    }
    places! {
        EarlyReading { early, received_ns, age_ns, sample_age_ns, is_new, reserved }
        Reading { state, received_ns, age_ns, sample_age_ns, missed, restarted, is_new }
        Options { layout, stale_after_ns, depth, no_report }
    }
    places
}
