//! The parts of a flat graph: nodes, links and outputs.

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
    /// The uses of graphs that lead to the node, from the outermost one.
    pub uses: Arc<[Use]>,
    pub node: Arc<dyn AnyNode>,
    /// The pack of the node type; empty for types of the engine itself.
    pub pack: &'static str,
    /// The links of the ports. The index of a link in this list is the *slot* of its port.
    pub links: Vec<Link>,
    /// The files that the node reads.
    pub files: Vec<NodeFile>,
    /// The call as the file contains it, with parameters replaced by their values.
    pub(crate) tree: Arc<Tree>,
    pub outputs: Vec<&'static str>,
    /// The type of each output. `None` if the type depends on a port without a link.
    pub types: Vec<Option<&'static ValueType>>,
    /// The tests of the node's inputs that are made before the node runs.
    pub guards: Vec<Guard>,
}

/// A use of a graph, a `ForEach` or a `Switch`.
#[derive(Clone)]
pub struct GraphUse {
    pub name: String,
    /// The name of the used type, such as `Feature`.
    pub kind: String,
    /// For each port, the linked node and output.
    pub inputs: Vec<(String, (usize, usize))>,
    /// For each output, the nodes and outputs that it represents. Only an output of a `ForEach` represents several.
    pub outputs: Vec<(String, Vec<(usize, usize)>)>,
    /// True for a `ForEach` whose elements are not known yet, so that an example represents them.
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
    /// The path relative to the output folder.
    pub name: String,
    pub node: usize,
    pub output: usize,
    pub format: Format,
    /// The values from outside of the graph on which the output depends.
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

    /// Returns the position of the parameter at a path through the node's fields, as text. If uses pass a value on to a parameter, the
    /// position is the one at which the value is written.
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

/// The values from outside of a graph on which an output depends.
#[derive(Debug, Default)]
pub struct Lineage {
    /// True for a draft, in which each `Draft(..)` has its draft value.
    pub draft: bool,
    /// The names of parameters, in the order of the file.
    pub parameters: Vec<String>,
    /// The fields of nodes that `--set` has set.
    pub set: Vec<(String, Json)>,
}

/// The number of elements of each `ForEach` over data, by the name of the `ForEach`, if the number is known.
pub type Counts = BTreeMap<String, Count>;

/// The result of counting the elements of a `ForEach`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Count {
    /// The data have this number of elements.
    Of(usize),
    /// The data cannot be split into elements; contains the reason.
    Refused(String),
}

/// A `ForEach` over data in a flat graph.
#[derive(Clone, Debug)]
pub struct Loop {
    /// The name of the `ForEach`.
    pub name: String,
    /// The node that splits the data into elements.
    pub node: usize,
    /// True if the number of elements is not known, so that the graph contains an example.
    pub is_open: bool,
}

/// A guard: a test of an input of a node, made before the node runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    /// The index of the link at the tested input.
    pub slot: usize,
    pub property: &'static str,
    /// A description of the part that has the requirement: port `mesh`, or input `skin` of `shell`.
    pub by: Arc<str>,
    /// The input of the graph that requires the property. `None` if a port of the node requires it.
    pub input: Option<Arc<RequiringInput>>,
}

/// An input of a graph that requires a property.
#[derive(Debug, PartialEq)]
pub struct RequiringInput {
    /// The file that declares the input. `span` is a position in that file.
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    /// The uses that lead to the graph, from the outermost one.
    pub(crate) uses: Arc<[Use]>,
}

impl RequiringInput {
    /// Returns the error for a violated requirement, at the position of the use. If no other graph uses the graph, the error is at the
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
