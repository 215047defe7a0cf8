//! The cache folder contains only files that the program made; other files and folders in it are left alone.

use std::fs;
use std::path::Path;

use super::project::{Project, everything, wait};
use crate::output::text_of;

const OTHER_TAG: &str = "Signature: 8a477f597d28d172789f06886806bc55\n# This file is a cache directory tag created by cargo.\n";

#[test]
fn a_folder_of_the_user_is_no_cache() {
    let project = Project::new();
    let hash = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    project.write("programs/film.mov", "large");
    project.write(&format!("programs/{hash}"), "mine");
    project.write("0123456789abcdef0123456789abcdef/entries/mine.txt", "mine");
    for tag in [None, Some(OTHER_TAG)] {
        if let Some(tag) = tag {
            project.write("CACHEDIR.TAG", tag);
        }
        let before = project.everything("");
        for arguments in [
            &["cache", "gc", "--limit", "0", "--cache", "."][..],
            &["cache", "clear", "--cache", "."],
            &["cache", "doctor", "--cache", "."],
            &["cache", "ls", "--cache", "."],
            &["run", "net.ron", "--cache", "."],
        ] {
            let output = project.maquette(arguments);
            assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text_of(&output));
            assert!(
                text_of(&output).contains("is not a cache of maquette"),
                "{arguments:?}: {}",
                text_of(&output)
            );
            assert_eq!(project.everything(""), before, "{arguments:?}");
        }
    }
}

#[test]
fn what_others_keep_in_the_cache_folder_stays() {
    let project = Project::new();
    assert!(project.maquette(&["run", "net.ron"]).status.success());
    let cache = project.root().join("cache");
    let home = fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path());
    let home = home.into_iter().find(|path| path.join("entries").is_dir()).unwrap();
    project.write_outside("home/entries/0123", "secret");
    let hash = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    project.write_outside(&format!("home/columns/{hash}"), "secret");
    let other = "0123456789abcdef0123456789abcdef";
    std::os::unix::fs::symlink(project.root().join("home"), cache.join(other)).unwrap();
    fs::create_dir(cache.join(other.replace('0', "1"))).unwrap();
    std::os::unix::fs::symlink(
        project.root().join("home/columns"),
        cache.join(other.replace('0', "1")).join("columns"),
    )
    .unwrap();
    let foreign = [
        home.join("entries/notes.txt"),
        home.join("columns/.maquette-backup"),
        home.join("mine"),
        cache.join("programs/film.mov"),
        cache.join("mine"),
        cache.join(format!("{other}.txt")),
    ];
    for path in &foreign {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "mine").unwrap();
    }
    let outside = project.everything_outside();
    for arguments in
        [&["cache", "gc", "--limit", "0"][..], &["cache", "doctor"], &["cache", "clear"]]
    {
        let output = project.maquette(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", text_of(&output));
        for path in &foreign {
            assert_eq!(fs::read(path).unwrap(), b"mine", "{arguments:?} {}", path.display());
        }
        assert_eq!(project.everything_outside(), outside, "{arguments:?}");
    }
    let left = everything(&cache, &[]);
    // The foreign files, two links and the cache tag remain.
    assert_eq!(left.len(), foreign.len() + 3, "{:?}", left.keys());
}

#[test]
fn a_relative_folder_of_the_system_is_ignored() {
    let project = Project::new();
    let mut command = project.command(&["cache", "ls"]);
    command.env_remove("MAQUETTE_CACHE").env("XDG_CACHE_HOME", "here").env("HOME", "/home/of");
    let output = wait(command);
    assert!(text_of(&output).starts_with("/home/of"), "{}", text_of(&output));
}

/// Only root can give a folder to another user; for other users the test is skipped.
#[test]
fn a_cache_of_another_user_is_refused() {
    let project = Project::new();
    let cache = project.root().join("theirs");
    fs::create_dir(&cache).unwrap();
    if std::os::unix::fs::chown(&cache, Some(4711), None).is_err() {
        assert!(!is_root(&cache), "root gives files away");
        return;
    }
    let output = project.maquette(&["run", "net.ron", "--cache", cache.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", text_of(&output));
    assert!(text_of(&output).contains("belongs to another user"), "{}", text_of(&output));
    assert_eq!(fs::read_dir(&cache).unwrap().count(), 0);
    let output =
        project.command(&["run", "net.ron"]).env("MAQUETTE_CACHE", &cache).output().unwrap();
    assert!(output.status.success());
    assert_eq!(fs::read_dir(&cache).unwrap().count(), 0);
}

fn is_root(path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).unwrap().uid() == 0
}
