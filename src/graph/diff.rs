//! Differences in meaning between two graphs.
//!
//! Entries of the old and the new graph are matched by name. The remaining entries are matched as renamed. Entries with equal meaning are
//! matched first, then entries of one type that have at least half of their fields in common, the most similar first. Links to renamed
//! nodes and names of renamed parameters count as equal.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;
use std::path::Path;

use maquette_syntax::error::{Diagnostic, Source};
use maquette_syntax::paths::project_root;
use maquette_syntax::{Body, Kind, Tree, parse, syntax_diagnostics};
use serde_json::json;

use super::canonical::{CanonicalGraph, Item, SECTIONS, has_link, rename};
use super::describe::Subgraph;
use super::migrate::migrate_graph;
use super::patch::patched_tree;
use super::rebase::text_relative_to;
use super::{Files, Graph, Options};
use crate::catalog::Catalog;
use crate::load::check_file;
use crate::options::folder_of;
use crate::tree::{is_patch, join_path, show};

/// One difference between two graphs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The kind of entry: `node`, `parameter`, `input`, `output`, `use` or `graph`.
    pub what: &'static str,
    /// The name of the entry. If the entry was renamed, its new name. Empty for the graph itself.
    pub name: String,
    /// The kind of the difference.
    pub change: Change,
    /// The dotted path of the field that differs. Empty if the whole entry differs.
    pub field: String,
    /// The previous value, as text. `None` if only the new graph has the entry or the field.
    pub before: Option<String>,
    /// The new value, as text. `None` if only the old graph has the entry or the field.
    pub after: Option<String>,
    /// The names of the nodes that lead to the entry through used graphs, outermost first. Empty for an entry of the compared graphs
    /// themselves.
    pub inside: Vec<String>,
}

/// The kind of a difference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Only the new graph has the entry.
    Added,
    /// Only the old graph has the entry.
    Removed,
    /// The entry has another name in the new graph.
    Renamed,
    /// A link leads to another output than in the old graph.
    Rewired,
    /// The value of a field differs between the graphs.
    Changed,
}

impl Change {
    /// Returns the word for this kind of difference in messages, such as `added`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Added => "added",
            Self::Removed => "removed",
            Self::Renamed => "renamed",
            Self::Rewired => "rewired",
            Self::Changed => "changed",
        }
    }
}

impl Difference {
    /// Returns the difference as `maquette diff --json` prints it.
    pub fn to_json(&self) -> serde_json::Value {
        let mut object = json!({
            "what": self.what,
            "name": self.name,
            "change": self.change.word(),
            "field": self.field,
            "before": self.before,
            "after": self.after,
        });
        if !self.inside.is_empty() {
            object["inside"] = json!(self.inside);
        }
        object
    }
}

/// Formats the difference on one line: `node red: changed select.distance: 30 -> 25`.
impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for name in &self.inside {
            write!(f, "in {name}: ")?;
        }
        f.write_str(self.what)?;
        if !self.name.is_empty() {
            write!(f, " {}", self.name)?;
        }
        write!(f, ": {}", self.change.word())?;
        fn side(value: &Option<String>) -> Option<String> {
            value.as_deref().map(shorten)
        }
        match (self.change, side(&self.before), side(&self.after)) {
            (Change::Added, _, Some(value)) | (Change::Removed, Some(value), _) => {
                write!(f, ": {value}")
            }
            (Change::Renamed, Some(before), _) => write!(f, ", was {before}"),
            (_, before, after) => {
                fn absent() -> String {
                    "left out".to_owned()
                }
                let gap = if self.field.is_empty() { "" } else { " " };
                let (before, after) = (before.unwrap_or_else(absent), after.unwrap_or_else(absent));
                write!(f, "{gap}{}: {before} -> {after}", self.field)
            }
        }
    }
}

/// Shortens a value for a line of output.
fn shorten(value: &str) -> String {
    const MAX_CHARS: usize = 100;
    match value.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}...", &value[..end]),
        None => value.to_owned(),
    }
}

impl Graph {
    /// Returns the differences in meaning between the graphs `old` and `new`. Spaces, comments, order, and values that equal their defaults
    /// are ignored. The files that the nodes read may be missing.
    ///
    /// If both graphs are in one project, two paths are equal if they lead to the same file, and paths are shown relative to the old graph.
    /// If the graphs are in two projects, such as two checkouts, paths are compared as they are written.
    ///
    /// # Errors
    /// A text has syntax errors.
    pub fn differences(
        old: &Source,
        new: &Source,
        catalog: &Catalog,
    ) -> Result<Vec<Difference>, Vec<Diagnostic>> {
        let folder = folder_of(&old.name);
        let is_one_project = project_root(&folder) == project_root(&folder_of(&new.name));
        let mut old = ComparedGraph::read(old, is_one_project, &folder, catalog);
        let mut new = ComparedGraph::read(new, is_one_project, &folder, catalog);
        Subgraph::make_comparable(&mut old.subgraphs, &mut new.subgraphs);
        let diagnostics = [old.diagnostics, new.diagnostics].concat();
        if !diagnostics.is_empty() {
            return Err(diagnostics);
        }
        let old = CanonicalGraph::new(&old.tree, catalog, &old.subgraphs);
        let new = CanonicalGraph::new(&new.tree, catalog, &new.subgraphs);
        Ok(compare(&old, &new))
    }
}

/// A graph that has been read for a comparison.
struct ComparedGraph {
    tree: Tree,
    /// The graphs that the compared graph uses as nodes.
    subgraphs: Vec<Subgraph>,
    diagnostics: Vec<Diagnostic>,
}

impl ComparedGraph {
    /// Reads a graph, and replaces outdated names of nodes and fields by current ones. If both compared graphs are in one project, paths
    /// are made relative to `folder`.
    fn read(source: &Source, is_one_project: bool, folder: &Path, catalog: &Catalog) -> Self {
        let (tree, errors) = parse(&source.text);
        let diagnostics = syntax_diagnostics(&source.name, &source.text, errors);
        let is_plain = tree.fields().is_some_and(|fields| {
            fields.iter().all(|field| field.name.text != "use" && field.name.text != "of")
        });
        let is_near = !is_one_project || folder_of(&source.name) == *folder;
        if is_plain && is_near || !diagnostics.is_empty() {
            let tree = migrate_graph(&tree, catalog);
            return Self { tree, subgraphs: Vec::new(), diagnostics };
        }
        // The used graphs determine which values are defaults. If the file is a patch, compare the graph that results from the patch.
        let options = Options { files: Files::Ignored, ..Options::default() };
        let (path, text) = (&source.name, source.text.clone());
        let (subgraphs, _) = Graph::subgraphs_of(path, text.clone(), catalog, &options);
        let tree = match is_one_project {
            true => check_file(path, text, catalog, &options)
                .1
                .map_or(tree, |whole| parse(&text_relative_to(&whole.definition, folder)).0),
            false if is_patch(&tree) => patched_tree(path, text, catalog, &options),
            false => tree,
        };
        Self { tree: migrate_graph(&tree, catalog), subgraphs, diagnostics }
    }
}

fn compare(old: &CanonicalGraph, new: &CanonicalGraph) -> Vec<Difference> {
    let mut found = Vec::new();
    let added = new.rest.iter().filter(|item| old.rest.iter().all(|known| known.name != item.name));
    for Item { name, .. } in old.rest.iter().chain(added) {
        let [before, after] =
            [old, new].map(|graph| graph.rest.iter().find(|item| item.name == *name));
        if before.map(|item| &item.value) != after.map(|item| &item.value) {
            let [before, after] =
                [before, after].map(|item| item.map(|item| item.show("", &item.value)));
            let (what, field) = ("graph", name.clone());
            let change = Change::Changed;
            let inside = Vec::new();
            found.push(Difference {
                what,
                name: String::new(),
                change,
                field,
                before,
                after,
                inside,
            });
        }
    }
    let mut names = RenamedNames::default();
    for (section, (_, what)) in SECTIONS.iter().enumerate() {
        let section = Section { what, old: &old.sections[section], new: &new.sections[section] };
        section.compare(&mut names, &mut found);
    }
    found
}

/// The renamed nodes and parameters. Each map is from a new name to the old one.
#[derive(Default)]
struct RenamedNames {
    nodes: HashMap<String, String>,
    parameters: HashMap<String, String>,
}

impl RenamedNames {
    /// Replaces new names of nodes and parameters by the old ones in a value of the new graph.
    fn in_old(&self, tree: &Tree) -> Tree {
        rename(tree, &|name| self.nodes.get(name).cloned(), &|name| {
            self.parameters.get(name).cloned()
        })
    }

    /// Replaces old names of nodes and parameters by the new ones in a value of the old graph.
    fn in_new(&self, tree: &Tree) -> Tree {
        fn new_name_of(names: &HashMap<String, String>, wanted: &str) -> Option<String> {
            let mut found = names.iter().filter(|(_, old)| *old == wanted);
            found.next().map(|(new, _)| new.clone())
        }
        rename(tree, &|name| new_name_of(&self.nodes, name), &|name| {
            new_name_of(&self.parameters, name)
        })
    }

    fn add(&mut self, what: &str, new: &str, old: &str) {
        match what {
            "node" | "input" => self.nodes.insert(new.to_owned(), old.to_owned()),
            "parameter" => self.parameters.insert(new.to_owned(), old.to_owned()),
            _ => None,
        };
    }
}

/// One section, such as `nodes`, of both graphs.
struct Section<'m> {
    what: &'static str,
    old: &'m [Item],
    new: &'m [Item],
}

impl Section<'_> {
    fn compare(&self, names: &mut RenamedNames, found: &mut Vec<Difference>) {
        fn places(items: &[Item]) -> HashMap<String, usize> {
            let items = items.iter().enumerate();
            items.map(|(index, item)| (item.name.clone(), index)).collect()
        }
        let (in_old, in_new) = (places(self.old), places(self.new));
        let gone = (0..self.old.len()).filter(|&k| !in_new.contains_key(&self.old[k].name));
        let come = (0..self.new.len()).filter(|&k| !in_old.contains_key(&self.new[k].name));
        let mut match_up = RenameMatcher {
            section: self,
            removed: gone.collect(),
            added: come.collect(),
            pairs: BTreeMap::new(),
        };
        match_up.run(names);
        let pairs = match_up.pairs;
        for (index, old) in self.old.iter().enumerate() {
            let renamed = pairs.get(&index).copied();
            let Some(new) = renamed.or_else(|| in_new.get(&old.name).copied()) else {
                found.push(self.entry_difference(old, Change::Removed));
                continue;
            };
            let new = &self.new[new];
            if renamed.is_some() {
                found.push(Difference {
                    name: new.name.clone(),
                    before: Some(old.name.clone()),
                    after: Some(new.name.clone()),
                    ..self.entry_difference(new, Change::Renamed)
                });
            }
            let value = names.in_old(&new.value);
            if old.value != value {
                let mut walk = Walk { section: self, items: [old, new], names, found };
                walk.entry(&old.value, &value);
            }
        }
        let matched: HashSet<usize> = pairs.values().copied().collect();
        for (index, new) in self.new.iter().enumerate() {
            if !matched.contains(&index) && !in_old.contains_key(&new.name) {
                found.push(self.entry_difference(new, Change::Added));
            }
        }
    }

    /// Returns the difference for an entry that exists only in the old or only in the new graph.
    fn entry_difference(&self, item: &Item, change: Change) -> Difference {
        let text = Some(item.show("", &item.value));
        let (before, after) = match change {
            Change::Removed => (text, None),
            _ => (None, text),
        };
        let (what, name) = (self.what, item.name.clone());
        let (field, inside) = (String::new(), Vec::new());
        Difference { what, name, change, field, before, after, inside }
    }
}

/// Matches removed entries with added entries that are equal except for their names.
struct RenameMatcher<'m> {
    section: &'m Section<'m>,
    removed: Vec<usize>,
    added: Vec<usize>,
    /// The matched pairs, as a map from the index of the old entry to the index of the new one.
    pairs: BTreeMap<usize, usize>,
}

impl RenameMatcher<'_> {
    /// Maximum number of rounds of exact matching. Each round can match entries that link to entries matched in the previous round.
    const MAX_ROUNDS: usize = 8;

    /// Maximum number of pairs of entries that are compared one by one.
    const MAX_PAIRS: usize = 1_000_000;

    fn run(&mut self, names: &mut RenamedNames) {
        let what = self.section.what;
        for _ in 0..Self::MAX_ROUNDS {
            let before = self.pairs.len();
            let (old, new) = (self.old_values(false), self.new_values(names, false));
            self.match_exact(&old, &new, names);
            if self.pairs.len() == before || self.removed.is_empty() {
                break;
            }
        }
        let (old, new) = (self.old_values(true), self.new_values(names, true));
        self.match_exact(&old, &new, names);
        // Do not match outputs: an output has no fields, and an output with another file name is a different output.
        if matches!(what, "output" | "use")
            || self.removed.len() * self.added.len() > Self::MAX_PAIRS
        {
            return;
        }
        self.match_nearest(names);
    }

    /// Returns the values of the old entries without a match.
    fn old_values(&self, loose: bool) -> Vec<Tree> {
        let values = self.removed.iter().map(|&index| self.section.old[index].value.clone());
        self.with_types_for_names(values, self.section.old, &self.removed, loose)
    }

    /// Returns the values of the new entries without a match, with new names replaced by old ones.
    fn new_values(&self, names: &RenamedNames, loose: bool) -> Vec<Tree> {
        let values = self.added.iter().map(|&index| names.in_old(&self.section.new[index].value));
        self.with_types_for_names(values, self.section.new, &self.added, loose)
    }

    /// If `loose` is set, replaces each link to an unmatched node by the type of that node.
    fn with_types_for_names(
        &self,
        values: impl Iterator<Item = Tree>,
        items: &[Item],
        open: &[usize],
        loose: bool,
    ) -> Vec<Tree> {
        if !loose || self.section.what != "node" {
            return values.collect();
        }
        let kinds: HashMap<&str, &str> =
            open.iter().map(|&index| (&items[index].name[..], items[index].kind())).collect();
        values
            .map(|value| rename(&value, &|name| Some(format!("?{}", kinds.get(name)?)), &|_| None))
            .collect()
    }

    /// Matches old and new entries with equal values, in order.
    fn match_exact(&mut self, old: &[Tree], new: &[Tree], names: &mut RenamedNames) {
        let mut waiting: HashMap<String, Vec<usize>> = HashMap::new();
        for (value, &index) in new.iter().zip(&self.added).rev() {
            waiting.entry(show(value)).or_default().push(index);
        }
        let pairs = old.iter().zip(&self.removed).filter_map(|(value, &index)| {
            let new = waiting.get_mut(&show(value)).and_then(Vec::pop)?;
            Some((index, new))
        });
        for (old, new) in Vec::from_iter(pairs) {
            self.add_pair(old, new, names);
        }
    }

    /// Matches entries of one type whose similarity is at least 0.5, the most similar pairs first.
    fn match_nearest(&mut self, names: &mut RenamedNames) {
        let (old, new) = (self.old_values(true), self.new_values(names, true));
        let mut scored = Vec::new();
        for (a, &gone) in old.iter().zip(&self.removed) {
            for (b, &come) in new.iter().zip(&self.added) {
                let likeness = similarity(a, b);
                if likeness >= 0.5 {
                    scored.push((likeness, gone, come));
                }
            }
        }
        scored.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (_, gone, come) in scored {
            if self.removed.contains(&gone) && self.added.contains(&come) {
                self.add_pair(gone, come, names);
            }
        }
    }

    fn add_pair(&mut self, old: usize, new: usize, names: &mut RenamedNames) {
        let Section { what, old: olds, new: news } = self.section;
        names.add(what, &news[new].name, &olds[old].name);
        self.removed.retain(|&index| index != old);
        self.added.retain(|&index| index != new);
        self.pairs.insert(old, new);
    }
}

/// Returns the fraction of fields that two values of one type have in common, from 0 to 1.
fn similarity(a: &Tree, b: &Tree) -> f64 {
    let (Kind::Call { name: a_name, .. }, Kind::Call { name: b_name, .. }) = (&a.kind, &b.kind)
    else {
        return 0.0;
    };
    if a_name != b_name {
        return 0.0;
    }
    let (a, b) = (a.fields().unwrap_or_default(), b.fields().unwrap_or_default());
    let same = a.iter().filter(|field| b.contains(field)).count();
    let only_b = b.iter().filter(|field| a.iter().all(|other| other.name != field.name)).count();
    let all = a.len() + only_b;
    if all == 0 { 1.0 } else { same as f64 / all as f64 }
}

/// Compares two values of one entry recursively.
struct Walk<'a, 'm> {
    section: &'a Section<'m>,
    /// The old entry and the new entry that are compared.
    items: [&'a Item; 2],
    names: &'a RenamedNames,
    found: &'a mut Vec<Difference>,
}

impl Walk<'_, '_> {
    fn entry(&mut self, old: &Tree, new: &Tree) {
        fn kind(tree: &Tree) -> Option<String> {
            match &tree.kind {
                Kind::Call { name: Some(name), .. } => Some(name.text.clone()),
                _ => None,
            }
        }
        match (kind(old), kind(new)) {
            (before, after) if before.is_some() && after.is_some() && before != after => {
                self.report(Change::Changed, "type", before, after);
            }
            _ => {}
        }
        fn is_call(tree: &Tree) -> bool {
            kind(tree).is_some() && tree.fields().is_some()
        }
        match is_call(old) && is_call(new) {
            true => self.fields(old, new, ""),
            false => self.value(Some(old), Some(new), String::new()),
        }
    }

    fn fields(&mut self, old: &Tree, new: &Tree, path: &str) {
        let (old, new) = (old.fields().unwrap_or_default(), new.fields().unwrap_or_default());
        for field in old {
            let other = new.iter().find(|other| other.name == field.name);
            let path = join_path(path, &field.name.text);
            self.value(Some(&field.value), other.map(|other| &other.value), path);
        }
        for field in new.iter().filter(|field| old.iter().all(|other| other.name != field.name)) {
            self.value(None, Some(&field.value), join_path(path, &field.name.text));
        }
    }

    fn value(&mut self, old: Option<&Tree>, new: Option<&Tree>, path: String) {
        if old == new {
            return;
        }
        if let (Some(old), Some(new)) = (old, new) {
            match (&old.kind, &new.kind) {
                (
                    Kind::Call { name: a, body: Body::Items(old) },
                    Kind::Call { name: b, body: Body::Items(new) },
                ) if a == b && a.is_none() && old.len() == new.len() => {
                    return self.items(old, new, &path);
                }
                (Kind::List(old), Kind::List(new)) if old.len() == new.len() => {
                    return self.items(old, new, &path);
                }
                (Kind::Call { name: a, .. }, Kind::Call { name: b, .. })
                    if a == b && old.fields().is_some() && new.fields().is_some() =>
                {
                    return self.fields(old, new, &path);
                }
                _ => {}
            }
        }
        let links = old.is_some_and(has_link) || new.is_some_and(has_link);
        let change = if links { Change::Rewired } else { Change::Changed };
        let before = old.map(|old| self.items[0].show(&path, old));
        let after = new.map(|new| self.items[1].show(&path, &self.names.in_new(new)));
        // Values with equal texts may differ: one text is treated as a link and the other is not. Such a difference is not reported.
        if before == after {
            return;
        }
        self.report(change, &path, before, after);
    }

    fn items(&mut self, old: &[Tree], new: &[Tree], path: &str) {
        for (index, (old, new)) in old.iter().zip(new).enumerate() {
            self.value(Some(old), Some(new), join_path(path, &index.to_string()));
        }
    }

    fn report(
        &mut self,
        change: Change,
        field: &str,
        before: Option<String>,
        after: Option<String>,
    ) {
        let (what, name) = (self.section.what, self.items[1].name.clone());
        let field = field.to_owned();
        let inside = Vec::new();
        self.found.push(Difference { what, name, change, field, before, after, inside });
    }
}
