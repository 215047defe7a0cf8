//! Finds files by a pattern such as `scans/*/range.pcd`.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// A file or folder that matches a pattern, and the part of its path that the wildcards match. Without wildcards in the pattern, that part
/// is the file name without extension.
#[derive(Debug, PartialEq)]
pub(super) struct MatchedPath {
    pub(super) path: PathBuf,
    pub(super) name: String,
}

/// The maximum number of files that may match each part of a pattern.
const MAX_FOUND: usize = 100_000;

/// Returns the files and folders that match a pattern, sorted in natural order. A hidden file matches only if the pattern also begins with
/// a dot.
///
/// # Errors
/// A message if the pattern is invalid or a folder cannot be read.
pub(super) fn matches(folder: &Path, pattern: &str) -> Result<Vec<MatchedPath>, String> {
    let parts: Vec<_> = pattern.split('/').collect();
    if parts.iter().any(|part| part.is_empty()) {
        return Err("expected a path relative to this file, such as `scans/*/range.pcd`".to_owned());
    }
    if parts.iter().any(|part| part.contains("**")) {
        return Err(
            "unsupported pattern `**`: write a `*` for each folder, such as `scans/*/*.pcd`"
                .to_owned(),
        );
    }
    let is_plain = parts.iter().all(|part| !part.contains(['*', '?']));
    let mut found = vec![(folder.to_owned(), Vec::<String>::new())];
    for part in parts {
        let mut next = Vec::new();
        for (path, stars) in found {
            if !part.contains(['*', '?']) {
                let path = path.join(part);
                // Resolve a path that contains `..`, so that a file is always found under the same path.
                let path =
                    if part == ".." { fs::canonicalize(&path).unwrap_or(path) } else { path };
                next.extend(path.exists().then_some((path, stars)));
                continue;
            }
            let entries = match fs::read_dir(&path) {
                Ok(entries) => entries,
                // Skip a file next to matching folders: a file has no entries that could match the next part of the pattern.
                Err(_) if !path.is_dir() => continue,
                Err(error) => return Err(read_error(&path, &error)),
            };
            for entry in entries {
                let name = entry
                    .map_err(|error| read_error(&path, &error))?
                    .file_name()
                    .to_string_lossy()
                    .into_owned();
                if name.starts_with('.') && !part.starts_with('.') {
                    continue;
                }
                if let Some(star) = wildcard_text(part, &name).filter(|_| next.len() <= MAX_FOUND) {
                    let stars = stars.iter().cloned().chain([star]).collect();
                    next.push((path.join(name), stars));
                }
            }
        }
        if MAX_FOUND < next.len() {
            // The cause may be a link to a parent folder, which leads to an unlimited number of paths.
            return Err(format!(
                "more than {MAX_FOUND} files match `{pattern}`: use fewer wildcards"
            ));
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
            MatchedPath { path, name }
        })
        .collect();
    found.sort_by(|a, b| natural_order(&a.name, &b.name).then_with(|| a.path.cmp(&b.path)));
    Ok(found)
}

/// Returns the error message about a folder that cannot be read.
fn read_error(folder: &Path, error: &io::Error) -> String {
    format!("cannot read {}: {error}", folder.display())
}

/// Returns the part of a name that the pattern matches from its first to its last wildcard. Returns `None` if the name does not match.
fn wildcard_text(pattern: &str, name: &str) -> Option<String> {
    fn is_wild(c: char) -> bool {
        c == '*' || c == '?'
    }
    let (pattern, name) = (pattern.chars().collect::<Vec<_>>(), name.chars().collect::<Vec<_>>());
    if !matches_pattern(&pattern, &name) {
        return None;
    }
    let before = pattern.iter().take_while(|c| !is_wild(**c)).count();
    let behind = pattern.iter().rev().take_while(|c| !is_wild(**c)).count();
    Some(String::from_iter(&name[before..name.len() - behind]))
}

/// Returns true if a name matches a pattern. After a mismatch, goes back to the last `*`.
fn matches_pattern(pattern: &[char], name: &[char]) -> bool {
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

/// Compares names in natural order, in which `scan-2` is before `scan-10`.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        fn leading_digits(text: &str) -> usize {
            text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len()
        }
        let (in_a, in_b) = (leading_digits(a), leading_digits(b));
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
    fn files_and_folders_are_found_in_natural_order() {
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
    fn cyclic_links_terminate() {
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
        assert!(
            matches(folder.path(), &back).is_err_and(|why| why.contains("use fewer wildcards"))
        );
    }

    #[test]
    fn wildcards_match_characters() {
        for (pattern, name, star) in [
            ("*", "", Some("")),
            ("a*b*c", "aXbYbZc", Some("XbYbZ")),
            ("a*b", "ab", Some("")),
            ("a*b", "aXc", None),
            ("?", "ä", Some("ä")),
            ("?", "ab", None),
            ("*.pcd", "a.pcd.bak", None),
        ] {
            assert_eq!(wildcard_text(pattern, name).as_deref(), star, "{pattern} {name}");
        }
    }
}
