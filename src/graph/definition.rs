//! The definition of a graph in its file. It is checked once, for all nodes that use the graph.

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

/// Properties that a graph requires of an input, such as `Closed`, each with its position in the file.
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
    /// The inputs of the graph, followed by its nodes. The number of inputs is `inputs`.
    pub parsed_nodes: Vec<ParsedNode>,
    pub inputs: usize,
    /// The indices of the nodes, ordered so that each node comes after those on which it depends.
    pub order: Vec<usize>,
    pub for_each_nodes: Vec<ForEachNode>,
    /// The outputs to which other graphs can link. The root graph instead has output files, which are stored in [`ParsedFile`].
    pub ports: Vec<Port>,
    /// For each input, the properties that the graph requires of it.
    pub wants: Vec<Wants>,
    /// The expectations in the graph's file: conditions on values of the graph. They are tested for each node that uses the graph.
    pub(super) expect: Vec<BoundExpectation>,
    /// The JSON schema of the inputs and parameters, under their own names.
    pub(super) schema: Json,
    /// The JSON schema of the inputs and parameters, under their field names, in which underscores replace hyphens.
    pub fields: Json,
}

impl Definition {
    /// Returns true if the graph is defined as a patch of another graph.
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

    /// Returns how closely the graph's results agree between machines. This is the exactness of its least exact node.
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

/// An output of a graph to which other graphs can link.
pub struct Port {
    pub name: String,
    /// The index of the node, and the index of the node's output. `None` if the link in the file is invalid.
    pub(super) target: Option<(usize, usize)>,
    pub kind: Option<&'static ValueType>,
    /// The inputs of the graph, and the other values from outside of it, on which the output depends.
    pub(super) lineage: Arc<Lineage>,
    /// The position of the output's name in the file.
    pub(super) span: Span,
}

/// A node type that the section `use` of a graph declares: its name, and its definition. The definition is `None` if the file is
/// unreadable.
pub(super) struct UsedGraph {
    pub(super) name: String,
    pub(super) definition: Option<Arc<Definition>>,
}

/// A parsed graph file, with the data that exists only for the root graph.
pub struct ParsedFile {
    pub definition: Definition,
    /// The output files, each with the index of the node that computes its content.
    pub(crate) outputs: Vec<GraphOutput>,
    /// The output files whose type of value is unknown, because they depend on a node of an unknown type.
    pub(crate) undecided: Vec<GraphOutput>,
    /// True if the graph has ports to which other graphs can link, instead of output files.
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
    /// For each link, the pairs of node index and output index to which it leads. `None` if the link is invalid.
    pub(crate) targets: Vec<Option<Vec<(usize, usize)>>>,
    /// The type of each output, if it is known.
    pub types: Vec<Option<&'static ValueType>>,
    /// True if the node depends on parameters of its graph.
    pub(crate) parametric: bool,
    /// True if the fields have no errors while all parameters have their default values.
    pub(crate) is_valid: bool,
    /// True for an input of the graph that may be omitted by a node that uses the graph.
    pub is_optional: bool,
    /// The checked fields, for the default values of parameters. `None` if the fields have errors, or after the node has been built.
    pub checked_fields: Option<CheckedFields>,
    /// The node, built for the default values of parameters. `None` if it has not been built.
    pub(crate) built: Option<BuiltNode>,
    /// Data of a repeated node whose number of elements is still unknown, so that this one node represents all elements. `None` for other
    /// nodes.
    pub(crate) repeat: Option<Repeat>,
}

/// The kind of a node.
pub enum NodeKind {
    /// A node of a built-in type.
    Node(Arc<Entry>),
    /// A node that uses another graph: its type name, as declared by the section `use`, and the definition of the used graph.
    Use(String, Arc<Definition>),
    /// An input of the graph.
    Input,
    /// A `Switch`, which represents one of its links.
    Switch(Branches),
    /// The node that splits a value into the elements of a `ForEach`.
    Elements(Elements),
    /// A link to one element of a `ForEach` over data.
    Pick(Pick),
    /// A node of a type that no pack defines, with the diagnostic that reports the type. Also an entry that is not a valid node.
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

    /// Returns the type of each output. `None` for an output whose type depends on the links of the node.
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

    /// Returns the JSON schema of the node's fields. `None` for kinds without fields, such as inputs.
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

    /// Creates an entry that has links but is not of a type in the catalog, such as a `Switch`.
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

    /// Returns true if a link to this output leads to a list whose length is still unknown.
    pub fn is_list(&self, output: usize) -> bool {
        let Some(repeat) = &self.repeat else { return false };
        let outputs = self.what.outputs();
        let name = outputs.get(output).copied().unwrap_or_default();
        repeat.carry.iter().all(|(carried, _)| carried != name)
    }
}

/// A `ForEach` over a list. It is replaced by one node for each element.
pub struct ForEachNode {
    pub name: String,
    /// The position of the name of the `ForEach`.
    pub(crate) span: Span,
    /// The node type that the `ForEach` repeats.
    pub(crate) kind: String,
    /// For each element, the index of its node.
    pub(crate) elements: Vec<usize>,
    /// The carried inputs, which take their values from the previous element, and the links that they have in the first element.
    pub(crate) carry: Vec<(String, Tree)>,
    /// If there are no elements: the output names of the repeated node type. Otherwise `None`.
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

/// An expectation in a file, with its values looked up. Each value is a node and an output, or `None` if the value does not exist.
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
    /// True if the node's links differ from those in the file: optional inputs are omitted, or data determine the number of links. An error
    /// of the node is then not an error of the file.
    pub(crate) has_other_links: bool,
}

/// A built-in node that is ready to be added to a graph.
#[derive(Clone)]
pub(crate) struct BuiltNode {
    pub(crate) node: Arc<dyn AnyNode>,
    pub(crate) pack: &'static str,
    pub(crate) recipe: Arc<Recipe>,
    pub(crate) files: Vec<NodeFile>,
    pub(crate) tree: Arc<Tree>,
}

/// The repeated node of a `ForEach` whose number of elements is not yet known when the file is read.
pub(crate) struct Repeat {
    pub(crate) count: ElementCount,
    /// The parameter that receives the number of the element, from 1.
    pub(crate) number: Option<Name>,
    /// The carried inputs, which take their values from the previous element, and the links that they have in the first element.
    pub(crate) carry: Vec<(String, Tree)>,
    pub(crate) max_elements: Option<Tree>,
}

impl Repeat {
    /// Returns the expressions for the number of elements and for the maximum number of elements, if the file contains them.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = &Tree> {
        let count = match &self.count {
            ElementCount::Number(count) => Some(count),
            ElementCount::Data(..) => None,
        };
        count.into_iter().chain(&self.max_elements)
    }
}

/// The source of the number of elements of a `ForEach`.
pub(crate) enum ElementCount {
    /// A number, or an expression that defines it.
    Number(Tree),
    /// The index of the node that splits a value into elements, and the port that takes each element.
    Data(usize, String),
}

/// The elements of a value that a `ForEach` iterates over.
pub struct Elements {
    /// The word in the file that selects the kind of elements, such as `Parts`. Empty for the default kind.
    pub(crate) word: String,
    /// The name of the `ForEach` that iterates over the elements.
    pub(crate) each: String,
    pub(crate) max_elements: Option<Tree>,
}

/// A link to one element of a `ForEach` whose number of elements is not known yet.
pub struct Pick {
    /// The index of the repeated node in the list of parsed nodes.
    pub(crate) of: usize,
    /// The number of the element, counted from 1.
    pub(crate) number: usize,
    /// The type of the node that computes the element.
    pub(crate) kind: String,
    pub(crate) outputs: Vec<String>,
}
