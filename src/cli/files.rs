//! Which files a command means that takes several: a shell's pattern, `*.ron`, or a folder has more than graphs in it.

use std::io;
use std::path::{Path, PathBuf};

use maquette_golden::case;
use maquette_graph::{LOCK_ENDING, PINS_ENDING};

use super::serve::LAYOUT_ENDING;

/// The files of some paths, and what could not be read. Of folders all `.ron` files, in the order of their names, and those of the
/// folders in them, hidden ones left out. What programs keep beside graphs is passed over, unless it is all that is named.
pub(super) fn given(paths: &[PathBuf]) -> (Vec<PathBuf>, Vec<(PathBuf, io::Error)>) {
    let (mut files, mut unread) = (Vec::new(), Vec::new());
    for path in without(paths, is_beside) {
        unread.extend(collect(path, &mut files).err());
    }
    (files, unread)
}

/// The paths without those that are not meant, if several are named.
pub(super) fn without(
    paths: &[PathBuf],
    is_other: fn(&Path) -> bool,
) -> impl Iterator<Item = &PathBuf> {
    paths.iter().filter(move |path| paths.len() == 1 || !is_other(path))
}

/// Whether a program keeps the file beside a graph: a lock file, pins, or where an editor puts nodes.
pub(super) fn is_beside(path: &Path) -> bool {
    let name = path.to_string_lossy();
    [LOCK_ENDING, PINS_ENDING, LAYOUT_ENDING]
        .into_iter()
        .any(|ending| name.ends_with(&format!(".{ending}")))
}

/// Whether the file is no graph by its name: the same, a test or a sweep.
pub(super) fn is_no_graph(path: &Path) -> bool {
    let name = path.to_string_lossy();
    is_beside(path)
        || [case::ENDING, maquette_golden::sweep::ENDING]
            .iter()
            .any(|ending| name.ends_with(ending))
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) -> Result<(), (PathBuf, io::Error)> {
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
        let is_ron = path.extension().is_some_and(|ending| ending == "ron") && !is_beside(&path);
        // Links are not followed: they may lead in a circle, or to files of somebody else.
        if (kind.is_dir() && !is_hidden) || (is_ron && kind.is_file()) {
            collect(&path, files)?;
        }
    }
    Ok(())
}
