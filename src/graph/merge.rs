//! Two people's edits of one graph, put together by what they say.
//!
//! Texts are merged part by part: fields of the graph, entries of its sections, fields of nodes, as deep as parts have names. What
//! one of them changed is taken; both must have changed the same part, differently, for a conflict. What has another name on one
//! side gets it everywhere first.

use std::path::Path;

use super::diff::Change;
use super::edit::renamed_in;
use super::{Difference, Files, Graph, Options};
use crate::catalog::Catalog;
use crate::error::{Problem, Severity, Source};
use crate::text::{Tree, parse, syntax_problems};

mod parts;
mod sides;

use parts::Value;
use sides::{Merger, RenamedTwice, comments};

/// What two people's edits of a graph file give.
#[derive(Clone, Debug)]
pub struct Merge {
    /// The text, with conflicts marked as git marks them.
    pub text: String,
    /// Where both changed the same, differently: `nodes.red.select.distance`.
    pub conflicts: Vec<String>,
    /// Errors of the new text that neither of both has. Nothing is checked as long as there are conflicts.
    pub problems: Vec<Problem>,
}

/// What was renamed: the section, the old name, and the new one.
type Renamed = (&'static str, String, String);

impl Graph {
    /// What `ours` and `theirs` have made of `base`, as one text. `path` is where the file belongs, for the graphs that it uses.
    ///
    /// Names, comments and the form of our text stay; what they changed and added is as they wrote it.
    ///
    /// # Errors
    /// The mistakes in the texts, if one of them is no RON.
    pub fn merge(
        path: &Path,
        [base, ours, theirs]: [&str; 3],
        catalog: &Catalog,
    ) -> Result<Merge, Vec<Problem>> {
        let mut mistakes = Vec::new();
        for text in [base, ours, theirs] {
            mistakes.extend(syntax_problems(path, text, parse(text).1));
        }
        if !mistakes.is_empty() {
            return Err(mistakes);
        }
        let named = Named { path, catalog };
        let (texts, renamed_twice) = named.same_names([base, ours, theirs])?;
        let trees = texts.each_ref().map(|text| parse(text).0);
        let [before, left, right] = [0, 1, 2].map(|k| Value { text: &texts[k], tree: &trees[k] });
        let mut merger = Merger { renamed_twice: &renamed_twice, conflicts: Vec::new() };
        let whole = merger.whole(before, left, right);
        let around = |part: fn(&str, &Tree) -> String| {
            let [base, ours, theirs] = [0, 1, 2].map(|k| part(&texts[k], &trees[k]));
            comments(&base, &ours, &theirs)
        };
        let above = around(|text, tree| text[..tree.span.start].to_owned());
        let below = around(|text, tree| text[tree.span.end..].to_owned());
        let text = format!("{above}{whole}{below}");
        let mut conflicts = merger.conflicts;
        conflicts.dedup();
        let problems = match conflicts.is_empty() {
            true => named.new_problems(&text, [ours, theirs]),
            false => Vec::new(),
        };
        Ok(Merge { text, conflicts, problems })
    }
}

/// Where texts of a graph belong, and what their words mean.
#[derive(Clone, Copy)]
struct Named<'a> {
    path: &'a Path,
    catalog: &'a Catalog,
}

impl Named<'_> {
    /// The three texts with the new names of what one of both has renamed, and what both have, differently.
    fn same_names(
        self,
        texts: [&str; 3],
    ) -> Result<([String; 3], Vec<RenamedTwice>), Vec<Problem>> {
        let [mut base, mut ours, mut theirs] = texts.map(str::to_owned);
        let (by_us, by_them) = (self.renamed(&base, &ours)?, self.renamed(&base, &theirs)?);
        let mut twice = Vec::new();
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
        Ok(([base, ours, theirs], twice))
    }

    /// What has another name in the new text.
    fn renamed(self, old: &str, new: &str) -> Result<Vec<Renamed>, Vec<Problem>> {
        let source = |text: &str| Source { name: self.path.to_owned(), text: text.to_owned() };
        let found = Graph::differences(&source(old), &source(new), self.catalog)?;
        let renamed = |found: Difference| {
            let section = match found.what {
                "node" => "nodes",
                "input" => "inputs",
                "parameter" => "params",
                _ => return None,
            };
            let is_renamed = found.change == Change::Renamed;
            is_renamed.then_some((section, found.before?, found.after?))
        };
        Ok(found.into_iter().filter_map(renamed).collect())
    }

    /// The text with another name of something in it; as it is if it has no such thing, or has the new name already.
    fn with_name(self, text: String, section: &str, old: &str, new: &str) -> String {
        let (tree, _) = parse(&text);
        let mut known = super::meaning::entries(tree.fields().unwrap_or_default(), section);
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
        let known = Vec::from_iter(others.into_iter().flat_map(problems));
        let mut found = problems(text);
        found.retain(|problem| {
            let is_known =
                |it: &Problem| (it.code, &it.message) == (problem.code, &problem.message);
            problem.severity == Severity::Error && !known.iter().any(is_known)
        });
        found
    }
}
