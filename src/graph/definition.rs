//! The definition of a graph by its file, checked once for all uses.

use std::sync::Arc;

use maquette_node::{AnyNode, Exactness};
use maquette_syntax::error::Span;
use maquette_syntax::{FoundFile, FoundLink, LocalDiagnostic, Name, SourceMap, Tree};
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

/// Required properties, each with its position in the file.
pub(super) type Wants = Vec<(&'static str, Span)>;

/// A graph as its file defines it, checked with the default values of its parameters.
pub struct Definition {
    pub source_map: Arc<SourceMap>,
    /// The syntax tree of the graph file's text.
    pub tree: Arc<Tree>,
    pub doc: String,
    pub(super) version: Option<Version>,
    /// The declarations of the parameters, with their default values.
    pub declared: Vec<Declaration>,
    pub(super) defaults: Parameters,
    /// The inputs of the graph, as many as `inputs`, followed by its nodes.
    pub parsed_nodes: Vec<ParsedNode>,
    pub inputs: usize,
    /// The indices of the nodes, ordered so that each node comes after those on which it depends.
    pub order: Vec<usize>,
    pub for_each_nodes: Vec<ForEachNode>,
    /// The outputs, if other graphs use this graph. Otherwise the outputs are files, which are stored in [`ParsedFile`].
    pub ports: Vec<Port>,
    /// The required properties of each input.
    pub wants: Vec<Wants>,
    /// The expectations of the graph, which must hold wherever the graph is used.
    pub(super) expect: Vec<BoundExpectation>,
    /// The schema of the inputs and parameters, under their names.
    pub(super) schema: Json,
    /// The schema of the inputs and parameters, under the names of fields: underscores replace hyphens.
    pub fields: Json,
}

impl Definition {
    /// Returns true if the graph is a patch of another graph.
    pub fn is_patched(&self) -> bool {
        !self.source_map.parts.is_empty()
    }

    /// Returns true if an output or an input has this name.
    pub(super) fn has_port_or_input(&self, name: &str) -> bool {
        self.ports.iter().any(|port| port.name == name)
            || self.parsed_nodes[..self.inputs].iter().any(|input| input.name.text == name)
    }

    /// Returns the parameters with computed defaults. Each comes after the parameters from which it is computed.
    pub fn derived_parameters(&self) -> Vec<&str> {
        self.defaults.derived_parameters().map(|(name, _)| name).collect()
    }

    /// Returns the exactness of the graph's results, the agreement between machines: it is that of its least exact node.
    pub(super) fn exactness(&self) -> Exactness {
        self.parsed_nodes
            .iter()
            .map(|parsed| match &parsed.what {
                NodeKind::Node(entry) => entry.exactness(),
                NodeKind::Use(_, graph) => graph.exactness(),
                _ => Exactness::Exact,
            })
            .fold(Exactness::Exact, Exactness::combine)
    }
}

/// An output of a graph that other graphs use.
pub struct Port {
    pub name: String,
    /// The index of the node, and the index of the node's output. `None` if the link is wrong.
    pub(super) target: Option<(usize, usize)>,
    pub kind: Option<&'static ValueType>,
    /// The values from outside of the graph on which the output depends.
    pub(super) lineage: Arc<Lineage>,
    /// The position of the output's name in the file.
    pub(super) span: Span,
}

/// A node type that `use` declares for a graph: its name, and the graph's definition if the file could be read.
pub(super) struct UsedGraph {
    pub(super) name: String,
    pub(super) definition: Option<Arc<Definition>>,
}

/// A parsed file, with the data that exists only for the graph's own file.
pub struct ParsedFile {
    pub definition: Definition,
    /// The output files, each with the index of its node.
    pub(crate) outputs: Vec<GraphOutput>,
    /// The output files whose type is unknown, because they depend on a node of an unknown type.
    pub(crate) undecided: Vec<GraphOutput>,
    /// True if the outputs are ports, not files.
    pub(crate) is_used: bool,
    /// The nodes that no output or expectation needs, with the positions of their names.
    pub(crate) unused: Vec<(String, Span)>,
}

/// A node that is being checked.
pub struct ParsedNode {
    pub name: Name,
    /// The call of the node as it is written in the file.
    pub tree: Tree,
    pub what: NodeKind,
    pub links: Vec<FoundLink>,
    /// For each link, the indices of the nodes and outputs to which it leads, if they exist.
    pub(crate) targets: Vec<Option<Vec<(usize, usize)>>>,
    /// The type of each output, if it is known.
    pub types: Vec<Option<&'static ValueType>>,
    /// True if the node depends on parameters of its graph.
    pub(crate) parametric: bool,
    /// True if the fields have no errors when parameters have their default values.
    pub(crate) is_valid: bool,
    /// True for an input that a use of the graph may omit.
    pub is_optional: bool,
    /// The checked fields for the default values of parameters, if the fields have no errors. They are taken when the node is built.
    pub checked_fields: Option<CheckedFields>,
    /// The built-in node for the default values of parameters.
    pub(crate) built: Option<BuiltNode>,
    /// The repetition, if the node represents the elements of a `ForEach` whose number of elements is not known yet.
    pub(crate) repeat: Option<Repeat>,
}

/// The kind of a node.
pub enum NodeKind {
    /// A node of a built-in type.
    Node(Arc<Entry>),
    /// A use of a graph, for which `use` declares this type name.
    Use(String, Arc<Definition>),
    /// An input of the graph.
    Input,
    /// A `Switch`, which represents one of its links.
    Switch(Branches),
    /// The elements of the value that a `ForEach` iterates over.
    Elements(Elements),
    /// One element of a `ForEach` over data.
    Pick(Pick),
    /// A node of a type that no pack has, with the diagnostic that reports it. Also an invalid entry.
    Unknown(Option<LocalDiagnostic>),
}

impl NodeKind {
    /// Returns the names of the node's outputs.
    pub fn outputs(&self) -> Vec<&str> {
        match self {
            Self::Node(entry) => entry.outputs().iter().map(|output| output.name).collect(),
            Self::Use(_, graph) => graph.ports.iter().map(|port| &port.name[..]).collect(),
            Self::Pick(pick) => pick.outputs.iter().map(String::as_str).collect(),
            Self::Input | Self::Switch(_) | Self::Elements(_) | Self::Unknown(_) => Vec::new(),
        }
    }

    /// Returns the ports of a built-in node, or of a used graph.
    pub fn ports(&self) -> Vec<PortDescription> {
        match self {
            Self::Node(entry) => entry.ports(),
            Self::Use(_, graph) => ports(&graph.fields),
            _ => Vec::new(),
        }
    }

    /// Returns the type of each output, if the types do not depend on links.
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

    /// Returns the schema of the node's fields.
    pub fn schema(&self) -> Option<&Json> {
        match self {
            Self::Node(entry) => Some(entry.merged_schema()),
            Self::Use(_, graph) => Some(&graph.fields),
            _ => None,
        }
    }

    /// Returns the name of the node's type.
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

impl ParsedNode {
    pub(crate) fn input(
        name: Name,
        tree: Tree,
        kind: Option<&'static ValueType>,
        is_optional: bool,
    ) -> Self {
        Self { types: vec![kind], is_optional, ..Self::new(name, tree, NodeKind::Input) }
    }

    /// Creates an entry that has links but is not a node of the catalog.
    pub(crate) fn with_links(
        name: Name,
        tree: Tree,
        what: NodeKind,
        links: Vec<FoundLink>,
    ) -> Self {
        Self { links, ..Self::new(name, tree, what) }
    }

    pub(crate) fn new(name: Name, tree: Tree, what: NodeKind) -> Self {
        Self {
            name,
            parametric: is_parametric(&tree),
            tree,
            what,
            links: Vec::new(),
            targets: Vec::new(),
            types: Vec::new(),
            is_valid: true,
            is_optional: false,
            checked_fields: None,
            built: None,
            repeat: None,
        }
    }

    /// Returns true if a link to this output leads to a list whose length is not known yet.
    pub fn is_list(&self, output: usize) -> bool {
        let Some(repeat) = &self.repeat else { return false };
        let outputs = self.what.outputs();
        let name = outputs.get(output).copied().unwrap_or_default();
        repeat.carry.iter().all(|(carried, _)| carried != name)
    }
}

/// A `ForEach` over a list, which becomes one node for each element.
pub struct ForEachNode {
    pub name: String,
    /// The position of the name of the `ForEach`.
    pub(crate) span: Span,
    /// The node type that the `ForEach` repeats.
    pub(crate) kind: String,
    /// The index of the node of each element.
    pub(crate) elements: Vec<usize>,
    /// The carried inputs, which take their values from the previous element. Each has the link that the first element uses.
    pub(crate) carry: Vec<(String, Tree)>,
    /// The names of the node type's outputs, if there are no elements.
    pub outputs: Option<Vec<String>>,
}

impl ForEachNode {
    /// Returns true if a link begins with the name of the `ForEach`.
    pub(crate) fn is_named(&self, link: &str) -> bool {
        link.split('.').next() == Some(&self.name)
    }
}

/// The cases of a `Switch`, and the choice between them.
pub struct Branches {
    /// The name and the link of each case.
    pub(crate) cases: Vec<(String, Tree)>,
    pub(crate) choose: Tree,
}

/// An expectation, for the file that contains it. Each of its values is resolved to a node and an output, or to `None` if the value does
/// not exist.
pub(crate) struct BoundExpectation {
    pub(crate) expectation: Expectation,
    pub(crate) span: Span,
    pub(crate) targets: Vec<Option<(usize, usize)>>,
}

/// The checked fields of a node: their values, and the links and files among them.
pub struct CheckedFields {
    pub(crate) tree: Tree,
    pub(crate) links: Vec<FoundLink>,
    pub(crate) files: Vec<FoundFile>,
    /// True if the links differ from those in the file, because optional inputs are omitted or because data determine the number of links.
    /// In that case an error of the node is not an error of the file.
    pub(crate) has_other_links: bool,
}

/// A built-in node that can be added to a graph.
#[derive(Clone)]
pub(crate) struct BuiltNode {
    pub(crate) node: Arc<dyn AnyNode>,
    pub(crate) pack: &'static str,
    pub(crate) recipe: Arc<Recipe>,
    pub(crate) files: Vec<NodeFile>,
    pub(crate) tree: Arc<Tree>,
}

/// The repetition of a `ForEach` whose number of elements is not known when its file is read.
pub(crate) struct Repeat {
    pub(crate) count: ElementCount,
    /// The parameter that receives the number of the element, from 1.
    pub(crate) number: Option<Name>,
    /// The carried inputs, which take their values from the previous element. Each has the link that the first element uses.
    pub(crate) carry: Vec<(String, Tree)>,
    pub(crate) max_elements: Option<Tree>,
}

impl Repeat {
    /// Returns the expressions that define the number of elements and its maximum.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = &Tree> {
        let count = match &self.count {
            ElementCount::Number(count) => Some(count),
            ElementCount::Data(..) => None,
        };
        count.into_iter().chain(&self.max_elements)
    }
}

/// The source of the number of elements.
pub(crate) enum ElementCount {
    /// A number, or an expression that defines it.
    Number(Tree),
    /// The index of the node that splits a value into elements, and the port that takes each element.
    Data(usize, String),
}

/// The elements of a value that a `ForEach` iterates over.
pub struct Elements {
    /// The word that selects the kind of elements; empty for the default kind.
    pub(crate) word: String,
    /// The name of the `ForEach` that iterates over the elements.
    pub(crate) each: String,
    pub(crate) max_elements: Option<Tree>,
}

/// A link to one element of a `ForEach` whose number of elements is not known yet.
pub struct Pick {
    /// The index of the repeated node.
    pub(crate) of: usize,
    /// The number of the element, from 1.
    pub(crate) number: usize,
    /// The type of the node of that element.
    pub(crate) kind: String,
    pub(crate) outputs: Vec<String>,
}
