//! Finds the references in the text of a graph, with their positions: links, names of parameters, and names of values in expectations.

use std::collections::{BTreeMap, HashMap, HashSet};

use maquette_graph::canonical::node_of_link;
use maquette_graph::catalog::{PortDescription, ports};
use maquette_graph::definition::{Definition, NodeKind, ParsedFile};
use maquette_graph::expectation::Expectation;
use maquette_graph::load::check_file;
use maquette_graph::place::field;
use maquette_graph::tree::entries;
use maquette_graph::{Files, Options};
use maquette_syntax::error::{Diagnostic, Span};
use maquette_syntax::{Body, Kind, Tree};

use super::Editor;

/// A text in a graph file that refers to another part of the graph.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The position of the literal that contains the reference.
    pub(crate) span: Span,
    /// The text of the literal, without its quotes.
    pub(crate) text: String,
    pub(crate) kind: ReferenceKind,
    /// A description of the part that contains the reference, such as port `mask` of `spots`.
    pub(crate) by: String,
}

/// The kind of part to which a text refers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReferenceKind {
    /// A link to a node or an input.
    Link,
    Output,
    Parameter,
    /// An expression, which refers to the parameters in it.
    Expression,
}

/// All references in a graph file, and the ports of its nodes.
pub struct References {
    /// The references, in the order of their positions.
    pub(crate) all: Vec<Reference>,
    /// For each node whose type is known, its ports.
    pub ports: HashMap<String, Vec<PortDescription>>,
}

impl References {
    /// Returns the references in the text of a graph.
    ///
    /// # Errors
    /// The text cannot be parsed.
    pub(super) fn read(editor: &Editor<'_>, text: &str) -> Result<Self, Vec<Diagnostic>> {
        let (roots, texts) = (editor.options.roots.clone(), editor.options.texts.clone());
        let options = Options { roots, texts, files: Files::Ignored, ..Options::default() };
        let (world, whole) = check_file(editor.path, text.to_owned(), editor.catalog, &options);
        match whole {
            Some(ParsedFile { definition, .. }) => Ok(Self::of_definition(&definition)),
            None => Err(world.diagnostics),
        }
    }

    /// Returns the references in a parsed graph.
    pub fn of_definition(definition: &Definition) -> Self {
        let tree = &definition.tree;
        let (mut links, mut unknown) = (HashMap::new(), HashSet::new());
        let mut known_ports = HashMap::new();
        for parsed in &definition.parsed_nodes {
            let node = node_of_link(&parsed.name.text);
            for link in &parsed.links {
                links.entry(link.span).or_insert_with(|| link.port.clone());
            }
            match &parsed.what {
                NodeKind::Node(entry) => {
                    known_ports.entry(node.to_owned()).or_insert_with(|| entry.ports());
                }
                NodeKind::Use(_, graph) => {
                    known_ports.entry(node.to_owned()).or_insert_with(|| ports(&graph.fields));
                }
                // For a node of unknown type, treat each text that equals the name of a node as a link.
                NodeKind::Unknown(_) => drop(unknown.insert(node.to_owned())),
                NodeKind::Input
                | NodeKind::Switch(_)
                | NodeKind::Elements(_)
                | NodeKind::Pick(_) => {}
            }
        }
        let fields = tree.fields().unwrap_or_default();
        let named = ["nodes", "inputs"].map(|section| entries(fields, section));
        let names = named.into_iter().flatten().map(|(name, _)| name);
        let mut search = Search { found: BTreeMap::new(), names: names.collect(), links };
        for (name, node) in entries(fields, "nodes") {
            let guess = unknown.contains(name);
            search.node(name, node, guess);
            for group in ["links", "carry"] {
                // A `ForEach` without elements has no parsed nodes with links, so search its call for links.
                let is_each = node.name().is_some_and(|kind| kind.text == "ForEach");
                if let Some(group) = field(node, group).filter(|_| is_each) {
                    search.node(name, &group.value, true);
                }
            }
        }
        for (name, declared) in entries(fields, "params") {
            search.parameters(name, declared);
        }
        let outputs = HashSet::<&str>::from_iter(entries(fields, "outputs").map(|(name, _)| name));
        for (name, value) in entries(fields, "outputs") {
            search.add(value, ReferenceKind::Link, format!("output `{name}`"));
        }
        for expected in
            field(tree, "expect").iter().flat_map(|f| Expectation::value_texts(&f.value))
        {
            let is_output = expected.text().is_some_and(|text| outputs.contains(text));
            let kind = if is_output { ReferenceKind::Output } else { ReferenceKind::Link };
            search.add(expected, kind, "an expectation".into());
        }
        if let Some(Kind::Map(promises)) = field(tree, "promises").map(|field| &field.value.kind) {
            for (output, _) in promises {
                search.add(output, ReferenceKind::Output, "a promise".into());
            }
        }
        Self { all: search.found.into_values().collect(), ports: known_ports }
    }

    /// Returns the references in the order of their positions.
    pub(crate) fn iter(&self) -> &[Reference] {
        &self.all
    }

    /// Returns true if a port of a node must have a link.
    pub(crate) fn is_required(&self, node: &str, port: &str) -> bool {
        let mut ports = self.ports.get(node).into_iter().flatten();
        ports.any(|known| known.name == port && !known.optional)
    }

    /// Returns the texts of the links in the graph file.
    pub fn links(&self) -> impl Iterator<Item = &str> {
        let links = self.all.iter().filter(|found| found.kind == ReferenceKind::Link);
        links.map(|found| &found.text[..])
    }

    /// Returns true if the literal at this position is a link.
    pub fn is_link(&self, span: Span) -> bool {
        self.all.iter().any(|found| found.span == span && found.kind == ReferenceKind::Link)
    }
}

/// Collects the references in a graph file.
struct Search<'t> {
    found: BTreeMap<Span, Reference>,
    /// The names of the nodes and inputs of the graph.
    names: HashSet<&'t str>,
    /// The port of each link, by the position of the link in the text.
    links: HashMap<Span, String>,
}

impl Search<'_> {
    fn add(&mut self, literal: &Tree, kind: ReferenceKind, by: String) {
        let Some(text) = literal.text() else { return };
        let (span, text) = (literal.span, text.to_owned());
        self.found.entry(span).or_insert(Reference { span, text, kind, by });
    }

    /// If a value is a `Param` or `Expr`, adds the parameters in it and returns true. Returns false for any other value.
    fn add_computed(&mut self, name: &str, tree: &Tree) -> bool {
        for (call, kind) in
            [("Param", ReferenceKind::Parameter), ("Expr", ReferenceKind::Expression)]
        {
            if let Some(argument) = tree.call_of(call) {
                self.add(argument, kind, format!("`{name}`"));
                return true;
            }
        }
        false
    }

    /// Adds the parameters to which the declaration of a parameter refers.
    fn parameters(&mut self, name: &str, tree: &Tree) {
        if self.add_computed(name, tree) {
            return;
        }
        match &tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
                items.iter().for_each(|item| self.parameters(name, item));
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().for_each(|field| self.parameters(name, &field.value));
            }
            _ => {}
        }
    }

    /// Adds the references in a node or a part of it. If `guess` is set, each text that equals the name of a node is treated as a link.
    fn node(&mut self, name: &str, tree: &Tree, guess: bool) {
        if self.add_computed(name, tree) {
            return;
        }
        let mut all = |trees: &[Tree]| trees.iter().for_each(|tree| self.node(name, tree, guess));
        match &tree.kind {
            Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => all(items),
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().for_each(|field| self.node(name, &field.value, guess));
            }
            Kind::Map(entries) => {
                entries.iter().for_each(|(_, value)| self.node(name, value, guess));
            }
            Kind::Text(text) => match self.links.get(&tree.span) {
                Some(port) => {
                    self.add(tree, ReferenceKind::Link, format!("port `{port}` of `{name}`"));
                }
                None if guess && self.names.contains(node_of_link(text)) => {
                    self.add(tree, ReferenceKind::Link, format!("`{name}`"));
                }
                None => {}
            },
            _ => {}
        }
    }
}
