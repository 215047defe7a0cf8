//! What an output tells of where it came from.

use std::path::{Component, Path, PathBuf};

use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, GraphOutput, INPUT, PINNED};
use maquette_node::provenance::{Provenance, Signature, short};
use maquette_syntax::paths::{folder_of_new, project_root, within};
use maquette_value::Hash;
use serde_json::Value as Json;

/// Tells of the outputs of a graph.
pub struct Teller<'a> {
    graph: &'a Graph,
    catalog: &'a Catalog,
    /// The folder of the graph, from which paths in its values lead on.
    folder: PathBuf,
    /// The folder of the project.
    root: PathBuf,
    /// What each node gives is made of: its recipe and those of all that it hangs on. No name and no order counts.
    made: Vec<Hash>,
}

impl<'a> Teller<'a> {
    pub(crate) fn new(graph: &'a Graph, catalog: &'a Catalog) -> Self {
        let folder = folder_of_new(&graph.source().name);
        let root = project_root(&folder);
        let mut made: Vec<Hash> = Vec::with_capacity(graph.nodes().len());
        for node in graph.nodes().iter() {
            // What is given at an input is told beside it.
            let mut content = match node.kind() {
                INPUT => [INPUT, &node.name].concat().into_bytes(),
                _ => node.recipe.identity.0.to_vec(),
            };
            for link in &node.links {
                content.extend_from_slice(&made[link.node].0);
                content.extend_from_slice(&(link.output as u64).to_le_bytes());
            }
            // A recipe does not say which files it reads, except for that of a pin.
            for file in node.files.iter().filter(|_| node.kind() != PINNED) {
                content.extend_from_slice(within(&root, &file.path).as_bytes());
                content.push(0);
            }
            made.push(Hash::of(&content));
        }
        Self { graph, catalog, folder, root, made }
    }

    /// What each node gives is made of.
    pub(super) fn made(self) -> Vec<Hash> {
        self.made
    }

    /// Where an output comes from; `read_by` gives the hashes of the files that a node has read.
    pub(crate) fn provenance<'f>(
        &self,
        output: &GraphOutput,
        read_by: impl Fn(usize) -> &'f [Option<Hash>],
    ) -> Provenance {
        let Self { graph, catalog, root, made, .. } = self;
        let mut told = Provenance {
            maquette: env!("CARGO_PKG_VERSION").into(),
            graph: within(root, &graph.source().name),
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
                told.parameters.insert(name.clone(), self.value(value));
            }
        }
        let needed = graph.shape().needed_by(&[output.node]);
        for (index, node) in graph.nodes().iter().enumerate().filter(|(index, _)| needed[*index]) {
            if node.kind() == PINNED {
                let hash = short(&node.recipe.identity.to_string());
                told.pins.insert(node.name.clone(), hash.into());
                continue;
            }
            for (file, hash) in node.files.iter().zip(read_by(index)) {
                if let Some(hash) = hash {
                    let name = within(root, &file.path);
                    told.files.insert(name, short(&hash.to_string()).into());
                }
            }
            match node.recipe.parameters.get("value").and_then(|value| value.as_str()) {
                Some(hash) if node.kind() == INPUT => {
                    told.inputs.insert(node.name.clone(), short(hash).into());
                }
                _ => {}
            }
            if let Some(entry) = catalog.find(node.kind()) {
                told.packs.insert(entry.pack.to_owned(), entry.version.into());
            }
        }
        let of = [&made[output.node].0[..], &(output.output as u64).to_le_bytes()].concat();
        told.made = short(&Hash::of(&of).to_string());
        told
    }

    /// A parameter's value as it is told: the same for `12` and `12.0`, and of paths that lead out of the project the last name alone.
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
        if file.starts_with(&self.root) { text.to_owned() } else { within(&self.root, &file) }
    }

    /// What is put into the files of an output.
    pub(crate) fn signature<'f>(
        &self,
        output: &GraphOutput,
        read_by: impl Fn(usize) -> &'f [Option<Hash>],
    ) -> Signature {
        sign(&self.provenance(output, read_by))
    }
}

/// The words and their hash.
pub fn sign(told: &Provenance) -> Signature {
    let words = told.words();
    let hash = short(&Hash::of(words.as_bytes()).to_string());
    Signature { words, hash }
}
