#[cfg(target_os = "linux")]
use std::os::fd::AsRawFd;

use super::*;

#[test]
fn a_file_is_replaced_whole_and_its_stamp_is_that_of_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a/b.txt");
    for text in ["one", "two"] {
        let stamp = write_whole(&path, text.as_bytes()).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
        assert!(stamp.is_some() && stamp == Stamp::of(&path));
    }
    assert_eq!(fs::read_dir(folder.path().join("a")).unwrap().count(), 1);
}

#[test]
fn a_large_file_is_written_from_many_threads_and_replaces_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.bin");
    let bytes: Vec<_> = (0..20_000_000u32).map(|k| (k / 5) as u8).collect();
    for len in [bytes.len(), 17_000_000, 5] {
        let written = write_by(&path, len, Last::<()>::default(), |file, _| {
            let (left, right) = bytes[..len].split_at(len / 2);
            std::thread::scope(|scope| {
                let late = scope.spawn(|| write_at(file, left.len(), right));
                write_at(file, 0, left).and(late.join().unwrap())
            })
        });
        let stamp = written.unwrap().stamp;
        assert!(stamp.is_some() && stamp == Stamp::of(&path));
        assert!(fs::read(&path).unwrap() == bytes[..len]);
    }
    // What comes to nothing leaves what was there.
    let full = |_: &mut File, _: Option<&()>| Err::<(), _>(io::ErrorKind::StorageFull.into());
    assert!(write_by(&path, bytes.len(), Last::default(), full).is_err());
    assert_eq!(fs::read(&path).unwrap(), bytes[..5]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// A file that is written again and again, full of one byte, and what comes of it.
#[cfg(target_os = "linux")]
struct Repeated {
    folder: tempfile::TempDir,
    path: PathBuf,
    last: Last<u8>,
}

#[cfg(target_os = "linux")]
impl Repeated {
    const LEN: usize = 17 << 20;

    /// A file that has been written twice, so that there is a spare one; none where files cannot be written over.
    #[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
    fn new() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        if !spare::is_open_only_here(temporary::create(folder.path()).unwrap().as_file()) {
            println!("skipped: the file system of temporary files has no leases");
            return None;
        }
        let path = folder.path().join("large.bin");
        let mut repeated = Self { folder, path, last: Last::default() };
        assert_eq!([repeated.write(1), repeated.write(2)], [None; 2]);
        Some(repeated)
    }

    /// Gives what was in the file that was written over, if there was one.
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
        assert_eq!(written.stamp, Stamp::of(&self.path));
        assert!(self.holds(byte));
        self.last = Last { there: written.stamp.map(|stamp| (stamp, byte)), spare: written.spare };
        written.told
    }

    fn holds(&self, byte: u8) -> bool {
        fs::read(&self.path).unwrap() == vec![byte; Self::LEN]
    }

    /// The name of the spare file.
    fn spare(&self) -> PathBuf {
        let entries = fs::read_dir(self.folder.path()).unwrap().map(|entry| entry.unwrap().path());
        entries.into_iter().find(|path| is_temporary(path)).unwrap()
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_large_file_is_written_over_the_last_but_one_and_goes_with_its_process() {
    let Some(mut file) = Repeated::new() else { return };
    assert_eq!([3, 4, 5].map(|byte| file.write(byte)), [Some(1), Some(2), Some(3)]);
    assert!(!is_abandoned(&file.spare()), "it is ours");
    sweep(file.folder.path());
    assert_eq!(file.write(6), Some(4));
    let spare = file.spare();
    file.last = Last::default();
    assert!(!spare.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn what_somebody_else_can_see_is_not_written_over() {
    // Open when it is replaced, to be read or to be mapped.
    let Some(mut file) = Repeated::new() else { return };
    let open = File::open(file.spare()).unwrap();
    assert_eq!(file.write(3), None);
    let mut seen = Vec::new();
    io::Read::read_to_end(&mut &open, &mut seen).unwrap();
    assert!(seen == vec![1; Repeated::LEN], "a reader sees what it has opened");
    drop(open);
    // Under another name, from before it was replaced or after.
    let Some(mut file) = Repeated::new() else { return };
    let copy = file.folder.path().join("copy.bin");
    fs::hard_link(file.spare(), &copy).unwrap();
    assert_eq!(file.write(3), None);
    assert!(fs::read(&copy).unwrap() == vec![1; Repeated::LEN]);
    fs::remove_file(&copy).unwrap();
    fs::hard_link(&file.path, &copy).unwrap();
    assert_eq!([file.write(4), file.write(5)], [Some(2), None]);
    assert!(fs::read(&copy).unwrap() == vec![3; Repeated::LEN]);
}

#[cfg(target_os = "linux")]
#[test]
fn what_somebody_else_has_changed_is_not_believed() {
    // At once, in its place.
    let Some(mut file) = Repeated::new() else { return };
    write_at(&File::options().write(true).open(&file.path).unwrap(), 5, b"x").unwrap();
    assert_eq!(file.write(3), Some(1));
    assert_eq!([file.write(4), file.write(5)], [None, Some(3)]);
    // After it was replaced.
    let Some(mut file) = Repeated::new() else { return };
    write_at(&File::options().write(true).open(file.spare()).unwrap(), 5, b"x").unwrap();
    assert_eq!(file.write(3), None);
    // Another file, a link, nothing, or no folder in its place.
    let Some(mut file) = Repeated::new() else { return };
    fs::remove_file(&file.path).unwrap();
    assert_eq!(file.write(3), Some(1));
    fs::write(&file.path, "mine").unwrap();
    assert_eq!([file.write(4), file.write(5)], [None; 2]);
    fs::remove_dir_all(file.folder.path()).unwrap();
    assert_eq!([file.write(6), file.write(7), file.write(8)], [None, None, Some(6)]);
}

#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_written_over_a_spare_file_leaves_what_was_there() {
    let Some(mut file) = Repeated::new() else { return };
    let last = std::mem::take(&mut file.last);
    let full = |half: &mut File, _: Option<&u8>| {
        write_at(half, 0, b"half")?;
        Err::<(), _>(io::ErrorKind::StorageFull.into())
    };
    assert!(write_by(&file.path, Repeated::LEN, last, full).is_err());
    assert!(file.holds(2));
    assert_eq!(fs::read_dir(file.folder.path()).unwrap().count(), 1);
}

#[test]
fn a_file_that_is_being_written_is_known_from_one_that_was_left() {
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
fn many_writers_and_sweepers_of_one_folder_lose_nothing() {
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

/// The sources of `src` outside of `writing`, each without its tests at the end.
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

/// The modules that a source declares under `#[cfg(test)]`, as paths.
fn for_tests(path: &Path, text: &str) -> Vec<PathBuf> {
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
    let tests: Vec<_> = found.iter().flat_map(|(path, text)| for_tests(path, text)).collect();
    found.retain(|(path, _)| !tests.iter().any(|test| path.with_extension("").starts_with(test)));
    assert!(found.len() > 100);
    for (path, text) in found {
        for word in WORDS {
            assert!(!text.contains(word), "{} has {word}", path.display());
        }
    }
}
