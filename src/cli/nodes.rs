//! `maquette nodes`: prints the reference of nodes, which is generated from their types.

use std::fmt::Write;
use std::path::Path;

use clap::Args;
use maquette_graph::catalog::{Catalog, Description, Entry, describe_default, describe_parameter};
use maquette_graph::{Files, Graph, Options, Subgraph};
use maquette_syntax::{any_of, nearest, resolve_field, unknown_name_message, variants};
use serde_json::{Value as Json, json};

use super::{Exit, has_errors, print, print_json, program, report};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Nodes {
    /// Print this node in full, or the graphs that a graph file uses [default: list all nodes].
    #[arg(value_name = "NODE|GRAPH")]
    node: Option<String>,
    /// Print only this used graph.
    #[arg(value_name = "NODE")]
    of_graph: Option<String>,
    /// Print all nodes in full, not only the first sentence of each.
    #[arg(long)]
    doc: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

impl Nodes {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let Some(name) = &self.node else {
            match self.json {
                true => print_json(
                    &json!({ "nodes": catalog.entries().map(Entry::to_json).collect::<Vec<_>>() }),
                ),
                false if self.doc => {
                    self.print(&catalog.entries().map(Entry::description).collect::<Vec<_>>());
                }
                false => print(&node_list(catalog)),
            }
            return Exit::Done;
        };
        if name.ends_with(".ron") {
            return self.graph(Path::new(name), catalog);
        }
        let Some(entry) = catalog.find(name) else {
            let message = format!("there is no node type `{name}`");
            let names = catalog.names();
            let described = catalog.described_with(name);
            return Exit::Usage(match nearest(name, names.iter().copied()).is_empty() {
                true if !described.is_empty() => format!("{message}; {described}"),
                _ => unknown_name_message(message, name, "node types", &names),
            });
        };
        self.print(&[entry.description()]);
        Exit::Done
    }

    fn print(&self, nodes: &[Description<'_>]) {
        if self.json {
            let nodes = nodes.iter().map(Description::to_json).collect::<Vec<_>>();
            return print_json(&json!({ "nodes": nodes }));
        }
        let nodes = nodes.iter().map(describe_node);
        print(&Vec::from_iter(nodes).join("\n"));
    }

    /// Prints the reference of the graphs that a graph uses. If the graph itself has inputs, it comes first.
    fn graph(&self, path: &Path, catalog: &Catalog) -> Exit {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let (subgraphs, diagnostics) = Graph::subgraphs(path, catalog, &options);
        report(&diagnostics);
        let found: Vec<_> = subgraphs
            .iter()
            .filter(|it| self.of_graph.as_ref().is_none_or(|name| it.name == *name))
            .map(Subgraph::description)
            .collect();
        if let (true, Some(name)) = (found.is_empty(), &self.of_graph) {
            let message = format!("{} uses no graph `{name}`", path.for_display());
            let known: Vec<_> = subgraphs.iter().map(|it| &it.name[..]).collect();
            return Exit::Usage(unknown_name_message(message, name, "it uses", &known));
        }
        self.print(&found);
        if found.is_empty() && !self.json && diagnostics.is_empty() {
            print(&format!("{} uses no other graph\n", path.for_display()));
        }
        if has_errors(&diagnostics) { Exit::Failed } else { Exit::Done }
    }
}

/// Returns a list of all nodes, with one line per node, grouped by pack.
fn node_list(catalog: &Catalog) -> String {
    let mut text = String::new();
    let mut pack = "";
    let longest = catalog.names().into_iter().map(str::len).max().unwrap_or(0);
    for entry in catalog.entries() {
        if pack != entry.pack {
            let gap = if pack.is_empty() { "" } else { "\n" };
            let _ = writeln!(text, "{gap}{}", entry.pack);
            pack = entry.pack;
        }
        let doc = doc(entry.schema()).replace('\n', " ");
        let sentence = doc.find(". ").map_or(&doc[..], |end| &doc[..=end]);
        let _ = writeln!(text, "  {:<longest$}  {sentence}", entry.name);
    }
    let program = program();
    let _ = writeln!(
        text,
        "\n`{program} nodes NODE` prints one in full, `{program} help graph` explains how to build a graph."
    );
    text
}

fn doc(schema: &Json) -> &str {
    schema.get("description").and_then(Json::as_str).unwrap_or_default()
}

/// Returns the complete reference of a node.
fn describe_node(entry: &Description<'_>) -> String {
    let schema = entry.schema;
    let version = entry.version.map_or_else(String::new, |version| format!(" {version}"));
    let mut text =
        format!("{}{version} ({})\n\n{}\n", entry.name, entry.pack, indent(doc(schema), 0));
    let ports = entry.ports();
    if !ports.is_empty() {
        text += "\nInputs\n";
    }
    for port in &ports {
        let types = any_of(port.types.iter().map(String::as_str));
        let many = if port.many { ", any number" } else { "" };
        let optional = if port.optional { ", optional" } else { "" };
        let _ =
            writeln!(text, "  {}: {types}{many}{optional}\n{}", port.name, indent(&port.doc, 6));
        for want in &port.requirements {
            let _ = writeln!(text, "      wants {want}");
        }
    }
    let fields = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
    let parameters: Vec<_> =
        fields.filter(|(name, _)| ports.iter().all(|port| port.name != **name)).collect();
    if !parameters.is_empty() {
        text += "\nParameters\n";
    }
    for (name, field) in parameters {
        describe_parameter_tree(&mut text, name, field, schema, 2);
    }
    text += "\nOutputs\n";
    for (name, types) in &entry.outputs {
        let same = if types.len() > 1 { " (the type of the input)" } else { "" };
        let _ = writeln!(text, "  {name}: {}{same}", any_of(types.iter().copied()));
        for promise in entry.promises_of(name) {
            let _ = writeln!(text, "      promises {promise}");
        }
    }
    let _ = writeln!(text, "\nExactness\n  {}", entry.exactness.describe());
    if !entry.carries.is_empty() {
        text += "\nAttributes\n";
    }
    for carry in entry.carries {
        let fates = carry.by_domain().map(|(domain, fate)| format!("{domain} {}", fate.word()));
        let fates = Vec::from_iter(fates).join(", ");
        let own = match carry.own {
            [] => String::new(),
            own => format!(", except its own {}", own.join(", ")),
        };
        let _ = writeln!(text, "  {} to {}: {fates}{own}", carry.port, carry.output);
    }
    text
}

/// The maximum indentation of nested parameters. It ends the output of recursive types.
const MAX_INDENT: usize = 24;

/// Describes a parameter with its enum variants and nested fields.
fn describe_parameter_tree(text: &mut String, name: &str, field: &Json, root: &Json, by: usize) {
    let schema = resolve_field(field, root);
    let default = describe_default(field, root);
    let choices = choices(&schema);
    let items = schema.get("items").map(|items| resolve_field(items, root));
    let holder = if properties(&schema).is_some() { Some(&*schema) } else { items.as_deref() };
    let fields = holder.and_then(properties).filter(|_| by < MAX_INDENT);
    let kind = match (&fields, choices.is_empty() || by >= MAX_INDENT) {
        (_, false) => "one of".to_owned(),
        (Some(_), _) if properties(&schema).is_some() => "(..)".to_owned(),
        (Some(_), _) => "[(..), ..]".to_owned(),
        _ => describe_parameter(field, root),
    };
    let _ = writeln!(text, "{:by$}{name}: {kind}{default}", "");
    push_doc(text, doc(field), by + 4);
    if by >= MAX_INDENT {
        return;
    }
    for choice in choices {
        describe_choice(text, choice, root, by + 2);
    }
    for (name, field) in fields.into_iter().flatten() {
        describe_parameter_tree(text, name, field, root, by + 4);
    }
}

/// Describes an enum variant of a parameter with its fields.
fn describe_choice(text: &mut String, choice: &Json, root: &Json, by: usize) {
    let only = json!({ "oneOf": [choice] });
    let variants = variants(&only);
    for (name, content) in &variants {
        let content = content.map(|content| resolve_field(content, root));
        let Some(fields) = content.as_deref().and_then(properties) else {
            let description = describe_parameter(&only, root);
            let description = if variants.len() == 1 { &description } else { *name };
            let _ = writeln!(text, "{:by$}{description}", "");
            push_doc(text, doc(choice), by + 4);
            continue;
        };
        let _ = writeln!(text, "{:by$}{name}(..)", "");
        push_doc(text, doc(choice), by + 4);
        for (name, field) in fields {
            describe_parameter_tree(text, name, field, root, by + 4);
        }
    }
}

/// Appends a description, unless it is empty.
fn push_doc(text: &mut String, doc: &str, by: usize) {
    if !doc.is_empty() {
        let _ = writeln!(text, "{}", indent(doc, by));
    }
}

/// Returns the variants of an enum, if the JSON schema describes them one by one.
fn choices(schema: &Json) -> &[Json] {
    schema.get("oneOf").and_then(Json::as_array).map(Vec::as_slice).unwrap_or_default()
}

fn properties(schema: &Json) -> Option<&serde_json::Map<String, Json>> {
    schema.get("properties").and_then(Json::as_object)
}

fn indent(text: &str, by: usize) -> String {
    let lines = text.lines().map(|line| format!("{:by$}{line}", ""));
    Vec::from_iter(lines).join("\n")
}
