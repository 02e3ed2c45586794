//! Checks processor, scheduler, limits, user and clock.

use equipoise_config::LoopConfig;

use super::Check;
use super::facts::{Facts, Preemption};

/// Clock sources with fast reads and a stable rate.
const GOOD_SOURCES: [&str; 5] =
    ["tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter", "xen"];
/// First id of ordinary users (login.defs).
const ORDINARY_USERS_FROM: u32 = 1000;
/// If real-time threads may use less than this fraction of each period, the kernel may throttle the loop after a single
/// late cycle.
const RT_FRACTION_MIN: f64 = 0.5;

pub(super) fn user(facts: &Facts) -> Check {
    const NAME: &str = "user";
    let name = format!("{} ({})", facts.user, facts.user_id);
    match facts.user_id {
        0 => Check::warn(
            NAME,
            format!("{name}: the service needs no root"),
            "run it as the system user `equipoise` with the shipped systemd unit (systemd/README.md)",
        ),
        id if id < ORDINARY_USERS_FROM => Check::ok(NAME, format!("{name}, a system user")),
        _ => {
            Check::ok(NAME, format!("{name}, an ordinary user: every process on the bus must be of the same"))
        }
    }
}

pub(super) fn real_time(facts: &Facts, tick: &LoopConfig) -> Check {
    const NAME: &str = "real-time priority";
    let requested = u64::from(tick.priority);
    if requested == 0 {
        return Check::skipped(NAME, "not requested (loop.priority = 0)");
    }
    if facts.has_scheduling_capability {
        return Check::ok(NAME, format!("SCHED_FIFO {requested} is available (CAP_SYS_NICE)"));
    }
    match facts.rtprio_limit {
        Some(limit) if limit < requested => Check::fail(
            NAME,
            format!("RLIMIT_RTPRIO is {limit}, loop.priority {requested}, and CAP_SYS_NICE is missing"),
            "run under the shipped systemd unit (AmbientCapabilities=CAP_SYS_NICE), or put `@realtime - rtprio 90` into \
             /etc/security/limits.d/ and log in again",
        ),
        _ => Check::ok(NAME, format!("SCHED_FIFO {requested} is available (RLIMIT_RTPRIO)")),
    }
}

pub(super) fn throttling(facts: &Facts) -> Check {
    const NAME: &str = "real-time throttling";
    let (Some(runtime_us), Some(period_us)) = (facts.rt_runtime_us, facts.rt_period_us) else {
        return Check::skipped(NAME, "the kernel does not report it");
    };
    if runtime_us < 0 {
        return Check::ok(NAME, "off: a real-time thread that spins occupies its core indefinitely");
    }
    let fraction = runtime_us as f64 / period_us.max(1) as f64;
    let found = format!(
        "real-time threads may use {:.0} % of each {:.1} s",
        100.0 * fraction,
        period_us as f64 * 1e-6
    );
    const FIX: &str = "sysctl -w kernel.sched_rt_runtime_us=950000 (and a file in /etc/sysctl.d/)";
    match fraction {
        fraction if fraction <= 0.0 => Check::fail(NAME, found, FIX),
        fraction if fraction < RT_FRACTION_MIN => Check::warn(NAME, found, FIX),
        _ => Check::ok(NAME, format!("{found}; the loop needs a few percent")),
    }
}

pub(super) fn memory_lock(facts: &Facts, tick: &LoopConfig) -> Check {
    const NAME: &str = "locked memory";
    match facts.memlock_limit {
        _ if !tick.lock_memory => Check::skipped(NAME, "not requested (loop.lock_memory = false)"),
        Some(limit) if facts.user_id != 0 => Check::warn(
            NAME,
            format!("at most {} kB may be locked, so nothing is", limit / 1024),
            "LimitMEMLOCK=infinity in the unit (the shipped one has it), or `@realtime - memlock unlimited` in \
             /etc/security/limits.d/",
        ),
        _ => Check::ok(NAME, "without a limit"),
    }
}

pub(super) fn governor(facts: &Facts) -> Check {
    const NAME: &str = "CPU governor";
    let slow: Vec<String> = facts
        .governors
        .iter()
        .filter(|(_, governor)| governor != "performance")
        .map(|(core, governor)| format!("core {core}: {governor}"))
        .collect();
    match (facts.governors.is_empty(), slow.is_empty()) {
        (true, _) => Check::ok(NAME, "none: a virtual machine, or a processor of one frequency"),
        (_, true) => Check::ok(NAME, "performance on every core"),
        _ => Check::warn(
            NAME,
            slow.join(", "),
            "cpupower frequency-set -g performance (and again at every start: cpupower.service, or tuned's profile \
             latency-performance)",
        ),
    }
}

pub(super) fn core(facts: &Facts, tick: &LoopConfig) -> Check {
    const NAME: &str = "core of the loop";
    match tick.cpu {
        None => Check::skipped(NAME, "not requested (loop.cpu)"),
        Some(cpu) if cpu >= facts.cores => Check::fail(
            NAME,
            format!(
                "loop.cpu = {cpu}, and this computer has the cores 0 to {}",
                facts.cores.saturating_sub(1)
            ),
            "choose one of them, or remove the key",
        ),
        Some(cpu) if !facts.isolated.contains(&cpu) => Check::warn(
            NAME,
            format!("core {cpu} is not isolated: other programs run on it too"),
            format!(
                "add `isolcpus=managed_irq,domain,{cpu} nohz_full={cpu} rcu_nocbs={cpu}` to the kernel's command line"
            ),
        ),
        Some(cpu) => Check::ok(NAME, format!("core {cpu} is isolated")),
    }
}

pub(super) fn preemption(facts: &Facts) -> Check {
    const NAME: &str = "kernel preemption";
    const FIX: &str =
        "boot with `preempt=full`, or install a kernel with PREEMPT_RT (Debian: linux-image-rt-amd64)";
    match facts.preemption {
        Preemption::RealTime => Check::ok(NAME, "PREEMPT_RT"),
        Preemption::Full => Check::ok(NAME, "full; PREEMPT_RT would bound the worst case too"),
        Preemption::Less(ref model) => {
            Check::warn(NAME, format!("{model}: the kernel finishes its own work before the loop's"), FIX)
        }
        Preemption::AtBoot => Check::warn(
            NAME,
            "chosen at boot (PREEMPT_DYNAMIC), and the current mode is unreadable",
            format!(
                "as root: `mount -t debugfs none /sys/kernel/debug`, run this again; unless it is full, {FIX}"
            ),
        ),
    }
}

pub(super) fn clock_source(facts: &Facts) -> Check {
    const NAME: &str = "clock source";
    match facts.clock_source.as_deref() {
        None => Check::skipped(NAME, "the kernel does not report it"),
        Some(source) if GOOD_SOURCES.contains(&source) => Check::ok(NAME, source),
        Some(source) => Check::warn(
            NAME,
            format!("{source}: slow to read, for every stamp"),
            "see `dmesg | grep -i tsc` for why the kernel left tsc; a firmware update, or `tsc=reliable` if the \
             hardware has a reliable TSC",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict::{Fail, Ok, Skipped, Warn};
    use super::*;

    fn tick(priority: u32, cpu: Option<usize>) -> LoopConfig {
        LoopConfig { priority, cpu, ..LoopConfig::default() }
    }

    #[test]
    fn root_is_reported_as_unnecessary() {
        let as_id = |user_id| user(&Facts { user_id, ..Facts::healthy() }).verdict;
        assert_eq!((as_id(0), as_id(104), as_id(1000)), (Warn, Ok, Ok));
    }

    #[test]
    fn priority_needs_the_capability_or_the_limit() {
        let check = |has_scheduling_capability, rtprio_limit, priority| {
            real_time(
                &Facts { has_scheduling_capability, rtprio_limit, ..Facts::healthy() },
                &tick(priority, None),
            )
        };
        assert_eq!(check(false, Some(0), 80).verdict, Fail);
        assert!(check(false, Some(79), 80).fix.unwrap().contains("CAP_SYS_NICE"));
        assert_eq!(check(false, Some(80), 80).verdict, Ok);
        assert_eq!(check(false, None, 80).verdict, Ok, "no limit at all");
        assert_eq!(check(true, Some(0), 80).verdict, Ok);
        assert_eq!(check(false, Some(0), 0).verdict, Skipped, "not requested");
    }

    #[test]
    fn throttling_is_a_safety_net_unless_it_leaves_too_little() {
        let check = |runtime| throttling(&Facts { rt_runtime_us: runtime, ..Facts::healthy() }).verdict;
        assert_eq!(
            [Some(-1), Some(950_000), Some(300_000), Some(0), None].map(check),
            [Ok, Ok, Warn, Fail, Skipped]
        );
    }

    #[test]
    fn the_memlock_limit_matters_unless_root_or_not_requested() {
        let check = |memlock_limit, user_id, lock_memory| {
            let tick = LoopConfig { lock_memory, ..LoopConfig::default() };
            memory_lock(&Facts { memlock_limit, user_id, ..Facts::healthy() }, &tick).verdict
        };
        assert_eq!(check(Some(65_536), 1000, true), Warn);
        assert_eq!(check(Some(65_536), 0, true), Ok);
        assert_eq!(check(Some(65_536), 1000, false), Skipped);
        assert_eq!(check(None, 1000, true), Ok);
    }

    #[test]
    fn every_core_needs_the_governor() {
        let of = |names: &[&str]| {
            let governors = names.iter().map(|name| (*name).to_owned()).enumerate().collect();
            governor(&Facts { governors, ..Facts::healthy() })
        };
        assert_eq!(of(&[]).verdict, Ok);
        assert_eq!(of(&["performance"; 4]).verdict, Ok);
        let check = of(&["performance", "powersave"]);
        assert_eq!((check.verdict, check.found.as_str()), (Warn, "core 1: powersave"));
    }

    #[test]
    fn a_pinned_loop_needs_an_existing_isolated_core() {
        let facts = Facts { cores: 4, isolated: vec![3], ..Facts::healthy() };
        let check = |cpu| core(&facts, &tick(80, cpu)).verdict;
        assert_eq!([None, Some(3), Some(2), Some(4)].map(check), [Skipped, Ok, Warn, Fail]);
    }

    #[test]
    fn less_than_full_preemption_is_reported() {
        let check = |preemption| preemption_of(preemption).verdict;
        assert_eq!(check(Preemption::RealTime), Ok);
        assert_eq!(check(Preemption::Full), Ok);
        assert_eq!(check(Preemption::Less("voluntary".to_owned())), Warn);
        assert_eq!(check(Preemption::AtBoot), Warn);
    }

    fn preemption_of(preemption: Preemption) -> Check {
        super::preemption(&Facts { preemption, ..Facts::healthy() })
    }

    #[test]
    fn a_slow_clock_is_reported() {
        let check = |source: Option<&str>| {
            clock_source(&Facts { clock_source: source.map(str::to_owned), ..Facts::healthy() }).verdict
        };
        assert_eq!([Some("tsc"), Some("kvm-clock"), Some("hpet"), None].map(check), [Ok, Ok, Warn, Skipped]);
    }
}
