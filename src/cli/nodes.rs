//! `maquette nodes`: the reference, printed from the types themselves.

use std::fmt::Write;
use std::path::Path;

use clap::Args;
use serde_json::{Value as Json, json};

use super::{Exit, print, print_json, report};
use crate::catalog::{
    Catalog, Description, Entry, describe_choices, describe_default, describe_parameter,
};
use crate::graph::{Files, Graph, Options, Subgraph, any_of};

#[derive(Args)]
pub(super) struct Nodes {
    /// Only this node, in full; or a graph file: the graphs that it uses, in full.
    #[arg(value_name = "NODE|GRAPH")]
    node: Option<String>,
    /// Of a graph's, only this node.
    #[arg(value_name = "NODE")]
    of_graph: Option<String>,
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
                false => print(&list(catalog)),
            }
            return Exit::Done;
        };
        if name.ends_with(".ron") {
            return self.graph(Path::new(name), catalog);
        }
        let Some(entry) = catalog.find(name) else {
            let help = crate::graph::nearest(name, catalog.names());
            return Exit::Usage(format!("there is no node type `{name}`; {help}"));
        };
        self.print(&[entry.description()]);
        Exit::Done
    }

    fn print(&self, nodes: &[Description<'_>]) {
        if self.json {
            let nodes = nodes.iter().map(Description::to_json).collect::<Vec<_>>();
            return print_json(&json!({ "nodes": nodes }));
        }
        let nodes = nodes.iter().map(in_full);
        print(&Vec::from_iter(nodes).join("\n"));
    }

    /// The graphs that a graph uses; itself first, if it is made to be used.
    fn graph(&self, path: &Path, catalog: &Catalog) -> Exit {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let (subgraphs, problems) = Graph::subgraphs(path, catalog, &options);
        report(&problems);
        let wanted = |it: &&Subgraph| self.of_graph.as_ref().is_none_or(|name| it.name == *name);
        let found = Vec::from_iter(subgraphs.iter().filter(wanted).map(Subgraph::description));
        if let (true, Some(name)) = (found.is_empty(), &self.of_graph) {
            let help = crate::graph::nearest(name, subgraphs.iter().map(|it| &it.name[..]));
            return Exit::Usage(format!("{} uses no graph `{name}`; {help}", path.display()));
        }
        self.print(&found);
        if found.is_empty() && !self.json && problems.is_empty() {
            print(&format!("{} uses no other graph\n", path.display()));
        }
        if problems.is_empty() { Exit::Done } else { Exit::Failed }
    }
}

/// One line a node, by packs.
fn list(catalog: &Catalog) -> String {
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
    text + "\n`maquette nodes NODE` prints one in full.\n"
}

fn doc(schema: &Json) -> &str {
    schema.get("description").and_then(Json::as_str).unwrap_or_default()
}

/// Everything that is known of a node.
fn in_full(entry: &Description<'_>) -> String {
    let schema = entry.schema;
    let mut text = format!("{} ({})\n\n{}\n", entry.name, entry.pack, indent(doc(schema), 0));
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
    }
    let fields = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
    let parameters: Vec<_> =
        fields.filter(|(name, _)| ports.iter().all(|port| port.name != **name)).collect();
    if !parameters.is_empty() {
        text += "\nParameters\n";
    }
    for (name, field) in parameters {
        let choices = describe_choices(field, schema);
        let default = describe_default(field);
        let kind = match choices.is_empty() {
            true => describe_parameter(field, schema),
            false => "one of".into(),
        };
        let _ = writeln!(text, "  {name}: {kind}{default}\n{}", indent(doc(field), 6));
        for (choice, doc) in choices {
            let _ = writeln!(text, "    {choice}\n{}", indent(&doc, 8));
        }
    }
    text += "\nOutputs\n";
    for (name, types) in &entry.outputs {
        let same = if types.len() > 1 { " (the type that came in)" } else { "" };
        let _ = writeln!(text, "  {name}: {}{same}", any_of(types.iter().copied()));
    }
    text
}

fn indent(text: &str, by: usize) -> String {
    let lines = text.lines().map(|line| format!("{:by$}{line}", ""));
    Vec::from_iter(lines).join("\n")
}
