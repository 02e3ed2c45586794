//! Two 16-bit cyclic redundancy checks with the generator polynomial 0x1021, for the frames of simulated devices.
//!
//! Parameters and check values are those of the RevEng catalogue. The implementation is independent of the crate that
//! the adapters use, as is every wire format of the simulator.

/// CRC-16/X-25: reflected, initial value 0xFFFF, inverted at the end. Check value (CRC of `123456789`): 0x906E.
pub fn x25(bytes: &[u8]) -> u16 {
    !bytes.iter().fold(0xffff, |crc: u16, byte| {
        (0..8).fold(
            crc ^ u16::from(*byte),
            |crc, _| {
                if crc & 1 == 1 { (crc >> 1) ^ 0x8408 } else { crc >> 1 }
            },
        )
    })
}

/// CRC-16/CCITT-FALSE: most significant bit first, initial value 0xFFFF. Check value: 0x29B1.
pub fn ccitt_false(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc: u16, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| {
            if crc & 0x8000 != 0 { (crc << 1) ^ 0x1021 } else { crc << 1 }
        })
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn check_values_are_those_of_the_catalogue() {
        assert_eq!(super::x25(b"123456789"), 0x906e);
        assert_eq!(super::ccitt_false(b"123456789"), 0x29b1);
    }
}
