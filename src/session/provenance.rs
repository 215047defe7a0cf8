//! What an output tells of where it came from.

use std::path::{Path, PathBuf};

use serde_json::Map;

use crate::catalog::Catalog;
use crate::graph::{Graph, GraphOutput, INPUT};
use crate::paths::{project_root, within};
use crate::provenance::{Provenance, Signature, short};
use crate::value::Hash;

/// Tells of the outputs of a graph.
pub(crate) struct Teller<'a> {
    graph: &'a Graph,
    catalog: &'a Catalog,
    /// The folder of the project.
    root: PathBuf,
}

impl<'a> Teller<'a> {
    pub(crate) fn new(graph: &'a Graph, catalog: &'a Catalog) -> Self {
        let folder = graph.source.name.parent().filter(|folder| *folder != Path::new(""));
        Self { graph, catalog, root: project_root(folder.unwrap_or(Path::new("."))) }
    }

    /// Where an output comes from; `read_by` gives the hashes of the files that a node has read.
    pub(crate) fn provenance<'f>(
        &self,
        output: &GraphOutput,
        read_by: impl Fn(usize) -> &'f [Option<Hash>],
    ) -> Provenance {
        let Self { graph, catalog, root } = self;
        let mut told = Provenance {
            maquette: env!("CARGO_PKG_VERSION").into(),
            graph: within(root, &graph.source.name),
            output: output.name.clone(),
            draft: output.lineage.draft,
            set: Map::from_iter(output.lineage.set.clone()),
            ..Provenance::default()
        };
        for name in &output.lineage.parameters {
            let declared = graph.schema["properties"].get(name);
            if let Some(value) = declared.and_then(|declared| declared.get("default")) {
                told.parameters.insert(name.clone(), value.clone());
            }
        }
        let needed = graph.shape.needed_by(&[output.node]);
        // Its place among the nodes that are needed stands for a node, so that a name counts for nothing.
        let mut places = vec![0_u64; graph.nodes.len()];
        let mut count = 0;
        let mut content = (output.output as u64).to_le_bytes().to_vec();
        for (index, node) in graph.nodes.iter().enumerate().filter(|(index, _)| needed[*index]) {
            places[index] = count;
            count += 1;
            content.extend_from_slice(&node.recipe.identity.0);
            for link in &node.links {
                content.extend_from_slice(&places[link.node].to_le_bytes());
                content.extend_from_slice(&(link.output as u64).to_le_bytes());
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
                told.packs.insert(entry.pack.to_owned(), entry.node.version.into());
            }
        }
        told.made = short(&Hash::of(&content).to_string());
        told
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
pub(crate) fn sign(told: &Provenance) -> Signature {
    let words = told.words();
    let hash = short(&Hash::of(words.as_bytes()).to_string());
    Signature { words, hash }
}
