//! The memory that this process can still allocate before the system runs out of it and kills a process.

use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// The number of bytes that are left on the machine and in the control groups of this process, whichever is less. `None` where the system
/// does not report these numbers (anywhere but on Linux) or does not kill processes.
pub fn available_memory() -> Option<u64> {
    if !cfg!(target_os = "linux") {
        return None;
    }
    let machine = of_machine(&read_to_string("/proc/meminfo").ok()?)?;
    let groups = read_to_string("/proc/self/cgroup").unwrap_or_default();
    let groups = folders(&groups, Path::new("/sys/fs/cgroup"));
    Some(groups.iter().filter_map(|folder| of_group(folder)).fold(machine, u64::min))
}

/// The memory that `/proc/meminfo` reports as available without swapping, plus the free swap space.
fn of_machine(text: &str) -> Option<u64> {
    fn line(name: &str, text: &str) -> Option<u64> {
        let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
        rest.trim_end_matches("kB").trim().parse::<u64>().ok()
    }
    Some((line("MemAvailable:", text)? + line("SwapFree:", text).unwrap_or(0)) * 1024)
}

/// The folders of the control groups that `/proc/self/cgroup` lists, and of their ancestors, for both versions of cgroups. In a container
/// the outermost folder is that of the container.
fn folders(text: &str, root: &Path) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for line in text.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(kinds), Some(path)) = (parts.next(), parts.next()) else { continue };
        let root = match kinds {
            "" => root.to_owned(),
            kinds if kinds.split(',').any(|kind| kind == "memory") => root.join("memory"),
            _ => continue,
        };
        let inner = root.join(path.trim_start_matches('/'));
        let around = inner.ancestors().take_while(|folder| folder.starts_with(&root));
        folders.extend(around.map(Path::to_owned));
    }
    folders
}

/// The memory that a control group has left. `None` if the group has no limit. Memory that holds cached files counts as free, because the
/// system reclaims it on demand.
fn of_group(folder: &Path) -> Option<u64> {
    fn number(name: &str, folder: &Path) -> Option<u64> {
        read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok()
    }
    let limit = number("memory.max", folder).or_else(|| number("memory.limit_in_bytes", folder))?;
    let used =
        number("memory.current", folder).or_else(|| number("memory.usage_in_bytes", folder))?;
    let stat = read_to_string(folder.join("memory.stat")).unwrap_or_default();
    let files = stat.lines().find_map(|line| {
        let rest =
            line.strip_prefix("total_inactive_file ").or(line.strip_prefix("inactive_file "));
        rest?.trim().parse::<u64>().ok()
    });
    Some(limit.saturating_sub(used.saturating_sub(files.unwrap_or(0))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn system_files_are_parsed() {
        let text = "MemTotal:  8000000 kB\nMemAvailable:   2000 kB\nSwapFree:    500 kB\n";
        assert_eq!(of_machine(text), Some(2500 * 1024));
        assert_eq!(of_machine("MemTotal: 3 kB\n"), None);
        let text = "5:cpu,memory:/a\n2:cpu:/x\n0::/b/c\n";
        let paths = ["/r/memory/a", "/r/memory", "/r/b/c", "/r/b", "/r"];
        assert_eq!(folders(text, Path::new("/r")), paths.map(PathBuf::from));
    }

    #[test]
    fn cached_files_count_as_free_memory_of_a_group() {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("memory.current", "700\n");
        write("memory.stat", "anon 500\ninactive_file 150\n");
        write("memory.max", "max\n");
        assert_eq!(of_group(folder.path()), None);
        write("memory.max", "1000\n");
        assert_eq!(of_group(folder.path()), Some(450));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn something_is_left() {
        assert!(available_memory().is_some_and(|bytes| 1 << 20 < bytes));
    }
}
