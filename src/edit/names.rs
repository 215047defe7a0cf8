//! Finds all names in the text of a graph, a patch, a test or a sweep, and the declaration to which each name refers. The declaration may
//! be in another file.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::canonical::node_of_link;
use maquette_graph::catalog::Catalog;
use maquette_graph::definition::{Definition, ParsedFile};
use maquette_graph::expectation::Expectation;
use maquette_graph::expression::named_parameters;
use maquette_graph::header::name_of;
use maquette_graph::load::check_file;
use maquette_graph::options::folder_of;
use maquette_graph::tree::entries;
use maquette_graph::{Files, Options};
use maquette_syntax::error::Span;
use maquette_syntax::{Body, Field, Kind, Name, Tree, parse};

use super::{Reference, ReferenceKind, References};

/// The declaration of a named part of a graph, such as a node or a parameter.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Symbol {
    /// The file that contains the declaration, as a path without symbolic links and without `.` and `..`.
    pub file: PathBuf,
    pub sort: SymbolSort,
    pub name: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SymbolSort {
    /// A node or an input.
    Node,
    Parameter,
    Output,
    /// A node type that the section `use` declares for another graph.
    Type,
}

/// An occurrence of a name in a text, and the declaration to which the name refers.
#[derive(Clone, Debug, PartialEq)]
pub struct NameOccurrence {
    /// The span of the name itself, without quotes and without other text in the same literal.
    pub span: Span,
    pub symbol: Symbol,
    /// True if the occurrence is the declaration itself.
    pub is_declaration: bool,
    /// True if the name is used as the name of a field, in which underscores replace hyphens.
    pub is_field: bool,
}

/// The names in a file, and the files of the graphs that the file uses. Paths contain no symbolic links and no `.` or `..`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FileNames {
    /// The occurrences of names, ordered by position.
    pub all: Vec<NameOccurrence>,
    /// For each node type that the section `use` declares, the file of its graph.
    pub types: HashMap<String, PathBuf>,
}

/// Returns the names in the text of a graph or a patch. Empty if the text cannot be parsed.
pub fn names_in(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> FileNames {
    let Some((known, ParsedFile { definition, .. })) =
        KnownNames::load(path, text, catalog, options)
    else {
        return FileNames::default();
    };
    let mut search = Search { text, found: Vec::new() };
    match definition.is_patched() {
        true => search.patch(parse(text).0.fields().unwrap_or_default(), &known),
        false => {
            let fields = definition.tree.fields().unwrap_or_default();
            search.graph(fields, &known, &References::of_definition(&definition));
        }
    }
    search.found.sort_by_key(|found| found.span);
    search.found.dedup();
    let types = known.types.iter().map(|(name, inner)| (name.clone(), inner.file.clone()));
    FileNames { types: types.collect(), all: search.found }
}

/// Returns the names in the text of a test. `graphs` are the files of the tested graphs.
pub fn names_in_test(
    text: &str,
    graphs: &[PathBuf],
    catalog: &Catalog,
    options: &Options,
) -> FileNames {
    let (tree, _) = parse(text);
    let mut search = Search { text, found: Vec::new() };
    for path in graphs {
        let Ok(graph) = options.text(path) else { continue };
        let Some((known, _)) = KnownNames::load(path, &graph, catalog, options) else { continue };
        search.test(tree.fields().unwrap_or_default(), &known);
    }
    search.found.sort_by(|a, b| (a.span, &a.symbol).cmp(&(b.span, &b.symbol)));
    search.found.dedup();
    FileNames { all: search.found, types: HashMap::new() }
}

/// Returns the names in the text of a sweep. `path` is the path of the sweep, which need not exist.
pub fn names_in_sweep(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> FileNames {
    let (tree, _) = parse(text);
    let fields = tree.fields().unwrap_or_default();
    let named = fields.iter().find(|field| field.name.text == "graph");
    let Some(named) = named.and_then(|field| field.value.text()) else {
        return FileNames::default();
    };
    let graph = folder_of(path).join(named);
    let known = options.text(&graph).ok();
    let known = known.and_then(|text| KnownNames::load(&graph, &text, catalog, options));
    let Some((known, _)) = known else { return FileNames::default() };
    let mut search = Search { text, found: Vec::new() };
    search.sweep(fields, &known);
    search.found.sort_by_key(|found| found.span);
    FileNames { all: search.found, types: HashMap::new() }
}

/// The names that a graph declares and to which other files can refer.
struct UsedGraph {
    file: PathBuf,
    params: Vec<String>,
    inputs: Vec<String>,
}

impl UsedGraph {
    fn from_definition(definition: &Definition) -> Self {
        let inputs = definition.parsed_nodes[..definition.inputs].iter();
        Self {
            file: file_of(definition),
            params: definition.declared.iter().map(|declared| declared.name.clone()).collect(),
            inputs: inputs.map(|parsed| parsed.name.text.clone()).collect(),
        }
    }

    /// Returns the input or parameter of the used graph that corresponds to a field name.
    fn field(&self, field: &str) -> Option<Symbol> {
        let name = name_of(field);
        let sort = match () {
            () if self.inputs.contains(&name) => SymbolSort::Node,
            () if self.params.contains(&name) => SymbolSort::Parameter,
            () => return None,
        };
        Some(Symbol { file: self.file.clone(), sort, name })
    }
}

/// Returns the file of a definition. For a patch, returns the file of the patched graph.
fn file_of(definition: &Definition) -> PathBuf {
    let source_map = &definition.source_map;
    let (folder, source) = match source_map.parts.first() {
        Some(first) => (&first.folder, &first.source),
        None => (&source_map.folder, &source_map.source),
    };
    folder.join(source.name.file_name().unwrap_or_default())
}

/// The names that a graph declares, and those that its used graphs declare.
struct KnownNames {
    own: UsedGraph,
    nodes: Vec<String>,
    outputs: Vec<String>,
    types: HashMap<String, Arc<UsedGraph>>,
    /// For each node that uses a graph, that graph.
    uses: HashMap<String, Arc<UsedGraph>>,
    /// The names of the nodes of type `ForEach`.
    repeated: HashSet<String>,
}

impl KnownNames {
    fn load(
        path: &Path,
        text: &str,
        catalog: &Catalog,
        options: &Options,
    ) -> Option<(Self, ParsedFile)> {
        let options = Options { files: Files::Ignored, set: Vec::new(), ..options.clone() };
        let (world, whole) = check_file(path, text.to_owned(), catalog, &options);
        let whole = whole?;
        let definition = &whole.definition;
        let listed = world.node_types.iter().filter(|(depth, ..)| *depth == 1);
        let types = listed
            .map(|(_, name, inner)| (name.clone(), Arc::new(UsedGraph::from_definition(inner))));
        let types: HashMap<_, _> = types.collect();
        let fields = definition.tree.fields().unwrap_or_default();
        let (mut uses, mut repeated) = (HashMap::new(), HashSet::new());
        for (name, call) in entries(fields, "nodes") {
            let inner = kind_of(call).and_then(|kind| types.get(&kind.text));
            uses.extend(inner.map(|inner| (name.to_owned(), inner.clone())));
            repeated.extend(is_for_each(call).then(|| name.to_owned()));
        }
        fn names(section: &str, fields: &[Field]) -> Vec<String> {
            entries(fields, section).map(|(name, _)| name.to_owned()).collect()
        }
        let own = UsedGraph::from_definition(definition);
        let (nodes, outputs) = (names("nodes", fields), names("outputs", fields));
        Some((Self { own, nodes, outputs, types, uses, repeated }, whole))
    }

    fn symbol(&self, sort: SymbolSort, name: &str) -> Symbol {
        Symbol { file: self.own.file.clone(), sort, name: name.to_owned() }
    }

    /// Returns the declaration of the node or input of this name.
    fn node(&self, name: &str) -> Option<Symbol> {
        let known = self.nodes.iter().chain(&self.own.inputs).any(|known| known == name);
        known.then(|| self.symbol(SymbolSort::Node, name))
    }

    /// Resolves the names in a link: the name of a node and, if the node uses a graph, the name of that graph's output.
    fn link(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let node = node_of_link(text);
        let mut found: Vec<_> =
            self.node(node).map(|symbol| (0..node.len(), symbol)).into_iter().collect();
        if let (Some(inner), Some(dot)) = (self.uses.get(node), text.find('.')) {
            let name = text[dot + 1..].to_owned();
            let symbol = Symbol { file: inner.file.clone(), sort: SymbolSort::Output, name };
            found.push((dot + 1..text.len(), symbol));
        }
        found
    }

    /// Resolves the names in the target of a value: `growth` for a parameter, or `node.field`.
    fn value(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        if text.contains('.') {
            return self.node_path(text);
        }
        if self.own.params.iter().any(|known| known == text) {
            return vec![(0..text.len(), self.symbol(SymbolSort::Parameter, text))];
        }
        Vec::new()
    }

    /// Resolves the names in a target `node.field`.
    fn node_path(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let node = node_of_link(text);
        let mut found: Vec<_> =
            self.node(node).map(|symbol| (0..node.len(), symbol)).into_iter().collect();
        if let Some((way, inner)) = self.used_field_path(text).zip(self.uses.get(node)) {
            let (start, field) = (text.len() - way.len(), way.split('.').next().unwrap_or(way));
            found.extend(inner.field(field).map(|symbol| (start..start + field.len(), symbol)));
        }
        found
    }

    /// Returns true if the node in the target `text` is a `ForEach`. A target inside of one element, such as `eyes/1.scale`, does not
    /// count.
    fn is_repeated(&self, text: &str) -> bool {
        self.repeated.contains(text.split('.').next().unwrap_or(text))
    }

    /// Returns the part of the target `node.field` that begins with the name of a field of the used graph. In a `ForEach`, skips the steps
    /// before that field, such as `with` or `over.1`.
    fn used_field_path<'t>(&self, text: &'t str) -> Option<&'t str> {
        let (_, way) = text.split_once('.')?;
        let groups = match way.split('.').next() {
            Some("with" | "links" | "carry") if self.is_repeated(text) => 1,
            Some("over") if self.is_repeated(text) => 2,
            _ => 0,
        };
        Some(way.splitn(groups + 1, '.').nth(groups).unwrap_or(""))
    }

    /// Resolves `text` as the name of an output of the graph.
    fn output(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let known = self.outputs.iter().any(|output| output == text);
        Vec::from_iter(known.then(|| (0..text.len(), self.symbol(SymbolSort::Output, text))))
    }

    /// Resolves the name of a value in an expectation: an output of the graph, or a link.
    fn expected_value(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let output = self.output(text);
        if output.is_empty() { self.link(text) } else { output }
    }
}

fn is_for_each(call: &Tree) -> bool {
    call.name().is_some_and(|name| name.text == "ForEach")
}

/// Returns the type of a node. For a `ForEach`, returns the repeated type.
fn kind_of(call: &Tree) -> Option<Name> {
    let kind = call.name()?;
    if kind.text != "ForEach" {
        return Some(kind);
    }
    let graph = call.fields()?.iter().find(|field| field.name.text == "graph")?;
    Some(Name { text: graph.value.text()?.to_owned(), span: graph.value.span })
}

/// Returns the entries of a section of a file as pairs of key and value.
fn keys<'t>(fields: &'t [Field], section: &str) -> impl Iterator<Item = (&'t Tree, &'t Tree)> {
    let maps = fields.iter().filter(move |field| field.name.text == section);
    maps.flat_map(|field| entries_of(&field.value))
}

fn entries_of(map: &Tree) -> impl Iterator<Item = (&Tree, &Tree)> {
    let entries = match &map.kind {
        Kind::Map(entries) => &entries[..],
        _ => &[],
    };
    entries.iter().map(|(key, value)| (key, value))
}

/// Collects the occurrences of names in a text.
struct Search<'t> {
    text: &'t str,
    found: Vec<NameOccurrence>,
}

impl Search<'_> {
    /// Records the names in a literal. `of` returns the names and their byte ranges in the text of the literal.
    fn record(&mut self, literal: &Tree, of: impl FnOnce(&str) -> Vec<(Range<usize>, Symbol)>) {
        let Some(says) = literal.text() else { return };
        self.record_at(literal.span, says, of(says), false);
    }

    fn declare(&mut self, literal: &Tree, symbol: Symbol) {
        let Some(says) = literal.text() else { return };
        self.record_at(literal.span, says, vec![(0..says.len(), symbol)], true);
    }

    fn record_at(
        &mut self,
        at: Span,
        says: &str,
        named: Vec<(Range<usize>, Symbol)>,
        declares: bool,
    ) {
        // Skip a literal with escapes, because ranges of its text are not ranges of the file.
        let Some(start) = self.text[at.start..at.end].find(says) else { return };
        let start = at.start + start;
        for (range, symbol) in named {
            // A name after a dot is a field or an output.
            let is_field = says[..range.start].ends_with('.') && symbol.sort != SymbolSort::Output;
            let span = Span { start: start + range.start, end: start + range.end };
            self.found.push(NameOccurrence { span, symbol, is_declaration: declares, is_field });
        }
    }

    /// Records the names of the fields of a node that uses the graph `inner`.
    fn fields(&mut self, call: &Tree, inner: &UsedGraph) {
        for Field { name, .. } in call.fields().unwrap_or_default() {
            let symbol = inner.field(&name.text);
            self.found.extend(symbol.map(|symbol| NameOccurrence {
                span: name.span,
                symbol,
                is_declaration: false,
                is_field: true,
            }));
        }
    }

    fn patch(&mut self, fields: &[Field], known: &KnownNames) {
        for (key, _) in keys(fields, "params") {
            self.record(key, |name| known.value(name));
        }
        for (key, value) in keys(fields, "nodes") {
            self.record(key, |name| known.node_path(name));
            let text = key.text().unwrap_or_default();
            let Some(inner) = known.uses.get(node_of_link(text)) else { continue };
            match known.used_field_path(text) {
                None if known.is_repeated(text) => self.for_each_fields(value, inner),
                // The keys of this value are field names of the used graph.
                None | Some("") => self.fields(value, inner),
                Some(_) => {}
            }
        }
    }

    fn graph(&mut self, fields: &[Field], known: &KnownNames, references: &References) {
        use SymbolSort::{Node, Output, Parameter, Type};
        let sections = [
            ("nodes", Node),
            ("inputs", Node),
            ("params", Parameter),
            ("outputs", Output),
            ("use", Type),
        ];
        for (section, sort) in sections {
            for (key, _) in keys(fields, section) {
                let name = key.text().unwrap_or_default();
                self.declare(key, known.symbol(sort, name));
            }
        }
        let params = HashSet::<&str>::from_iter(known.own.params.iter().map(String::as_str));
        for Reference { span, text, kind, .. } in references.iter() {
            let named = match kind {
                ReferenceKind::Link => known.link(text),
                ReferenceKind::Output => vec![(0..text.len(), known.symbol(Output, text))],
                ReferenceKind::Parameter => vec![(0..text.len(), known.symbol(Parameter, text))],
                ReferenceKind::Expression => {
                    let places = named_parameters(text, &|name| params.contains(name));
                    let places = places.unwrap_or_default();
                    places
                        .into_iter()
                        .map(|place: Range<usize>| {
                            let symbol = known.symbol(Parameter, &text[place.clone()]);
                            (place, symbol)
                        })
                        .collect()
                }
            };
            self.record_at(*span, text, named, false);
        }
        for (_, call) in keys(fields, "nodes") {
            let Some((kind, inner)) = kind_of(call).and_then(|kind| {
                let inner = known.types.get(&kind.text)?.clone();
                Some((kind, inner))
            }) else {
                continue;
            };
            let symbol = known.symbol(Type, &kind.text);
            self.record_at(kind.span, &kind.text, vec![(0..kind.text.len(), symbol)], false);
            match is_for_each(call) {
                true => self.for_each_fields(call, &inner),
                false => self.fields(call, &inner),
            }
        }
    }

    /// Records the field names in a `ForEach` whose repeated type is the graph `inner`.
    fn for_each_fields(&mut self, call: &Tree, inner: &UsedGraph) {
        for Field { name, value } in call.fields().unwrap_or_default() {
            match (&name.text[..], &value.kind) {
                ("with" | "links" | "carry", _) => self.fields(value, inner),
                ("over", Kind::List(items)) => {
                    items.iter().for_each(|item| self.fields(item, inner));
                }
                ("each" | "number", _) => self.record(value, |says| {
                    inner
                        .field(says)
                        .map(|symbol| (0..says.len(), symbol))
                        .into_iter()
                        .collect::<Vec<_>>()
                }),
                _ => {}
            }
        }
    }

    fn sweep(&mut self, fields: &[Field], known: &KnownNames) {
        for (key, _) in keys(fields, "set") {
            self.record(key, |says| known.value(says));
        }
        let mut axis_names = HashSet::new();
        for Field { name, value } in fields {
            match &name.text[..] {
                "over" => self.axis(value, known, &mut axis_names),
                "picture" => {
                    let inner = value.fields().unwrap_or_default().iter();
                    let inner = inner.filter(|it| it.name.text == "output").map(|it| &it.value);
                    let outputs = inner.chain([value]);
                    outputs.for_each(|output| self.record(output, |says| known.output(says)));
                }
                _ => {}
            }
        }
        let out = fields.iter().filter(|field| field.name.text == "out");
        for Field { value, .. } in out {
            self.record(value, |says| {
                let braces = says.match_indices('{').filter_map(|(start, _)| {
                    let name = says[start + 1..].split('}').next()?;
                    axis_names.contains(name).then_some((start + 1, name))
                });
                let named = braces.flat_map(|(start, name)| {
                    let there = known.value(name).into_iter();
                    there.map(move |(at, it)| (start + at.start..start + at.end, it))
                });
                named.collect()
            });
        }
    }

    /// Records the names in an axis of a sweep. Targets that the sweep may insert into names of files are added to `axis_names`.
    fn axis(&mut self, axis: &Tree, known: &KnownNames, axis_names: &mut HashSet<String>) {
        let items: &[Tree] = match &axis.kind {
            Kind::Call { body: Body::Items(items), .. } => items,
            _ => &[],
        };
        match (axis.name().as_ref().map(|name| &name.text[..]), items.first()) {
            (Some("Product" | "Zip"), Some(Tree { kind: Kind::List(axes), .. })) => {
                axes.iter().for_each(|axis| self.axis(axis, known, axis_names));
            }
            (Some("Values"), Some(target)) => {
                axis_names.extend(target.text().map(str::to_owned));
                self.record(target, |says| known.value(says));
            }
            (Some("Files"), _) => {
                for Field { name, value } in axis.fields().unwrap_or_default() {
                    match &name.text[..] {
                        "set" => self.record(value, |says| known.value(says)),
                        "input" => self.record(value, |says| {
                            known
                                .node(says)
                                .map(|it| (0..says.len(), it))
                                .into_iter()
                                .collect::<Vec<_>>()
                        }),
                        "beside" => {
                            entries_of(value).for_each(|(key, _)| {
                                self.record(key, |says| known.value(says));
                            });
                        }
                        _ => {}
                    }
                }
            }
            _ => {}
        }
    }

    fn test(&mut self, fields: &[Field], known: &KnownNames) {
        for (_, case) in keys(fields, "cases") {
            for field in case.fields().unwrap_or_default() {
                for (key, _) in entries_of(&field.value) {
                    match &field.name.text[..] {
                        "set" => self.record(key, |says| known.value(says)),
                        "inputs" => self.record(key, |says| {
                            known
                                .node(says)
                                .map(|symbol| (0..says.len(), symbol))
                                .into_iter()
                                .collect::<Vec<_>>()
                        }),
                        _ => {}
                    }
                }
            }
        }
        for (key, _) in keys(fields, "compare") {
            self.record(key, |says| known.output(says));
        }
        let expect = fields.iter().filter(|field| field.name.text == "expect");
        for text in expect.flat_map(|field| Expectation::value_texts(&field.value)) {
            self.record(text, |says| known.expected_value(says));
        }
    }
}

/// Returns a path without symbolic links and without `.` and `..`. The file need not exist.
pub fn resolve_path(path: &Path) -> PathBuf {
    folder_of(path).join(path.file_name().unwrap_or_default())
}
