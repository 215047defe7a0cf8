//! Files by a pattern: `scans/*/range.pcd`.

use std::cmp::Ordering;
use std::fs;
use std::path::{Path, PathBuf};

/// A file that fits a pattern, and what stands for its stars: its own name without its ending, if there are none.
#[derive(Debug, PartialEq)]
pub(super) struct Found {
    pub(super) path: PathBuf,
    pub(super) name: String,
}

/// The greatest number of files that a part of a pattern may fit.
const MAX_FOUND: usize = 100_000;

/// The files and folders that fit a pattern, in the order of their names, in which numbers count as numbers. Hidden ones only fit a
/// pattern with a dot.
///
/// # Errors
/// In words, if it is no pattern, or a folder cannot be read.
pub(super) fn matches(folder: &Path, pattern: &str) -> Result<Vec<Found>, String> {
    let parts: Vec<_> = pattern.split('/').collect();
    if parts.iter().any(|part| part.is_empty()) {
        return Err("a pattern is a path relative to this file, `scans/*/range.pcd`".to_owned());
    }
    if parts.iter().any(|part| part.contains("**")) {
        return Err(
            "`**` is no pattern: write a `*` for each folder between, `scans/*/*.pcd`".to_owned()
        );
    }
    let is_plain = parts.iter().all(|part| !part.contains(['*', '?']));
    let mut found = vec![(folder.to_owned(), Vec::<String>::new())];
    for part in parts {
        let mut next = Vec::new();
        for (path, stars) in found {
            if !part.contains(['*', '?']) {
                let path = path.join(part);
                // So that what is found is called the same from wherever it is looked for.
                let path =
                    if part == ".." { fs::canonicalize(&path).unwrap_or(path) } else { path };
                next.extend(path.exists().then_some((path, stars)));
                continue;
            }
            let unread = |error: std::io::Error| format!("cannot read {}: {error}", path.display());
            let entries = match fs::read_dir(&path) {
                Ok(entries) => entries,
                // A file beside the folders that are meant.
                Err(_) if !path.is_dir() => continue,
                Err(error) => return Err(unread(error)),
            };
            for entry in entries {
                let name = entry.map_err(unread)?.file_name().to_string_lossy().into_owned();
                if name.starts_with('.') && !part.starts_with('.') {
                    continue;
                }
                if let Some(star) = standing_for(part, &name).filter(|_| next.len() <= MAX_FOUND) {
                    let stars = stars.iter().cloned().chain([star]).collect();
                    next.push((path.join(name), stars));
                }
            }
        }
        if MAX_FOUND < next.len() {
            // Links that lead back to a folder above make ever more paths.
            return Err(format!("more than {MAX_FOUND} files fit `{pattern}`: write fewer stars"));
        }
        found = next;
    }
    let mut found: Vec<_> = found
        .into_iter()
        .map(|(path, stars): (PathBuf, Vec<String>)| {
            fn stem(path: &Path) -> String {
                path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
            }
            let name = if is_plain { stem(&path) } else { stars.join("_") };
            Found { path, name }
        })
        .collect();
    found.sort_by(|a, b| natural(&a.name, &b.name).then_with(|| a.path.cmp(&b.path)));
    Ok(found)
}

/// What stands in a name from the first star of a pattern to the last one; none if the name does not fit.
fn standing_for(pattern: &str, name: &str) -> Option<String> {
    fn is_wild(c: char) -> bool {
        c == '*' || c == '?'
    }
    let (pattern, name) = (pattern.chars().collect::<Vec<_>>(), name.chars().collect::<Vec<_>>());
    if !fits(&pattern, &name) {
        return None;
    }
    let before = pattern.iter().take_while(|c| !is_wild(**c)).count();
    let behind = pattern.iter().rev().take_while(|c| !is_wild(**c)).count();
    Some(String::from_iter(&name[before..name.len() - behind]))
}

/// Whether a name fits a pattern: goes back to the last star where it does not.
fn fits(pattern: &[char], name: &[char]) -> bool {
    let (mut at, mut in_name) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while in_name < name.len() {
        match pattern.get(at) {
            Some('*') => {
                star = Some((at, in_name));
                at += 1;
            }
            Some(c) if *c == '?' || *c == name[in_name] => {
                at += 1;
                in_name += 1;
            }
            _ => match &mut star {
                Some((before, taken)) => {
                    *taken += 1;
                    (at, in_name) = (*before + 1, *taken);
                }
                None => return false,
            },
        }
    }
    pattern[at..].iter().all(|c| *c == '*')
}

/// `scan-2` before `scan-10`.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let digits =
            |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let (in_a, in_b) = (digits(a), digits(b));
        if 0 < in_a && 0 < in_b {
            fn number(text: &str) -> String {
                text.trim_start_matches('0').to_owned()
            }
            let (one, other) = (number(&a[..in_a]), number(&b[..in_b]));
            let order = one.len().cmp(&other.len()).then_with(|| one.cmp(&other));
            if order != Ordering::Equal {
                return order;
            }
            (a, b) = (&a[in_a..], &b[in_b..]);
            continue;
        }
        match (a.chars().next(), b.chars().next()) {
            (Some(one), Some(other)) if one == other => {
                (a, b) = (&a[one.len_utf8()..], &b[other.len_utf8()..]);
            }
            (one, other) => return one.cmp(&other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_and_folders_are_found_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let scans = folder.path().join("scans");
        for name in ["doll-10", "doll-2", "doll-1", ".hidden", "empty"] {
            fs::create_dir_all(scans.join(name)).unwrap();
            if name != "empty" {
                fs::write(scans.join(name).join("range.pcd"), "").unwrap();
            }
        }
        fs::write(scans.join("notes.txt"), "").unwrap();
        fn names(pattern: &str, folder: &tempfile::TempDir) -> Vec<String> {
            let found = matches(folder.path(), pattern).unwrap();
            found.into_iter().map(|found| found.name).collect::<Vec<_>>()
        }
        assert_eq!(names("scans/*/range.pcd", &folder), ["doll-1", "doll-2", "doll-10"]);
        assert_eq!(names("scans/doll-*/*.pcd", &folder), ["1_range", "2_range", "10_range"]);
        assert_eq!(names("scans/doll-?", &folder), ["1", "2"]);
        assert_eq!(names("scans/*.txt", &folder), ["notes"]);
        assert_eq!(names("scans/notes.txt", &folder), ["notes"]);
        assert_eq!(names("nowhere/*", &folder), [""; 0]);
        let beside = matches(&scans.join("empty"), "../notes.txt").unwrap();
        assert_eq!(beside[0].path, fs::canonicalize(&scans).unwrap().join("notes.txt"));
        for wrong in ["/etc/*", "scans//a", "scans/**/range.pcd", ""] {
            assert!(matches(folder.path(), wrong).is_err(), "{wrong}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_in_a_circle_come_to_an_end() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a", "b", "c"] {
            fs::create_dir(folder.path().join(name)).unwrap();
            for link in ["up", "same"] {
                std::os::unix::fs::symlink("..", folder.path().join(name).join(link)).unwrap();
            }
        }
        let found = matches(folder.path(), "*/*/..").unwrap();
        assert_eq!(found.len(), 6);
        let many = vec!["*"; 40].join("/");
        assert!(matches(folder.path(), &many).unwrap_err().contains("more than 100000 files"));
        let back = vec!["*/*/*/.."; 20].join("/");
        assert!(matches(folder.path(), &back).is_err_and(|why| why.contains("write fewer stars")));
    }

    #[test]
    fn stars_and_question_marks_stand_for_letters() {
        for (pattern, name, star) in [
            ("*", "", Some("")),
            ("a*b*c", "aXbYbZc", Some("XbYbZ")),
            ("a*b", "ab", Some("")),
            ("a*b", "aXc", None),
            ("?", "ä", Some("ä")),
            ("?", "ab", None),
            ("*.pcd", "a.pcd.bak", None),
        ] {
            assert_eq!(standing_for(pattern, name).as_deref(), star, "{pattern} {name}");
        }
    }
}
