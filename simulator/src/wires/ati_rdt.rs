//! ATI's raw data transfer (Net F/T, Axia): requests of 8 bytes, records of 36, big-endian, over UDP; and the page
//! `netftapi2.xml` with the scale of the counts.
//!
//! After ATI 9620-05-Net FT, section 10, and the Axia manuals.

/// The device's port.
pub const DEFAULT_PORT: u16 = 49152;

/// Host commands. Command numbers of the other family are ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// 0: no more records.
    Stop,
    /// 2 (Net F/T) and 1 (Axia): one record a datagram.
    Stream,
    /// 3: several records a datagram.
    StreamBlocks,
    /// 0x41.
    ResetLatch,
    /// 0x42: zero the present load.
    Bias,
}

/// The two families, which number their commands differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Family {
    /// Net F/T: 2 streams, 3 in blocks, 4 for several units.
    #[default]
    NetFt,
    /// Axia: 1 streams, 3 in blocks.
    Axia,
}

/// A host's request: command, and number of records (0: without end). `None` if a device of the family would not
/// answer.
pub fn request(bytes: &[u8], family: Family) -> Option<(Command, u32)> {
    let [0x12, 0x34, high, low, count @ ..] = bytes else { return None };
    let command = match (u16::from_be_bytes([*high, *low]), family) {
        (0, _) => Command::Stop,
        (2 | 4, Family::NetFt) | (1, Family::Axia) => Command::Stream,
        (3, _) => Command::StreamBlocks,
        (0x41, _) => Command::ResetLatch,
        (0x42, _) => Command::Bias,
        _ => return None,
    };
    Some((command, u32::from_be_bytes(count.try_into().ok()?)))
}

/// One record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Record {
    /// Counts the records sent since the request, from 1.
    pub rdt_sequence: u32,
    /// The sensor's own count of samples.
    pub ft_sequence: u32,
    /// 0 means no fault.
    pub status: u32,
    /// Fx Fy Fz in counts.
    pub force_counts: [i32; 3],
    /// Tx Ty Tz in counts.
    pub torque_counts: [i32; 3],
}

impl Record {
    /// The 36 bytes.
    pub fn to_bytes(&self) -> [u8; 36] {
        let head = [self.rdt_sequence, self.ft_sequence, self.status].map(u32::to_be_bytes);
        let counts = [self.force_counts, self.torque_counts].as_flattened().to_vec();
        let mut bytes = [0; 36];
        let words = head.into_iter().chain(counts.into_iter().map(i32::to_be_bytes));
        for (place, word) in bytes.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word);
        }
        bytes
    }
}

/// Content of `netftapi2.xml`.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// Counts per unit of force and of torque.
    pub counts_per_unit: [f64; 2],
    /// Names of the units: `N` and `Nm`, or others.
    pub units: [String; 2],
    /// Whether RDT is switched on.
    pub rdt_enabled: bool,
    /// Records a second.
    pub rate_hz: u32,
    /// Records of a block.
    pub block: u32,
}

impl Page {
    /// The page, as the device writes it.
    pub fn to_xml(&self) -> String {
        let [cpf, cpt] = self.counts_per_unit;
        let [force, torque] = &self.units;
        let enabled = if self.rdt_enabled { "Enabled" } else { "Disabled" };
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<netft>\n<runstat>0</runstat>\n<cfgnam>Config #1</cfgnam>\n\
             <cfgfu>{force}</cfgfu>\n<scfgfu>{force}</scfgfu>\n<cfgtu>{torque}</cfgtu>\n<scfgtu>{torque}</scfgtu>\n\
             <cfgcpf>{cpf}</cfgcpf>\n<cfgcpt>{cpt}</cfgcpt>\n<comrdte>{enabled}</comrdte>\n\
             <comrdtrate>{rate}</comrdtrate>\n<comrdtbsiz>{block}</comrdtbsiz>\n</netft>\n",
            rate = self.rate_hz,
            block = self.block,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_number_their_commands_differently() {
        let ask = |number: u8, family| request(&[0x12, 0x34, 0, number, 0, 0, 0, 9], family);
        assert_eq!(ask(2, Family::NetFt), Some((Command::Stream, 9)));
        assert_eq!(ask(2, Family::Axia), None);
        assert_eq!(ask(1, Family::Axia), Some((Command::Stream, 9)));
        assert_eq!(ask(1, Family::NetFt), None);
        assert_eq!(ask(0x42, Family::Axia), Some((Command::Bias, 9)));
        assert_eq!(request(&[0x12, 0x34, 0, 2, 0, 0, 0], Family::NetFt), None);
        assert_eq!(request(b"\x12\x35\0\x02\0\0\0\0", Family::NetFt), None);
    }

    #[test]
    fn the_page_names_counts_and_units() {
        let page = Page {
            counts_per_unit: [1_000_000.0, 1_000_000.0],
            units: ["N".into(), "Nm".into()],
            rdt_enabled: true,
            rate_hz: 1000,
            block: 40,
        };
        let xml = page.to_xml();
        for part in ["<cfgcpf>1000000</cfgcpf>", "<scfgtu>Nm</scfgtu>", "<comrdte>Enabled</comrdte>"] {
            assert!(xml.contains(part), "{xml}");
        }
    }
}
