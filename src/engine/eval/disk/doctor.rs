//! Checks every file in a cache folder, for all builds of the program, and removes damaged and useless files. Removed results are computed
//! again when they are needed.

use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};

use maquette_value::Hash;
use maquette_value::fs;
use maquette_value::parallel::*;

use super::folder::{self, CacheFile, FileKind, contents};
use super::seal::unseal;
use super::{Disk, DiskError, entry, program};
use crate::writing::{is_abandoned, remove};

/// The result of checking a cache folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Diagnosis {
    /// The number of files checked.
    pub files: usize,
    /// The size of all files, in bytes.
    pub bytes: u64,
    /// The faults that were found, sorted by path.
    pub faults: Vec<CacheFault>,
    /// Files and folders in the cache folder that are not part of the cache. The check does not change them.
    pub foreign: Vec<PathBuf>,
}

/// A damaged or useless file of a cache folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CacheFault {
    /// The path of the faulty file.
    pub path: PathBuf,
    /// A description of the fault.
    pub description: &'static str,
    /// True if the fault was repaired: the file was removed or rewritten.
    pub is_repaired: bool,
}

const DAMAGED: &str = "its content is not what was written";
const MOVED: &str = "it is not of this name";
const INCOMPLETE: &str = "a column that it names is gone or damaged";
const UNUSED: &str = "no result names it";
const LEFT: &str = "a process that was killed left it half written";
const NO_TAG: &str = "the tag is not as it was written";
const OTHER_PROGRAM: &str = "it names another program";

/// The columns that an entry refers to, or the reason why they are unknown.
enum Entry {
    /// An undamaged entry. Each column to which it refers is given by its hash and its number of items.
    Whole(Vec<(Hash, u64)>),
    Faulty(&'static str),
    /// The entry has the format of another version of the program, so its columns are unknown.
    Unknown,
    /// Another process has just removed the entry.
    Gone,
}

impl Disk {
    /// Checks every file in a cache folder, for all builds. Removes damaged files, entries whose columns are missing, and columns that no
    /// entry uses. In a dry run, nothing is removed and the faults are only reported.
    ///
    /// # Errors
    /// If the folder is not a cache of this program.
    pub fn doctor(folder: &Path, dry_run: bool) -> Result<Diagnosis, DiskError> {
        folder::check(folder)?;
        let contents = contents(folder);
        let mut faults = Vec::new();
        for home in &contents.homes {
            let files = contents.files.iter().filter(|found| found.path.starts_with(home));
            faults.extend(program_faults(&Vec::from_iter(files)));
        }
        let others = contents.files.par_iter().filter_map(|found| match found.kind {
            FileKind::Program => Some((&*found.path, memo_fault(folder, &found.path)?)),
            FileKind::Temporary => is_abandoned(&found.path).then_some((&*found.path, LEFT)),
            _ => None,
        });
        faults.extend(others.collect::<Vec<_>>());
        let mut faults: Vec<_> = faults
            .into_iter()
            .map(|(path, what): (&Path, _)| {
                let mended = !dry_run
                    && remove(path).map_or_else(
                        |error: io::Error| error.kind() == io::ErrorKind::NotFound,
                        |()| true,
                    );
                CacheFault { path: path.to_owned(), description: what, is_repaired: mended }
            })
            .collect();
        if folder.exists() && !folder::is_tagged(folder) {
            let (path, what) = (folder.join(folder::TAG), NO_TAG);
            let mended = !dry_run && folder::tag(folder).is_ok();
            faults.push(CacheFault { path, description: what, is_repaired: mended });
        }
        faults.sort_by(|a, b| a.path.cmp(&b.path));
        let bytes = contents.files.iter().map(|found| found.bytes).sum();
        Ok(Diagnosis { files: contents.files.len(), bytes, faults, foreign: contents.foreign })
    }
}

/// Returns the paths of those files that are in the subfolder `folder` of a build.
fn paths_in<'f>(files: &[&'f CacheFile], folder: &'static str) -> Vec<&'f Path> {
    let files = files.iter().filter(|file| file.kind == FileKind::Stored(folder));
    files.map(|file| &*file.path).collect()
}

/// Returns the faults of the files that one build of the program has stored.
fn program_faults<'f>(files: &[&'f CacheFile]) -> Vec<(&'f Path, &'static str)> {
    let entries: Vec<_> =
        paths_in(files, "entries").into_par_iter().map(|path| (path, entry_at(path))).collect();
    let are_all_known = entries.iter().all(|(_, entry)| !matches!(entry, Entry::Unknown));
    let lengths: HashMap<Hash, u64> =
        entries.iter().flat_map(|(_, entry)| entry.columns()).collect();
    let columns: Vec<_> = paths_in(files, "columns")
        .into_par_iter()
        .filter_map(|path| Some((path, name_of(path)?)))
        .map(|(path, hash)| {
            (path, hash, lengths.get(&hash).map(|&items| is_column(path, hash, items)))
        })
        .collect();
    let whole: HashSet<Hash> = columns
        .iter()
        .filter(|(_, _, whole)| *whole == Some(true))
        .map(|(_, hash, _)| *hash)
        .collect();
    let (mut faults, mut named) = (Vec::new(), HashSet::new());
    for (path, entry) in &entries {
        match entry {
            Entry::Faulty(what) => faults.push((*path, *what)),
            entry if entry.columns().any(|(hash, _)| !whole.contains(&hash)) => {
                faults.push((*path, INCOMPLETE));
            }
            entry => named.extend(entry.columns().map(|(hash, _)| hash)),
        }
    }
    for (path, hash, is_whole) in columns {
        match is_whole {
            Some(false) => faults.push((path, DAMAGED)),
            _ if are_all_known && !named.contains(&hash) => faults.push((path, UNUSED)),
            _ => {}
        }
    }
    let notes = [paths_in(files, "graphs"), paths_in(files, "outputs")].concat();
    let damaged = notes.into_par_iter().filter(|path| match fs::read_no_follow(path) {
        Ok(bytes) => unseal(path, bytes).is_none(),
        Err(error) => error.kind() != io::ErrorKind::NotFound,
    });
    faults.extend(damaged.map(|path| (path, DAMAGED)).collect::<Vec<_>>());
    faults
}

impl Entry {
    fn columns(&self) -> impl Iterator<Item = (Hash, u64)> {
        let columns = if let Self::Whole(columns) = self { &columns[..] } else { &[] };
        columns.iter().copied()
    }
}

fn entry_at(path: &Path) -> Entry {
    let bytes = match fs::read_no_follow(path) {
        Ok(bytes) => unseal(path, bytes),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Entry::Gone,
        Err(_) => None,
    };
    let (Some(bytes), Some(key)) = (bytes, name_of(path)) else { return Entry::Faulty(DAMAGED) };
    match entry::columns(&bytes, key) {
        Some(Some(columns)) => Entry::Whole(columns),
        Some(None) => Entry::Faulty(MOVED),
        None => Entry::Unknown,
    }
}

/// Returns true if the file contains a column of `items` items with this hash.
fn is_column(path: &Path, hash: Hash, items: u64) -> bool {
    fn column_hash(items: u64, path: &Path) -> Result<Hash, io::Error> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&items.to_le_bytes()).update_reader(fs::open_no_follow(path)?)?;
        io::Result::Ok(Hash(*hasher.finalize().as_bytes()))
    }
    column_hash(items, path).is_ok_and(|found| found == hash)
}

/// Returns the fault of a memo: a file that stores the hash of an executable or library. Returns `None` if the memo is right.
fn memo_fault(folder: &Path, memo: &Path) -> Option<&'static str> {
    let remembered =
        fs::read_no_follow(memo).ok().and_then(|bytes| program::read_memo(memo, bytes));
    let Some(remembered) = remembered else { return Some(DAMAGED) };
    // Only the memo of the running code can be compared, because the executables of other programs are unknown.
    program::is_outdated(folder, memo, &remembered).then_some(OTHER_PROGRAM)
}

fn name_of(path: &Path) -> Option<Hash> {
    Hash::parse(path.file_name()?.to_str()?)
}
