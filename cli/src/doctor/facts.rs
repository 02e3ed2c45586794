//! Facts about this computer from /proc, /sys and the limits of this process.

use std::fs;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access, statvfs};
use rustix::process::{Resource, geteuid, getrlimit};

use equipoise_station::state_directory::{NoStateDirectory, StateDirectory};

/// Facts about the computer; unavailable ones are `None` or empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// Effective user id.
    pub user_id: u32,
    /// User name.
    pub user: String,
    /// Whether CAP_SYS_NICE is effective.
    pub has_scheduling_capability: bool,
    /// RLIMIT_RTPRIO; `None` without a limit.
    pub rtprio_limit: Option<u64>,
    /// RLIMIT_MEMLOCK, bytes; `None` without a limit.
    pub memlock_limit: Option<u64>,
    /// kernel.sched_rt_runtime_us; negative for no throttling.
    pub rt_runtime_us: Option<i64>,
    /// kernel.sched_rt_period_us.
    pub rt_period_us: Option<i64>,
    /// Number of cores.
    pub cores: usize,
    /// Isolated cores.
    pub isolated: Vec<usize>,
    /// Frequency governor of each core that has one.
    pub governors: Vec<(usize, String)>,
    /// Preemption model of the kernel.
    pub preemption: Preemption,
    /// Current clock source.
    pub clock_source: Option<String>,
    /// net.core.rmem_max, bytes.
    pub rmem_max: Option<u64>,
    /// Whether logind removes a user's shared memory; `None` without logind.
    pub remove_ipc: Option<bool>,
    /// Directory of the bus.
    pub bus_root: Directory,
    /// Free space of /dev/shm, bytes.
    pub shm_free: Option<u64>,
    /// The state directory.
    pub state_directory: Result<Directory, NoStateDirectory>,
}

/// Preemption model of the kernel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Preemption {
    /// PREEMPT_RT.
    RealTime,
    /// Full preemption, except under spin locks.
    Full,
    /// A weaker model, by its name.
    Less(String),
    /// PREEMPT_DYNAMIC, and this user has no permission to read the chosen model.
    AtBoot,
}

/// A directory, existing or to be created.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Directory {
    /// Path of the directory.
    pub path: PathBuf,
    /// Type of the file system.
    pub file_system: String,
    /// Whether this user may create files there.
    pub writable: bool,
    /// User id of the owner; `None` if the directory does not exist yet.
    pub owner: Option<u32>,
    /// Free bytes.
    pub free: u64,
}

impl Facts {
    /// Collects all facts; `state` is the active state directory, or the reason that there is none.
    pub fn gather(state: Result<StateDirectory, NoStateDirectory>) -> Facts {
        let status = text("/proc/self/status").unwrap_or_default();
        let user_id = geteuid().as_raw();
        let shm = Path::new("/dev/shm");
        Facts {
            user_id,
            user: name_of(user_id, &text("/etc/passwd").unwrap_or_default()),
            has_scheduling_capability: has_capability(&status, CAP_SYS_NICE),
            rtprio_limit: getrlimit(Resource::Rtprio).current,
            memlock_limit: getrlimit(Resource::Memlock).current,
            rt_runtime_us: number("/proc/sys/kernel/sched_rt_runtime_us"),
            rt_period_us: number("/proc/sys/kernel/sched_rt_period_us"),
            cores: std::thread::available_parallelism().map_or(1, usize::from).max(cores_present()),
            isolated: core_list(&text("/sys/devices/system/cpu/isolated").unwrap_or_default()),
            governors: governors(),
            preemption: preemption_of(
                text("/sys/kernel/realtime").as_deref(),
                text("/sys/kernel/debug/sched/preempt").as_deref(),
                &text("/proc/version").unwrap_or_default(),
            ),
            clock_source: text("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            rmem_max: number("/proc/sys/net/core/rmem_max").and_then(|bytes| u64::try_from(bytes).ok()),
            remove_ipc: Path::new("/run/systemd/seats").exists().then(remove_ipc_is_on),
            bus_root: Directory::inspect(&equipoise_bus::root::root_of_environment()),
            shm_free: shm.exists().then(|| free_bytes(shm)),
            state_directory: state.map(|state| Directory::inspect(state.path())),
        }
    }
}

impl Directory {
    fn inspect(path: &Path) -> Directory {
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        // A missing directory would be created below its nearest existing ancestor.
        let nearest = absolute.ancestors().find(|ancestor| ancestor.exists()).unwrap_or(Path::new("/"));
        let owner = |path: &Path| {
            use std::os::unix::fs::MetadataExt;
            fs::metadata(path).ok().map(|metadata| metadata.uid())
        };
        Directory {
            file_system: file_system_of(nearest, &text("/proc/self/mountinfo").unwrap_or_default()),
            writable: nearest.is_dir() && access(nearest, Access::WRITE_OK | Access::EXEC_OK).is_ok(),
            owner: (nearest == absolute).then(|| owner(nearest)).flatten(),
            free: free_bytes(nearest),
            path: absolute,
        }
    }
}

const CAP_SYS_NICE: u32 = 23;

fn text(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn number(path: &str) -> Option<i64> {
    text(path)?.parse().ok()
}

fn free_bytes(path: &Path) -> u64 {
    statvfs(path).map_or(0, |found| found.f_bavail * found.f_frsize)
}

fn name_of(user_id: u32, passwd: &str) -> String {
    let entry = passwd.lines().map(|line| line.split(':').collect::<Vec<_>>());
    let found = entry.into_iter().find(|fields| fields.get(2) == Some(&user_id.to_string().as_str()));
    found.map_or_else(|| "without a name".to_owned(), |fields| fields[0].to_owned())
}

fn has_capability(status: &str, number: u32) -> bool {
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    effective
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & (1 << number) != 0)
}

fn cores_present() -> usize {
    core_list(&text("/sys/devices/system/cpu/present").unwrap_or_default()).len()
}

/// Parses a core list such as `0-3,6`.
fn core_list(text: &str) -> Vec<usize> {
    text.split(',')
        .filter_map(|part| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
        })
        .flatten()
        .collect()
}

fn governors() -> Vec<(usize, String)> {
    let of = |core: usize| text(&format!("/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor"));
    (0..cores_present()).filter_map(|core| Some((core, of(core)?))).collect()
}

/// `realtime` is `1` under PREEMPT_RT; `dynamic` has the chosen model in parentheses; `version` names the build.
fn preemption_of(realtime: Option<&str>, dynamic: Option<&str>, version: &str) -> Preemption {
    let built = |value: &str| version.split_whitespace().any(|found| found == value);
    if realtime == Some("1") || built("PREEMPT_RT") {
        return Preemption::RealTime;
    }
    let chosen = dynamic.and_then(|text| Some(text.split_once('(')?.1.split_once(')')?.0.to_owned()));
    match chosen.as_deref() {
        Some("full") => Preemption::Full,
        Some(other) => Preemption::Less(other.to_owned()),
        None if built("PREEMPT_DYNAMIC") => Preemption::AtBoot,
        None if built("PREEMPT") => Preemption::Full,
        None => Preemption::Less("none or voluntary".to_owned()),
    }
}

/// The file system type of a path: that of the deepest mount point above it, and of the last one mounted there.
fn file_system_of(path: &Path, mountinfo: &str) -> String {
    let mounts = mountinfo.lines().filter_map(|line| {
        let (before, behind) = line.split_once(" - ")?;
        // mountinfo escapes spaces like this.
        let point = before.split_whitespace().nth(4)?.replace("\\040", " ");
        let kind = behind.split_whitespace().next()?;
        path.starts_with(&point).then(|| (Path::new(&point).components().count(), kind.to_owned()))
    });
    mounts
        .max_by_key(|(depth, _)| *depth)
        .map_or_else(|| "an unknown file system".to_owned(), |(_, kind)| kind)
}

fn remove_ipc_is_on() -> bool {
    let mut files = vec![PathBuf::from("/etc/systemd/logind.conf")];
    let drop_ins =
        ["/usr/lib/systemd/logind.conf.d", "/etc/systemd/logind.conf.d", "/run/systemd/logind.conf.d"];
    for directory in drop_ins {
        let mut found: Vec<PathBuf> =
            fs::read_dir(directory).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        found.sort();
        files.extend(found);
    }
    let texts: Vec<String> = files.iter().filter_map(|path| fs::read_to_string(path).ok()).collect();
    remove_ipc_in(&texts)
}

/// The last setting in logind's files; the default is on.
fn remove_ipc_in(texts: &[String]) -> bool {
    let lines = texts.iter().flat_map(|text| text.lines());
    let last = lines.filter_map(|line| line.trim().strip_prefix("RemoveIPC=")).next_back();
    last.is_none_or(|value| matches!(value.trim(), "yes" | "true" | "on" | "1"))
}

#[cfg(test)]
impl Facts {
    /// Facts of a computer without faults.
    pub(super) fn healthy() -> Facts {
        let place = |path: &str| Directory {
            path: PathBuf::from(path),
            file_system: "ext4".to_owned(),
            writable: true,
            owner: Some(104),
            free: 1 << 34,
        };
        Facts {
            user_id: 104,
            user: "equipoise".to_owned(),
            has_scheduling_capability: true,
            rtprio_limit: Some(90),
            memlock_limit: None,
            rt_runtime_us: Some(950_000),
            rt_period_us: Some(1_000_000),
            cores: 4,
            isolated: vec![],
            governors: vec![],
            preemption: Preemption::Full,
            clock_source: Some("tsc".to_owned()),
            rmem_max: Some(4 << 20),
            remove_ipc: Some(true),
            bus_root: place("/run/equipoise/iceoryx2"),
            shm_free: Some(1 << 30),
            state_directory: Ok(place("/var/lib/equipoise")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_healthy_computer_needs_no_fix() {
        let checks = super::super::evaluate(&Facts::healthy(), None, Err("no configuration"));
        let (examined, skipped): (Vec<_>, Vec<_>) =
            checks.into_iter().partition(|check| check.verdict != super::super::Verdict::Skipped);
        assert_eq!(examined.len(), 12);
        for check in examined {
            assert_eq!((check.verdict, check.fix), (super::super::Verdict::Ok, None), "{}", check.name);
        }
        let skipped: Vec<&str> = skipped.iter().map(|check| check.name).collect();
        assert_eq!(skipped, ["core of the loop", "ports", "MVN stream", "plate"]);
    }

    #[test]
    fn this_computer_can_be_read() {
        let facts = Facts::gather(Ok(StateDirectory::at(Path::new("/tmp"))));
        assert!(facts.cores > 0 && facts.bus_root.path.is_absolute());
        assert_ne!(facts.bus_root.file_system, "an unknown file system");
        assert!(facts.state_directory.unwrap().free > 0);
    }

    #[test]
    fn lists_of_cores_capabilities_and_names_are_read() {
        assert_eq!(core_list("0-3,6"), [0, 1, 2, 3, 6]);
        assert!(core_list("").is_empty());
        let status = "Name:\tx\nCapEff:\t0000000000800000\n";
        assert!(has_capability(status, CAP_SYS_NICE) && !has_capability(status, 14));
        let passwd = "root:x:0:0::/:/bin/sh\nequipoise:x:998:998::/:/bin/false";
        assert_eq!(
            (name_of(998, passwd).as_str(), name_of(7, passwd).as_str()),
            ("equipoise", "without a name")
        );
    }

    #[test]
    fn the_kernel_s_preemption_is_read_from_several_files() {
        let dynamic = "Linux version 6.18.0 #1 SMP PREEMPT_DYNAMIC Thu";
        assert_eq!(preemption_of(Some("1"), None, ""), Preemption::RealTime);
        assert_eq!(preemption_of(None, None, "Linux #1 SMP PREEMPT_RT Debian"), Preemption::RealTime);
        assert_eq!(preemption_of(None, Some("none voluntary (full) lazy"), dynamic), Preemption::Full);
        let less = Preemption::Less("none".to_owned());
        assert_eq!(preemption_of(None, Some("(none) voluntary full"), dynamic), less);
        assert_eq!(preemption_of(None, None, dynamic), Preemption::AtBoot);
        assert_eq!(preemption_of(None, None, "Linux #1 SMP PREEMPT"), Preemption::Full);
        assert!(matches!(preemption_of(None, None, "Linux #1 SMP"), Preemption::Less(_)));
    }

    #[test]
    fn the_deepest_mount_above_a_path_is_its_file_system() {
        let mountinfo = "22 1 8:1 / / rw - ext4 /dev/sda1 rw\n23 22 0:20 / /run rw,nosuid shared:5 - tmpfs tmpfs rw\n24 22 \
                         0:44 / /mnt/all\\040ours rw - nfs4 server:/x rw\n";
        let of = |path: &str| file_system_of(Path::new(path), mountinfo);
        assert_eq!(of("/run/equipoise/iceoryx2"), "tmpfs");
        assert_eq!(of("/runner"), "ext4");
        assert_eq!(of("/mnt/all ours/bus"), "nfs4");
    }

    #[test]
    fn the_last_remove_ipc_setting_counts_and_the_default_is_yes() {
        let of =
            |texts: &[&str]| remove_ipc_in(&texts.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>());
        assert!(of(&["[Login]\n#RemoveIPC=no\n"]));
        assert!(!of(&["[Login]\nRemoveIPC=yes\n", "[Login]\nRemoveIPC=no\n"]));
    }
}
