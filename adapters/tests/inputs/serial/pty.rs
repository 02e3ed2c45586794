//! Serial line whose device end is controlled by the test: a pseudo terminal under a persistent name.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::path::PathBuf;

/// A socket that a device can be plugged into repeatedly.
pub(crate) struct Socket {
    folder: tempfile::TempDir,
}

impl Socket {
    pub(crate) fn new() -> Socket {
        Socket { folder: tempfile::tempdir().unwrap() }
    }

    /// The name of the port, with or without a device.
    pub(crate) fn port(&self) -> PathBuf {
        self.folder.path().join("plate")
    }

    /// Connects a device: the port exists until the device's end is dropped.
    pub(crate) fn plug(&self) -> Device {
        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&far).unwrap();
        unlockpt(&far).unwrap();
        let near = ptsname(&far, Vec::new()).unwrap().into_string().unwrap();
        std::os::unix::fs::symlink(near, self.port()).unwrap();
        Device { far, port: self.port() }
    }
}

/// The device's end.
pub(crate) struct Device {
    far: OwnedFd,
    port: PathBuf,
}

impl Device {
    pub(crate) fn say(&self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            bytes = &bytes[rustix::io::write(&self.far, bytes).unwrap()..];
        }
    }

    /// Bytes sent to the device; empty after a timeout.
    pub(crate) fn received(&self) -> Vec<u8> {
        let while_ = Timespec { tv_sec: 0, tv_nsec: 10_000_000 };
        let mut wait = [PollFd::new(&self.far, PollFlags::IN)];
        if poll(&mut wait, Some(&while_)).unwrap() == 0 || !wait[0].revents().contains(PollFlags::IN) {
            return Vec::new();
        }
        let mut bytes = vec![0; 256];
        let count = rustix::io::read(&self.far, &mut bytes).unwrap_or(0);
        bytes.truncate(count);
        bytes
    }

    /// The speed that the host set, baud.
    pub(crate) fn speed(&self) -> u32 {
        rustix::termios::tcgetattr(&self.far).unwrap().output_speed()
    }

    pub(crate) fn unplug(self) {}
}

impl Drop for Device {
    fn drop(&mut self) {
        // The socket may have been dropped before, with all names in it.
        let _gone = std::fs::remove_file(&self.port);
    }
}
