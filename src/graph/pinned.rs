//! Nodes that return stored results. They replace pinned nodes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_node::{AnyNode, Context, FilePath, bail};
use maquette_syntax::error::{Diagnostic, Error, Severity, Source, code};
use maquette_value::{AnyValue, Hash, ValueType};
use serde_json::json;

use crate::files::NodeFile;
use crate::load::load_text;
use crate::pins::{PINNED, Pin, Pins, bytes};
use crate::recipe::Recipe;
use crate::world::World;
use crate::{Files, GraphNode, Options};

impl World<'_> {
    /// Reads the pins of the graph, if the options enable pins.
    pub(crate) fn read_pins(&mut self, graph: &Path) {
        if self.options.pins {
            match Pins::read(graph) {
                Ok(pins) => self.pins = Arc::new(pins),
                Err(diagnostic) => self.diagnostics.push(*diagnostic),
            }
        }
    }

    /// Reports pins whose results were not computed from the current nodes. Must be called before pinned nodes are replaced.
    pub(crate) fn report_stale_pins(&mut self, nodes: &[GraphNode], graph: &Source) {
        let pins = self.pins.clone();
        if pins.pins.is_empty() {
            return;
        }
        let stale = match self.options.draft {
            false => self.stale_pins(&pins, nodes),
            // Compare with the graph for final results: pinned results are final, so a draft does not make them stale.
            true => {
                let options = Options { draft: false, ..self.options.clone() };
                let finals =
                    load_text(&graph.name, graph.text.clone(), self.catalog, &options).diagnostics;
                finals.into_iter().filter(|diagnostic| diagnostic.code == code::PIN).collect()
            }
        };
        self.diagnostics.extend(stale);
    }

    /// Replaces pinned nodes by their stored results.
    pub(crate) fn insert_pinned_nodes(&mut self, nodes: &mut [GraphNode]) {
        let pins = self.pins.clone();
        for pin in &pins.pins {
            let Some(index) = nodes.iter().position(|node| node.name == *pin.0) else { continue };
            match self.pinned_node(&nodes[index], pin, &pins) {
                Ok(node) => nodes[index] = node,
                Err(diagnostic) => self.diagnostics.push(*diagnostic),
            }
        }
    }

    fn stale_pins(&self, pins: &Pins, nodes: &[GraphNode]) -> Vec<Diagnostic> {
        fn place(name: &String, nodes: &[GraphNode]) -> Option<usize> {
            nodes.iter().position(|node| node.name == *name)
        }
        let stale = pins.pins.iter().filter_map(|(name, pin)| match place(name, nodes) {
            None => {
                let message = format!("`{name}` is pinned, but the graph has no such node");
                let help =
                    "remove the pin with `maquette pin --remove`, or restore the name of the node";
                let diagnostic = pins.diagnostic(pin.span, code::PIN, message, help.into());
                Some(Diagnostic { severity: Severity::Warning, ..diagnostic })
            }
            Some(index) => {
                let change = pin.ancestry.change(nodes, index, self.catalog.readers())?;
                let message = format!("`{name}` is pinned before {change}");
                let help = "the old result is used; pin the node again, or remove the pin with `maquette pin --remove`";
                Some(nodes[index].diagnostic(Severity::Warning, code::PIN, message, help))
            }
        });
        stale.collect()
    }

    /// Creates the node that replaces a pinned node.
    fn pinned_node(
        &mut self,
        node: &GraphNode,
        (name, pin): (&String, &Pin),
        pins: &Pins,
    ) -> Result<GraphNode, Box<Diagnostic>> {
        fn error(code: &'static str, message: String, node: &GraphNode) -> Box<Diagnostic> {
            let help = "pin the node again, or remove the pin with `maquette pin --remove`";
            Box::new(node.diagnostic(Severity::Error, code, message, help))
        }
        let kept = pin
            .outputs
            .iter()
            .map(|(kind, hash)| Some((*self.values.get(&kind[..])?, *hash)))
            .collect::<Option<Vec<_>>>();
        let Some(kept) = kept.filter(|kept| {
            kept.len() == node.outputs.len()
                && node.types.iter().zip(kept).all(|(kind, (kept, _)): (&Option<_>, &(_, _))| {
                    kind.is_none_or(|it| it == *kept)
                })
        }) else {
            let now = node.types.iter().flatten().map(|kind| kind.name);
            let [was, now] =
                [pin.outputs.iter().map(|(kind, _)| &kind[..]).collect(), now.collect()]
                    .map(|kinds: Vec<&str>| kinds.join(", "));
            let message = format!("`{name}` is pinned with {was}, and gives {now} now");
            return Err(error(code::WRONG_TYPE, message, node));
        };
        let path = pin.file(&pins.folder);
        let folder = pins.folder.file_name().unwrap_or_default().to_string_lossy();
        let given = format!("{folder}/{}", path.file_name().unwrap_or_default().to_string_lossy());
        if self.options.files == Files::Needed && !path.is_file() {
            self.files.push(crate::ReadFile { path, node: name.clone(), optional: false });
            let message = format!("`{name}` is pinned, but its result {given} does not exist");
            return Err(error(code::MISSING_FILE, message, node));
        }
        let hashes: Vec<_> = kept.iter().map(|(_, hash)| hash.to_string()).collect();
        let file = NodeFile { given: given.clone(), ..NodeFile::from_path(&path, Arc::default()) };
        Ok(GraphNode {
            recipe: Arc::new(Recipe::new(PINNED, json!({ "outputs": hashes }), &[])),
            types: kept.iter().map(|(kind, _)| Some(*kind)).collect(),
            node: Arc::new(PinnedNode { kept, file: file.path.clone(), given }),
            pack: "",
            links: Vec::new(),
            files: vec![file],
            guards: Vec::new(),
            ..node.clone()
        })
    }
}

/// A node that returns stored values.
pub(crate) struct PinnedNode {
    kept: Vec<(&'static ValueType, Hash)>,
    file: PathBuf,
    /// The path of the file with the stored values, as it appears in messages.
    given: String,
}

impl AnyNode for PinnedNode {
    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        let file = cx.files.get(&self.file).and_then(Option::as_ref);
        let Some(values) = file.and_then(|file| bytes::read(file.bytes(), &self.kept)) else {
            bail!(
                "its pinned result {} is damaged, or kept by another version of maquette: restore the file, pin the node again, or remove the pin with `maquette pin --remove`",
                self.given
            );
        };
        Ok(values)
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({}))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}
