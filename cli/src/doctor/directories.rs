//! Checks the locations of files and shared memory.

use equipoise_bus::service::STATION_MEMORY_MAX;

use super::Check;
use super::facts::{Directory, Facts};

/// Network file systems: their locks do not reveal which processes of this machine are alive.
const REMOTE: [&str; 10] =
    ["nfs", "nfs4", "cifs", "smb3", "smbfs", "9p", "ceph", "fuse.sshfs", "fuse.glusterfs", "afs"];
/// The profiles of a shift need less than a megabyte; logs and recordings need more.
const STATE_FREE_MIN: u64 = 1 << 20;
const STATE_FREE_COMFORT: u64 = 100 << 20;
/// Consumers of a running daemon need little more shared memory than it already has.
const SHM_FREE_RUNNING: u64 = 8 << 20;

pub(super) fn bus_root(facts: &Facts) -> Check {
    const NAME: &str = "bus root";
    let Directory { path, file_system, writable, owner, .. } = &facts.bus_root;
    let found = format!("{} on {file_system}", path.display());
    if REMOTE.contains(&file_system.as_str()) {
        return Check::fail(
            NAME,
            format!(
                "{found}, which other computers share: living and dead processes cannot be distinguished there"
            ),
            "set EQUIPOISE_BUS_ROOT to a directory of this computer, for example below /run",
        );
    }
    if !writable {
        return Check::fail(
            NAME,
            format!("{found}: this user may not write there"),
            "set EQUIPOISE_BUS_ROOT to a directory of this user, or give it to this user (chown)",
        );
    }
    match owner {
        Some(owner) if *owner != facts.user_id && facts.user_id != 0 => Check::fail(
            NAME,
            format!("{found} belongs to user {owner}"),
            "run as that user (sudo -u), or set EQUIPOISE_BUS_ROOT: the bus is for processes of one user",
        ),
        _ => Check::ok(NAME, found),
    }
}

pub(super) fn shared_memory(facts: &Facts, daemon_runs: bool) -> Check {
    const NAME: &str = "shared memory";
    let needed = if daemon_runs { SHM_FREE_RUNNING } else { STATION_MEMORY_MAX as u64 };
    match facts.shm_free {
        None => Check::fail(NAME, "there is no /dev/shm", "mount -t tmpfs tmpfs /dev/shm"),
        Some(free) if free < needed => Check::fail(
            NAME,
            format!("/dev/shm has {} free; a station takes up to {}", megabytes(free), megabytes(needed)),
            "mount -o remount,size=1G /dev/shm (containers: --shm-size=1g); remove what dead programs left there",
        ),
        Some(free) => Check::ok(NAME, format!("/dev/shm has {} free", megabytes(free))),
    }
}

pub(super) fn remove_ipc(facts: &Facts) -> Check {
    const NAME: &str = "RemoveIPC";
    match facts.remove_ipc {
        None => Check::ok(NAME, "no systemd-logind here"),
        Some(_) if facts.user_id < 1000 => Check::ok(NAME, "does not concern system users"),
        Some(false) => Check::ok(NAME, "off"),
        Some(true) => Check::warn(
            NAME,
            "on: when this user's last session ends, systemd-logind removes the bus's shared memory",
            "run as a system user (the shipped unit does), or set RemoveIPC=no in /etc/systemd/logind.conf",
        ),
    }
}

pub(super) fn state_directory(facts: &Facts) -> Check {
    const NAME: &str = "state directory";
    const FIX: &str = "set STATE_DIRECTORY (systemd: StateDirectory=) to a directory of this user";
    let Directory { path, file_system, writable, free, .. } = match &facts.state_directory {
        Ok(place) => place,
        Err(reason) => return Check::fail(NAME, reason.to_string(), FIX),
    };
    let found = format!("{} on {file_system}, {} free", path.display(), megabytes(*free));
    const ROOM: &str = "make room there, or set STATE_DIRECTORY to another place";
    if !writable {
        return Check::fail(NAME, format!("{}: this user may not write there", path.display()), FIX);
    }
    match *free {
        free if free < STATE_FREE_MIN => Check::fail(NAME, found, ROOM),
        free if free < STATE_FREE_COMFORT => Check::warn(NAME, found, ROOM),
        _ => Check::ok(NAME, found),
    }
}

fn megabytes(bytes: u64) -> String {
    format!("{} MB", bytes / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::super::Verdict::{Fail, Ok, Warn};
    use super::*;
    use equipoise_station::state_directory::NoStateDirectory;

    #[test]
    fn a_root_must_be_local_writable_and_owned() {
        let of = |file_system: &str, writable, owner| {
            let file_system = file_system.to_owned();
            let bus_root = Directory { file_system, writable, owner, ..Facts::healthy().bus_root };
            bus_root_of(bus_root).verdict
        };
        assert_eq!(of("ext4", true, Some(104)), Ok);
        assert_eq!(of("tmpfs", true, None), Ok);
        assert_eq!(of("nfs4", true, Some(104)), Fail);
        assert_eq!(of("ext4", false, Some(104)), Fail);
        assert_eq!(of("ext4", true, Some(1000)), Fail);
    }

    fn bus_root_of(bus_root: Directory) -> Check {
        super::bus_root(&Facts { bus_root, ..Facts::healthy() })
    }

    #[test]
    fn a_station_must_fit_into_shared_memory_once() {
        let of = |shm_free, runs| shared_memory(&Facts { shm_free, ..Facts::healthy() }, runs).verdict;
        assert_eq!(of(Some(64 << 20), false), Fail, "a container's default");
        assert_eq!(of(Some(64 << 20), true), Ok, "it has its place already");
        assert_eq!(of(Some(1 << 30), false), Ok);
        assert_eq!(of(None, false), Fail);
    }

    #[test]
    fn remove_ipc_harms_ordinary_users_only() {
        let of = |user_id, remove_ipc| remove_ipc_of(user_id, remove_ipc).verdict;
        assert_eq!(of(1000, Some(true)), Warn);
        assert_eq!(of(1000, Some(false)), Ok);
        assert_eq!(of(1000, None), Ok);
        assert_eq!(of(104, Some(true)), Ok);
    }

    fn remove_ipc_of(user_id: u32, remove_ipc: Option<bool>) -> Check {
        super::remove_ipc(&Facts { user_id, remove_ipc, ..Facts::healthy() })
    }

    #[test]
    fn the_state_directory_needs_write_access_and_space() {
        let of = |writable, free| {
            let state_directory =
                Facts::healthy().state_directory.map(|place| Directory { writable, free, ..place });
            super::state_directory(&Facts { state_directory, ..Facts::healthy() }).verdict
        };
        assert_eq!(
            [of(true, 1 << 30), of(true, 50 << 20), of(true, 0), of(false, 1 << 30)],
            [Ok, Warn, Fail, Fail]
        );
        let missing = Facts { state_directory: Err(NoStateDirectory), ..Facts::healthy() };
        assert_eq!(state_directory(&missing).verdict, Fail);
    }
}
