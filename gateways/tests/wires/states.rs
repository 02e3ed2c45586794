//! Test states with a different value in every field.

use bytemuck::Zeroable;
use equipoise_client::Reading;
use equipoise_core::body::JOINTS;
use equipoise_core::message::layout::{Message, Primitive};
use equipoise_core::message::{State, Validity};

/// A state with all numbers different, and all values valid.
pub(crate) fn state() -> State {
    let mut state = State::zeroed();
    let bytes = bytemuck::bytes_of_mut(&mut state);
    let mut number = 0_u32;
    for field in State::FIELDS {
        for at in 0..field.count {
            number += 1;
            let start = field.offset + at * field.primitive.size();
            match field.primitive {
                Primitive::U8 => bytes[start] = number as u8,
                Primitive::U32 => bytes[start..start + 4].copy_from_slice(&number.to_le_bytes()),
                Primitive::U64 => bytes[start..start + 8].copy_from_slice(&u64::from(number).to_le_bytes()),
                Primitive::F64 => {
                    let value = f64::from(number) + 0.25;
                    bytes[start..start + 8].copy_from_slice(&value.to_le_bytes());
                }
            }
        }
    }
    state.valid = 0;
    state.unavailable = 0;
    state.joint_level = std::array::from_fn(|joint| joint as u32 % 6);
    state.worst_joint = JOINTS as u32 - 1;
    state
}

/// A reading with this state.
pub(crate) fn reading(state: State) -> Reading {
    Reading {
        state,
        received_ns: 0,
        age_ns: 1_234_567,
        sample_age_ns: Some(71_234_567),
        missed: 0,
        restarted: false,
        daemon_life: 3,
        is_new: true,
    }
}

/// Every single validity flag alone, none, and all.
pub(crate) fn reasons() -> Vec<Validity> {
    let alone = Validity::NAMES.iter().map(|(reason, _)| *reason);
    let all = alone.clone().fold(Validity::default(), Validity::and);
    alone.chain([Validity::default(), all]).collect()
}
