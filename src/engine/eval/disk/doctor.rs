//! Looks at every file of a cache, of all programs, and removes what is not as it was written. What is removed is computed again.

use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};

use maquette_value::Hash;
use maquette_value::parallel::*;
use maquette_value::plain;

use super::folder::{self, Found, What, contents};
use super::seal::unsealed;
use super::{Disk, DiskError, entry, program};
use crate::writing::{is_abandoned, remove};

/// What is wrong with a cache folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Diagnosis {
    /// How many files were looked at.
    pub files: usize,
    /// All of them together.
    pub bytes: u64,
    /// What was found, in the order of the paths.
    pub faults: Vec<Fault>,
    /// What is not ours, and was left alone.
    pub foreign: Vec<PathBuf>,
}

/// Something wrong with a cache folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, in words.
    pub what: &'static str,
    /// Whether it was mended: the file is gone, or written anew.
    pub mended: bool,
}

const DAMAGED: &str = "its content is not what was written";
const MOVED: &str = "it is not of this name";
const INCOMPLETE: &str = "a column that it names is gone or damaged";
const UNUSED: &str = "no result names it";
const LEFT: &str = "a process that was killed left it half written";
const NO_TAG: &str = "the tag is not as it was written";
const OTHER_PROGRAM: &str = "it names another program";

/// What an entry says, as far as it matters here.
enum Entry {
    /// The columns that it names, and how many items each has.
    Whole(Vec<(Hash, u64)>),
    Faulty(&'static str),
    /// Another program wrote it in its own way.
    Unknown,
    /// Another process has just removed it.
    Gone,
}

impl Disk {
    /// Looks at every file of a cache folder, of all programs, and removes those that nobody could use: what is damaged, what names
    /// something that is gone, what nothing names. Only tells what it would do in a dry run.
    ///
    /// # Errors
    /// If the folder is not a cache of ours.
    pub fn doctor(folder: &Path, dry_run: bool) -> Result<Diagnosis, DiskError> {
        folder::check(folder)?;
        let contents = contents(folder);
        let mut faults = Vec::new();
        for home in &contents.homes {
            let files = contents.files.iter().filter(|found| found.path.starts_with(home));
            faults.extend(faults_of_program(&Vec::from_iter(files)));
        }
        let others = contents.files.par_iter().filter_map(|found| match found.what {
            What::Program => Some((&*found.path, fault_of_memo(folder, &found.path)?)),
            What::Temporary => is_abandoned(&found.path).then_some((&*found.path, LEFT)),
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
                Fault { path: path.to_owned(), what, mended }
            })
            .collect();
        if folder.exists() && !folder::is_tagged(folder) {
            let (path, what) = (folder.join(folder::TAG), NO_TAG);
            let mended = !dry_run && folder::tag(folder).is_ok();
            faults.push(Fault { path, what, mended });
        }
        faults.sort_by(|a, b| a.path.cmp(&b.path));
        let bytes = contents.files.iter().map(|found| found.bytes).sum();
        Ok(Diagnosis { files: contents.files.len(), bytes, faults, foreign: contents.foreign })
    }
}

/// What is wrong with the files of one program.
fn faults_of_program<'f>(files: &[&'f Found]) -> Vec<(&'f Path, &'static str)> {
    let of = |what: &'static str| {
        let files = files.iter().filter(move |found| found.what == What::Kept(what));
        files.map(|found| &*found.path).collect::<Vec<_>>()
    };
    let entries: Vec<_> =
        of("entries").into_par_iter().map(|path| (path, entry_at(path))).collect();
    let all_known = entries.iter().all(|(_, entry)| !matches!(entry, Entry::Unknown));
    let lengths: HashMap<Hash, u64> =
        entries.iter().flat_map(|(_, entry)| entry.columns()).collect();
    let columns: Vec<_> = of("columns")
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
            _ if all_known && !named.contains(&hash) => faults.push((path, UNUSED)),
            _ => {}
        }
    }
    let notes = [of("graphs"), of("outputs")].concat();
    let damaged = notes.into_par_iter().filter(|path| match plain::read_own(path) {
        Ok(bytes) => unsealed(path, bytes).is_none(),
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
    let bytes = match plain::read_own(path) {
        Ok(bytes) => unsealed(path, bytes),
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

/// Whether a file holds the column of this hash.
fn is_column(path: &Path, hash: Hash, items: u64) -> bool {
    fn hashed(items: u64, path: &Path) -> Result<Hash, io::Error> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&items.to_le_bytes()).update_reader(plain::open_own(path)?)?;
        io::Result::Ok(Hash(*hasher.finalize().as_bytes()))
    }
    hashed(items, path).is_ok_and(|found| found == hash)
}

/// What is wrong with a file that remembers a program.
fn fault_of_memo(folder: &Path, memo: &Path) -> Option<&'static str> {
    let remembered = plain::read_own(memo).ok().and_then(|bytes| program::remembered(memo, bytes));
    let Some(remembered) = remembered else { return Some(DAMAGED) };
    // Of the other programs nobody knows where they are.
    program::is_wrong(folder, memo, &remembered).then_some(OTHER_PROGRAM)
}

fn name_of(path: &Path) -> Option<Hash> {
    Hash::parse(path.file_name()?.to_str()?)
}
