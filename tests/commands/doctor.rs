//! `cache doctor` finds any damage to a cache file, and a run after the repair gives the original results.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::output::text_of;
use crate::project::{GRAPHS, Project};

/// A project whose cache has the results of the example graph `doll.ron`. The commands run in the folder of the example graphs.
struct Cache(Project);

impl Cache {
    fn new() -> Self {
        let cache = Self(Project::empty());
        cache.run();
        cache
    }

    fn folder(&self) -> PathBuf {
        self.0.cache().to_owned()
    }

    fn maquette(&self, arguments: &[&str]) -> Output {
        self.0.command(arguments).current_dir(GRAPHS).output().unwrap()
    }

    /// Runs the graph; returns the printed text and the written files.
    fn run(&self) -> (String, Vec<(String, Vec<u8>)>) {
        let out = self.0.folder().join("out");
        let output = self.maquette(&["run", "doll.ron", "--out", out.to_str().unwrap()]);
        assert!(output.status.success() && output.stderr.is_empty(), "{}", text_of(&output));
        let files = fs::read_dir(out).unwrap().map(|file| file.unwrap().path());
        let mut files: Vec<_> = files
            .map(|path: PathBuf| {
                (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(path).unwrap())
            })
            .collect();
        files.sort();
        (text_of(&output), files)
    }

    fn doctor(&self, arguments: &[&str]) -> (Option<i32>, serde_json::Value) {
        let output = self.maquette(&[&["cache", "doctor", "--json"], arguments].concat());
        (output.status.code(), serde_json::from_slice(&output.stdout).unwrap())
    }

    /// Lists the files in all cache folders with this name, or all cache files if the name is empty.
    fn files(&self, what: &str) -> Vec<PathBuf> {
        let mut files = Vec::new();
        let mut folders = vec![self.folder()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(&folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false if what.is_empty() || folder.ends_with(what) => files.push(path),
                    false => {}
                }
            }
        }
        files.sort();
        files
    }

    /// Checks that the doctor finds exactly the damaged files `wrong`, only reports them in a dry run, and repairs them otherwise. After
    /// the repair nothing is damaged, and a run gives the results `before`.
    fn is_mended(&self, wrong: &[&Path], before: &[(String, Vec<u8>)]) {
        let all = self.files("");
        let (code, told) = self.doctor(&["--dry-run"]);
        fn paths(told: &serde_json::Value) -> Vec<PathBuf> {
            let faults = told["faults"].as_array().unwrap().iter();
            faults.map(|fault| PathBuf::from(fault["path"].as_str().unwrap())).collect::<Vec<_>>()
        }
        let found = paths(&told);
        for path in wrong {
            assert!(
                found.contains(&path.to_path_buf()),
                "{} is not found: {told:#}",
                path.display()
            );
        }
        assert_eq!((code, self.files("")), (Some(i32::from(!wrong.is_empty())), all));
        let (code, mended) = self.doctor(&[]);
        assert_eq!((code, paths(&mended)), (Some(0), found));
        let (code, well) = self.doctor(&[]);
        assert_eq!((code, paths(&well)), (Some(0), Vec::new()), "{well:#}");
        assert_eq!(self.run().1, before);
    }
}

fn flip(path: &Path, place: usize) {
    let mut bytes = fs::read(path).unwrap();
    let length = bytes.len();
    bytes[place % length] ^= 1 << (place % 8);
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_cache_that_is_well_stays_as_it_is() {
    let cache = Cache::new();
    let all = cache.files("");
    let (code, told) = cache.doctor(&[]);
    assert_eq!((code, told["faults"].as_array().unwrap().len()), (Some(0), 0), "{told:#}");
    // The number of files does not include `CACHEDIR.TAG`, which marks the folder as a cache.
    assert_eq!(told["files"], all.len() - 1);
    assert_eq!(cache.files(""), all);
    assert!(cache.run().0.contains("15 nodes: 15 cached"));
}

#[test]
fn every_flipped_bit_and_every_cut_is_found_and_mended() {
    let cache = Cache::new();
    let (_, before) = cache.run();
    for round in 0..4 {
        let files = cache.files("");
        let damaged = files
            .iter()
            .enumerate()
            .filter(|(k, _)| round == 3 || k % 3 == round)
            .collect::<Vec<_>>();
        for (k, path) in &damaged {
            let length = fs::metadata(path).unwrap().len();
            match (k + round) % 4 {
                _ if length == 0 => fs::write(path, "x").unwrap(),
                0 => fs::OpenOptions::new()
                    .write(true)
                    .open(path)
                    .unwrap()
                    .set_len(length / 2)
                    .unwrap(),
                1 => fs::write(path, "").unwrap(),
                _ => flip(path, 7919 * (k + 1)),
            }
        }
        let tidied = cache.folder().join("programs/tidied");
        let wrong = damaged.iter().map(|(_, path)| &***path).filter(|path| **path != tidied);
        cache.is_mended(&Vec::from_iter(wrong), &before);
    }
}

#[test]
fn whole_files_under_the_names_of_others_are_found() {
    let cache = Cache::new();
    let (_, before) = cache.run();
    let hash = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    for what in ["entries", "graphs", "outputs", "columns"] {
        let files = cache.files(what);
        let from = &files[0];
        let other = from.with_file_name(hash);
        fs::copy(from, &other).unwrap();
        cache.is_mended(&[&other], &before);
        assert!(!other.exists() && from.exists(), "{what}");
    }
    let entries = cache.files("entries");
    let contents: Vec<_> = entries.iter().map(|path| fs::read(path).unwrap()).collect();
    for (path, content) in entries.iter().zip(contents.iter().cycle().skip(1)) {
        fs::write(path, content).unwrap();
    }
    cache.is_mended(&entries.iter().map(|path| &**path).collect::<Vec<_>>(), &before);
}

#[test]
fn results_without_their_columns_and_columns_without_results_go() {
    let cache = Cache::new();
    let (_, before) = cache.run();
    let columns = cache.files("columns");
    fs::remove_file(&columns[0]).unwrap();
    let (_, told) = cache.doctor(&["--dry-run"]);
    let is_incomplete =
        |fault: &&serde_json::Value| fault["what"].as_str().unwrap().contains("a column");
    let incomplete = told["faults"].as_array().unwrap().iter().filter(is_incomplete);
    let incomplete = incomplete.map(|fault| PathBuf::from(fault["path"].as_str().unwrap()));
    let incomplete = Vec::from_iter(incomplete);
    assert!(!incomplete.is_empty(), "{told:#}");
    cache.is_mended(&incomplete.iter().map(|path| &**path).collect::<Vec<_>>(), &before);
    for entry in cache.files("entries") {
        fs::remove_file(entry).unwrap();
    }
    let columns = cache.files("columns");
    cache.is_mended(&columns.iter().map(|path| &**path).collect::<Vec<_>>(), &before);
}

#[test]
fn what_is_not_ours_is_told_and_stays() {
    let cache = Cache::new();
    let (_, before) = cache.run();
    let home = cache.files("entries")[0].parent().unwrap().parent().unwrap().to_owned();
    let foreign = [
        cache.folder().join("mine.txt"),
        cache.folder().join("programs/film.mov"),
        home.join("entries/.maquette-backup"),
        home.join("mine"),
    ];
    for path in &foreign {
        fs::write(path, "mine").unwrap();
    }
    let left = home.join("columns/.maquette-aB3dE5gH7jK9.part");
    fs::write(&left, "half").unwrap();
    let (code, told) = cache.doctor(&[]);
    assert_eq!(code, Some(0), "{told:#}");
    assert_eq!(told["faults"].as_array().unwrap().len(), 1, "{told:#}");
    let mut paths = foreign.clone().map(|path| path.display().to_string());
    paths.sort();
    assert_eq!(told["foreign"], serde_json::json!(paths));
    assert!(!left.exists());
    for path in &foreign {
        assert_eq!(fs::read(path).unwrap(), b"mine");
    }
    assert_eq!(cache.run().1, before);
    let text = text_of(&cache.maquette(&["cache", "doctor"]));
    assert!(
        text.contains("mine.txt: foreign file") && text.contains("0 faults, 0 mended"),
        "{text}"
    );
}

#[test]
fn results_of_other_programs_are_looked_at_too() {
    let cache = Cache::new();
    let (_, before) = cache.run();
    let home = cache.files("entries")[0].parent().unwrap().parent().unwrap().to_owned();
    let other = home.with_file_name("0123456789abcdef0123456789abcdef");
    fs::rename(&home, &other).unwrap();
    let damaged = [cache.files("entries")[1].clone(), cache.files("columns")[0].clone()];
    damaged.iter().for_each(|path| flip(path, 4711));
    cache.is_mended(&[&damaged[0], &damaged[1]], &before);
}
