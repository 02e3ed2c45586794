//! The screen of `watch` on a real terminal: its content, and the terminal's state afterwards.

use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZero;
use std::os::fd::OwnedFd;
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, LocalModes, Winsize, tcflow, tcgetattr, tcsetwinsize};

use crate::process::wait_for;
use crate::station::{NAME, Station};

/// A terminal with `watch` in it. `vt100` emulates the screen.
struct Terminal {
    keys: File,
    /// The program's end of the terminal, kept open to read its settings.
    terminal: OwnedFd,
    screen: Arc<Mutex<vt100::Parser>>,
    reader: Option<JoinHandle<()>>,
    closed: Arc<AtomicBool>,
    watch: Child,
}

/// Polling interval for a request to close the terminal.
const POLL_TIMEOUT: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

impl Terminal {
    fn before(station: &Station, size: (u16, u16)) -> Terminal {
        // Makes it the controlling terminal of a separate session, as a login does; the process stays the same.
        let mut setsid = Command::new("setsid");
        setsid.args(["--ctty", env!("CARGO_BIN_EXE_equipoise")]);
        Terminal::of(setsid, station, size)
    }

    /// A terminal that sends no SIGHUP: not the controlling one.
    fn without_signals(station: &Station, size: (u16, u16)) -> Terminal {
        Terminal::of(Command::new(env!("CARGO_BIN_EXE_equipoise")), station, size)
    }

    fn of(mut command: Command, station: &Station, (columns, rows): (u16, u16)) -> Terminal {
        let controller =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
        grantpt(&controller).and_then(|()| unlockpt(&controller)).expect("its near end");
        let name = ptsname(&controller, Vec::new()).expect("its name");
        let terminal =
            open(name, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty()).expect("near");
        tcsetwinsize(&terminal, size(columns, rows)).expect("a size");
        let copy = || terminal.try_clone().expect("a descriptor");
        let watch = command
            .args(["watch", "--station", NAME])
            .env("EQUIPOISE_BUS_ROOT", station.root())
            .env("TERM", "xterm-256color")
            .stdin(copy())
            .stdout(copy())
            .stderr(copy())
            .spawn()
            .expect("it starts (setsid is of util-linux)");
        let screen = Arc::new(Mutex::new(vt100::Parser::new(cells(rows), cells(columns), 0)));
        let keys = File::from(controller);
        let (mut reader, reader_screen) = (keys.try_clone().expect("a descriptor"), Arc::clone(&screen));
        let closed = Arc::new(AtomicBool::new(false));
        let is_closed = Arc::clone(&closed);
        let reader = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while !is_closed.load(Ordering::Relaxed) {
                if !matches!(poll(&mut [PollFd::new(&reader, PollFlags::IN)], Some(&POLL_TIMEOUT)), Ok(1..)) {
                    continue;
                }
                let Ok(count @ 1..) = reader.read(&mut bytes) else { return };
                reader_screen.lock().expect("the glass").process(&bytes[..count]);
            }
        });
        Terminal { keys, terminal, screen, reader: Some(reader), closed, watch }
    }

    fn text(&self) -> String {
        self.screen.lock().expect("the glass").screen().contents()
    }

    #[track_caller]
    fn shows(&self, text: &str) {
        wait_for(text, || self.text().contains(text).then_some(()));
    }

    fn press(&mut self, key: &str) {
        self.keys.write_all(key.as_bytes()).expect("a key");
    }

    fn resize(&mut self, columns: u16, rows: u16) {
        self.screen.lock().expect("the glass").screen_mut().set_size(cells(rows), cells(columns));
        tcsetwinsize(&self.terminal, size(columns, rows)).expect("a size");
    }

    fn send(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.watch), signal).expect("a process to signal");
    }

    /// Closes the terminal's far end, as a window that is closed or a connection that breaks does.
    fn close(&mut self) {
        self.closed.store(true, Ordering::Relaxed);
        self.reader.take().expect("closed once").join().expect("the glass");
        self.keys = File::open("/dev/null").expect("/dev/null");
    }

    #[track_caller]
    fn ends(&mut self) -> Option<i32> {
        wait_for("its end", || self.watch.try_wait().expect("a child")).code()
    }

    fn is_raw(&self) -> bool {
        !tcgetattr(&self.terminal)
            .expect("its settings")
            .local_modes
            .contains(LocalModes::ICANON | LocalModes::ECHO)
    }

    /// Asserts a regular end and a restored terminal: settings, alternate screen, cursor.
    #[track_caller]
    fn leaves_the_terminal_clean(mut self) {
        assert_eq!(self.ends(), Some(0), "{}", self.text());
        assert!(!self.is_raw(), "the terminal still takes keys one by one");
        wait_for("the screen from before", || {
            let reader = self.screen.lock().expect("the glass");
            (!reader.screen().alternate_screen() && !reader.screen().hide_cursor()).then_some(())
        });
        assert_eq!(self.text().trim(), "", "something was left on the screen");
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // Already ended, or the test has failed.
        let _ = self.watch.kill();
        let _ = self.watch.wait();
        self.closed.store(true, Ordering::Relaxed);
    }
}

fn cells(count: u16) -> NonZero<u16> {
    NonZero::new(count).expect("a terminal has cells")
}

fn size(columns: u16, rows: u16) -> Winsize {
    Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}

#[test]
fn the_screen_continues_without_the_daemon_and_leaves_a_clean_terminal() {
    let station = Station::new();
    let mut screen_terminal = Terminal::before(&station, (100, 30));
    screen_terminal.shows("Nothing has come from station bench yet.");
    assert!(
        screen_terminal.is_raw()
            && screen_terminal.screen.lock().expect("the glass").screen().alternate_screen()
    );

    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    screen_terminal.shows("Calibration");
    screen_terminal.shows("ms old");
    screen_terminal.shows("late awake");
    screen_terminal.press("?");
    screen_terminal.shows("quit");
    screen_terminal.shows("Bars: overload torque over the joint's limit");
    screen_terminal.press("?");
    wait_for("the help to go", || (!screen_terminal.text().contains("Bars: overload")).then_some(()));
    screen_terminal.resize(40, 12);
    wait_for("a smaller screen", || (!screen_terminal.text().contains("late awake")).then_some(()));
    screen_terminal.shows("Calibration");
    screen_terminal.resize(100, 30);
    screen_terminal.shows("late awake");

    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    screen_terminal.shows("The daemon is silent");
    screen_terminal.shows("what came before is old and not shown");
    let _next = station.daemon(&station.configuration());
    screen_terminal.shows("Calibration");
    drop(person);
    screen_terminal.shows("The suit is silent");
    screen_terminal.press("q");
    screen_terminal.leaves_the_terminal_clean();
}

#[test]
fn a_signal_leaves_a_clean_terminal_too() {
    let station = Station::new();
    for signal in [Signal::TERM, Signal::INT, Signal::HUP, Signal::QUIT] {
        let screen_terminal = Terminal::before(&station, (80, 24));
        screen_terminal.shows("Nothing has come");
        screen_terminal.send(signal);
        screen_terminal.leaves_the_terminal_clean();
    }
    let mut screen_terminal = Terminal::before(&station, (80, 24));
    screen_terminal.shows("Nothing has come");
    screen_terminal.press("\x03");
    screen_terminal.leaves_the_terminal_clean();
}

#[test]
fn a_terminal_that_is_closed_ends_the_screen() {
    let station = Station::new();
    for screen_terminal in [Terminal::before, Terminal::without_signals] {
        let mut screen_terminal = screen_terminal(&station, (80, 24));
        screen_terminal.shows("Nothing has come");
        screen_terminal.close();
        assert_eq!(screen_terminal.ends(), Some(0));
    }
}

#[test]
fn a_signal_ends_a_screen_with_a_blocked_terminal() {
    let station = Station::new();
    let mut screen_terminal = Terminal::before(&station, (80, 24));
    screen_terminal.shows("Nothing has come");
    tcflow(&screen_terminal.terminal, Action::OOff).expect("output held");
    // Leaving the alternate screen is a write, which does not return.
    screen_terminal.send(Signal::TERM);
    assert_eq!(screen_terminal.ends(), Some(1));
    assert!(!screen_terminal.is_raw(), "the terminal still takes keys one by one");
}

#[test]
fn in_a_pipe_at_least_one_line_is_printed() {
    let station = Station::new();
    let _person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let watched = station.run(&["watch", "--station", NAME, "--for", "0.000001"]);
    assert_eq!(watched.assert_done().lines().count(), 1, "{}", watched.stdout);
}
