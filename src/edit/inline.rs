//! Inlining: replaces a node that uses another graph by the nodes of that graph.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use maquette_graph::canonical::node_of_link;
use maquette_graph::catalog::Catalog;
use maquette_graph::definition::{Definition, NodeKind};
use maquette_graph::expectation::Expectation;
use maquette_graph::header::name_of;
use maquette_graph::migrate::kind_of;
use maquette_graph::rebase::path_of_use;
use maquette_graph::tree::text_in_call;
use maquette_graph::{
    EditError, Options, Splice, add_field, apply, content_start, field, insert_after, parts,
    put_entry, remove_parts,
};
use maquette_syntax::error::{Diagnostic, Span, code};
use maquette_syntax::paths::{folder_of_new, without_dots};
use maquette_syntax::{
    Field, Kind, Tree, nearest_or_all, parse, quote, with_article, with_trailing_commas,
};

use super::relocate::{
    Fingerprints, ParameterValue, ParsedGraph, apply_within, edit_error, expression, free_name,
    indented_entries, replace_entry, separator_after, substitution_splices,
};
use super::{Edit, EditedText, Editor};

/// Replaces one node that uses a graph, in the file at `path`, by the nodes of the used graph. This is the inverse of
/// [`extract`](crate::extract()).
///
/// The nodes keep their comments. The parameters of the used graph are replaced by the values that the replaced node gives to them. An
/// inlined node keeps its name if the name is free; otherwise it is prefixed with the name of the replaced node. Links to outputs of the
/// replaced node become links to the inlined nodes. The expectations and node types of the used graph are copied. Every value keeps its
/// cache key. The file of the used graph is not changed.
///
/// # Errors
/// The graph has errors, the new text has errors, the node does not use a graph or is a `ForEach`, or the inlined nodes would have another
/// meaning. Their meaning can change if the used graph requires properties of its inputs or promises properties of its outputs. It can also
/// change if a value cannot be written in an expression. Positions refer to `text` or to the text of the used graph.
pub fn inline(
    path: &Path,
    text: &str,
    node: &str,
    catalog: &Catalog,
    options: &Options,
) -> Result<EditedText, Vec<Diagnostic>> {
    // Ignore the values of `--set`, because they are not in the text.
    let options = &Options { set: Vec::new(), ..options.clone() };
    let editor = Editor { path, catalog, options };
    EditedText::with_commas_behind(text, |text| inline_in(&editor, text, node))
}

fn inline_in(editor: &Editor<'_>, text: &str, node: &str) -> Result<EditedText, Vec<Diagnostic>> {
    let &Editor { path, catalog, .. } = editor;
    let (known, before) = editor.load_valid(text)?;
    let to_diagnostics = |error| editor.diagnostics(text, error);
    let name = node.strip_prefix("nodes.").unwrap_or(node);
    let (at, graph) = find_use(&known, name).map_err(to_diagnostics)?;
    let file =
        graph.source_map.folder.join(graph.source_map.source.name.file_name().unwrap_or_default());
    let mut inside = editor.reading_options();
    inside.roots.extend(known.roots.iter().cloned());
    let inner = Editor { path: &file, catalog, options: &inside };
    let edits = preparing_edits(&known, at, graph);
    let own = inner
        .apply_unchecked(
            &with_trailing_commas(&graph.source_map.source.text),
            &edits,
            std::iter::empty(),
        )?
        .text;
    let inner_known = ParsedGraph::read(&file, &own, catalog, &inside)?;
    let work = Inliner::new(&known, at, &inner_known, path, &file);
    let named = Editor { path: &graph.source_map.source.name, ..inner };
    let new = work.write().map_err(|(is_inside, error)| match is_inside {
        true => named.diagnostics(&own, error),
        false => editor.diagnostics(text, error),
    })?;
    let after = editor.fingerprints(&new)?;
    if before != after {
        let span = known.entries("nodes")[at].0.span;
        return Err(to_diagnostics(difference_error(name, graph, &before, &after, span)));
    }
    Ok(EditedText { text: new, before: text.to_owned(), changes: Vec::new() })
}

/// Returns the index of the node `name`, and the definition of the graph that it uses.
fn find_use<'k>(known: &'k ParsedGraph, name: &str) -> Result<(usize, &'k Definition), EditError> {
    let Some(at) = known.position("nodes", name) else {
        let nodes = Vec::from_iter(known.names("nodes"));
        let message = format!("the graph has no node `{name}`");
        let help = String::from(nearest_or_all(name, "its nodes", &nodes));
        return Err(edit_error(code::UNKNOWN_LINK, Span::default(), message, help));
    };
    let (key, call) = &known.entries("nodes")[at];
    let kind = call.name().map_or_else(String::new, |kind| kind.text);
    if kind == "ForEach" {
        let message = format!("`{name}` is a ForEach, whose elements are not written one by one");
        let help = "use the graph once for each element, and inline these uses";
        return Err(edit_error(code::WRONG_TYPE, key.span, message, help));
    }
    let NodeKind::Use(_, graph) =
        &known.parsed_node(name).map_or(&NodeKind::Input, |parsed| &parsed.what)
    else {
        let message = format!("`{name}` is {}, not a use of a graph", with_article(&kind));
        let help = "only nodes whose types are declared under `use` can be inlined";
        return Err(edit_error(code::WRONG_TYPE, key.span, message, help));
    };
    if graph.is_patched() {
        let file = graph.source_map.source.name.display();
        let message = format!("`{file}` is a patch, which has no nodes of its own");
        let help = "use the graph that it is `of`, with its values";
        return Err(edit_error(code::WRONG_TYPE, key.span, message, help));
    }
    Ok((at, graph))
}

/// Returns the edits that prepare the text of a used graph for inlining. They remove omitted inputs, and rename nodes whose names are taken
/// in the using graph.
fn preparing_edits(known: &ParsedGraph, at: usize, graph: &Definition) -> Vec<Edit> {
    let (key, call) = &known.entries("nodes")[at];
    let fields = call.fields().unwrap_or_default();
    let parsed_nodes = &graph.parsed_nodes[..graph.inputs];
    let absent = parsed_nodes
        .iter()
        .map(|parsed| &parsed.name.text)
        .filter(|name| fields.iter().all(|it| name_of(&it.name.text) != **name || is_none(it)));
    let mut edits: Vec<_> = absent
        .map(|name| Edit::Remove { name: format!("inputs.{name}"), and_links: true })
        .collect();
    let map = field(&graph.tree, "nodes").map(|nodes| &nodes.value.kind);
    let inner = match map {
        Some(Kind::Map(entries)) => entries.iter().filter_map(|(key, _)| key.text()).collect(),
        _ => Vec::new(),
    };
    let name = key.text().unwrap_or_default();
    let others = known.names("nodes").filter(|other| *other != name).chain(known.names("inputs"));
    let others = BTreeSet::from_iter(others);
    let inputs = parsed_nodes.iter().map(|parsed| &parsed.name.text[..]);
    let mut taken = BTreeSet::from_iter(inner.iter().copied().chain(inputs).map(str::to_owned));
    taken.extend(others.iter().map(|&other| other.to_owned()));
    for node in inner.into_iter().filter(|node| others.contains(node)) {
        let to = free_name(
            [format!("{name}-{node}")],
            |name, nth| format!("{name}-{nth}"),
            |name| !taken.contains(name),
        );
        taken.insert(to.clone());
        edits.push(Edit::Rename { from: format!("nodes.{node}"), to });
    }
    edits
}

fn is_none(field: &Field) -> bool {
    matches!(&field.value.kind, Kind::Word(word) if word == "None")
}

/// Returns the error for an inlining after which the graph would compute other values.
fn difference_error(
    name: &str,
    graph: &Definition,
    [before, _]: &Fingerprints,
    [after, _]: &Fingerprints,
    span: Span,
) -> EditError {
    let requiring =
        graph.wants.iter().zip(&graph.parsed_nodes).find(|(wants, _)| !wants.is_empty());
    let (message, help) = if before.promised.len() != after.promised.len() {
        (
            format!("the graph of `{name}` promises properties that do not follow from its nodes"),
            "remove the promise from its file, or keep the use".to_owned(),
        )
    } else if let Some((wants, input)) = requiring {
        (
            format!(
                "input `{}` of `{name}` wants {}, which its nodes do not require",
                input.name.text, wants[0].0
            ),
            "remove the requirement from the graph's file, or keep the use".to_owned(),
        )
    } else {
        (
            format!("without `{name}` some results would change, such as a number in another unit"),
            "keep the use, or give its parameters values of their own units".to_owned(),
        )
    };
    edit_error(code::EXPRESSION, span, message, help)
}

/// An error of an inlining. The flag is true if the position of the error is in the used graph, and false if it is in the using graph.
type InlineError = (bool, EditError);

/// Writes the text of the using graph with the inlined nodes.
struct Inliner<'a> {
    known: &'a ParsedGraph,
    /// The index, in the using graph, of the node to be replaced.
    at: usize,
    /// The used graph, after the edits that prepare it for inlining.
    inner: &'a ParsedGraph,
    path: &'a Path,
    /// The folder of the used graph, and the folder of the using graph.
    folders: [PathBuf; 2],
    /// For each input of the used graph, the link by which the replaced node sets this input.
    links: BTreeMap<String, &'a str>,
    /// New names for node types of the used graph whose names are taken in the using graph.
    kinds: BTreeMap<String, String>,
}

impl<'a> Inliner<'a> {
    fn new(
        known: &'a ParsedGraph,
        at: usize,
        inner: &'a ParsedGraph,
        path: &'a Path,
        file: &Path,
    ) -> Self {
        let fields = known.entries("nodes")[at].1.fields().unwrap_or_default();
        let folders = [folder_of_new(file), folder_of_new(path)];
        let links = fields
            .iter()
            .filter_map(|field| {
                let value = field.value.call_of("Some").unwrap_or(&field.value);
                let name = name_of(&field.name.text);
                inner.position("inputs", &name)?;
                Some((name, value.text()?))
            })
            .collect();
        let mut work = Self { known, at, inner, path, folders, links, kinds: BTreeMap::new() };
        work.kinds = work.renamed_types();
        work
    }

    fn name(&self) -> &str {
        self.known.entries("nodes")[self.at].0.text().unwrap_or_default()
    }

    fn write(&self) -> Result<String, InlineError> {
        let Self { known, inner, .. } = self;
        let (text, own) = (&known.text, &inner.text);
        let (Some(map), Some(inside)) = (known.section("nodes"), inner.section("nodes")) else {
            return Ok(text.clone());
        };
        let within = self.inner_splices().map_err(|error| (true, error))?;
        let content = Span { start: content_start(own, inside.span), end: inside.span.end - 1 };
        let entries = apply_within(own, content, &within);
        // The inserted text comes from a parsed text, so it has no syntax errors.
        let entries = indented_entries(self.path, &entries).unwrap_or_default();
        let mut splices = replace_entry(text, map, self.at, &entries);
        for link in known.links.iter().filter(|link| node_of_link(&link.text) == self.name()) {
            splices.push((link.span, quote(&self.link_to_output(&link.text))));
        }
        splices.extend(self.expectation_splices());
        splices.extend(self.use_splices());
        splices.extend(self.pack_splices().map_err(|error| (false, error))?);
        Ok(apply(text, splices))
    }

    /// Returns the replacement of a link to an output of the replaced node.
    fn link_to_output(&self, link: &str) -> String {
        let outputs = self.inner.entries("outputs");
        let output = match link.split_once('.') {
            Some((_, wanted)) => outputs.iter().find(|(key, _)| key.text() == Some(wanted)),
            None => outputs.first(),
        };
        output
            .and_then(|(_, value)| value.text())
            .map_or_else(|| link.to_owned(), |it| self.outer_link(it))
    }

    /// Returns the replacement of a link inside of the used graph. A link to an input is replaced by the link by which the replaced node
    /// sets this input.
    fn outer_link(&self, link: &str) -> String {
        self.links.get(link).map_or(link, |outer| outer).to_owned()
    }

    /// Returns the edits within the text of the inlined nodes: they adapt links to inputs, paths of files, parameters and node types.
    fn inner_splices(&self) -> Result<Vec<Splice>, EditError> {
        let inner = self.inner;
        let mut splices = Vec::new();
        for link in &inner.links {
            if inner.owner(link.span).is_some() && self.links.contains_key(&link.text[..]) {
                splices.push((link.span, quote(&self.outer_link(&link.text))));
            }
        }
        splices.extend(self.path_splices());
        let values = self.parameter_values();
        let there = self.known.names("params").map(str::to_owned).collect();
        for entry in inner.entries("nodes") {
            splices.extend(substitution_splices(inner, entry, &values, &there)?);
            let kind = kind_of(&entry.1);
            let Some((kind, new)) = kind.and_then(|it| Some((self.kinds.get(&it.text)?, it)))
            else {
                continue;
            };
            let is_text = inner.slice(new.span).starts_with('"');
            splices.push((new.span, if is_text { quote(kind) } else { kind.clone() }));
        }
        Ok(splices)
    }

    /// Returns the edits that adapt paths to the folder of the using graph.
    fn path_splices(&self) -> Vec<Splice> {
        let [from, to] = &self.folders;
        self.inner.rebase_paths(self.inner.files(), from, to)
    }

    /// Returns the values that the replaced node gives to the parameters of the used graph.
    fn parameter_values(&self) -> BTreeMap<String, ParameterValue> {
        let Self { known, inner, .. } = self;
        let fields = known.entries("nodes")[self.at].1.fields().unwrap_or_default();
        let paths = self.path_splices();
        let declared = inner.entries("params").iter().filter_map(|(key, declaration)| {
            let name = key.text()?;
            let unit = field(declaration, "unit").and_then(|unit| unit.value.text());
            let given = fields.iter().find(|field| name_of(&field.name.text) == name);
            fn call(word: &str, given: Option<&Field>) -> Option<String> {
                given?.value.call_of(word)?.text().map(str::to_owned)
            }
            let value = match (call("Param", given), call("Expr", given), given) {
                (Some(name), ..) => ParameterValue::Parameter(name),
                (_, Some(text), _) => ParameterValue::Expression(text),
                (.., given) => {
                    let text = match given {
                        Some(given) => known.slice(given.value.span).to_owned(),
                        None => {
                            let default = &field(declaration, "default")?.value;
                            apply_within(&inner.text, default.span, &paths)
                        }
                    };
                    ParameterValue::Value { text, unit: unit.map(str::to_owned) }
                }
            };
            Some((name.to_owned(), value))
        });
        let values = declared.collect();
        self.with_derived_values(values)
    }

    /// Replaces each computed default of a parameter by an expression that is valid in the using graph.
    fn with_derived_values(
        &self,
        mut values: BTreeMap<String, ParameterValue>,
    ) -> BTreeMap<String, ParameterValue> {
        let there = self.known.names("params").map(str::to_owned).collect();
        for name in self.inner.definition().derived_parameters() {
            let Some(ParameterValue::Value { text, .. }) = values.get(name) else { continue };
            let default = parse(text).0;
            let value = match (text_in_call(&default, "Param"), text_in_call(&default, "Expr")) {
                (Some(other), _) => values.get(other).cloned(),
                (None, Some(text)) => {
                    expression(text, &values, &there).ok().map(ParameterValue::Expression)
                }
                (None, None) => None,
            };
            if let Some(value) = value {
                values.insert(name.to_owned(), value);
            }
        }
        values
    }

    /// Returns the edits that copy the expectations of the used graph to the using graph.
    fn expectation_splices(&self) -> Vec<Splice> {
        let Self { known, inner, .. } = self;
        let Some(list) = field(inner.tree(), "expect").map(|field| &field.value) else {
            return Vec::new();
        };
        let items = match &list.kind {
            Kind::List(items) => items,
            _ => return Vec::new(),
        };
        let names = Expectation::value_texts(list).into_iter().filter_map(|text| {
            let name = text.text()?;
            let is_output = inner.position("outputs", name).is_some();
            let new = if is_output {
                self.link_to_output(&format!(".{name}"))
            } else {
                self.outer_link(name)
            };
            Some((text.span, quote(&new)))
        });
        let names = Vec::from_iter(names);
        let items = items.iter().map(|item| apply_within(&inner.text, item.span, &names));
        let items = Vec::from_iter(items);
        let own = field(known.tree(), "expect").map(|field| &field.value);
        match own.map(|own| (own, parts(own))) {
            _ if items.is_empty() => Vec::new(),
            None => {
                add_field(&known.text, known.tree(), "expect", &format!("[{}]", items.join(", ")))
            }
            Some((own, places)) => match &places[..] {
                [] => vec![(own.span, format!("[{}]", items.join(", ")))],
                [before @ .., last] => {
                    let before = before.last().map(|before| before.end);
                    let items = items.join(&separator_after(&known.text, own, *last));
                    insert_after(&known.text, own.span, before, *last, &items)
                }
            },
        }
    }

    /// Returns new names for node types of the used graph whose names are taken in the using graph.
    fn renamed_types(&self) -> BTreeMap<String, String> {
        let Self { known, inner, .. } = self;
        let mut taken = BTreeSet::from_iter(known.names("use").map(str::to_owned));
        taken.extend(inner.names("use").map(str::to_owned));
        let mut kinds = BTreeMap::new();
        for (key, value) in inner.entries("use") {
            let Some(name) = key.text() else { continue };
            let mut uses = known.entries("use").iter();
            let same_name = uses.clone().find(|(key, _)| key.text() == Some(name));
            let new = match (same_name, uses.find(|(_, other)| self.is_same_use(other, value))) {
                (None, None) => continue,
                (Some(same), _) if self.is_same_use(&same.1, value) => continue,
                (_, Some((key, _))) => key.text().unwrap_or_default().to_owned(),
                (Some(_), None) => free_name(
                    [name.to_owned()],
                    |name, nth| format!("{name}{nth}"),
                    |name| !taken.contains(name),
                ),
            };
            taken.insert(new.clone());
            kinds.insert(name.to_owned(), new);
        }
        kinds
    }

    /// Returns true if two entries of `use`, one from each graph, refer to the same file and require the same version.
    fn is_same_use(&self, own: &Tree, inner: &Tree) -> bool {
        let [from, to] = &self.folders;
        fn version(value: &Tree) -> Option<String> {
            field(value, "version").and_then(|it| it.value.text().map(str::to_owned))
        }
        fn path(value: &Tree) -> Option<String> {
            path_of_use(value).and_then(Tree::text).map(str::to_owned)
        }
        let there = path(inner).map(|path| without_dots(&from.join(path)));
        let here = path(own).map(|path| without_dots(&to.join(path)));
        here == there && version(own) == version(inner)
    }

    /// Returns the edits of the section `use` of the using graph. They remove the entry of the used graph if no other node needs it, and
    /// add the node types that the inlined nodes need.
    fn use_splices(&self) -> Vec<Splice> {
        let Self { known, inner, at, .. } = self;
        let nodes = known.entries("nodes");
        let Some(kind) = kind_of(&nodes[*at].1) else { return Vec::new() };
        let mut others = nodes.iter().enumerate().filter(|(other, _)| other != at);
        let is_needed = others
            .any(|(_, (_, call))| kind_of(call).is_some_and(|it| it.text == kind.text))
            || inner.entries("use").iter().any(|(key, _)| self.type_name(key) == kind.text);
        let [from, to] = &self.folders;
        let mut new = Vec::new();
        for (key, value) in inner.entries("use") {
            let name = self.type_name(key);
            if known.position("use", &name).is_some() {
                continue;
            }
            let path = inner.rebase_paths(path_of_use(value).map(|path| path.span), from, to);
            new.push(format!("{}: {}", quote(&name), apply_within(&inner.text, value.span, &path)));
        }
        let (Some(map), Some(place)) = (known.section("use"), known.position("use", &kind.text))
        else {
            return Vec::new();
        };
        let (text, entry) = (&known.text, parts(map)[place]);
        if !new.is_empty() {
            let new = new.join(&separator_after(text, map, entry));
            return match is_needed {
                true => put_entry(text, map, Some(place), false, |_| new.clone()),
                false => vec![(entry, new)],
            };
        }
        if is_needed {
            return Vec::new();
        }
        if parts(map).len() > 1 {
            return remove_parts(text, map, &BTreeSet::from([place]));
        }
        let fields = known.tree().fields().unwrap_or_default();
        let field = fields.iter().position(|field| field.name.text == "use");
        field.map(|at| remove_parts(text, known.tree(), &BTreeSet::from([at]))).unwrap_or_default()
    }

    fn type_name(&self, key: &Tree) -> String {
        let name = key.text().unwrap_or_default();
        self.kinds.get(name).map_or(name, String::as_str).to_owned()
    }

    /// Returns the edits that add the packs required by the used graph to the using graph.
    fn pack_splices(&self) -> Result<Vec<Splice>, EditError> {
        let Self { known, inner, .. } = self;
        let mut new = Vec::new();
        for (key, version) in inner.entries("packs") {
            let name = key.text().unwrap_or_default();
            let mut own = known.entries("packs").iter();
            match own.find(|(key, _)| key.text() == Some(name)) {
                None => new.push(format!("{}: {}", quote(name), inner.slice(version.span))),
                Some((_, own)) if own.text() == version.text() => {}
                Some((_, own)) => {
                    let message = format!("the used graph needs another version of pack `{name}`");
                    let help = format!("name one version in both: {}", inner.slice(version.span));
                    return Err(edit_error(code::WRONG_VALUE, own.span, message, help));
                }
            }
        }
        let section = known.section("packs").map(|map| (map, parts(map)));
        Ok(match section.as_ref().map(|(map, places)| (map, places.last())) {
            _ if new.is_empty() => Vec::new(),
            Some((map, last)) => {
                let gap = last.map_or(", ".into(), |last| separator_after(&known.text, map, *last));
                put_entry(&known.text, map, None, false, |_| new.join(&gap))
            }
            None => {
                let value = format!("{{ {} }}", new.join(", "));
                add_field(&known.text, known.tree(), "packs", &value)
            }
        })
    }
}
