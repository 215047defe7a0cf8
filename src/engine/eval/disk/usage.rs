//! How much the cache holds, of which nodes and graphs it is, and what goes when that is too much.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use maquette_value::{Hash, plain};

use super::folder::{Found, PROGRAMS, TIDIED, What, check, contents};
use super::seal::unsealed;
use super::{Disk, DiskError, FOLDERS, Store, entry, record};
use crate::writing::{is_abandoned, remove, remove_empty, write_whole};

/// What the cache holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Results.
    pub entries: usize,
    /// Large columns of results.
    pub columns: usize,
    /// Graphs whose last evaluation is remembered.
    pub graphs: usize,
    /// Programs, or builds of one, that kept something here.
    pub programs: usize,
    /// All files together.
    pub bytes: u64,
}

/// The results of one node in a cache.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeSize {
    /// The graph's file; none if no graph is known to have given the results last.
    pub graph: Option<PathBuf>,
    /// The name of the node there.
    pub node: Option<String>,
    /// Its type; empty if it is unknown.
    pub kind: String,
    /// The number of results.
    pub results: usize,
    /// Their bytes. A column that several have counts once.
    pub bytes: u64,
}

/// All bytes of a cache.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
    /// The largest first.
    pub nodes: Vec<NodeSize>,
    /// The bytes of files that are not of results.
    pub other: u64,
}

/// The graph, the node's name and its type.
type Owner = (Option<PathBuf>, Option<String>, String);

impl Disk {
    /// What a cache folder holds, of all programs.
    ///
    /// # Errors
    /// If the folder is there and is not a cache of ours.
    pub fn usage(folder: &Path) -> Result<Usage, DiskError> {
        check(folder)?;
        let contents = contents(folder);
        let mut usage = Usage { programs: contents.homes.len(), ..Usage::default() };
        for found in contents.files {
            usage.bytes += found.bytes;
            match found.what {
                What::Kept("entries") => usage.entries += 1,
                What::Kept("columns") => usage.columns += 1,
                What::Kept("graphs") => usage.graphs += 1,
                _ => {}
            }
        }
        Ok(usage)
    }

    /// Drops the files that were not used for longest, until at most `limit` bytes are left, and what a killed process left
    /// half written. Gives the number of bytes that went. What is not ours stays.
    ///
    /// # Errors
    /// If the folder is there and is not a cache of ours, or files that should go cannot be removed; the others are gone then.
    pub fn gc(folder: &Path, limit: u64) -> Result<u64, DiskError> {
        check(folder)?;
        let contents = contents(folder);
        let mut files = contents.files;
        let mut bytes: u64 = files.iter().map(|found| found.bytes).sum();
        let before = bytes;
        let mut kept = None;
        files.sort_by_key(|found| std::cmp::Reverse(found.used));
        while let Some(Found { path, what, bytes: size, .. }) = files.pop() {
            let goes = match what {
                What::Temporary => is_abandoned(&path),
                _ => limit < bytes,
            };
            if !goes {
                continue;
            }
            match remove(&path) {
                Ok(()) => bytes -= size,
                // Another process was quicker.
                Err(error) if error.kind() == ErrorKind::NotFound => bytes -= size,
                Err(error) => {
                    let (count, _) = kept.get_or_insert((0, error));
                    *count += 1;
                }
            }
        }
        for home in contents.homes {
            // Those of programs that are long gone.
            FOLDERS.iter().for_each(|name| remove_empty(&home.join(name)));
            remove_empty(&home);
        }
        let folder = folder.to_owned();
        kept.map_or(Ok(before - bytes), |(count, error)| {
            Err(DiskError::Kept { folder, count, error })
        })
    }
}

impl Store {
    /// Looks after the cache's size, once in a while.
    pub(super) fn tidy(&self) {
        let written = self.written.swap(0, Ordering::Relaxed);
        let stamp = self.folder.join(PROGRAMS).join(TIDIED);
        let last = fs::metadata(&stamp).and_then(|metadata| metadata.modified()).ok();
        let age = last.and_then(|last| SystemTime::now().duration_since(last).ok());
        let due = age.is_none_or(|age| Duration::from_secs(3600) < age);
        if self.trouble.get().is_none() && 0 < written && (due || self.limit / 32 < written) {
            // First, so that other processes need not do the same.
            let _ = write_whole(&stamp, b"");
            let _ = Disk::gc(&self.folder, self.limit);
        }
    }
}

impl Disk {
    /// Returns the sizes of the results in a cache folder, of all programs. Results that a graph gave last are its node's, others are
    /// known by the types of their nodes.
    ///
    /// # Errors
    /// If the folder is there and is not a cache of ours.
    pub fn sizes(folder: &Path) -> Result<Sizes, DiskError> {
        check(folder)?;
        let mut files = contents(folder).files;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        let mut owners: HashMap<(PathBuf, Hash), Owner> = HashMap::new();
        let mut columns: HashMap<PathBuf, u64> = HashMap::new();
        let mut sizes = Sizes::default();
        for found in &files {
            match found.what {
                What::Kept("graphs") => {
                    sizes.other += found.bytes;
                    let bytes = plain::read_own(&found.path).ok();
                    let record = bytes.and_then(|bytes| unsealed(&found.path, bytes));
                    let owned = record.and_then(|record| record::owned(&record));
                    let Some((graph, nodes)) = owned else { continue };
                    for (key, name, kind) in nodes {
                        let owner = (graph.clone(), Some(name), kind);
                        owners.entry((home(&found.path), key)).or_insert(owner);
                    }
                }
                What::Kept("columns") => drop(columns.insert(found.path.clone(), found.bytes)),
                What::Kept("entries") => {}
                _ => sizes.other += found.bytes,
            }
        }
        let mut nodes: BTreeMap<Owner, (usize, u64)> = BTreeMap::new();
        for found in files.iter().filter(|found| found.what == What::Kept("entries")) {
            let (kind, named) = entry::summary(&found.path).unwrap_or_default();
            let home = home(&found.path);
            let name = found.path.file_name().and_then(|name| name.to_str());
            let key = name.and_then(Hash::parse);
            let owner = key.and_then(|key| owners.get(&(home.clone(), key)).cloned());
            let (results, bytes) = nodes.entry(owner.unwrap_or((None, None, kind))).or_default();
            let own = named.iter().filter_map(|column| {
                columns.remove(&home.join("columns").join(column.to_string()))
            });
            *results += 1;
            *bytes += found.bytes + own.sum::<u64>();
        }
        sizes.other += columns.values().sum::<u64>();
        sizes.nodes = nodes
            .into_iter()
            .map(|((graph, node, kind), (results, bytes))| NodeSize {
                graph,
                node,
                kind,
                results,
                bytes,
            })
            .collect();
        sizes.nodes.sort_by_key(|size| std::cmp::Reverse(size.bytes));
        Ok(sizes)
    }
}

/// The folder of the program that kept a file.
fn home(path: &Path) -> PathBuf {
    path.ancestors().nth(2).map_or_else(PathBuf::new, Path::to_owned)
}
