//! Writes the files of a single value.

use std::io;
use std::path::{Path, PathBuf};

use maquette_node::pack::NewFile;

use crate::writing::{Destination, Sources, WriteError};

/// Writes the files of a value into the folder of `path`. `files` is the result of
/// [`Catalog::write`](maquette_graph::catalog::Catalog::write). Each file is written whole or not at all. If one of them must not be
/// written, none is written. Existing links, folders and devices are not replaced. Returns the paths of the files.
///
/// # Errors
/// The path of the file that could not be written, and the reason.
pub fn save(files: Vec<NewFile>, path: &Path) -> Result<Vec<PathBuf>, SaveError> {
    let files = files.into_iter().map(|file| (path.with_file_name(&file.name), file.bytes));
    let files = Vec::from_iter(files);
    match Destination::anywhere(&Sources::default()).put_all(&files) {
        Ok(()) => Ok(files.into_iter().map(|(path, _)| path).collect()),
        Err((path, why)) => Err(SaveError { path, why }),
    }
}

/// Returns the POSIX error code for an error of writing a temporary file, or `None` if no code fits. Such an error has a kind but no system
/// error code.
fn code_of(kind: io::ErrorKind) -> Option<i32> {
    Some(match kind {
        io::ErrorKind::NotFound => 2,
        io::ErrorKind::PermissionDenied => ACCESS_DENIED,
        io::ErrorKind::AlreadyExists => 17,
        io::ErrorKind::NotADirectory => 20,
        io::ErrorKind::IsADirectory => 21,
        io::ErrorKind::StorageFull => 28,
        io::ErrorKind::ReadOnlyFilesystem => 30,
        _ => return None,
    })
}

/// The error that a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {why}", .path.display())]
pub struct SaveError {
    /// The path of the file that could not be written.
    pub path: PathBuf,
    why: WriteError,
}

/// The POSIX error code `EACCES`. It is 13 on all systems.
const ACCESS_DENIED: i32 = 13;

impl SaveError {
    /// Returns the error code of the operating system, or `None` if the error has another cause.
    pub fn system_code(&self) -> Option<i32> {
        match &self.why {
            WriteError::System(error) => error.raw_os_error().or_else(|| code_of(error.kind())),
            WriteError::ReadOnly => Some(ACCESS_DENIED),
            _ => None,
        }
    }
}
