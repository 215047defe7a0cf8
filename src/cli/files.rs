//! Finds the files that the arguments of a command select. An argument may be a folder, which may also contain `.ron` files that are not
//! graphs.

use std::io;
use std::path::{Path, PathBuf};

use maquette_golden::case;
use maquette_graph::{LOCK_ENDING, PINS_ENDING};

use super::serve::LAYOUT_ENDING;

/// Returns the files that some paths select, and the folders that could not be read. A folder selects all `.ron` files in it and its
/// subfolders, sorted by name, except those in hidden folders. Companion files of graphs ([`is_companion`]) are skipped, unless a companion
/// file is the only path.
pub(super) fn find_files(paths: &[PathBuf]) -> (Vec<PathBuf>, Vec<(PathBuf, io::Error)>) {
    let (mut files, mut unread) = (Vec::new(), Vec::new());
    for path in filter_paths(paths, is_companion) {
        unread.extend(collect_files(path, &mut files).err());
    }
    (files, unread)
}

/// Returns the paths for which `is_other` is false. If there is only one path, it is always returned.
pub(super) fn filter_paths(
    paths: &[PathBuf],
    is_other: fn(&Path) -> bool,
) -> impl Iterator<Item = &PathBuf> {
    paths.iter().filter(move |path| paths.len() == 1 || !is_other(path))
}

/// Returns true if a file accompanies a graph: a lock file, a file of pins, or the positions of nodes in an editor.
pub(super) fn is_companion(path: &Path) -> bool {
    let name = path.to_string_lossy();
    [LOCK_ENDING, PINS_ENDING, LAYOUT_ENDING]
        .into_iter()
        .any(|ending| name.ends_with(&format!(".{ending}")))
}

/// Returns true if the name of a file shows that it is not a graph but a companion file, a test or a sweep.
pub(super) fn is_no_graph(path: &Path) -> bool {
    let name = path.to_string_lossy();
    is_companion(path)
        || [case::EXTENSION, maquette_golden::sweep::EXTENSION]
            .iter()
            .any(|ending| name.ends_with(ending))
}

fn collect_files(path: &Path, files: &mut Vec<PathBuf>) -> Result<(), (PathBuf, io::Error)> {
    if !path.is_dir() {
        files.push(path.to_owned());
        return Ok(());
    }
    let unread = |error| (path.to_owned(), error);
    let entries = std::fs::read_dir(path).map_err(unread)?;
    let mut entries = entries.collect::<Result<Vec<_>, _>>().map_err(unread)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let kind = entry.file_type().map_err(unread)?;
        let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
        let path = entry.path();
        let is_ron = path.extension().is_some_and(|ending| ending == "ron") && !is_companion(&path);
        // Do not follow symbolic links, which may form a cycle or lead out of the project.
        if (kind.is_dir() && !is_hidden) || (is_ron && kind.is_file()) {
            collect_files(&path, files)?;
        }
    }
    Ok(())
}
