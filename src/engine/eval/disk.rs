//! Results on disk, from one process to the next. The fingerprint of a folder is that of a build: see [`program`].
//!
//! ```text
//! CACHE/CACHEDIR.TAG
//! CACHE/programs/STAMP                the hash of a file of code, of that stamp
//! CACHE/FINGERPRINT/entries/KEY       what a node gave: its outputs, without their large columns
//! CACHE/FINGERPRINT/columns/HASH      a large column
//! CACHE/FINGERPRINT/graphs/HASH       what the last evaluation of the graph at the path of that hash found
//! CACHE/FINGERPRINT/outputs/HASH      which files are in the folder of outputs at the path of that hash
//! ```
//!
//! Every file appears whole or not at all, ends with a checksum of its name and content (a column's is its name), and is believed
//! only if that fits: what is torn, flipped or of another name is removed and computed again. So any number of processes may share
//! a folder without a lock. A file's time of change is the time of its last use; [`gc`](Disk::gc) drops the files that were not
//! used for longest, [`doctor`](Disk::doctor) looks at all of them. Whatever has no name of ours stays: see [`folder`].
//!
//! Entries and columns, which are named by what they are made of, may be shared with other machines: see `remote`.
//!
//! A large column is read straight into its buffer.

use std::collections::HashMap;
use std::fmt;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use maquette_graph::catalog::Catalog;
use maquette_graph::files::KnownFile;
use maquette_value::plain;
use maquette_value::{Bytes, Columns, Hash, ValueType};

use super::cache::{Outcome, Values};
use super::snapshot::Snapshot;
use crate::writing::{in_spite_of_removal, make_folder, remove, touch, write_parts};

mod doctor;
mod entry;
mod folder;
mod program;
mod record;
mod seal;
mod share;
mod usage;
mod writer;

pub use doctor::{Diagnosis, Fault};
use entry::Entry;
use maquette_remote::Remote;
pub use program::this_is_a_program;
use seal::{seal, unsealed};
pub use usage::{NodeSize, Sizes, Usage};
use writer::{Job, Writer};

/// Results on disk, for one program.
pub struct Disk {
    store: Arc<Store>,
    writer: Writer,
}

/// The disk cache cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DiskError {
    /// The folder is somebody's.
    #[error("{} is no cache of maquette: it is not empty and has no {} of ours", .0.display(), folder::TAG)]
    Foreign(PathBuf),
    /// What others wrote is not believed.
    #[error("the cache {} belongs to another user", .0.display())]
    OtherUser(PathBuf),
    /// Files that should go stay.
    #[error("cannot remove {count} of the files in the cache {}: {error}", .folder.display())]
    Kept {
        /// The folder.
        folder: PathBuf,
        /// The number of files.
        count: usize,
        /// Why the first one stays.
        error: io::Error,
    },
    /// The system says why.
    #[error("the cache {} cannot be used: {error}", .folder.display())]
    System {
        /// The folder.
        folder: PathBuf,
        /// Why.
        error: io::Error,
    },
}

/// The folders, and what happened to them.
struct Store {
    /// The folder of all programs' results.
    folder: PathBuf,
    /// That of this program's.
    home: PathBuf,
    limit: u64,
    types: HashMap<&'static str, &'static ValueType>,
    /// The first error of a write; no more are tried after it.
    trouble: OnceLock<String>,
    written: AtomicU64,
    /// Where other machines have results.
    remote: OnceLock<Remote>,
}

/// The folders of a program.
const FOLDERS: [&str; 4] = ["entries", "columns", "graphs", "outputs"];

/// Entries of one process that are kept however little work they were; later ones must have taken longer.
const CHEAP_ENTRIES: usize = 1000;

/// What later entries must have taken, in seconds.
pub(super) const WORTH_A_FILE: f64 = 1e-3;

/// Results below this many bytes are read back at once.
const SMALL: usize = 8 << 20;

/// Bytes a second that are read back from a file that the system holds in memory.
const READ_SPEED: f64 = 1.5e9;

impl Disk {
    /// Results of the running program in this folder, which is made if it is not there, of at most `limit` bytes.
    ///
    /// # Errors
    /// If the folder cannot be made and is not there, or is not ours, or the program cannot be identified.
    pub fn open(folder: &Path, limit: u64, catalog: &Catalog) -> Result<Self, DiskError> {
        folder::claim(folder)?;
        let fail = |error| DiskError::System { folder: folder.to_owned(), error };
        let fingerprint = program::fingerprint(folder, catalog).map_err(fail)?;
        let store =
            Store::open(folder, &fingerprint, limit, catalog.value_types()).map_err(fail)?;
        let store = Arc::new(store);
        Ok(Self { writer: Writer::new(store.clone()), store })
    }

    /// The id of the program's build, which no other build has.
    pub(crate) fn program(&self) -> String {
        let name = self.store.home.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Why results cannot be kept, if that is so: the disk is full, or the folder may not be written to.
    pub fn trouble(&self) -> Option<&str> {
        self.store.trouble.get().map(String::as_str)
    }

    /// Waits until everything is written, and a second more for what a [server](Self::sharing) is to be sent; drops what was not used
    /// for longest if there is too much.
    pub fn finish(&self) {
        self.writer.wait();
        self.store.remote.get().into_iter().for_each(Remote::finish);
        self.store.tidy();
    }

    /// Whether there is an entry of this key; it may still turn out to be damaged.
    pub(super) fn has(&self, key: Hash) -> bool {
        self.store.entry_path(key).exists()
    }

    /// Returns true if there is a whole entry of this key, and a file for each of its columns.
    pub(super) fn holds(&self, key: Hash) -> bool {
        let path = self.store.entry_path(key);
        let bytes = plain::read_own(&path).ok().and_then(|bytes| unsealed(&path, bytes));
        let columns = bytes.and_then(|bytes| entry::columns(&bytes, key).flatten());
        columns.is_some_and(|columns| {
            columns.iter().all(|(column, _)| self.store.column_path(*column).exists())
        })
    }

    /// What is known of a result.
    pub(super) fn find(&self, key: Hash) -> Option<Outcome> {
        self.store.entry(key).map(|entry| entry.outcome())
    }

    /// The values of a result, if they are all there and what they were.
    pub(super) fn read(&self, key: Hash, outcome: &Outcome) -> Option<Values> {
        let entry = self.store.entry(key)?;
        self.store.fetch_columns(&entry, outcome.seconds);
        let values = entry.values(&*self.store).filter(|values| {
            values
                .iter()
                .map(|value| (value.kind().name, value.hash()))
                .eq(outcome.outputs.iter().copied())
        });
        if values.is_none() {
            self.store.remove(&self.store.entry_path(key));
        }
        values
    }

    /// Keeps a result of a node of this type if reading it back is faster than computing it. Returns before it is written. If what was kept before is
    /// lost, the columns that are still there are not `trusted`. Whether it is kept.
    pub(super) fn keep(
        &self,
        key: Hash,
        node: &str,
        outcome: &Arc<Outcome>,
        values: &Values,
        trusted: bool,
    ) -> bool {
        let slow = WORTH_A_FILE < outcome.seconds;
        let pays = outcome.bytes <= SMALL || outcome.bytes as f64 / READ_SPEED < outcome.seconds;
        let keeps =
            pays && (slow || self.writer.entries() < CHEAP_ENTRIES) && self.trouble().is_none();
        if keeps {
            let (node, outcome, values) = (node.to_owned(), outcome.clone(), values.clone());
            self.writer.send(Job::Entry { key, node, outcome, values, trusted });
        }
        keeps
    }

    /// Removes a result that its node does not give.
    pub(super) fn remove(&self, key: Hash) {
        self.store.remove(&self.store.entry_path(key));
    }

    /// Keeps what an evaluation of a graph found.
    pub(super) fn keep_snapshot(&self, snapshot: &Arc<Snapshot>, files: Vec<KnownFile>) {
        if self.trouble().is_none() {
            let path = self.store.path_of("graphs", &snapshot.graph);
            self.writer.send(Job::Record { path, snapshot: snapshot.clone(), files });
        }
    }

    /// What was last noted of a folder of outputs.
    pub(crate) fn note(&self, folder: &Path) -> Option<Vec<u8>> {
        self.store.read(&self.store.path_of("outputs", folder))
    }

    /// Keeps a note of a folder of outputs, when these files are on disk.
    pub(crate) fn keep_note(&self, folder: &Path, note: Vec<u8>, files: Vec<PathBuf>) {
        let path = self.store.path_of("outputs", folder);
        self.writer.send(Job::Note { path, note, files });
    }

    /// What the last evaluation of the graph at this path found, and the files that it read.
    pub(super) fn snapshot(&self, graph: &Path) -> Option<(Snapshot, Vec<KnownFile>)> {
        let path = self.store.path_of("graphs", graph);
        let found = record::read(&self.store.read(&path)?, graph, &self.store);
        if found.is_none() {
            self.store.remove(&path);
        }
        found
    }
}

/// What a server is to be sent is waited for a moment here, too, by those who wait for nothing else.
impl Drop for Disk {
    fn drop(&mut self) {
        if let Some(remote) = self.store.remote.get() {
            self.writer.wait();
            remote.finish();
        }
    }
}

impl Store {
    fn open(
        folder: &Path,
        fingerprint: &str,
        limit: u64,
        types: HashMap<&'static str, &'static ValueType>,
    ) -> io::Result<Self> {
        let (folder, home) = (folder.to_owned(), folder.join(fingerprint));
        let (trouble, written, remote) = (OnceLock::new(), AtomicU64::new(0), OnceLock::new());
        let store = Self { folder, home, limit, types, trouble, written, remote };
        let made = in_spite_of_removal(|_| {
            FOLDERS.iter().try_for_each(|name| make_folder(&store.home.join(name)))
        });
        match made {
            // A folder that may only be read still answers.
            Err(error) if store.home.is_dir() => store.stop(error),
            other => other?,
        }
        Ok(store)
    }

    fn entry_path(&self, key: Hash) -> PathBuf {
        self.home.join("entries").join(key.to_string())
    }

    fn column_path(&self, hash: Hash) -> PathBuf {
        self.home.join("columns").join(hash.to_string())
    }

    /// The file for what is known of the graph or folder at this path.
    fn path_of(&self, what: &str, path: &Path) -> PathBuf {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let hash = Hash::of(path.as_os_str().as_encoded_bytes());
        self.home.join(what).join(hash.to_string())
    }

    /// The content of a file that ends with its checksum; none, and no file any more, if that does not fit.
    fn read(&self, path: &Path) -> Option<Vec<u8>> {
        let content = unsealed(path, plain::read_own(path).ok()?);
        match content {
            Some(_) => self.touch(path),
            None => self.remove(path),
        }
        content
    }

    fn entry(&self, key: Hash) -> Option<Entry> {
        let path = self.entry_path(key);
        let entry = Entry::parse(self.read(&path)?, key, &self.types);
        if entry.is_none() {
            self.remove(&path);
        }
        entry
    }

    /// Says that a file was used.
    fn touch(&self, path: &Path) {
        if self.trouble.get().is_none() {
            touch(path);
        }
    }

    /// Removes a file that is damaged; where that is not allowed, it is found damaged again.
    fn remove(&self, path: &Path) {
        let _ = remove(path);
    }

    /// Writes nothing any more, for this reason.
    fn stop(&self, reason: impl fmt::Display) {
        let _ = self.trouble.set(reason.to_string());
    }

    /// Writes a file, which appears whole or not at all.
    fn write(&self, path: &Path, parts: &[&[u8]]) {
        if self.trouble.get().is_some() {
            return;
        }
        match write_parts(path, parts) {
            Ok(_) => {
                let bytes = parts.iter().map(|part| part.len() as u64).sum();
                self.written.fetch_add(bytes, Ordering::Relaxed);
            }
            Err(error) => self.stop(error),
        }
    }

    fn write_checked(&self, path: &Path, content: &[u8]) {
        self.write(path, &[content, &seal(path, content)]);
    }

    /// Whether it was not there.
    fn write_column(&self, column: &dyn Bytes, trusted: bool) -> bool {
        let path = self.column_path(column.hash());
        let length = column.bytes().len() as u64;
        let is_new = !fs::metadata(&path)
            .is_ok_and(|metadata: fs::Metadata| trusted && metadata.len() == length);
        match is_new {
            true => self.write(&path, &[column.bytes()]),
            false => self.touch(&path),
        }
        is_new
    }
}

impl Columns for Store {
    /// The content is not judged here: who asks compares its hash.
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool {
        let path = self.column_path(hash);
        let read = plain::open_own(&path).and_then(|mut file| {
            let fits = file.metadata()?.len() == into.len() as u64;
            if fits { file.read_exact(into).map(|()| true) } else { Ok(false) }
        });
        self.touch(&path);
        read.unwrap_or(false)
    }

    fn damaged(&self, hash: Hash) {
        self.remove(&self.column_path(hash));
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{AnyValue, Column, Points};
    use nalgebra::Point3;

    use super::*;

    fn store(folder: &Path) -> io::Result<Store> {
        Store::open(folder, "0123456789abcdef0123456789abcdef", u64::MAX, HashMap::new())
    }

    #[test]
    fn a_cache_that_is_cleared_all_the_time_is_no_trouble() {
        let folder = tempfile::tempdir().unwrap();
        folder::tag(folder.path()).unwrap();
        let is_over = AtomicU64::new(0);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while is_over.load(Ordering::Relaxed) == 0 {
                    Disk::gc(folder.path(), 0).unwrap();
                }
            });
            for number in 0..300_u32 {
                let store = store(folder.path());
                if let Ok(store) = &store {
                    store.write_checked(&store.entry_path(Hash::of(&number.to_le_bytes())), b"new");
                }
                let trouble = store.map(|store| store.trouble.into_inner());
                if !matches!(trouble, Ok(None)) {
                    is_over.store(1, Ordering::Relaxed);
                    panic!("{number}: {trouble:?}");
                }
            }
            is_over.store(1, Ordering::Relaxed);
        });
    }

    #[test]
    fn a_result_that_was_changed_after_it_was_computed_is_not_written() {
        for (is_intact, n) in [(true, 10), (true, 10_000), (false, 10), (false, 10_000)] {
            let folder = tempfile::tempdir().unwrap();
            let store = store(folder.path()).unwrap();
            let points = Column::from(vec![Point3::new(1.0, 2.0, 3.0); n]);
            let value = AnyValue::new(Points::new(points.clone()).unwrap());
            let value = match is_intact {
                true => value,
                // As if somebody had moved a point in memory.
                false => {
                    let mut moved = points.to_vec();
                    moved[n - 1].x = 100.0;
                    let moved = Column::of_hash(moved, points.hash());
                    AnyValue::new(Points::new(moved).unwrap())
                }
            };
            let outputs = [(value.kind().name, value.hash())].into();
            let outcome = Outcome::known(outputs, Vec::new(), value.size(), 1.0);
            let (key, values) = (Hash::of(b"key"), Values::from(vec![value]));
            let (node, outcome) = (String::new(), outcome.into());
            Job::Entry { key, node, outcome, values, trusted: true }.run(&store);
            assert_eq!(store.entry_path(key).exists(), is_intact, "{n}");
            let columns = fs::read_dir(store.home.join("columns")).unwrap().count();
            assert_eq!(columns, usize::from(is_intact && n == 10_000));
            assert_eq!(store.trouble.get().is_some(), !is_intact);
        }
    }

    #[test]
    fn what_is_being_written_stays_when_the_cache_is_cleared() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path()).unwrap();
        folder::tag(folder.path()).unwrap();
        let entries = store.home.join("entries");
        let [busy, left] =
            ["a", "b"].map(|letter| entries.join(format!(".maquette-{}.part", letter.repeat(12))));
        for path in [&busy, &left, &store.entry_path(Hash::of(b"result"))] {
            fs::write(path, "half").unwrap();
        }
        let writing = fs::File::options().append(true).open(&busy).unwrap();
        writing.lock().unwrap();
        assert_eq!(Disk::gc(folder.path(), 0).unwrap(), 8);
        let left = fs::read_dir(entries).unwrap().map(|entry| entry.unwrap().path());
        assert_eq!(Vec::from_iter(left), [busy]);
    }
}
