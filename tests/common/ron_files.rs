//! The graph files, and the files that belong to them, in a folder and its subfolders.

use std::path::{Path, PathBuf};

/// Returns the paths of all `.ron` files, sorted.
pub(crate) fn ron_files(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder that can be read") {
            let path = entry.expect("an entry that can be read").path();
            match path.is_dir() {
                true => folders.push(path),
                false if path.extension().is_some_and(|ending| ending == "ron") => files.push(path),
                false => {}
            }
        }
    }
    files.sort();
    files
}
