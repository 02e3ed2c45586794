//! The loop's whole memory, for recorders and for saving.

use super::Memory;
use crate::message::layout::{ZeroCopySend, message};

/// The memory in numbers of 8 bytes.
pub const WORDS: usize = size_of::<Memory>() / 8;
const _: () = assert!(size_of::<Memory>() == 8 * WORDS, "the memory is whole words");

message! {
    /// A copy of the loop's memory after one cycle. Opaque: only the version that wrote it reads it.
    as "equipoise/Checkpoint/1", 1029040 bytes,
    pub struct Checkpoint {
        /// The cycle after which it was taken.
        pub cycle: u64,
        /// `core::cycle::memory::MEMORY_VERSION`.
        pub memory_version: u64,
        /// Number of the reload whose settings the loop uses; 0 for those of the daemon's start.
        pub settings_number: u64,
        /// The bytes of `core::cycle::Memory`.
        pub words: [u64; WORDS],
    }
}

impl Checkpoint {
    /// Writes a copy of the memory.
    pub fn take(&mut self, cycle: u64, memory: &Memory) {
        self.cycle = cycle;
        self.memory_version = memory.version;
        bytemuck::bytes_of_mut(&mut self.words).copy_from_slice(bytemuck::bytes_of(memory));
    }

    /// The memory, unless another version wrote it or a number in it is out of range.
    pub fn memory(&self) -> Option<&Memory> {
        let memory: &Memory = bytemuck::try_cast_ref(&self.words).ok()?;
        memory.is_sound().then_some(memory)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::Message;

    #[test]
    fn the_table_fills_the_message() {
        let end = Checkpoint::FIELDS.last().map(|field| field.offset + field.count * field.primitive.size());
        assert_eq!(end, Some(size_of::<Checkpoint>()));
    }
}
