//! Privileges that the configuration requests from the kernel: locked memory and real-time scheduling.

use anyhow::bail;
use equipoise_config::Config;
use equipoise_core::message::Incident;
use equipoise_station::proc::MemoryUse;
use tracing::info;

use crate::incidents::IncidentBoard;
use crate::realtime;
use crate::thread_registry::ThreadRegistry;

/// Prefix of the message for a refused memory lock.
const NOT_LOCKED: &str = "not locked";

/// Requests that all memory is locked; returns the result in words. Whether it is locked is checked later.
pub(super) fn lock_memory(config: &Config) -> anyhow::Result<String> {
    if !config.tick.lock_memory {
        return Ok("not asked for".to_owned());
    }
    match realtime::lock_memory() {
        Ok(()) => Ok("locked".to_owned()),
        Err(reason) if config.tick.strict => bail!("loop.strict: memory is not locked: {reason}"),
        Err(reason) => {
            info!("memory is not locked: {reason}");
            Ok(format!("{NOT_LOCKED}: {reason}"))
        }
    }
}

/// Reports requests of threads and memory that were not granted: refused under `loop.strict`, otherwise an incident for the
/// daemon's lifetime.
pub(super) fn report_missing(
    config: &Config,
    board: &IncidentBoard,
    memory_lock: &str,
    thread_registry: &ThreadRegistry,
) -> anyhow::Result<()> {
    let mut missing = thread_registry.missing();
    let memory = MemoryUse::read();
    if memory_lock.starts_with(NOT_LOCKED) {
        missing.push(format!("memory is {memory_lock}"));
    } else if config.tick.lock_memory && !memory.is_locked() {
        missing.push(format!(
            "memory is not locked: {} KiB of {} KiB in memory are; run as root, or under systemd with \
             LimitMEMLOCK=infinity",
            memory.locked_kib, memory.resident_kib
        ));
    }
    let Some(first) = missing.first() else { return Ok(()) };
    if config.tick.strict {
        bail!("loop.strict: {first}");
    }
    let others = match missing.len() - 1 {
        0 => String::new(),
        others => format!(" (and {others} more; `equipoise status` shows all)"),
    };
    board.begin(Incident::RealTimeRefused, &format!("{first}{others}"));
    Ok(())
}
