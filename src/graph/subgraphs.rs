//! Reads the files of the graphs that a graph uses, and the inputs that the graph declares.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Span, Use, code};
use maquette_syntax::paths::{PathError, may_read, without_dots};
use maquette_syntax::{Body, Kind, Name, Tree, nearest, nearest_or_all};
use maquette_value::ValueType;
use serde_json::{Map, Value as Json, json};

use crate::check::Check;
use crate::definition::{Definition, ParsedNode, UsedGraph, Wants};
use crate::header::Header;
use crate::version::UseEntry;
use crate::world::{GraphReference, with_enough_stack};

/// The names of the fields in the declaration of an input.
pub(crate) const INPUT_FIELDS: [&str; 2] = ["doc", "wants"];

/// Maximum nesting depth of used graphs: a graph uses a graph that uses a graph, and so on.
pub(crate) const MAX_NESTING: usize = 256;

/// The file of a graph to which another graph refers.
pub(crate) struct FoundGraph {
    pub(crate) path: PathBuf,
    /// The path without symbolic links and without `.` and `..`.
    pub(crate) canonical_path: PathBuf,
    /// The path for messages, relative to the same folder as the path of the root graph.
    pub(crate) name: PathBuf,
}

impl<'a> Check<'_, 'a> {
    /// Reads the graphs in the section `use` of this graph.
    pub(crate) fn subgraphs(&mut self, header: &Header<'_>) -> Vec<UsedGraph> {
        let mut subgraphs: Vec<UsedGraph> = Vec::with_capacity(header.uses.len());
        for (key, value) in header.uses {
            let Some(name) = key.text().filter(|name| is_type_name(name)) else {
                let message = format!("{} cannot be the name of a node type", key.describe());
                let help = "use a name that begins with a capital letter: \"Feature\"";
                self.report(code::BAD_NAME, key.span, message, help);
                continue;
            };
            let is_word = matches!(name, "ForEach" | "Switch" | "Graph" | "Patch");
            let is_taken = is_word || self.world.catalog.has(name);
            if is_taken || subgraphs.iter().any(|known| known.name == name) {
                let message = format!("there is already a node type `{name}`");
                self.report(code::BAD_NAME, key.span, message, "give it another name");
                continue;
            }
            let at = first_use(header, name).unwrap_or((name, key.span));
            let wanted = self.read_use(name, value);
            let definition = wanted.as_ref().and_then(|it| self.subgraph(it.path, it.span, at));
            if let Some(UseEntry { path, version: Some(wanted), .. }) = &wanted
                && let Some(found) = &definition
            {
                self.check_version(name, path, wanted, found);
            }
            if let Some(definition) = &definition {
                let listed = (self.world.open_files.len(), name.to_owned(), definition.clone());
                self.world.node_types.push(listed);
            }
            subgraphs.push(UsedGraph { name: name.to_owned(), definition });
        }
        subgraphs
    }

    /// Reads the graph in the file `given`. `at` is the first node that uses the graph.
    fn subgraph(&mut self, given: &str, span: Span, at: (&str, Span)) -> Option<Arc<Definition>> {
        let FoundGraph { path, canonical_path: real, name } = self.enter(given, span)?;
        if let Some(known) = self.world.known.get(&real) {
            return known.clone();
        }
        let mut uses = self.uses.clone();
        let (source, place) = self.source_map.locate(at.1);
        uses.push(Use { name: at.0.to_owned(), source, span: place });
        self.world.open_files.push((real.clone(), name.clone()));
        let world = &mut *self.world;
        let depth = world.open_files.len();
        let definition = with_enough_stack(depth, move || {
            crate::load::load_definition(world, &path, name, uses)
        });
        self.world.open_files.pop();
        self.world.known.insert(real, definition.clone());
        definition
    }

    /// Resolves the path of another graph's file. Reports cycles, and files that the graph may not read.
    pub(crate) fn enter(&mut self, given: &str, span: Span) -> Option<FoundGraph> {
        let folder = self.source_map.folder_of(span);
        let path = folder.join(given);
        // A new graph may be in a folder that does not exist yet, whose symbolic links cannot be resolved.
        let path = if folder.is_dir() { path } else { without_dots(&path) };
        self.world.subgraphs.push(path.clone());
        let access = match may_read(given, &path, &self.world.roots) {
            Err(PathError::Missing { .. }) if self.world.options.has_text(&path) => Ok(()),
            access => access,
        };
        if let Err(error) = access {
            let (code, message, help) = match error {
                PathError::Outside { message, help } => (code::OUTSIDE, message, help),
                PathError::Missing { message, help } => (code::MISSING_FILE, message, help),
            };
            self.report(code, span, message, help);
            return None;
        }
        let real = std::fs::canonicalize(&path).unwrap_or_else(|_| without_dots(&path));
        let (source, _) = self.source_map.locate(span);
        let name = without_dots_within(&source.name.with_file_name(""), given);
        if let Some(first) = self.world.open_files.iter().position(|(open, _)| *open == real) {
            let names = self.world.open_files[first..].iter().map(|(_, name)| name);
            let around = names.chain([&name]).map(|name| name.display().to_string());
            let path = Vec::from_iter(around).join(" -> ");
            let message = format!("cycle of graphs: {path}");
            self.report(code::CYCLE, span, message, "a graph cannot be a part of itself");
            return None;
        }
        if self.world.open_files.len() >= MAX_NESTING {
            let message = format!("graphs are nested more than {MAX_NESTING} deep here");
            self.report(code::CYCLE, span, message, "use the inner graphs side by side");
            return None;
        }
        let (source, span) = self.source_map.locate(span);
        let uses = self.uses.clone();
        self.world.references.push(GraphReference {
            path: path.clone(),
            canonical_path: real.clone(),
            source,
            span,
            uses,
        });
        Some(FoundGraph { path, canonical_path: real, name })
    }

    /// Reads the declared inputs of a graph as parsed nodes.
    pub(crate) fn inputs(
        &mut self,
        entries: &[(Tree, Tree)],
    ) -> (Vec<ParsedNode>, Map<String, Json>, Vec<Wants>) {
        let (mut parsed_nodes, mut schema, mut all_wants) = (Vec::new(), Map::new(), Vec::new());
        for (key, value) in self.named_entries(entries, "input", &[]) {
            let name = key.text().unwrap_or_default();
            let optional = value.call_of("Optional");
            let value = optional.unwrap_or(value);
            let kind = self.input(name, value);
            let fields = value.fields().unwrap_or_default().iter();
            let wants = fields.filter(|field| field.name.text == "wants");
            let wants: Vec<_> =
                wants.flat_map(|field| self.properties(&field.value, kind)).collect();
            let key = Name { text: name.to_owned(), span: key.span };
            parsed_nodes.push(ParsedNode::input(key, value.clone(), kind, optional.is_some()));
            let doc = value.fields().unwrap_or_default().iter();
            let doc = doc.filter(|field| field.name.text == "doc").find_map(|f| f.value.text());
            // If the type is unknown, its name is empty. No type has this name, but links to such a port are not checked.
            let kind = kind.map_or("", |kind| kind.name);
            let doc = doc.unwrap_or_default();
            let mut port = json!({ "port": kind, "types": [kind], "description": doc });
            if !wants.is_empty() {
                port["wants"] = wants.iter().map(|&(property, _)| property).collect();
            }
            schema.insert(name.to_owned(), port);
            all_wants.push(wants);
        }
        (parsed_nodes, schema, all_wants)
    }

    fn input(&mut self, name: &str, value: &Tree) -> Option<&'static ValueType> {
        let Some(kind) = value.name() else {
            let message = format!("input `{name}` has no type, but is {}", value.describe());
            self.report(code::WRONG_VALUE, value.span, message, "write Mesh(doc: \"what it is\")");
            return None;
        };
        for field in value.fields().unwrap_or_default() {
            let word = &field.name.text;
            if !INPUT_FIELDS.contains(&&word[..]) {
                let message = format!("an input has no field `{word}`");
                let help = nearest_or_all(word, "its fields", &INPUT_FIELDS);
                self.report(code::UNKNOWN_FIELD, field.name.span, message, help);
            } else if word == "doc" && field.value.text().is_none() && !field.value.is_broken() {
                let message =
                    format!("field `doc` of an input is a text, not {}", field.value.describe());
                self.report(code::WRONG_VALUE, field.value.span, message, "");
            }
        }
        if let Kind::Call { body: Body::Items(_), .. } = value.kind {
            let message = format!("input `{name}` has a value without a name");
            self.report(code::WRONG_VALUE, value.span, message, "write Mesh(doc: \"what it is\")");
        }
        let found = self.world.values.get(&kind.text[..]).copied();
        if found.is_none() {
            let message = format!("there is no type of values `{}`", kind.text);
            let known: Vec<_> = self.world.values.keys().copied().collect();
            let help = match nearest(&kind.text, known.iter().copied()) {
                help if help.is_empty() => format!("types: {}", known.join(", ")).into(),
                help => help,
            };
            self.report(code::WRONG_VALUE, kind.span, message, help);
        }
        found
    }
}

/// Returns the name of the first node of this type, and the position of that name.
pub(crate) fn first_use<'t>(header: &Header<'t>, name: &str) -> Option<(&'t str, Span)> {
    let (key, _) = header.nodes.iter().find(|node| {
        let kind = node.1.name();
        kind.as_ref().is_some_and(|kind| kind.text == name)
            || kind.is_some_and(|kind| kind.text == "ForEach")
                && node.1.fields().is_some_and(|fields| {
                    fields
                        .iter()
                        .any(|field| field.name.text == "graph" && field.value.text() == Some(name))
                })
    })?;
    Some((key.text()?, key.span))
}

/// Returns true if a word can be the name of a node type.
pub fn is_type_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_uppercase())
        && word.chars().all(|c| c.is_ascii_alphanumeric())
}

/// Joins a path to a folder, and removes `.` and `..` from the result.
pub(crate) fn without_dots_within(folder: &Path, given: &str) -> PathBuf {
    let mut path = folder.to_owned();
    for part in Path::new(given).components() {
        match part {
            std::path::Component::CurDir => {}
            std::path::Component::ParentDir if path.file_name().is_some() => {
                path.pop();
            }
            part => path.push(part),
        }
    }
    path
}
