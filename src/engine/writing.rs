//! Writes, replaces and deletes files. This is the only module that creates or removes files.
//!
//! - A file appears whole or not at all: it is written to a temporary file in the same folder and moved to its path (`write_whole`).
//! - Only writable plain files are replaced, and only plain files are removed: no links, folders, pipes or devices.
//! - The files of a graph and the files that it reads are not replaced ([`Sources`]). Nothing is written outside of the given folder,
//!   wherever links lead ([`Destination`]).
//! - Unfinished files of killed processes are removed; those of running processes stay (`temporary`).

use std::fs::{self, File, Metadata};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use maquette_graph::file_stat::FileStat;
use maquette_syntax::paths::without_dots;
use tempfile::NamedTempFile;

mod exchange_folder;
mod folder_lock;
mod large;
mod log;
mod recycled_file;
mod sources;
mod temporary;

pub use exchange_folder::ExchangeFolder;
pub use folder_lock::FolderLock;
pub(crate) use large::{bring_to_disk, write_at};
pub use log::{begin_log, open_log, remove_logs};
pub(crate) use recycled_file::RecycledFile;
pub use sources::Sources;
pub(crate) use temporary::{is_abandoned, is_temporary, sweep};

/// The part of the file system in which files may be written and removed.
pub struct Destination<'a> {
    bounds: Bounds,
    sources: &'a Sources,
}

enum Bounds {
    /// Any path is allowed.
    None,
    /// Paths inside of this folder are allowed. Links inside of the folder must not lead out of it.
    Folder(PathBuf),
    /// Paths inside of `folder` are allowed, which itself must be inside of `base`.
    Inside { base: PathBuf, folder: PathBuf },
    /// Paths inside of this folder are allowed, if no link is on the way from the folder to the file.
    Own(PathBuf),
}

/// The reason why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    #[error("{0}")]
    Source(&'static str),
    #[error("a link leads out of {}", .0.display())]
    Outside(PathBuf),
    #[error("there is a link on the way from {}", .0.display())]
    Linked(PathBuf),
    #[error("it is {0}; only plain files are replaced")]
    NotPlain(&'static str),
    #[error("it is read-only")]
    ReadOnly,
    #[error(transparent)]
    System(#[from] io::Error),
}

impl<'a> Destination<'a> {
    /// Creates a destination that allows any path. For paths that the user has given explicitly.
    pub fn anywhere(sources: &'a Sources) -> Self {
        Self { bounds: Bounds::None, sources }
    }

    /// Creates a destination that allows a folder that the user has given explicitly. The path to the folder may contain links.
    pub fn folder(folder: &Path, sources: &'a Sources) -> Self {
        Self { bounds: Bounds::Folder(folder.to_owned()), sources }
    }

    /// Creates a destination that allows a folder inside of `base`. No link may lead out of `base`.
    pub fn folder_inside(base: &Path, folder: &Path, sources: &'a Sources) -> Self {
        Self {
            bounds: Bounds::Inside { base: base.to_owned(), folder: folder.to_owned() },
            sources,
        }
    }

    /// Creates a destination that allows paths inside of `base`, if no link is on the way from `base` to the file.
    pub fn without_links(base: &Path, sources: &'a Sources) -> Self {
        Self { bounds: Bounds::Own(base.to_owned()), sources }
    }

    /// Writes the given bytes to a file, whole or not at all. Returns the metadata of the file, or `None` if another program has already
    /// changed it. The first write of this process to a folder removes unfinished files that killed processes left there.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<Option<FileStat>, WriteError> {
        self.check(path)?;
        temporary::sweep_once(parent_folder(path));
        Ok(write_whole(path, bytes)?)
    }

    /// Writes `len` bytes by calling `fill`, and also returns the result of `fill`. The bytes go to a new file, or they overwrite a
    /// recycled file (an earlier version). For a recycled file, `fill` receives what is known about the content.
    pub(crate) fn write_again<S, T>(
        &self,
        path: &Path,
        len: usize,
        last: PreviousFiles<S>,
        fill: impl FnMut(&mut File, Option<&S>) -> io::Result<T>,
    ) -> Result<Rewritten<S, T>, WriteError> {
        self.check(path)?;
        Ok(write_by(path, len, last, fill)?)
    }

    /// Writes one file. Also removes unfinished files that killed processes left in its folder.
    pub fn put(&self, path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
        self.check(path)?;
        sweep(parent_folder(path));
        Ok(write_whole(path, bytes).map(|_| ())?)
    }

    /// Writes several files. If one of them must not be written, none is written. The error contains the path of the file that could not be
    /// written.
    pub fn put_all(&self, files: &[(PathBuf, Vec<u8>)]) -> Result<(), (PathBuf, WriteError)> {
        for (path, _) in files {
            self.check(path).map_err(|error| (path.clone(), error))?;
        }
        for (path, bytes) in files {
            self.put(path, bytes).map_err(|error| (path.clone(), error))?;
        }
        Ok(())
    }

    /// Checks that a file may be written at this path.
    pub fn check(&self, path: &Path) -> Result<(), WriteError> {
        self.check_folder(parent_folder(path))?;
        match fs::symlink_metadata(path) {
            Ok(it) if !it.is_file() => return Err(WriteError::NotPlain(kind(&it))),
            Ok(it) if it.permissions().readonly() => return Err(WriteError::ReadOnly),
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        self.sources.use_of(path).map_or(Ok(()), |what| Err(WriteError::Source(what)))
    }

    /// Removes a plain file.
    pub fn remove(&self, path: &Path) -> Result<(), WriteError> {
        self.check_folder(parent_folder(path))?;
        Ok(remove(path)?)
    }

    /// Removes unfinished files that killed processes left in a folder. Does nothing if this destination does not allow the folder.
    pub fn sweep(&self, folder: &Path) {
        if self.check_folder(folder).is_ok() {
            sweep(folder);
        }
    }

    /// Checks that files may be written to a folder.
    pub fn check_folder(&self, folder: &Path) -> Result<(), WriteError> {
        fn lies_in(inner: &Path, outer: &Path) -> Result<(), WriteError> {
            match real(inner)?.starts_with(real(outer)?) {
                true => Ok(()),
                false => Err(WriteError::Outside(outer.to_owned())),
            }
        }
        match &self.bounds {
            Bounds::None => Ok(()),
            Bounds::Folder(outer) => lies_in(folder, outer),
            Bounds::Inside { base, folder: outer } => {
                lies_in(outer, base)?;
                lies_in(folder, outer)
            }
            Bounds::Own(base) => {
                let below = folder.strip_prefix(base).ok();
                let expected = real(base)?.join(below.unwrap_or(Path::new("..")));
                match expected == real(folder)? {
                    true => Ok(()),
                    false => Err(WriteError::Linked(base.clone())),
                }
            }
        }
    }
}

/// Returns the folder that contains a file. For a file name without a folder, this is the current folder.
fn parent_folder(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns a path without symbolic links. The file need not exist yet. A link whose target does not exist is an error, because the path of
/// the target is unknown.
fn real(path: &Path) -> io::Result<PathBuf> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let path = std::path::absolute(path)?;
    let there = path.ancestors().find(|path| fs::symlink_metadata(path).is_ok()).unwrap_or(&path);
    let rest = path.strip_prefix(there).unwrap_or(Path::new(""));
    let there = fs::canonicalize(there)?;
    Ok(if rest.as_os_str().is_empty() { there } else { without_dots(&there.join(rest)) })
}

fn kind(metadata: &Metadata) -> &'static str {
    match metadata {
        it if it.is_symlink() => "a link",
        it if it.is_dir() => "a folder",
        _ => "a pipe or device",
    }
}

/// Replaces the text of a file that people edit. The file is written whole or not at all, and its permissions stay. If the path is a link,
/// its target is replaced.
pub fn rewrite(path: &Path, text: &str) -> io::Result<()> {
    let path = fs::canonicalize(path)?;
    let metadata = fs::metadata(&path)?;
    if !metadata.is_file() || metadata.permissions().readonly() {
        return Err(io::ErrorKind::PermissionDenied.into());
    }
    sweep(parent_folder(&path));
    write_whole(&path, text.as_bytes())?;
    fs::set_permissions(&path, metadata.permissions())
}

/// Replaces the text of a file, if the file still contains the text `read`. If the caller took a [`FolderLock`] before reading, no edit by
/// this program is lost. An edit by another program is lost only if it happens between the check and the write in this function.
pub fn replace(path: &Path, read: &str, text: &str) -> io::Result<()> {
    match maquette_value::fs::read_text(path)? == read {
        true => rewrite(path, text),
        false => Err(changed_meanwhile()),
    }
}

fn changed_meanwhile() -> io::Error {
    io::Error::other("another program is changing the file; try again")
}

/// Replaces the text of a file and creates a second file that belongs to it. If one of the two cannot be written, neither is. The error
/// contains the path of the file that could not be written.
pub fn rewrite_with(
    path: &Path,
    text: &str,
    (new, new_text): (&Path, &str),
) -> Result<(), (PathBuf, io::Error)> {
    let metadata = fs::metadata(path).map_err(|error| (path.to_owned(), error))?;
    if !metadata.is_file() || metadata.permissions().readonly() {
        return Err((path.to_owned(), io::ErrorKind::PermissionDenied.into()));
    }
    write_new(new, new_text).map_err(|error| (new.to_owned(), error))?;
    rewrite(path, text).map_err(|error| {
        // Remove the new file again. No other program has read it yet.
        let _ = remove(new);
        (path.to_owned(), error)
    })
}

/// Creates a file with the given text, and the folders above it. An existing file is an error.
pub fn write_new(path: &Path, text: &str) -> io::Result<()> {
    let folder = parent_folder(path);
    fs::create_dir_all(folder)?;
    sweep(folder);
    let mut file = temporary::create(folder)?;
    file.write_all(text.as_bytes())?;
    file.persist_noclobber(path).map_err(|error| error.error)?;
    Ok(())
}

/// Writes a file that the program stores next to a graph. People may read and edit the file.
pub fn keep_beside(path: &Path, text: &str) -> Result<(), WriteError> {
    match path.exists() {
        true => Ok(rewrite(path, text)?),
        false => Destination::anywhere(&Sources::default()).put(path, text.as_bytes()),
    }
}

/// Writes a temporary file and moves it to `path`, so the file appears whole or not at all. Returns the metadata of the file, or `None` if
/// another program has already changed it.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<Option<FileStat>> {
    write_parts(path, &[bytes])
}

/// Writes a file that only this user can read, in a folder that only this user can read. A missing folder is created.
pub fn write_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let folder = parent_folder(path);
    make_private_folder(folder)?;
    sweep(folder);
    let mut file = temporary::create_private(folder)?;
    file.write_all(bytes)?;
    file.persist(path).map(|_| ()).map_err(|error| error.error)
}

/// Creates a folder that other users cannot read. If the folder exists and other users can write to it, returns an error, because they
/// could replace the files in it.
fn make_private_folder(path: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(path)?;
    match is_private(&fs::metadata(path)?, 0o022) {
        true => Ok(()),
        false => Err(io::ErrorKind::PermissionDenied.into()),
    }
}

/// Returns true if a file or folder belongs to this user, and no other user has any of the given `permissions` (bits of the Unix mode). On
/// systems without such permissions, returns true, because a user's folders are private there.
#[cfg_attr(not(unix), expect(unused_variables, reason = "there is nothing to ask for"))]
pub fn is_private(metadata: &Metadata, permissions: u32) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let is_mine = metadata.uid() == rustix::process::geteuid().as_raw();
        is_mine && metadata.mode() & permissions == 0
    }
    #[cfg(not(unix))]
    true
}

/// Writes a file whose content is given in parts, whole or not at all. See [`write_whole`].
pub(crate) fn write_parts(path: &Path, parts: &[&[u8]]) -> io::Result<Option<FileStat>> {
    let len = parts.iter().map(|part| part.len()).sum();
    let written = write_by(path, len, PreviousFiles::<()>::default(), |file, _| {
        parts.iter().try_for_each(|part| file.write_all(part))
    })?;
    Ok(written.stamp)
}

/// The files at and next to a path that this process left there when it last wrote to the path.
pub(crate) struct PreviousFiles<S> {
    /// The metadata and the known content of the file at the path, if the next write should keep that file to be recycled.
    pub(crate) there: Option<(FileStat, S)>,
    /// A file that was replaced earlier, and that the next write may overwrite.
    pub(crate) recycled: Option<RecycledFile<S>>,
}

impl<S> Default for PreviousFiles<S> {
    fn default() -> Self {
        Self { there: None, recycled: None }
    }
}

/// The result of writing a file, and the file that was replaced.
pub(crate) struct Rewritten<S, T> {
    /// The metadata of the new file, or `None` if another program has already changed it.
    pub(crate) stamp: Option<FileStat>,
    /// The result of the function that wrote the content.
    pub(crate) result: T,
    /// The replaced file, if a later write can overwrite it.
    pub(crate) recycled: Option<RecycledFile<S>>,
}

/// Writes a file of `len` bytes by calling `fill`. If the file or its folder is removed during the write, tries again.
fn write_by<S, T>(
    path: &Path,
    len: usize,
    last: PreviousFiles<S>,
    mut fill: impl FnMut(&mut File, Option<&S>) -> io::Result<T>,
) -> io::Result<Rewritten<S, T>> {
    let folder = parent_folder(path);
    let PreviousFiles { mut there, recycled: mut spare } = last;
    retry_if_removed(|is_gone| {
        if is_gone {
            fs::create_dir_all(folder)?;
        }
        let (mut file, holds) = match spare.take().and_then(RecycledFile::reuse) {
            Some((file, holds)) => (file, Some(holds)),
            None => (temporary::create(folder)?, None),
        };
        match holds {
            Some(_) => file.as_file().set_len(len as u64)?,
            None => large::make_room(file.as_file(), len),
        }
        let result = fill(file.as_file_mut(), holds.as_ref())?;
        large::mark(file.as_file(), len)?;
        let written = file.as_file().metadata()?;
        // Keep the temporary file locked while it is moved to `path`.
        let (file, spare) = match there.take() {
            Some((stamp, holds)) => match RecycledFile::exchange(file, path, stamp, holds) {
                Ok(moved) => moved,
                Err(file) => (persist(file, path, len)?, None),
            },
            None => (persist(file, path, len)?, None),
        };
        Ok(Rewritten {
            stamp: FileStat::after_move(&written, &file.metadata()?),
            result,
            recycled: spare,
        })
    })
}

/// Moves a temporary file of `len` bytes to `path`.
fn persist(file: NamedTempFile, path: &Path, len: usize) -> io::Result<File> {
    let old = large::ReplacedFile::open(path, len);
    let file = file.persist(path).map_err(|error| error.error)?;
    old.close_in_background();
    Ok(file)
}

/// Calls `does`, and calls it again if it fails because a file or folder was removed, which another process may do at any time. Gives up
/// after a hundred attempts, because the error must then have another cause. The argument of `does` is false at the first attempt.
pub(crate) fn retry_if_removed<T>(mut does: impl FnMut(bool) -> io::Result<T>) -> io::Result<T> {
    const TRIES: usize = 100;
    let mut result = does(false);
    for _ in 1..TRIES {
        match &result {
            Err(error) if is_gone(error) => result = does(true),
            _ => break,
        }
    }
    result
}

/// Returns true if the error may mean that a file or folder was removed. One such error is "already exists", which can occur if a folder is
/// removed while this process creates it.
fn is_gone(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::AlreadyExists)
}

/// Returns true if files can be written to a folder or, if it does not exist, to the nearest existing folder above it.
pub fn is_writable(folder: &Path) -> bool {
    let there = folder.ancestors().find(|folder| fs::symlink_metadata(folder).is_ok());
    temporary::create(there.unwrap_or(Path::new("."))).is_ok()
}

/// Creates a folder and the folders above it.
pub fn make_folder(path: &Path) -> io::Result<()> {
    fs::create_dir_all(path)
}

/// Removes a plain file. If the path is a link, neither the link nor its target is removed.
pub fn remove(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path)? {
        it if it.is_file() => fs::remove_file(path),
        it => Err(io::Error::other(format!("it is {}", kind(&it)))),
    }
}

/// Removes a folder if it is empty. Errors are ignored.
pub fn remove_empty(folder: &Path) {
    let _ = fs::remove_dir(folder);
}

/// Marks a file as used by setting its modification time to now.
pub(crate) fn touch(path: &Path) {
    let file = File::options().append(true).open(path);
    // Ignore an error: another process may just have removed the file.
    let _ = file.and_then(|file| file.set_modified(SystemTime::now()));
}

#[cfg(test)]
mod tests;
