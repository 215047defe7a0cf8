//! Two people's edits of one graph, put together by what they say.
//!
//! Texts are merged part by part: fields of the graph, entries of its sections, fields of nodes, as deep as parts have names. What
//! one of them changed is taken; both must have changed the same part, differently, for a conflict. What has another name on one
//! side gets it everywhere first.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_graph::diff::Change;
use maquette_graph::tree::entries;
use maquette_graph::{Difference, Files, Graph, Options};
use maquette_syntax::error::{Problem, Severity, Source};
use maquette_syntax::{Ends, Tree, commas_behind, parse, syntax_problems, with_commas_behind};

use super::minimal::cuts;
use super::renamed_in;

mod align;
mod lines;
mod notes;
mod parts;
mod readings;
mod sides;
mod units;

use lines::by_lines;
use notes::{around, comments, is_amiss};
use parts::{Means, Value};
use readings::{entries_of, turned};
use sides::{Merger, RenamedTwice};
use units::plain_numbers;

/// What two people's edits of a graph file give.
#[derive(Clone, Debug)]
pub struct Merge {
    /// The text, with conflicts marked as git marks them.
    pub text: String,
    /// Where both changed the same, differently: `nodes.red.select.distance`; empty for the whole text.
    pub conflicts: Vec<String>,
    /// Errors of the new text that neither of both has, which is checked if there are no conflicts; expressions in conflicts that would
    /// say something else; mistakes in the texts that could not be read.
    pub problems: Vec<Problem>,
    /// Whether lines were merged, as git does, because a text cannot be read, or comments cannot be put where they belong.
    pub by_lines: bool,
}

/// What was renamed: the section, the old name, and the new one.
type Renamed = (&'static str, String, String);

/// What `ours` and `theirs` have made of `base`, as one text. `path` is where the file belongs, for the graphs that it uses.
///
/// Names, comments and the form of our text stay; what they changed and added is as they wrote it. If one of the texts is no RON,
/// lines are merged.
pub fn merge(path: &Path, [base, ours, theirs]: [&Source; 3], catalog: &Catalog) -> Merge {
    let named = Named { path, catalog };
    let texts = [base, ours, theirs].map(|source| &source.text[..]);
    let ends = match Ends::of(texts[0]) == Ends::of(texts[1]) {
        true => Ends::of(texts[2]),
        false => Ends::of(texts[1]),
    };
    let texts = texts.map(|text| match ends {
        Some(_) => Ends::of(text).unwrap_or(Ends::Windows).plain(text),
        None => text.to_owned(),
    });
    let texts = texts.each_ref().map(|text| &text[..]);
    let behind = texts.map(commas_behind);
    let behind = behind.each_ref().map(|text| &text[..]);
    let mut mistakes = Vec::new();
    for source in [ours, theirs] {
        mistakes.extend(syntax_problems(&source.name, &source.text, parse(&source.text).1));
    }
    let mut merged = match named.by_meaning(behind) {
        Ok(merged) if mistakes.is_empty() => merged,
        Err(problems) if mistakes.is_empty() => by_lines(texts, problems),
        _ => by_lines(texts, mistakes),
    };
    if !merged.by_lines && merged.conflicts.is_empty() {
        let text = with_commas_behind(texts[1], |_| Ok::<_, Infallible>(merged.text));
        merged.text = text.unwrap_or_else(|never| match never {});
    }
    if let Some(ends) = ends {
        merged.text = ends.put(merged.text);
    }
    if merged.conflicts.is_empty() && merged.problems.is_empty() {
        merged.problems = named.new_problems(&merged.text, [ours, theirs].map(|it| &it.text[..]));
    }
    merged
}

/// Three texts in which what was renamed has one name.
struct SameNames {
    texts: [String; 3],
    renamed_twice: Vec<RenamedTwice>,
    /// Entries under a name that one side gave to another entry, and the other side to a new one: `nodes.red`.
    taken: BTreeSet<String>,
}

/// Names that one side gives to what it renames, and the other side to something else.
fn taken_names(
    [base, ours, theirs]: [&str; 3],
    by_us: &[Renamed],
    by_them: &[Renamed],
) -> BTreeSet<String> {
    fn has(text: &str, section: &str, name: &str) -> bool {
        let (tree, _) = parse(text);
        let fields = tree.fields().unwrap_or_default();
        // Nodes and inputs share their names.
        let sections: &[_] = if section == "params" { &["params"] } else { &["nodes", "inputs"] };
        sections.iter().any(|section| entries(fields, section).any(|(known, _)| known == name))
    }
    let mut taken = BTreeSet::new();
    for (renamed, others, other) in [(by_us, by_them, theirs), (by_them, by_us, ours)] {
        for it @ (section, _, new) in renamed {
            if !others.contains(it) && !has(base, section, new) && has(other, section, new) {
                taken.insert(format!("{section}.{new}"));
            }
        }
    }
    taken
}

/// Where texts of a graph belong, and what their words mean.
#[derive(Clone, Copy)]
struct Named<'a> {
    path: &'a Path,
    catalog: &'a Catalog,
}

impl Named<'_> {
    /// The texts as one by what they say. The result is not checked yet.
    ///
    /// # Errors
    /// One of them cannot be read, or comments cannot be put where they belong, with the problems that are known by then.
    fn by_meaning(self, texts: [&str; 3]) -> Result<Merge, Vec<Problem>> {
        if texts.iter().any(|text| !parse(text).1.is_empty()) {
            return Err(Vec::new());
        }
        let SameNames { texts: same, renamed_twice: twice, taken } =
            self.same_names(texts).map_err(|_| Vec::new())?;
        let texts = same.each_ref().map(|text| &text[..]);
        let (mut text, mut conflicts) = self.put_together(texts, &twice, &taken);
        let mut problems = Vec::new();
        if conflicts.is_empty() {
            let trees = texts.map(|text| parse(text).0);
            let turned = turned(trees.each_ref(), &parse(&text).0);
            if !turned.is_empty() {
                (text, conflicts) = self.put_together(texts, &twice, &entries_of(&turned));
                problems = turned.iter().map(|it| it.problem(self.path, &text)).collect();
            }
        }
        if is_amiss(texts, &text, !conflicts.is_empty()) {
            return Err(problems);
        }
        Ok(Merge { text, conflicts, problems, by_lines: false })
    }

    /// The texts, which have the same names, as one, and where both do not agree. Some entries are kept apart in any case.
    fn put_together(
        self,
        texts: [&str; 3],
        renamed_twice: &[RenamedTwice],
        kept_apart: &BTreeSet<String>,
    ) -> (String, Vec<String>) {
        let trees = texts.map(|text| parse(text).0);
        let means = [0, 1, 2].map(|k| Means {
            defaults: self.defaults(texts[k]),
            numbers: plain_numbers(self.path, texts[k], &trees[k], self.catalog),
        });
        let [before, left, right] =
            [0, 1, 2].map(|k| Value { text: texts[k], tree: &trees[k], means: &means[k] });
        let known = BTreeSet::from_iter(comments(texts[0]));
        let mut merger = Merger { renamed_twice, kept_apart, known, conflicts: Vec::new() };
        let whole = merger.whole(before, left, right);
        fn outside(
            part: fn(&str, &Tree) -> String,
            texts: &[&str; 3],
            trees: &[Tree; 3],
        ) -> String {
            let [base, ours, theirs] = [0, 1, 2].map(|k| part(texts[k], &trees[k]));
            around(&base, &ours, &theirs)
        }
        let above = outside(|text, tree| text[..tree.span.start].to_owned(), &texts, &trees);
        let below = outside(|text, tree| text[tree.span.end..].to_owned(), &texts, &trees);
        let mut conflicts = merger.conflicts;
        conflicts.dedup();
        (format!("{above}{whole}{below}"), conflicts)
    }

    /// Where the fields of a text begin that would say the same if they were left out.
    fn defaults(self, text: &str) -> BTreeSet<usize> {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let cuts = cuts(self.path, text, self.catalog, &options);
        cuts.into_iter().map(|cut| cut.start).collect()
    }

    /// Gives what one side has renamed its new name in all texts.
    fn same_names(self, texts: [&str; 3]) -> Result<SameNames, Vec<Problem>> {
        let [mut base, mut ours, mut theirs] = texts.map(str::to_owned);
        let (mut by_us, mut by_them) = (self.renamed(&base, &ours)?, self.renamed(&base, &theirs)?);
        let mut twice = Vec::new();
        let taken = taken_names(texts, &by_us, &by_them);
        let is_free = |(section, _, new): &Renamed| !taken.contains(&format!("{section}.{new}"));
        by_us.retain(is_free);
        by_them.retain(is_free);
        for (section, old, new) in &by_them {
            let other = by_us.iter().find(|other| other.0 == *section && other.1 == *old);
            let known = other.map_or(old, |(_, _, name)| name);
            if known != new {
                ours = self.with_name(ours, section, known, new);
            }
            base = self.with_name(base, section, old, new);
            if other.is_some() && known != new {
                let (old, theirs, ours) = (old.clone(), new.clone(), known.clone());
                twice.push(RenamedTwice { section, old, theirs, ours });
            }
        }
        for (section, old, new) in &by_us {
            if by_them.iter().all(|other| other.0 != *section || other.1 != *old) {
                base = self.with_name(base, section, old, new);
                theirs = self.with_name(theirs, section, old, new);
            }
        }
        Ok(SameNames { texts: [base, ours, theirs], renamed_twice: twice, taken })
    }

    /// What has another name in the new text.
    fn renamed(self, old: &str, new: &str) -> Result<Vec<Renamed>, Vec<Problem>> {
        fn source(text: &str, path: &Path) -> Source {
            Source { name: path.to_owned(), text: text.to_owned() }
        }
        let found =
            Graph::differences(&source(old, self.path), &source(new, self.path), self.catalog)?;
        Ok(found
            .into_iter()
            .filter_map(|found: Difference| {
                let section = match found.what {
                    "node" => "nodes",
                    "input" => "inputs",
                    "parameter" => "params",
                    _ => return None,
                };
                let is_renamed = found.change == Change::Renamed;
                is_renamed.then_some((section, found.before?, found.after?))
            })
            .collect())
    }

    /// The text with another name of something in it; as it is if it has no such thing, or has the new name already.
    fn with_name(self, text: String, section: &str, old: &str, new: &str) -> String {
        let (tree, _) = parse(&text);
        let mut known = entries(tree.fields().unwrap_or_default(), section);
        if known.any(|(name, _)| name == new) {
            return text;
        }
        let from = format!("{section}.{old}");
        renamed_in(self.path, &text, &from, new, self.catalog).unwrap_or(text)
    }

    /// The errors of a text that none of two others has.
    fn new_problems(self, text: &str, others: [&str; 2]) -> Vec<Problem> {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let problems = |text: &str| {
            Graph::load_text(self.path, text.to_owned(), self.catalog, &options).problems
        };
        let known: Vec<_> = others.into_iter().flat_map(problems).collect();
        let mut found = problems(text);
        found.retain(|problem| {
            let is_known =
                |it: &Problem| (it.code, &it.message) == (problem.code, &problem.message);
            problem.severity == Severity::Error && !known.iter().any(is_known)
        });
        found
    }
}
