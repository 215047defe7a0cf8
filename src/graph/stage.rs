//! Graphs whose number of nodes hangs on data: a `ForEach` over the components of labels, the points of a cloud, the parts of a mesh.
//!
//! What is wrong with such a graph is known when it is read, with one example for all elements. How many there are is known when the
//! value is: then the graph is expanded again, with these counts. Equal nodes have equal keys, so nothing is computed twice.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use maquette_node::{AnyNode, Context, FilePath};
use maquette_syntax::Tree;
use maquette_syntax::error::{Error, Problem};
use maquette_value::{AnyValue, Encoder, Hash, Memo, NoElements};
use serde_json::json;

use super::Graph;
use super::expand::expand;
use super::recipe::Recipe;
use crate::catalog::Catalog;
use crate::definition::{Built, Elements, Whole};
use crate::flat::{Count, Counts, Loop};
use crate::graph::Stage;
use crate::world::World;

impl Stage {
    pub(super) fn new(whole: Arc<Whole>, is_partial: bool, world: &World<'_>) -> Self {
        let root = world.roots.first().cloned().unwrap_or_default();
        let (options, absent) = (world.options.clone(), world.absent.clone());
        let (pins, last) = (world.pins.clone(), Mutex::default());
        Self { whole, options, root, is_partial, absent, pins, last }
    }
}

impl Graph {
    /// The same graph, of which it is known that these `ForEach`es have as many elements as their data have, or that their data fail.
    pub fn settled(self, settled: BTreeSet<String>) -> Self {
        Self { settled, ..self }
    }

    /// What takes data without elements apart: no node hangs on it, but what happened to it is to be told.
    pub fn empty(&self) -> impl Iterator<Item = usize> {
        let is_empty =
            |it: &&Loop| self.settled.contains(&it.name) && self.nodes[it.node].outputs.is_empty();
        self.loops.iter().filter(is_empty).map(|it| it.node)
    }

    /// Whether that is known of one.
    pub fn is_settled(&self, name: &str) -> bool {
        self.settled.contains(name)
    }

    /// Each `ForEach` over data in it.
    pub fn loops(&self) -> &[Loop] {
        &self.loops
    }

    /// The data of one element, `spots/3/spot`: the output of the node `spots/spot` that takes them apart.
    pub fn element(&self, name: &str) -> Option<(usize, usize)> {
        let (element, port) = name.rsplit_once('/')?;
        let (each, number) = element.rsplit_once('/')?;
        let found = self.loops.iter().find(|it| it.name == each && !it.is_open)?;
        let node = &self.nodes[found.node];
        let output = number.parse::<usize>().ok()?.checked_sub(1)?;
        let rest = node.name.strip_prefix(each).and_then(|rest| rest.strip_prefix('/'));
        (rest == Some(port) && output < node.outputs.len()).then_some((found.node, output))
    }

    /// The nodes that a name means; of one that may be inside of a `ForEach` over data, the node that says what is.
    pub fn meant(&self, name: &str) -> Vec<usize> {
        let named =
            self.value_named(name).map_or_else(|| self.nodes_of(name), |(node, _)| vec![node]);
        let around = self.loops.iter().filter(|it| is_inside(name, &it.name));
        named.into_iter().chain(around.map(|it| it.node)).collect()
    }

    /// The `ForEach` over data that a name means or is inside of, if its elements are not known.
    pub fn open_loop(&self, name: &str) -> Option<&Loop> {
        let mut open = self.loops.iter().filter(|it| it.is_open);
        open.find(|it| name == it.name || is_inside(name, &it.name))
    }

    /// The same graph with so many elements, and the same values at its inputs.
    ///
    /// # Errors
    /// If something is wrong with these counts, as with a number that an element gets.
    pub fn expanded(&self, counts: &Counts, catalog: &Catalog) -> Result<Self, Vec<Problem>> {
        let Some(stage) = &self.stage else { return Ok(self.clone()) };
        let mut last = stage.last.lock().unwrap_or_else(|broken| broken.into_inner());
        let known = last.take().filter(|(known, _)| known == counts).map(|(_, graph)| graph);
        let graph = match known {
            Some(graph) => graph,
            None => {
                let mut world = World::new(catalog, &stage.options, stage.root.clone());
                world.subgraphs.clone_from(&self.subgraphs);
                world.absent.clone_from(&stage.absent);
                world.pins.clone_from(&stage.pins);
                let graph = expand(&mut world, &stage.whole, false, stage.is_partial, counts);
                graph.ok_or_else(|| std::mem::take(&mut world.problems))?
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

/// What the nodes that take data apart are called, where the types of nodes are told.
pub const ELEMENTS: &str = "Elements";

/// Takes data apart: an output for each element.
struct Cut {
    word: String,
    most: usize,
    /// The link of the data.
    over: String,
    count: Option<Count>,
}

/// What a `ForEach` went over the last time: what is as it was need not be made again. It changes how long it takes, and nothing else.
#[derive(Clone)]
struct Before(Arc<[AnyValue]>);

impl Memo for Before {
    const NAME: &'static str = "elements";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.0.len()]);
    }

    fn size(&self) -> usize {
        self.0.iter().map(AnyValue::size).sum()
    }
}

/// There are other elements than the graph was expanded for.
#[derive(Clone, Debug, thiserror::Error)]
#[error("it has {0} elements by now: run the graph again")]
pub struct OtherCount(pub usize);

#[derive(Clone, Debug, thiserror::Error)]
enum Uncut {
    #[error(
        "`{over}` has {count} elements, but ForEach takes {most} at most: `most: {count}` lets it have them"
    )]
    TooMany { over: String, count: usize, most: usize },
    #[error("{0}")]
    Refused(String),
}

impl AnyNode for Cut {
    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        if let Some(Count::Refused(why)) = &self.count {
            return Err(Uncut::Refused(why.clone()).into());
        }
        let key = Hash::of(format!("elements {} of {}", self.word, self.over).as_bytes());
        let before = cx.memos.and_then(|memos| memos.find(key));
        let before = before.as_ref().and_then(AnyValue::memo::<Before>);
        let before = before.map_or(&[][..], |before| &before.0);
        let found = cx.inputs.first().and_then(|value| value.cut(&self.word, self.most, before));
        let elements = match found {
            Some(Ok(elements)) => elements,
            Some(Err(NoElements::TooMany { count })) => {
                let (over, most) = (self.over.clone(), self.most);
                return Err(Uncut::TooMany { over, count, most }.into());
            }
            Some(Err(NoElements::Impossible(why))) => return Err(Uncut::Refused(why).into()),
            None => return Err(Uncut::Refused("it has no elements".into()).into()),
        };
        if let Some(memos) = cx.memos {
            memos.keep(key, &AnyValue::of_memo(Before(elements.clone().into())));
        }
        match self.count {
            Some(Count::Of(count)) if count == elements.len() => Ok(elements),
            _ => Err(OtherCount(elements.len()).into()),
        }
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        let count = if let Some(Count::Of(count)) = self.count { Some(count) } else { None };
        Ok(json!({ "word": self.word, "most": self.most, "count": count }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// What takes the data of a `ForEach` apart.
pub(super) fn cut_node(
    elements: &Elements,
    most: usize,
    count: Option<&Count>,
    over: &str,
    tree: &Tree,
) -> Built {
    let (word, over) = (elements.word.clone(), over.to_owned());
    built(ELEMENTS, Cut { word, most, over, count: count.cloned() }, tree)
}

/// Stands for what cannot be.
struct Refused(String);

impl AnyNode for Refused {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        Err(Uncut::Refused(self.0.clone()).into())
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({ "why": self.0 }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// What fails because of this.
pub(super) fn refused_node(why: String, tree: &Tree) -> Built {
    built("ForEach", Refused(why), tree)
}

fn built(kind: &str, node: impl AnyNode + 'static, tree: &Tree) -> Built {
    let recipe = Arc::new(Recipe::new(kind, node.parameters().unwrap_or_default(), &[]));
    let (node, tree) = (Arc::new(node), Arc::new(tree.clone()));
    Built { node, pack: "", recipe, files: Vec::new(), tree }
}

/// Whether a name is that of a node in a `ForEach` of this name.
fn is_inside(name: &str, each: &str) -> bool {
    name.strip_prefix(each).is_some_and(|rest| rest.starts_with('/'))
}
