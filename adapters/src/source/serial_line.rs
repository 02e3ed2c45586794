//! Serial port as a transport: raw bytes, exclusive use, any speed, reconnection after unplugging.
//!
//! Uses `rustix` rather than a crate for serial ports: it distinguishes the kernel's error numbers (unplugged, in use
//! and forbidden need different remedies), counts unread bytes, and needs no unsafe code.

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

/// Timeout of one wait for bytes.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
/// A device that accepts no byte for this long does not receive.
const SEND_WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 200_000_000 };
/// Size of one read; the kernel buffers no more for a serial port.
const BUFFER_SIZE: usize = 4096;
/// Start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u64 = 10;
const NS_PER_S: u64 = 1_000_000_000;
/// The kernel's major device numbers of the near ends of pseudo terminals.
const PSEUDO_TERMINALS: core::ops::RangeInclusive<u32> = 136..=143;

/// Flow control.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Flow {
    /// None: bytes are sent at once.
    #[default]
    Free,
    /// RTS and CTS lines.
    RtsCts,
}

/// Port and use of the line. Always eight bits, no parity, one stop bit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineSettings {
    /// The port's file, for example `/dev/ttyUSB0`.
    pub port: PathBuf,
    /// Speed at which the line is opened, baud.
    pub baud: u32,
    /// Flow control.
    pub flow: Flow,
    /// The configuration key that names the port, for errors.
    pub key: &'static str,
}

/// One serial port.
#[derive(Debug)]
pub struct SerialLine {
    settings: LineSettings,
    /// Current speed: devices change it during the dialogue.
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

    /// Closes at once, so that a port that is plugged in again obtains its old name; returns the error.
    fn lost(&mut self, why: &str) -> SourceError {
        self.open = None;
        gone(&self.settings, why)
    }

    /// Latest possible arrival of the newest of the bytes just read.
    ///
    /// Unread bytes were sent after them, so the bytes arrived at least the transmission time of the unread ones
    /// earlier. USB adapters deliver bytes in blocks, later than they arrive; the clock fit uses the earliest arrivals,
    /// so this does not matter.
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
        // Two kinds of lock: this one excludes all programs that check it, those of root included, …
        flock(&fd, FlockOperation::NonBlockingLockExclusive)
            .map_err(|errno| refused(settings, if errno == Errno::AGAIN { Errno::BUSY } else { errno }))?;
        // … and this one those that do not check. On a pseudo terminal it would persist as long as the far end exists,
        // long after this process.
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
            // Woken without data: the other end hung up.
            Ok(0) | Err(Errno::IO | Errno::NXIO | Errno::NODEV) => return Err(self.lost(unplugged)),
            Ok(count) => count,
            Err(Errno::AGAIN | Errno::INTR) => return Ok(None),
            Err(errno) => return Err(self.lost(&errno.to_string())),
        };
        // A line without this count is read as fast as data arrive.
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

    /// At once: the caller allows earlier output the time to be sent. Unread input at the old speed is discarded.
    fn set_speed(&mut self, baud: u32) -> Result<(), SourceError> {
        set_up(self.fd()?, &self.settings, baud).inspect_err(|_| self.open = None)?;
        self.baud = baud;
        Ok(())
    }
}

/// Sets raw mode and speed; the settings are read back, as many drivers accept values that they do not support.
fn set_up(fd: &OwnedFd, settings: &LineSettings, baud: u32) -> Result<(), SourceError> {
    let failed = |errno| refused(settings, errno);
    let mut line = tcgetattr(fd).map_err(failed)?;
    line.make_raw();
    line.control_modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
    // Ignores the carrier: plates have no modems.
    line.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
    if settings.flow == Flow::RtsCts {
        line.control_modes |= ControlModes::CRTSCTS;
    }
    // With a minimum of one byte, an empty read means that the other end hung up.
    line.special_codes[SpecialCodeIndex::VMIN] = 1;
    line.special_codes[SpecialCodeIndex::VTIME] = 0;
    line.set_speed(baud).map_err(|_| wrong_speed(settings, baud, None))?;
    tcsetattr(fd, OptionalActions::Now, &line).map_err(|errno| match errno {
        Errno::INVAL => wrong_speed(settings, baud, None),
        errno => failed(errno),
    })?;
    let is = tcgetattr(fd).map_err(failed)?.output_speed();
    // Speeds are divided from a clock and not exact; a byte of ten bits tolerates three per cent.
    if is.abs_diff(baud) > baud / 33 {
        return Err(wrong_speed(settings, baud, Some(is)));
    }
    tcflush(fd, QueueSelector::IFlush).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrival_times_account_for_later_bytes_and_do_not_decrease() {
        let settings =
            LineSettings { port: PathBuf::new(), baud: 100_000, flow: Flow::Free, key: "ground.serial.port" };
        let mut line = SerialLine::new(settings);
        assert_eq!(line.arrival_ns(1_000_000_000, 0), 1_000_000_000);
        // 100 bytes of ten bits at 100 kbaud take 10 ms.
        assert_eq!(line.arrival_ns(1_020_000_000, 100), 1_010_000_000);
        assert_eq!(line.arrival_ns(1_021_000_000, 4000), 1_010_000_000);
    }
}
