//! Logs: files that people read while they grow.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use super::{beside, remove, remove_empty};

/// Opens a log at its end, and makes the folders above it: what was there stays.
pub fn open_log(path: &Path) -> io::Result<File> {
    fs::create_dir_all(beside(path))?;
    File::options().create(true).append(true).open(path)
}

/// Opens an empty log in place of the one that was there. What is no plain file stays, and is an error.
pub fn begin_log(path: &Path) -> io::Result<File> {
    match remove(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => open_log(path),
    }
}

/// Removes the logs in a folder and in those below it, and the folders in which nothing else is. What cannot be removed stays.
pub fn remove_logs(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        // Not the folder that a link leads to.
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
    fn a_log_goes_on_or_begins_anew_and_nothing_but_logs_is_removed() {
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
    fn what_a_link_leads_to_is_no_log() {
        let folder = tempfile::tempdir().unwrap();
        fn at(name: &str, folder: &tempfile::TempDir) -> std::path::PathBuf {
            folder.path().join(name)
        }
        fs::write(at("graph.ron", &folder), "Graph()").unwrap();
        fs::create_dir(at("logs", &folder)).unwrap();
        std::os::unix::fs::symlink(at("graph.ron", &folder), at("logs/5.log", &folder)).unwrap();
        std::os::unix::fs::symlink(folder.path(), at("logs/more", &folder)).unwrap();
        assert!(begin_log(&at("logs/5.log", &folder)).is_err());
        remove_logs(&at("logs", &folder));
        assert_eq!(fs::read_to_string(at("graph.ron", &folder)).unwrap(), "Graph()");
    }
}
