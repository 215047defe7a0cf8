//! What may be written, replaced and deleted: every file that this program leaves on disk or takes from it goes through here.
//!
//! - A file appears whole or not at all: it is written beside its place and moved there (`write_whole`).
//! - Only plain files that may be written to are replaced, and only plain files removed: no link, folder, pipe or device.
//! - What a graph is made of or reads is not replaced ([`Sources`]); nothing is written outside of the folder that was asked
//!   for, whatever links lead there ([`Destination`]).
//! - What a killed process left half written is swept, what a living one is writing stays (`temporary`).

use std::fs::{self, File, Metadata};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use maquette_graph::stamp::Stamp;
use maquette_syntax::paths::without_dots;
use maquette_value::plain;
use tempfile::NamedTempFile;

mod large;
mod log;
mod shelf;
mod sources;
mod spare;
mod temporary;
mod turn;

pub(crate) use large::{bring_to_disk, write_at};
pub use log::{begin_log, open_log, remove_logs};
pub use shelf::Shelf;
pub use sources::Sources;
pub(crate) use spare::Spare;
pub(crate) use temporary::{is_abandoned, is_temporary, sweep};
pub use turn::Turn;

/// Where files may be written and removed.
pub struct Destination<'a> {
    bounds: Bounds,
    sources: &'a Sources,
}

enum Bounds {
    /// Any path: one that the user named.
    None,
    /// Links may lead anywhere in this folder, but not out of it.
    Folder(PathBuf),
    /// The same, and the folder itself lies in another one.
    Inside { base: PathBuf, folder: PathBuf },
    /// There is no link on the way from this folder on.
    Own(PathBuf),
}

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    #[error("{0}")]
    Source(&'static str),
    #[error("a link leads out of {}", .0.display())]
    Outside(PathBuf),
    #[error("there is a link on the way from {}", .0.display())]
    Linked(PathBuf),
    #[error("it is {0}, and only plain files are replaced")]
    NotPlain(&'static str),
    #[error("it is read-only")]
    ReadOnly,
    #[error(transparent)]
    System(#[from] io::Error),
}

impl<'a> Destination<'a> {
    /// Any path: one that the user named.
    pub fn anywhere(sources: &'a Sources) -> Self {
        Self { bounds: Bounds::None, sources }
    }

    /// A folder that the user named, wherever links to it lead.
    pub fn folder(folder: &Path, sources: &'a Sources) -> Self {
        Self { bounds: Bounds::Folder(folder.to_owned()), sources }
    }

    /// A folder in another one, which no link may lead out of.
    pub fn inside(base: &Path, folder: &Path, sources: &'a Sources) -> Self {
        Self {
            bounds: Bounds::Inside { base: base.to_owned(), folder: folder.to_owned() },
            sources,
        }
    }

    /// Folders in this one that no link leads to.
    pub fn own(base: &Path, sources: &'a Sources) -> Self {
        Self { bounds: Bounds::Own(base.to_owned()), sources }
    }

    /// Puts these bytes into a file: whole or not at all. Gives its stamp, unless somebody else has changed it already. The first file that
    /// this process writes to a folder removes what killed processes left there.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<Option<Stamp>, Refused> {
        self.judge(path)?;
        temporary::sweep_once(beside(path));
        Ok(write_whole(path, bytes)?)
    }

    /// The same for so many bytes that `fill` writes, into a new file, or over one of which it is told what it holds; what it gives comes
    /// along.
    pub(crate) fn write_again<S, T>(
        &self,
        path: &Path,
        len: usize,
        last: Last<S>,
        fill: impl FnMut(&mut File, Option<&S>) -> io::Result<T>,
    ) -> Result<Rewritten<S, T>, Refused> {
        self.judge(path)?;
        Ok(write_by(path, len, last, fill)?)
    }

    /// Writes one file, and removes what killed processes left beside it.
    pub fn put(&self, path: &Path, bytes: &[u8]) -> Result<(), Refused> {
        self.judge(path)?;
        sweep(beside(path));
        Ok(write_whole(path, bytes).map(|_| ())?)
    }

    /// Writes some files, or none if one of them may not be written: then, which and why.
    pub fn put_all(&self, files: &[(PathBuf, Vec<u8>)]) -> Result<(), (PathBuf, Refused)> {
        let failed = |path: &PathBuf| {
            let path = path.clone();
            |refused| (path, refused)
        };
        files.iter().try_for_each(|(path, _)| self.judge(path).map_err(failed(path)))?;
        files.iter().try_for_each(|(path, bytes)| self.put(path, bytes).map_err(failed(path)))
    }

    /// Whether a file may be written.
    pub fn judge(&self, path: &Path) -> Result<(), Refused> {
        self.judge_folder(beside(path))?;
        match fs::symlink_metadata(path) {
            Ok(it) if !it.is_file() => return Err(Refused::NotPlain(kind(&it))),
            Ok(it) if it.permissions().readonly() => return Err(Refused::ReadOnly),
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        self.sources.use_of(path).map_or(Ok(()), |what| Err(Refused::Source(what)))
    }

    /// Removes a plain file.
    pub fn remove(&self, path: &Path) -> Result<(), Refused> {
        self.judge_folder(beside(path))?;
        Ok(remove(path)?)
    }

    /// Removes what killed processes left in a folder, if files may be written there.
    pub fn sweep(&self, folder: &Path) {
        if self.judge_folder(folder).is_ok() {
            sweep(folder);
        }
    }

    /// Whether files in a folder may be written.
    pub fn judge_folder(&self, folder: &Path) -> Result<(), Refused> {
        fn lies_in(inner: &Path, outer: &Path) -> Result<(), Refused> {
            match real(inner)?.starts_with(real(outer)?) {
                true => Ok(()),
                false => Err(Refused::Outside(outer.to_owned())),
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
                    false => Err(Refused::Linked(base.clone())),
                }
            }
        }
    }
}

/// The folder that a file is in.
fn beside(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// The path without links, also of what is not there yet. A link to nothing is an error: nobody knows what it will lead to.
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

/// Puts a new text into a file that people write: whole or not at all, with the permissions of the old one. A link that leads to
/// it stays one.
pub fn rewrite(path: &Path, text: &str) -> io::Result<()> {
    let path = fs::canonicalize(path)?;
    let metadata = fs::metadata(&path)?;
    if !metadata.is_file() || metadata.permissions().readonly() {
        return Err(io::ErrorKind::PermissionDenied.into());
    }
    sweep(beside(&path));
    write_whole(&path, text.as_bytes())?;
    fs::set_permissions(&path, metadata.permissions())
}

/// The same in place of what was read, and nothing if that is not there any more. Who has a [`Turn`] since then loses nothing that
/// this program writes, and no editor's work but by a hair.
pub fn replace(path: &Path, read: &str, text: &str) -> io::Result<()> {
    match plain::read_text(path)? == read {
        true => rewrite(path, text),
        false => Err(changed_meanwhile()),
    }
}

fn changed_meanwhile() -> io::Error {
    io::Error::other("somebody else is changing it: try again")
}

/// The same, with another file that is not there yet and belongs to it: both are written, or none. An error comes with the file that it
/// is of.
pub fn rewrite_with(
    path: &Path,
    text: &str,
    (new, new_text): (&Path, &str),
) -> Result<(), (PathBuf, io::Error)> {
    let of = |path: &Path| {
        let path = path.to_owned();
        |error| (path, error)
    };
    let metadata = fs::metadata(path).map_err(of(path))?;
    if !metadata.is_file() || metadata.permissions().readonly() {
        return Err((path.to_owned(), io::ErrorKind::PermissionDenied.into()));
    }
    write_new(new, new_text).map_err(of(new))?;
    rewrite(path, text).map_err(|error| {
        // Nobody has read it yet.
        let _ = remove(new);
        (path.to_owned(), error)
    })
}

/// Writes a text to a file that is not there yet, and makes the folders above it.
pub fn write_new(path: &Path, text: &str) -> io::Result<()> {
    let folder = beside(path);
    fs::create_dir_all(folder)?;
    sweep(folder);
    let mut file = temporary::create(folder)?;
    file.write_all(text.as_bytes())?;
    file.persist_noclobber(path).map_err(|error| error.error)?;
    Ok(())
}

/// Writes what the program itself keeps beside a graph, in a file that people read and may have changed.
pub fn keep_beside(path: &Path, text: &str) -> Result<(), Refused> {
    match path.exists() {
        true => Ok(rewrite(path, text)?),
        false => Destination::anywhere(&Sources::default()).put(path, text.as_bytes()),
    }
}

/// Writes a file beside its place and moves it there: it appears whole or not at all. Gives the stamp of what was moved, unless
/// somebody else has changed that already.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<Option<Stamp>> {
    write_parts(path, &[bytes])
}

/// Writes a file that nobody but its user may read, in a folder of the same kind, which is made if it is not there.
pub fn write_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let folder = beside(path);
    make_private_folder(folder)?;
    sweep(folder);
    let mut file = temporary::create_private(folder)?;
    file.write_all(bytes)?;
    file.persist(path).map(|_| ()).map_err(|error| error.error)
}

/// Makes a folder of which others see nothing. One that is there and that others may write to is refused: they could put their
/// own files into the place of the user's.
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

/// Whether a file or folder is this user's, and others have none of these permissions. Where there are no such permissions the
/// system keeps a user's folders from others.
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

/// The same for a content in parts.
pub(crate) fn write_parts(path: &Path, parts: &[&[u8]]) -> io::Result<Option<Stamp>> {
    let len = parts.iter().map(|part| part.len()).sum();
    let fill =
        |file: &mut File, _: Option<&()>| parts.iter().try_for_each(|part| file.write_all(part));
    write_by(path, len, Last::default(), fill).map(|written| written.stamp)
}

/// What this process left where a file is written again.
pub(crate) struct Last<S> {
    /// The file that lies there, and what it holds, if it is to be kept for the next time.
    pub(crate) there: Option<(Stamp, S)>,
    /// One from before, to be written over.
    pub(crate) spare: Option<Spare<S>>,
}

impl<S> Default for Last<S> {
    fn default() -> Self {
        Self { there: None, spare: None }
    }
}

/// A file that was written.
pub(crate) struct Rewritten<S, T> {
    /// Its stamp, unless somebody else has changed it already.
    pub(crate) stamp: Option<Stamp>,
    /// What came of writing it.
    pub(crate) told: T,
    /// The one that it replaced.
    pub(crate) spare: Option<Spare<S>>,
}

/// The same for so many bytes that `fill` writes, which is asked again if the file has gone meanwhile.
fn write_by<S, T>(
    path: &Path,
    len: usize,
    last: Last<S>,
    mut fill: impl FnMut(&mut File, Option<&S>) -> io::Result<T>,
) -> io::Result<Rewritten<S, T>> {
    let folder = beside(path);
    let Last { mut there, mut spare } = last;
    in_spite_of_removal(|is_gone| {
        if is_gone {
            fs::create_dir_all(folder)?;
        }
        let (mut file, holds) = match spare.take().and_then(Spare::reuse) {
            Some((file, holds)) => (file, Some(holds)),
            None => (temporary::create(folder)?, None),
        };
        match holds {
            Some(_) => file.as_file().set_len(len as u64)?,
            None => large::make_room(file.as_file(), len),
        }
        let told = fill(file.as_file_mut(), holds.as_ref())?;
        large::mark(file.as_file(), len)?;
        let written = file.as_file().metadata()?;
        // Still locked while it is moved.
        let (file, spare) = match there.take() {
            Some((stamp, holds)) => match Spare::exchange(file, path, stamp, holds) {
                Ok(moved) => moved,
                Err(file) => (persist(file, path, len)?, None),
            },
            None => (persist(file, path, len)?, None),
        };
        Ok(Rewritten { stamp: Stamp::moved(&written, &file.metadata()?), told, spare })
    })
}

/// Moves a file of so many bytes to its place.
fn persist(file: NamedTempFile, path: &Path, len: usize) -> io::Result<File> {
    let old = large::Old::at(path, len);
    let file = file.persist(path).map_err(|error| error.error)?;
    old.forget();
    Ok(file)
}

/// Does it again if a file or folder has gone meanwhile, which `does` is told: somebody may clear the cache, or sweep a folder,
/// between any two steps. Who finds it gone a hundred times has another problem.
pub(crate) fn in_spite_of_removal<T>(mut does: impl FnMut(bool) -> io::Result<T>) -> io::Result<T> {
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

/// A folder that goes while it is made was there already, and then is none.
fn is_gone(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::AlreadyExists)
}

/// Whether files can be written to a folder, or to the nearest one above it if it is not there.
pub fn is_writable(folder: &Path) -> bool {
    let there = folder.ancestors().find(|folder| fs::symlink_metadata(folder).is_ok());
    temporary::create(there.unwrap_or(Path::new("."))).is_ok()
}

/// Makes a folder and those above it.
pub fn make_folder(path: &Path) -> io::Result<()> {
    fs::create_dir_all(path)
}

/// Removes a plain file; never what a link leads to, nor the link.
pub fn remove(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path)? {
        it if it.is_file() => fs::remove_file(path),
        it => Err(io::Error::other(format!("it is {}", kind(&it)))),
    }
}

/// Removes a folder if nothing is in it.
pub fn remove_empty(folder: &Path) {
    let _ = fs::remove_dir(folder);
}

/// Says that a file was used: its time of change is now.
pub(crate) fn touch(path: &Path) {
    let file = File::options().append(true).open(path);
    // A file that another process has just removed needs no time.
    let _ = file.and_then(|file| file.set_modified(SystemTime::now()));
}

#[cfg(test)]
mod tests;
