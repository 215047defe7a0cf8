//! The folder of a cache: whose it is, and which files in it are ours. What has another name, or is a link, is somebody's.

use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use maquette_value::Hash;
use maquette_value::plain;

use super::{DiskError, FOLDERS, program};
use crate::writing::{is_temporary, make_folder, write_whole};

/// The file that tells backup programs to leave a folder out (bford.info/cachedir), and us that it is ours.
pub(super) const TAG: &str = "CACHEDIR.TAG";
const TAG_TEXT: &str =
    "Signature: 8a477f597d28d172789f06886806bc55\n# Results that maquette can compute again.\n";

/// The folder of what is known of programs.
pub(super) const PROGRAMS: &str = "programs";

/// Its file whose time of change says when the cache was last tidied.
pub(super) const TIDIED: &str = "tidied";

/// What a file of the cache is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum What {
    /// In one of the [`FOLDERS`] of a program.
    Kept(&'static str),
    Program,
    Tidied,
    /// It is being written, or was.
    Temporary,
}

/// A file of ours.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) path: PathBuf,
    pub(super) what: What,
    pub(super) used: SystemTime,
    pub(super) bytes: u64,
}

/// Everything in a cache folder.
#[derive(Default)]
pub(super) struct Contents {
    pub(super) files: Vec<Found>,
    /// The folders of programs.
    pub(super) homes: Vec<PathBuf>,
    /// What is not ours.
    pub(super) foreign: Vec<PathBuf>,
}

/// Makes a folder a cache if it is none: one that is not there, or empty.
pub(super) fn claim(folder: &Path) -> Result<(), DiskError> {
    let failed = |error| DiskError::System { folder: folder.to_owned(), error };
    make_folder(folder).map_err(failed)?;
    check(folder)?;
    if is_tagged(folder) { Ok(()) } else { tag(folder).map_err(failed) }
}

/// Marks the folder as ours.
pub(super) fn tag(folder: &Path) -> io::Result<()> {
    write_whole(&folder.join(TAG), TAG_TEXT.as_bytes()).map(|_| ())
}

/// Whether the folder says that it is ours.
pub(super) fn is_tagged(folder: &Path) -> bool {
    plain::read_own(&folder.join(TAG)).is_ok_and(|text| text == TAG_TEXT.as_bytes())
}

/// Whether a folder is a cache of ours, or may become one.
pub(super) fn check(folder: &Path) -> Result<(), DiskError> {
    if !folder.exists() {
        return Ok(());
    }
    if !is_mine(folder).map_err(|error| DiskError::System { folder: folder.to_owned(), error })? {
        return Err(DiskError::OtherUser(folder.to_owned()));
    }
    let may_be_ours = is_tagged(folder) || is_empty(folder) || looks_ours(folder);
    // Another process may have marked it meanwhile.
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

/// Whether a folder without its tag can be nothing else: all that it holds is ours, and some of it could not be anything else.
fn looks_ours(folder: &Path) -> bool {
    let contents = contents(folder);
    let is_known = contents.homes.iter().any(|home| home.join(FOLDERS[0]).is_dir())
        || contents.files.iter().any(|found| {
            found.what == What::Program
                && plain::read_own(&found.path)
                    .is_ok_and(|bytes| program::remembered(&found.path, bytes).is_some())
        });
    contents.foreign.is_empty() && is_known
}

/// Whether a text is a fingerprint: 32 hexadecimal digits.
pub(super) fn is_fingerprint(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// Everything in the folder of a cache.
pub(super) fn contents(folder: &Path) -> Contents {
    let mut contents = Contents::default();
    for entry in list(folder) {
        let (name, path) = (name_of(&entry), entry.path());
        match is_folder(&entry) {
            true if name == PROGRAMS => contents.add_all(&path, |name| match name {
                TIDIED => Some(What::Tidied),
                name => is_hash(name).then_some(What::Program),
            }),
            true if is_fingerprint(&name) => contents.add_home(path),
            false if name == TAG && plain::is_own(&path) => {}
            false if is_temporary(&path) => contents.add(&entry, Some(What::Temporary)),
            _ => contents.foreign.push(path),
        }
    }
    contents.foreign.sort();
    contents
}

impl Contents {
    /// The folder of a program.
    fn add_home(&mut self, home: PathBuf) {
        for entry in list(&home) {
            let name = name_of(&entry);
            match FOLDERS.into_iter().find(|folder| *folder == name && is_folder(&entry)) {
                Some(folder) => {
                    self.add_all(&entry.path(), |name| is_hash(name).then_some(What::Kept(folder)));
                }
                None => self.foreign.push(entry.path()),
            }
        }
        self.homes.push(home);
    }

    /// The files of a folder in which these names are ours.
    fn add_all(&mut self, folder: &Path, what: impl Fn(&str) -> Option<What>) {
        for entry in list(folder) {
            let temporary = is_temporary(&entry.path()).then_some(What::Temporary);
            self.add(&entry, what(&name_of(&entry)).or(temporary));
        }
    }

    fn add(&mut self, entry: &DirEntry, what: Option<What>) {
        let path = entry.path();
        // Of a link, this is about the link.
        match entry.metadata() {
            Ok(metadata) if metadata.is_file() && what.is_some() => {
                let used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                let bytes = metadata.len();
                self.files.extend(what.map(|what| Found { path, what, used, bytes }));
            }
            // It has just gone.
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

/// Whether a name is a hash as we write it.
fn is_hash(name: &str) -> bool {
    Hash::parse(name).is_some_and(|hash| hash.to_string() == name)
}
