//! The contents of the files that nodes read. Each file is read at most once per evaluation, and an unchanged file is not read again. The
//! companions of a file are files to which it refers, such as the materials and picture of an OBJ file. Companions are read with the file,
//! and its hash covers them.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use maquette_node::importers::{CompanionFiles, InputFile, Readers};
use maquette_node::{Companions, File, ReadError};
use maquette_syntax::error::{Diagnostic, panic_message};
use maquette_value::fs::extension;
use maquette_value::{Hash, fs};
use serde::{Deserialize, Serialize};

use crate::file_stat::FileStat;

/// A file that a node reads.
#[derive(Clone, Debug)]
pub struct NodeFile {
    /// The path as it is written in the graph.
    pub given: String,
    pub path: PathBuf,
    /// True if the node fails without the file.
    pub needed: bool,
    /// The folders that must contain the companions of the file.
    pub roots: Arc<[PathBuf]>,
    /// The diagnostic of the check, if the node requires the file and the file cannot be read. Otherwise `None`.
    pub missing: Option<Arc<Diagnostic>>,
    /// True if the file is the value of an input, and a forecast has skipped reading it.
    pub is_unread: bool,
}

impl NodeFile {
    /// Creates a file for a value that comes from outside of the graph. Its companions must be in the folders `roots`.
    pub fn from_path(path: &Path, roots: Arc<[PathBuf]>) -> Self {
        let (given, path) = (path.display().to_string(), path.to_owned());
        Self { given, path, needed: true, roots, missing: None, is_unread: false }
    }
}

/// A file that was read, with its hash and its metadata at the time of reading.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct KnownFile {
    path: PathBuf,
    as_read: ReadState,
}

/// The hash of a file and its companions, and their metadata at the time of reading.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct ReadState {
    stamp: FileStat,
    /// The metadata of each companion of the file. `None` for a companion that did not exist.
    #[serde(default)]
    companions: Vec<(PathBuf, Option<FileStat>)>,
    hash: Hash,
}

impl ReadState {
    /// Returns true if the metadata of the file and of its companions has not changed.
    fn is_unchanged(&self, stamp: FileStat) -> bool {
        stamp == self.stamp
            && self.companions.iter().all(|(path, stamp)| FileStat::read(path) == *stamp)
    }
}

/// All files that have been read, by path, with their metadata at the time of reading.
#[derive(Default)]
pub struct KnownFiles(Mutex<HashMap<PathBuf, ReadState>>);

impl KnownFile {
    /// Returns the hash of the content. `None` if the file or one of its companions has changed.
    pub fn hash(&self) -> Option<Hash> {
        self.as_read.is_unchanged(FileStat::read(&self.path)?).then_some(self.as_read.hash)
    }
}

/// The metadata of a file and its companions, taken before they are read.
pub struct FileStats {
    path: PathBuf,
    own: Option<FileStat>,
    companions: RefCell<Vec<(PathBuf, Option<FileStat>)>>,
}

impl FileStats {
    pub fn read(path: &Path) -> Self {
        Self { path: path.to_owned(), own: FileStat::read(path), companions: RefCell::default() }
    }

    /// Records the metadata of a companion. Must be called before the companion is read.
    pub fn add(&self, companion: &Path) {
        self.companions.borrow_mut().push((companion.to_owned(), FileStat::read(companion)));
    }

    /// Combines the metadata with `hash`, the hash of the file's content, so that a forecast can skip reading the file. Returns `None` for
    /// a small file, and for a file that has changed since. Also returns `None` if a later write to the file might not change its metadata.
    pub fn into_known_file(self, hash: Hash) -> Option<KnownFile> {
        let (stamp, companions) = (self.own?, self.companions.into_inner());
        let all = companions.iter().filter_map(|(_, stamp)| *stamp).chain([stamp]);
        let bytes = all.clone().fold(0, |sum: u64, stamp| sum.saturating_add(stamp.size()));
        let is_worth_it = bytes > MAX_FORECAST_BYTES && all.clone().all(|it| it.is_settled());
        let as_read = ReadState { stamp, companions, hash };
        let is_same = is_worth_it && as_read.is_unchanged(FileStat::read(&self.path)?);
        is_same.then_some(KnownFile { path: self.path, as_read })
    }
}

impl KnownFiles {
    /// Returns the hash of the file's content: `Some(None)` if the file does not exist, and `None` if the file must be read to know the
    /// hash.
    pub fn cached_hash(&self, path: &Path) -> Option<Option<Hash>> {
        match std::fs::metadata(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Some(None),
            Err(_) => None,
            Ok(metadata) => {
                let as_read = lock(&self.0).get(path)?.clone();
                as_read.is_unchanged(FileStat::new(&metadata)).then_some(Some(as_read.hash))
            }
        }
    }

    /// Adds the files that another process has read.
    pub fn extend(&self, files: Vec<KnownFile>) {
        lock(&self.0).extend(files.into_iter().map(|file| (file.path, file.as_read)));
    }

    fn remember(&self, path: &Path, as_read: ReadState) {
        lock(&self.0).insert(path.to_owned(), as_read);
    }

    /// Returns the data of those of the given paths whose files have been read.
    pub fn get_all<'a>(&self, paths: impl Iterator<Item = &'a Path>) -> Vec<KnownFile> {
        let known = lock(&self.0);
        paths
            .filter_map(|path| {
                Some(KnownFile { path: path.to_owned(), as_read: known.get(path)?.clone() })
            })
            .collect()
    }
}

/// The files that one evaluation reads.
pub struct Reads<'a> {
    known: &'a KnownFiles,
    readers: &'a Readers,
    read: Mutex<HashMap<PathBuf, Arc<Slot>>>,
    /// Number of bytes that may still be read in this evaluation. `None` if there is no limit.
    left: Option<AtomicU64>,
    /// Time spent reading, in ns, summed over all threads.
    nanoseconds: AtomicU64,
}

type Slot = OnceLock<Option<File>>;

impl<'a> Reads<'a> {
    pub fn new(known: &'a KnownFiles, readers: &'a Readers) -> Self {
        let (read, left, nanoseconds) = Default::default();
        Self { known, readers, read, left, nanoseconds }
    }

    /// Limits the number of bytes that are read, for use by a forecast. Large files are skipped: see
    /// [`is_too_large_for_forecast`](Self::is_too_large_for_forecast).
    #[must_use]
    pub fn with_forecast_limit(self) -> Self {
        Self { left: Some(MAX_FORECAST_BYTES.into()), ..self }
    }

    /// Returns true if the hash of a file and its companions is unknown and they are too large for a forecast to read.
    pub fn is_too_large_for_forecast(&self, file: &NodeFile) -> bool {
        if file.is_unread {
            return true;
        }
        if self.left.is_none() {
            return false;
        }
        self.known.cached_hash(&file.path).is_none()
            && !self.is_read(&file.path)
            && self.is_too_large(file)
    }

    /// Returns true if the file has been read in this evaluation.
    fn is_read(&self, path: &Path) -> bool {
        let slot = lock(&self.read).get(path).cloned();
        slot.is_some_and(|slot| slot.get().is_some())
    }

    /// Returns true if a file and its companions have more bytes than a forecast may still read.
    pub fn is_too_large(&self, file: &NodeFile) -> bool {
        let Some(left) = &self.left else { return false };
        // Do not read a file to find its companions if it is too large by itself.
        let own = std::fs::metadata(&file.path).map_or(0, |metadata| metadata.len());
        if own > left.load(Ordering::Relaxed) {
            return true;
        }
        let size = size_with_companions(file, self.readers);
        let order = Ordering::Relaxed;
        left.fetch_update(order, order, |left| left.checked_sub(size)).is_err()
    }

    /// Returns the time spent reading in s, summed over all threads.
    pub fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 / 1e9
    }

    /// Returns the hash of the file's content. `None` if the file is optional and does not exist.
    pub fn hash(&self, file: &NodeFile) -> Result<Option<Hash>, ReadError> {
        let read = lock(&self.read).get(&file.path).cloned();
        if let Some(read) = read.as_ref().and_then(|slot| slot.get()) {
            return Ok(read.as_ref().map(|file| file.hash));
        }
        match self.known.cached_hash(&file.path) {
            Some(Some(hash)) => Ok(Some(hash)),
            _ => Ok(self.file(file)?.map(|file| file.hash)),
        }
    }

    /// Returns the hash of a large file without companions. Reads it piece by piece if its metadata does not prove it unchanged.
    pub fn hash_in_pieces(&self, file: &NodeFile) -> Result<Hash, ReadError> {
        if let Some(Some(hash)) = self.known.cached_hash(&file.path) {
            return Ok(hash);
        }
        let start = Instant::now();
        let stamp = FileStat::read(&file.path);
        let hash = fs::open(&file.path)
            .and_then(Hash::of_reader)
            .map_err(|error| ReadError { name: file.given.clone(), reason: error.to_string() })?;
        if let Some(stamp) = stamp.filter(FileStat::is_settled) {
            self.known.remember(&file.path, ReadState { stamp, companions: Vec::new(), hash });
        }
        self.add_time(start);
        Ok(hash)
    }

    fn add_time(&self, start: Instant) {
        let nanoseconds = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.nanoseconds.fetch_add(nanoseconds, Ordering::Relaxed);
    }

    /// Returns the file with its content. `None` if the file is optional and does not exist.
    pub fn file(&self, file: &NodeFile) -> Result<Option<File>, ReadError> {
        let slot = lock(&self.read).entry(file.path.clone()).or_default().clone();
        let found = match slot.get() {
            Some(found) => found.clone(),
            // Read outside of `get_or_init`, which would block other threads on this one and could cause a deadlock.
            None => {
                let start = Instant::now();
                let found = self.read(file)?;
                self.add_time(start);
                slot.get_or_init(|| found).clone()
            }
        };
        if found.is_none() && file.needed {
            let reason = "there is no such file".into();
            return Err(ReadError { name: file.given.clone(), reason });
        }
        Ok(found)
    }

    fn read(&self, file: &NodeFile) -> Result<Option<File>, ReadError> {
        let stamp = FileStat::read(&file.path);
        let bytes = match fs::read(&file.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                return Err(ReadError { name: file.given.clone(), reason: error.to_string() });
            }
        };
        let found = companions(file, &bytes, self.readers);
        let (companions, stamps) =
            found.map_err(|reason| ReadError { name: file.given.clone(), reason })?;
        let hash = hash(&bytes, &companions);
        let all = stamp.into_iter().chain(stamps.iter().filter_map(|(_, stamp)| *stamp));
        if let Some(stamp) = stamp.filter(|_| all.clone().all(|stamp| stamp.is_settled())) {
            self.known.remember(&file.path, ReadState { stamp, companions: stamps, hash });
        }
        let (name, companions) = (file.given.clone(), companions.into());
        Ok(Some(File { name, bytes: bytes.into(), companions, hash }))
    }
}

/// Maximum number of bytes that a forecast reads. Hashing 64 MiB takes about 20 ms, whereas a scan of 3 GB takes 22 s. A larger file is
/// reported as possibly changed if its metadata differs from that of the last run.
const MAX_FORECAST_BYTES: u64 = 64 << 20;

/// Returns the size of a file with its companions in bytes. Above the limit of a forecast, the result is not exact but exceeds the limit.
fn size_with_companions(file: &NodeFile, readers: &Readers) -> u64 {
    fn size(path: &Path) -> u64 {
        std::fs::metadata(path).map_or(0, |metadata| metadata.len())
    }
    let own = size(&file.path);
    if own > MAX_FORECAST_BYTES || !readers.may_name(&extension(&file.path)) {
        return own;
    }
    let Ok(bytes) = fs::read(&file.path) else { return own };
    let folder = file.path.parent().unwrap_or(Path::new(""));
    let (all, files) = (Cell::new(own), CompanionFiles::new(&file.roots));
    let beside = |name: &str| {
        let path = folder.join(name);
        all.set(all.get().saturating_add(size(&path)));
        match all.get() <= MAX_FORECAST_BYTES {
            true => files.read(name, &path),
            false => Err("it is too large".into()),
        }
    };
    let name = file.path.to_string_lossy();
    // Ignore a panic of a reader. It will be reported when the file is read.
    let reading = InputFile::new(&name, &bytes, &beside);
    let _ = catch_unwind(AssertUnwindSafe(|| readers.ask_companions(&reading)));
    drop(reading);
    all.get()
}

/// Returns the paths of a file's companions, including those that are not in the folders `roots`.
pub fn companion_paths(path: &Path, roots: &[PathBuf], readers: &Readers) -> Vec<PathBuf> {
    // Files of formats whose readers never refer to other files have no companions.
    if !readers.may_name(&extension(path)) {
        return Vec::new();
    }
    let file = NodeFile { needed: false, ..NodeFile::from_path(path, roots.into()) };
    let found = companions(&file, &fs::read(path).unwrap_or_default(), readers);
    found.map_or(Vec::new(), |(_, stamps)| stamps.into_iter().map(|(path, _)| path).collect())
}

/// The companions of a file, and the metadata of each companion from before it was read.
type NamedFiles = (Companions, Vec<(PathBuf, Option<FileStat>)>);

/// Asks the readers of the file's format which companions the file has, and reads the companions.
///
/// # Errors
/// A reader panics. The error is the message of the panic.
fn companions(file: &NodeFile, bytes: &[u8], readers: &Readers) -> Result<NamedFiles, String> {
    let folder = file.path.parent().unwrap_or(Path::new(""));
    let files = CompanionFiles::new(&file.roots);
    let named = RefCell::new(NamedFiles::default());
    let beside = |name: &str| {
        let (companions, stamps) = &mut *named.borrow_mut();
        companions
            .entry(name.to_owned())
            .or_insert_with(|| {
                let path = folder.join(name);
                stamps.push((path.clone(), FileStat::read(&path)));
                files.read(name, &path)
            })
            .clone()
    };
    let name = file.path.to_string_lossy();
    let reading = InputFile::new(&name, bytes, &beside);
    catch_unwind(AssertUnwindSafe(|| readers.ask_companions(&reading)))
        .map_err(|panic| format!("its reader panicked: {}", panic_message(&*panic)))?;
    drop(reading);
    Ok(named.into_inner())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns a hash of the content of a file and of its companions.
fn hash(bytes: &[u8], companions: &Companions) -> Hash {
    let own = Hash::compute(bytes);
    if companions.is_empty() {
        return own;
    }
    let mut all = own.to_string();
    let mut hashes = HashMap::new();
    for (name, found) in companions {
        let found = match found {
            // Compute the hash once for a companion to which the file refers by several names.
            Ok(bytes) => hashes
                .entry((bytes.as_ptr(), bytes.len()))
                .or_insert_with(|| Hash::compute(bytes).to_string())
                .clone(),
            Err(why) => why.clone(),
        };
        all += &format!("\n{name}\n{found}");
    }
    Hash::compute(all.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use maquette_format::READERS;

    use super::*;

    fn readers() -> Readers {
        Readers::new(READERS.iter().copied())
    }

    fn file_at(path: PathBuf) -> NodeFile {
        let roots = path.parent().map(|root| std::fs::canonicalize(root).unwrap_or(root.into()));
        let roots = roots.into_iter().collect();
        NodeFile { given: "a.txt".into(), ..NodeFile::from_path(&path, roots) }
    }

    #[test]
    fn a_file_that_was_just_written_is_read_again_and_an_old_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let file = file_at(folder.path().join("a.txt"));
        std::fs::write(&file.path, "new").unwrap();
        let known = KnownFiles::default();
        assert_eq!(
            Reads::new(&known, &readers()).hash(&file).unwrap(),
            Some(Hash::compute(b"new"))
        );
        assert_eq!(known.cached_hash(&file.path), None, "a second write may have the same stamp");

        let old = SystemTime::now() - Duration::from_secs(60);
        std::fs::File::options().append(true).open(&file.path).unwrap().set_modified(old).unwrap();
        let stamp = FileStat::read(&file.path).unwrap();
        let as_read = ReadState { stamp, companions: Vec::new(), hash: Hash::compute(b"new") };
        known.remember(&file.path, as_read);
        assert_eq!(known.cached_hash(&file.path), Some(Some(Hash::compute(b"new"))));
        std::fs::write(&file.path, "bad").unwrap();
        assert_eq!(known.cached_hash(&file.path), None);
    }

    #[test]
    fn the_files_that_a_file_names_are_a_part_of_it() {
        let folder = tempfile::tempdir().unwrap();
        fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            let old = SystemTime::now() - Duration::from_secs(60);
            let file = std::fs::File::options().append(true).open(path).unwrap();
            file.set_modified(old).unwrap();
        }
        write("a.obj", "mtllib a.mtl\nv 0 0 0\n", &folder);
        let file =
            NodeFile { path: folder.path().join("a.obj"), ..file_at(folder.path().join("a")) };
        let known = KnownFiles::default();
        fn read(known: &KnownFiles, file: &NodeFile) -> File {
            Reads::new(known, &readers()).file(file).unwrap().unwrap()
        }
        let missing = read(&known, &file);
        assert_eq!(missing.companion("a.mtl"), Err("there is no file `a.mtl`".into()));
        let stamp = FileStat::read(&file.path).unwrap();
        let companions = vec![(folder.path().join("a.mtl"), None)];
        known.remember(&file.path, ReadState { stamp, companions, hash: missing.hash });
        assert_eq!(known.cached_hash(&file.path), Some(Some(missing.hash)));
        write("a.mtl", "newmtl a\nmap_Kd a.png\n", &folder);
        assert_eq!(known.cached_hash(&file.path), None, "a material has come");
        let bare = read(&known, &file);
        assert_eq!(bare.companion("a.png"), Err("there is no file `a.png`".into()));
        write("a.png", "not yet a picture", &folder);
        let whole = read(&known, &file);
        assert_eq!(whole.companion("a.png").as_deref(), Ok(&b"not yet a picture"[..]));
        let other = [missing.hash, bare.hash, Hash::compute(whole.bytes())];
        assert!(!other.contains(&whole.hash));
        write("a.mtl", "newmtl a\nmap_Kd ../a.png\n", &folder);
        let outside = read(&known, &file).companion("../a.png").unwrap_err();
        assert_eq!(outside, "`../a.png` lies outside of the project");
    }

    #[test]
    fn a_file_that_is_named_in_many_spellings_is_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let names = (0..390).map(|k| format!("mtllib {}a.mtl\n", "./".repeat(k)));
        let text = format!("{}mtllib b/../a.mtl\nv 0 0 0\n", String::from_iter(names));
        std::fs::create_dir(folder.path().join("b")).unwrap();
        std::fs::write(folder.path().join("a.mtl"), "newmtl a\n").unwrap();
        let file =
            NodeFile { path: folder.path().join("a.obj"), ..file_at(folder.path().join("a")) };
        std::fs::write(&file.path, text).unwrap();
        let known = KnownFiles::default();
        let read = Reads::new(&known, &readers()).file(&file).unwrap().unwrap();
        let first = read.companion("a.mtl").unwrap();
        assert_eq!(read.companions.len(), 391);
        for found in read.companions.values() {
            assert!(Arc::ptr_eq(found.as_ref().unwrap(), &first));
        }
    }

    #[test]
    fn a_forecast_reads_no_large_files_and_none_that_name_such() {
        let folder = tempfile::tempdir().unwrap();
        fn large(name: &str, folder: &tempfile::TempDir) {
            let file = std::fs::File::create(folder.path().join(name)).unwrap();
            file.set_len(MAX_FORECAST_BYTES + 1).unwrap();
        }
        large("large.txt", &folder);
        large("a.mtl", &folder);
        std::fs::write(folder.path().join("a.obj"), "mtllib a.mtl\nv 0 0 0\n").unwrap();
        std::fs::write(folder.path().join("b.txt"), "small").unwrap();
        let known = KnownFiles::default();
        let readers = readers();
        for (name, expected) in [("large.txt", true), ("a.obj", true), ("b.txt", false)] {
            let file =
                NodeFile { path: folder.path().join(name), ..file_at(folder.path().join("a")) };
            let reads = Reads::new(&known, &readers);
            assert!(!reads.is_too_large_for_forecast(&file), "{name}");
            assert_eq!(
                reads.with_forecast_limit().is_too_large_for_forecast(&file),
                expected,
                "{name}"
            );
        }
    }

    #[test]
    fn a_file_that_is_not_there_is_an_error_only_if_it_is_needed() {
        let file = file_at("/no/such/folder/a.txt".into());
        let known = KnownFiles::default();
        let error = Reads::new(&known, &readers()).hash(&file).unwrap_err();
        assert_eq!(error.to_string(), "cannot read a.txt: there is no such file");
        assert_eq!(
            Reads::new(&known, &readers()).hash(&NodeFile { needed: false, ..file }).unwrap(),
            None
        );
    }
}
