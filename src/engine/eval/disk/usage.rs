//! Measures the size of a cache by node and graph, and removes old files.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use maquette_value::Hash;

use super::folder::{CacheFile, FileKind, PROGRAMS, TIDIED, check, contents};
use super::seal::unseal;
use super::{Disk, DiskError, FOLDERS, Store, entry, record};
use crate::writing::{is_abandoned, remove, remove_empty, write_whole};

/// The numbers of results, columns, graphs and builds in a cache, and the size of all files.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// The number of stored results.
    pub entries: usize,
    /// The number of large columns of results.
    pub columns: usize,
    /// The number of graphs for which the cache has a record of the last evaluation.
    pub graphs: usize,
    /// The number of builds of the program that have stored results.
    pub programs: usize,
    /// The size of all files, in bytes.
    pub bytes: u64,
}

/// The number and size of the results of one node in a cache.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeSize {
    /// The path of the graph file. `None` if the results are not the last results of a known graph.
    pub graph: Option<PathBuf>,
    /// The name of the node in the graph. `None` if it is unknown.
    pub node: Option<String>,
    /// The type of the node; empty if unknown.
    pub kind: String,
    /// The number of stored results of the node.
    pub results: usize,
    /// The size of the results, in bytes. A column that several results share counts once.
    pub bytes: u64,
}

/// The sizes of all results in a cache.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
    /// The sizes by node, the largest first.
    pub nodes: Vec<NodeSize>,
    /// The size of files that are not results, in bytes.
    pub other: u64,
}

/// The graph file, the name and the type of the node that computed a result.
type Owner = (Option<PathBuf>, Option<String>, String);

impl Disk {
    /// Counts the files in a cache folder, for all builds of the program.
    ///
    /// # Errors
    /// If the folder exists and is not a cache.
    pub fn usage(folder: &Path) -> Result<Usage, DiskError> {
        check(folder)?;
        let contents = contents(folder);
        let mut usage = Usage { programs: contents.homes.len(), ..Usage::default() };
        for found in contents.files {
            usage.bytes += found.bytes;
            match found.kind {
                FileKind::Stored("entries") => usage.entries += 1,
                FileKind::Stored("columns") => usage.columns += 1,
                FileKind::Stored("graphs") => usage.graphs += 1,
                _ => {}
            }
        }
        Ok(usage)
    }

    /// Drops the least recently used files until at most `limit` bytes are left. Also drops files that a killed process left unfinished.
    /// Returns the number of bytes removed. Files that do not belong to the cache are not touched.
    ///
    /// # Errors
    /// If the folder exists and is not a cache, or if some files cannot be removed. In the second case the other files have been removed.
    pub fn gc(folder: &Path, limit: u64) -> Result<u64, DiskError> {
        check(folder)?;
        let contents = contents(folder);
        let mut files = contents.files;
        let mut bytes: u64 = files.iter().map(|found| found.bytes).sum();
        let before = bytes;
        let mut kept = None;
        files.sort_by_key(|found| std::cmp::Reverse(found.last_use));
        while let Some(CacheFile { path, kind, bytes: size, .. }) = files.pop() {
            let goes = match kind {
                FileKind::Temporary => is_abandoned(&path),
                _ => limit < bytes,
            };
            if !goes {
                continue;
            }
            match remove(&path) {
                Ok(()) => bytes -= size,
                // Another process has already removed the file.
                Err(error) if error.kind() == ErrorKind::NotFound => bytes -= size,
                Err(error) => {
                    let (count, _) = kept.get_or_insert((0, error));
                    *count += 1;
                }
            }
        }
        for home in contents.homes {
            // Remove the folders of builds that have no results left.
            FOLDERS.iter().for_each(|name| remove_empty(&home.join(name)));
            remove_empty(&home);
        }
        let folder = folder.to_owned();
        kept.map_or(Ok(before - bytes), |(count, error)| {
            Err(DiskError::NotRemoved { folder, count, error })
        })
    }
}

impl Store {
    /// Applies the size limit of the cache. Does so at most once an hour, or earlier if this process has written more than 1/32 of the
    /// limit since.
    pub(super) fn tidy(&self) {
        let written = self.written.swap(0, Ordering::Relaxed);
        let stamp = self.folder.join(PROGRAMS).join(TIDIED);
        let last = fs::metadata(&stamp).and_then(|metadata| metadata.modified()).ok();
        let age = last.and_then(|last| SystemTime::now().duration_since(last).ok());
        let due = age.is_none_or(|age| Duration::from_secs(3600) < age);
        if self.write_error.get().is_none() && 0 < written && (due || self.limit / 32 < written) {
            // Set the time of the last cleanup before the cleanup itself, so that other processes skip theirs.
            let _ = write_whole(&stamp, b"");
            let _ = Disk::gc(&self.folder, self.limit);
        }
    }
}

impl Disk {
    /// Returns the sizes of the results in a cache folder, for all builds. The last results of a graph are listed by node; all other
    /// results are listed by node type.
    ///
    /// # Errors
    /// If the folder exists and is not a cache.
    pub fn sizes(folder: &Path) -> Result<Sizes, DiskError> {
        check(folder)?;
        let mut files = contents(folder).files;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        let mut owners: HashMap<(PathBuf, Hash), Owner> = HashMap::new();
        let mut columns: HashMap<PathBuf, u64> = HashMap::new();
        let mut sizes = Sizes::default();
        for found in &files {
            match found.kind {
                FileKind::Stored("graphs") => {
                    sizes.other += found.bytes;
                    let bytes = maquette_value::fs::read_no_follow(&found.path).ok();
                    let record = bytes.and_then(|bytes| unseal(&found.path, bytes));
                    let owned = record.and_then(|record| record::read_owners(&record));
                    let Some((graph, nodes)) = owned else { continue };
                    for (key, name, kind) in nodes {
                        let owner = (graph.clone(), Some(name), kind);
                        owners.entry((home(&found.path), key)).or_insert(owner);
                    }
                }
                FileKind::Stored("columns") => {
                    columns.insert(found.path.clone(), found.bytes);
                }
                FileKind::Stored("entries") => {}
                _ => sizes.other += found.bytes,
            }
        }
        let mut nodes: BTreeMap<Owner, (usize, u64)> = BTreeMap::new();
        for found in files.iter().filter(|found| found.kind == FileKind::Stored("entries")) {
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

/// Returns the folder of the build that wrote a cache file.
fn home(path: &Path) -> PathBuf {
    path.ancestors().nth(2).map_or_else(PathBuf::new, Path::to_owned)
}
