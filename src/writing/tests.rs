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
    let bytes = Vec::from_iter((0..20_000_000u32).map(|k| (k / 5) as u8));
    for len in [bytes.len(), 17_000_000, 5] {
        let written = write_by(&path, len, |file| {
            let (left, right) = bytes[..len].split_at(len / 2);
            std::thread::scope(|scope| {
                let late = scope.spawn(|| write_at(file, left.len(), right));
                write_at(file, 0, left).and(late.join().unwrap())
            })
        });
        let (stamp, ()) = written.unwrap();
        assert!(stamp.is_some() && stamp == Stamp::of(&path));
        assert!(fs::read(&path).unwrap() == bytes[..len]);
    }
    // What comes to nothing leaves what was there.
    let full = |_: &mut File| Err::<(), _>(io::ErrorKind::StorageFull.into());
    assert!(write_by(&path, bytes.len(), full).is_err());
    assert_eq!(fs::read(&path).unwrap(), bytes[..5]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
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
    let room = ["src/writing", "src/writing.rs"];
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
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut found);
    let tests = Vec::from_iter(found.iter().flat_map(|(path, text)| for_tests(path, text)));
    found.retain(|(path, _)| !tests.iter().any(|test| path.with_extension("").starts_with(test)));
    assert!(found.len() > 100);
    for (path, text) in found {
        for word in WORDS {
            assert!(!text.contains(word), "{} has {word}", path.display());
        }
    }
}
