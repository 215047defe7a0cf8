//! A graph that has been checked, and what shapes its reading.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_node::AnyNode;
use maquette_node::pack::Format;
use maquette_node::reading::Readers;
use maquette_syntax::error::{Problem, Severity, Source, Span, Use};
use maquette_syntax::paths::without_dots;
use maquette_syntax::{Origin, Sheet, Tree, ron, shell};
use maquette_value::plain;
use maquette_value::{Hash, ValueType};

use super::lineage::Lineage;
use super::*;
use crate::catalog::Catalog;
use crate::files::NodeFile;

/// A graph that has been checked: every name, type, range and path in it is right.
#[derive(Clone)]
pub struct Graph {
    pub source: Arc<Source>,
    /// The files of the graphs that it uses.
    pub(crate) subgraphs: Vec<PathBuf>,
    /// What it is for, in its author's words.
    pub doc: String,
    /// Its nodes, each after those that it hangs on.
    pub nodes: Arc<[GraphNode]>,
    pub shape: Arc<Shape>,
    pub outputs: Vec<GraphOutput>,
    /// What reads the files of its nodes.
    pub readers: Arc<Readers>,
    /// What it wants and gives if it is a function of values.
    pub(crate) inputs: Vec<GraphInput>,
    pub ports: Vec<GraphPort>,
    /// What it is made of again without some inputs, if it has such that may be left out and none has been given a value yet.
    pub(crate) text: Option<Arc<input::GraphText>>,
    /// What must hold of its values, and of those of the graphs that it uses.
    pub expect: Arc<[Expected]>,
    /// Its inputs and parameters, described as a node's fields are.
    pub schema: serde_json::Value,
    /// What looks like a node in a file and is none: uses of graphs, `ForEach` and `Switch`.
    pub uses: Arc<[GraphUse]>,
    /// Each `ForEach` over data.
    pub(crate) loops: Arc<[Loop]>,
    /// Those of which the number of elements has been found out.
    pub(crate) settled: BTreeSet<String>,
    /// What it is expanded from again, if it has such.
    pub(crate) stage: Option<Arc<stage::Stage>>,
    /// The values at its inputs.
    pub(crate) given: InputValues,
    /// The words of a command that say how it was read.
    pub words: Arc<[String]>,
    /// Names in its own file that no output of it needs, and what is wanted and never given.
    pub(crate) warnings: Vec<Problem>,
}

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

/// What shapes the reading of a graph, beside its file.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Folders outside of the project that the graph may read.
    pub roots: Vec<PathBuf>,
    /// Values in place of defaults and fields: (`name` or `node.field`, RON).
    pub set: Vec<(String, String)>,
    /// Whether each `Draft(final: .., draft: ..)` stands for its draft. What is computed from another value has another key, so that a
    /// final run never takes what a draft gave.
    pub draft: bool,
    /// Whether results that are pinned beside the graph's file stand in for their nodes.
    pub pins: bool,
    /// Whether the files that the graph reads must be there.
    pub files: Files,
    /// Texts that stand in place of files of graphs, by path: those that an editor has not saved yet.
    pub texts: BTreeMap<PathBuf, String>,
    /// Whether the graphs that it uses must be what the lock file beside it says; otherwise it is a warning if they are not.
    pub locked: bool,
}

impl Options {
    /// The same with a text in place of the file of a graph at this path.
    #[must_use]
    pub fn with_text(mut self, path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        self.texts.insert(path.into(), text.into());
        self
    }

    /// The words of a command that say the same of a graph, whether or not it has pins.
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        for (name, value) in &self.set {
            words.extend(["--set".to_owned(), format!("{name}={value}")]);
        }
        for root in &self.roots {
            words.extend(["--root".to_owned(), root.display().to_string()]);
        }
        let flags = [(self.draft, "--draft"), (self.locked, "--locked")];
        let flags = flags.into_iter().filter(|(is_set, _)| *is_set);
        words.extend(flags.map(|(_, flag)| flag.to_owned()));
        words
    }

    /// The text of a graph's file, or the one that stands in its place.
    pub fn text(&self, path: &Path) -> std::io::Result<String> {
        match self.text_in_place_of(path) {
            Some(text) => Ok(text.clone()),
            None => plain::read_text(path),
        }
    }

    /// However the path is written that leads there.
    fn text_in_place_of(&self, path: &Path) -> Option<&String> {
        let texts = Some(&self.texts).filter(|texts| !texts.is_empty())?;
        let real = || texts.get(&std::fs::canonicalize(path).ok()?);
        texts.get(path).or_else(|| texts.get(&without_dots(path))).or_else(real)
    }

    /// Whether a text stands in place of the file.
    pub fn has_text(&self, path: &Path) -> bool {
        self.text_in_place_of(path).is_some()
    }
}

/// What a check demands of the files that a graph reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Files {
    /// They must be there, inside of the project.
    #[default]
    Needed,
    /// They may be missing, but no other ones may be named than those inside of the project: the graph is edited.
    Inside,
    /// Nothing: the graph is looked at, not evaluated.
    Ignored,
}

/// A graph, if it can be evaluated, and all problems of its file.
pub struct Checked {
    /// The graph; none if a problem is an error.
    pub graph: Option<Graph>,
    /// If all errors are nodes of unknown types: the graph in which these, and what hangs on them, give nothing.
    pub partial: Option<Graph>,
    /// All problems, in the order of their places.
    pub problems: Vec<Problem>,
    /// The files that its nodes read, those that are not there included: all of them if there is a graph, else those of the
    /// nodes that could be understood.
    pub files: Vec<ReadFile>,
    /// The files of the graphs that it uses, those that are not there included.
    pub subgraphs: Vec<PathBuf>,
}

/// A file that a node of a graph reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadFile {
    /// Where it is, or would be.
    pub path: PathBuf,
    /// The name of the node.
    pub node: String,
    /// Whether the node can do without it.
    pub optional: bool,
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

impl Graph {
    /// Reads and checks a graph file and those that it uses. Runs no node and opens no other file.
    pub fn load(path: &Path, catalog: &Catalog, options: &Options) -> Checked {
        check::load(path, catalog, options)
    }

    /// The same for a text that stands, or will stand, in the file.
    pub fn load_text(path: &Path, text: String, catalog: &Catalog, options: &Options) -> Checked {
        check::load_text(path, text, catalog, options)
    }

    /// Remembers what it is made of, if it may have to be made again without some inputs.
    pub fn remember(&mut self, path: &Path, text: &str, options: &Options) {
        if self.inputs.iter().any(|input| input.optional) {
            let (path, text, options) = (path.to_owned(), text.to_owned(), options.clone());
            self.text = Some(Arc::new(input::GraphText { path, text, options }));
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
        let ports = ports.filter(|_| !self.inputs.is_empty());
        let kind = |(name, node, output): (_, usize, usize)| (name, self.nodes[node].types[output]);
        files.chain(ports).map(kind)
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
        let wanted = |(name, _): &&(String, _)| output.is_none_or(|output| output == name);
        match given.outputs.iter().find(wanted)?.1[..] {
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
        let mut nodes = Vec::from_iter(given.map(|(node, _)| *node).chain(own));
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
        let same_output = |(a, b): (&GraphOutput, &GraphOutput)| {
            (&a.name, a.node, a.output) == (&b.name, b.node, b.output)
        };
        let same_expected = |(a, b): (&Expected, &Expected)| {
            (&a.expectation, &a.values) == (&b.expectation, &b.values)
        };
        self.shape.identity == other.shape.identity
            && self.expect.len() == other.expect.len()
            && self.expect.iter().zip(&*other.expect).all(same_expected)
            && self.files().eq(other.files())
            && self.outputs.len() == other.outputs.len()
            && self.outputs.iter().zip(&other.outputs).all(same_output)
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
