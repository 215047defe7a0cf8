//! What a graph is made of, before anything is run: by this a result that lies on disk is known to be its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette_graph::Graph;
use maquette_graph::files::{KnownFile, NodeFile, Reads};
use maquette_syntax::paths::{project_root, within};
use maquette_value::Hash;

use super::Session;
use super::provenance::Teller;
use crate::eval::Disk;

/// The files that a graph reads.
#[derive(Default)]
pub struct ReadFiles {
    /// The hash of each, by its path in the project; none for one that is not there.
    pub by_name: BTreeMap<String, Option<Hash>>,
    /// What the system said of them, so that they need not be read again.
    pub as_read: Vec<KnownFile>,
    /// The first one that was not read, in a forecast.
    pub unread: Option<String>,
}

impl Session {
    /// The id of this build of the program with its packs.
    pub fn build(&self) -> String {
        let of_disk = self.evaluator.disk().map(Disk::program);
        of_disk.unwrap_or_else(|| env!("CARGO_PKG_VERSION").to_owned())
    }

    /// Takes over what the system said of files when they were read last.
    pub fn know(&self, files: Vec<KnownFile>) {
        self.evaluator.known_files().extend(files);
    }

    /// The files that a graph reads with these files at its inputs; none if one cannot be read. A forecast reads no large ones.
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
        let inputs: Vec<_> =
            inputs.iter().map(|(_, path)| NodeFile::given(path, [root.clone()].into())).collect();
        let known = self.evaluator.known_files();
        let reads = Reads::new(known, graph.readers());
        let reads = if is_forecast { reads.sparing() } else { reads };
        let all = graph.nodes().iter().flat_map(|node| &node.files).chain(&inputs);
        let mut files = ReadFiles::default();
        for file in all.clone() {
            if reads.is_spared(file) {
                files.unread.get_or_insert_with(|| within(&root, &file.path));
                continue;
            }
            let hash = match reads.hash(file) {
                Ok(hash) => hash,
                // It is known that there is none: when there is one, that is a change.
                Err(_) if file.missing.is_some() && !file.path.exists() => None,
                Err(_) => return None,
            };
            files.by_name.insert(within(&root, &file.path), hash);
        }
        files.as_read = known.of(all.map(|file| &*file.path));
        Some(files)
    }

    /// The hash of what a graph computes and expects, whatever is in the files that it reads.
    pub fn made_of(&self, graph: &Graph) -> Hash {
        let made = self.made_of_nodes(graph);
        let files = graph.outputs().iter().map(|it| (&it.name[..], it.node, it.output));
        let ports = graph.ports().iter().filter_map(|port| {
            let (node, output) = graph.value_named(&port.name)?;
            Some((&port.name[..], node, output))
        });
        let mut words = String::new();
        for (name, node, output) in files.chain(ports) {
            words += &format!("{name:?} {} {output}\n", made[node]);
        }
        for expected in graph.expected(&Vec::from_iter(0..graph.nodes().len())) {
            let values: Vec<_> = expected
                .values
                .iter()
                .map(|at| at.map(|(node, output)| (made[node], output)))
                .collect();
            words += &format!("{:?} {values:?}\n", expected.expectation);
        }
        Hash::of(words.as_bytes())
    }

    /// The same of each node.
    pub fn made_of_nodes(&self, graph: &Graph) -> Vec<Hash> {
        Teller::new(graph, &self.catalog).made()
    }
}
