//! Finds orphans: goldens that no test uses. The files of a golden are listed in its summary. Other files in the folders of goldens are
//! ignored, and links are not followed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use maquette_value::Hash;

use super::{GOLDENS_FOLDER, NODES_FILE, SUFFIXES, jobs_of, test_folder};
use crate::case;
use crate::case::TestFile;
use crate::store::file_label;

/// Returns the goldens in a folder, by name. Each has the paths of its files.
pub(super) fn goldens(folder: &Path) -> BTreeMap<String, Vec<PathBuf>> {
    let mut goldens = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let file = entry.file_name().to_string_lossy().into_owned();
        let Some(name) = file.strip_suffix(".txt").filter(|_| file != NODES_FILE) else { continue };
        let summary = maquette_value::fs::read_text_no_follow(&entry.path()).ok();
        if let Some(suffixes) = summary.and_then(|summary| suffixes(&summary)) {
            let files = suffixes.iter().map(|suffix| folder.join(format!("{name}{suffix}")));
            goldens.insert(
                name.to_owned(),
                files.filter(|file| maquette_value::fs::is_regular_file(file)).collect(),
            );
        }
    }
    goldens
}

/// Returns the suffixes of a golden's files, as its summary lists them. Returns `None` if the text is not the summary of a golden.
fn suffixes(summary: &str) -> Option<Vec<&'static str>> {
    let lines = summary.lines().filter_map(|line| line.split_once("  "));
    let facts: BTreeMap<&str, &str> = lines.map(|(name, fact)| (name, fact.trim())).collect();
    facts.get("type")?;
    Hash::parse(facts.get("hash")?)?;
    let named: Vec<_> =
        SUFFIXES.into_iter().filter(|suffix| facts.contains_key(&file_label(suffix)[..])).collect();
    if !named.is_empty() {
        return Some([&[".txt"], &named[..]].concat());
    }
    // A golden in the earlier format does not list its files. It only states how much of the value it stores.
    Some(match facts.get("kept").copied() {
        Some(kept) if kept.ends_with("pixel") => vec![".txt", ".png"],
        Some("every 1. element") => vec![".txt", ".bin"],
        Some(_) => vec![".txt", ".bin", ".view.png"],
        None => vec![".txt"],
    })
}

/// Returns the unused goldens in the folders next to the given tests: those that no test uses. If a test next to a folder cannot be read,
/// its goldens are unknown, so nothing in that folder is returned.
pub(super) fn unclaimed_goldens(tests: &[TestFile]) -> Vec<PathBuf> {
    let folders: BTreeSet<&Path> = tests.iter().map(test_folder).collect();
    let mut orphans = Vec::new();
    for folder in folders {
        let Some(claimed) = claimed_folders(folder) else { continue };
        walk(&folder.join(GOLDENS_FOLDER), &mut |folder| {
            if !claimed.contains(folder) {
                let mut files: Vec<_> = goldens(folder).into_values().flatten().collect();
                let nodes = folder.join(NODES_FILE);
                if !files.is_empty() && maquette_value::fs::is_regular_file(&nodes) {
                    files.push(nodes);
                }
                orphans.append(&mut files);
            }
        });
    }
    orphans.sort();
    orphans
}

/// Returns the folders of goldens that belong to the tests in a folder, including tests that are not run now. Returns `None` if one of the
/// tests cannot be read.
fn claimed_folders(folder: &Path) -> Option<BTreeSet<PathBuf>> {
    let mut claimed = BTreeSet::new();
    for file in fs::read_dir(if folder == Path::new("") { Path::new(".") } else { folder }).ok()? {
        let path = folder.join(file.ok()?.file_name());
        if path.to_string_lossy().ends_with(case::EXTENSION) {
            claimed.extend(jobs_of(&case::skim(&path)?).into_iter().map(|job| job.folder));
        }
    }
    Some(claimed)
}

/// Calls `found` for a folder and all of its subfolders.
fn walk(folder: &Path, found: &mut impl FnMut(&Path)) {
    if !fs::symlink_metadata(folder).is_ok_and(|metadata| metadata.is_dir()) {
        return;
    }
    found(folder);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        walk(&entry.path(), found);
    }
}
