//! The graphs that a file uses, and the inputs that it declares.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Span, Use, code};
use maquette_syntax::paths::{PathProblem, may_read, without_dots};
use maquette_syntax::{Body, Kind, Name, Tree, nearest, nearest_or_all};
use maquette_value::ValueType;
use serde_json::{Map, Value as Json, json};

use crate::check::Check;
use crate::definition::{Definition, Draft, Used, Wants};
use crate::top::TopLevel;
use crate::version::Wanted;
use crate::world::{Entered, deeper};

/// The fields of an input's declaration.
pub(crate) const INPUT_FIELDS: [&str; 2] = ["doc", "wants"];

/// Graphs that use each other are nested less deep than this: far deeper than anybody can follow.
pub(crate) const DEEPEST: usize = 256;

/// The file of a graph that another one names.
pub(crate) struct FoundGraph {
    pub(crate) path: PathBuf,
    /// The same without links and dots.
    pub(crate) real: PathBuf,
    /// The path for messages: relative to what the first graph's is relative to.
    pub(crate) name: PathBuf,
}

impl<'a> Check<'_, 'a> {
    /// Reads the graphs that this one uses.
    pub(crate) fn subgraphs(&mut self, top: &TopLevel<'_>) -> Vec<Used> {
        let mut subgraphs: Vec<Used> = Vec::with_capacity(top.uses.len());
        for (key, value) in top.uses {
            let Some(name) = key.text().filter(|name| is_type_name(name)) else {
                let message = format!("{} cannot name a type of nodes", key.in_words());
                let help = "such names begin with a capital letter: \"Feature\"";
                self.find(code::BAD_NAME, key.span, message, help);
                continue;
            };
            let is_word = matches!(name, "ForEach" | "Switch" | "Graph" | "Patch");
            let is_taken = is_word || self.world.catalog.has(name);
            if is_taken || subgraphs.iter().any(|known| known.name == name) {
                let message = format!("there is already a node type `{name}`");
                self.find(code::BAD_NAME, key.span, message, "give it another name");
                continue;
            }
            let at = first_use(top, name).unwrap_or((name, key.span));
            let wanted = self.wanted(name, value);
            let definition = wanted.as_ref().and_then(|it| self.subgraph(it.path, it.span, at));
            if let Some(Wanted { path, version: Some(wanted), .. }) = &wanted
                && let Some(found) = &definition
            {
                self.must_fit(name, path, wanted, found);
            }
            if let Some(definition) = &definition {
                let listed = (self.world.open.len(), name.to_owned(), definition.clone());
                self.world.listed.push(listed);
            }
            subgraphs.push(Used { name: name.to_owned(), definition });
        }
        subgraphs
    }

    /// The graph in the file `given`, which the node `at` is the first to use.
    fn subgraph(&mut self, given: &str, span: Span, at: (&str, Span)) -> Option<Arc<Definition>> {
        let FoundGraph { path, real, name } = self.enter(given, span)?;
        if let Some(known) = self.world.known.get(&real) {
            return known.clone();
        }
        let mut uses = self.uses.clone();
        let (source, place) = self.sheet.place(at.1);
        uses.push(Use { name: at.0.to_owned(), source, span: place });
        self.world.open.push((real.clone(), name.clone()));
        let world = &mut *self.world;
        let depth = world.open.len();
        let definition = deeper(depth, move || crate::load::definition(world, &path, name, uses));
        self.world.open.pop();
        self.world.known.insert(real, definition.clone());
        definition
    }

    /// The file of another graph, if it may be read now: not while it is being read.
    pub(crate) fn enter(&mut self, given: &str, span: Span) -> Option<FoundGraph> {
        let folder = self.sheet.folder_of(span);
        let path = folder.join(given);
        // That of a file that is still to be written may not be there, and nothing is found through it.
        let path = if folder.is_dir() { path } else { without_dots(&path) };
        self.world.subgraphs.push(path.clone());
        fn is_there(problem: &PathProblem, path: &Path, world_options: &crate::Options) -> bool {
            matches!(problem, PathProblem::Missing { .. }) && world_options.has_text(path)
        }
        let readable = may_read(given, &path, &self.world.roots);
        if let Err(problem) = readable.or_else(|problem| {
            if is_there(&problem, &path, self.world.options) { Ok(()) } else { Err(problem) }
        }) {
            let (code, message, help) = match problem {
                PathProblem::Outside { message, help } => (code::OUTSIDE, message, help),
                PathProblem::Missing { message, help } => (code::MISSING_FILE, message, help),
            };
            self.find(code, span, message, help);
            return None;
        }
        let real = std::fs::canonicalize(&path).unwrap_or_else(|_| without_dots(&path));
        let (source, _) = self.sheet.place(span);
        let name = without_dots_within(&source.name.with_file_name(""), given);
        if let Some(first) = self.world.open.iter().position(|(open, _)| *open == real) {
            let names = self.world.open[first..].iter().map(|(_, name)| name);
            let around = names.chain([&name]).map(|name| name.display().to_string());
            let path = Vec::from_iter(around).join(" -> ");
            let message = format!("graphs use each other in a circle: {path}");
            self.find(code::CYCLE, span, message, "a graph cannot be a part of itself");
            return None;
        }
        if self.world.open.len() >= DEEPEST {
            let message = format!("graphs are nested more than {DEEPEST} deep here");
            self.find(code::CYCLE, span, message, "use the inner ones side by side");
            return None;
        }
        let (source, span) = self.sheet.place(span);
        let uses = self.uses.clone();
        self.world.entered.push(Entered {
            path: path.clone(),
            real: real.clone(),
            source,
            span,
            uses,
        });
        Some(FoundGraph { path, real, name })
    }

    /// The inputs that a graph declares, as drafts of nodes that give them.
    pub(crate) fn inputs(
        &mut self,
        entries: &[(Tree, Tree)],
    ) -> (Vec<Draft>, Map<String, Json>, Vec<Wants>) {
        let (mut drafts, mut schema, mut all_wants) = (Vec::new(), Map::new(), Vec::new());
        for (key, value) in self.named(entries, "input", &[]) {
            let name = key.text().unwrap_or_default();
            let optional = value.call_of("Optional");
            let value = optional.unwrap_or(value);
            let kind = self.input(name, value);
            let fields = value.fields().unwrap_or_default().iter();
            let wants = fields.filter(|field| field.name.text == "wants");
            let wants: Vec<_> =
                wants.flat_map(|field| self.properties(&field.value, kind)).collect();
            let key = Name { text: name.to_owned(), span: key.span };
            drafts.push(Draft::input(key, value.clone(), kind, optional.is_some()));
            let doc = value.fields().unwrap_or_default().iter();
            let doc = doc.filter(|field| field.name.text == "doc").find_map(|f| f.value.text());
            // A port of which nothing is known takes nothing; what is linked to it is not judged either.
            let kind = kind.map_or("", |kind| kind.name);
            let doc = doc.unwrap_or_default();
            let mut port = json!({ "port": kind, "types": [kind], "description": doc });
            if !wants.is_empty() {
                port["wants"] = wants.iter().map(|&(property, _)| property).collect();
            }
            schema.insert(name.to_owned(), port);
            all_wants.push(wants);
        }
        (drafts, schema, all_wants)
    }

    fn input(&mut self, name: &str, value: &Tree) -> Option<&'static ValueType> {
        let Some(kind) = value.name() else {
            let message = format!("input `{name}` has no type, but is {}", value.in_words());
            self.find(code::WRONG_VALUE, value.span, message, "write Mesh(doc: \"what it is\")");
            return None;
        };
        for field in value.fields().unwrap_or_default() {
            let word = &field.name.text;
            if !INPUT_FIELDS.contains(&&word[..]) {
                let message = format!("an input has no field `{word}`");
                let help = nearest_or_all(word, "its fields", &INPUT_FIELDS);
                self.find(code::UNKNOWN_FIELD, field.name.span, message, help);
            } else if word == "doc" && field.value.text().is_none() && !field.value.is_broken() {
                let message =
                    format!("field `doc` of an input is a text, not {}", field.value.in_words());
                self.find(code::WRONG_VALUE, field.value.span, message, "");
            }
        }
        if let Kind::Call { body: Body::Items(_), .. } = value.kind {
            let message = format!("input `{name}` has a value without a name");
            self.find(code::WRONG_VALUE, value.span, message, "write Mesh(doc: \"what it is\")");
        }
        let found = self.world.values.get(&kind.text[..]).copied();
        if found.is_none() {
            let message = format!("there is no type of values `{}`", kind.text);
            let known: Vec<_> = self.world.values.keys().copied().collect();
            let help = match nearest(&kind.text, known.iter().copied()) {
                help if help.is_empty() => format!("types: {}", known.join(", ")).into(),
                help => help,
            };
            self.find(code::WRONG_VALUE, kind.span, message, help);
        }
        found
    }
}

/// The first node of this type, and its place.
pub(crate) fn first_use<'t>(top: &TopLevel<'t>, name: &str) -> Option<(&'t str, Span)> {
    let (key, _) = top.nodes.iter().find(|node| {
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

/// Whether a word can name a type of nodes.
pub fn is_type_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_uppercase())
        && word.chars().all(|c| c.is_ascii_alphanumeric())
}

/// A path from a folder on, without more dots than the folder itself has.
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
