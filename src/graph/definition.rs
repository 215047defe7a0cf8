//! What a file says that a graph is: checked once, however often other graphs use it.

use std::sync::Arc;

use maquette_node::{AnyNode, Exactness};
use maquette_syntax::error::Span;
use maquette_syntax::{Finding, FoundFile, FoundLink, Name, Sheet, Tree};
use maquette_value::ValueType;
use semver::Version;
use serde_json::Value as Json;

use super::declaration::Declaration;
use super::parameters::Parameters;
use crate::GraphOutput;
use crate::catalog::{Entry, PortDescription, ports};
use crate::expectation::Expectation;
use crate::files::NodeFile;
use crate::flat::Lineage;
use crate::parameters::is_parametric;
use crate::recipe::Recipe;

/// Properties that are wanted, and where each stands.
pub(super) type Wants = Vec<(&'static str, Span)>;

/// A graph as its file has it, with the default values of its parameters.
pub struct Definition {
    pub sheet: Arc<Sheet>,
    /// The tree of its text.
    pub tree: Arc<Tree>,
    pub doc: String,
    pub(super) version: Option<Version>,
    /// Its parameters and their values where a use gives none.
    pub declared: Vec<Declaration>,
    pub(super) defaults: Parameters,
    /// Its inputs, as many as `inputs`, then its nodes.
    pub drafts: Vec<Draft>,
    pub inputs: usize,
    /// The drafts, each after those that it hangs on.
    pub order: Vec<usize>,
    pub eaches: Vec<Each>,
    /// Its outputs, if other graphs use it; files are kept elsewhere.
    pub ports: Vec<Port>,
    /// The properties that it wants of each input.
    pub wants: Vec<Wants>,
    /// What must hold of its values wherever it is used.
    pub(super) expect: Vec<Expecting>,
    /// Inputs and parameters by their names, described as a built-in node's fields are.
    pub(super) schema: Json,
    /// The same for who uses it: under the names of fields.
    pub fields: Json,
}

impl Definition {
    /// Whether a patch has made it of another graph.
    pub fn is_patched(&self) -> bool {
        !self.sheet.parts.is_empty()
    }

    /// The parameters whose defaults are computed from others, each behind all that it is computed from.
    pub fn derived_parameters(&self) -> Vec<&str> {
        self.defaults.derived().map(|(name, _)| name).collect()
    }

    /// How equal its results are on all machines: as equal as those of the worst of its nodes.
    pub(super) fn exactness(&self) -> Exactness {
        self.drafts
            .iter()
            .map(|draft| match &draft.what {
                What::Node(entry) => entry.exactness(),
                What::Use(_, graph) => graph.exactness(),
                _ => Exactness::Exact,
            })
            .fold(Exactness::Exact, Exactness::and)
    }
}

/// An output of a graph that others use.
pub struct Port {
    pub name: String,
    /// The draft and output that it gives; none if its link is wrong.
    pub(super) target: Option<(usize, usize)>,
    pub kind: Option<&'static ValueType>,
    /// What from outside may shape it.
    pub(super) lineage: Arc<Lineage>,
    /// Its name in the file.
    pub(super) span: Span,
}

/// A type of nodes that a graph makes of another graph: its name there, and what it is if its file says so.
pub(super) struct Used {
    pub(super) name: String,
    pub(super) definition: Option<Arc<Definition>>,
}

/// What a file says, and what only the first one of a graph gives.
pub struct Whole {
    pub definition: Definition,
    /// Files, with the places of drafts for those of nodes.
    pub(crate) outputs: Vec<GraphOutput>,
    /// Those of which nobody knows what they hold: they hang on a node of an unknown type.
    pub(crate) undecided: Vec<GraphOutput>,
    /// Whether it gives ports, not files.
    pub(crate) is_used: bool,
    /// The nodes that nothing needs.
    pub(crate) unused: Vec<(String, Span)>,
}

/// A node while it is checked.
pub struct Draft {
    pub name: Name,
    /// What stands in the file.
    pub tree: Tree,
    pub what: What,
    pub links: Vec<FoundLink>,
    /// For each link, the nodes and outputs that it names, if they exist.
    pub(crate) targets: Vec<Option<Vec<(usize, usize)>>>,
    /// The type of each output, as far as it is known.
    pub types: Vec<Option<&'static ValueType>>,
    /// Whether parameters of the graph shape it.
    pub(crate) parametric: bool,
    /// Whether its fields have no problem with the defaults.
    pub(crate) is_sound: bool,
    /// Whether it is an input that a use may leave out.
    pub is_optional: bool,
    /// Its fields with the defaults, if they have no problem, until the node is made of them.
    pub survey: Option<Survey>,
    /// A built-in node itself, with the defaults.
    pub(crate) built: Option<Built>,
    /// Whether it stands for as many as there will be.
    pub(crate) repeat: Option<Repeat>,
}

/// What a node is.
pub enum What {
    /// Built in.
    Node(Arc<Entry>),
    /// A graph, under this name.
    Use(String, Arc<Definition>),
    /// What comes into the graph.
    Input,
    /// One of its links.
    Switch(Branches),
    /// What a `ForEach` goes over: the elements of a value.
    Elements(Elements),
    /// One element of a `ForEach` over data.
    Pick(Pick),
    /// Of a type that no pack has, with what is told of it; or something that is wrong in another way.
    Unknown(Option<Finding>),
}

impl What {
    /// The names of the outputs.
    pub fn outputs(&self) -> Vec<&str> {
        match self {
            Self::Node(entry) => entry.outputs().iter().map(|output| output.name).collect(),
            Self::Use(_, graph) => graph.ports.iter().map(|port| &port.name[..]).collect(),
            Self::Pick(pick) => pick.outputs.iter().map(String::as_str).collect(),
            Self::Input | Self::Switch(_) | Self::Elements(_) | Self::Unknown(_) => Vec::new(),
        }
    }

    /// Its ports, if it is a node or a graph.
    pub fn ports(&self) -> Vec<PortDescription> {
        match self {
            Self::Node(entry) => entry.ports(),
            Self::Use(_, graph) => ports(&graph.fields),
            _ => Vec::new(),
        }
    }

    /// The type of each output, as far as no link decides it.
    pub fn types(&self) -> Vec<Option<&'static ValueType>> {
        match self {
            Self::Node(entry) => entry
                .outputs()
                .iter()
                .map(|output| match output.types[..] {
                    [kind] => Some(kind),
                    _ => None,
                })
                .collect(),
            Self::Use(_, graph) => graph.ports.iter().map(|port| port.kind).collect(),
            _ => Vec::new(),
        }
    }

    /// The description of its fields.
    pub fn schema(&self) -> Option<&Json> {
        match self {
            Self::Node(entry) => Some(entry.merged_schema()),
            Self::Use(_, graph) => Some(&graph.fields),
            _ => None,
        }
    }

    /// The name of its type.
    pub(crate) fn kind(&self) -> &str {
        match self {
            Self::Node(entry) => &entry.name,
            Self::Use(name, _) => name,
            Self::Input => "input",
            Self::Switch(_) => "Switch",
            Self::Elements(_) => "ForEach",
            Self::Pick(pick) => &pick.kind,
            Self::Unknown(_) => "",
        }
    }
}

impl Draft {
    pub(crate) fn input(
        name: Name,
        tree: Tree,
        kind: Option<&'static ValueType>,
        is_optional: bool,
    ) -> Self {
        Self { types: vec![kind], is_optional, ..Self::new(name, tree, What::Input) }
    }

    /// A draft that is no node of the catalog, with its links.
    pub(crate) fn linked(name: Name, tree: Tree, what: What, links: Vec<FoundLink>) -> Self {
        Self { links, ..Self::new(name, tree, what) }
    }

    pub(crate) fn new(name: Name, tree: Tree, what: What) -> Self {
        Self {
            name,
            parametric: is_parametric(&tree),
            tree,
            what,
            links: Vec::new(),
            targets: Vec::new(),
            types: Vec::new(),
            is_sound: true,
            is_optional: false,
            survey: None,
            built: None,
            repeat: None,
        }
    }

    /// Whether a link to this output leads to a list, of a length that is known late.
    pub fn is_list(&self, output: usize) -> bool {
        let Some(repeat) = &self.repeat else { return false };
        let outputs = self.what.outputs();
        let name = outputs.get(output).copied().unwrap_or_default();
        repeat.carry.iter().all(|(carried, _)| carried != name)
    }
}

/// A `ForEach`: one node for each element of a list.
pub struct Each {
    pub name: String,
    /// Where its name stands.
    pub(crate) span: Span,
    /// The type of its nodes.
    pub(crate) kind: String,
    /// Their places among the drafts.
    pub(crate) elements: Vec<usize>,
    /// What each element takes from the one before, and what the first one takes instead.
    pub(crate) carry: Vec<(String, Tree)>,
    /// The outputs of its nodes, if it has none.
    pub outputs: Option<Vec<String>>,
}

impl Each {
    /// Whether a link begins with its name.
    pub(crate) fn is_named(&self, link: &str) -> bool {
        link.split('.').next() == Some(&self.name)
    }
}

/// The branches of a `Switch`.
pub struct Branches {
    /// Names, and links to what each gives.
    pub(crate) cases: Vec<(String, Tree)>,
    pub(crate) choose: Tree,
}

/// An expectation in the file that has it, and the drafts and outputs whose values it speaks of; none for one that is not there.
pub(crate) struct Expecting {
    pub(crate) expectation: Expectation,
    pub(crate) span: Span,
    pub(crate) targets: Vec<Option<(usize, usize)>>,
}

/// A node's fields, looked at: the values that they have, and the links and files among them.
pub struct Survey {
    pub(crate) tree: Tree,
    pub(crate) links: Vec<FoundLink>,
    pub(crate) files: Vec<FoundFile>,
    /// Whether it has other links than those that are written: without those to optional inputs that have no value, or as many as data
    /// has elements. Then it may be one that nothing needs.
    pub(crate) has_other_links: bool,
}

/// A built-in node, ready to be put into a graph.
#[derive(Clone)]
pub(crate) struct Built {
    pub(crate) node: Arc<dyn AnyNode>,
    pub(crate) pack: &'static str,
    pub(crate) recipe: Arc<Recipe>,
    pub(crate) files: Vec<NodeFile>,
    pub(crate) tree: Arc<Tree>,
}

/// How a draft is repeated whose number is no matter of its file.
pub(crate) struct Repeat {
    pub(crate) count: Counted,
    /// The parameter that gets the element's number, from 1.
    pub(crate) number: Option<Name>,
    /// What each element takes from the one before, and what the first one takes instead.
    pub(crate) carry: Vec<(String, Tree)>,
    pub(crate) most: Option<Tree>,
}

impl Repeat {
    /// What says how many elements there are, and may be, if numbers do.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = &Tree> {
        let count = match &self.count {
            Counted::Number(count) => Some(count),
            Counted::Data(..) => None,
        };
        count.into_iter().chain(&self.most)
    }
}

/// What says how many there are.
pub(crate) enum Counted {
    /// A number.
    Number(Tree),
    /// The draft of the elements of a value, and the port that takes each.
    Data(usize, String),
}

/// The elements of a value, for a `ForEach`.
pub struct Elements {
    /// Which ones, if a word says so.
    pub(crate) word: String,
    /// The `ForEach`.
    pub(crate) each: String,
    pub(crate) most: Option<Tree>,
}

/// One element of a `ForEach` whose number is known late.
pub struct Pick {
    /// The draft that is repeated.
    pub(crate) of: usize,
    /// Which one, from 1.
    pub(crate) number: usize,
    /// What it is: its type and outputs.
    pub(crate) kind: String,
    pub(crate) outputs: Vec<String>,
}
