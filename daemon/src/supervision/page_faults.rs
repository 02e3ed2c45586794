//! Page faults of the loop's thread after its warm-up, read from outside.

/// The first seconds touch code and memory for the first time.
const WARM_UP_LOOKS: u32 = 10;
/// Without a new fault for so many looks, one a second, the incident ends.
const RESTS_AFTER_LOOKS: u32 = 10;

/// Watches the count of one thread, once a second.
#[derive(Debug, Default)]
pub(super) struct PageFaults {
    looks: u32,
    last: u64,
    quiet_looks: Option<u32>,
}

impl PageFaults {
    /// Takes in the thread's count; says how many are new, if it is warm.
    pub(super) fn look(&mut self, faults: Option<u64>) -> Option<u64> {
        let faults = faults?;
        let new = faults.saturating_sub(std::mem::replace(&mut self.last, faults));
        self.looks += 1;
        if self.looks <= WARM_UP_LOOKS {
            return None;
        }
        if new > 0 {
            self.quiet_looks = Some(0);
            return Some(new);
        }
        self.quiet_looks = self.quiet_looks.map(|looks| looks + 1).filter(|looks| *looks < RESTS_AFTER_LOOKS);
        None
    }

    /// Whether there were any lately.
    pub(super) fn goes_on(&self) -> bool {
        self.quiet_looks.is_some()
    }
}

/// Minor and major faults of this process's thread of that name; `None` if there is none.
pub(super) fn of_thread(name: &str) -> Option<u64> {
    std::fs::read_dir("/proc/self/task").ok()?.flatten().find_map(|task| {
        let comm = std::fs::read_to_string(task.path().join("comm")).ok()?;
        if comm.trim_end() != name {
            return None;
        }
        faults_of(&std::fs::read_to_string(task.path().join("stat")).ok()?)
    })
}

/// Fields 10 and 12 of proc_pid_stat(5); the name before them may hold blanks and ends with the last parenthesis.
fn faults_of(stat: &str) -> Option<u64> {
    let (_, behind) = stat.rsplit_once(')')?;
    let mut fields = behind.split_whitespace().skip(7);
    let minor: u64 = fields.next()?.parse().ok()?;
    let major: u64 = fields.nth(1)?.parse().ok()?;
    Some(minor + major)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_count_only_after_the_warm_up_and_rest_ends_them() {
        let mut watch = PageFaults::default();
        for look in 1..=WARM_UP_LOOKS {
            assert_eq!(watch.look(Some(u64::from(100 * look))), None);
        }
        assert_eq!(watch.look(Some(1000)), None);
        assert!(!watch.goes_on());
        assert_eq!(watch.look(Some(1003)), Some(3));
        for _ in 1..RESTS_AFTER_LOOKS {
            assert_eq!(watch.look(Some(1003)), None);
            assert!(watch.goes_on());
        }
        assert_eq!(watch.look(Some(1003)), None);
        assert!(!watch.goes_on());
    }

    #[test]
    fn the_kernel_s_line_is_read_whatever_the_thread_is_called() {
        let line = "7 (a ) b) S 1 7 7 0 -1 4194304 83 0 5 0 12 3 0 0 20 0 1 0 777 1 2";
        assert_eq!(faults_of(line), Some(88));
        assert_eq!(faults_of("nothing"), None);
    }

    #[test]
    fn a_thread_s_own_faults_are_seen() {
        let name = "faults-of-mine";
        let (ask, asked) = std::sync::mpsc::channel::<()>();
        let (tell, told) = std::sync::mpsc::channel();
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                while asked.recv().is_ok() {
                    let mut fresh = vec![0_u8; 4 << 20];
                    fresh.iter_mut().step_by(4096).for_each(|page| *page = 1);
                    tell.send(std::hint::black_box(fresh).len()).unwrap();
                }
            })
            .unwrap();
        let count = || {
            ask.send(()).unwrap();
            told.recv().unwrap();
            of_thread(name).unwrap()
        };
        let before = count();
        assert!(count() > before + 100, "4 MB of new pages");
        drop(ask);
        thread.join().unwrap();
        assert_eq!(of_thread("nobody-is-called-so"), None);
    }
}
