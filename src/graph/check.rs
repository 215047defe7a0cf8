//! Reads a graph file and finds every problem in it.
//!
//! A mistake causes one problem: a node whose fields are wrong still has its output types, and what cannot be known because
//! of another problem is not reported.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::file::{self, Body, Field, Kind, Name, Tree};
use super::parameters::{Parameters, read_set};
use super::paths::{PathProblem, may_read, project_root, stays_inside};
use super::schema::{Finding, FoundFile, FoundLink, Walk};
use super::suggest::nearest_or_all;
use super::{
    Checked, Files, Graph, GraphNode, GraphOutput, Link, Options, ReadFile, Reader, Shape, any_of,
    with_article,
};
use crate::catalog::{Catalog, Entry};
use crate::error::{Source, Span, code};
use crate::eval::{NodeFile, Recipe};
use crate::golden::Expectation;
use crate::node::{AnyNode, Output, ending};
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

struct Check<'a> {
    catalog: &'a Catalog,
    options: &'a Options,
    folder: PathBuf,
    roots: Vec<PathBuf>,
    findings: Vec<Finding>,
    /// The files of the nodes that have been looked at.
    files: Vec<ReadFile>,
}

/// A node while it is checked.
struct Draft<'a> {
    name: Name,
    tree: Tree,
    entry: Option<&'a Entry>,
    links: Vec<FoundLink>,
    files: Vec<FoundFile>,
    /// For each link, the node and output that it names, if they exist.
    targets: Vec<Option<(usize, usize)>>,
    /// The type of each output, as far as it is known.
    types: Vec<Option<&'static ValueType>>,
    /// The node itself, if its fields have no problem.
    node: Option<Box<dyn AnyNode>>,
}

impl Draft<'_> {
    fn outputs(&self) -> &[Output] {
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

    fn find(&mut self, code: &'static str, span: Span, message: String, help: impl Into<String>) {
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

    /// Finds what each link names.
    fn link(&mut self, drafts: &mut [Draft<'a>]) {
        let names: HashMap<String, usize> = drafts
            .iter()
            .enumerate()
            .map(|(index, draft)| (draft.name.text.clone(), index))
            .collect();
        for index in 0..drafts.len() {
            let targets = drafts[index].links.iter().map(|link| (link.text.clone(), link.span));
            let targets: Vec<_> = targets.collect();
            drafts[index].targets = targets
                .into_iter()
                .map(|(text, span)| self.target(&text, span, drafts, &names))
                .collect();
        }
    }

    fn target(
        &mut self,
        text: &str,
        span: Span,
        drafts: &[Draft<'_>],
        names: &HashMap<String, usize>,
    ) -> Option<(usize, usize)> {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output)),
            None => (text, None),
        };
        let Some(&index) = names.get(node) else {
            let known: Vec<&str> = drafts.iter().map(|draft| &draft.name.text[..]).collect();
            let help = nearest_or_all(node, "the graph's nodes", &known);
            self.find(code::UNKNOWN_LINK, span, format!("there is no node `{node}`"), help);
            return None;
        };
        let draft = &drafts[index];
        let (Some(output), Some(entry)) = (output, draft.entry) else { return Some((index, 0)) };
        let names: Vec<&str> = draft.outputs().iter().map(|output| output.name).collect();
        let found = names.iter().position(|name| *name == output);
        if found.is_none() {
            let message = format!(
                "`{node}` is {}, which has no output `{output}`",
                with_article(&entry.name)
            );
            self.find(
                code::UNKNOWN_LINK,
                span,
                message,
                nearest_or_all(output, "its outputs", &names),
            );
        }
        found.map(|output| (index, output))
    }

    /// The nodes, each after those that it hangs on; nodes in a cycle, which is reported, are left out.
    fn order(&mut self, drafts: &[Draft<'_>]) -> Vec<usize> {
        const NEW: u8 = 0;
        const OPEN: u8 = 1;
        const DONE: u8 = 2;
        let mut state = vec![NEW; drafts.len()];
        let mut order = Vec::with_capacity(drafts.len());
        for start in 0..drafts.len() {
            // Depth first without recursion: a chain of nodes may be longer than the stack is deep.
            let mut path: Vec<(usize, usize)> = Vec::new();
            if state[start] == NEW {
                state[start] = OPEN;
                path.push((start, 0));
            }
            while let Some(&mut (node, ref mut next)) = path.last_mut() {
                let Some(target) = drafts[node].targets.get(*next) else {
                    state[node] = DONE;
                    order.push(node);
                    path.pop();
                    continue;
                };
                *next += 1;
                let Some((target, _)) = *target else { continue };
                if state[target] == NEW {
                    state[target] = OPEN;
                    path.push((target, 0));
                } else if state[target] == OPEN {
                    let first =
                        path.iter().position(|(node, _)| *node == target).unwrap_or_default();
                    let cycle: Vec<usize> = path[first..].iter().map(|(node, _)| *node).collect();
                    self.cycle(&cycle, drafts);
                }
            }
        }
        order
    }

    fn cycle(&mut self, cycle: &[usize], drafts: &[Draft<'_>]) {
        let lowest =
            (0..cycle.len()).min_by_key(|&k| drafts[cycle[k]].name.span).unwrap_or_default();
        let around =
            (0..=cycle.len()).map(|k| &drafts[cycle[(lowest + k) % cycle.len()]].name.text[..]);
        let path = Vec::from_iter(around).join(" <- ");
        let span = drafts[cycle[lowest]].name.span;
        let message = format!("nodes hang on each other in a circle: {path}");
        self.find(
            code::CYCLE,
            span,
            message,
            "a node cannot need its own result: break one of these links",
        );
    }

    /// Finds the type of every output and checks that every link fits.
    fn types(&mut self, drafts: &mut [Draft<'a>], order: &[usize]) {
        for &index in order {
            let draft = &drafts[index];
            let mut came_in: Vec<(&str, &'static ValueType)> = Vec::new();
            let mut misfits = Vec::new();
            for (link, target) in draft.links.iter().zip(&draft.targets) {
                let Some((node, output)) = *target else { continue };
                let Some(kind) = drafts[node].types.get(output).copied().flatten() else {
                    continue;
                };
                if link.types.iter().any(|fits| fits == kind.name) {
                    came_in.push((&link.wants, kind));
                } else {
                    misfits.push((link.clone(), kind));
                }
            }
            let types = draft.outputs().iter().map(|output| match output.types[..] {
                [kind] => Some(kind),
                _ => came_in.iter().find(|(wants, _)| *wants == output.kind).map(|(_, kind)| *kind),
            });
            let types: Vec<_> = types.collect();
            let owner = draft.entry.map_or("", |entry| &entry.name).to_owned();
            drafts[index].types = types;
            for (link, kind) in misfits {
                self.misfit(&owner, &link, kind);
            }
        }
    }

    fn misfit(&mut self, owner: &str, link: &FoundLink, kind: &ValueType) {
        let wanted = any_of(link.types.iter().map(String::as_str));
        let message = format!(
            "port `{}` of {owner} wants {}, but `{}` is {}",
            link.port,
            with_article(&wanted),
            link.text,
            with_article(kind.name)
        );
        let makers =
            link.types.iter().map(|wanted| (wanted, self.catalog.converters(kind.name, wanted)));
        let help = makers.filter_map(|(wanted, makers)| {
            let maker = makers.first()?;
            Some(format!("{} makes {} of it", with_article(maker), with_article(wanted)))
        });
        let help = Vec::from_iter(help).join("; ");
        self.find(code::WRONG_TYPE, link.span, message, help);
    }

    fn outputs(&mut self, entries: &[(Tree, Tree)], drafts: &[Draft<'_>]) -> Vec<GraphOutput> {
        let names: HashMap<String, usize> = drafts
            .iter()
            .enumerate()
            .map(|(index, draft)| (draft.name.text.clone(), index))
            .collect();
        let mut outputs: Vec<GraphOutput> = Vec::with_capacity(entries.len());
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!("the name of an output is a text, not {}", key.in_words());
                self.find(code::BAD_NAME, key.span, message, "write \"name.ply\": \"node\"");
                continue;
            };
            if !stays_inside(name) {
                let message = format!("output `{name}` lies outside of the folder of outputs");
                self.find(
                    code::OUTSIDE,
                    key.span,
                    message,
                    "name a file, such as \"model.ply\"; --out chooses the folder",
                );
                continue;
            }
            if outputs.iter().any(|before| before.name == name) {
                self.find(
                    code::BAD_NAME,
                    key.span,
                    format!("there is already an output `{name}`"),
                    "",
                );
                continue;
            }
            let Some(link) = value.text() else {
                let message = format!("output `{name}` wants a link, not {}", value.in_words());
                self.find(
                    code::WRONG_VALUE,
                    value.span,
                    message,
                    "write \"node\" or \"node.output\"",
                );
                continue;
            };
            let Some((node, output)) = self.target(link, value.span, drafts, &names) else {
                continue;
            };
            let kind = drafts[node].types.get(output).copied().flatten();
            let ending = ending(Path::new(name));
            let format = kind.and_then(|kind| self.catalog.format(kind, &ending));
            if let Some(format) = format {
                let (name, format) = (name.to_owned(), *format);
                outputs.push(GraphOutput { name, node, output, format, span: key.span });
            } else if kind.is_some() || !self.catalog.endings(None).contains(&&ending[..]) {
                self.no_format(name, &ending, kind, key.span);
            }
        }
        outputs
    }

    /// What the graph expects of its values; each must be there.
    fn expectations(
        &mut self,
        tree: Option<&Tree>,
        drafts: &[Draft<'_>],
    ) -> Vec<(Expectation, Span)> {
        let Some(tree) = tree else { return Vec::new() };
        let (expectations, findings) = Expectation::read_all(tree);
        self.findings.extend(findings);
        let names: HashMap<String, usize> =
            (0..drafts.len()).map(|index| (drafts[index].name.text.clone(), index)).collect();
        for (expectation, span) in &expectations {
            for value in expectation.values() {
                self.target(value, *span, drafts, &names);
            }
        }
        expectations
    }

    fn no_format(&mut self, name: &str, ending: &str, kind: Option<&ValueType>, span: Span) {
        let known = self.catalog.endings(kind);
        let what = kind.map_or_else(|| "a value".to_owned(), |kind| with_article(kind.name));
        let message = match ending {
            "" => format!("output `{name}` has no ending that says how to write {what}"),
            _ => format!("{what} cannot be written to a `.{ending}` file"),
        };
        let help = match (known.is_empty(), kind) {
            (true, _) => format!("{what} has no file format"),
            (false, _) => format!("{what} can be written to: {}", known.join(", ")),
        };
        self.find(code::OUTPUT_FORMAT, span, message, help);
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
