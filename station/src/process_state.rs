//! State of another process according to `/proc`.

/// Whether a process exists and is stopped by SIGSTOP or a terminal (`T`), or by a debugger (`t`).
pub fn is_stopped(process_id: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{process_id}/stat"));
    stat.is_ok_and(|stat| state(&stat).is_some_and(|state| matches!(state, 'T' | 't')))
}

/// The letter after the command name, which is in parentheses and may contain any character (proc(5)).
fn state(stat: &str) -> Option<char> {
    stat.rsplit_once(") ")?.1.chars().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_parsed_after_any_name() {
        assert_eq!(state("42 (equipoise) T 1 42 42 0"), Some('T'));
        assert_eq!(state("42 (a) T) S 1 42"), Some('S'));
        assert_eq!(state(""), None);
        assert!(!is_stopped(std::process::id()));
    }
}
