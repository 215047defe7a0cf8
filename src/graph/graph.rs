//! Graphs that have been checked.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use maquette_node::importers::Readers;
use maquette_syntax::error::{Diagnostic, Severity, Source, Span};
use maquette_syntax::{quote_for_shell, to_ron};
use maquette_value::{Hash, ValueType};

use crate::Topology;
use crate::definition::ParsedFile;
use crate::expected::GraphExpectation;
use crate::flat::{Counts, GraphNode, GraphOutput, GraphUse, Loop};
use crate::input::{GraphInput, GraphPort, KnownInputs};
use crate::options::{Options, ReadFile};
use crate::pins::Pins;

/// A checked graph, in which every name, type, range and path is valid.
#[derive(Clone)]
pub struct Graph {
    pub(crate) source: Arc<Source>,
    /// The files of the graphs that this graph uses.
    pub(crate) subgraphs: Vec<PathBuf>,
    /// The author's description of the graph.
    pub(crate) doc: String,
    /// The nodes, ordered so that each node comes after those on which it depends.
    pub(crate) nodes: Arc<[GraphNode]>,
    pub(crate) topology: Arc<Topology>,
    pub(crate) outputs: Vec<GraphOutput>,
    /// The file readers of all packs of the program.
    pub(crate) readers: Arc<Readers>,
    /// The inputs, if the graph has a section `inputs`. The outputs of such a graph are `ports`.
    pub(crate) inputs: Vec<GraphInput>,
    pub(crate) ports: Vec<GraphPort>,
    /// The text of the file, for expanding the graph again without some optional inputs. `None` if the graph has no optional inputs, or if
    /// one of them already has a value.
    pub(crate) text: Option<Arc<GraphText>>,
    /// The expectations of the graph and of the graphs that it uses.
    pub(crate) expect: Arc<[GraphExpectation]>,
    /// The JSON schema of the graph's inputs and parameters.
    pub(crate) schema: serde_json::Value,
    /// The entries that are written like nodes but were replaced by other nodes: used graphs, `ForEach` and `Switch`.
    pub(crate) uses: Arc<[GraphUse]>,
    /// Each `ForEach` of the graph that iterates over data.
    pub(crate) loops: Arc<[Loop]>,
    /// The names of all `ForEach` nodes over data whose number of elements is known.
    pub(crate) counted: BTreeSet<String>,
    /// The data for expanding the graph again with other numbers of elements. `None` if the graph has no `ForEach` over data.
    pub(crate) stage: Option<Arc<Stage>>,
    /// What is known about the values of the graph's inputs.
    pub(crate) given: KnownInputs,
    /// The command-line options with which the graph was read.
    pub(crate) words: Arc<[String]>,
    /// Warnings about unused nodes, and about required properties that a value never has.
    pub(crate) warnings: Vec<Diagnostic>,
}

/// The result of checking a graph file.
pub struct CheckedGraph {
    /// The graph. `None` if the file has errors.
    pub graph: Option<Graph>,
    /// The graph in which invalid nodes and their dependents fail when they are evaluated. `None` if there are errors other than unknown
    /// types and missing files of nodes.
    pub partial: Option<Graph>,
    /// All diagnostics, in the order of their positions.
    pub diagnostics: Vec<Diagnostic>,
    /// The files that the nodes read, including missing files. If there is no graph, only the files of valid nodes.
    pub files: Vec<ReadFile>,
    /// The files of the graphs that the graph uses, including missing files.
    pub subgraphs: Vec<PathBuf>,
}

impl Graph {
    /// Returns the text of the graph's file.
    pub fn source(&self) -> &Arc<Source> {
        &self.source
    }

    /// Returns the nodes. Each node comes after those on which it depends.
    pub fn nodes(&self) -> &Arc<[GraphNode]> {
        &self.nodes
    }

    /// Returns the output files.
    pub fn outputs(&self) -> &[GraphOutput] {
        &self.outputs
    }

    /// Returns the entries that are written like nodes but were replaced by other nodes: used graphs, `ForEach` and `Switch`.
    pub fn uses(&self) -> &Arc<[GraphUse]> {
        &self.uses
    }

    /// Returns the expectations of the graph and of the graphs that it uses.
    pub fn expectations(&self) -> &Arc<[GraphExpectation]> {
        &self.expect
    }

    /// Returns the file readers with which the files of nodes are read.
    pub fn readers(&self) -> &Arc<Readers> {
        &self.readers
    }

    pub fn topology(&self) -> &Arc<Topology> {
        &self.topology
    }

    /// Returns the command-line options with which the graph was read.
    pub fn words(&self) -> &[String] {
        &self.words
    }

    /// Stores the text of the graph, if it has optional inputs and may have to be expanded again without some of them.
    pub fn remember(&mut self, path: &Path, text: &str, options: &Options) {
        if self.inputs.iter().any(|input| input.optional) {
            let (path, text, options) = (path.to_owned(), text.to_owned(), options.clone());
            self.text = Some(Arc::new(GraphText { path, text, options }));
        }
    }

    /// Returns an error without a position in the graph's text.
    pub fn diagnostic(&self, code: &'static str, message: String) -> Diagnostic {
        Diagnostic::new(Severity::Error, code, (self.source.clone(), Span::default()), message)
    }

    /// Returns the warnings: one for each node of the root graph's file that no output or expectation needs, and one for each required
    /// property that a value never has.
    pub fn unused_warnings(&self) -> &[Diagnostic] {
        &self.warnings
    }

    /// Returns the author's description of the graph.
    pub fn doc(&self) -> &str {
        &self.doc
    }

    /// Returns the text of the graph's file.
    pub fn source_text(&self) -> &str {
        &self.source.text
    }

    /// Returns the names of the nodes. Each node comes after those on which it depends.
    pub fn node_names(&self) -> impl Iterator<Item = &str> {
        self.nodes.iter().map(|node| node.name.as_str())
    }

    /// Returns the inputs and parameters as a JSON schema in the form of a node's fields, with types, ranges, units, defaults and
    /// descriptions.
    pub fn schema(&self) -> &serde_json::Value {
        &self.schema
    }

    /// Returns the hash of everything that the graph computes: names, types, parameters and links of the nodes. Only the extensions of file
    /// paths are included, so the hash does not depend on the location of the graph.
    pub fn identity(&self) -> Hash {
        self.topology.identity
    }

    /// Returns the names of the output files.
    pub fn output_names(&self) -> impl Iterator<Item = &str> {
        self.outputs.iter().map(|output| output.name.as_str())
    }

    /// Returns the name and type of each output file or, if the graph has inputs, of each output value. The type is `None` if it depends on
    /// an input.
    pub fn results(&self) -> impl Iterator<Item = (&str, Option<&'static ValueType>)> {
        let files =
            self.outputs.iter().map(|output| (&output.name[..], output.node, output.output));
        let ports = self.ports.iter().map(|port| (&port.name[..], port.node, port.output));
        let ports = ports.filter(|_| self.is_function());
        files
            .chain(ports)
            .map(|(name, node, output): (_, usize, usize)| (name, self.nodes[node].types[output]))
    }

    /// Returns true if the graph has the section `inputs`, even an empty one. The outputs of such a graph are values, not files.
    pub fn is_function(&self) -> bool {
        self.outputs.is_empty() && !self.ports.is_empty()
    }

    /// Converts a value for a parameter to RON, in the form that [`Options::set`] takes. The declaration of the parameter determines if a
    /// string is a choice, a text or a color. A list is converted to a vector. Returns `None` if no such parameter exists.
    pub fn as_ron(&self, parameter: &str, value: &serde_json::Value) -> Option<String> {
        let declared = self.schema.get("properties")?.get(parameter)?;
        Some(to_ron(value, declared, &self.schema))
    }

    /// Returns a command line about one of the graph's values, such as `maquette inspect graph.ron nose`, with the options with which the
    /// graph was read.
    pub fn command(&self, verb: &str, link: &str) -> String {
        let file = self.source.name.display().to_string();
        let given = self.given.keys().flat_map(|name| ["--input".into(), format!("{name}=..")]);
        let words = [file, link.into()].into_iter().chain(self.words.iter().cloned()).chain(given);
        words.fold(format!("maquette {verb}"), |command, word| {
            command + " " + &quote_for_shell(&word)
        })
    }

    /// Returns the node and output of a value. `name` is the name of an output of the graph, or a link such as `nose.mask`.
    pub fn find_value(&self, name: &str) -> Option<(usize, usize)> {
        let outputs = self.outputs.iter().map(|output| (&output.name, output.node, output.output));
        let ports = self.ports.iter().map(|port| (&port.name, port.node, port.output));
        let found = outputs.chain(ports).find(|(known, ..)| *known == name);
        found.map(|(_, node, output)| (node, output)).or_else(|| self.target(name))
    }

    /// Returns the node and output to which a link leads: `node`, `node.output`, or an output of a used graph.
    pub fn target(&self, link: &str) -> Option<(usize, usize)> {
        let (name, output) = match link.split_once('.') {
            Some((name, output)) => (name, Some(output)),
            None => (link, None),
        };
        if let Some(index) = self.find(name) {
            let names = &self.nodes[index].outputs;
            let output = output.map_or(Some(0), |output| names.iter().position(|n| *n == output));
            return output.map(|output| (index, output));
        }
        if let Some(element) = self.element(name) {
            return Some(element);
        }
        let given = self.uses.iter().find(|given| given.name == name)?;
        match given.outputs.iter().find(|(name, _)| output.is_none_or(|output| output == name))?.1[..]
        {
            [target] => Some(target),
            _ => None,
        }
    }

    /// Returns the node of this name. If the name belongs to a used graph, returns all nodes that compute the outputs of that graph.
    pub fn nodes_of(&self, name: &str) -> Vec<usize> {
        let given = self.uses.iter().filter(|given| given.name == name);
        let given = given.flat_map(|given| &given.outputs).flat_map(|(_, targets)| targets);
        let element = self.element(name).map(|(node, _)| node);
        let own = self.find(name).or(element);
        let mut nodes: Vec<_> = given.map(|(node, _)| *node).chain(own).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Returns the names of all nodes and used graphs, and of each `ForEach` and `Switch`.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.node_names().chain(self.uses.iter().map(|given| &given.name[..]))
    }

    /// Returns the index of a node by its name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.topology.names.iter().position(|other| other == name)
    }

    /// Returns true if both graphs compute and write equal data. Such graphs differ at most in comments and the order of fields.
    pub fn means_the_same(&self, other: &Self) -> bool {
        // While an example represents the elements of a `ForEach`, graphs with equal parts may still differ.
        self.stage.is_none() && self.has_the_same_parts(other)
    }

    /// Returns true if both graphs have equal nodes, outputs and expectations. Each `ForEach` over data is compared by its example element.
    pub fn has_the_same_parts(&self, other: &Self) -> bool {
        self.topology.identity == other.topology.identity
            && self.expect.len() == other.expect.len()
            && self.expect.iter().zip(&*other.expect).all(
                |(a, b): (&GraphExpectation, &GraphExpectation)| {
                    (&a.expectation, &a.values) == (&b.expectation, &b.values)
                },
            )
            && self.files().eq(other.files())
            && self.outputs.len() == other.outputs.len()
            && self.outputs.iter().zip(&other.outputs).all(
                |(a, b): (&GraphOutput, &GraphOutput)| {
                    (&a.name, a.node, a.output) == (&b.name, b.node, b.output)
                },
            )
    }

    /// Returns the files of the graph itself and of the graphs that it uses.
    pub fn texts(&self) -> impl Iterator<Item = &Path> {
        [&self.source.name].into_iter().chain(&self.subgraphs).map(|path| &**path)
    }

    /// Returns all files that an evaluation may read, including optional ones.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.nodes.iter().flat_map(|node| &node.files).map(|file| &*file.path)
    }
}

/// The text of a file, for expanding the graph again without some optional inputs.
pub(crate) struct GraphText {
    pub(crate) path: PathBuf,
    pub(crate) text: String,
    pub(crate) options: Options,
}

/// The data for expanding a graph again with other numbers of elements.
pub(crate) struct Stage {
    pub whole: Arc<ParsedFile>,
    pub options: Options,
    pub root: PathBuf,
    /// True if the graph has nodes of unknown types.
    pub is_partial: bool,
    /// The names of the optional inputs that are omitted.
    pub absent: BTreeSet<String>,
    pub pins: Arc<Pins>,
    /// The last expansion, with its numbers of elements. The field `stage` of that graph is `None`.
    pub last: Mutex<Option<(Counts, Graph)>>,
}
