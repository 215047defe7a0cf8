//! The provenance of an output: everything from which it was made.

use std::path::{Component, Path, PathBuf};

use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, GraphOutput, INPUT, PINNED};
use maquette_node::provenance::{Provenance, Signature, shorten_hash};
use maquette_syntax::paths::{folder_of_new, project_root, relative_to_root};
use maquette_value::Hash;
use serde_json::Value as Json;

/// Collects the provenance of the outputs of a graph.
pub struct ProvenanceBuilder<'a> {
    graph: &'a Graph,
    catalog: &'a Catalog,
    /// The folder that contains the graph file. Paths in the graph are relative to it.
    folder: PathBuf,
    /// The root folder of the project that contains the graph.
    root: PathBuf,
    /// For each node, a hash of its recipe and of the recipes of all its dependencies. Names and the order of nodes do not change it.
    identities: Vec<Hash>,
}

impl<'a> ProvenanceBuilder<'a> {
    pub(crate) fn new(graph: &'a Graph, catalog: &'a Catalog) -> Self {
        let folder = folder_of_new(&graph.source().name);
        let root = project_root(&folder);
        let mut made: Vec<Hash> = Vec::with_capacity(graph.nodes().len());
        for node in graph.nodes().iter() {
            // Leave out the value of an input node, because provenance lists the values of inputs separately.
            let mut content = match node.kind() {
                INPUT => [INPUT, &node.name].concat().into_bytes(),
                _ => node.recipe.identity.0.to_vec(),
            };
            for link in &node.links {
                content.extend_from_slice(&made[link.node].0);
                content.extend_from_slice(&(link.output as u64).to_le_bytes());
            }
            // Add the path of each file that the node reads. The content is not part of a recipe. Skip a pin, whose recipe already contains
            // the content.
            for file in node.files.iter().filter(|_| node.kind() != PINNED) {
                content.extend_from_slice(relative_to_root(&root, &file.path).as_bytes());
                content.push(0);
            }
            made.push(Hash::compute(&content));
        }
        Self { graph, catalog, folder, root, identities: made }
    }

    /// Returns the hash of each node and its dependencies.
    pub(super) fn into_identities(self) -> Vec<Hash> {
        self.identities
    }

    /// Returns the provenance of an output. `read_by` returns the hashes of the files that a node has read, given the node's index.
    pub(crate) fn provenance<'f>(
        &self,
        output: &GraphOutput,
        files_read_by: impl Fn(usize) -> &'f [Option<Hash>],
    ) -> Provenance {
        let Self { graph, catalog, root, identities: made, .. } = self;
        let mut provenance = Provenance {
            maquette: env!("CARGO_PKG_VERSION").into(),
            graph: relative_to_root(root, &graph.source().name),
            output: output.name.clone(),
            draft: output.lineage.draft,
            set: output
                .lineage
                .set
                .iter()
                .map(|(name, value)| (name.clone(), self.value(value)))
                .collect(),
            ..Provenance::default()
        };
        for name in &output.lineage.parameters {
            let declared = graph.schema()["properties"].get(name);
            if let Some(value) = declared.and_then(|declared| declared.get("default")) {
                provenance.parameters.insert(name.clone(), self.value(value));
            }
        }
        let needed = graph.topology().needed_by(&[output.node]);
        for (index, node) in graph.nodes().iter().enumerate().filter(|(index, _)| needed[*index]) {
            if node.kind() == PINNED {
                let hash = shorten_hash(&node.recipe.identity.to_string());
                provenance.pins.insert(node.name.clone(), hash.into());
                continue;
            }
            for (file, hash) in node.files.iter().zip(files_read_by(index)) {
                if let Some(hash) = hash {
                    let name = relative_to_root(root, &file.path);
                    provenance.files.insert(name, shorten_hash(&hash.to_string()).into());
                }
            }
            match node.recipe.parameters.get("value").and_then(|value| value.as_str()) {
                Some(hash) if node.kind() == INPUT => {
                    provenance.inputs.insert(node.name.clone(), shorten_hash(hash).into());
                }
                _ => {}
            }
            if let Some(entry) = catalog.find(node.kind()) {
                provenance.packs.insert(entry.pack.to_owned(), entry.version.into());
            }
        }
        let source = [&made[output.node].0[..], &(output.output as u64).to_le_bytes()].concat();
        provenance.made = shorten_hash(&Hash::compute(&source).to_string());
        provenance
    }

    /// Returns the value of a parameter in the normal form for provenance: `12` and `12.0` become equal. A path that leads out of the
    /// project is reduced to its file name.
    fn value(&self, value: &Json) -> Json {
        match value {
            Json::String(text) => self.text(text).into(),
            Json::Array(items) => items.iter().map(|item| self.value(item)).collect(),
            Json::Object(fields) => {
                fields.iter().map(|(name, value)| (name.clone(), self.value(value))).collect()
            }
            value => match value.as_f64() {
                Some(number) if number.fract() == 0.0 && number.abs() < 1e15 => {
                    (number as i64).into()
                }
                _ => value.clone(),
            },
        }
    }

    fn text(&self, text: &str) -> String {
        let path = Path::new(text);
        fn climbs(path: &Path) -> bool {
            path.components().any(|part| part == Component::ParentDir)
        }
        if !path.is_absolute() && !climbs(path) {
            return text.to_owned();
        }
        let file = self.folder.join(path);
        let file = folder_of_new(&file).join(file.file_name().unwrap_or_default());
        if file.starts_with(&self.root) {
            text.to_owned()
        } else {
            relative_to_root(&self.root, &file)
        }
    }

    /// Returns the signed provenance of an output, which is written into its files.
    pub(crate) fn signature<'f>(
        &self,
        output: &GraphOutput,
        files_read_by: impl Fn(usize) -> &'f [Option<Hash>],
    ) -> Signature {
        sign(&self.provenance(output, files_read_by))
    }
}

/// Returns the signature of a provenance: its text together with the hash of the text.
pub fn sign(provenance: &Provenance) -> Signature {
    let words = provenance.words();
    let hash = shorten_hash(&Hash::compute(words.as_bytes()).to_string());
    Signature { words, hash }
}
