//! The identity of a graph: a hash that is known before anything is run. It shows whether a result on disk belongs to the graph.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_graph::Graph;
use maquette_graph::files::{KnownFile, NodeFile, Reads};
use maquette_syntax::paths::{project_root, relative_to_root};
use maquette_value::Hash;

use super::Session;
use super::provenance::ProvenanceBuilder;
use crate::eval::Disk;

/// The files that a graph reads, with their hashes and metadata.
#[derive(Default)]
pub struct ReadFiles {
    /// The hash of each file, by the path of the file in the project. `None` for a missing file.
    pub by_name: BTreeMap<String, Option<Hash>>,
    /// The metadata (stamps) of the files. A file whose metadata has not changed need not be read again.
    pub stamps: Vec<KnownFile>,
    /// The first file that was skipped, because it is large and forecasts do not read large files; `None` if no file was skipped.
    pub first_unread: Option<String>,
}

impl Session {
    /// Returns an identifier of this build of the program and its packs.
    pub fn build(&self) -> String {
        let of_disk = self.evaluator.disk().map(Disk::program);
        of_disk.unwrap_or_else(|| env!("CARGO_PKG_VERSION").to_owned())
    }

    /// Adds the metadata and hashes of files that were read earlier, so that unchanged files need not be read again.
    pub fn remember_files(&self, files: Vec<KnownFile>) {
        self.evaluator.known_files().extend(files);
    }

    /// Returns the files that a graph reads, including `inputs`: the files that contain the values of the graph's inputs. Returns `None` if
    /// one of the files cannot be read. In a forecast, large files are skipped.
    pub fn files_of(
        &self,
        graph: &Graph,
        inputs: &[(String, PathBuf)],
        is_forecast: bool,
    ) -> Option<ReadFiles> {
        fn folder(file: &Path) -> PathBuf {
            match file.parent() {
                Some(folder) if folder != Path::new("") => folder.to_owned(),
                _ => PathBuf::from("."),
            }
        }
        let root = project_root(&folder(&graph.source().name));
        let inputs: Vec<_> = inputs
            .iter()
            .map(|(_, path)| NodeFile::from_path(path, [root.clone()].into()))
            .collect();
        let known = self.evaluator.known_files();
        let reads = Reads::new(known, graph.readers());
        let reads = if is_forecast { reads.with_forecast_limit() } else { reads };
        let all = graph.nodes().iter().flat_map(|node| &node.files).chain(&inputs);
        let mut files = ReadFiles::default();
        for file in all.clone() {
            if reads.is_too_large_for_forecast(file) {
                files.first_unread.get_or_insert_with(|| relative_to_root(&root, &file.path));
                continue;
            }
            let hash = match reads.hash(file) {
                Ok(hash) => hash,
                // Not an error: the graph was loaded without this file. If the file appears later, the graph counts as changed.
                Err(_) if file.missing.is_some() && !file.path.exists() => None,
                Err(_) => return None,
            };
            files.by_name.insert(relative_to_root(&root, &file.path), hash);
        }
        files.stamps = known.get_all(all.map(|file| &*file.path));
        Some(files)
    }

    /// Returns a hash of everything that a graph computes and expects. The hash does not depend on the contents of the files that the graph
    /// reads.
    pub fn graph_identity(&self, graph: &Graph) -> Hash {
        let made = self.node_identities(graph);
        let files = graph.outputs().iter().map(|it| (&it.name[..], it.node, it.output));
        let ports = graph.ports().iter().filter_map(|port| {
            let (node, output) = graph.find_value(&port.name)?;
            Some((&port.name[..], node, output))
        });
        let mut words = String::new();
        for (name, node, output) in files.chain(ports) {
            words += &format!("{name:?} {} {output}\n", made[node]);
        }
        for expected in graph.expectations_for(&Vec::from_iter(0..graph.nodes().len())) {
            let values: Vec<_> = expected
                .values
                .iter()
                .map(|at| at.map(|(node, output)| (made[node], output)))
                .collect();
            words += &format!("{:?} {values:?}\n", expected.expectation);
        }
        Hash::compute(words.as_bytes())
    }

    /// For each node, returns a hash of the node and all its dependencies. The hashes do not depend on the contents of files.
    pub fn node_identities(&self, graph: &Graph) -> Vec<Hash> {
        ProvenanceBuilder::new(graph, &self.catalog).into_identities()
    }
}
