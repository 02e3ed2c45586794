//! A serial line: a pair of pseudo-terminals. The host opens a name that stays the same across reconnections; the
//! device has the other end.
//!
//! Pseudo-terminals have no baud rate, so the device reads the host's setting: if it differs from its own, both receive
//! only noise, as on a real line.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};

use super::port::Port;
use crate::random::Random;

/// Buffer of a USB converter for a slow host, bytes.
const WAITING_MAX: usize = 1 << 16;

/// A host's end counts as open once these are cleared: a line that still echoes is being opened.
const NOT_YET: LocalModes = LocalModes::ECHO.union(LocalModes::ICANON);

/// The device's end.
#[derive(Debug)]
pub struct SerialPort {
    name: PathBuf,
    master: Option<File>,
    baud: u32,
    session: u64,
    host: Host,
    /// Written, and not yet accepted by the kernel.
    waiting: Vec<u8>,
    noise: Random,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Host {
    /// No process has opened the line.
    Away,
    /// Open at a different baud rate.
    Deaf,
    /// Open at the device's baud rate.
    There,
}

impl SerialPort {
    /// A line with a name (a symbolic link, created here and removed with the port), at the device's baud rate.
    ///
    /// # Errors
    /// The name is in use, or there are no pseudo-terminals.
    pub fn new(name: &Path, baud: u32) -> io::Result<SerialPort> {
        let noise = Random::new(u64::from(baud), "serial noise");
        let mut port = SerialPort {
            name: name.to_owned(),
            master: None,
            baud,
            session: 0,
            host: Host::Away,
            waiting: Vec::new(),
            noise,
        };
        port.plug()?;
        Ok(port)
    }

    /// The name that hosts open.
    pub fn name(&self) -> &Path {
        &self.name
    }

    fn look(&mut self) -> io::Result<()> {
        let Some(master) = &self.master else { return Ok(()) };
        let settings = tcgetattr(master)?;
        let mut ends = [PollFd::new(master, PollFlags::IN)];
        poll(&mut ends, Some(&Timespec::default()))?;
        let hung_up = ends[0].revents().contains(PollFlags::HUP);
        let now = if hung_up || settings.local_modes.intersects(NOT_YET) {
            Host::Away
        } else if settings.output_speed() == self.baud {
            Host::There
        } else {
            Host::Deaf
        };
        if self.host == Host::Away && now != Host::Away {
            self.session += 1;
            self.waiting.clear();
        }
        self.host = now;
        Ok(())
    }
}

impl Port for SerialPort {
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        let Some(master) = &mut self.master else { return Ok(Vec::new()) };
        let mut bytes = [0; 4096];
        let received = match master.read(&mut bytes) {
            Ok(length) => bytes[..length].to_vec(),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Vec::new(),
            // The kernel's error if no host has the line open.
            Err(error) if error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error()) => {
                self.host = Host::Away;
                return Ok(Vec::new());
            }
            Err(error) => return Err(error),
        };
        self.look()?;
        // At another baud rate the bits differ.
        Ok(if self.host == Host::There { received } else { Vec::new() })
    }

    fn is_open(&self) -> bool {
        self.host != Host::Away
    }

    fn session(&self) -> u64 {
        self.session
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.look()?;
        let Some(master) = &mut self.master else { return Ok(()) };
        match self.host {
            Host::Away => return Ok(()),
            Host::There => self.waiting.extend_from_slice(bytes),
            Host::Deaf => {
                let noise = bytes.iter().map(|_| self.noise.between(0.0, 256.0) as u8);
                self.waiting.extend(noise);
            }
        }
        // If the host stops reading, the buffer overflows and its content is lost, as in a converter.
        if self.waiting.len() > WAITING_MAX {
            self.waiting.clear();
        }
        match master.write(&self.waiting) {
            Ok(count) => drop(self.waiting.drain(..count)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) if error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error()) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn set_baud(&mut self, baud: u32) {
        self.baud = baud;
    }

    fn unplug(&mut self) {
        // As when a USB converter is unplugged: the name disappears, and processes that hold it open get an error.
        if self.master.take().is_some() {
            let _ = std::fs::remove_file(&self.name);
        }
        self.host = Host::Away;
    }

    fn plug(&mut self) -> io::Result<()> {
        if self.master.is_some() {
            return Ok(());
        }
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let slave = ptsname(&master, Vec::new())?;
        let slave = slave.into_string().map_err(io::Error::other)?;
        // Open and close it once: only then does the kernel report that no process has it open.
        let opened = File::options().read(true).write(true).open(&slave)?;
        let mut settings = tcgetattr(&opened)?;
        settings.make_raw();
        tcsetattr(&opened, OptionalActions::Now, &settings)?;
        drop(opened);
        fcntl_setfl(&master, fcntl_getfl(&master)? | OFlags::NONBLOCK)?;
        std::os::unix::fs::symlink(slave, &self.name)?;
        self.master = Some(File::from(master));
        Ok(())
    }

    fn kind(&self) -> &'static str {
        "serial"
    }

    fn config(&self) -> [String; 2] {
        let port = format!("[ground.serial]\nport = {:?}\n", self.name.display().to_string());
        [String::new(), port]
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        self.unplug();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(port: &SerialPort, baud: u32) -> File {
        let host = File::options().read(true).write(true).open(port.name()).unwrap();
        let mut settings = tcgetattr(&host).unwrap();
        settings.make_raw();
        settings.set_speed(baud).unwrap();
        tcsetattr(&host, OptionalActions::Now, &settings).unwrap();
        fcntl_setfl(&host, fcntl_getfl(&host).unwrap() | OFlags::NONBLOCK).unwrap();
        host
    }

    fn read(host: &mut File) -> Vec<u8> {
        let mut bytes = [0; 64];
        host.read(&mut bytes).map_or_else(|_| Vec::new(), |length| bytes[..length].to_vec())
    }

    #[test]
    fn host_and_device_hear_each_other_at_one_speed_only() {
        let folder = tempfile::tempdir().unwrap();
        let mut port = SerialPort::new(&folder.path().join("plate"), 460_800).unwrap();
        port.receive().unwrap();
        assert!(!port.is_open());
        port.write(b"into the void").unwrap();
        let mut host = opened(&port, 460_800);
        host.write_all(b"hello").unwrap();
        assert_eq!((port.receive().unwrap(), port.is_open(), port.session()), (b"hello".to_vec(), true, 1));
        port.write(b"here").unwrap();
        assert_eq!(read(&mut host), b"here");
        port.set_baud(115_200);
        host.write_all(b"hello").unwrap();
        assert_eq!(port.receive().unwrap(), b"");
        port.write(b"here").unwrap();
        let noise = read(&mut host);
        assert!(noise.len() == 4 && noise != b"here");
        drop(host);
        port.receive().unwrap();
        assert!(!port.is_open());
    }

    #[test]
    fn a_line_that_was_pulled_out_is_gone_and_comes_back_under_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let mut port = SerialPort::new(&folder.path().join("plate"), 1_000_000).unwrap();
        let mut host = opened(&port, 1_000_000);
        port.receive().unwrap();
        port.unplug();
        assert!(!port.name().exists());
        let ended = host.read(&mut [0; 8]);
        assert!(ended.is_err() || ended.unwrap() == 0, "the host gets an error");
        port.plug().unwrap();
        let mut host = opened(&port, 1_000_000);
        port.receive().unwrap();
        port.write(b"again").unwrap();
        assert_eq!((read(&mut host), port.session()), (b"again".to_vec(), 2));
        let name = port.name().to_owned();
        drop(port);
        assert!(!name.exists());
    }
}
