//! The contents of the files that nodes read: each file read once an evaluation, and not at all if it is as it was. Files that a file
//! names, as an OBJ file does its materials and their picture, are parts of it: they are read with it, and its hash is that of all.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use maquette_node::reading::{CompanionFiles, Readers, Reading};
use maquette_node::{Companions, File, ReadError};
use maquette_syntax::error::{Problem, in_words};
use maquette_value::plain::ending;
use maquette_value::{Hash, plain};
use serde::{Deserialize, Serialize};

use crate::stamp::Stamp;

/// A file that a node reads.
#[derive(Clone, Debug)]
pub struct NodeFile {
    /// The path as the graph has it.
    pub given: String,
    pub path: PathBuf,
    /// Whether the node cannot do without it.
    pub needed: bool,
    /// The folders that a file named by it must lie in.
    pub roots: Arc<[PathBuf]>,
    /// What the check reports if the node needs it and it cannot be read.
    pub missing: Option<Arc<Problem>>,
    /// Whether it is that of an input, which a forecast has not read.
    pub is_unread: bool,
}

impl NodeFile {
    /// A file that is given from outside, and may name others in these folders.
    pub fn given(path: &Path, roots: Arc<[PathBuf]>) -> Self {
        let (given, path) = (path.display().to_string(), path.to_owned());
        Self { given, path, needed: true, roots, missing: None, is_unread: false }
    }
}

/// A file that was read, and what the system said of it then.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct KnownFile {
    path: PathBuf,
    as_read: AsRead,
}

/// What a file was when it was read.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct AsRead {
    stamp: Stamp,
    /// The files that it names; none for those that were not there.
    #[serde(default)]
    companions: Vec<(PathBuf, Option<Stamp>)>,
    hash: Hash,
}

impl AsRead {
    /// Whether the system says the same of all as it did then.
    fn is_as_it_was(&self, stamp: Stamp) -> bool {
        stamp == self.stamp && self.companions.iter().all(|(path, stamp)| Stamp::of(path) == *stamp)
    }
}

/// The files that were read, by path, with what the system said of them then.
#[derive(Default)]
pub struct Known(Mutex<HashMap<PathBuf, AsRead>>);

impl KnownFile {
    /// Returns the hash of what was read, if the file and those that it names are as they were then.
    pub fn hash(&self) -> Option<Hash> {
        self.as_read.is_as_it_was(Stamp::of(&self.path)?).then_some(self.as_read.hash)
    }
}

/// What the system says of a file and of those that it names before they are read.
pub struct Stamps {
    path: PathBuf,
    own: Option<Stamp>,
    companions: RefCell<Vec<(PathBuf, Option<Stamp>)>>,
}

impl Stamps {
    pub fn of(path: &Path) -> Self {
        Self { path: path.to_owned(), own: Stamp::of(path), companions: RefCell::default() }
    }

    /// Adds a file that it names.
    pub fn add(&self, companion: &Path) {
        self.companions.borrow_mut().push((companion.to_owned(), Stamp::of(companion)));
    }

    /// What a forecast need not read if the value in the file has this hash. None for small files, and where a later write could go
    /// unnoticed.
    pub fn known(self, hash: Hash) -> Option<KnownFile> {
        let (stamp, companions) = (self.own?, self.companions.into_inner());
        let all = companions.iter().filter_map(|(_, stamp)| *stamp).chain([stamp]);
        let bytes = all.clone().fold(0, |sum: u64, stamp| sum.saturating_add(stamp.size()));
        let is_worth_it = bytes > MAX_FORECAST_BYTES && all.clone().all(|it| it.is_settled());
        let as_read = AsRead { stamp, companions, hash };
        let is_same = is_worth_it && as_read.is_as_it_was(Stamp::of(&self.path)?);
        is_same.then_some(KnownFile { path: self.path, as_read })
    }
}

impl Known {
    /// The content's hash, or that there is no such file; none if it must be read to know.
    pub fn look(&self, path: &Path) -> Option<Option<Hash>> {
        match std::fs::metadata(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Some(None),
            Err(_) => None,
            Ok(metadata) => {
                let as_read = lock(&self.0).get(path)?.clone();
                as_read.is_as_it_was(Stamp::new(&metadata)).then_some(Some(as_read.hash))
            }
        }
    }

    /// Takes over what another process knew.
    pub fn extend(&self, files: Vec<KnownFile>) {
        lock(&self.0).extend(files.into_iter().map(|file| (file.path, file.as_read)));
    }

    fn remember(&self, path: &Path, as_read: AsRead) {
        lock(&self.0).insert(path.to_owned(), as_read);
    }

    /// What is known of these files.
    pub fn of<'a>(&self, paths: impl Iterator<Item = &'a Path>) -> Vec<KnownFile> {
        let known = lock(&self.0);
        paths
            .filter_map(|path| {
                Some(KnownFile { path: path.to_owned(), as_read: known.get(path)?.clone() })
            })
            .collect()
    }
}

/// The files of one evaluation.
pub struct Reads<'a> {
    known: &'a Known,
    readers: &'a Readers,
    read: Mutex<HashMap<PathBuf, Arc<Slot>>>,
    /// The number of bytes that may still be read; none if all may be.
    left: Option<AtomicU64>,
    /// How long reading took, on all threads together.
    nanoseconds: AtomicU64,
}

type Slot = OnceLock<Option<File>>;

impl<'a> Reads<'a> {
    pub fn new(known: &'a Known, readers: &'a Readers) -> Self {
        let (read, left, nanoseconds) = Default::default();
        Self { known, readers, read, left, nanoseconds }
    }

    /// The same for a forecast, which reads no large files: see [`is_spared`](Self::is_spared).
    #[must_use]
    pub fn sparing(self) -> Self {
        Self { left: Some(MAX_FORECAST_BYTES.into()), ..self }
    }

    /// Returns true if a file, with those that it names, would have to be read to know its hash, and is too large for a forecast.
    pub fn is_spared(&self, file: &NodeFile) -> bool {
        if file.is_unread {
            return true;
        }
        if self.left.is_none() {
            return false;
        }
        fn is_read(
            read: &Mutex<HashMap<PathBuf, Arc<OnceLock<Option<File>>>>>,
            file_path: &Path,
        ) -> bool {
            let slot = lock(read).get(file_path).cloned();
            slot.is_some_and(|slot| slot.get().is_some())
        }
        self.known.look(&file.path).is_none()
            && !is_read(&self.read, &file.path)
            && self.is_too_large(file)
    }

    /// Returns true if a file, with those that it names, is too large for a forecast, after what that has read.
    pub fn is_too_large(&self, file: &NodeFile) -> bool {
        let Some(left) = &self.left else { return false };
        let size = size_with_companions(file, self.readers);
        let order = Ordering::Relaxed;
        left.fetch_update(order, order, |left| left.checked_sub(size)).is_err()
    }

    /// How long reading took, on all threads together.
    pub fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 / 1e9
    }

    /// The hash of the content; none if there is no such file and the node can do without it.
    pub fn hash(&self, file: &NodeFile) -> Result<Option<Hash>, ReadError> {
        let read = lock(&self.read).get(&file.path).cloned();
        if let Some(read) = read.as_ref().and_then(|slot| slot.get()) {
            return Ok(read.as_ref().map(|file| file.hash));
        }
        match self.known.look(&file.path) {
            Some(Some(hash)) => Ok(Some(hash)),
            _ => Ok(self.file(file)?.map(|file| file.hash)),
        }
    }

    /// The file with its content; none if there is no such file and the node can do without it.
    pub fn file(&self, file: &NodeFile) -> Result<Option<File>, ReadError> {
        let slot = lock(&self.read).entry(file.path.clone()).or_default().clone();
        let found = match slot.get() {
            Some(found) => found.clone(),
            // Not inside of `get_or_init`: a thread must not wait for another one that may wait for it.
            None => {
                let start = Instant::now();
                let found = self.read(file)?;
                let nanoseconds = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
                self.nanoseconds.fetch_add(nanoseconds, Ordering::Relaxed);
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
        fn failed(error: std::io::Error, file_given: &str) -> Result<Option<File>, ReadError> {
            Err(ReadError { name: file_given.to_owned(), reason: error.to_string() })
        }
        let stamp = Stamp::of(&file.path);
        let bytes = match plain::read(&file.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return failed(error, &file.given),
        };
        let found = companions(file, &bytes, self.readers);
        let (companions, stamps) =
            found.map_err(|reason| ReadError { name: file.given.clone(), reason })?;
        let hash = hash(&bytes, &companions);
        let all = stamp.into_iter().chain(stamps.iter().filter_map(|(_, stamp)| *stamp));
        if let Some(stamp) = stamp.filter(|_| all.clone().all(|stamp| stamp.is_settled())) {
            self.known.remember(&file.path, AsRead { stamp, companions: stamps, hash });
        }
        let (name, companions) = (file.given.clone(), companions.into());
        Ok(Some(File { name, bytes: bytes.into(), companions, hash }))
    }
}

/// A forecast reads at most this many bytes of files: they are hashed in some 20 ms.
/// A scan of 3 GB takes 22 s. If the stamp of such a file is not that of the last run, the answer is that it may have changed.
const MAX_FORECAST_BYTES: u64 = 64 << 20;

/// Returns the size of a file and of those that it names; more than a forecast reads if it is known to be larger.
fn size_with_companions(file: &NodeFile, readers: &Readers) -> u64 {
    fn size(path: &Path) -> u64 {
        std::fs::metadata(path).map_or(0, |metadata| metadata.len())
    }
    let own = size(&file.path);
    if own > MAX_FORECAST_BYTES || !readers.may_name(&ending(&file.path)) {
        return own;
    }
    let Ok(bytes) = plain::read(&file.path) else { return own };
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
    // A reader that panics is reported when the file is read.
    let reading = Reading::new(&name, &bytes, &beside);
    let _ = catch_unwind(AssertUnwindSafe(|| readers.ask_companions(&reading)));
    drop(reading);
    all.get()
}

/// Where the files are that a file names, which lie in these folders or are said not to.
pub fn named_in(path: &Path, roots: &[PathBuf], readers: &Readers) -> Vec<PathBuf> {
    // Only such files are read for what they name.
    if !readers.may_name(&ending(path)) {
        return Vec::new();
    }
    let file = NodeFile { needed: false, ..NodeFile::given(path, roots.into()) };
    let found = companions(&file, &plain::read(path).unwrap_or_default(), readers);
    found.map_or(Vec::new(), |(_, stamps)| stamps.into_iter().map(|(path, _)| path).collect())
}

/// The files that a file names, and what the system says of each before it is read.
type Named = (Companions, Vec<(PathBuf, Option<Stamp>)>);

/// Asks the readers of a file which others it names.
///
/// # Errors
/// In words, if a reader panics.
fn companions(file: &NodeFile, bytes: &[u8], readers: &Readers) -> Result<Named, String> {
    let folder = file.path.parent().unwrap_or(Path::new(""));
    let files = CompanionFiles::new(&file.roots);
    let named = RefCell::new(Named::default());
    let beside = |name: &str| {
        let (companions, stamps) = &mut *named.borrow_mut();
        companions
            .entry(name.to_owned())
            .or_insert_with(|| {
                let path = folder.join(name);
                stamps.push((path.clone(), Stamp::of(&path)));
                files.read(name, &path)
            })
            .clone()
    };
    let name = file.path.to_string_lossy();
    let reading = Reading::new(&name, bytes, &beside);
    catch_unwind(AssertUnwindSafe(|| readers.ask_companions(&reading)))
        .map_err(|panic| format!("its reader panicked: {}", in_words(&*panic)))?;
    drop(reading);
    Ok(named.into_inner())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The hash of a file's content, and of that of the files that it names.
fn hash(bytes: &[u8], companions: &Companions) -> Hash {
    let own = Hash::of(bytes);
    if companions.is_empty() {
        return own;
    }
    let mut all = own.to_string();
    let mut hashes = HashMap::new();
    for (name, found) in companions {
        let found = match found {
            // Other names may lead to the same file.
            Ok(bytes) => hashes
                .entry((bytes.as_ptr(), bytes.len()))
                .or_insert_with(|| Hash::of(bytes).to_string())
                .clone(),
            Err(why) => why.clone(),
        };
        all += &format!("\n{name}\n{found}");
    }
    Hash::of(all.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use maquette_format::READERS;

    use super::*;

    fn readers() -> Readers {
        Readers::new(READERS.iter().copied())
    }

    fn at(path: PathBuf) -> NodeFile {
        let roots = path.parent().map(|root| std::fs::canonicalize(root).unwrap_or(root.into()));
        let roots = roots.into_iter().collect();
        NodeFile { given: "a.txt".into(), ..NodeFile::given(&path, roots) }
    }

    #[test]
    fn a_file_that_was_just_written_is_read_again_and_an_old_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let file = at(folder.path().join("a.txt"));
        std::fs::write(&file.path, "new").unwrap();
        let known = Known::default();
        assert_eq!(Reads::new(&known, &readers()).hash(&file).unwrap(), Some(Hash::of(b"new")));
        assert_eq!(known.look(&file.path), None, "a second write may have the same stamp");

        let old = SystemTime::now() - Duration::from_secs(60);
        std::fs::File::options().append(true).open(&file.path).unwrap().set_modified(old).unwrap();
        let stamp = Stamp::of(&file.path).unwrap();
        let as_read = AsRead { stamp, companions: Vec::new(), hash: Hash::of(b"new") };
        known.remember(&file.path, as_read);
        assert_eq!(known.look(&file.path), Some(Some(Hash::of(b"new"))));
        std::fs::write(&file.path, "bad").unwrap();
        assert_eq!(known.look(&file.path), None);
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
        let file = NodeFile { path: folder.path().join("a.obj"), ..at(folder.path().join("a")) };
        let known = Known::default();
        fn read(known: &Known, file: &NodeFile) -> File {
            Reads::new(known, &readers()).file(file).unwrap().unwrap()
        }
        let missing = read(&known, &file);
        assert_eq!(missing.companion("a.mtl"), Err("there is no file `a.mtl`".into()));
        let stamp = Stamp::of(&file.path).unwrap();
        let companions = vec![(folder.path().join("a.mtl"), None)];
        known.remember(&file.path, AsRead { stamp, companions, hash: missing.hash });
        assert_eq!(known.look(&file.path), Some(Some(missing.hash)));
        write("a.mtl", "newmtl a\nmap_Kd a.png\n", &folder);
        assert_eq!(known.look(&file.path), None, "a material has come");
        let bare = read(&known, &file);
        assert_eq!(bare.companion("a.png"), Err("there is no file `a.png`".into()));
        write("a.png", "not yet a picture", &folder);
        let whole = read(&known, &file);
        assert_eq!(whole.companion("a.png").as_deref(), Ok(&b"not yet a picture"[..]));
        let other = [missing.hash, bare.hash, Hash::of(whole.bytes())];
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
        let file = NodeFile { path: folder.path().join("a.obj"), ..at(folder.path().join("a")) };
        std::fs::write(&file.path, text).unwrap();
        let known = Known::default();
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
        let known = Known::default();
        let readers = readers();
        fn is_spared(
            name: &str,
            is_forecast: bool,
            folder: &tempfile::TempDir,
            known: &Known,
            readers: &Readers,
        ) -> bool {
            let file = NodeFile { path: folder.path().join(name), ..at(folder.path().join("a")) };
            let reads = Reads::new(known, readers);
            let reads = if is_forecast { reads.sparing() } else { reads };
            reads.is_spared(&file)
        }
        for (name, expected) in [("large.txt", true), ("a.obj", true), ("b.txt", false)] {
            assert_eq!(
                (
                    is_spared(name, true, &folder, &known, &readers),
                    is_spared(name, false, &folder, &known, &readers)
                ),
                (expected, false),
                "{name}"
            );
        }
    }

    #[test]
    fn a_file_that_is_not_there_is_an_error_only_if_it_is_needed() {
        let file = at("/no/such/folder/a.txt".into());
        let known = Known::default();
        let error = Reads::new(&known, &readers()).hash(&file).unwrap_err();
        assert_eq!(error.to_string(), "cannot read a.txt: there is no such file");
        assert_eq!(
            Reads::new(&known, &readers()).hash(&NodeFile { needed: false, ..file }).unwrap(),
            None
        );
    }
}
