//! The parts of a flat graph, in which all used graphs have been replaced by their nodes: nodes, links and outputs.

use std::collections::BTreeMap;
use std::sync::Arc;

use maquette_node::AnyNode;
use maquette_node::pack::Format;
use maquette_syntax::error::{Diagnostic, Position, Severity, Source, Span, Use, code};
use maquette_syntax::{Origin, SourceMap, Tree};
use maquette_value::ValueType;
use serde_json::Value as Json;

use crate::files::NodeFile;
use crate::recipe::Recipe;

/// A node of a flat graph.
#[derive(Clone)]
pub struct GraphNode {
    pub name: String,
    pub recipe: Arc<Recipe>,
    /// The text of the file that contains the node.
    pub source_map: Arc<SourceMap>,
    pub span: Span,
    /// The path from the root graph to the node: each item is a node that uses another graph, outermost first.
    pub uses: Arc<[Use]>,
    pub node: Arc<dyn AnyNode>,
    /// The pack of the node type; empty for types of the engine itself.
    pub pack: &'static str,
    /// The links of the ports. The index of a link in this list is the *slot* of its port.
    pub links: Vec<Link>,
    /// The files that the node reads.
    pub files: Vec<NodeFile>,
    /// The call of the node as the file contains it, with parameters replaced by their values.
    pub(crate) tree: Arc<Tree>,
    pub outputs: Vec<&'static str>,
    /// The type of each output. `None` if the type depends on a port that has no link.
    pub types: Vec<Option<&'static ValueType>>,
    /// The properties of inputs that are tested before the node runs.
    pub guards: Vec<Guard>,
}

/// A node of a graph file that was replaced by other nodes: a used graph, a `ForEach` or a `Switch`.
#[derive(Clone)]
pub struct GraphUse {
    pub name: String,
    /// The name of the used type, such as `Feature`.
    pub kind: String,
    /// For each port, the linked node and output.
    pub inputs: Vec<(String, (usize, usize))>,
    /// For each output, the nodes and outputs of the flat graph that compute it. Only an output of a `ForEach` has several.
    pub outputs: Vec<(String, Vec<(usize, usize)>)>,
    /// True for a `ForEach` whose number of elements is still unknown. One example node represents its elements.
    pub is_open: bool,
}

/// A link from a port to another node's output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    pub port: String,
    pub node: usize,
    pub output: usize,
}

/// An output file of a graph.
#[derive(Clone)]
pub struct GraphOutput {
    /// The path of the file relative to the output folder.
    pub name: String,
    pub node: usize,
    pub output: usize,
    pub format: Format,
    /// The parameters and other values from outside of the graph on which the output depends.
    pub lineage: Arc<Lineage>,
    /// The file that declares the output. `span` is a position in that file.
    pub source: Arc<Source>,
    pub span: Span,
}

impl GraphNode {
    /// Returns the name of the type: `Threshold`.
    pub fn kind(&self) -> &str {
        &self.recipe.kind
    }

    /// Returns the position of a parameter as text, such as `file:line:column`. `path` leads to the parameter through the node's fields.
    /// For a value that is passed on from graph to graph, the position is that of the original value.
    pub fn place_of(&self, path: &[String]) -> String {
        let tree = self.tree.descend(path);
        match &tree.origin {
            Some(Origin::External(given)) => given.location(),
            _ => self.source_map.describe_location(tree.span),
        }
    }

    /// Returns a diagnostic at the position of the node.
    pub fn diagnostic(
        &self,
        severity: Severity,
        code: &'static str,
        message: String,
        help: &str,
    ) -> Diagnostic {
        let (source, span) = self.source_map.locate(self.span);
        Diagnostic {
            help: help.into(),
            uses: self.uses.to_vec(),
            ..Diagnostic::new(severity, code, (source, span), message)
        }
    }
}

/// The parameters and other values from outside of a graph on which an output depends.
#[derive(Debug, Default)]
pub struct Lineage {
    /// True for a draft, in which each `Draft(..)` has its draft value.
    pub draft: bool,
    /// The names of the parameters on which the output depends, in the order of the file.
    pub parameters: Vec<String>,
    /// The fields of nodes that the option `--set` has set, with their values.
    pub set: Vec<(String, Json)>,
}

/// The number of elements of each `ForEach` over data, by the name of the `ForEach`, if the number is known.
pub type Counts = BTreeMap<String, Count>;

/// The result of counting the elements of a `ForEach`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Count {
    /// The data are split into this number of elements.
    Of(usize),
    /// The data cannot be split into elements; contains the reason.
    Refused(String),
}

/// A `ForEach` over data in a flat graph.
#[derive(Clone, Debug)]
pub struct Loop {
    /// The name of the `ForEach` in the graph file.
    pub name: String,
    /// The node that splits the data into elements.
    pub node: usize,
    /// True if the number of elements is still unknown. The graph then contains one example element.
    pub is_open: bool,
}

/// A test of a property of a node's input, made before the node runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    /// The index of the link whose value is tested.
    pub slot: usize,
    pub property: &'static str,
    /// A description of the origin of the requirement: port `mesh`, or input `skin` of `shell`.
    pub by: Arc<str>,
    /// The input of a used graph that requires the property. `None` if a port of the node itself requires it.
    pub input: Option<Arc<RequiringInput>>,
}

/// An input of a graph that requires a property.
#[derive(Debug, PartialEq)]
pub struct RequiringInput {
    /// The file that declares the input. `span` is a position in that file.
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    /// The path from the root graph to the graph of the input, outermost use first.
    pub(crate) uses: Arc<[Use]>,
}

impl RequiringInput {
    /// Returns the error for a violated requirement. Its position is that of the node that uses the graph or, for a root graph, the
    /// declaration of the input.
    pub fn diagnostic(&self, message: String, help: String) -> Diagnostic {
        let (source, span) = (self.source.clone(), self.span);
        fn failure(place: (Arc<Source>, Span), message: String) -> Diagnostic {
            Diagnostic::new(Severity::Error, code::FAILED, place, message)
        }
        let Some((last, outer)) = self.uses.split_last() else {
            return Diagnostic { help, ..failure((source, span), message) };
        };
        let Position { line, column } = Position::from_offset(&source.text, span.start);
        let wanted = format!("this is required at {}:{line}:{column}", source.name.display());
        let help = if help.is_empty() { wanted } else { format!("{wanted}; {help}") };
        Diagnostic {
            help,
            uses: outer.to_vec(),
            ..failure((last.source.clone(), last.span), message)
        }
    }
}
