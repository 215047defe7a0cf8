//! The disk cache, which keeps results from one process to the next. Each build of the program has its own folder, which is named by a
//! fingerprint of the code: see [`program`].
//!
//! ```text
//! CACHE/CACHEDIR.TAG
//! CACHE/programs/STAMP                the hash of an executable or library, by its metadata (stamp)
//! CACHE/FINGERPRINT/entries/KEY       the result of a node: its outputs without their large columns
//! CACHE/FINGERPRINT/columns/HASH      a large column (an array of data)
//! CACHE/FINGERPRINT/graphs/HASH       the record of the last evaluation of a graph; HASH is of the graph's path
//! CACHE/FINGERPRINT/outputs/HASH      the record of the files in an output folder; HASH is of the folder's path
//! ```
//!
//! Every file appears whole or not at all, and ends with a checksum of its name and content. The name of a column file is itself the hash
//! of its content. A file whose checksum does not match is incomplete, damaged or renamed; it is removed, and the result is computed again.
//! So any number of processes can share a folder without a lock. The modification time of a file is the time of its last use.
//! [`gc`](Disk::gc) drops the least recently used files, and [`doctor`](Disk::doctor) checks all files. Files that are not part of the
//! cache are left alone: see [`folder`].
//!
//! The names of entries and columns depend only on the data from which they are computed. So machines can exchange these files: see
//! `remote`.
//!
//! A large column is read directly into the buffer of its value.

use std::collections::HashMap;
use std::fmt;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use maquette_graph::catalog::Catalog;
use maquette_graph::files::KnownFile;
use maquette_value::{Bytes, Columns, Hash, ValueType};

use super::cache::{Outcome, Values};
use super::snapshot::Snapshot;
use crate::writing::{make_folder, remove, retry_if_removed, touch, write_parts};

mod doctor;
mod entry;
mod folder;
mod program;
mod record;
mod seal;
mod share;
mod usage;
mod writer;

pub use doctor::{CacheFault, Diagnosis};
use entry::Entry;
use maquette_remote::Remote;
pub use program::this_is_a_program;
use seal::{seal, unseal};
pub use usage::{NodeSize, Sizes, Usage};
use writer::{Job, Writer};

/// A disk cache that one build of the program has opened.
pub struct Disk {
    store: Arc<Store>,
    writer: Writer,
}

/// The reason why a disk cache cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DiskError {
    /// The folder is not a cache of this program.
    #[error("{} is not a cache of maquette: it is not empty and has no {} of maquette", .0.display(), folder::TAG)]
    Foreign(PathBuf),
    /// The folder belongs to another user, whose files are not trusted.
    #[error("the cache {} belongs to another user", .0.display())]
    OtherUser(PathBuf),
    /// Some files of the cache cannot be removed.
    #[error("cannot remove {count} of the files in the cache {}: {error}", .folder.display())]
    NotRemoved {
        /// The folder that contains the files.
        folder: PathBuf,
        /// The number of files that cannot be removed.
        count: usize,
        /// The error of removing the first of these files.
        error: io::Error,
    },
    /// An error of the operating system.
    #[error("the cache {} cannot be used: {error}", .folder.display())]
    System {
        /// The folder that cannot be used.
        folder: PathBuf,
        /// The error that the operating system returned.
        error: io::Error,
    },
}

impl DiskError {
    fn system(folder: &Path, error: io::Error) -> Self {
        Self::System { folder: folder.to_owned(), error }
    }
}

/// The folders of the cache, and the state of writing.
struct Store {
    /// The folder of the cache, which contains the results of all builds.
    folder: PathBuf,
    /// The folder that contains the results of this build.
    home: PathBuf,
    limit: u64,
    types: HashMap<&'static str, &'static ValueType>,
    /// The first error of writing a file. After an error nothing more is written.
    write_error: OnceLock<String>,
    written: AtomicU64,
    /// The server through which machines share results.
    remote: OnceLock<Remote>,
}

/// The subfolders of the folder of a build.
const FOLDERS: [&str; 4] = ["entries", "columns", "graphs", "outputs"];

/// The number of entries that a process stores even if they were computed quickly. Later entries are stored only if they took at least
/// [`MIN_SECONDS_TO_KEEP`].
const CHEAP_ENTRIES: usize = 1000;

/// The minimum computation time, in seconds, of an entry that is stored after the first [`CHEAP_ENTRIES`] entries of a process.
pub(super) const MIN_SECONDS_TO_KEEP: f64 = 1e-3;

/// A result of at most this size, in bytes, is always stored. A larger one is stored only if it is faster to read than to compute.
const SMALL: usize = 8 << 20;

/// The assumed speed of reading a file that the operating system has in memory, in bytes per second.
const READ_SPEED: f64 = 1.5e9;

impl Disk {
    /// Opens the cache of the running program in `folder`, which is created if it is missing. The cache may take up to `limit` bytes.
    ///
    /// # Errors
    /// If the folder cannot be created or is not a cache, or if the running code cannot be identified.
    pub fn open(folder: &Path, limit: u64, catalog: &Catalog) -> Result<Self, DiskError> {
        folder::claim(folder)?;
        let store = program::fingerprint(folder, catalog)
            .and_then(|fingerprint| Store::open(folder, &fingerprint, limit, catalog.value_types()))
            .map_err(|error| DiskError::system(folder, error))?;
        let store = Arc::new(store);
        Ok(Self { writer: Writer::new(store.clone()), store })
    }

    /// Returns the fingerprint of the code that computes results: the name of this build's folder in the cache.
    pub(crate) fn program(&self) -> String {
        let name = self.store.home.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Returns the reason why results cannot be written to disk, such as a full disk or a read-only folder. `None` if they can be written.
    pub fn write_error(&self) -> Option<&str> {
        self.store.write_error.get().map(String::as_str)
    }

    /// Waits until all results are on disk. Also waits up to one second for uploads to a [server](Self::with_server). If the cache exceeds
    /// its size limit, drops the least recently used files.
    pub fn finish(&self) {
        self.writer.wait();
        self.store.remote.get().into_iter().for_each(Remote::finish);
        self.store.tidy();
    }

    /// Returns true if an entry with this key exists. The content is not checked, so the entry may be damaged.
    pub(super) fn has_entry(&self, key: Hash) -> bool {
        self.store.entry_path(key).exists()
    }

    /// Returns true if an undamaged entry with this key and the files of all its columns exist.
    pub(super) fn has_whole_entry(&self, key: Hash) -> bool {
        let path = self.store.entry_path(key);
        let bytes =
            maquette_value::fs::read_no_follow(&path).ok().and_then(|bytes| unseal(&path, bytes));
        let columns = bytes.and_then(|bytes| entry::columns(&bytes, key).flatten());
        columns.is_some_and(|columns| {
            columns.iter().all(|(column, _)| self.store.column_path(*column).exists())
        })
    }

    /// Returns the stored result with this key, without its values. Returns `None` if there is no undamaged entry with this key.
    pub(super) fn find(&self, key: Hash) -> Option<Outcome> {
        self.store.entry(key).map(|entry| entry.outcome())
    }

    /// Returns the values of a stored result, or `None` if some of them are missing or damaged.
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

    /// Stores the result of a node of type `node`, if it is faster to read back than to compute again. Returns true if it is stored; a
    /// background thread writes it. If `trusts_columns` is false, existing column files are overwritten, because an earlier copy of the
    /// result was damaged or incomplete.
    pub(super) fn keep(
        &self,
        key: Hash,
        node: &str,
        outcome: &Arc<Outcome>,
        values: &Values,
        trusts_columns: bool,
    ) -> bool {
        let slow = MIN_SECONDS_TO_KEEP < outcome.seconds;
        let pays = outcome.bytes <= SMALL || outcome.bytes as f64 / READ_SPEED < outcome.seconds;
        let keeps =
            pays && (slow || self.writer.entries() < CHEAP_ENTRIES) && self.write_error().is_none();
        if keeps {
            let (node, outcome, values) = (node.to_owned(), outcome.clone(), values.clone());
            self.writer.send(Job::Entry { key, node, outcome, values, trusted: trusts_columns });
        }
        keeps
    }

    /// Removes the result with this key, because computing it again gave a different one.
    pub(super) fn remove(&self, key: Hash) {
        self.store.remove(&self.store.entry_path(key));
    }

    /// Stores the snapshot of an evaluation.
    pub(super) fn keep_snapshot(&self, snapshot: &Arc<Snapshot>, files: Vec<KnownFile>) {
        if self.write_error().is_none() {
            let path = self.store.path_of("graphs", &snapshot.graph);
            self.writer.send(Job::Record { path, snapshot: snapshot.clone(), files });
        }
    }

    /// Returns the bytes that [`keep_note`](Self::keep_note) has stored for an output folder, or `None` if there are none.
    pub(crate) fn note(&self, folder: &Path) -> Option<Vec<u8>> {
        self.store.read(&self.store.path_of("outputs", folder))
    }

    /// Stores some bytes (a note) for an output folder. The note is written only after the given files are on disk.
    pub(crate) fn keep_note(&self, folder: &Path, note: Vec<u8>, files: Vec<PathBuf>) {
        let path = self.store.path_of("outputs", folder);
        self.writer.send(Job::Note { path, note, files });
    }

    /// Returns the snapshot of the last evaluation of the graph at this path, and the metadata of the files that the evaluation read.
    /// Returns `None` if no usable snapshot is stored.
    pub(super) fn snapshot(&self, graph: &Path) -> Option<(Snapshot, Vec<KnownFile>)> {
        let path = self.store.path_of("graphs", graph);
        let found = record::read(&self.store.read(&path)?, graph, &self.store);
        if found.is_none() {
            self.store.remove(&path);
        }
        found
    }
}

/// Waits a short time for uploads if [`finish`](Disk::finish) was not called.
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
        let store = Self { folder, home, limit, types, write_error: trouble, written, remote };
        let made = retry_if_removed(|_| {
            FOLDERS.iter().try_for_each(|name| make_folder(&store.home.join(name)))
        });
        match made {
            // Only stop writing: results in a read-only folder can still be read.
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

    /// Returns the path of the cache file about a graph or output folder. `what` is the subfolder of the cache; `path` is the path of the
    /// graph or folder.
    fn path_of(&self, what: &str, path: &Path) -> PathBuf {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let hash = Hash::compute(path.as_os_str().as_encoded_bytes());
        self.home.join(what).join(hash.to_string())
    }

    /// Reads a file that ends with its checksum. If the checksum does not match, removes the file and returns `None`.
    fn read(&self, path: &Path) -> Option<Vec<u8>> {
        let content = unseal(path, maquette_value::fs::read_no_follow(path).ok()?);
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

    /// Sets the last use of a file to now. The least recently used files are dropped first.
    fn touch(&self, path: &Path) {
        if self.write_error.get().is_none() {
            touch(path);
        }
    }

    /// Removes a damaged file. If that fails, the error is ignored: the file will be found damaged again.
    fn remove(&self, path: &Path) {
        let _ = remove(path);
    }

    /// Stops all further writing, and stores `reason` as the write error.
    fn stop(&self, reason: impl fmt::Display) {
        let _ = self.write_error.set(reason.to_string());
    }

    /// Writes a file whose content is the given parts, one after the other. The file appears whole or not at all.
    fn write(&self, path: &Path, parts: &[&[u8]]) {
        if self.write_error.get().is_some() {
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

    /// Writes the file of a column unless it exists. If `trusted` is false, an existing file is overwritten. Returns true if the file was
    /// written.
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
    /// Reads a column into a buffer. Does not check the content: the caller must compare its hash.
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool {
        let path = self.column_path(hash);
        let read = maquette_value::fs::open_no_follow(&path).and_then(|mut file| {
            let fits = file.metadata()?.len() == into.len() as u64;
            if fits { file.read_exact(into).map(|()| true) } else { Ok(false) }
        });
        self.touch(&path);
        read.unwrap_or(false)
    }

    fn report_damage(&self, hash: Hash) {
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
    fn clearing_the_cache_does_not_disturb_writing() {
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
                    store.write_checked(
                        &store.entry_path(Hash::compute(&number.to_le_bytes())),
                        b"new",
                    );
                }
                let trouble = store.map(|store| store.write_error.into_inner());
                if !matches!(trouble, Ok(None)) {
                    is_over.store(1, Ordering::Relaxed);
                    panic!("{number}: {trouble:?}");
                }
            }
            is_over.store(1, Ordering::Relaxed);
        });
    }

    #[test]
    fn a_result_modified_after_computation_is_not_written() {
        for (is_intact, n) in [(true, 10), (true, 10_000), (false, 10), (false, 10_000)] {
            let folder = tempfile::tempdir().unwrap();
            let store = store(folder.path()).unwrap();
            let points = Column::from(vec![Point3::new(1.0, 2.0, 3.0); n]);
            let value = AnyValue::new(Points::new(points.clone()).unwrap());
            let value = match is_intact {
                true => value,
                // Simulates a value whose memory was overwritten by accident: a point has moved, but the column still has the old hash.
                false => {
                    let mut moved = points.to_vec();
                    moved[n - 1].x = 100.0;
                    let moved = Column::with_known_hash(moved, points.hash());
                    AnyValue::new(Points::new(moved).unwrap())
                }
            };
            let outputs = [(value.kind().name, value.hash())].into();
            let outcome = Outcome::without_values(outputs, Vec::new(), value.size(), 1.0);
            let (key, values) = (Hash::compute(b"key"), Values::from(vec![value]));
            let (node, outcome) = (String::new(), outcome.into());
            Job::Entry { key, node, outcome, values, trusted: true }.run(&store);
            assert_eq!(store.entry_path(key).exists(), is_intact, "{n}");
            let columns = fs::read_dir(store.home.join("columns")).unwrap().count();
            assert_eq!(columns, usize::from(is_intact && n == 10_000));
            assert_eq!(store.write_error.get().is_some(), !is_intact);
        }
    }

    #[test]
    fn files_being_written_survive_clearing_the_cache() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path()).unwrap();
        folder::tag(folder.path()).unwrap();
        let entries = store.home.join("entries");
        let [busy, left] =
            ["a", "b"].map(|letter| entries.join(format!(".maquette-{}.part", letter.repeat(12))));
        for path in [&busy, &left, &store.entry_path(Hash::compute(b"result"))] {
            fs::write(path, "half").unwrap();
        }
        let writing = fs::File::options().append(true).open(&busy).unwrap();
        writing.lock().unwrap();
        assert_eq!(Disk::gc(folder.path(), 0).unwrap(), 8);
        let left = fs::read_dir(entries).unwrap().map(|entry| entry.unwrap().path());
        assert_eq!(Vec::from_iter(left), [busy]);
    }
}
