//! Nodes that stand in for pinned ones, and give what was kept.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_node::{AnyNode, Context, FilePath};
use maquette_syntax::error::{Error, Problem, Severity, Source, code};
use maquette_value::{AnyValue, Hash, ValueType};
use serde_json::json;

use crate::files::NodeFile;
use crate::load::load_text;
use crate::pins::{PINNED, Pin, Pins, bytes};
use crate::recipe::Recipe;
use crate::world::World;
use crate::{Files, GraphNode, Options};

impl World<'_> {
    /// Reads the pins of the graph, if they are to be used.
    pub(crate) fn read_pins(&mut self, graph: &Path) {
        if self.options.pins {
            match Pins::of(graph) {
                Ok(pins) => self.pins = Arc::new(pins),
                Err(problem) => self.problems.push(*problem),
            }
        }
    }

    /// Says which kept results were computed from something else than these nodes say, in which no pins have been put yet.
    pub(crate) fn judge_pins(&mut self, nodes: &[GraphNode], graph: &Source) {
        let pins = self.pins.clone();
        if pins.pins.is_empty() {
            return;
        }
        let stale = match self.options.draft {
            false => self.stale(&pins, nodes),
            // Pins are of final results: a draft does not make them stale.
            true => {
                let options = Options { draft: false, ..self.options.clone() };
                let finals =
                    load_text(&graph.name, graph.text.clone(), self.catalog, &options).problems;
                finals.into_iter().filter(|problem| problem.code == code::PIN).collect()
            }
        };
        self.problems.extend(stale);
    }

    /// Puts kept results in the place of their nodes.
    pub(crate) fn put_pins(&mut self, nodes: &mut [GraphNode]) {
        let pins = self.pins.clone();
        for pin in &pins.pins {
            let Some(index) = nodes.iter().position(|node| node.name == *pin.0) else { continue };
            match self.stand_in(&nodes[index], pin, &pins) {
                Ok(node) => nodes[index] = node,
                Err(problem) => self.problems.push(*problem),
            }
        }
    }

    fn stale(&self, pins: &Pins, nodes: &[GraphNode]) -> Vec<Problem> {
        fn place(name: &String, nodes: &[GraphNode]) -> Option<usize> {
            nodes.iter().position(|node| node.name == *name)
        }
        let stale = pins.pins.iter().filter_map(|(name, pin)| match place(name, nodes) {
            None => {
                let message = format!("`{name}` is pinned, but the graph has no such node");
                let help =
                    "take the pin away with `maquette unpin`, or give the node its name again";
                let problem = pins.problem(pin.span, code::PIN, message, help.into());
                Some(Problem { severity: Severity::Warning, ..problem })
            }
            Some(index) => {
                let change = pin.ancestry.change(nodes, index, self.catalog.readers())?;
                let message = format!("`{name}` is pinned before {change}");
                let help = "it is used as it was: pin it again, or unpin it";
                Some(nodes[index].problem(Severity::Warning, code::PIN, message, help))
            }
        });
        stale.collect()
    }

    /// What stands in the place of a node whose result is pinned.
    fn stand_in(
        &mut self,
        node: &GraphNode,
        (name, pin): (&String, &Pin),
        pins: &Pins,
    ) -> Result<GraphNode, Box<Problem>> {
        fn error(code: &'static str, message: String, node: &GraphNode) -> Box<Problem> {
            let help = "pin it again, or unpin it";
            Box::new(node.problem(Severity::Error, code, message, help))
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
            let message = format!("`{name}` is pinned, but its result {given} is not there");
            return Err(error(code::MISSING_FILE, message, node));
        }
        let hashes: Vec<_> = kept.iter().map(|(_, hash)| hash.to_string()).collect();
        let file = NodeFile { given: given.clone(), ..NodeFile::given(&path, Arc::default()) };
        Ok(GraphNode {
            recipe: Arc::new(Recipe::new(PINNED, json!({ "outputs": hashes }), &[])),
            types: kept.iter().map(|(kind, _)| Some(*kind)).collect(),
            node: Arc::new(Pinned { kept, file: file.path.clone(), given }),
            pack: "",
            links: Vec::new(),
            files: vec![file],
            guards: Vec::new(),
            ..node.clone()
        })
    }
}

/// Gives the values that were kept.
pub(crate) struct Pinned {
    kept: Vec<(&'static ValueType, Hash)>,
    file: PathBuf,
    /// Its file, as people are told of it.
    given: String,
}

/// The values of a pin are not what they were.
#[derive(Clone, Debug, thiserror::Error)]
#[error(
    "its pinned result {0} is damaged, or kept by another version of maquette: put the file back, pin the node again, or unpin it"
)]
struct Damaged(String);

impl AnyNode for Pinned {
    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        let file = cx.files.get(&self.file).and_then(Option::as_ref);
        let values = file.and_then(|file| bytes::read(file.bytes(), &self.kept));
        values.ok_or_else(|| Damaged(self.given.clone()).into())
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({}))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}
