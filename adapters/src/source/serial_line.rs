//! A serial port as a way to a device: raw bytes, for us alone, of any speed, unplugged and plugged in again.
//!
//! Through `rustix` rather than a crate for serial ports: it tells the kernel's own error numbers apart (unplugged, taken,
//! forbidden are three different things to do), counts unread bytes, and needs no unsafe code.

mod refused;

use super::error::SourceError;
use super::transport::{Incoming, Transport};
use crate::clock::now_monotonic_ns;
use refused::{gone, no_port, refused, stuck, wrong_speed};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FileType, FlockOperation, Mode, OFlags, flock, fstat, major};
use rustix::io::{Errno, ioctl_fionread, read, write};
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, SpecialCodeIndex, ioctl_tiocexcl, tcflush, tcgetattr,
    tcsetattr,
};
use std::os::fd::OwnedFd;
use std::path::PathBuf;

/// How long one wait for bytes lasts.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
/// A device that takes no byte for so long does not listen.
const SEND_WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 200_000_000 };
/// What one read takes at most; the kernel holds no more for a serial port.
const BUFFER_SIZE: usize = 4096;
/// Start, eight bits, stop.
const BITS_PER_BYTE: u64 = 10;
const NS_PER_S: u64 = 1_000_000_000;
/// The kernel's numbers for the near ends of pseudo terminals.
const PSEUDO_TERMINALS: core::ops::RangeInclusive<u32> = 136..=143;

/// Who says when bytes may be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Flow {
    /// Nobody: bytes are sent when they are there.
    #[default]
    Free,
    /// The wires RTS and CTS.
    RtsCts,
}

/// Which line, and how it is used. Always eight bits, no parity, one stop bit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineSettings {
    /// The port's file, for example `/dev/ttyUSB0`.
    pub port: PathBuf,
    /// Speed at which the line is opened, baud.
    pub baud: u32,
    /// Who says when bytes may be sent.
    pub flow: Flow,
    /// The configuration key that names the port, for errors.
    pub key: &'static str,
}

/// One serial port.
#[derive(Debug)]
pub struct SerialLine {
    settings: LineSettings,
    /// As it is now: devices change it while they are talked to.
    baud: u32,
    open: Option<OwnedFd>,
    buffer: Box<[u8]>,
    last_arrival_ns: u64,
}

impl SerialLine {
    /// A line that is not open yet.
    pub fn new(settings: LineSettings) -> SerialLine {
        let baud = settings.baud;
        SerialLine {
            settings,
            baud,
            open: None,
            buffer: vec![0; BUFFER_SIZE].into_boxed_slice(),
            last_arrival_ns: 0,
        }
    }

    fn fd(&self) -> Result<&OwnedFd, SourceError> {
        let settings = &self.settings;
        self.open.as_ref().ok_or_else(|| gone(settings, "it was closed"))
    }

    /// Closes at once, so that a port that is plugged in again gets its old name, and says why.
    fn lost(&mut self, why: &str) -> SourceError {
        self.open = None;
        gone(&self.settings, why)
    }

    /// When the newest of the bytes just read came, at the latest.
    ///
    /// What is still unread was sent after them, so they came at least as much earlier as the line needs for that. USB
    /// adapters hand on bytes in blocks, later than they came; the clock fit takes the earliest for its measure anyway.
    fn arrival_ns(&mut self, read_ns: u64, unread: u64) -> u64 {
        let later_ns = unread.saturating_mul(BITS_PER_BYTE * NS_PER_S) / u64::from(self.baud.max(1));
        self.last_arrival_ns = read_ns.saturating_sub(later_ns).max(self.last_arrival_ns);
        self.last_arrival_ns
    }
}

impl Transport for SerialLine {
    fn open(&mut self) -> Result<(), SourceError> {
        self.open = None;
        self.baud = self.settings.baud;
        let settings = &self.settings;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(&settings.port, flags, Mode::empty())
            .map_err(|errno| refused(settings, errno))?;
        let stat = fstat(&fd).map_err(|errno| refused(settings, errno))?;
        if FileType::from_raw_mode(stat.st_mode) != FileType::CharacterDevice {
            return Err(no_port(settings));
        }
        // Two kinds of lock: this one keeps out whoever asks, root too, …
        flock(&fd, FlockOperation::NonBlockingLockExclusive)
            .map_err(|errno| refused(settings, if errno == Errno::AGAIN { Errno::BUSY } else { errno }))?;
        // … and this one whoever does not ask. A pseudo terminal would keep the mark as long as its far end lives,
        // however long we are gone.
        if !PSEUDO_TERMINALS.contains(&major(stat.st_rdev)) {
            ioctl_tiocexcl(&fd).map_err(|errno| refused(settings, errno))?;
        }
        set_up(&fd, settings, self.baud)?;
        self.open = Some(fd);
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        let fd = self.fd()?;
        let mut wait = [PollFd::new(fd, PollFlags::IN)];
        match poll(&mut wait, Some(&WAIT)) {
            Ok(0) | Err(Errno::INTR) => return Ok(None),
            Ok(_) => {}
            Err(errno) => return Err(self.lost(&errno.to_string())),
        }
        let read_ns = now_monotonic_ns();
        let unplugged = "it was unplugged";
        let Some(fd) = &self.open else { return Err(self.lost(unplugged)) };
        let count = match read(fd, &mut *self.buffer) {
            // Woken up for nothing: the other end hung up.
            Ok(0) | Err(Errno::IO | Errno::NXIO | Errno::NODEV) => return Err(self.lost(unplugged)),
            Ok(count) => count,
            Err(Errno::AGAIN | Errno::INTR) => return Ok(None),
            Err(errno) => return Err(self.lost(&errno.to_string())),
        };
        // A line that cannot tell is read as fast as it comes.
        let unread = ioctl_fionread(self.fd()?).unwrap_or(0);
        let arrival_ns = self.arrival_ns(read_ns, unread);
        let bytes = self.buffer.get(..count).unwrap_or_default();
        Ok(Some(Incoming { bytes, arrival_ns, admitted: true }))
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        let mut rest = bytes;
        while !rest.is_empty() {
            let fd = self.fd()?;
            match write(fd, rest) {
                Ok(count) => rest = rest.get(count..).unwrap_or_default(),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => {
                    let mut wait = [PollFd::new(fd, PollFlags::OUT)];
                    if poll(&mut wait, Some(&SEND_WAIT)) == Ok(0) {
                        self.open = None;
                        return Err(stuck(&self.settings));
                    }
                }
                Err(errno) => return Err(self.lost(&errno.to_string())),
            }
        }
        Ok(())
    }

    /// At once: whatever was sent before must have had its time. What came at the old speed and was not read is gone.
    fn set_speed(&mut self, baud: u32) -> Result<(), SourceError> {
        set_up(self.fd()?, &self.settings, baud).inspect_err(|_| self.open = None)?;
        self.baud = baud;
        Ok(())
    }
}

/// Raw bytes at a speed; the driver's answer is read back, since many say yes to what they cannot do.
fn set_up(fd: &OwnedFd, settings: &LineSettings, baud: u32) -> Result<(), SourceError> {
    let failed = |errno| refused(settings, errno);
    let mut line = tcgetattr(fd).map_err(failed)?;
    line.make_raw();
    line.control_modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
    // No carrier is waited for: plates have no modems.
    line.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
    if settings.flow == Flow::RtsCts {
        line.control_modes |= ControlModes::CRTSCTS;
    }
    // With at least one byte asked for, a read of nothing means that the other end hung up.
    line.special_codes[SpecialCodeIndex::VMIN] = 1;
    line.special_codes[SpecialCodeIndex::VTIME] = 0;
    line.set_speed(baud).map_err(|_| wrong_speed(settings, baud, None))?;
    tcsetattr(fd, OptionalActions::Now, &line).map_err(|errno| match errno {
        Errno::INVAL => wrong_speed(settings, baud, None),
        errno => failed(errno),
    })?;
    let is = tcgetattr(fd).map_err(failed)?.output_speed();
    // Made of a clock by division, no speed is exact; three per cent is what a byte of ten bits bears.
    if is.abs_diff(baud) > baud / 33 {
        return Err(wrong_speed(settings, baud, Some(is)));
    }
    tcflush(fd, QueueSelector::IFlush).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_others_follow_came_earlier_and_arrivals_never_step_back() {
        let settings =
            LineSettings { port: PathBuf::new(), baud: 100_000, flow: Flow::Free, key: "ground.serial.port" };
        let mut line = SerialLine::new(settings);
        assert_eq!(line.arrival_ns(1_000_000_000, 0), 1_000_000_000);
        // A hundred bytes of ten bits at 100 kbaud take 10 ms.
        assert_eq!(line.arrival_ns(1_020_000_000, 100), 1_010_000_000);
        assert_eq!(line.arrival_ns(1_021_000_000, 4000), 1_010_000_000);
    }
}
