//! The inputs of a graph. Their values come from another graph that uses this one, or from a program that calls the graph as a function.
//!
//! If a file contains the value of an input, the file is read as a node would read it. This includes a `camera.json` in the folder of a
//! range file or picture.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_node::{AnyNode, Context, FilePath, bail};
use maquette_syntax::error::{Diagnostic, Error, Severity, Span, code};
use maquette_syntax::{Tree, nearest_or_all, with_article};
use maquette_value::{AnyValue, Hash, ValueType};
use serde_json::json;

use super::recipe::Recipe;
use super::{Graph, GraphOutput, Topology};
use crate::catalog::Catalog;
use crate::definition::{BuiltNode, ParsedNode};
use crate::files::NodeFile;
use crate::flat::Lineage;

/// The values for the inputs of a graph, by the names of the inputs.
pub type InputValues = BTreeMap<String, AnyValue>;

/// What is known about the values of a graph's inputs, by the names of the inputs.
pub type KnownInputs = BTreeMap<String, KnownInput>;

/// The values read for the inputs, by the names of the inputs, with warnings. If reading fails, all errors.
pub type ReadInputs<T> = Result<(BTreeMap<String, T>, Vec<Diagnostic>), Vec<Diagnostic>>;

/// What is known about the value of an input. An evaluation needs the value itself; a forecast can use its hash or file.
#[derive(Clone, Debug)]
pub enum KnownInput {
    Value(AnyValue),
    /// Only the hash of the value is known.
    Hash(Hash),
    /// The unread file that contains the value.
    File(NodeFile),
}

/// An input that a graph declares.
#[derive(Clone, Debug)]
pub struct GraphInput {
    /// The name of the input.
    pub name: String,
    /// The type of the input's values.
    pub kind: &'static ValueType,
    /// The author's description of the input.
    pub doc: String,
    /// True if a graph that uses this one may omit the input. All links to the input are then removed.
    pub optional: bool,
    /// The index of the node that represents the input.
    pub(super) node: usize,
}

/// An output of a graph that has inputs. Its value is passed to the graph or program that uses this graph.
#[derive(Clone, Debug)]
pub struct GraphPort {
    /// The name of the output in the graph file.
    pub name: String,
    /// The type of the output's values. `None` if the type depends on an input.
    pub kind: Option<&'static ValueType>,
    pub node: usize,
    pub output: usize,
    pub(super) lineage: Arc<Lineage>,
    pub(super) span: Span,
}

impl GraphInput {
    /// Creates an input from its declaration, such as `Mesh(doc: "..")`.
    pub(super) fn new(parsed: &ParsedNode, kind: &'static ValueType, node: usize) -> Self {
        let mut fields = parsed.tree.fields().unwrap_or_default().iter();
        let doc =
            fields.find(|field| field.name.text == "doc").and_then(|field| field.value.text());
        let (name, doc) = (parsed.name.text.clone(), doc.unwrap_or_default().to_owned());
        Self { name, kind, doc, optional: parsed.is_optional, node }
    }
}

impl Graph {
    /// Returns the inputs, in the order of the file.
    pub fn inputs(&self) -> &[GraphInput] {
        &self.inputs
    }

    /// Returns the output values of a graph with inputs, in the order of the file.
    pub fn ports(&self) -> &[GraphPort] {
        &self.ports
    }

    /// Sets the values of inputs, so that the graph can be evaluated on its own. The results have the same cache keys as in a graph that
    /// uses this one with equal values. The outputs become files in the default formats of their types.
    ///
    /// An input without a value is not an error. If the input is optional, it is removed from the returned graph. Otherwise the nodes that
    /// depend on it fail when they are evaluated.
    ///
    /// # Errors
    /// A value has a wrong type, or a name is not the name of an input.
    pub fn with_inputs(
        &self,
        values: &InputValues,
        catalog: &Catalog,
    ) -> Result<Self, Vec<Diagnostic>> {
        let known =
            values.iter().map(|(name, value)| (name.clone(), KnownInput::Value(value.clone())));
        self.with_known_inputs(&known.collect(), catalog)
    }

    /// Sets what is known about the values of inputs, for a forecast of an evaluation.
    ///
    /// # Errors
    /// The same errors as in [`with_inputs`](Self::with_inputs).
    pub fn with_known_inputs(
        &self,
        values: &KnownInputs,
        catalog: &Catalog,
    ) -> Result<Self, Vec<Diagnostic>> {
        let left_out =
            self.inputs.iter().filter(|it| it.optional && !values.contains_key(&it.name));
        let left_out = BTreeSet::from_iter(left_out.map(|input| input.name.clone()));
        if let Some(text) = self.text.as_ref().filter(|_| !left_out.is_empty()) {
            return text.graph_without(left_out, catalog)?.with_known_inputs(values, catalog);
        }
        let mut diagnostics = Vec::new();
        let mut nodes = self.nodes.to_vec();
        for (name, known) in values {
            let input = match self.input(name) {
                Ok(input) => input,
                Err(diagnostic) => {
                    diagnostics.push(*diagnostic);
                    continue;
                }
            };
            fn of_hash(hash: Hash) -> serde_json::Value {
                json!({ "value": hash.to_string() })
            }
            let (parameters, value) = match known {
                KnownInput::Value(value) if input.kind != value.kind() => {
                    diagnostics.push(self.input_type_error(input, value, catalog));
                    continue;
                }
                KnownInput::Value(value) => (of_hash(value.hash()), Some(value.clone())),
                KnownInput::Hash(hash) => (of_hash(*hash), None),
                KnownInput::File(file) => (json!({ "file": file.given }), None),
            };
            let node = &mut nodes[input.node];
            node.recipe = Arc::new(Recipe::new(INPUT, parameters, &[]));
            node.node = Arc::new(Input { name: name.clone(), value });
            if let KnownInput::File(file) = known {
                node.files = vec![NodeFile { is_unread: true, ..file.clone() }];
            }
        }
        if !diagnostics.is_empty() {
            return Err(diagnostics);
        }
        let shape = Arc::new(Topology::new(&nodes));
        let outputs = self.ports.iter().filter_map(|port| self.file_of(port, catalog)).collect();
        let mut given = self.given.clone();
        given.extend(values.clone());
        Ok(Self {
            nodes: nodes.into(),
            topology: shape,
            outputs,
            text: None,
            given,
            ..self.clone()
        })
    }

    /// Returns the output file for an output port, in the default format of its type.
    fn file_of(&self, port: &GraphPort, catalog: &Catalog) -> Option<GraphOutput> {
        let format = *catalog.preferred_format(port.kind?)?;
        let (node, output, span) = (port.node, port.output, port.span);
        let lineage = port.lineage.clone();
        let name = Path::new(&port.name).with_extension(format.extension).display().to_string();
        let source = self.source.clone();
        Some(GraphOutput { name, node, output, format, lineage, source, span })
    }

    /// Reads the values of inputs from files, and returns them with warnings. The type of the input and the extension of the file select
    /// the reader.
    ///
    /// # Errors
    /// A name is not the name of an input, or a file cannot be read.
    pub fn read_inputs(
        &self,
        files: &[(String, PathBuf)],
        catalog: &Catalog,
    ) -> Result<(InputValues, Vec<Diagnostic>), Vec<Diagnostic>> {
        self.read_inputs_by(files, |path, kind| catalog.readers().open(path, Some(kind)))
    }

    /// Reads the values of inputs by calling `open` for each file and input. `open` returns the content of the file, and warnings.
    ///
    /// # Errors
    /// A name is not the name of an input, or a file cannot be read.
    pub fn read_inputs_by<T>(
        &self,
        files: &[(String, PathBuf)],
        open: impl Fn(&Path, &'static ValueType) -> Result<(T, Vec<String>), String>,
    ) -> ReadInputs<T> {
        let (mut values, mut warnings, mut errors) = (BTreeMap::new(), Vec::new(), Vec::new());
        for (name, path) in files {
            let input = match self.input(name) {
                Ok(input) => input,
                Err(diagnostic) => {
                    errors.push(*diagnostic);
                    continue;
                }
            };
            let diagnostic = |severity, code, text: &str| {
                self.input_diagnostic(input, severity, code, format!("input `{name}`: {text}"))
            };
            match open(path, input.kind) {
                Ok((value, doubts)) => {
                    let doubts = doubts.iter();
                    warnings.extend(
                        doubts.map(|doubt| diagnostic(Severity::Warning, code::WARNING, doubt)),
                    );
                    values.insert(name.clone(), value);
                }
                Err(why) => errors.push(diagnostic(Severity::Error, code::FAILED, &why)),
            }
        }
        if errors.is_empty() { Ok((values, warnings)) } else { Err(errors) }
    }

    /// Returns the input of this name.
    ///
    /// # Errors
    /// No input has this name.
    fn input(&self, name: &str) -> Result<&GraphInput, Box<Diagnostic>> {
        let found = self.inputs.iter().find(|input| input.name == name);
        found.ok_or_else(|| Box::new(self.no_input(name)))
    }

    /// Returns a diagnostic whose position is the declaration of an input.
    pub(crate) fn input_diagnostic(
        &self,
        input: &GraphInput,
        severity: Severity,
        code: &'static str,
        message: String,
    ) -> Diagnostic {
        self.nodes[input.node].diagnostic(severity, code, message, "")
    }

    fn no_input(&self, name: &str) -> Diagnostic {
        let known: Vec<_> = self.inputs.iter().map(|input| &input.name[..]).collect();
        let help = match known.is_empty() {
            true => "it has no inputs at all; --set changes parameters".into(),
            false => nearest_or_all(name, "its inputs", &known),
        };
        let message = format!("the graph has no input `{name}`");
        Diagnostic { help: help.into(), ..self.diagnostic(code::UNKNOWN_FIELD, message) }
    }

    fn input_type_error(
        &self,
        input: &GraphInput,
        value: &AnyValue,
        catalog: &Catalog,
    ) -> Diagnostic {
        let (wanted, given) = (input.kind.name, value.kind().name);
        let message = format!(
            "input `{}` wants {}, but it is given {}",
            input.name,
            with_article(wanted),
            with_article(given)
        );
        let maker = catalog
            .converters(given, wanted)
            .first()
            .map(|maker| format!("{} makes {} of it", with_article(maker), with_article(wanted)));
        let node = &self.nodes[input.node];
        node.diagnostic(Severity::Error, code::WRONG_TYPE, message, &maker.unwrap_or_default())
    }
}

/// The type name of the nodes that represent inputs.
pub const INPUT: &str = "Input";

/// The node that represents an input. Its value is `None` until it is set.
struct Input {
    name: String,
    value: Option<AnyValue>,
}

impl AnyNode for Input {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        let Some(value) = &self.value else {
            bail!(
                "it is an input without a value: `maquette run --input {}=FILE` gives it one, as does a graph that uses this one",
                self.name
            );
        };
        Ok(vec![value.clone()])
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({ "name": self.name }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// Creates the node of an input without a value.
pub(super) fn input_node(name: &str, tree: &Tree) -> BuiltNode {
    let recipe = Arc::new(Recipe::new(INPUT, json!({ "name": name }), &[]));
    let node = Arc::new(Input { name: name.to_owned(), value: None });
    BuiltNode { node, pack: "", recipe, files: Vec::new(), tree: Arc::new(tree.clone()) }
}
