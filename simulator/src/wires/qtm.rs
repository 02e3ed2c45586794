//! Qualisys Track Manager's real-time protocol: packets of size, type and content over TCP, little-endian.
//!
//! After the makers' public client `qualisys_python_sdk`.

/// The little-endian port.
pub const PORT: u16 = 22_223;
/// QTM's greeting for a new connection.
pub const WELCOME: &str = "QTM RT Interface connected";

/// Types of packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// An error message.
    Error = 0,
    /// A command or the answer to one.
    Command = 1,
    /// Settings.
    Xml = 2,
    /// A frame.
    Data = 3,
    /// No more data to stream.
    NoMoreData = 4,
    /// One byte: the event.
    Event = 6,
}

/// A packet: size of the whole, type, content.
pub fn packet(kind: Kind, content: &[u8]) -> Vec<u8> {
    let mut bytes = (8 + content.len() as u32).to_le_bytes().to_vec();
    bytes.extend_from_slice(&(kind as u32).to_le_bytes());
    bytes.extend_from_slice(content);
    bytes
}

/// A text with its terminator.
pub fn text_packet(kind: Kind, text: &str) -> Vec<u8> {
    let mut content = text.as_bytes().to_vec();
    content.push(0);
    packet(kind, &content)
}

/// Data of one plate in a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plate {
    /// Its number, from 1.
    pub id: i32,
    /// Number of the first force.
    pub force_number: i32,
    /// Forces since the last frame: force (N), moment (N m), point of application (mm).
    pub forces: Vec<[f32; 9]>,
}

fn component(kind: u32, content: &[u8]) -> Vec<u8> {
    let mut bytes = (8 + content.len() as u32).to_le_bytes().to_vec();
    bytes.extend_from_slice(&kind.to_le_bytes());
    bytes.extend_from_slice(content);
    bytes
}

fn floats(out: &mut Vec<u8>, numbers: &[f32]) {
    for number in numbers {
        out.extend_from_slice(&number.to_le_bytes());
    }
}

/// Component 4: all forces of each plate since the last frame.
pub fn force_component(plates: &[Plate]) -> Vec<u8> {
    let mut content = (plates.len() as i32).to_le_bytes().to_vec();
    for plate in plates {
        for number in [plate.id, plate.forces.len() as i32, plate.force_number] {
            content.extend_from_slice(&number.to_le_bytes());
        }
        floats(&mut content, plate.forces.as_flattened());
    }
    component(4, &content)
}

/// Component 15: the last force of each plate; a plate without forces is left out.
pub fn force_single_component(plates: &[Plate]) -> Vec<u8> {
    let with_force: Vec<_> =
        plates.iter().filter_map(|plate| Some((plate.id, plate.forces.last()?))).collect();
    let mut content = (with_force.len() as i32).to_le_bytes().to_vec();
    for (id, force) in with_force {
        content.extend_from_slice(&id.to_le_bytes());
        floats(&mut content, force);
    }
    component(15, &content)
}

/// A data packet of components.
pub fn data(timestamp_us: i64, frame: u32, components: &[Vec<u8>]) -> Vec<u8> {
    let mut content = timestamp_us.to_le_bytes().to_vec();
    content.extend_from_slice(&frame.to_le_bytes());
    content.extend_from_slice(&(components.len() as u32).to_le_bytes());
    content.extend(components.iter().flatten());
    packet(Kind::Data, &content)
}

/// A client's command.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Stream at this rate (`None`: all frames), with these components.
    Stream {
        /// `Frequency:…`; `AllFrames` is `None`.
        rate_hz: Option<f64>,
        /// `FrequencyDivisor:…`: only every n-th frame.
        divisor: u32,
        /// `Force`.
        force: bool,
        /// `ForceSingle`.
        single: bool,
    },
    /// Stop streaming.
    Stop,
    /// Settings of the plates.
    Parameters,
    /// Answered with this text.
    Answered(String),
    /// Unknown command.
    Unknown,
}

/// Parses a command's text.
pub fn command(text: &str) -> Command {
    let words: Vec<&str> = text.trim_end_matches('\0').split_whitespace().collect();
    let is = |word: &str, name: &str| word.eq_ignore_ascii_case(name);
    match words[..] {
        [verb, version] if is(verb, "version") => Command::Answered(format!("Version set to {version}")),
        [verb] if is(verb, "version") => Command::Answered("Version is 1.25".into()),
        [verb] if is(verb, "qtmversion") => Command::Answered("QTM Version is 2024.1".into()),
        [verb] if is(verb, "byteorder") => Command::Answered("Byte order is little endian".into()),
        [verb, what] if is(verb, "streamframes") && is(what, "stop") => Command::Stop,
        [verb, how, ref components @ ..] if is(verb, "streamframes") && !components.is_empty() => {
            let (key, value) = how.split_once(':').unwrap_or((how, ""));
            let rate_hz = value.parse().ok().filter(|_| is(key, "frequency"));
            let divisor = value.parse().ok().filter(|_| is(key, "frequencydivisor")).unwrap_or(1);
            let asked = |name: &str| components.iter().any(|component| is(component, name));
            Command::Stream { rate_hz, divisor, force: asked("force"), single: asked("forcesingle") }
        }
        [verb, ..] if is(verb, "getparameters") => Command::Parameters,
        _ => Command::Unknown,
    }
}

/// Removes the first complete packet from the received bytes: its type and its text.
pub fn take_packet(bytes: &mut Vec<u8>) -> Option<(u32, String)> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let (size, kind) = (word(0)?.max(8) as usize, word(4)?);
    if bytes.len() < size {
        return None;
    }
    let text = String::from_utf8_lossy(&bytes[8..size]).into_owned();
    bytes.drain(..size);
    Some((kind, text))
}

/// The plates' settings: size and corners (mm), in QTM's format.
pub fn parameters(plates: &[[[f64; 3]; 4]]) -> String {
    let mut xml = String::from(
        "<QTM_Parameters_Ver_1.25><Force><Unit_Length>mm</Unit_Length><Unit_Force>N</Unit_Force>",
    );
    for (id, corners) in (1..).zip(plates) {
        let side = |from: usize, to: usize| {
            let [a, b] = [corners[from], corners[to]];
            (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
        };
        xml += &format!(
            "<Plate><Plate_ID>{id}</Plate_ID><Name>Force-plate {id}</Name><Length>{:.1}</Length><Width>{:.1}</Width>\
             <Location>",
            side(0, 1),
            side(1, 2)
        );
        for (number, [x, y, z]) in (1..).zip(corners) {
            xml += &format!("<Corner{number}><X>{x:.3}</X><Y>{y:.3}</Y><Z>{z:.3}</Z></Corner{number}>");
        }
        xml += "</Location></Plate>";
    }
    xml + "</Force></QTM_Parameters_Ver_1.25>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_understood_however_they_are_written() {
        assert_eq!(command("Version 1.25\0"), Command::Answered("Version set to 1.25".into()));
        assert_eq!(
            command("StreamFrames Frequency:100 Force"),
            Command::Stream { rate_hz: Some(100.0), divisor: 1, force: true, single: false }
        );
        assert_eq!(
            command("streamframes FrequencyDivisor:4 ForceSingle"),
            Command::Stream { rate_hz: None, divisor: 4, force: false, single: true }
        );
        assert_eq!(command("StreamFrames Stop"), Command::Stop);
        assert_eq!(command("Dance"), Command::Unknown);
        let mut sent = text_packet(Kind::Command, "Version 1.25");
        sent.extend_from_slice(&[9, 0]);
        assert_eq!(take_packet(&mut sent), Some((1, "Version 1.25\0".into())));
        assert_eq!((take_packet(&mut sent), sent.len()), (None, 2));
    }

    #[test]
    fn a_frame_of_two_plates_has_the_sizes_of_the_protocol() {
        let plates = [1, 2].map(|id| Plate { id, force_number: 7, forces: vec![[1.5; 9]; 3] });
        let force = force_component(&plates);
        assert_eq!(force.len(), 8 + 4 + 2 * (12 + 3 * 36));
        let single = force_single_component(&plates);
        assert_eq!(single.len(), 8 + 4 + 2 * (4 + 36));
        let packet = data(1_000_000, 100, &[force, single]);
        assert_eq!(packet[..4], (packet.len() as u32).to_le_bytes());
        assert_eq!(packet[4..8], [3, 0, 0, 0]);
        assert_eq!(packet[8..24], *b"\x40\x42\x0f\0\0\0\0\0\x64\0\0\0\x02\0\0\0");
    }
}
