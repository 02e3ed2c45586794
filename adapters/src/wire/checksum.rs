//! Checksums by the names of the RevEng catalogue (<https://reveng.sourceforge.io/crc-catalogue/>), and the plain ones that
//! small boards use.

use crc::{Algorithm, Crc};

/// Checksum of a frame.
#[derive(Clone)]
pub struct Checksum {
    name: &'static str,
    sum: Sum,
}

#[derive(Clone)]
enum Sum {
    Crc8(Box<Crc<u8>>),
    Crc16(Box<Crc<u16>>),
    Crc32(Box<Crc<u32>>),
    /// All bytes added up, modulo 2⁸ or 2¹⁶.
    Added8,
    Added16,
    /// All bytes exclusive-or'd.
    Xor8,
}

impl core::fmt::Debug for Checksum {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for Checksum {
    fn eq(&self, other: &Checksum) -> bool {
        self.name == other.name
    }
}

/// Declares the catalogue that is offered: names, and what they are there.
macro_rules! catalogue {
    ($($names:expr => $Variant:ident $algorithm:ident),* $(,)?) => {
        /// All names that [`Checksum::named`] knows; of one checksum's names the first is the catalogue's.
        pub const NAMES: &[&[&str]] = &[$($names,)* &["SUM-8"], &["SUM-16"], &["XOR-8"]];

        fn of_catalogue(name: &'static str) -> Option<Sum> {
            $(if $names[0] == name {
                return Some($Variant(&crc::$algorithm));
            })*
            match name {
                "SUM-8" => Some(Sum::Added8),
                "SUM-16" => Some(Sum::Added16),
                "XOR-8" => Some(Sum::Xor8),
                _ => None,
            }
        }
    };
}

catalogue! {
    &["CRC-8/SMBUS", "CRC-8"] => crc8 CRC_8_SMBUS,
    &["CRC-8/MAXIM-DOW"] => crc8 CRC_8_MAXIM_DOW,
    &["CRC-8/SAE-J1850"] => crc8 CRC_8_SAE_J1850,
    &["CRC-8/AUTOSAR"] => crc8 CRC_8_AUTOSAR,
    &["CRC-8/ROHC"] => crc8 CRC_8_ROHC,
    &["CRC-16/IBM-SDLC", "CRC-16/X-25"] => crc16 CRC_16_IBM_SDLC,
    &["CRC-16/IBM-3740", "CRC-16/CCITT-FALSE"] => crc16 CRC_16_IBM_3740,
    &["CRC-16/SPI-FUJITSU", "CRC-16/AUG-CCITT"] => crc16 CRC_16_SPI_FUJITSU,
    &["CRC-16/XMODEM"] => crc16 CRC_16_XMODEM,
    &["CRC-16/KERMIT", "CRC-16/CCITT"] => crc16 CRC_16_KERMIT,
    &["CRC-16/GENIBUS"] => crc16 CRC_16_GENIBUS,
    &["CRC-16/MCRF4XX"] => crc16 CRC_16_MCRF4XX,
    &["CRC-16/MODBUS"] => crc16 CRC_16_MODBUS,
    &["CRC-16/ARC"] => crc16 CRC_16_ARC,
    &["CRC-16/USB"] => crc16 CRC_16_USB,
    &["CRC-16/DNP"] => crc16 CRC_16_DNP,
    &["CRC-32/ISO-HDLC", "CRC-32"] => crc32 CRC_32_ISO_HDLC,
    &["CRC-32/ISCSI", "CRC-32C"] => crc32 CRC_32_ISCSI,
    &["CRC-32/MPEG-2"] => crc32 CRC_32_MPEG_2,
    &["CRC-32/BZIP2"] => crc32 CRC_32_BZIP2,
    &["CRC-32/JAMCRC"] => crc32 CRC_32_JAMCRC,
}

fn crc8(algorithm: &'static Algorithm<u8>) -> Sum {
    Sum::Crc8(Box::new(Crc::<u8>::new(algorithm)))
}

fn crc16(algorithm: &'static Algorithm<u16>) -> Sum {
    Sum::Crc16(Box::new(Crc::<u16>::new(algorithm)))
}

fn crc32(algorithm: &'static Algorithm<u32>) -> Sum {
    Sum::Crc32(Box::new(Crc::<u32>::new(algorithm)))
}

impl Checksum {
    /// The checksum with a name of [`NAMES`], in capitals or not.
    pub fn named(name: &str) -> Option<Checksum> {
        let names = NAMES.iter().find(|names| names.iter().any(|known| known.eq_ignore_ascii_case(name)))?;
        let name = names.first().copied()?;
        Some(Checksum { name, sum: of_catalogue(name)? })
    }

    /// How many bytes it takes in a frame.
    pub fn bytes(&self) -> usize {
        match self.sum {
            Sum::Crc8(_) | Sum::Added8 | Sum::Xor8 => 1,
            Sum::Crc16(_) | Sum::Added16 => 2,
            Sum::Crc32(_) => 4,
        }
    }

    /// Of these bytes.
    pub fn of(&self, bytes: &[u8]) -> u64 {
        let added = || bytes.iter().map(|byte| u64::from(*byte)).sum::<u64>();
        match &self.sum {
            Sum::Crc8(crc) => u64::from(crc.checksum(bytes)),
            Sum::Crc16(crc) => u64::from(crc.checksum(bytes)),
            Sum::Crc32(crc) => u64::from(crc.checksum(bytes)),
            Sum::Added8 => added() & 0xff,
            Sum::Added16 => added() & 0xffff,
            Sum::Xor8 => u64::from(bytes.iter().fold(0, |all, byte| all ^ byte)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_known_and_its_checksum_is_the_catalogues() {
        let check = |name: &str| Checksum::named(name).unwrap().of(b"123456789");
        // The column "check" of the catalogue.
        assert_eq!(check("crc-16/x-25"), 0x906e);
        assert_eq!(check("CRC-16/CCITT-FALSE"), 0x29b1);
        assert_eq!(check("CRC-16/MODBUS"), 0x4b37);
        assert_eq!(check("CRC-8"), 0xf4);
        assert_eq!(check("CRC-32"), 0xcbf4_3926);
        assert_eq!((check("SUM-8"), check("SUM-16"), check("XOR-8")), (0xdd, 0x1dd, 0x31));
        for name in NAMES.iter().flat_map(|names| names.iter()) {
            let checksum = Checksum::named(name).unwrap_or_else(|| panic!("{name}"));
            assert!(checksum.of(b"1") < 1 << (8 * checksum.bytes()), "{name}");
        }
        assert!(Checksum::named("CRC-16").is_none(), "there are thirty of them");
    }
}
