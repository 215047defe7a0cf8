//! Reads a graph file and finds every problem in it.
//!
//! A mistake causes one problem: a node whose fields are wrong still has its output types, and what cannot be known because
//! of another problem is not reported.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::file::{self, Body, Field, Kind, Name, Tree};
use super::parameters::{Parameters, read_set};
use super::paths::{PathProblem, may_read, project_root};
use super::schema::{Finding, FoundFile, FoundLink, Walk};
use super::suggest::nearest_or_all;
use super::{
    Checked, Files, Graph, GraphNode, GraphOutput, Link, Options, ReadFile, Reader, Shape,
};
use crate::catalog::{Catalog, Entry};
use crate::error::{Source, Span, code};
use crate::eval::{NodeFile, Recipe};
use crate::node::{AnyNode, Output};
use crate::value::ValueType;

/// The version of the file format that this program reads.
const FORMAT: f64 = 1.0;

/// The fields of a graph.
const FIELDS: [&str; 6] = ["format", "doc", "params", "nodes", "outputs", "expect"];

pub(super) fn load(path: &Path, catalog: &Catalog, options: &Options) -> Checked {
    match std::fs::read_to_string(path) {
        Ok(text) => load_text(path, text, catalog, options),
        Err(error) => {
            let message = format!("cannot read the graph: {error}");
            let (code, span, help) = (code::MISSING_FILE, Span::default(), String::new());
            let unread = Finding { code, span, message, help, note: None };
            checked(path, String::new(), vec![unread], None, Vec::new())
        }
    }
}

/// The same for a text that stands, or will stand, in the file.
pub(super) fn load_text(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
) -> Checked {
    let mut check = Check::new(path, catalog, options);
    let graph = check.graph(&text);
    checked(path, text, check.findings, graph, check.files)
}

fn checked(
    path: &Path,
    text: String,
    mut findings: Vec<Finding>,
    graph: Option<Graph>,
    files: Vec<ReadFile>,
) -> Checked {
    let source = Arc::new(Source { name: path.to_owned(), text });
    findings.sort_by_key(|finding| finding.span);
    let problems: Vec<_> = findings.into_iter().map(|finding| finding.at(&source)).collect();
    let graph = graph.filter(|_| problems.is_empty()).map(|graph| Graph { source, ..graph });
    Checked { graph, problems, files }
}

/// Whether a word can name a node: `[a-z][a-z0-9-]*`.
pub(crate) fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_lowercase())
        && word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

pub(super) struct Check<'a> {
    pub(super) catalog: &'a Catalog,
    pub(super) options: &'a Options,
    pub(super) folder: PathBuf,
    pub(super) roots: Vec<PathBuf>,
    pub(super) findings: Vec<Finding>,
    /// The files of the nodes that have been looked at.
    pub(super) files: Vec<ReadFile>,
}

/// A node while it is checked.
pub(super) struct Draft<'a> {
    pub(super) name: Name,
    pub(super) tree: Tree,
    pub(super) entry: Option<&'a Entry>,
    pub(super) links: Vec<FoundLink>,
    pub(super) files: Vec<FoundFile>,
    /// For each link, the node and output that it names, if they exist.
    pub(super) targets: Vec<Option<(usize, usize)>>,
    /// The type of each output, as far as it is known.
    pub(super) types: Vec<Option<&'static ValueType>>,
    /// The node itself, if its fields have no problem.
    pub(super) node: Option<Box<dyn AnyNode>>,
}

impl Draft<'_> {
    pub(super) fn outputs(&self) -> &[Output] {
        self.entry.map_or(&[], Entry::outputs)
    }
}

impl<'a> Check<'a> {
    fn new(path: &Path, catalog: &'a Catalog, options: &'a Options) -> Self {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        let allowed = options.roots.iter().filter_map(|root| std::fs::canonicalize(root).ok());
        let roots = std::iter::once(project_root(&folder)).chain(allowed).collect();
        Self { catalog, options, folder, roots, findings: Vec::new(), files: Vec::new() }
    }

    pub(super) fn find(
        &mut self,
        code: &'static str,
        span: Span,
        message: String,
        help: impl Into<String>,
    ) {
        self.findings.push(Finding { code, span, message, help: help.into(), note: None });
    }

    fn graph(&mut self, text: &str) -> Option<Graph> {
        let (tree, mistakes) = file::parse(text);
        if self.is_newer(&tree) {
            return None;
        }
        if !mistakes.is_empty() {
            for mistake in mistakes {
                self.find(code::SYNTAX, mistake.span, mistake.message, mistake.help);
            }
            return None;
        }
        let top = self.top_level(&tree)?;
        let parameters = self.named(top.params, "parameter");
        let parameters = Parameters::read(&parameters, &self.options.set, &mut self.findings);
        let mut drafts = self.drafts(top.nodes, &parameters);
        self.unknown_sets(&parameters, &drafts);
        self.link(&mut drafts);
        let order = self.order(&drafts);
        self.types(&mut drafts, &order);
        let outputs = self.outputs(top.outputs, &drafts);
        let expect = self.expectations(top.expect, &drafts);
        if !self.findings.is_empty() {
            return None;
        }
        let (nodes, places) = self.nodes(drafts, &order)?;
        let outputs = outputs.into_iter();
        let outputs =
            outputs.map(|output| GraphOutput { node: places[output.node], ..output }).collect();
        let source = Arc::new(Source { name: PathBuf::new(), text: String::new() });
        let shape = Arc::new(Shape::new(&nodes));
        Some(Graph { source, doc: top.doc, nodes: nodes.into(), shape, outputs, expect })
    }

    /// Whether the file is of another format version; then nothing else in it is judged.
    fn is_newer(&mut self, tree: &Tree) -> bool {
        let fields = tree.fields().unwrap_or_default();
        let Some(field) = fields.iter().find(|field| field.name.text == "format") else {
            return false;
        };
        match field.value.kind {
            Kind::Number { value, .. } if value != FORMAT => {
                let message =
                    format!("format {value} is unknown: this program reads format {FORMAT}");
                let help = "use a newer maquette, or the graph's older version";
                self.find(code::FORMAT, field.value.span, message, help);
                true
            }
            _ => false,
        }
    }

    fn top_level<'t>(&mut self, tree: &'t Tree) -> Option<TopLevel<'t>> {
        let is_graph = tree.name().is_some_and(|name| name.text == "Graph");
        let Some(fields) = tree.fields().filter(|_| is_graph) else {
            let message = format!("a graph file holds Graph(..), not {}", tree.in_words());
            self.find(
                code::SYNTAX,
                tree.span,
                message,
                "begin with `Graph(format: 1, nodes: {..}, outputs: {..})`",
            );
            return None;
        };
        let mut top =
            TopLevel { doc: String::new(), params: &[], nodes: &[], outputs: &[], expect: None };
        for (index, Field { name, value }) in fields.iter().enumerate() {
            if fields[..index].iter().any(|before| before.name.text == name.text) {
                let message = format!("field `{}` is given twice", name.text);
                self.find(code::BAD_NAME, name.span, message, "keep one of them");
                continue;
            }
            match (&name.text[..], &value.kind) {
                ("format", Kind::Number { .. }) => {}
                ("doc", Kind::Text(doc)) => top.doc.clone_from(doc),
                ("params", Kind::Map(entries)) => top.params = entries,
                ("nodes", Kind::Map(entries)) => top.nodes = entries,
                ("outputs", Kind::Map(entries)) => top.outputs = entries,
                ("expect", _) => top.expect = Some(value),
                (known, _) if FIELDS.contains(&known) => {
                    let wanted = match known {
                        "format" => "the number 1",
                        "doc" => "a text",
                        _ => "a map: {\"name\": .., ..}",
                    };
                    let message = format!(
                        "field `{known}` of Graph wants {wanted}, not {}",
                        value.in_words()
                    );
                    self.find(code::WRONG_VALUE, value.span, message, "");
                }
                (unknown, _) => {
                    let message = format!("Graph has no field `{unknown}`");
                    self.find(
                        code::UNKNOWN_FIELD,
                        name.span,
                        message,
                        nearest_or_all(unknown, "its fields", &FIELDS),
                    );
                }
            }
        }
        for needed in ["format", "nodes", "outputs"] {
            if !fields.iter().any(|field| field.name.text == needed) {
                let span = tree.name().map_or(tree.span, |name| name.span);
                let message = format!("Graph needs a field `{needed}`");
                let help = if needed == "format" {
                    "write `format: 1`"
                } else {
                    "write a map: {\"name\": .., ..}"
                };
                self.find(code::MISSING_FIELD, span, message, help);
            }
        }
        Some(top)
    }

    /// The entries of a map whose keys are names, each once.
    fn named(&mut self, entries: &[(Tree, Tree)], what: &str) -> Vec<(Tree, Tree)> {
        let mut kept: Vec<(Tree, Tree)> = Vec::with_capacity(entries.len());
        let mut seen = HashMap::with_capacity(entries.len());
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!(
                    "the name of a {what} is a text in double quotes, not {}",
                    key.in_words()
                );
                self.find(code::BAD_NAME, key.span, message, "");
                continue;
            };
            if !is_name(name) {
                let message = format!("`{name}` cannot name a {what}");
                let help = "names begin with a lower-case letter; lower-case letters, digits and hyphens follow";
                self.find(code::BAD_NAME, key.span, message, help);
            } else if let Some(first) = seen.insert(name, key.span) {
                let message = format!("there is already a {what} `{name}`");
                self.find(code::BAD_NAME, key.span, message, "give one of them another name");
                if let Some(finding) = self.findings.last_mut() {
                    finding.note = Some((first, "the first one".into()));
                }
            } else {
                kept.push((key.clone(), value.clone()));
            }
        }
        kept
    }

    fn drafts(&mut self, entries: &[(Tree, Tree)], parameters: &Parameters) -> Vec<Draft<'a>> {
        let entries = self.named(entries, "node");
        let mut drafts = Vec::with_capacity(entries.len());
        for (key, value) in entries {
            let text = key.text().unwrap_or_default().to_owned();
            let name = Name { text, span: key.span };
            let known = self.findings.len();
            let value = self.with_sets(&name.text, value);
            let tree = parameters.substitute(&value, &mut self.findings);
            let entry = self.entry(&tree, &name);
            let (mut links, mut files) = (Vec::new(), Vec::new());
            if let Some(entry) = entry {
                let mut walk = Walk {
                    node: &entry.name,
                    root: entry.schema(),
                    folder: &self.folder,
                    findings: Vec::new(),
                    links: Vec::new(),
                    files: Vec::new(),
                };
                walk.node(&tree);
                (links, files) = (walk.links, walk.files);
                self.findings.append(&mut walk.findings);
                if self.options.files == Files::Needed {
                    files.iter().for_each(|file| self.may_read(file));
                }
            }
            let types = vec![None; entry.map_or(0, |entry| entry.outputs().len())];
            let reader = Reader { tree: &tree, links: &links, files: &files };
            // What is broken has been reported: a parameter out of its range, or a word that cannot be read.
            let sound = entry.filter(|_| self.findings.len() == known && tree.is_whole());
            let node = sound.and_then(|entry| self.read(entry, &reader));
            self.note_files(&name.text, &files, node.as_deref());
            drafts.push(Draft {
                name,
                tree,
                entry,
                links,
                files,
                targets: Vec::new(),
                types,
                node,
            });
        }
        drafts
    }

    /// Remembers which files a node reads; those that it can do without are known only if its fields have no problem.
    fn note_files(&mut self, node: &str, named: &[FoundFile], read: Option<&dyn AnyNode>) {
        let file = |path: &Path, optional| ReadFile {
            path: path.to_owned(),
            node: node.to_owned(),
            optional,
        };
        self.files.extend(named.iter().map(|found| file(&found.resolved, false)));
        let optional = read.map(AnyNode::files).unwrap_or_default();
        self.files.extend(optional.iter().map(|found| file(found.resolved(), true)));
    }

    fn entry(&mut self, tree: &Tree, name: &Name) -> Option<&'a Entry> {
        let Some(kind) = tree.name() else {
            if !tree.is_broken() {
                let message = format!("node `{}` is {}, not a node", name.text, tree.in_words());
                self.find(code::WRONG_VALUE, tree.span, message, "write `Type(field: value, ..)`");
            }
            return None;
        };
        let entry = self.catalog.find(&kind.text);
        if entry.is_none() {
            let message = format!("there is no node type `{}`", kind.text);
            let names = self.catalog.names();
            let help = match super::suggest::nearest(&kind.text, names) {
                help if help.is_empty() => "`maquette nodes` lists them all".into(),
                help => help,
            };
            self.find(code::UNKNOWN_NODE, kind.span, message, help);
        }
        entry
    }

    fn may_read(&mut self, file: &FoundFile) {
        match may_read(&file.given, &file.resolved, &self.roots) {
            Ok(()) => {}
            Err(PathProblem::Outside { message, help }) => {
                self.find(code::OUTSIDE, file.span, message, help);
            }
            Err(PathProblem::Missing { message, help }) => {
                self.find(code::MISSING_FILE, file.span, message, help);
            }
        }
    }

    /// The node's call with the fields that `--set node.field=value` gives.
    fn with_sets(&self, node: &str, mut tree: Tree) -> Tree {
        for (target, text) in &self.options.set {
            let Some(path) = target.strip_prefix(node).and_then(|rest| rest.strip_prefix('.'))
            else {
                continue;
            };
            set_field(
                &mut tree,
                path,
                &read_set(text, &format!("{target}={text}"), Span::default()),
            );
        }
        tree
    }

    /// Values of `--set` that go nowhere.
    fn unknown_sets(&mut self, parameters: &Parameters, drafts: &[Draft<'_>]) {
        let nodes: Vec<&str> = drafts.iter().map(|draft| &draft.name.text[..]).collect();
        for (target, text) in &self.options.set {
            let (what, name, known) = match target.split_once('.') {
                Some((node, _)) => ("node", node, nodes.clone()),
                None => ("parameter", &target[..], parameters.names()),
            };
            if !known.contains(&name) {
                let message = format!("--set {target}={text}: the graph has no {what} `{name}`");
                let help = nearest_or_all(name, &format!("its {what}s"), &known);
                self.find(code::UNKNOWN_LINK, Span::default(), message, help);
            }
        }
    }

    /// The nodes in order, and the new place of each.
    fn nodes(
        &mut self,
        drafts: Vec<Draft<'_>>,
        order: &[usize],
    ) -> Option<(Vec<GraphNode>, Vec<usize>)> {
        let mut places = vec![usize::MAX; drafts.len()];
        order.iter().enumerate().for_each(|(place, &node)| places[node] = place);
        let mut drafts: Vec<Option<Draft<'_>>> = drafts.into_iter().map(Some).collect();
        let mut nodes = Vec::with_capacity(order.len());
        for &index in order {
            let draft = drafts[index].take()?;
            nodes.push(self.node(draft, &places));
        }
        nodes.into_iter().collect::<Option<Vec<_>>>().map(|nodes| (nodes, places))
    }

    /// The node itself, with what only its own type can tell of its fields.
    fn read(&mut self, entry: &Entry, reader: &Reader<'_>) -> Option<Box<dyn AnyNode>> {
        let node = match (entry.node.read)(reader) {
            Ok(node) => node,
            Err(error) => {
                let message = format!("{} cannot be read: {}", entry.name, error.message);
                self.find(code::WRONG_VALUE, error.span.unwrap_or(reader.tree.span), message, "");
                return None;
            }
        };
        let files = match self.options.files {
            Files::Needed => node.files(),
            Files::Ignored => Vec::new(),
        };
        for file in files {
            let (given, resolved) = (file.given(), file.resolved());
            if let Err(PathProblem::Outside { message, help }) =
                may_read(given, resolved, &self.roots)
            {
                self.find(code::OUTSIDE, reader.tree.span, message, help);
            }
        }
        Some(node)
    }

    fn node(&mut self, draft: Draft<'_>, places: &[usize]) -> Option<GraphNode> {
        let (entry, node) = (draft.entry?, draft.node?);
        let parameters = match node.parameters() {
            Ok(parameters) => parameters,
            Err(error) => {
                let message = format!("{} cannot be written: {error}", entry.name);
                self.find(
                    code::WRONG_VALUE,
                    draft.tree.span,
                    message,
                    "this is a fault of the node",
                );
                return None;
            }
        };
        let links = draft.links.into_iter().zip(draft.targets).map(|(link, target)| {
            target.map(|(node, output)| Link { port: link.port, node: places[node], output })
        });
        let named = draft.files.into_iter();
        let named =
            named.map(|file| NodeFile { given: file.given, path: file.resolved, needed: true });
        let optional = node.files().into_iter().map(|file| NodeFile {
            given: file.given().to_owned(),
            path: file.resolved().to_owned(),
            needed: false,
        });
        let files = Vec::from_iter(named.chain(optional));
        Some(GraphNode {
            name: draft.name.text,
            recipe: Arc::new(Recipe::new(&entry.name, parameters, &files)),
            span: draft.tree.span,
            node,
            links: links.collect::<Option<_>>()?,
            files,
            tree: draft.tree,
            outputs: entry.outputs().iter().map(|output| output.name).collect(),
            types: draft.types,
        })
    }
}

struct TopLevel<'t> {
    doc: String,
    params: &'t [(Tree, Tree)],
    nodes: &'t [(Tree, Tree)],
    outputs: &'t [(Tree, Tree)],
    expect: Option<&'t Tree>,
}

/// Puts a value at `field` or `field.field` of a call; a field that is not there is added.
fn set_field(tree: &mut Tree, path: &str, value: &Tree) {
    let (name, rest) = match path.split_once('.') {
        Some((name, rest)) => (name, Some(rest)),
        None => (path, None),
    };
    let span = tree.span;
    let Kind::Call { body, .. } = &mut tree.kind else { return };
    if *body == Body::Empty {
        *body = Body::Fields(Vec::new());
    }
    let Body::Fields(fields) = body else { return };
    let found = fields.iter().position(|field| field.name.text == name);
    let index = found.unwrap_or_else(|| {
        let name = Name { text: name.to_owned(), span };
        fields.push(Field {
            name,
            value: Tree::new(span, Kind::Call { name: None, body: Body::Empty }),
        });
        fields.len() - 1
    });
    let field = &mut fields[index].value;
    match rest {
        Some(rest) => set_field(field, rest, value),
        None => *field = Tree { span: field.span, ..value.clone() },
    }
}
