//! Converts OpenMetrics text to Prometheus's own format, 0.0.4.
//!
//! OpenMetrics names a counter's family without its `_total` and has two more kinds of lines. Older readers and
//! `promtool check metrics` require the name of the samples.

/// Translates the output of `prometheus-client`.
pub(super) fn of_open_metrics(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        // A family starts with its help line; its type is in the next line.
        if let Some((name, help)) = line.strip_prefix("# HELP ").and_then(|rest| rest.split_once(' ')) {
            let kind = lines.peek().and_then(|next| next.rsplit(' ').next()).unwrap_or("untyped");
            let (name, kind) = match kind {
                "counter" => (format!("{name}_total"), "counter"),
                "info" => (format!("{name}_info"), "gauge"),
                other => (name.to_owned(), other),
            };
            plain.push_str(&format!("# HELP {name} {help}\n# TYPE {name} {kind}\n"));
        } else if !line.starts_with('#') {
            plain.push_str(line);
            plain.push('\n');
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::of_open_metrics;

    #[test]
    fn a_counter_s_family_is_named_as_its_samples_are() {
        let open = "# HELP a_cycles Cycles begun.\n# TYPE a_cycles counter\na_cycles_total 5\n# HELP a_age_seconds \
                    Age.\n# TYPE a_age_seconds gauge\n# UNIT a_age_seconds seconds\na_age_seconds{of=\"x\"} 0.5\n# \
                    HELP a_build Version.\n# TYPE a_build info\na_build_info{version=\"1\"} 1\n# EOF\n";
        assert_eq!(
            of_open_metrics(open),
            "# HELP a_cycles_total Cycles begun.\n# TYPE a_cycles_total counter\na_cycles_total 5\n# HELP \
             a_age_seconds Age.\n# TYPE a_age_seconds gauge\na_age_seconds{of=\"x\"} 0.5\n# HELP a_build_info \
             Version.\n# TYPE a_build_info gauge\na_build_info{version=\"1\"} 1\n"
        );
    }
}
