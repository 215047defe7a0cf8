//! The cache folder: checks its owner, and decides which files in it belong to the cache. Symbolic links, and files whose names the cache
//! does not use, do not belong to it.

use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use maquette_value::Hash;

use super::{DiskError, FOLDERS, program};
use crate::writing::{is_temporary, make_folder, write_whole};

/// The file that marks the folder as a cache, for backup programs (bford.info/cachedir) and for this program.
pub(super) const TAG: &str = "CACHEDIR.TAG";
const TAG_TEXT: &str =
    "Signature: 8a477f597d28d172789f06886806bc55\n# Results that maquette can compute again.\n";

/// The subfolder that stores the hashes of executables and libraries.
pub(super) const PROGRAMS: &str = "programs";

/// The name of an empty file in [`PROGRAMS`]. Its modification time is the time of the last cleanup of the cache.
pub(super) const TIDIED: &str = "tidied";

/// The kind of a file in the cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FileKind {
    /// A file in the given subfolder of a build; the subfolder is one of [`FOLDERS`].
    Stored(&'static str),
    Program,
    Tidied,
    /// A file that is being written, or that a process left unfinished.
    Temporary,
}

/// A file of the cache, with its kind and metadata.
#[derive(Clone, Debug)]
pub(super) struct CacheFile {
    pub(super) path: PathBuf,
    pub(super) kind: FileKind,
    pub(super) last_use: SystemTime,
    pub(super) bytes: u64,
}

/// The files and folders in a cache folder.
#[derive(Default)]
pub(super) struct Contents {
    pub(super) files: Vec<CacheFile>,
    /// The folders of builds of the program that have stored results.
    pub(super) homes: Vec<PathBuf>,
    /// Files and folders in the cache folder that are not part of the cache.
    pub(super) foreign: Vec<PathBuf>,
}

/// Turns a missing or empty folder into a cache. If the folder is already a cache, checks that it belongs to this user.
pub(super) fn claim(folder: &Path) -> Result<(), DiskError> {
    make_folder(folder).map_err(|error| DiskError::system(folder, error))?;
    check(folder)?;
    if is_tagged(folder) {
        return Ok(());
    }
    tag(folder).map_err(|error| DiskError::system(folder, error))
}

/// Writes the tag that marks a folder as a cache.
pub(super) fn tag(folder: &Path) -> io::Result<()> {
    write_whole(&folder.join(TAG), TAG_TEXT.as_bytes()).map(|_| ())
}

/// Returns true if the folder has the tag file that marks a cache.
pub(super) fn is_tagged(folder: &Path) -> bool {
    maquette_value::fs::read_no_follow(&folder.join(TAG))
        .is_ok_and(|text| text == TAG_TEXT.as_bytes())
}

/// Checks that a folder is a cache, or is missing or empty and so can become one.
pub(super) fn check(folder: &Path) -> Result<(), DiskError> {
    if !folder.exists() {
        return Ok(());
    }
    if !is_mine(folder).map_err(|error| DiskError::system(folder, error))? {
        return Err(DiskError::OtherUser(folder.to_owned()));
    }
    let may_be_ours = is_tagged(folder) || is_empty(folder) || looks_ours(folder);
    // Look for the tag again, because another process may have written it in the meantime.
    if may_be_ours || is_tagged(folder) {
        Ok(())
    } else {
        Err(DiskError::Foreign(folder.to_owned()))
    }
}

#[cfg(unix)]
fn is_mine(folder: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    Ok(fs::metadata(folder)?.uid() == rustix::process::geteuid().as_raw())
}

#[cfg(not(unix))]
fn is_mine(_: &Path) -> io::Result<bool> {
    Ok(true)
}

fn is_empty(folder: &Path) -> bool {
    list(folder).all(|entry| is_temporary(&entry.path()))
}

/// Returns true if a folder without a tag file is certainly a cache: all its files have names that the cache uses, and some of these names
/// are used by nothing else.
fn looks_ours(folder: &Path) -> bool {
    let contents = contents(folder);
    let is_known = contents.homes.iter().any(|home| home.join(FOLDERS[0]).is_dir())
        || contents.files.iter().any(|found| {
            found.kind == FileKind::Program
                && maquette_value::fs::read_no_follow(&found.path)
                    .is_ok_and(|bytes| program::read_memo(&found.path, bytes).is_some())
        });
    contents.foreign.is_empty() && is_known
}

/// Returns true if a text is the fingerprint of a build: 32 hexadecimal digits, letters in lower case.
pub(super) fn is_fingerprint(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// Lists the contents of a cache folder.
pub(super) fn contents(folder: &Path) -> Contents {
    let mut contents = Contents::default();
    for entry in list(folder) {
        let (name, path) = (name_of(&entry), entry.path());
        match is_folder(&entry) {
            true if name == PROGRAMS => contents.add_all(&path, |name| match name {
                TIDIED => Some(FileKind::Tidied),
                name => is_hash(name).then_some(FileKind::Program),
            }),
            true if is_fingerprint(&name) => contents.add_home(path),
            false if name == TAG && maquette_value::fs::is_regular_file(&path) => {}
            false if is_temporary(&path) => contents.add(&entry, Some(FileKind::Temporary)),
            _ => contents.foreign.push(path),
        }
    }
    contents.foreign.sort();
    contents
}

impl Contents {
    /// Adds the files in the folder of one build.
    fn add_home(&mut self, home: PathBuf) {
        for entry in list(&home) {
            let name = name_of(&entry);
            match FOLDERS.into_iter().find(|folder| *folder == name && is_folder(&entry)) {
                Some(folder) => {
                    self.add_all(&entry.path(), |name| {
                        is_hash(name).then_some(FileKind::Stored(folder))
                    });
                }
                None => self.foreign.push(entry.path()),
            }
        }
        self.homes.push(home);
    }

    /// Adds the files of a folder. `kind_of` returns the kind of file for a name, or `None` if the cache does not use that name.
    fn add_all(&mut self, folder: &Path, kind_of: impl Fn(&str) -> Option<FileKind>) {
        for entry in list(folder) {
            let temporary = is_temporary(&entry.path()).then_some(FileKind::Temporary);
            self.add(&entry, kind_of(&name_of(&entry)).or(temporary));
        }
    }

    fn add(&mut self, entry: &DirEntry, kind: Option<FileKind>) {
        let path = entry.path();
        // `DirEntry::metadata` does not follow a link, so a link is not a plain file here.
        match entry.metadata() {
            Ok(metadata) if metadata.is_file() && kind.is_some() => {
                let used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                let bytes = metadata.len();
                self.files.extend(kind.map(|kind| CacheFile { path, kind, last_use: used, bytes }));
            }
            // Another process has just removed the file. Ignore it.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            _ => self.foreign.push(path),
        }
    }
}

fn list(folder: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    fs::read_dir(folder).into_iter().flatten().flatten()
}

fn name_of(entry: &DirEntry) -> String {
    entry.file_name().to_string_lossy().into_owned()
}

fn is_folder(entry: &DirEntry) -> bool {
    entry.file_type().is_ok_and(|kind| kind.is_dir())
}

/// Returns true if a file name is a hash, written as the cache writes hashes.
fn is_hash(name: &str) -> bool {
    Hash::parse(name).is_some_and(|hash| hash.to_string() == name)
}
