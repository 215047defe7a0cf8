//! Every name in the text of a graph, a patch, a test or a sweep, and what it names, there or in another file.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::definition::{Definition, Whole};
use maquette_graph::expectation::Expectation;
use maquette_graph::expression::named_parameters;
use maquette_graph::load::first;
use maquette_graph::meaning::named_node;
use maquette_graph::options::folder_of;
use maquette_graph::top::name_of;
use maquette_graph::tree::entries;
use maquette_graph::{Files, Options};
use maquette_syntax::error::Span;
use maquette_syntax::{Body, Field, Kind, Name, Tree, parse};

use super::{Names, Reference, References};

/// What has a name of its author.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Symbol {
    /// The file that declares it, without links and dots.
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
    /// A type of nodes that `use` makes of a graph.
    Type,
}

/// A name in a text.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Where it stands, without quotes and what stands beside it.
    pub span: Span,
    pub symbol: Symbol,
    /// Whether it is the place that declares it.
    pub declares: bool,
    /// Whether it is written as a field.
    pub is_field: bool,
}

/// The names in a file, and the files of graphs that it names, without links and dots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamesOf {
    /// In the order of their places.
    pub all: Vec<Named>,
    /// The graph of each type of nodes that `use` makes.
    pub types: HashMap<String, PathBuf>,
}

/// The names in the text of a graph or a patch; none if it cannot be read.
pub fn names_in(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> NamesOf {
    let Some((known, Whole { definition, .. })) = Known::of(path, text, catalog, options) else {
        return NamesOf::default();
    };
    let mut search = Search { text, found: Vec::new() };
    match definition.is_patched() {
        true => search.patch(parse(text).0.fields().unwrap_or_default(), &known),
        false => {
            let fields = definition.tree.fields().unwrap_or_default();
            search.graph(fields, &known, &References::within(&definition));
        }
    }
    search.found.sort_by_key(|found| found.span);
    search.found.dedup();
    let types = known.types.iter().map(|(name, inner)| (name.clone(), inner.file.clone()));
    NamesOf { types: types.collect(), all: search.found }
}

/// The names in the text of a test of these graphs.
pub fn names_in_test(
    text: &str,
    graphs: &[PathBuf],
    catalog: &Catalog,
    options: &Options,
) -> NamesOf {
    let (tree, _) = parse(text);
    let mut search = Search { text, found: Vec::new() };
    for path in graphs {
        let Ok(graph) = options.text(path) else { continue };
        let Some((known, _)) = Known::of(path, &graph, catalog, options) else { continue };
        search.test(tree.fields().unwrap_or_default(), &known);
    }
    search.found.sort_by(|a, b| (a.span, &a.symbol).cmp(&(b.span, &b.symbol)));
    search.found.dedup();
    NamesOf { all: search.found, types: HashMap::new() }
}

/// The names in the text of a sweep that stands, or will stand, in this file.
pub fn names_in_sweep(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> NamesOf {
    let (tree, _) = parse(text);
    let fields = tree.fields().unwrap_or_default();
    let named = fields.iter().find(|field| field.name.text == "graph");
    let Some(named) = named.and_then(|field| field.value.text()) else {
        return NamesOf::default();
    };
    let graph = folder_of(path).join(named);
    let known = options.text(&graph).ok();
    let known = known.and_then(|text| Known::of(&graph, &text, catalog, options));
    let Some((known, _)) = known else { return NamesOf::default() };
    let mut search = Search { text, found: Vec::new() };
    search.sweep(fields, &known);
    search.found.sort_by_key(|found| found.span);
    NamesOf { all: search.found, types: HashMap::new() }
}

/// What a graph declares, for who names it from outside.
struct Inner {
    file: PathBuf,
    params: Vec<String>,
    inputs: Vec<String>,
}

impl Inner {
    fn of(definition: &Definition) -> Self {
        let inputs = definition.drafts[..definition.inputs].iter();
        Self {
            file: file_of(definition),
            params: definition.declared.iter().map(|declared| declared.name.clone()).collect(),
            inputs: inputs.map(|draft| draft.name.text.clone()).collect(),
        }
    }

    /// The input or parameter that a field stands for.
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

/// The file of a definition; of what a patch makes, that of the graph.
fn file_of(definition: &Definition) -> PathBuf {
    let sheet = &definition.sheet;
    let (folder, source) = match sheet.parts.first() {
        Some(first) => (&first.folder, &first.source),
        None => (&sheet.folder, &sheet.source),
    };
    folder.join(source.name.file_name().unwrap_or_default())
}

/// What a graph declares, and what the graphs do that its nodes use.
struct Known {
    own: Inner,
    nodes: Vec<String>,
    outputs: Vec<String>,
    types: HashMap<String, Arc<Inner>>,
    /// The graph that a node uses.
    uses: HashMap<String, Arc<Inner>>,
    /// Those that are a `ForEach`.
    repeated: HashSet<String>,
}

impl Known {
    fn of(path: &Path, text: &str, catalog: &Catalog, options: &Options) -> Option<(Self, Whole)> {
        let options = Options { files: Files::Ignored, set: Vec::new(), ..options.clone() };
        let (world, whole) = first(path, text.to_owned(), catalog, &options);
        let whole = whole?;
        let definition = &whole.definition;
        let listed = world.listed.iter().filter(|(depth, ..)| *depth == 1);
        let types = listed.map(|(_, name, inner)| (name.clone(), Arc::new(Inner::of(inner))));
        let types: HashMap<_, _> = types.collect();
        let fields = definition.tree.fields().unwrap_or_default();
        let (mut uses, mut repeated) = (HashMap::new(), HashSet::new());
        for (name, call) in entries(fields, "nodes") {
            let inner = kind_of(call).and_then(|kind| types.get(&kind.text));
            uses.extend(inner.map(|inner| (name.to_owned(), inner.clone())));
            repeated.extend(is_each(call).then(|| name.to_owned()));
        }
        fn names(section: &str, fields: &[Field]) -> Vec<String> {
            entries(fields, section).map(|(name, _)| name.to_owned()).collect()
        }
        let own = Inner::of(definition);
        let (nodes, outputs) = (names("nodes", fields), names("outputs", fields));
        Some((Self { own, nodes, outputs, types, uses, repeated }, whole))
    }

    fn symbol(&self, sort: SymbolSort, name: &str) -> Symbol {
        Symbol { file: self.own.file.clone(), sort, name: name.to_owned() }
    }

    /// A node or an input.
    fn node(&self, name: &str) -> Option<Symbol> {
        let known = self.nodes.iter().chain(&self.own.inputs).any(|known| known == name);
        known.then(|| self.symbol(SymbolSort::Node, name))
    }

    /// What a link names: a node, and an output of the graph that it uses.
    fn link(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let node = named_node(text);
        let mut found: Vec<_> =
            self.node(node).map(|symbol| (0..node.len(), symbol)).into_iter().collect();
        if let (Some(inner), Some(dot)) = (self.uses.get(node), text.find('.')) {
            let name = text[dot + 1..].to_owned();
            let symbol = Symbol { file: inner.file.clone(), sort: SymbolSort::Output, name };
            found.push((dot + 1..text.len(), symbol));
        }
        found
    }

    /// What a name of a value names: `growth`, or `node.field`.
    fn value(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        if text.contains('.') {
            return self.way(text);
        }
        let known = self.own.params.iter().any(|known| known == text);
        let symbol = || self.symbol(SymbolSort::Parameter, text);
        Vec::from_iter(known.then(|| (0..text.len(), symbol())))
    }

    /// What `node.field` names.
    fn way(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let node = named_node(text);
        let mut found: Vec<_> =
            self.node(node).map(|symbol| (0..node.len(), symbol)).into_iter().collect();
        if let Some((way, inner)) = self.behind(text).zip(self.uses.get(node)) {
            let (start, field) = (text.len() - way.len(), way.split('.').next().unwrap_or(way));
            found.extend(inner.field(field).map(|symbol| (start..start + field.len(), symbol)));
        }
        found
    }

    /// Whether `node` is a `ForEach` as a whole, and not one of its elements.
    fn is_repeated(&self, text: &str) -> bool {
        self.repeated.contains(text.split('.').next().unwrap_or(text))
    }

    /// What stands in `node.field` from the name of a field of the used graph on: `with` and `over.1` of a `ForEach` come before it.
    fn behind<'t>(&self, text: &'t str) -> Option<&'t str> {
        let (_, way) = text.split_once('.')?;
        let groups = match way.split('.').next() {
            Some("with" | "links" | "carry") if self.is_repeated(text) => 1,
            Some("over") if self.is_repeated(text) => 2,
            _ => 0,
        };
        Some(way.splitn(groups + 1, '.').nth(groups).unwrap_or(""))
    }

    /// An output.
    fn output(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let known = self.outputs.iter().any(|output| output == text);
        Vec::from_iter(known.then(|| (0..text.len(), self.symbol(SymbolSort::Output, text))))
    }

    /// What an expectation speaks of.
    fn expected(&self, text: &str) -> Vec<(Range<usize>, Symbol)> {
        let output = self.output(text);
        if output.is_empty() { self.link(text) } else { output }
    }
}

fn is_each(call: &Tree) -> bool {
    call.name().is_some_and(|name| name.text == "ForEach")
}

/// The type of a node; of a `ForEach`, that of its nodes.
fn kind_of(call: &Tree) -> Option<Name> {
    let kind = call.name()?;
    if kind.text != "ForEach" {
        return Some(kind);
    }
    let graph = call.fields()?.iter().find(|field| field.name.text == "graph")?;
    Some(Name { text: graph.value.text()?.to_owned(), span: graph.value.span })
}

/// The keys of a section with their values.
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

/// Collects the names in a text.
struct Search<'t> {
    text: &'t str,
    found: Vec<Named>,
}

impl Search<'_> {
    /// Puts what a literal names, by ranges of what it says.
    fn put(&mut self, literal: &Tree, of: impl FnOnce(&str) -> Vec<(Range<usize>, Symbol)>) {
        let Some(says) = literal.text() else { return };
        self.put_at(literal.span, says, of(says), false);
    }

    fn declare(&mut self, literal: &Tree, symbol: Symbol) {
        let Some(says) = literal.text() else { return };
        self.put_at(literal.span, says, vec![(0..says.len(), symbol)], true);
    }

    fn put_at(&mut self, at: Span, says: &str, named: Vec<(Range<usize>, Symbol)>, declares: bool) {
        // What is written with escapes is no name.
        let Some(start) = self.text[at.start..at.end].find(says) else { return };
        let start = at.start + start;
        for (range, symbol) in named {
            // Behind a dot stands a field, or an output.
            let is_field = says[..range.start].ends_with('.') && symbol.sort != SymbolSort::Output;
            let span = Span { start: start + range.start, end: start + range.end };
            self.found.push(Named { span, symbol, declares, is_field });
        }
    }

    /// The fields of a call of a used graph.
    fn fields(&mut self, call: &Tree, inner: &Inner) {
        for Field { name, .. } in call.fields().unwrap_or_default() {
            let symbol = inner.field(&name.text);
            self.found.extend(symbol.map(|symbol| Named {
                span: name.span,
                symbol,
                declares: false,
                is_field: true,
            }));
        }
    }

    fn patch(&mut self, fields: &[Field], known: &Known) {
        for (key, _) in keys(fields, "params") {
            self.put(key, |name| known.value(name));
        }
        for (key, value) in keys(fields, "nodes") {
            self.put(key, |name| known.way(name));
            let text = key.text().unwrap_or_default();
            let Some(inner) = known.uses.get(named_node(text)) else { continue };
            match known.behind(text) {
                None if known.is_repeated(text) => self.repeated(value, inner),
                // What stands there are the fields.
                None | Some("") => self.fields(value, inner),
                Some(_) => {}
            }
        }
    }

    fn graph(&mut self, fields: &[Field], known: &Known, references: &References) {
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
        for Reference { span, text, kind, .. } in references.all() {
            let named = match kind {
                Names::Link => known.link(text),
                Names::Output => vec![(0..text.len(), known.symbol(Output, text))],
                Names::Parameter => vec![(0..text.len(), known.symbol(Parameter, text))],
                Names::Expression => {
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
            self.put_at(*span, text, named, false);
        }
        for (_, call) in keys(fields, "nodes") {
            let Some((kind, inner)) = kind_of(call).and_then(|kind| {
                let inner = known.types.get(&kind.text)?.clone();
                Some((kind, inner))
            }) else {
                continue;
            };
            let symbol = known.symbol(Type, &kind.text);
            self.put_at(kind.span, &kind.text, vec![(0..kind.text.len(), symbol)], false);
            match is_each(call) {
                true => self.repeated(call, &inner),
                false => self.fields(call, &inner),
            }
        }
    }

    /// The fields of a `ForEach` over a used graph.
    fn repeated(&mut self, call: &Tree, inner: &Inner) {
        for Field { name, value } in call.fields().unwrap_or_default() {
            match (&name.text[..], &value.kind) {
                ("with" | "links" | "carry", _) => self.fields(value, inner),
                ("over", Kind::List(items)) => {
                    items.iter().for_each(|item| self.fields(item, inner));
                }
                ("each" | "number", _) => self.put(value, |says| {
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

    fn sweep(&mut self, fields: &[Field], known: &Known) {
        for (key, _) in keys(fields, "set") {
            self.put(key, |says| known.value(says));
        }
        let mut swept = HashSet::new();
        for Field { name, value } in fields {
            match &name.text[..] {
                "over" => self.axis(value, known, &mut swept),
                "picture" => {
                    let inner = value.fields().unwrap_or_default().iter();
                    let inner = inner.filter(|it| it.name.text == "output").map(|it| &it.value);
                    let outputs = inner.chain([value]);
                    outputs.for_each(|output| self.put(output, |says| known.output(says)));
                }
                _ => {}
            }
        }
        let out = fields.iter().filter(|field| field.name.text == "out");
        for Field { value, .. } in out {
            self.put(value, |says| {
                let braces = says.match_indices('{').filter_map(|(start, _)| {
                    let name = says[start + 1..].split('}').next()?;
                    swept.contains(name).then_some((start + 1, name))
                });
                let named = braces.flat_map(|(start, name)| {
                    let there = known.value(name).into_iter();
                    there.map(move |(at, it)| (start + at.start..start + at.end, it))
                });
                named.collect()
            });
        }
    }

    /// What an axis of a sweep names; those values that are shown by the name of what they set are `swept`.
    fn axis(&mut self, axis: &Tree, known: &Known, swept: &mut HashSet<String>) {
        let items: &[Tree] = match &axis.kind {
            Kind::Call { body: Body::Items(items), .. } => items,
            _ => &[],
        };
        match (axis.name().as_ref().map(|name| &name.text[..]), items.first()) {
            (Some("Product" | "Zip"), Some(Tree { kind: Kind::List(axes), .. })) => {
                axes.iter().for_each(|axis| self.axis(axis, known, swept));
            }
            (Some("Values"), Some(target)) => {
                swept.extend(target.text().map(str::to_owned));
                self.put(target, |says| known.value(says));
            }
            (Some("Files"), _) => {
                for Field { name, value } in axis.fields().unwrap_or_default() {
                    match &name.text[..] {
                        "set" => self.put(value, |says| known.value(says)),
                        "input" => self.put(value, |says| {
                            known
                                .node(says)
                                .map(|it| (0..says.len(), it))
                                .into_iter()
                                .collect::<Vec<_>>()
                        }),
                        "beside" => {
                            entries_of(value).for_each(|(key, _)| {
                                self.put(key, |says| known.value(says));
                            });
                        }
                        _ => {}
                    }
                }
            }
            _ => {}
        }
    }

    fn test(&mut self, fields: &[Field], known: &Known) {
        for (_, case) in keys(fields, "cases") {
            for field in case.fields().unwrap_or_default() {
                for (key, _) in entries_of(&field.value) {
                    match &field.name.text[..] {
                        "set" => self.put(key, |says| known.value(says)),
                        "inputs" => self.put(key, |says| {
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
            self.put(key, |says| known.output(says));
        }
        let expect = fields.iter().filter(|field| field.name.text == "expect");
        for text in expect.flat_map(|field| Expectation::value_texts(&field.value)) {
            self.put(text, |says| known.expected(says));
        }
    }
}

/// A path without links and dots, whether or not there is such a file.
pub fn real(path: &Path) -> PathBuf {
    folder_of(path).join(path.file_name().unwrap_or_default())
}
