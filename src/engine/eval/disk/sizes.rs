//! What the cache's bytes are of, by node and graph.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use maquette_value::{Hash, plain};

use super::folder::{What, check, contents};
use super::seal::unsealed;
use super::{Disk, DiskError, entry, record};

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
        let size = |((graph, node, kind), (results, bytes))| NodeSize {
            graph,
            node,
            kind,
            results,
            bytes,
        };
        sizes.nodes = nodes.into_iter().map(size).collect();
        sizes.nodes.sort_by_key(|size| std::cmp::Reverse(size.bytes));
        Ok(sizes)
    }
}

/// The folder of the program that kept a file.
fn home(path: &Path) -> PathBuf {
    path.ancestors().nth(2).map_or_else(PathBuf::new, Path::to_owned)
}
