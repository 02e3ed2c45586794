//! How a message lies in memory: one table per message, made by the `message!` macro.

use bytemuck::Pod;
pub(crate) use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;

/// A number as it lies in memory, little-endian on every supported machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Primitive {
    /// One byte.
    U8,
    /// Unsigned, 4 bytes.
    U32,
    /// Unsigned, 8 bytes.
    U64,
    /// IEEE-754 binary64.
    F64,
}

impl Primitive {
    /// Bytes of one number.
    pub const fn size(self) -> usize {
        match self {
            Primitive::U8 => 1,
            Primitive::U32 => 4,
            Primitive::U64 | Primitive::F64 => 8,
        }
    }

    /// The name that `ros1msg` schemas use (wiki.ros.org/msg, "Fields").
    pub const fn ros_name(self) -> &'static str {
        match self {
            Primitive::U8 => "uint8",
            Primitive::U32 => "uint32",
            Primitive::U64 => "uint64",
            Primitive::F64 => "float64",
        }
    }
}

/// One field of a message: `count` numbers of one kind, row by row if it is a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// The field's name, units last.
    pub name: &'static str,
    /// What each number is.
    pub primitive: Primitive,
    /// How many numbers; 1 for a scalar.
    pub count: usize,
    /// Bytes from the start of the message.
    pub offset: usize,
}

/// What may stand in a message: numbers and (nested) arrays of numbers.
pub trait Cell {
    /// The number at the bottom.
    const PRIMITIVE: Primitive;
    /// How many of them.
    const COUNT: usize;
}

macro_rules! scalar_cell {
    ($($ty:ty => $primitive:ident),*) => {
        $(impl Cell for $ty {
            const PRIMITIVE: Primitive = Primitive::$primitive;
            const COUNT: usize = 1;
        })*
    };
}
scalar_cell!(u8 => U8, u32 => U32, u64 => U64, f64 => F64);

impl<T: Cell, const N: usize> Cell for [T; N] {
    const PRIMITIVE: Primitive = T::PRIMITIVE;
    const COUNT: usize = N * T::COUNT;
}

/// Plain old data with a versioned name and a table of its fields.
pub trait Message: Pod + ZeroCopySend + core::fmt::Debug {
    /// The versioned type name, for example `equipoise/State/1`. A change of layout or of meaning is a new number.
    const TYPE_NAME: &'static str;
    /// The fields in memory order, without gaps.
    const FIELDS: &'static [Field];
    /// FNV-1a over names, kinds, counts and order of the fields.
    ///
    /// iceoryx2 compares type name and size only; this distinguishes two layouts of one size. Recordings hold it. What the
    /// bits and numbers in the fields mean is not in it: who reads the bus agrees on `equipoise_bus::Topic::schema`.
    const SCHEMA_HASH: u64 = schema_hash(Self::TYPE_NAME, Self::FIELDS);

    /// Whether no number is infinite or none at all.
    fn is_finite(&self) -> bool {
        let bytes = bytemuck::bytes_of(self);
        Self::FIELDS.iter().filter(|field| field.primitive == Primitive::F64).all(|field| {
            let numbers = bytes[field.offset..].as_chunks::<8>().0;
            numbers[..field.count].iter().all(|number| f64::from_ne_bytes(*number).is_finite())
        })
    }
}

/// FNV-1a of 64 bits, going on from `hash`.
pub const fn fnv1a(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        index += 1;
    }
    hash
}

const fn schema_hash(type_name: &str, fields: &[Field]) -> u64 {
    let mut hash = fnv1a(0xcbf2_9ce4_8422_2325, type_name.as_bytes());
    let mut index = 0;
    while index < fields.len() {
        let field = fields[index];
        hash = fnv1a(hash, field.name.as_bytes());
        hash = fnv1a(hash, field.primitive.ros_name().as_bytes());
        hash = fnv1a(hash, &(field.count as u64).to_le_bytes());
        index += 1;
    }
    hash
}

/// Declares a message: the struct, its derives, its size assertion and its field table, in one place.
macro_rules! message {
    ($(#[$doc:meta])* as $type_name:tt, $size:literal bytes, pub struct $Name:ident {
        $($(#[$field_doc:meta])* pub $field:ident: $ty:ty,)*
    }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[derive(iceoryx2_bb_derive_macros::ZeroCopySend)]
        #[type_name($type_name)]
        pub struct $Name {
            $($(#[$field_doc])* pub $field: $ty,)*
        }

        impl $crate::message::layout::Message for $Name {
            const TYPE_NAME: &'static str = $type_name;
            const FIELDS: &'static [$crate::message::layout::Field] = &[
                $($crate::message::layout::Field {
                    name: stringify!($field),
                    primitive: <$ty as $crate::message::layout::Cell>::PRIMITIVE,
                    count: <$ty as $crate::message::layout::Cell>::COUNT,
                    offset: core::mem::offset_of!($Name, $field),
                },)*
            ];
        }

        const _: () = assert!(core::mem::size_of::<$Name>() == $size, "the layout is a contract");
    };
}
pub(crate) use message;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{
        AdapterHealth, Command, CycleRecord, GroundSample, Reply, State, SuitBody, SuitSample,
    };

    fn fields_fill_the_message_without_gaps<M: Message>() {
        let mut end = 0;
        for field in M::FIELDS {
            assert_eq!(field.offset, end, "{}::{}", M::TYPE_NAME, field.name);
            end += field.count * field.primitive.size();
        }
        assert_eq!(end, size_of::<M>(), "{}", M::TYPE_NAME);
    }

    #[test]
    fn every_message_is_its_table() {
        fields_fill_the_message_without_gaps::<SuitSample>();
        fields_fill_the_message_without_gaps::<GroundSample>();
        fields_fill_the_message_without_gaps::<SuitBody>();
        fields_fill_the_message_without_gaps::<State>();
        fields_fill_the_message_without_gaps::<CycleRecord>();
        fields_fill_the_message_without_gaps::<AdapterHealth>();
        fields_fill_the_message_without_gaps::<Command>();
        fields_fill_the_message_without_gaps::<Reply>();
    }

    #[test]
    fn another_order_of_fields_is_another_schema() {
        let a = [
            Field { name: "a", primitive: Primitive::F64, count: 1, offset: 0 },
            Field { name: "b", primitive: Primitive::F64, count: 1, offset: 8 },
        ];
        let b = [a[1], a[0]];
        assert_ne!(schema_hash("x/1", &a), schema_hash("x/1", &b));
        assert_ne!(schema_hash("x/1", &a), schema_hash("x/2", &a));
    }
}
