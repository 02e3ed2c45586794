//! The viewer of the demonstration: a browser of the desktop, and the signal that somebody is watching.

use std::io::{IsTerminal, Stdin};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::getpgrp;
use rustix::termios::tcgetpgrp;

use crate::page_feed::ServedPage;

/// Environment variables that a desktop session sets.
const DESKTOP: [&str; 2] = ["DISPLAY", "WAYLAND_DISPLAY"];
/// Opens a URL in the user's browser (xdg-utils).
const OPENER: &str = "xdg-open";

/// Opens the page in the browser of the desktop session. Returns whether there are both.
pub(super) fn open_browser(url: &str) -> bool {
    let is_desktop = DESKTOP.iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    if !is_desktop {
        return false;
    }
    let mut opener = Command::new(OPENER);
    opener.arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    // Ctrl-C ends the demonstration and leaves the browser, which shows the results.
    let Ok(mut child) = opener.process_group(0).spawn() else { return false };
    // The opener may live as long as the browser.
    std::thread::spawn(move || child.wait());
    true
}

/// Waits for the first viewer of the page, or for Enter on the terminal.
pub(super) struct StartSignal {
    keyboard: Option<Stdin>,
    is_given: bool,
}

impl StartSignal {
    /// A signal that was given already.
    pub(super) fn given() -> StartSignal {
        StartSignal { keyboard: None, is_given: true }
    }

    /// A signal to wait for.
    pub(super) fn awaited() -> StartSignal {
        let stdin = std::io::stdin();
        // A process in the background must not read the terminal: the system would stop it.
        let is_ours = stdin.is_terminal() && tcgetpgrp(&stdin).is_ok_and(|group| group == getpgrp());
        StartSignal { keyboard: is_ours.then_some(stdin), is_given: false }
    }

    /// Whether Enter on the terminal gives it.
    pub(super) fn takes_a_key(&self) -> bool {
        self.keyboard.is_some()
    }

    /// Whether it is given now or was before.
    pub(super) fn is_given(&mut self, page: Option<&ServedPage>) -> bool {
        self.is_given |= page.is_none_or(ServedPage::has_been_viewed) || self.is_key_pressed();
        self.is_given
    }

    fn is_key_pressed(&mut self) -> bool {
        let Some(keyboard) = &self.keyboard else { return false };
        let mut watched = [PollFd::new(keyboard, PollFlags::IN)];
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        if !poll(&mut watched, Some(&now)).is_ok_and(|count| count > 0) {
            return false;
        }
        // Removes the line from the terminal's input. Without one the terminal is closed, and gives no key any more.
        let pressed = rustix::io::read(keyboard, &mut [0_u8; 256]).is_ok_and(|count| count > 0);
        self.keyboard = None;
        pressed
    }
}
