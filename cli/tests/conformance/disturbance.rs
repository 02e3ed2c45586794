//! Other load on the machine: it delays bytes by more than the times of samples may be off, so it must not be taken for a
//! fault of an adapter.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::{read, write};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::questions::{Answer, Question};

/// A delay beyond which samples are misdated by more than the tolerances of most questions: 10 ms of a person's sway.
const LATE_MAX: Duration = Duration::from_millis(10);
/// Attempts on a machine with other load.
const ATTEMPTS: usize = 3;

/// Between two bytes.
const PAUSE: Duration = Duration::from_millis(1);

/// All answers of one adapter; an error is one of the test rig.
pub(crate) type Answers = Result<Vec<(Question, Answer)>, String>;

/// Measures the delay of one byte through a pseudo terminal every millisecond: of the scheduler and of the kernel's own
/// threads that carry serial data.
struct Watch {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Duration>,
}

impl Watch {
    fn start() -> Watch {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut worst = Duration::ZERO;
            let (far, near) = pseudo_terminal().expect("a pseudo terminal");
            while !stopped.load(Ordering::Relaxed) {
                let started = Instant::now();
                std::thread::sleep(PAUSE);
                write(&far, &[0]).expect("room for a byte");
                let mut wait = [PollFd::new(&near, PollFlags::IN)];
                poll(&mut wait, Some(&Timespec { tv_sec: 1, tv_nsec: 0 })).expect("a poll");
                worst = worst.max(started.elapsed().saturating_sub(PAUSE));
                let _none_within_a_second = read(&near, &mut [0_u8; 64]);
            }
            worst
        });
        Watch { stop, thread }
    }

    fn worst(self) -> Duration {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or(Duration::MAX)
    }
}

/// Both ends of a raw pseudo terminal; reads of the near one do not wait.
fn pseudo_terminal() -> rustix::io::Result<(OwnedFd, OwnedFd)> {
    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    grantpt(&far)?;
    unlockpt(&far)?;
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK;
    let near = rustix::fs::open(ptsname(&far, Vec::new())?, flags, Mode::empty())?;
    let mut line = tcgetattr(&near)?;
    line.make_raw();
    tcsetattr(&near, OptionalActions::Now, &line)?;
    Ok((far, near))
}

/// Asks until all answers are right, or one is wrong on an undisturbed machine. Returns with wrong answers of a disturbed
/// machine by how much it was late in the last attempt.
pub(crate) fn retry(ask: impl Fn() -> Answers) -> (Answers, Option<Duration>) {
    let mut attempt = 1;
    loop {
        let watch = Watch::start();
        let answers = ask();
        let late = watch.worst();
        let is_right = answers.as_ref().is_ok_and(|answers| answers.iter().all(|(_, answer)| answer.is_ok()));
        if is_right || late <= LATE_MAX {
            return (answers, None);
        }
        if attempt == ATTEMPTS {
            return (answers, Some(late));
        }
        attempt += 1;
    }
}

#[test]
fn a_failure_on_an_undisturbed_machine_is_final() {
    let wrong = || Ok(vec![(Question::Rate, Err("wrong".into()))]);
    let (answers, disturbed) = retry(wrong);
    assert!(answers.unwrap()[0].1.is_err());
    // On a busy machine the same answer is inconclusive, never right.
    assert!(disturbed.is_none_or(|late| late > LATE_MAX));
}
