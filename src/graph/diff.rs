//! How two graphs differ in what they say.
//!
//! Entries are matched by name. What is left on both sides is matched as renamed: first what says exactly the same, then, best
//! first, what is of one type and says half of it the same. Links to renamed nodes, and names of renamed parameters, count as
//! the same.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;

use maquette_syntax::error::{Problem, Source};
use maquette_syntax::paths::project_root;
use maquette_syntax::{Body, Kind, Tree, parse, syntax_problems};
use serde_json::json;

use super::describe::Subgraph;
use super::meaning::{Item, Meaning, SECTIONS, has_link, renamed};
use super::migrate::renewed_graph;
use super::patch::patched_tree;
use super::rebase::seen_from;
use super::{Files, Graph, Options};
use crate::catalog::Catalog;
use crate::load::first;
use crate::options::folder_of;
use crate::tree::{is_patch, joined, show};

/// One difference between two graphs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// `node`, `parameter`, `input`, `output`, `use` or `graph`.
    pub what: &'static str,
    /// Its name, the new one if it has two; empty for the graph itself.
    pub name: String,
    /// How it differs.
    pub change: Change,
    /// The field that differs, with dots; empty if it is the whole.
    pub field: String,
    /// What was there, as text.
    pub before: Option<String>,
    /// What is there now, as text.
    pub after: Option<String>,
    /// The graphs that lead to it, by the names that they are used by; empty in the graphs themselves.
    pub inside: Vec<String>,
}

/// How a part of a graph differs from that of another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// It is new.
    Added,
    /// It is gone.
    Removed,
    /// It has another name.
    Renamed,
    /// A link of it goes elsewhere.
    Rewired,
    /// A value of it is another one.
    Changed,
}

impl Change {
    /// The word in messages: `added` and so on.
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
    /// The difference as `maquette diff --json` prints it.
    pub fn to_json(&self) -> serde_json::Value {
        let mut told = json!({
            "what": self.what,
            "name": self.name,
            "change": self.change.word(),
            "field": self.field,
            "before": self.before,
            "after": self.after,
        });
        if !self.inside.is_empty() {
            told["inside"] = json!(self.inside);
        }
        told
    }
}

/// One line: `node red: changed select.distance: 30 -> 25`.
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
            value.as_deref().map(shortened)
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

/// A value as a line has room for it.
fn shortened(value: &str) -> String {
    const MOST: usize = 100;
    match value.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &value[..end]),
        None => value.to_owned(),
    }
}

impl Graph {
    /// How the graph `new` differs from `old` in what it says: spaces, comments, order, and values that are written out though
    /// they are the defaults, make no difference. The files that they read need not be there. In one project paths are compared by
    /// where they lead, and told relative to the old graph; between two, such as two checkouts, as they are written.
    ///
    /// # Errors
    /// The mistakes in the texts, if one of them is no RON.
    pub fn differences(
        old: &Source,
        new: &Source,
        catalog: &Catalog,
    ) -> Result<Vec<Difference>, Vec<Problem>> {
        let folder = folder_of(&old.name);
        let is_one_project = project_root(&folder) == project_root(&folder_of(&new.name));
        fn read(
            source: &Source,
            is_one_project: bool,
            folder: &std::path::Path,
            catalog: &Catalog,
        ) -> (Tree, Vec<Subgraph>, Vec<Problem>) {
            let (tree, mistakes) = parse(&source.text);
            let problems = syntax_problems(&source.name, &source.text, mistakes);
            let is_plain = tree.fields().is_some_and(|fields| {
                fields.iter().all(|field| field.name.text != "use" && field.name.text != "of")
            });
            let is_near = !is_one_project || folder_of(&source.name) == *folder;
            if is_plain && is_near || !problems.is_empty() {
                return (renewed_graph(&tree, catalog), Vec::new(), problems);
            }
            // The graphs that it uses say which of its values are defaults; a patch says what it is by the graph that it patches.
            let options = Options { files: Files::Ignored, ..Options::default() };
            let (path, text) = (&source.name, source.text.clone());
            let (graphs, _) = Graph::subgraphs_of(path, text.clone(), catalog, &options);
            let tree = match is_one_project {
                true => first(path, text, catalog, &options)
                    .1
                    .map_or(tree, |whole| parse(&seen_from(&whole.definition, folder)).0),
                false if is_patch(&tree) => patched_tree(path, text, catalog, &options),
                false => tree,
            };
            (renewed_graph(&tree, catalog), graphs, problems)
        }
        let ((old, mut old_graphs, mut problems), (new, mut new_graphs, others)) = (
            read(old, is_one_project, &folder, catalog),
            read(new, is_one_project, &folder, catalog),
        );
        Subgraph::make_comparable(&mut old_graphs, &mut new_graphs);
        let (old, new) =
            (Meaning::of(&old, catalog, &old_graphs), Meaning::of(&new, catalog, &new_graphs));
        problems.extend(others);
        if problems.is_empty() { Ok(compare(&old, &new)) } else { Err(problems) }
    }
}

fn compare(old: &Meaning, new: &Meaning) -> Vec<Difference> {
    let mut found = Vec::new();
    let added = new.rest.iter().filter(|item| old.rest.iter().all(|known| known.name != item.name));
    for Item { name, .. } in old.rest.iter().chain(added) {
        let item = |rest: &'_ [Item]| rest.iter().find(|item| item.name == *name).cloned();
        let (before, after) = (item(&old.rest), item(&new.rest));
        fn value(item: &Option<Item>) -> Option<Tree> {
            item.as_ref().map(|item| item.value.clone())
        }
        if value(&before) != value(&after) {
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
    let mut names = Names::default();
    for (section, (_, what)) in SECTIONS.iter().enumerate() {
        let section = Section { what, old: &old.sections[section], new: &new.sections[section] };
        section.compare(&mut names, &mut found);
    }
    found
}

/// What has another name in the new graph, by its new name.
#[derive(Default)]
struct Names {
    nodes: HashMap<String, String>,
    parameters: HashMap<String, String>,
}

impl Names {
    /// A value of the new graph in the old one's names.
    fn in_old(&self, tree: &Tree) -> Tree {
        renamed(tree, &|name| self.nodes.get(name).cloned(), &|name| {
            self.parameters.get(name).cloned()
        })
    }

    /// A value in the old graph's names in those of the new one.
    fn in_new(&self, tree: &Tree) -> Tree {
        fn back(names: &HashMap<String, String>, wanted: &str) -> Option<String> {
            let mut found = names.iter().filter(|(_, old)| *old == wanted);
            found.next().map(|(new, _)| new.clone())
        }
        renamed(tree, &|name| back(&self.nodes, name), &|name| back(&self.parameters, name))
    }

    fn add(&mut self, what: &str, new: &str, old: &str) {
        match what {
            "node" | "input" => self.nodes.insert(new.to_owned(), old.to_owned()),
            "parameter" => self.parameters.insert(new.to_owned(), old.to_owned()),
            _ => None,
        };
    }
}

/// One section of both graphs.
struct Section<'m> {
    what: &'static str,
    old: &'m [Item],
    new: &'m [Item],
}

impl Section<'_> {
    fn compare(&self, names: &mut Names, found: &mut Vec<Difference>) {
        fn places(items: &[Item]) -> HashMap<String, usize> {
            let items = items.iter().enumerate();
            items.map(|(index, item)| (item.name.clone(), index)).collect()
        }
        let (in_old, in_new) = (places(self.old), places(self.new));
        let gone = (0..self.old.len()).filter(|&k| !in_new.contains_key(&self.old[k].name));
        let come = (0..self.new.len()).filter(|&k| !in_old.contains_key(&self.new[k].name));
        let mut match_up = MatchUp {
            section: self,
            gone: gone.collect(),
            come: come.collect(),
            pairs: BTreeMap::new(),
        };
        match_up.run(names);
        let pairs = match_up.pairs;
        for (index, old) in self.old.iter().enumerate() {
            let renamed = pairs.get(&index).copied();
            let Some(new) = renamed.or_else(|| in_new.get(&old.name).copied()) else {
                found.push(self.whole(old, Change::Removed));
                continue;
            };
            let new = &self.new[new];
            if renamed.is_some() {
                found.push(Difference {
                    name: new.name.clone(),
                    before: Some(old.name.clone()),
                    after: Some(new.name.clone()),
                    ..self.whole(new, Change::Renamed)
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
                found.push(self.whole(new, Change::Added));
            }
        }
    }

    /// An entry that is only in one graph.
    fn whole(&self, item: &Item, change: Change) -> Difference {
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

/// Finds which of the entries that are gone are those that have come, under another name.
struct MatchUp<'m> {
    section: &'m Section<'m>,
    gone: Vec<usize>,
    come: Vec<usize>,
    /// Places of old and new entries.
    pairs: BTreeMap<usize, usize>,
}

impl MatchUp<'_> {
    /// Rounds of exact matches; each finds what hangs on the matches of the one before.
    const ROUNDS: usize = 8;

    /// More pairs than this are not compared one by one.
    const MOST_PAIRS: usize = 1_000_000;

    fn run(&mut self, names: &mut Names) {
        let what = self.section.what;
        for _ in 0..Self::ROUNDS {
            let before = self.pairs.len();
            let (old, new) = (self.old_values(false), self.new_values(names, false));
            self.exact(&old, &new, names);
            if self.pairs.len() == before || self.gone.is_empty() {
                break;
            }
        }
        let (old, new) = (self.old_values(true), self.new_values(names, true));
        self.exact(&old, &new, names);
        // An output has no fields, and another file than before is another output.
        if matches!(what, "output" | "use") || self.gone.len() * self.come.len() > Self::MOST_PAIRS
        {
            return;
        }
        self.nearest(names);
    }

    /// The old entries that have no match.
    fn old_values(&self, loose: bool) -> Vec<Tree> {
        let values = self.gone.iter().map(|&index| self.section.old[index].value.clone());
        self.loosened(values, self.section.old, &self.gone, loose)
    }

    /// The new entries that have no match, in the old graph's names.
    fn new_values(&self, names: &Names, loose: bool) -> Vec<Tree> {
        let values = self.come.iter().map(|&index| names.in_old(&self.section.new[index].value));
        self.loosened(values, self.section.new, &self.come, loose)
    }

    /// With `loose`, links to nodes that may be renamed themselves name the nodes' types instead.
    fn loosened(
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
        let kind = |name: &str| kinds.get(name).map(|kind| format!("?{kind}"));
        values.map(|value| renamed(&value, &kind, &|_| None)).collect()
    }

    /// Takes pairs that say exactly the same, in order.
    fn exact(&mut self, old: &[Tree], new: &[Tree], names: &mut Names) {
        let mut waiting: HashMap<String, Vec<usize>> = HashMap::new();
        for (value, &index) in new.iter().zip(&self.come).rev() {
            waiting.entry(show(value)).or_default().push(index);
        }
        let pairs = old.iter().zip(&self.gone).filter_map(|(value, &index)| {
            let new = waiting.get_mut(&show(value)).and_then(Vec::pop)?;
            Some((index, new))
        });
        for (old, new) in Vec::from_iter(pairs) {
            self.take(old, new, names);
        }
    }

    /// Takes pairs of one type that say at least half the same, best first.
    fn nearest(&mut self, names: &mut Names) {
        let (old, new) = (self.old_values(true), self.new_values(names, true));
        let mut scored = Vec::new();
        for (a, &gone) in old.iter().zip(&self.gone) {
            for (b, &come) in new.iter().zip(&self.come) {
                let likeness = likeness(a, b);
                if likeness >= 0.5 {
                    scored.push((likeness, gone, come));
                }
            }
        }
        scored.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (_, gone, come) in scored {
            if self.gone.contains(&gone) && self.come.contains(&come) {
                self.take(gone, come, names);
            }
        }
    }

    fn take(&mut self, old: usize, new: usize, names: &mut Names) {
        let Section { what, old: olds, new: news } = self.section;
        names.add(what, &news[new].name, &olds[old].name);
        self.gone.retain(|&index| index != old);
        self.come.retain(|&index| index != new);
        self.pairs.insert(old, new);
    }
}

/// Which part of their fields two values of one type have in common, 0 to 1.
fn likeness(a: &Tree, b: &Tree) -> f64 {
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

/// Compares two values of one entry, part by part.
struct Walk<'a, 'm> {
    section: &'a Section<'m>,
    /// Before and after.
    items: [&'a Item; 2],
    names: &'a Names,
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
            let path = joined(path, &field.name.text);
            self.value(Some(&field.value), other.map(|other| &other.value), path);
        }
        for field in new.iter().filter(|field| old.iter().all(|other| other.name != field.name)) {
            self.value(None, Some(&field.value), joined(path, &field.name.text));
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
        // What may be a link where the type is not known was one only as long as there was such a node.
        if before == after {
            return;
        }
        self.report(change, &path, before, after);
    }

    fn items(&mut self, old: &[Tree], new: &[Tree], path: &str) {
        for (index, (old, new)) in old.iter().zip(new).enumerate() {
            self.value(Some(old), Some(new), joined(path, &index.to_string()));
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
