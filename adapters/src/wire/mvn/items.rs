//! Payloads that consist of equal items.

use super::Malformed;
use super::header::{DatagramType, Header, Oversized, frame};
use crate::wire::reader::Reader;
use core::marker::PhantomData;

/// One item of a payload.
pub trait Item: Sized {
    /// The type of the datagrams that contain it.
    const DATAGRAM_TYPE: DatagramType;
    /// Bytes of one item.
    const SIZE: usize;

    /// Reads one item.
    fn read(reader: &mut Reader<'_>) -> Option<Self>;
    /// Appends the item.
    fn write(&self, out: &mut Vec<u8>);
}

/// The items of one datagram, in the order of transmission; decoded during iteration.
#[derive(Debug, Clone, Copy)]
pub struct Items<'a, T> {
    reader: Reader<'a>,
    item: PhantomData<T>,
}

impl<'a, T: Item> Items<'a, T> {
    pub(super) fn parse(header: &Header, payload: &'a [u8]) -> Result<Self, Malformed> {
        if payload.len() == usize::from(header.items) * T::SIZE {
            Ok(Items { reader: Reader::new(payload), item: PhantomData })
        } else {
            Err(Malformed::Items {
                datagram_type: header.datagram_type,
                items: header.items,
                payload: payload.len(),
            })
        }
    }
}

impl<T: Item> Iterator for Items<'_, T> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        T::read(&mut self.reader)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.reader.remaining() / T::SIZE;
        (left, Some(left))
    }
}

impl<T: Item> ExactSizeIterator for Items<'_, T> {}

/// Replaces the contents of `out` with one datagram of these items.
pub(super) fn encode<T: Item>(header: &Header, items: &[T], out: &mut Vec<u8>) -> Result<(), Oversized> {
    frame(header, T::DATAGRAM_TYPE, items.len(), out, |out| {
        for item in items {
            item.write(out);
        }
    })
}
