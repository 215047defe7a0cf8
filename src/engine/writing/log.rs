//! Log files. People may read them while they grow.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use super::{parent_folder, remove, remove_empty};

/// Opens a log file for appending. Creates the file and the folders above it if they are missing.
pub fn open_log(path: &Path) -> io::Result<File> {
    fs::create_dir_all(parent_folder(path))?;
    File::options().create(true).append(true).open(path)
}

/// Creates an empty log file that replaces an earlier one. Returns an error if the path exists and is not a plain file.
pub fn begin_log(path: &Path) -> io::Result<File> {
    match remove(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => open_log(path),
    }
}

/// Removes all log files in a folder and its subfolders, and then the subfolders that are empty. Errors are ignored.
pub fn remove_logs(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        // Do not follow links to folders.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            remove_logs(&path);
        } else if path.extension().is_some_and(|extension| extension == "log") {
            let _ = remove(&path);
        }
    }
    remove_empty(folder);
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn logs_are_appended_or_replaced_and_only_logs_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let logs = folder.path().join("logs");
        let path = logs.join("a/5.log");
        write!(open_log(&path).unwrap(), "one ").unwrap();
        write!(open_log(&path).unwrap(), "two").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "one two");
        write!(begin_log(&path).unwrap(), "three").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "three");

        let other = logs.join("b/notes.txt");
        fs::create_dir_all(other.parent().unwrap()).unwrap();
        fs::write(&other, "").unwrap();
        remove_logs(&logs);
        assert!(other.exists() && !logs.join("a").exists());
        fs::remove_file(&other).unwrap();
        remove_logs(&logs);
        assert!(!logs.exists());
    }

    #[cfg(unix)]
    #[test]
    fn targets_of_links_are_not_logs() {
        let folder = tempfile::tempdir().unwrap();
        fn path_in(name: &str, folder: &tempfile::TempDir) -> std::path::PathBuf {
            folder.path().join(name)
        }
        fs::write(path_in("graph.ron", &folder), "Graph()").unwrap();
        fs::create_dir(path_in("logs", &folder)).unwrap();
        std::os::unix::fs::symlink(path_in("graph.ron", &folder), path_in("logs/5.log", &folder))
            .unwrap();
        std::os::unix::fs::symlink(folder.path(), path_in("logs/more", &folder)).unwrap();
        assert!(begin_log(&path_in("logs/5.log", &folder)).is_err());
        remove_logs(&path_in("logs", &folder));
        assert_eq!(fs::read_to_string(path_in("graph.ron", &folder)).unwrap(), "Graph()");
    }
}
