//! Graphs whose number of nodes depends on data: a `ForEach` iterates over the components of labels, the points of a cloud or the parts of
//! a mesh.
//!
//! Such a graph is checked with one example node, which represents all elements. After the data have been computed, the graph is expanded
//! again with the actual numbers of elements. Equal nodes have equal cache keys, so nothing is computed twice.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use maquette_node::{AnyNode, Context, FilePath, bail};
use maquette_syntax::Tree;
use maquette_syntax::error::{Diagnostic, Error};
use maquette_value::{AnyValue, Encoder, Hash, Memo, NoElements};
use serde_json::json;

use super::Graph;
use super::expand::expand;
use super::recipe::Recipe;
use crate::catalog::Catalog;
use crate::definition::{BuiltNode, Elements, ParsedFile};
use crate::flat::{Count, Counts, Loop};
use crate::graph::Stage;
use crate::world::World;

impl Stage {
    pub(super) fn new(whole: Arc<ParsedFile>, is_partial: bool, world: &World<'_>) -> Self {
        let root = world.roots.first().cloned().unwrap_or_default();
        let (options, absent) = (world.options.clone(), world.absent.clone());
        let (pins, last) = (world.pins.clone(), Mutex::default());
        Self { whole, options, root, is_partial, absent, pins, last }
    }
}

impl Graph {
    /// Marks the given `ForEach` nodes as settled: their elements have been counted, or their data have failed.
    pub fn with_counted(self, settled: BTreeSet<String>) -> Self {
        Self { counted: settled, ..self }
    }

    /// Returns the nodes that have split data into zero elements. No other node depends on them, but their status is reported.
    pub fn empty_loops(&self) -> impl Iterator<Item = usize> {
        let counted = self.loops.iter().filter(|it| self.counted.contains(&it.name));
        counted.map(|it| it.node).filter(|node| self.nodes[*node].outputs.is_empty())
    }

    /// Returns true if the elements of the `ForEach` of this name have been counted, or its data have failed.
    pub fn is_settled(&self, name: &str) -> bool {
        self.counted.contains(name)
    }

    /// Returns each `ForEach` of the graph that iterates over data.
    pub fn loops(&self) -> &[Loop] {
        &self.loops
    }

    /// Returns the data of one element of a `ForEach`. For the name `spots/3/spot`, this is output 2 of the node `spots/spot`, which splits
    /// the data.
    pub fn element(&self, name: &str) -> Option<(usize, usize)> {
        let (element, port) = name.rsplit_once('/')?;
        let (each, number) = element.rsplit_once('/')?;
        let found = self.loops.iter().find(|it| it.name == each && !it.is_open)?;
        let node = &self.nodes[found.node];
        let output = number.parse::<usize>().ok()?.checked_sub(1)?;
        let rest = node.name.strip_prefix(each).and_then(|rest| rest.strip_prefix('/'));
        (rest == Some(port) && output < node.outputs.len()).then_some((found.node, output))
    }

    /// Returns the nodes to which a name refers. If the name is inside of a `ForEach` over data, such as `spots/3`, also returns the node
    /// that splits the data.
    pub fn resolve_nodes(&self, name: &str) -> Vec<usize> {
        let named =
            self.find_value(name).map_or_else(|| self.nodes_of(name), |(node, _)| vec![node]);
        let around = self.loops.iter().filter(|it| is_inside(name, &it.name));
        named.into_iter().chain(around.map(|it| it.node)).collect()
    }

    /// Returns the `ForEach` over data to which a name refers or inside of which the name is. `None` if there is none, or if its elements
    /// are known.
    pub fn open_loop(&self, name: &str) -> Option<&Loop> {
        let mut open = self.loops.iter().filter(|it| it.is_open);
        open.find(|it| name == it.name || is_inside(name, &it.name))
    }

    /// Expands the graph for the given numbers of elements. The inputs keep their values.
    ///
    /// # Errors
    /// The numbers cause an error, for example in a parameter that receives the number of an element.
    pub fn expand(&self, counts: &Counts, catalog: &Catalog) -> Result<Self, Vec<Diagnostic>> {
        let Some(stage) = &self.stage else { return Ok(self.clone()) };
        let mut last = stage.last.lock().unwrap_or_else(|error| error.into_inner());
        let known = last.take().filter(|(known, _)| known == counts).map(|(_, graph)| graph);
        let graph = match known {
            Some(graph) => graph,
            None => {
                let mut world = World::new(catalog, &stage.options, stage.root.clone());
                world.subgraphs.clone_from(&self.subgraphs);
                world.absent.clone_from(&stage.absent);
                world.pins.clone_from(&stage.pins);
                let graph = expand(&mut world, &stage.whole, false, stage.is_partial, counts);
                graph.ok_or_else(|| std::mem::take(&mut world.diagnostics))?
            }
        };
        *last = Some((counts.clone(), graph.clone()));
        let graph = Self { stage: self.stage.clone(), ..graph };
        let graph = match self.given.is_empty() && self.inputs.is_empty() {
            true => graph,
            false => graph.with_known_inputs(&self.given, catalog)?,
        };
        Ok(Self { text: self.text.clone(), ..graph })
    }
}

/// The type name of the nodes that split data into elements.
pub const ELEMENTS: &str = "Elements";

/// A node that splits data into elements, with one output for each element.
struct ElementsNode {
    word: String,
    max_elements: usize,
    /// The link to the data that are split.
    over: String,
    count: Option<Count>,
}

/// The elements of the previous run. Reusing unchanged elements saves time and does not affect results.
#[derive(Clone)]
struct PreviousElements(Arc<[AnyValue]>);

impl Memo for PreviousElements {
    const NAME: &'static str = "elements";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.0.len()]);
    }

    fn size(&self) -> usize {
        self.0.iter().map(AnyValue::size).sum()
    }
}

/// The error for data whose number of elements differs from the number for which the graph was expanded.
#[derive(Clone, Debug, thiserror::Error)]
#[error("it has {0} elements now: run the graph again")]
pub struct ElementCountChanged(pub usize);

impl AnyNode for ElementsNode {
    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        if let Some(Count::Refused(why)) = &self.count {
            bail!("{why}");
        }
        let key = Hash::compute(format!("elements {} of {}", self.word, self.over).as_bytes());
        let before = cx.memos.and_then(|memos| memos.find(key));
        let before = before.as_ref().and_then(AnyValue::memo::<PreviousElements>);
        let before = before.map_or(&[][..], |before| &before.0);
        let found =
            cx.inputs.first().and_then(|value| value.cut(&self.word, self.max_elements, before));
        let elements = match found {
            Some(Ok(elements)) => elements,
            Some(Err(NoElements::TooMany { count })) => {
                let (over, most) = (&self.over, self.max_elements);
                bail!(
                    "`{over}` has {count} elements, but ForEach takes {most} at most: `most: {count}` allows them"
                )
            }
            Some(Err(NoElements::Impossible(why))) => return Err(Error::new(why)),
            None => bail!("it has no elements"),
        };
        if let Some(memos) = cx.memos {
            memos.keep(key, &AnyValue::from_memo(PreviousElements(elements.clone().into())));
        }
        match self.count {
            Some(Count::Of(count)) if count == elements.len() => Ok(elements),
            _ => Err(ElementCountChanged(elements.len()).into()),
        }
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        let count = if let Some(Count::Of(count)) = self.count { Some(count) } else { None };
        Ok(json!({ "word": self.word, "most": self.max_elements, "count": count }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// Creates the node that splits the data of a `ForEach` into at most `most` elements.
pub(super) fn elements_node(
    elements: &Elements,
    most: usize,
    count: Option<&Count>,
    over: &str,
    tree: &Tree,
) -> BuiltNode {
    let (word, over) = (elements.word.clone(), over.to_owned());
    build(ELEMENTS, ElementsNode { word, max_elements: most, over, count: count.cloned() }, tree)
}

/// A node that always fails, with this message.
struct FailingNode(String);

impl AnyNode for FailingNode {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        bail!("{}", self.0)
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({ "why": self.0 }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// Creates a node that fails with the message `why`.
pub(super) fn failing_node(why: String, tree: &Tree) -> BuiltNode {
    build("ForEach", FailingNode(why), tree)
}

fn build(kind: &str, node: impl AnyNode + 'static, tree: &Tree) -> BuiltNode {
    let recipe = Arc::new(Recipe::new(kind, node.parameters().unwrap_or_default(), &[]));
    let (node, tree) = (Arc::new(node), Arc::new(tree.clone()));
    BuiltNode { node, pack: "", recipe, files: Vec::new(), tree }
}

/// Returns true if a name is inside the `ForEach` of this name.
fn is_inside(name: &str, each: &str) -> bool {
    name.strip_prefix(each).is_some_and(|rest| rest.starts_with('/'))
}
