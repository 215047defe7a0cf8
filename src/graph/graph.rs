//! A graph that has been checked.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use maquette_node::reading::Readers;
use maquette_syntax::error::{Problem, Severity, Source, Span};
use maquette_syntax::{ron, shell};
use maquette_value::{Hash, ValueType};

use crate::Shape;
use crate::definition::Whole;
use crate::expected::Expected;
use crate::flat::{Counts, GraphNode, GraphOutput, GraphUse, Loop};
use crate::input::{GraphInput, GraphPort, KnownInputs};
use crate::options::{Options, ReadFile};
use crate::pins::Pins;

/// A graph that has been checked: every name, type, range and path in it is right.
#[derive(Clone)]
pub struct Graph {
    pub(crate) source: Arc<Source>,
    /// The files of the graphs that it uses.
    pub(crate) subgraphs: Vec<PathBuf>,
    /// What it is for, in its author's words.
    pub(crate) doc: String,
    /// Its nodes, each after those that it hangs on.
    pub(crate) nodes: Arc<[GraphNode]>,
    pub(crate) shape: Arc<Shape>,
    pub(crate) outputs: Vec<GraphOutput>,
    /// What reads the files of its nodes.
    pub(crate) readers: Arc<Readers>,
    /// What it wants and gives if it is a function of values.
    pub(crate) inputs: Vec<GraphInput>,
    pub(crate) ports: Vec<GraphPort>,
    /// What it is made of again without some inputs, if it has such that may be left out and none has been given a value yet.
    pub(crate) text: Option<Arc<GraphText>>,
    /// What must hold of its values, and of those of the graphs that it uses.
    pub(crate) expect: Arc<[Expected]>,
    /// Its inputs and parameters, described as a node's fields are.
    pub(crate) schema: serde_json::Value,
    /// What looks like a node in a file and is none: uses of graphs, `ForEach` and `Switch`.
    pub(crate) uses: Arc<[GraphUse]>,
    /// Each `ForEach` over data.
    pub(crate) loops: Arc<[Loop]>,
    /// Those of which the number of elements has been found out.
    pub(crate) settled: BTreeSet<String>,
    /// What it is expanded from again, if it has such.
    pub(crate) stage: Option<Arc<Stage>>,
    /// The values at its inputs.
    pub(crate) given: KnownInputs,
    /// The words of a command that say how it was read.
    pub(crate) words: Arc<[String]>,
    /// Names in its own file that no output of it needs, and what is wanted and never given.
    pub(crate) warnings: Vec<Problem>,
}

/// A graph, if it can be evaluated, and all problems of its file.
pub struct Checked {
    /// The graph; none if a problem is an error.
    pub graph: Option<Graph>,
    /// If all errors are nodes of unknown types and missing files of nodes: the graph in which these nodes, and what depends on them,
    /// give nothing.
    pub partial: Option<Graph>,
    /// All problems, in the order of their places.
    pub problems: Vec<Problem>,
    /// The files that its nodes read, those that are not there included: all of them if there is a graph, else those of the
    /// nodes that could be understood.
    pub files: Vec<ReadFile>,
    /// The files of the graphs that it uses, those that are not there included.
    pub subgraphs: Vec<PathBuf>,
}

impl Graph {
    /// The text of its file.
    pub fn source(&self) -> &Arc<Source> {
        &self.source
    }

    /// Its nodes, each after those that it hangs on.
    pub fn nodes(&self) -> &Arc<[GraphNode]> {
        &self.nodes
    }

    /// The files that it gives.
    pub fn outputs(&self) -> &[GraphOutput] {
        &self.outputs
    }

    /// What looks like a node in a file and is none: uses of graphs, `ForEach` and `Switch`.
    pub fn uses(&self) -> &Arc<[GraphUse]> {
        &self.uses
    }

    /// What must hold of its values, and of those of the graphs that it uses.
    pub fn expectations(&self) -> &Arc<[Expected]> {
        &self.expect
    }

    /// What reads the files of its nodes.
    pub fn readers(&self) -> &Arc<Readers> {
        &self.readers
    }

    pub fn shape(&self) -> &Arc<Shape> {
        &self.shape
    }

    /// The words of a command that say how it was read.
    pub fn words(&self) -> &[String] {
        &self.words
    }

    /// Remembers what it is made of, if it may have to be made again without some inputs.
    pub fn remember(&mut self, path: &Path, text: &str, options: &Options) {
        if self.inputs.iter().any(|input| input.optional) {
            let (path, text, options) = (path.to_owned(), text.to_owned(), options.clone());
            self.text = Some(Arc::new(GraphText { path, text, options }));
        }
    }

    /// An error that has no place in the graph's text.
    pub fn problem(&self, code: &'static str, message: String) -> Problem {
        Problem::new(Severity::Error, code, (self.source.clone(), Span::default()), message)
    }

    /// A warning for each node of its own file that nothing needs: no output, and nothing that is expected of a value; and for each
    /// property that is wanted of a value that never has it.
    pub fn unused(&self) -> &[Problem] {
        &self.warnings
    }

    /// What it is for, in its author's words.
    pub fn doc(&self) -> &str {
        &self.doc
    }

    /// The text of its file.
    pub fn source_text(&self) -> &str {
        &self.source.text
    }

    /// The names of its nodes, each after those that it hangs on.
    pub fn node_names(&self) -> impl Iterator<Item = &str> {
        self.nodes.iter().map(|node| node.name.as_str())
    }

    /// Its inputs and parameters as a JSON schema, as a node's fields are described: types, ranges, units, defaults, words.
    pub fn schema(&self) -> &serde_json::Value {
        &self.schema
    }

    /// The hash of what it computes: of its nodes' names, types, parameters and links. Of files that it reads only their endings count, so
    /// that it is the same wherever the graph lies.
    pub fn identity(&self) -> Hash {
        self.shape.identity
    }

    /// The names of its outputs.
    pub fn output_names(&self) -> impl Iterator<Item = &str> {
        self.outputs.iter().map(|output| output.name.as_str())
    }

    /// What it gives: the name of each file, or of each value of a graph that is a function, and the type of what it holds; no type if it
    /// has that of what comes in.
    pub fn results(&self) -> impl Iterator<Item = (&str, Option<&'static ValueType>)> {
        let files =
            self.outputs.iter().map(|output| (&output.name[..], output.node, output.output));
        let ports = self.ports.iter().map(|port| (&port.name[..], port.node, port.output));
        let ports = ports.filter(|_| self.is_function());
        files
            .chain(ports)
            .map(|(name, node, output): (_, usize, usize)| (name, self.nodes[node].types[output]))
    }

    /// Returns true if the graph has the section `inputs`, even an empty one: its outputs are values in place of files.
    pub fn is_function(&self) -> bool {
        self.outputs.is_empty() && !self.ports.is_empty()
    }

    /// A value for a parameter of this name as RON, as [`Options::set`] takes it: words are choices, texts or colors, and lists are vectors,
    /// as its declaration says. None if there is no such parameter.
    pub fn as_ron(&self, parameter: &str, value: &serde_json::Value) -> Option<String> {
        let declared = self.schema.get("properties")?.get(parameter)?;
        Some(ron(value, declared, &self.schema))
    }

    /// A command on one of its values for people, `maquette inspect graph.ron nose`, with the values that it was read with.
    pub fn command(&self, verb: &str, link: &str) -> String {
        let file = self.source.name.display().to_string();
        let given = self.given.keys().flat_map(|name| ["--input".into(), format!("{name}=..")]);
        let words = [file, link.into()].into_iter().chain(self.words.iter().cloned()).chain(given);
        words.fold(format!("maquette {verb}"), |command, word| command + " " + &shell(&word))
    }

    /// The node and output of a value by the name of an output, or by its link.
    pub fn value_named(&self, name: &str) -> Option<(usize, usize)> {
        let outputs = self.outputs.iter().map(|output| (&output.name, output.node, output.output));
        let ports = self.ports.iter().map(|port| (&port.name, port.node, port.output));
        let found = outputs.chain(ports).find(|(known, ..)| *known == name);
        found.map(|(_, node, output)| (node, output)).or_else(|| self.target(name))
    }

    /// The node and output that a link names: `node`, `node.output`, and the same of a use of a graph.
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

    /// The nodes of this name, or all that make what a use of this name gives.
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

    /// The names of nodes and of what else looks like nodes.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.node_names().chain(self.uses.iter().map(|given| &given.name[..]))
    }

    /// The place of a node, by name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.shape.names.iter().position(|other| other == name)
    }

    /// Whether evaluating it computes and writes the same as evaluating the other one: they differ in comments and order of
    /// fields at most, as long as no file that they read changes.
    pub fn means_the_same(&self, other: &Self) -> bool {
        // Of a graph with an example of its elements the parts do not say all.
        self.stage.is_none() && self.has_the_same_parts(other)
    }

    /// Whether its nodes, outputs and expectations are those of the other one; one element of a `ForEach` over data stands for all.
    pub fn has_the_same_parts(&self, other: &Self) -> bool {
        self.shape.identity == other.shape.identity
            && self.expect.len() == other.expect.len()
            && self.expect.iter().zip(&*other.expect).all(|(a, b): (&Expected, &Expected)| {
                (&a.expectation, &a.values) == (&b.expectation, &b.values)
            })
            && self.files().eq(other.files())
            && self.outputs.len() == other.outputs.len()
            && self.outputs.iter().zip(&other.outputs).all(
                |(a, b): (&GraphOutput, &GraphOutput)| {
                    (&a.name, a.node, a.output) == (&b.name, b.node, b.output)
                },
            )
    }

    /// The files that it is made of: its own, and those of the graphs that it uses.
    pub fn texts(&self) -> impl Iterator<Item = &Path> {
        [&self.source.name].into_iter().chain(&self.subgraphs).map(|path| &**path)
    }

    /// All files that evaluating it may read, those that need not be there included.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.nodes.iter().flat_map(|node| &node.files).map(|file| &*file.path)
    }
}

/// The text of a graph, of which another graph is made where inputs are left out.
pub(crate) struct GraphText {
    pub(crate) path: PathBuf,
    pub(crate) text: String,
    pub(crate) options: Options,
}

/// All that a graph is expanded from again.
pub(crate) struct Stage {
    pub whole: Arc<Whole>,
    pub options: Options,
    pub root: PathBuf,
    /// Whether it has nodes of unknown types.
    pub is_partial: bool,
    /// The inputs that are left out.
    pub absent: BTreeSet<String>,
    pub pins: Arc<Pins>,
    /// The last expansion, without this.
    pub last: Mutex<Option<(Counts, Graph)>>,
}
