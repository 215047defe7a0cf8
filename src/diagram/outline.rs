//! The parts of a graph's text, for programs that display and edit a graph as a diagram of nodes.
//!
//! Invalid parts, such as links without a target and nodes of unknown types, are included.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use maquette_edit::References;
use maquette_graph::canonical::node_of_link;
use maquette_graph::catalog::Catalog;
use maquette_graph::definition::{NodeKind, ParsedFile, ParsedNode};
use maquette_graph::describe::Subgraph;
use maquette_graph::draft_value::has_draft;
use maquette_graph::load::{check_file, finish_check};
use maquette_graph::tree::entries;
use maquette_graph::{CheckedGraph, Options};
use maquette_syntax::error::{LineIndex, Position, Span};
use maquette_syntax::{Body, Kind, SourceMap, Token, Tree, tokens};
use serde::Serialize;
use serde_json::Value as Json;

/// The parts of a graph's text. The entries of each section are in the order of the text.
#[derive(Debug, Serialize)]
pub struct Outline {
    pub(crate) doc: String,
    /// The graphs that the graph uses as nodes, each described as a node type.
    pub(crate) types: Vec<Json>,
    pub(crate) inputs: Vec<Entry>,
    pub(crate) params: Vec<Entry>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) outputs: Vec<OutputEntry>,
    /// The indices of the nodes in topological order: each node comes after its dependencies. The nodes of a cycle are in any order.
    #[serde(skip)]
    pub(crate) order: Vec<usize>,
}

/// An entry of a section of the graph file: a name and a value.
#[derive(Debug, Serialize)]
pub(crate) struct Entry {
    pub(crate) name: String,
    /// The name of the call that is the value, such as a node type. Empty if the value is not a call.
    #[serde(rename = "type")]
    pub(crate) kind: String,
    /// The text of the value, as the file contains it.
    pub(crate) text: String,
    /// True if the value contains a `Draft(..)`.
    pub(crate) draft: bool,
    /// The comment lines directly before the entry. Empty if there are none.
    pub(crate) comment: String,
    /// The index, from 0, of the entry's paragraph in its section. Blank lines separate paragraphs.
    pub(crate) paragraph: usize,
    /// The line and column at which the name begins, counted from 1.
    pub(crate) line: usize,
    pub(crate) column: usize,
}

/// A node of the outline.
#[derive(Debug, Serialize)]
pub struct Node {
    #[serde(flatten)]
    pub(crate) entry: Entry,
    /// The fields in the text of the node, as pairs of a name and the text of the value.
    pub(crate) fields: Vec<(String, String)>,
    /// The names of the ports of the node type. Empty if the type is unknown.
    pub(crate) ports: Vec<String>,
    pub(crate) links: Vec<Link>,
    pub(crate) outputs: Vec<Output>,
}

/// A link of a node.
#[derive(Debug, Serialize)]
pub(crate) struct Link {
    /// The path through the node's fields to the port, in the form that edits use: `mask` or `images.2`.
    pub(crate) port: String,
    #[serde(flatten)]
    pub(crate) target: Target,
}

/// The target of a link.
#[derive(Debug, Serialize)]
pub struct Target {
    /// The text of the link, such as `scan.color`.
    pub(crate) to: String,
    /// The name of the node or input to which the link leads. For an element of a `ForEach`, the name of the `ForEach`.
    pub(crate) node: String,
    /// The name of the output to which the link leads. If the link names no output, the node's first output; empty if that has no name.
    pub(crate) output: String,
}

/// An output of a node of the outline.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Output {
    /// The name of the output. Empty for an input and for a `Switch`, whose only output has no name.
    pub(crate) name: String,
    /// The name of the value type. `None` if it is unknown.
    #[serde(rename = "type")]
    pub(crate) kind: Option<&'static str>,
}

/// An output of the graph.
#[derive(Debug, Serialize)]
pub(crate) struct OutputEntry {
    #[serde(flatten)]
    pub(crate) entry: Entry,
    /// The target of the output's link. `None` if the value of the output is not a link.
    pub(crate) link: Option<Target>,
}

/// Checks a text as the content of the graph file at `path`. Returns the result of the check, and the outline: nodes, links and outputs. If
/// the file is a patch, which lists changes of another graph, the outline is that of the changed graph. It is `None` if the text cannot be
/// parsed.
pub fn outline(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
) -> (CheckedGraph, Option<Outline>) {
    let (world, whole) = check_file(path, text, catalog, options);
    let outline = whole.as_ref().map(|whole| {
        let used = world.node_types.iter().filter(|(depth, ..)| *depth == 1);
        let used = used.map(|(_, name, graph)| Subgraph::new(name, graph));
        Outliner::new(whole).outline(used.map(|used| used.description().to_json()).collect())
    });
    (finish_check(world, whole.map(Arc::new)), outline)
}

/// Collects the parts of a graph's text.
struct Outliner<'w> {
    whole: &'w ParsedFile,
    sheet: &'w SourceMap,
    references: References,
}

impl<'w> Outliner<'w> {
    fn new(whole: &'w ParsedFile) -> Self {
        let sheet = &*whole.definition.source_map;
        let references = References::of_definition(&whole.definition);
        Self { whole, sheet, references }
    }

    fn outline(&self, types: Vec<Json>) -> Outline {
        let fields = self.whole.definition.tree.fields().unwrap_or_default();
        let nodes = self.section("nodes").into_iter().zip(entries(fields, "nodes"));
        let outputs = self.section("outputs").into_iter().zip(entries(fields, "outputs"));
        let mut outline = Outline {
            doc: self.whole.definition.doc.clone(),
            types,
            inputs: self.section("inputs"),
            params: self.section("params"),
            nodes: nodes.map(|(entry, (_, call))| self.node(entry, call)).collect(),
            outputs: outputs
                .map(|(entry, (_, value)): (Entry, (&str, &Tree))| OutputEntry {
                    entry,
                    link: value.text().map(|text| self.target(text)),
                })
                .collect(),
            order: Vec::new(),
        };
        outline.order = self.order(&outline.nodes);
        outline
    }

    /// Returns the indices of the nodes in topological order: each node comes after its dependencies.
    fn order(&self, nodes: &[Node]) -> Vec<usize> {
        let definition = &self.whole.definition;
        let ranks = definition.order.iter().enumerate();
        let ranks: HashMap<&str, usize> = ranks
            .map(|(rank, &draft)| (node_of_link(&definition.parsed_nodes[draft].name.text), rank))
            .collect();
        let mut order = Vec::from_iter(0..nodes.len());
        order.sort_by_key(|&node| ranks.get(&nodes[node].entry.name[..]).copied());
        order
    }

    fn text(&self) -> &'w str {
        &self.sheet.source.text
    }

    fn source_text(&self, span: Span) -> String {
        self.text()[span.start..span.end].to_owned()
    }

    /// Returns the entries of a section of the graph file.
    fn section(&self, section: &str) -> Vec<Entry> {
        let fields = self.whole.definition.tree.fields().unwrap_or_default().iter();
        let maps = fields.filter(|field| field.name.text == section).map(|field| &field.value);
        let mut lines = LineIndex::default();
        let mut found = Vec::new();
        for map in maps {
            let Kind::Map(entries) = &map.kind else { continue };
            let (mut behind, mut paragraph) = (map.span.start + 1, 0);
            for (key, value) in entries {
                let Gap { comment, has_blank_line } =
                    Gap::parse(&self.text()[behind..key.span.start]);
                paragraph += usize::from(has_blank_line && !found.is_empty());
                behind = value.span.end;
                let Some(name) = key.text() else { continue };
                let (source, place) = self.sheet.locate(key.span);
                let Position { line, column } = lines.position(&source, place.start);
                found.push(Entry {
                    name: name.to_owned(),
                    kind: value.name().map_or_else(String::new, |kind| kind.text),
                    text: self.source_text(value.span),
                    draft: has_draft(value),
                    comment,
                    paragraph,
                    line,
                    column,
                });
            }
        }
        found
    }

    fn node(&self, entry: Entry, call: &Tree) -> Node {
        let fields = call.fields().unwrap_or_default().iter();
        let fields =
            fields.map(|field| (field.name.text.clone(), self.source_text(field.value.span)));
        let ports = self.references.ports.get(&entry.name).into_iter().flatten();
        let mut links = Vec::new();
        self.links(call, &mut Vec::new(), &mut links);
        Node {
            fields: fields.collect(),
            ports: ports.map(|port| port.name.clone()).collect(),
            links,
            outputs: self.outputs(&entry.name),
            entry,
        }
    }

    /// Collects the links in the value `tree`, which is part of a node. `way` is the path from the node to the value.
    fn links(&self, tree: &Tree, way: &mut Vec<String>, found: &mut Vec<Link>) {
        // The parts of the value, each with its step of the path. `None` if the part has the same path as the value.
        let mut parts: Vec<(Option<String>, &Tree)> = Vec::new();
        match &tree.kind {
            Kind::Text(text) if self.references.is_link(tree.span) => {
                found.push(Link { port: way.join("."), target: self.target(text) });
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                parts.extend(fields.iter().map(|it| (Some(it.name.text.clone()), &it.value)));
            }
            Kind::Map(entries) => {
                let entries = entries.iter();
                parts.extend(entries.map(|(key, value)| (key.text().map(str::to_owned), value)));
            }
            Kind::Call { body: Body::Items(items), .. } if tree.call_of("Some").is_some() => {
                parts.extend(items.iter().map(|item| (None, item)));
            }
            Kind::Call { body: Body::Items(items), .. } | Kind::List(items) => {
                let items = items.iter().enumerate();
                parts.extend(items.map(|(index, item)| (Some(index.to_string()), item)));
            }
            _ => {}
        }
        for (step, part) in parts {
            let steps = way.len();
            way.extend(step);
            self.links(part, way, found);
            way.truncate(steps);
        }
    }

    fn target(&self, text: &str) -> Target {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output.to_owned())),
            None => (text, None),
        };
        let node = node_of_link(node).to_owned();
        let output = output.or_else(|| {
            let first = self.drafts(&node).next()?;
            first.what.outputs().first().map(|&name| name.to_owned())
        });
        Target { to: text.to_owned(), node, output: output.unwrap_or_default() }
    }

    /// Returns the parsed nodes that belong to the entry of this name. A `ForEach` may have several.
    fn drafts(&self, name: &str) -> impl Iterator<Item = &'w ParsedNode> {
        let drafts = self.whole.definition.parsed_nodes.iter();
        drafts.filter(move |draft| node_of_link(&draft.name.text) == name)
    }

    fn outputs(&self, name: &str) -> Vec<Output> {
        fn unknown(name: &str) -> Output {
            Output { name: name.to_owned(), kind: None }
        }
        let Some(draft) = self.drafts(name).next() else {
            let eaches = &self.whole.definition.for_each_nodes;
            let each = eaches.iter().find(|each| each.name == name);
            let names = each.and_then(|each| each.outputs.as_ref()).into_iter().flatten();
            return names.map(|name| unknown(name)).collect();
        };
        let types = || draft.types.iter().map(|kind| kind.map(|kind| kind.name));
        match draft.what {
            NodeKind::Input | NodeKind::Switch(_) => {
                let kind = types().next().flatten();
                vec![Output { name: String::new(), kind }]
            }
            // If the type of a node is unknown, its outputs are those to which links refer.
            NodeKind::Unknown(_) => {
                let named = self.references.links().filter(|text| node_of_link(text) == name);
                let named = named.map(|text| text.split_once('.').map_or("", |(_, output)| output));
                let mut names = named.collect::<Vec<_>>();
                names.sort_unstable();
                names.dedup();
                names.into_iter().map(unknown).collect()
            }
            _ => draft
                .what
                .outputs()
                .into_iter()
                .zip(types())
                .map(|(name, kind): (&str, _)| Output { name: name.to_owned(), kind })
                .collect(),
        }
    }
}

/// The comments and blank lines between two entries.
struct Gap {
    comment: String,
    has_blank_line: bool,
}

impl Gap {
    /// Reads the comments between two entries. A comment on the same line as the previous entry belongs to that entry and is skipped.
    fn parse(text: &str) -> Self {
        let (mut lines, mut comment, mut has_blank_line) = (0, Vec::new(), false);
        for (token, span) in tokens(text) {
            let part = &text[span.start..span.end];
            let breaks = part.matches('\n').count();
            match token {
                Token::Space if 1 < breaks => {
                    (has_blank_line, comment) = (true, Vec::new());
                }
                Token::LineComment | Token::BlockComment if 0 < lines => {
                    let words = part.trim_start_matches(['/', '*']).trim_end_matches(['/', '*']);
                    comment.extend(words.lines().map(|line| line.trim().to_owned()));
                }
                _ => {}
            }
            lines += breaks;
        }
        Self { comment: comment.join("\n").trim().to_owned(), has_blank_line }
    }
}
