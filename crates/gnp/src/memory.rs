//! How much memory the program has used, and how much it may have.

use std::fs;
use std::path::{Path, PathBuf};

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

/// Resident size of a process by its number, bytes; `None` as for [`peak`], and where there is no such process.
#[must_use]
pub fn of(process: u32) -> Option<u64> {
    parse(&std::fs::read_to_string(format!("/proc/{process}/status")).ok()?, "VmRSS:")
}

/// Bytes that the program may have in all: those it has now, and those that are free in the system and in the control
/// group that the program runs in (version 1 or 2); `None` where the system does not tell (all but Linux).
#[must_use]
pub fn allowed() -> Option<u64> {
    let free = parse(&fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")?;
    let group = fs::read_to_string("/proc/self/cgroup").ok();
    let left = group.and_then(|text| left_in_groups(Path::new("/sys/fs/cgroup"), &text));
    Some(left.map_or(free, |left| left.min(free)) + now().unwrap_or(0))
}

/// Bytes that the control groups of `/proc/self/cgroup` and those above them leave; `None` where none has a limit.
fn left_in_groups(root: &Path, text: &str) -> Option<u64> {
    let groups = text.lines().filter_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, group) = (parts.next()?, parts.next()?.trim_start_matches('/'));
        // Version 2 has one hierarchy without a name.
        let place = match controllers {
            "" => Some((root.to_owned(), ["memory.max", "memory.current", "inactive_file "])),
            named if named.split(',').any(|name| name == "memory") => {
                let files = ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file "];
                Some((root.join("memory"), files))
            }
            _ => None,
        };
        place.map(|(top, files)| (top, group, files))
    });
    let left = groups.flat_map(|(top, group, files)| {
        // In a container the group's own path is not to be seen, but its files are at the top.
        let folders: Vec<PathBuf> = Path::new(group).ancestors().map(|above| top.join(above)).collect();
        folders.into_iter().filter_map(move |folder| left_in_group(&folder, files))
    });
    left.min()
}

/// Bytes that one control group leaves; what it holds of files that were read is given up where memory is short.
fn left_in_group(folder: &Path, [limit, used, cached]: [&str; 3]) -> Option<u64> {
    let read = |file: &str| fs::read_to_string(folder.join(file)).ok();
    let limit: u64 = read(limit)?.trim().parse().ok()?; // `max` is no number
    let used: u64 = read(used)?.trim().parse().ok()?;
    let stat = read("memory.stat").unwrap_or_default();
    let cached = stat.lines().find_map(|line| line.strip_prefix(cached)?.trim().parse().ok()).unwrap_or(0);
    Some(limit.saturating_sub(used.saturating_sub(cached)))
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

    #[test]
    fn the_closest_limit_of_the_control_groups_counts() {
        let root = tempfile::tempdir().unwrap();
        let put = |folder: &str, files: &[(&str, &str)]| {
            let folder = root.path().join(folder);
            fs::create_dir_all(&folder).unwrap();
            files.iter().for_each(|(name, text)| fs::write(folder.join(name), text).unwrap());
        };
        let left = |text: &str| left_in_groups(root.path(), text);
        assert_eq!(left("0::/a/b\n"), None);
        put("a/b", &[("memory.max", "max\n"), ("memory.current", "10\n")]);
        assert_eq!(left("0::/a/b\n"), None);
        let stat = ("memory.stat", "anon 5\ninactive_file 200\n");
        put("a", &[("memory.max", "1000\n"), ("memory.current", "500\n"), stat]);
        assert_eq!(left("0::/a/b\n"), Some(700));
        // Version 1, seen from within a container.
        put("memory", &[("memory.limit_in_bytes", "400"), ("memory.usage_in_bytes", "100")]);
        assert_eq!(left("4:cpu,memory:/docker/x\n3:pids:/\n0::/a\n"), Some(300));
        assert_eq!(left("3:pids:/\n"), None);
        // More in use than allowed leaves nothing.
        put("memory", &[("memory.usage_in_bytes", "900")]);
        assert_eq!(left("4:memory:/\n"), Some(0));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn what_is_allowed_holds_what_is_used() {
        assert!(allowed().unwrap() >= now().unwrap());
    }
}
