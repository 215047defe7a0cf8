//! What a flat graph is made of: nodes, links and outputs.

use std::collections::BTreeMap;
use std::sync::Arc;

use maquette_node::AnyNode;
use maquette_node::pack::Format;
use maquette_syntax::error::{Place, Problem, Severity, Source, Span, Use, code};
use maquette_syntax::{Origin, Sheet, Tree};
use maquette_value::ValueType;
use serde_json::Value as Json;

use crate::files::NodeFile;
use crate::recipe::Recipe;

/// A node of a graph.
#[derive(Clone)]
pub struct GraphNode {
    pub name: String,
    pub recipe: Arc<Recipe>,
    /// The text in which it stands.
    pub sheet: Arc<Sheet>,
    pub span: Span,
    /// The uses of graphs that lead to it.
    pub uses: Arc<[Use]>,
    pub node: Arc<dyn AnyNode>,
    /// The pack that has its type; empty for what is the engine's own.
    pub pack: &'static str,
    /// What its ports are linked to; a port's slot is its index here.
    pub links: Vec<Link>,
    /// The files that it reads.
    pub files: Vec<NodeFile>,
    /// What stands in the file.
    pub(crate) tree: Arc<Tree>,
    pub outputs: Vec<&'static str>,
    /// The type of each output; none for that of a union whose port has no link.
    pub types: Vec<Option<&'static ValueType>>,
    /// What is tested of the values that come to it before it runs.
    pub guards: Vec<Guard>,
}

/// A use of a graph, or what else stands for nodes.
#[derive(Clone)]
pub struct GraphUse {
    pub name: String,
    /// The type's name: `Feature`.
    pub kind: String,
    /// What each port is linked to, by node and output.
    pub inputs: Vec<(String, (usize, usize))>,
    /// What each output gives; several values only for a `ForEach`.
    pub outputs: Vec<(String, Vec<(usize, usize)>)>,
    /// A `ForEach` whose elements are not known yet: its nodes are those of an example.
    pub is_open: bool,
}

/// A link from a port to another node's output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    pub port: String,
    pub node: usize,
    pub output: usize,
}

/// A file that a graph gives.
#[derive(Clone)]
pub struct GraphOutput {
    /// Relative to the folder of all outputs.
    pub name: String,
    pub node: usize,
    pub output: usize,
    pub format: Format,
    /// What from outside may shape it.
    pub lineage: Arc<Lineage>,
    /// The file that names it, and where.
    pub source: Arc<Source>,
    pub span: Span,
}

impl GraphNode {
    /// The type's name: `Threshold`.
    pub fn kind(&self) -> &str {
        &self.recipe.kind
    }

    /// Where the parameter at the end of this way through the node's fields stands, as far as the file says it: in words. What
    /// comes through uses stands where the first of them has it.
    pub fn place_of(&self, path: &[String]) -> String {
        let tree = self.tree.at(path);
        match &tree.origin {
            Some(Origin::Given(given)) => given.place(),
            _ => self.sheet.place_in_words(tree.span),
        }
    }

    /// A problem of the node, at its place.
    pub fn problem(
        &self,
        severity: Severity,
        code: &'static str,
        message: String,
        help: &str,
    ) -> Problem {
        let (source, span) = self.sheet.place(self.span);
        Problem {
            help: help.into(),
            uses: self.uses.to_vec(),
            ..Problem::new(severity, code, (source, span), message)
        }
    }
}

/// The values from outside that may shape an output.
#[derive(Debug, Default)]
pub struct Lineage {
    /// Whether each `Draft(..)` stands for its draft.
    pub draft: bool,
    /// Names of parameters, in the order of the file.
    pub parameters: Vec<String>,
    /// Values of nodes' fields from `--set`.
    pub set: Vec<(String, Json)>,
}

/// How many elements each `ForEach` over data has, by its name, as far as that is known.
pub type Counts = BTreeMap<String, Count>;

/// What is known of the elements of a `ForEach`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Count {
    /// So many.
    Of(usize),
    /// Nothing can be made of them, because of this.
    Refused(String),
}

/// A `ForEach` over data in a flat graph.
#[derive(Clone, Debug)]
pub struct Loop {
    /// Its name.
    pub name: String,
    /// The node that takes the data apart.
    pub node: usize,
    /// Whether the number of its elements is not known: the graph has one example.
    pub is_open: bool,
}

/// A test of a value that comes to a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    /// The place of the link.
    pub slot: usize,
    pub property: &'static str,
    /// Who wants it, in words: port `mesh`, or input `skin` of `shell`.
    pub by: Arc<str>,
    /// The input that wants it, if it is not a port of the node.
    pub input: Option<Arc<Wanter>>,
}

/// An input of a graph that wants a property.
#[derive(Debug, PartialEq)]
pub struct Wanter {
    /// Where it says so.
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    /// The uses that lead to the graph, the outermost first.
    pub(crate) uses: Arc<[Use]>,
}

impl Wanter {
    /// What comes in is not so: told where the graph is used, or where the input is declared if nobody uses it.
    pub fn problem(&self, message: String, help: String) -> Problem {
        let (source, span) = (self.source.clone(), self.span);
        fn problem(place: (Arc<Source>, Span), message: String) -> Problem {
            Problem::new(Severity::Error, code::FAILED, place, message)
        }
        let Some((last, outer)) = self.uses.split_last() else {
            return Problem { help, ..problem((source, span), message) };
        };
        let Place { line, column } = Place::of(&source.text, span.start);
        let wanted = format!("this is wanted at {}:{line}:{column}", source.name.display());
        let help = if help.is_empty() { wanted } else { format!("{wanted}; {help}") };
        Problem { help, uses: outer.to_vec(), ..problem((last.source.clone(), last.span), message) }
    }
}
