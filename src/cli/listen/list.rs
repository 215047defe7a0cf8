//! The list of paths to watch: those on which a graph depends.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

/// A file to be watched, with the reason for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WatchRequest {
    pub(crate) path: PathBuf,
    pub(crate) reason: String,
}

/// A watched file.
#[derive(Clone, Debug)]
pub(crate) struct WatchedFile {
    /// The path by which the graph opens the file.
    pub(crate) path: PathBuf,
    /// The reason for watching the file.
    pub(crate) reason: String,
    /// The directory entries that determine which file the path leads to. These are the file itself, and each symbolic link and project
    /// folder on the path. The list ends at the first entry that does not exist.
    pub(crate) entries: Vec<PathBuf>,
}

/// All watched files.
#[derive(Clone, Debug, Default)]
pub(crate) struct WatchList {
    files: Vec<WatchedFile>,
    /// For each directory entry, the indices of the files that depend on it.
    by_entry: BTreeMap<PathBuf, Vec<usize>>,
    folders: BTreeSet<PathBuf>,
}

impl WatchList {
    /// Creates the list for the present state of the file system. Folders inside of `project` are watched, too, because they may be renamed
    /// or replaced.
    pub(crate) fn new(requests: &[WatchRequest], project: &Path) -> Self {
        let mut list = Self::default();
        let mut indices: BTreeMap<PathBuf, usize> = BTreeMap::new();
        for request in requests {
            let path = std::path::absolute(&request.path).unwrap_or_else(|_| request.path.clone());
            if let Some(&index) = indices.get(&path) {
                let why = &mut list.files[index].reason;
                if !why.split(", ").any(|known| known == request.reason) {
                    *why += &format!(", {}", request.reason);
                }
                continue;
            }
            let index = list.files.len();
            indices.insert(path.clone(), index);
            let entries = entries(&path, project);
            for entry in entries.iter().chain([&path]) {
                let files = list.by_entry.entry(entry.clone()).or_default();
                // Add an index only once, even if the entry occurs twice on one path.
                if files.last() != Some(&index) {
                    files.push(index);
                }
            }
            list.folders
                .extend(entries.iter().filter_map(|entry| Some(entry.parent()?.to_owned())));
            list.files.push(WatchedFile { path, reason: request.reason.clone(), entries });
        }
        list
    }

    pub(crate) fn files(&self) -> &[WatchedFile] {
        &self.files
    }

    /// Returns the folders to watch. All of them exist.
    pub(crate) fn folders(&self) -> &BTreeSet<PathBuf> {
        &self.folders
    }

    /// Returns the files that an event at this path may affect.
    pub(crate) fn files_at(&self, path: &Path) -> Vec<&WatchedFile> {
        let at = self.by_entry.get(path).into_iter().flatten().map(|&index| &self.files[index]);
        match self.folders.contains(path) {
            true => self
                .files
                .iter()
                .filter(|file| file.entries.iter().any(|entry| entry.parent() == Some(path)))
                .collect(),
            false => at.collect(),
        }
    }
}

/// The maximum number of symbolic links on a path, as in Linux. With more links, the path is assumed to be a cycle.
const MAX_LINKS: usize = 40;

fn entries(path: &Path, project: &Path) -> Vec<PathBuf> {
    let mut entries = Vec::new();
    let mut real = PathBuf::new();
    let mut rest: VecDeque<OsString> = parts(path).collect();
    let mut links = 0;
    while let Some(part) = rest.pop_front() {
        match Path::new(&part).components().next() {
            Some(Component::Normal(_)) => {}
            Some(Component::ParentDir) => {
                real.pop();
                continue;
            }
            Some(Component::CurDir) | None => continue,
            Some(Component::Prefix(_) | Component::RootDir) => {
                real.push(part);
                continue;
            }
        }
        let next = real.join(part);
        let Ok(metadata) = std::fs::symlink_metadata(&next) else {
            entries.push(next);
            break;
        };
        if metadata.is_symlink() {
            links += 1;
            let target = std::fs::read_link(&next).unwrap_or_default();
            entries.push(next);
            if links > MAX_LINKS {
                break;
            }
            for part in Vec::from_iter(parts(&target)).into_iter().rev() {
                rest.push_front(part);
            }
            if target.is_absolute() {
                real.clear();
            }
            continue;
        }
        let in_project = next.starts_with(project) && next != project;
        if in_project || rest.is_empty() {
            entries.push(next.clone());
        }
        real = next;
    }
    entries
}

fn parts(path: &Path) -> impl Iterator<Item = OsString> {
    path.components().map(|part| part.as_os_str().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks which directory entries determine the file at `path`. The project contains a folder `a` with a file `file`.
    fn check(prepare: fn(&Path), path: &str, expected: &[&str]) {
        let folder = tempfile::tempdir().unwrap();
        let project = std::fs::canonicalize(folder.path()).unwrap();
        std::fs::create_dir(project.join("a")).unwrap();
        std::fs::write(project.join("a/file"), "x").unwrap();
        prepare(&project);
        let request = WatchRequest { path: project.join(path), reason: "why".into() };
        let list = WatchList::new(&[request], &project);
        let entries = list.files[0].entries.iter();
        let relative = entries.map(|entry| entry.strip_prefix(&project).unwrap());
        let names = relative.map(|entry| entry.to_string_lossy().replace('\\', "/"));
        assert_eq!(names.collect::<Vec<_>>(), expected);
        for entry in &list.files[0].entries {
            assert_eq!(list.files_at(entry).len(), 1);
        }
        assert!(list.folders.iter().all(|folder| folder.is_dir()));
        assert!(list.files_at(&project.join("other")).is_empty());
    }

    #[test]
    fn a_file_and_its_folders_are_watched() {
        check(|_| {}, "a/file", &["a", "a/file"]);
        check(|_| {}, "a/../a/./file", &["a", "a", "a/file"]);
    }

    #[test]
    fn the_first_missing_part_of_a_path_is_watched() {
        check(|_| {}, "a/other", &["a", "a/other"]);
        check(|_| {}, "b/c/file", &["b"]);
    }

    #[cfg(unix)]
    #[test]
    fn every_link_on_the_way_is_watched() {
        use std::os::unix::fs::symlink;
        check(|p| symlink("a/file", p.join("link")).unwrap(), "link", &["link", "a", "a/file"]);
        check(|p| symlink("a", p.join("b")).unwrap(), "b/file", &["b", "a", "a/file"]);
        check(|p| symlink("nowhere", p.join("b")).unwrap(), "b/file", &["b", "nowhere"]);
        check(|p| symlink(p.join("a"), p.join("b")).unwrap(), "b/file", &["b", "a", "a/file"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_cycle_of_links_ends() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("link", &link).unwrap();
        assert_eq!(entries(&link, folder.path()).len(), MAX_LINKS + 1);
    }
}
