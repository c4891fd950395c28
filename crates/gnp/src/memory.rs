//! How much memory the program has used.

/// Largest resident size so far in bytes; `None` where the system does not tell (all but Linux).
#[must_use]
pub fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    parse(&status, "VmHWM:")
}

/// Resident size now in bytes; `None` as for [`peak`].
#[must_use]
pub fn now() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    parse(&status, "VmRSS:")
}

/// Reads a line such as `VmHWM:  123 kB` of a process status.
fn parse(status: &str, name: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// [`peak`] for people.
#[must_use]
pub fn peak_text() -> String {
    peak().map_or_else(|| "unknown".to_owned(), |bytes| format!("{:.0} MB", bytes as f64 / 1e6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_line_asked_for() {
        let status = "Name:\tx\nVmPeak:\t  99 kB\nVmHWM:\t    2048 kB\nVmRSS:\t 1 kB\n";
        assert_eq!(parse(status, "VmHWM:"), Some(2_097_152));
        assert_eq!(parse(status, "VmRSS:"), Some(1024));
        assert_eq!(parse("Name:\tx\n", "VmHWM:"), None);
    }
}
