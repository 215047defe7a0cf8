//! What stands in the text of a graph, part by part: for programs that show graphs as nodes and edit them there.
//!
//! It says what the text says, right or wrong: a link that leads nowhere and a node of an unknown type are parts like all others.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use maquette_edit::References;
use maquette_graph::catalog::Catalog;
use maquette_graph::definition::{Draft, What, Whole};
use maquette_graph::describe::Subgraph;
use maquette_graph::load::{first, judged};
use maquette_graph::meaning::named_node;
use maquette_graph::quality::has_draft;
use maquette_graph::tree::entries;
use maquette_graph::{Checked, Options};
use maquette_syntax::error::{Lines, Place, Span};
use maquette_syntax::{Body, Kind, Sheet, Token, Tree, tokens};
use serde::Serialize;
use serde_json::Value as Json;

/// The parts of a graph's text, each section in the order of the text.
#[derive(Debug, Serialize)]
pub struct Outline {
    pub(crate) doc: String,
    /// The graphs that it uses, described as types of nodes.
    pub(crate) types: Vec<Json>,
    pub(crate) inputs: Vec<Entry>,
    pub(crate) params: Vec<Entry>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) outputs: Vec<Given>,
    /// The nodes, each behind those that it hangs on as far as there is no circle.
    #[serde(skip)]
    pub(crate) order: Vec<usize>,
}

/// A named part of a section.
#[derive(Debug, Serialize)]
pub(crate) struct Entry {
    pub(crate) name: String,
    /// The name of its type; empty if it is no call.
    #[serde(rename = "type")]
    pub(crate) kind: String,
    /// Its value as it is written.
    pub(crate) text: String,
    /// Whether a `Draft(..)` stands in it.
    pub(crate) draft: bool,
    /// The comment in the lines before it; empty if there is none.
    pub(crate) comment: String,
    /// Entries with no blank line between them are of one paragraph; they are counted from 0.
    pub(crate) paragraph: usize,
    /// Where its name stands, counted from 1.
    pub(crate) line: usize,
    pub(crate) column: usize,
}

/// A node.
#[derive(Debug, Serialize)]
pub struct Node {
    #[serde(flatten)]
    pub(crate) entry: Entry,
    /// The fields that are written, by name, with their values as these are written.
    pub(crate) fields: Vec<(String, String)>,
    /// The names of the ports of its type; empty if the type is not known.
    pub(crate) ports: Vec<String>,
    pub(crate) links: Vec<Link>,
    pub(crate) outputs: Vec<Output>,
}

/// A link of a node.
#[derive(Debug, Serialize)]
pub(crate) struct Link {
    /// The way to it through the node's fields, as edits name ports: `mask`, `images.2`.
    pub(crate) port: String,
    #[serde(flatten)]
    pub(crate) target: Target,
}

/// What a link leads to.
#[derive(Debug, Serialize)]
pub struct Target {
    /// As it is written: `scan.color`.
    pub(crate) to: String,
    /// The node or input. That of an element of a `ForEach` is the `ForEach`.
    pub(crate) node: String,
    /// The output, the first one where none is written; empty where nodes have one without a name.
    pub(crate) output: String,
}

/// An output of a node.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Output {
    /// Its name; that of an input and of a `Switch` is empty.
    pub(crate) name: String,
    /// The name of the type of its values, if that is known.
    #[serde(rename = "type")]
    pub(crate) kind: Option<&'static str>,
}

/// An output of the graph.
#[derive(Debug, Serialize)]
pub(crate) struct Given {
    #[serde(flatten)]
    pub(crate) entry: Entry,
    /// None if the text says no link here.
    pub(crate) link: Option<Target>,
}

/// What is known of the graph file at `path` with this text, and the text's parts; those of a patch are the graph's that it
/// patches. No parts if it cannot be said what stands in it.
pub fn outline(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
) -> (Checked, Option<Outline>) {
    let (world, whole) = first(path, text, catalog, options);
    let outline = whole.as_ref().map(|whole| {
        let used = world.listed.iter().filter(|(depth, ..)| *depth == 1);
        let used = used.map(|(_, name, graph)| Subgraph::new(name, graph));
        Outliner::new(whole).outline(used.map(|used| used.description().to_json()).collect())
    });
    (judged(world, whole.map(Arc::new)), outline)
}

/// Reads the parts of a text.
struct Outliner<'w> {
    whole: &'w Whole,
    sheet: &'w Sheet,
    references: References,
}

impl<'w> Outliner<'w> {
    fn new(whole: &'w Whole) -> Self {
        let sheet = &*whole.definition.sheet;
        let references = References::within(&whole.definition);
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
                .map(|(entry, (_, value)): (Entry, (&str, &Tree))| Given {
                    entry,
                    link: value.text().map(|text| self.target(text)),
                })
                .collect(),
            order: Vec::new(),
        };
        outline.order = self.order(&outline.nodes);
        outline
    }

    /// The places of the nodes among each other.
    fn order(&self, nodes: &[Node]) -> Vec<usize> {
        let definition = &self.whole.definition;
        let ranks = definition.order.iter().enumerate();
        let ranks: HashMap<&str, usize> = ranks
            .map(|(rank, &draft)| (named_node(&definition.drafts[draft].name.text), rank))
            .collect();
        let mut order = Vec::from_iter(0..nodes.len());
        order.sort_by_key(|&node| ranks.get(&nodes[node].entry.name[..]).copied());
        order
    }

    fn text(&self) -> &'w str {
        &self.sheet.source.text
    }

    fn written(&self, span: Span) -> String {
        self.text()[span.start..span.end].to_owned()
    }

    /// The entries of a section.
    fn section(&self, section: &str) -> Vec<Entry> {
        let fields = self.whole.definition.tree.fields().unwrap_or_default().iter();
        let maps = fields.filter(|field| field.name.text == section).map(|field| &field.value);
        let mut lines = Lines::default();
        let mut found = Vec::new();
        for map in maps {
            let Kind::Map(entries) = &map.kind else { continue };
            let (mut behind, mut paragraph) = (map.span.start + 1, 0);
            for (key, value) in entries {
                let Before { comment, has_blank_line } =
                    Before::of(&self.text()[behind..key.span.start]);
                paragraph += usize::from(has_blank_line && !found.is_empty());
                behind = value.span.end;
                let Some(name) = key.text() else { continue };
                let (source, place) = self.sheet.place(key.span);
                let Place { line, column } = lines.place(&source, place.start);
                found.push(Entry {
                    name: name.to_owned(),
                    kind: value.name().map_or_else(String::new, |kind| kind.text),
                    text: self.written(value.span),
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
        let fields = fields.map(|field| (field.name.text.clone(), self.written(field.value.span)));
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

    /// The links in a part of a node, which this way leads to.
    fn links(&self, tree: &Tree, way: &mut Vec<String>, found: &mut Vec<Link>) {
        let mut inside = |step: Option<String>, part: &Tree| {
            let steps = way.len();
            way.extend(step);
            self.links(part, way, found);
            way.truncate(steps);
        };
        match &tree.kind {
            Kind::Text(text) if self.references.is_link(tree.span) => {
                found.push(Link { port: way.join("."), target: self.target(text) });
            }
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().for_each(|it| inside(Some(it.name.text.clone()), &it.value));
            }
            Kind::Map(entries) => {
                for (key, value) in entries {
                    inside(key.text().map(str::to_owned), value);
                }
            }
            Kind::Call { body: Body::Items(items), .. } if tree.call_of("Some").is_some() => {
                items.iter().for_each(|item| inside(None, item));
            }
            Kind::Call { body: Body::Items(items), .. } | Kind::List(items) => {
                for (index, item) in items.iter().enumerate() {
                    inside(Some(index.to_string()), item);
                }
            }
            _ => {}
        }
    }

    fn target(&self, text: &str) -> Target {
        let (node, output) = match text.split_once('.') {
            Some((node, output)) => (node, Some(output.to_owned())),
            None => (text, None),
        };
        let node = named_node(node).to_owned();
        let output = output.or_else(|| {
            let first = self.drafts(&node).next()?;
            first.what.outputs().first().map(|&name| name.to_owned())
        });
        Target { to: text.to_owned(), node, output: output.unwrap_or_default() }
    }

    /// The drafts of a node: several of a `ForEach`.
    fn drafts(&self, name: &str) -> impl Iterator<Item = &'w Draft> {
        let drafts = self.whole.definition.drafts.iter();
        drafts.filter(move |draft| named_node(&draft.name.text) == name)
    }

    fn outputs(&self, name: &str) -> Vec<Output> {
        fn unknown(name: &str) -> Output {
            Output { name: name.to_owned(), kind: None }
        }
        let Some(draft) = self.drafts(name).next() else {
            let eaches = &self.whole.definition.eaches;
            let each = eaches.iter().find(|each| each.name == name);
            let names = each.and_then(|each| each.outputs.as_ref()).into_iter().flatten();
            return names.map(|name| unknown(name)).collect();
        };
        let types = || draft.types.iter().map(|kind| kind.map(|kind| kind.name));
        match draft.what {
            What::Input | What::Switch(_) => {
                let kind = types().next().flatten();
                vec![Output { name: String::new(), kind }]
            }
            // Those that are named.
            What::Unknown(_) => {
                let named = self.references.links().filter(|text| named_node(text) == name);
                let named = named.map(|text| text.split_once('.').map_or("", |(_, output)| output));
                let mut names = Vec::from_iter(named);
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

/// What stands between two entries.
struct Before {
    comment: String,
    has_blank_line: bool,
}

impl Before {
    /// Comments on the line of the entry before are that one's.
    fn of(text: &str) -> Self {
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
