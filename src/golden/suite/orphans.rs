//! Goldens that no test asks for any more. The summary of a golden names the files that belong to it; other files in the folders of goldens
//! are not ours and are left alone. Links are not followed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use maquette_value::Hash;
use maquette_value::plain;

use super::{FOLDER, NODES, SUFFIXES, beside, jobs_of};
use crate::case;
use crate::case::TestFile;
use crate::store::kept_in;

/// The goldens in a folder by name, each with its files.
pub(super) fn goldens(folder: &Path) -> BTreeMap<String, Vec<PathBuf>> {
    let mut goldens = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let file = entry.file_name().to_string_lossy().into_owned();
        let Some(name) = file.strip_suffix(".txt").filter(|_| file != NODES) else { continue };
        let summary = plain::read_own_text(&entry.path()).ok();
        if let Some(suffixes) = summary.and_then(|summary| suffixes(&summary)) {
            let files = suffixes.iter().map(|suffix| folder.join(format!("{name}{suffix}")));
            goldens.insert(name.to_owned(), files.filter(|file| plain::is_own(file)).collect());
        }
    }
    goldens
}

/// What follows the name of a golden in the names of its files, as its summary says; none if the text is no summary.
fn suffixes(summary: &str) -> Option<Vec<&'static str>> {
    let facts = || summary.lines().filter_map(|line| line.split_once("  "));
    let fact = |label: &str| facts().find(|(name, _)| *name == label).map(|(_, fact)| fact.trim());
    fact("type")?;
    Hash::parse(fact("hash")?)?;
    let named: Vec<_> = SUFFIXES
        .into_iter()
        .filter(|suffix| facts().any(|(name, _)| name == kept_in(suffix)))
        .collect();
    if !named.is_empty() {
        return Some([&[".txt"], &named[..]].concat());
    }
    // Goldens of the earlier form say only how much they keep.
    Some(match fact("kept") {
        Some(kept) if kept.ends_with("pixel") => vec![".txt", ".png"],
        Some("every 1. element") => vec![".txt", ".bin"],
        Some(_) => vec![".txt", ".bin", ".view.png"],
        None => vec![".txt"],
    })
}

/// Goldens in folders that no test beside them claims. Whose goldens they are is not known while a test beside them cannot be read:
/// then there are none.
pub(super) fn unclaimed(tests: &[TestFile]) -> Vec<PathBuf> {
    let folders: BTreeSet<&Path> = tests.iter().map(beside).collect();
    let mut orphans = Vec::new();
    for folder in folders {
        let Some(claimed) = claimed(folder) else { continue };
        walk(&folder.join(FOLDER), &mut |folder| {
            if !claimed.contains(folder) {
                let mut files: Vec<_> = goldens(folder).into_values().flatten().collect();
                let nodes = folder.join(NODES);
                if !files.is_empty() && plain::is_own(&nodes) {
                    files.push(nodes);
                }
                orphans.append(&mut files);
            }
        });
    }
    orphans.sort();
    orphans
}

/// The folders of goldens of all tests in a folder, also of those that are not run now; none if one of them cannot be read.
fn claimed(folder: &Path) -> Option<BTreeSet<PathBuf>> {
    let mut claimed = BTreeSet::new();
    for file in fs::read_dir(if folder == Path::new("") { Path::new(".") } else { folder }).ok()? {
        let path = folder.join(file.ok()?.file_name());
        if path.to_string_lossy().ends_with(case::ENDING) {
            claimed.extend(jobs_of(&case::skim(&path)?).into_iter().map(|job| job.folder));
        }
    }
    Some(claimed)
}

/// A folder and all inside of it.
fn walk(folder: &Path, found: &mut impl FnMut(&Path)) {
    if !fs::symlink_metadata(folder).is_ok_and(|metadata| metadata.is_dir()) {
        return;
    }
    found(folder);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        walk(&entry.path(), found);
    }
}
