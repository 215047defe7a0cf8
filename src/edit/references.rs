//! What the text of a graph names, and where: links, parameters and what is expected of values.

use std::collections::{BTreeMap, HashMap, HashSet};

use maquette_graph::catalog::{PortDescription, ports};
use maquette_graph::definition::{Definition, What, Whole};
use maquette_graph::expectation::Expectation;
use maquette_graph::load::first;
use maquette_graph::meaning::named_node;
use maquette_graph::place::field;
use maquette_graph::tree::entries;
use maquette_graph::{Files, Options};
use maquette_syntax::error::{Problem, Span};
use maquette_syntax::{Body, Kind, Tree};

use super::Judge;

/// A text in a graph that names something of it.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Where the literal stands.
    pub(crate) span: Span,
    /// What it says.
    pub(crate) text: String,
    pub(crate) kind: Names,
    /// Who names it, in words: port `mask` of `spots`.
    pub(crate) by: String,
}

/// What a text names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// A node or an input.
    Link,
    /// An output.
    Output,
    /// A parameter.
    Parameter,
    /// Some parameters.
    Expression,
}

/// All that names something in a graph, and the ports of its nodes.
pub struct References {
    /// In the order of their places.
    pub(crate) all: Vec<Reference>,
    /// By the name of the node, as far as its type is known.
    pub ports: HashMap<String, Vec<PortDescription>>,
}

impl References {
    /// All in the text of a graph.
    ///
    /// # Errors
    /// The problems of the text, if it cannot be said what is in it.
    pub(super) fn of(judge: &Judge<'_>, text: &str) -> Result<Self, Vec<Problem>> {
        let (roots, texts) = (judge.options.roots.clone(), judge.options.texts.clone());
        let options = Options { roots, texts, files: Files::Ignored, ..Options::default() };
        let (world, whole) = first(judge.path, text.to_owned(), judge.catalog, &options);
        match whole {
            Some(Whole { definition, .. }) => Ok(Self::within(&definition)),
            None => Err(world.problems),
        }
    }

    /// All in a text that has been understood so far.
    pub fn within(definition: &Definition) -> Self {
        let tree = &definition.tree;
        let (mut links, mut unknown) = (HashMap::new(), HashSet::new());
        let mut known_ports = HashMap::new();
        for draft in &definition.drafts {
            let node = named_node(&draft.name.text);
            for link in &draft.links {
                links.entry(link.span).or_insert_with(|| link.port.clone());
            }
            match &draft.what {
                What::Node(entry) => {
                    known_ports.entry(node.to_owned()).or_insert_with(|| entry.ports());
                }
                What::Use(_, graph) => {
                    known_ports.entry(node.to_owned()).or_insert_with(|| ports(&graph.fields));
                }
                // A text that names a node is taken for a link where the type is not known.
                What::Unknown(_) => drop(unknown.insert(node.to_owned())),
                What::Input | What::Switch(_) | What::Elements(_) | What::Pick(_) => {}
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
                // The links of a `ForEach` without elements belong to no node.
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
            search.put(value, Names::Link, format!("output `{name}`"));
        }
        for expected in
            field(tree, "expect").iter().flat_map(|f| Expectation::value_texts(&f.value))
        {
            let is_output = expected.text().is_some_and(|text| outputs.contains(text));
            let kind = if is_output { Names::Output } else { Names::Link };
            search.put(expected, kind, "an expectation".into());
        }
        if let Some(Kind::Map(promises)) = field(tree, "promises").map(|field| &field.value.kind) {
            for (output, _) in promises {
                search.put(output, Names::Output, "a promise".into());
            }
        }
        Self { all: search.found.into_values().collect(), ports: known_ports }
    }

    /// All, in the order of their places.
    pub(crate) fn all(&self) -> &[Reference] {
        &self.all
    }

    /// What links say.
    pub fn links(&self) -> impl Iterator<Item = &str> {
        let links = self.all.iter().filter(|found| found.kind == Names::Link);
        links.map(|found| &found.text[..])
    }

    /// Whether the literal at this place is a link.
    pub fn is_link(&self, span: Span) -> bool {
        self.all.iter().any(|found| found.span == span && found.kind == Names::Link)
    }
}

/// Collects what names something.
struct Search<'t> {
    found: BTreeMap<Span, Reference>,
    /// Nodes and inputs.
    names: HashSet<&'t str>,
    /// The ports that hold links, by the places of these.
    links: HashMap<Span, String>,
}

impl Search<'_> {
    fn put(&mut self, literal: &Tree, kind: Names, by: String) {
        let Some(text) = literal.text() else { return };
        let (span, text) = (literal.span, text.to_owned());
        self.found.entry(span).or_insert(Reference { span, text, kind, by });
    }

    /// The parameters that are named in a value; true if it is one `Param` or `Expr`.
    fn is_computed(&mut self, name: &str, tree: &Tree) -> bool {
        for (call, kind) in [("Param", Names::Parameter), ("Expr", Names::Expression)] {
            if let Some(argument) = tree.call_of(call) {
                self.put(argument, kind, format!("`{name}`"));
                return true;
            }
        }
        false
    }

    /// The parameters that are named in the declaration of one.
    fn parameters(&mut self, name: &str, tree: &Tree) {
        if self.is_computed(name, tree) {
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

    /// What is named in a part of a node. With `guess`, each text that may be a link is one.
    fn node(&mut self, name: &str, tree: &Tree, guess: bool) {
        if self.is_computed(name, tree) {
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
                    self.put(tree, Names::Link, format!("port `{port}` of `{name}`"));
                }
                None if guess && self.names.contains(named_node(text)) => {
                    self.put(tree, Names::Link, format!("`{name}`"));
                }
                None => {}
            },
            _ => {}
        }
    }
}
