#[cfg(target_os = "linux")]
use std::os::fd::AsRawFd;

use super::*;

#[test]
fn a_file_is_replaced_atomically_and_its_stamp_is_returned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a/b.txt");
    for text in ["one", "two"] {
        let stamp = write_whole(&path, text.as_bytes()).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
        assert!(stamp.is_some() && stamp == FileStat::read(&path));
    }
    assert_eq!(fs::read_dir(folder.path().join("a")).unwrap().count(), 1);
}

#[test]
fn a_large_file_is_written_from_many_threads_and_replaces_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.bin");
    let bytes: Vec<_> = (0..20_000_000u32).map(|k| (k / 5) as u8).collect();
    for len in [bytes.len(), 17_000_000, 5] {
        let written = write_by(&path, len, PreviousFiles::<()>::default(), |file, _| {
            let (left, right) = bytes[..len].split_at(len / 2);
            std::thread::scope(|scope| {
                let late = scope.spawn(|| write_at(file, left.len(), right));
                write_at(file, 0, left).and(late.join().unwrap())
            })
        });
        let stamp = written.unwrap().stamp;
        assert!(stamp.is_some() && stamp == FileStat::read(&path));
        assert!(fs::read(&path).unwrap() == bytes[..len]);
    }
    // A write that fails must leave the old file.
    let fail = |_: &mut File, _: Option<&()>| Err::<(), _>(io::ErrorKind::StorageFull.into());
    assert!(write_by(&path, bytes.len(), PreviousFiles::default(), fail).is_err());
    assert_eq!(fs::read(&path).unwrap(), bytes[..5]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// A large file, filled with one byte value, which is written repeatedly.
#[cfg(target_os = "linux")]
struct RewrittenFile {
    folder: tempfile::TempDir,
    path: PathBuf,
    last: PreviousFiles<u8>,
}

#[cfg(target_os = "linux")]
impl RewrittenFile {
    const LEN: usize = 17 << 20;

    /// Writes a file twice, so that a recycled file exists. Returns `None` on systems where files cannot be overwritten.
    #[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
    fn new() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        if !recycled_file::is_open_only_here(temporary::create(folder.path()).unwrap().as_file()) {
            println!("skipped: the file system of temporary files has no leases");
            return None;
        }
        let path = folder.path().join("large.bin");
        let mut repeated = Self { folder, path, last: PreviousFiles::default() };
        assert_eq!([repeated.write(1), repeated.write(2)], [None; 2]);
        Some(repeated)
    }

    /// Writes the file, filled with `byte`. Returns the old byte value of the recycled file, or `None` if no recycled file was overwritten.
    fn write(&mut self, byte: u8) -> Option<u8> {
        let last = std::mem::take(&mut self.last);
        let written =
            write_by(&self.path, Self::LEN, last, |file: &mut File, there: Option<&u8>| {
                let there = there.copied();
                if let Some(there) = there {
                    assert!(
                        fs::read(format!("/proc/self/fd/{}", file.as_raw_fd()))?
                            .iter()
                            .all(|it| *it == there)
                    );
                }
                write_at(file, 0, &vec![byte; Self::LEN])?;
                Ok(there)
            })
            .unwrap();
        assert_eq!(written.stamp, FileStat::read(&self.path));
        assert!(self.holds(byte));
        self.last = PreviousFiles {
            there: written.stamp.map(|stamp| (stamp, byte)),
            recycled: written.recycled,
        };
        written.result
    }

    fn holds(&self, byte: u8) -> bool {
        fs::read(&self.path).unwrap() == vec![byte; Self::LEN]
    }

    /// Returns the path of the recycled file: the replaced version that is kept next to the file.
    fn spare(&self) -> PathBuf {
        let entries = fs::read_dir(self.folder.path()).unwrap().map(|entry| entry.unwrap().path());
        entries.into_iter().find(|path| is_temporary(path)).unwrap()
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_large_file_overwrites_the_version_before_the_last() {
    let Some(mut file) = RewrittenFile::new() else { return };
    assert_eq!([3, 4, 5].map(|byte| file.write(byte)), [Some(1), Some(2), Some(3)]);
    assert!(!is_abandoned(&file.spare()), "it is ours");
    sweep(file.folder.path());
    assert_eq!(file.write(6), Some(4));
    let spare = file.spare();
    file.last = PreviousFiles::default();
    assert!(!spare.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn files_in_use_elsewhere_are_not_overwritten() {
    // Case: the recycled file is open, for reading or as a memory map.
    let Some(mut file) = RewrittenFile::new() else { return };
    let open = File::open(file.spare()).unwrap();
    assert_eq!(file.write(3), None);
    let mut seen = Vec::new();
    io::Read::read_to_end(&mut &open, &mut seen).unwrap();
    assert!(seen == vec![1; RewrittenFile::LEN], "a reader sees what it has opened");
    drop(open);
    // Case: the file has a second name (a hard link), made before or after it was replaced.
    let Some(mut file) = RewrittenFile::new() else { return };
    let copy = file.folder.path().join("copy.bin");
    fs::hard_link(file.spare(), &copy).unwrap();
    assert_eq!(file.write(3), None);
    assert!(fs::read(&copy).unwrap() == vec![1; RewrittenFile::LEN]);
    fs::remove_file(&copy).unwrap();
    fs::hard_link(&file.path, &copy).unwrap();
    assert_eq!([file.write(4), file.write(5)], [Some(2), None]);
    assert!(fs::read(&copy).unwrap() == vec![3; RewrittenFile::LEN]);
}

#[cfg(target_os = "linux")]
#[test]
fn files_changed_by_others_are_not_recycled() {
    // Case: another program changes the file at its path.
    let Some(mut file) = RewrittenFile::new() else { return };
    write_at(&File::options().write(true).open(&file.path).unwrap(), 5, b"x").unwrap();
    assert_eq!(file.write(3), Some(1));
    assert_eq!([file.write(4), file.write(5)], [None, Some(3)]);
    // Case: another program changes the recycled file after it was replaced.
    let Some(mut file) = RewrittenFile::new() else { return };
    write_at(&File::options().write(true).open(file.spare()).unwrap(), 5, b"x").unwrap();
    assert_eq!(file.write(3), None);
    // Cases: the file at the path was removed, another program has put a different file there, or the folder does not exist.
    let Some(mut file) = RewrittenFile::new() else { return };
    fs::remove_file(&file.path).unwrap();
    assert_eq!(file.write(3), Some(1));
    fs::write(&file.path, "mine").unwrap();
    assert_eq!([file.write(4), file.write(5)], [None; 2]);
    fs::remove_dir_all(file.folder.path()).unwrap();
    assert_eq!([file.write(6), file.write(7), file.write(8)], [None, None, Some(6)]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_failed_overwrite_leaves_the_old_file() {
    let Some(mut file) = RewrittenFile::new() else { return };
    let last = std::mem::take(&mut file.last);
    let full = |half: &mut File, _: Option<&u8>| {
        write_at(half, 0, b"half")?;
        Err::<(), _>(io::ErrorKind::StorageFull.into())
    };
    assert!(write_by(&file.path, RewrittenFile::LEN, last, full).is_err());
    assert!(file.holds(2));
    assert_eq!(fs::read_dir(file.folder.path()).unwrap().count(), 1);
}

#[test]
fn files_being_written_differ_from_abandoned_ones() {
    let folder = tempfile::tempdir().unwrap();
    let busy = temporary::create(folder.path()).unwrap();
    assert!(is_temporary(busy.path()) && !is_abandoned(busy.path()));
    sweep(folder.path());
    assert!(busy.path().exists());
    let (_, path) = busy.keep().unwrap();
    assert!(is_abandoned(&path));
    sweep(folder.path());
    assert!(!path.exists());
}

#[test]
fn concurrent_writing_and_sweeping_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    std::thread::scope(|scope| {
        for writer in 0..4 {
            let path = folder.path().join(format!("{writer}.txt"));
            let folder = folder.path();
            scope.spawn(move || {
                for round in 0..200 {
                    sweep(folder);
                    let text = format!("{writer} {round}");
                    write_whole(&path, text.as_bytes()).unwrap();
                    assert_eq!(fs::read_to_string(&path).unwrap(), text);
                }
            });
        }
    });
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4);
}

/// Collects the source files below a folder, except those of the module `writing`. Cuts off the tests at the end of each file.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    let room = ["engine/writing", "engine/writing.rs"];
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if room.iter().any(|room| path.ends_with(room)) {
            continue;
        }
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let own = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default().to_owned();
            found.push((path, own));
        }
    }
}

/// Returns the files of the modules that a source file declares under `#[cfg(test)]`.
fn test_modules(path: &Path, text: &str) -> Vec<PathBuf> {
    let declared = text.split("#[cfg(test)]\nmod ").skip(1);
    let names = declared.filter_map(|rest| Some(rest.split_once(';')?.0));
    names.map(|name| path.with_extension("").join(name)).collect()
}

#[test]
fn nothing_is_written_or_removed_elsewhere() {
    const WORDS: [&str; 12] = [
        "fs::write(",
        "fs::remove_",
        "fs::rename(",
        "fs::copy(",
        "fs::create_dir",
        "fs::set_permissions(",
        "fs::hard_link(",
        "File::create",
        "File::options",
        "OpenOptions",
        "tempfile::",
        ".set_modified(",
    ];
    let mut found = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join(".."), &mut found);
    let tests: Vec<_> = found.iter().flat_map(|(path, text)| test_modules(path, text)).collect();
    found.retain(|(path, _)| !tests.iter().any(|test| path.with_extension("").starts_with(test)));
    assert!(found.len() > 100);
    for (path, text) in found {
        for word in WORDS {
            assert!(!text.contains(word), "{} has {word}", path.display());
        }
    }
}
