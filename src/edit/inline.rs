//! A use of a graph that gives way to the nodes inside of it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use maquette_graph::catalog::Catalog;
use maquette_graph::definition::{Definition, What};
use maquette_graph::expectation::Expectation;
use maquette_graph::meaning::named_node;
use maquette_graph::migrate::kind_of;
use maquette_graph::rebase::path_of_use;
use maquette_graph::top::name_of;
use maquette_graph::{
    Options, Refusal, Splice, added, apply, behind, field, opened, parts, put_entry, without,
};
use maquette_syntax::error::{Problem, Span, code};
use maquette_syntax::paths::{folder_of_new, without_dots};
use maquette_syntax::{
    Field, Kind, Tree, commas_behind, nearest_or_all, parse, quoted, with_article,
};

use super::moved::{
    Given, Known, Sides, expression, free_name, gap_behind, indented_entries, part_with,
    put_in_place, put_values, refusal,
};
use super::{Edit, Edited, Judge};

/// The text of the graph file at `path` with the nodes of a used graph in the place of one use: what [`extract`](crate::extract()) has done is undone.
///
/// The nodes come with their comments, and with the use's values in place of the graph's parameters. Each keeps its name if that is
/// free; else the use's name goes before it. Links to the use lead to the nodes, what the graph expects is expected of them, and its
/// types of nodes come along. Every value has the key that it had. The graph's file stays as it is.
///
/// # Errors
/// The graph has problems, the node is no use of a graph or stands in a `ForEach`, or its nodes cannot say the same here: because of
/// what the graph wants of its inputs or promises, or of a value that an expression cannot say. Or the new text has problems. Places
/// are those in `text` or in that of the used graph.
pub fn inline(
    path: &Path,
    text: &str,
    node: &str,
    catalog: &Catalog,
    options: &Options,
) -> Result<Edited, Vec<Problem>> {
    // What is set stands in no text.
    let options = &Options { set: Vec::new(), ..options.clone() };
    let judge = Judge { path, catalog, options };
    Edited::with_commas_behind(text, |text| inlined(&judge, text, node))
}

fn inlined(judge: &Judge<'_>, text: &str, node: &str) -> Result<Edited, Vec<Problem>> {
    let &Judge { path, catalog, .. } = judge;
    let (known, before) = judge.sound(text)?;
    let refused = |refused| judge.refuse(text, refused);
    let name = node.strip_prefix("nodes.").unwrap_or(node);
    let (at, graph) = used(&known, name).map_err(refused)?;
    let file = graph.sheet.folder.join(graph.sheet.source.name.file_name().unwrap_or_default());
    let mut inside = judge.reading();
    inside.roots.extend(known.roots.iter().cloned());
    let inner = Judge { path: &file, catalog, options: &inside };
    let edits = ready(&known, at, graph);
    let own =
        inner.done(&commas_behind(&graph.sheet.source.text), &edits, std::iter::empty())?.text;
    let inner_known = Known::read(&file, &own, catalog, &inside)?;
    let work = Work::of(&known, at, &inner_known, path, &file);
    let named = Judge { path: &graph.sheet.source.name, ..inner };
    let new = work.done().map_err(|(is_inside, told)| match is_inside {
        true => named.refuse(&own, told),
        false => judge.refuse(text, told),
    })?;
    let after = judge.computed(&new)?;
    if before != after {
        let span = known.entries("nodes")[at].0.span;
        return Err(refused(unlike(name, graph, &before, &after, span)));
    }
    Ok(Edited { text: new, before: text.to_owned(), changes: Vec::new() })
}

/// The place of a use among the nodes, and the graph that it is of.
fn used<'k>(known: &'k Known, name: &str) -> Result<(usize, &'k Definition), Refusal> {
    let Some(at) = known.position("nodes", name) else {
        let nodes = Vec::from_iter(known.names("nodes"));
        let message = format!("the graph has no node `{name}`");
        let help = String::from(nearest_or_all(name, "its nodes", &nodes));
        return Err(refusal(code::UNKNOWN_LINK, Span::default(), message, help));
    };
    let (key, call) = &known.entries("nodes")[at];
    let kind = call.name().map_or_else(String::new, |kind| kind.text);
    let no = |message: String, help: &str| Err(refusal(code::WRONG_TYPE, key.span, message, help));
    if kind == "ForEach" {
        let message = format!("`{name}` is a ForEach, whose elements are not written one by one");
        return no(
            message,
            "use the graph once for each element, and put the nodes in place of those",
        );
    }
    let What::Use(_, graph) = &known.draft(name).map_or(&What::Input, |draft| &draft.what) else {
        let message = format!("`{name}` is {}, and no use of a graph", with_article(&kind));
        return no(message, "only types of nodes under `use` have nodes inside");
    };
    if graph.is_patched() {
        let file = graph.sheet.source.name.display();
        let message = format!("`{file}` is a patch, which has no nodes of its own");
        return no(message, "use the graph that it is `of`, with its values");
    }
    Ok((at, graph))
}

/// The edits by which a used graph can stand in another one: without inputs that are left out, and with names that are free there.
fn ready(known: &Known, at: usize, graph: &Definition) -> Vec<Edit> {
    let (key, call) = &known.entries("nodes")[at];
    let fields = call.fields().unwrap_or_default();
    let drafts = &graph.drafts[..graph.inputs];
    let is_left_out =
        |name: &str| fields.iter().all(|it| name_of(&it.name.text) != name || is_none(it));
    let absent = drafts.iter().map(|draft| &draft.name.text).filter(|name| is_left_out(name));
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
    let inputs = drafts.iter().map(|draft| &draft.name.text[..]);
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

/// Why the nodes do not say the same here.
fn unlike(
    name: &str,
    graph: &Definition,
    [before, _]: &Sides,
    [after, _]: &Sides,
    span: Span,
) -> Refusal {
    let wants = || graph.wants.iter().zip(&graph.drafts).find(|(wants, _)| !wants.is_empty());
    let (message, help) = if before.promised.len() != after.promised.len() {
        (
            format!("the graph of `{name}` promises what does not follow from its nodes"),
            "take the promise out of its file, or keep the use".to_owned(),
        )
    } else if let Some((wants, input)) = wants() {
        (
            format!(
                "input `{}` of `{name}` wants {}, which nodes alone do not want",
                input.name.text, wants[0].0
            ),
            "take it out of the graph's file, or keep the use".to_owned(),
        )
    } else {
        (
            format!(
                "without `{name}` something would be computed otherwise, such as a number in another unit"
            ),
            "keep the use, or give its parameters values of their own units".to_owned(),
        )
    };
    refusal(code::EXPRESSION, span, message, help)
}

/// A refusal, and whether its place is in the used graph.
type Told = (bool, Refusal);

/// Writes the text.
struct Work<'a> {
    known: &'a Known,
    /// The place of the use among the nodes.
    at: usize,
    /// The used graph, as it can stand in the other one.
    inner: &'a Known,
    path: &'a Path,
    /// The folders of the used graph and of the graph.
    folders: [PathBuf; 2],
    /// What comes in at each input.
    links: BTreeMap<String, &'a str>,
    /// The names of types of nodes that are others here.
    kinds: BTreeMap<String, String>,
}

impl<'a> Work<'a> {
    fn of(known: &'a Known, at: usize, inner: &'a Known, path: &'a Path, file: &Path) -> Self {
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
        work.kinds = work.kinds();
        work
    }

    fn name(&self) -> &str {
        self.known.entries("nodes")[self.at].0.text().unwrap_or_default()
    }

    fn done(&self) -> Result<String, Told> {
        let Self { known, inner, .. } = self;
        let (text, own) = (&known.text, &inner.text);
        let (Some(map), Some(inside)) = (known.section("nodes"), inner.section("nodes")) else {
            return Ok(text.clone());
        };
        let within = self.inner_splices().map_err(|told| (true, told))?;
        let content = Span { start: opened(own, inside.span), end: inside.span.end - 1 };
        let entries = part_with(own, content, &within);
        // What was put in has no mistakes, or the text would have had them.
        let entries = indented_entries(self.path, &entries).unwrap_or_default();
        let mut splices = put_in_place(text, map, self.at, &entries);
        for link in known.links.iter().filter(|link| named_node(&link.text) == self.name()) {
            splices.push((link.span, quoted(&self.output(&link.text))));
        }
        splices.extend(self.expected());
        splices.extend(self.uses());
        splices.extend(self.packs().map_err(|told| (false, told))?);
        Ok(apply(text, splices))
    }

    /// What a link to the use says now.
    fn output(&self, link: &str) -> String {
        let outputs = self.inner.entries("outputs");
        let output = match link.split_once('.') {
            Some((_, wanted)) => outputs.iter().find(|(key, _)| key.text() == Some(wanted)),
            None => outputs.first(),
        };
        output
            .and_then(|(_, value)| value.text())
            .map_or_else(|| link.to_owned(), |it| self.link(it))
    }

    /// What a link inside says here.
    fn link(&self, link: &str) -> String {
        self.links.get(link).map_or(link, |outer| outer).to_owned()
    }

    /// The edits of the nodes themselves.
    fn inner_splices(&self) -> Result<Vec<Splice>, Refusal> {
        let inner = self.inner;
        let mut splices = Vec::new();
        for link in &inner.links {
            if inner.owner(link.span).is_some() && self.links.contains_key(&link.text[..]) {
                splices.push((link.span, quoted(&self.link(&link.text))));
            }
        }
        splices.extend(self.paths());
        let values = self.values();
        let there = self.known.names("params").map(str::to_owned).collect();
        for entry in inner.entries("nodes") {
            splices.extend(put_values(inner, entry, &values, &there)?);
            let kind = kind_of(&entry.1);
            let Some((kind, new)) = kind.and_then(|it| Some((self.kinds.get(&it.text)?, it)))
            else {
                continue;
            };
            let is_text = inner.slice(new.span).starts_with('"');
            splices.push((new.span, if is_text { quoted(kind) } else { kind.clone() }));
        }
        Ok(splices)
    }

    /// The edits of paths that lie elsewhere from here.
    fn paths(&self) -> Vec<Splice> {
        let [from, to] = &self.folders;
        self.inner.rebased(self.inner.files(), from, to)
    }

    /// What the parameters of the used graph stand for.
    fn values(&self) -> BTreeMap<String, Given> {
        let Self { known, inner, .. } = self;
        let fields = known.entries("nodes")[self.at].1.fields().unwrap_or_default();
        let paths = self.paths();
        let declared = inner.entries("params").iter().filter_map(|(key, declaration)| {
            let name = key.text()?;
            let unit = field(declaration, "unit").and_then(|unit| unit.value.text());
            let given = fields.iter().find(|field| name_of(&field.name.text) == name);
            fn call(word: &str, given: Option<&Field>) -> Option<String> {
                given?.value.call_of(word)?.text().map(str::to_owned)
            }
            let value = match (call("Param", given), call("Expr", given), given) {
                (Some(name), ..) => Given::Parameter(name),
                (_, Some(text), _) => Given::Expression(text),
                (.., given) => {
                    let text = match given {
                        Some(given) => known.slice(given.value.span).to_owned(),
                        None => {
                            let default = &field(declaration, "default")?.value;
                            part_with(&inner.text, default.span, &paths)
                        }
                    };
                    Given::Value { text, unit: unit.map(str::to_owned) }
                }
            };
            Some((name.to_owned(), value))
        });
        let values = declared.collect();
        self.derived(values)
    }

    /// The same, with what computed defaults say here.
    fn derived(&self, mut values: BTreeMap<String, Given>) -> BTreeMap<String, Given> {
        let there = self.known.names("params").map(str::to_owned).collect();
        for name in self.inner.definition().derived_parameters() {
            let Some(Given::Value { text, .. }) = values.get(name) else { continue };
            let default = parse(text).0;
            let call = |word: &str| default.call_of(word).and_then(Tree::text);
            let value = match (call("Param"), call("Expr")) {
                (Some(other), _) => values.get(other).cloned(),
                (None, Some(text)) => expression(text, &values, &there).ok().map(Given::Expression),
                (None, None) => None,
            };
            if let Some(value) = value {
                values.insert(name.to_owned(), value);
            }
        }
        values
    }

    /// The edits that expect here what the used graph expects.
    fn expected(&self) -> Vec<Splice> {
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
            let new = if is_output { self.output(&format!(".{name}")) } else { self.link(name) };
            Some((text.span, quoted(&new)))
        });
        let names = Vec::from_iter(names);
        let items = items.iter().map(|item| part_with(&inner.text, item.span, &names));
        let items = Vec::from_iter(items);
        let own = field(known.tree(), "expect").map(|field| &field.value);
        match own.map(|own| (own, parts(own))) {
            _ if items.is_empty() => Vec::new(),
            None => added(&known.text, known.tree(), "expect", &format!("[{}]", items.join(", "))),
            Some((own, places)) => match &places[..] {
                [] => vec![(own.span, format!("[{}]", items.join(", ")))],
                [before @ .., last] => {
                    let before = before.last().map(|before| before.end);
                    let items = items.join(&gap_behind(&known.text, own, *last));
                    behind(&known.text, own.span, before, *last, &items)
                }
            },
        }
    }

    /// The types of nodes that the used graph names otherwise than they are to be named here.
    fn kinds(&self) -> BTreeMap<String, String> {
        let Self { known, inner, .. } = self;
        let mut taken = BTreeSet::from_iter(known.names("use").map(str::to_owned));
        taken.extend(inner.names("use").map(str::to_owned));
        let mut kinds = BTreeMap::new();
        for (key, value) in inner.entries("use") {
            let Some(name) = key.text() else { continue };
            let mut uses = known.entries("use").iter();
            let same_name = uses.clone().find(|(key, _)| key.text() == Some(name));
            let new = match (same_name, uses.find(|(_, other)| self.is_same(other, value))) {
                (None, None) => continue,
                (Some(same), _) if self.is_same(&same.1, value) => continue,
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

    /// Whether an entry of the graph's `use` says the same as one of the used graph's.
    fn is_same(&self, own: &Tree, inner: &Tree) -> bool {
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

    /// The edits of `use`: without the used graph, if nothing else needs it, and with the types that its nodes need.
    fn uses(&self) -> Vec<Splice> {
        let Self { known, inner, at, .. } = self;
        let nodes = known.entries("nodes");
        let Some(kind) = kind_of(&nodes[*at].1) else { return Vec::new() };
        let mut others = nodes.iter().enumerate().filter(|(other, _)| other != at);
        let is_needed = others
            .any(|(_, (_, call))| kind_of(call).is_some_and(|it| it.text == kind.text))
            || inner.entries("use").iter().any(|(key, _)| self.renamed(key) == kind.text);
        let [from, to] = &self.folders;
        let mut new = Vec::new();
        for (key, value) in inner.entries("use") {
            let name = self.renamed(key);
            if known.position("use", &name).is_some() {
                continue;
            }
            let path = inner.rebased(path_of_use(value).map(|path| path.span), from, to);
            new.push(format!("{}: {}", quoted(&name), part_with(&inner.text, value.span, &path)));
        }
        let (Some(map), Some(place)) = (known.section("use"), known.position("use", &kind.text))
        else {
            return Vec::new();
        };
        let (text, entry) = (&known.text, parts(map)[place]);
        if !new.is_empty() {
            let new = new.join(&gap_behind(text, map, entry));
            return match is_needed {
                true => put_entry(text, map, Some(place), false, |_| new.clone()),
                false => vec![(entry, new)],
            };
        }
        if is_needed {
            return Vec::new();
        }
        if parts(map).len() > 1 {
            return without(text, map, &BTreeSet::from([place]));
        }
        let fields = known.tree().fields().unwrap_or_default();
        let field = fields.iter().position(|field| field.name.text == "use");
        field.map(|at| without(text, known.tree(), &BTreeSet::from([at]))).unwrap_or_default()
    }

    fn renamed(&self, key: &Tree) -> String {
        let name = key.text().unwrap_or_default();
        self.kinds.get(name).map_or(name, String::as_str).to_owned()
    }

    /// The edits that name the packs that the used graph names.
    fn packs(&self) -> Result<Vec<Splice>, Refusal> {
        let Self { known, inner, .. } = self;
        let mut new = Vec::new();
        for (key, version) in inner.entries("packs") {
            let name = key.text().unwrap_or_default();
            let mut own = known.entries("packs").iter();
            match own.find(|(key, _)| key.text() == Some(name)) {
                None => new.push(format!("{}: {}", quoted(name), inner.slice(version.span))),
                Some((_, own)) if own.text() == version.text() => {}
                Some((_, own)) => {
                    let message = format!("the used graph needs another version of pack `{name}`");
                    let help = format!("name one version in both: {}", inner.slice(version.span));
                    return Err(refusal(code::WRONG_VALUE, own.span, message, help));
                }
            }
        }
        let section = known.section("packs").map(|map| (map, parts(map)));
        Ok(match section.as_ref().map(|(map, places)| (map, places.last())) {
            _ if new.is_empty() => Vec::new(),
            Some((map, last)) => {
                let gap = last.map_or(", ".into(), |last| gap_behind(&known.text, map, *last));
                put_entry(&known.text, map, None, false, |_| new.join(&gap))
            }
            None => {
                let value = format!("{{ {} }}", new.join(", "));
                added(&known.text, known.tree(), "packs", &value)
            }
        })
    }
}
