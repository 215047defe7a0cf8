//! The inputs of a graph: values that come from a graph that uses it, or from whoever calls it as a function.
//!
//! A file for an input becomes the value that a node would read from it: `camera.json` beside a range file or picture counts.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_node::{AnyNode, Context, FilePath};
use maquette_syntax::error::{Error, Problem, Severity, Span, code};
use maquette_syntax::{Tree, nearest_or_all, with_article};
use maquette_value::{AnyValue, Hash, ValueType};
use serde_json::json;

use super::recipe::Recipe;
use super::{Graph, GraphOutput, Shape};
use crate::catalog::Catalog;
use crate::definition::{Built, Draft};
use crate::files::NodeFile;
use crate::flat::Lineage;

/// Values for the inputs of a graph, by their names.
pub type InputValues = BTreeMap<String, AnyValue>;

/// What is known of the values for the inputs of a graph, by their names.
pub type KnownInputs = BTreeMap<String, KnownInput>;

/// What is read for inputs, by their names, with warnings; or every error.
pub type InputsOr<T> = Result<(BTreeMap<String, T>, Vec<Problem>), Vec<Problem>>;

/// What is known of a value for an input. What is no value is known for a forecast alone.
#[derive(Clone, Debug)]
pub enum KnownInput {
    Value(AnyValue),
    /// The hash of the value.
    Hash(Hash),
    /// The file that has the value, and was not read.
    File(NodeFile),
}

/// An input that a graph declares.
#[derive(Clone, Debug)]
pub struct GraphInput {
    /// Its name.
    pub name: String,
    /// The type of values that it takes.
    pub kind: &'static ValueType,
    /// What it is, in its author's words.
    pub doc: String,
    /// Whether it may be left out: then what is linked to it has one link less.
    pub optional: bool,
    /// The node that stands for it.
    pub(super) node: usize,
}

/// An output of a graph with inputs: a value for who uses or calls it.
#[derive(Clone, Debug)]
pub struct GraphPort {
    /// Its name.
    pub name: String,
    /// The type of its values; none if it has the type that comes in somewhere.
    pub kind: Option<&'static ValueType>,
    pub node: usize,
    pub output: usize,
    pub(super) lineage: Arc<Lineage>,
    pub(super) span: Span,
}

impl GraphInput {
    /// The input that a declaration, such as `Mesh(doc: "..")`, makes.
    pub(super) fn new(draft: &Draft, kind: &'static ValueType, node: usize) -> Self {
        let mut fields = draft.tree.fields().unwrap_or_default().iter();
        let doc =
            fields.find(|field| field.name.text == "doc").and_then(|field| field.value.text());
        let (name, doc) = (draft.name.text.clone(), doc.unwrap_or_default().to_owned());
        Self { name, kind, doc, optional: draft.is_optional, node }
    }
}

impl Graph {
    /// The values that it wants, in the file's order.
    pub fn inputs(&self) -> &[GraphInput] {
        &self.inputs
    }

    /// The values that it gives, if it has inputs, in the file's order.
    pub fn ports(&self) -> &[GraphPort] {
        &self.ports
    }

    /// The same graph with these values at its inputs, to be evaluated by itself. Results have the same keys as where another
    /// graph uses it with equal values. Its outputs become files in the preferred format of their types.
    ///
    /// Inputs without a value are no error: those that are optional are left out for good, and what hangs on others fails when it
    /// is evaluated.
    ///
    /// # Errors
    /// For each value of a wrong type, and each name that is no input's.
    pub fn with_inputs(
        &self,
        values: &InputValues,
        catalog: &Catalog,
    ) -> Result<Self, Vec<Problem>> {
        let value =
            |(name, value): (&String, &AnyValue)| (name.clone(), KnownInput::Value(value.clone()));
        self.with_known_inputs(&values.iter().map(value).collect(), catalog)
    }

    /// The same for a forecast, with what is known of these values.
    ///
    /// # Errors
    /// As [`with_inputs`](Self::with_inputs).
    pub fn with_known_inputs(
        &self,
        values: &KnownInputs,
        catalog: &Catalog,
    ) -> Result<Self, Vec<Problem>> {
        let left_out =
            self.inputs.iter().filter(|it| it.optional && !values.contains_key(&it.name));
        let left_out = BTreeSet::from_iter(left_out.map(|input| input.name.clone()));
        if let Some(text) = self.text.as_ref().filter(|_| !left_out.is_empty()) {
            return text.graph_without(left_out, catalog)?.with_known_inputs(values, catalog);
        }
        let mut problems = Vec::new();
        let mut nodes = self.nodes.to_vec();
        for (name, known) in values {
            let input = match self.input(name) {
                Ok(input) => input,
                Err(problem) => {
                    problems.push(*problem);
                    continue;
                }
            };
            fn of_hash(hash: Hash) -> serde_json::Value {
                json!({ "value": hash.to_string() })
            }
            let (parameters, value) = match known {
                KnownInput::Value(value) if input.kind != value.kind() => {
                    problems.push(self.wrong_input(input, value, catalog));
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
        if !problems.is_empty() {
            return Err(problems);
        }
        let shape = Arc::new(Shape::new(&nodes));
        let outputs = self.ports.iter().filter_map(|port| self.file_of(port, catalog)).collect();
        let mut given = self.given.clone();
        given.extend(values.clone());
        Ok(Self { nodes: nodes.into(), shape, outputs, text: None, given, ..self.clone() })
    }

    /// The file that an output becomes where nobody names one.
    fn file_of(&self, port: &GraphPort, catalog: &Catalog) -> Option<GraphOutput> {
        let format = *catalog.preferred_format(port.kind?)?;
        let (node, output, span) = (port.node, port.output, port.span);
        let lineage = port.lineage.clone();
        let name = Path::new(&port.name).with_extension(format.ending).display().to_string();
        let source = self.source.clone();
        Some(GraphOutput { name, node, output, format, lineage, source, span })
    }

    /// The values in some files for its inputs, by their types and the files' endings, and warnings of what is to be doubted of them.
    pub fn read_inputs(
        &self,
        files: &[(String, PathBuf)],
        catalog: &Catalog,
    ) -> Result<(InputValues, Vec<Problem>), Vec<Problem>> {
        self.read_inputs_by(files, |path, kind| catalog.readers().open(path, Some(kind)))
    }

    /// The same, where `open` gives what is in a file for an input of a type, with its warnings.
    ///
    /// # Errors
    /// For each name that is no input's, and each file that cannot be read.
    pub fn read_inputs_by<T>(
        &self,
        files: &[(String, PathBuf)],
        open: impl Fn(&Path, &'static ValueType) -> Result<(T, Vec<String>), String>,
    ) -> InputsOr<T> {
        let (mut values, mut warnings, mut errors) = (BTreeMap::new(), Vec::new(), Vec::new());
        for (name, path) in files {
            let input = match self.input(name) {
                Ok(input) => input,
                Err(problem) => {
                    errors.push(*problem);
                    continue;
                }
            };
            let problem = |severity, code, text: &str| {
                self.problem_of_input(input, severity, code, format!("input `{name}`: {text}"))
            };
            match open(path, input.kind) {
                Ok((value, doubts)) => {
                    let doubts = doubts.iter();
                    warnings.extend(
                        doubts.map(|doubt| problem(Severity::Warning, code::WARNING, doubt)),
                    );
                    values.insert(name.clone(), value);
                }
                Err(why) => errors.push(problem(Severity::Error, code::FAILED, &why)),
            }
        }
        if errors.is_empty() { Ok((values, warnings)) } else { Err(errors) }
    }

    /// The input of this name.
    ///
    /// # Errors
    /// If there is none.
    fn input(&self, name: &str) -> Result<&GraphInput, Box<Problem>> {
        let found = self.inputs.iter().find(|input| input.name == name);
        found.ok_or_else(|| Box::new(self.no_input(name)))
    }

    /// A problem at the place where an input is declared.
    pub(crate) fn problem_of_input(
        &self,
        input: &GraphInput,
        severity: Severity,
        code: &'static str,
        message: String,
    ) -> Problem {
        self.nodes[input.node].problem(severity, code, message, "")
    }

    fn no_input(&self, name: &str) -> Problem {
        let known: Vec<_> = self.inputs.iter().map(|input| &input.name[..]).collect();
        let help = match known.is_empty() {
            true => "it has no inputs at all; --set changes parameters".into(),
            false => nearest_or_all(name, "its inputs", &known),
        };
        let message = format!("the graph has no input `{name}`");
        Problem { help: help.into(), ..self.problem(code::UNKNOWN_FIELD, message) }
    }

    fn wrong_input(&self, input: &GraphInput, value: &AnyValue, catalog: &Catalog) -> Problem {
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
        node.problem(Severity::Error, code::WRONG_TYPE, message, &maker.unwrap_or_default())
    }
}

/// What the nodes that stand for inputs are called, where the types of nodes are told.
pub const INPUT: &str = "Input";

/// The node that stands for an input, and its value if it has one.
struct Input {
    name: String,
    value: Option<AnyValue>,
}

/// A graph with inputs was evaluated without a value for one.
#[derive(Debug, thiserror::Error)]
#[error(
    "it is an input without a value: `maquette run --input {0}=FILE` gives it one, as does a graph that uses this one"
)]
struct NoValue(String);

impl AnyNode for Input {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        let value = self.value.clone().ok_or_else(|| NoValue(self.name.clone()))?;
        Ok(vec![value])
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({ "name": self.name }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// What stands for an input until it has a value.
pub(super) fn input_node(name: &str, tree: &Tree) -> Built {
    let recipe = Arc::new(Recipe::new(INPUT, json!({ "name": name }), &[]));
    let node = Arc::new(Input { name: name.to_owned(), value: None });
    Built { node, pack: "", recipe, files: Vec::new(), tree: Arc::new(tree.clone()) }
}
