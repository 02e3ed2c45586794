//! Check sums of 16 bits over the polynomial 0x1021.

/// CRC-16/X-25: reflected, starts with ones, inverted at the end. `123456789` gives 0x906E.
pub fn x25(bytes: &[u8]) -> u16 {
    !bytes.iter().fold(0xffff, |sum: u16, byte| {
        (0..8).fold(
            sum ^ u16::from(*byte),
            |sum, _| {
                if sum & 1 == 1 { (sum >> 1) ^ 0x8408 } else { sum >> 1 }
            },
        )
    })
}

/// CRC-16/CCITT-FALSE: highest bit first, starts with ones. `123456789` gives 0x29B1.
pub fn ccitt_false(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |sum: u16, byte| {
        (0..8).fold(sum ^ (u16::from(*byte) << 8), |sum, _| {
            if sum & 0x8000 != 0 { (sum << 1) ^ 0x1021 } else { sum << 1 }
        })
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_check_values_are_those_of_the_catalogue() {
        assert_eq!(super::x25(b"123456789"), 0x906e);
        assert_eq!(super::ccitt_false(b"123456789"), 0x29b1);
    }
}
