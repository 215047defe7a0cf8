//! Which places of the file system a graph depends on.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

/// A file that is to be watched, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Wish {
    pub(crate) path: PathBuf,
    pub(crate) why: String,
}

/// A watched file.
#[derive(Clone, Debug)]
pub(crate) struct Watched {
    /// The path under which it is opened.
    pub(crate) path: PathBuf,
    /// Why it is watched, in words.
    pub(crate) why: String,
    /// The entries of folders that decide what is found under the path: the file, every symbolic link on the way, the folders
    /// of the project on the way; if something is missing, only as far as the first missing one.
    pub(crate) places: Vec<PathBuf>,
}

/// All watched files.
#[derive(Clone, Debug, Default)]
pub(crate) struct WatchList {
    files: Vec<Watched>,
    /// The files that each place decides about, by their index.
    by_place: BTreeMap<PathBuf, Vec<usize>>,
    folders: BTreeSet<PathBuf>,
}

impl WatchList {
    /// The list of these files as the file system is now. Folders below `project` may be renamed and replaced, too.
    pub(crate) fn new(wishes: &[Wish], project: &Path) -> Self {
        let mut list = Self::default();
        let mut indices: BTreeMap<PathBuf, usize> = BTreeMap::new();
        for wish in wishes {
            let path = std::path::absolute(&wish.path).unwrap_or_else(|_| wish.path.clone());
            if let Some(&index) = indices.get(&path) {
                let why = &mut list.files[index].why;
                if !why.split(", ").any(|known| known == wish.why) {
                    *why += &format!(", {}", wish.why);
                }
                continue;
            }
            let index = list.files.len();
            indices.insert(path.clone(), index);
            let places = places(&path, project);
            for place in places.iter().chain([&path]) {
                let files = list.by_place.entry(place.clone()).or_default();
                // A place of this file that came before would be the last one.
                if files.last() != Some(&index) {
                    files.push(index);
                }
            }
            list.folders.extend(places.iter().filter_map(|place| Some(place.parent()?.to_owned())));
            list.files.push(Watched { path, why: wish.why.clone(), places });
        }
        list
    }

    pub(crate) fn files(&self) -> &[Watched] {
        &self.files
    }

    /// The folders in which something may happen; all exist.
    pub(crate) fn folders(&self) -> &BTreeSet<PathBuf> {
        &self.folders
    }

    /// The files about which an event at this path may say something.
    pub(crate) fn touched(&self, path: &Path) -> Vec<&Watched> {
        let at = self.by_place.get(path).into_iter().flatten().map(|&index| &self.files[index]);
        match self.folders.contains(path) {
            true => self
                .files
                .iter()
                .filter(|file| file.places.iter().any(|place| place.parent() == Some(path)))
                .collect(),
            false => at.collect(),
        }
    }
}

/// More symbolic links than this on the way to a file are a circle, for Linux, too.
const MOST_LINKS: usize = 40;

fn places(path: &Path, project: &Path) -> Vec<PathBuf> {
    let mut places = Vec::new();
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
            places.push(next);
            break;
        };
        if metadata.is_symlink() {
            links += 1;
            let target = std::fs::read_link(&next).unwrap_or_default();
            places.push(next);
            if links > MOST_LINKS {
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
            places.push(next.clone());
        }
        real = next;
    }
    places
}

fn parts(path: &Path) -> impl Iterator<Item = OsString> {
    path.components().map(|part| part.as_os_str().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The places of `path`, relative to a project with a folder `a` that holds a file `file`.
    fn check(prepare: fn(&Path), path: &str, expected: &[&str]) {
        let folder = tempfile::tempdir().unwrap();
        let project = std::fs::canonicalize(folder.path()).unwrap();
        std::fs::create_dir(project.join("a")).unwrap();
        std::fs::write(project.join("a/file"), "x").unwrap();
        prepare(&project);
        let wish = Wish { path: project.join(path), why: "why".into() };
        let list = WatchList::new(&[wish], &project);
        let places = list.files[0].places.iter();
        let relative = places.map(|place| place.strip_prefix(&project).unwrap());
        let names = relative.map(|place| place.to_string_lossy().replace('\\', "/"));
        assert_eq!(names.collect::<Vec<_>>(), expected);
        for place in &list.files[0].places {
            assert_eq!(list.touched(place).len(), 1);
        }
        assert!(list.folders.iter().all(|folder| folder.is_dir()));
        assert!(list.touched(&project.join("other")).is_empty());
    }

    #[test]
    fn a_file_and_its_folders_are_watched() {
        check(|_| {}, "a/file", &["a", "a/file"]);
        check(|_| {}, "a/../a/./file", &["a", "a", "a/file"]);
    }

    #[test]
    fn of_a_missing_path_the_first_missing_part_is_watched() {
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
    fn links_in_a_circle_end() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("link", &link).unwrap();
        assert_eq!(places(&link, folder.path()).len(), MOST_LINKS + 1);
    }
}
