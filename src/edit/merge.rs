//! Three-way merge of the edits that two people have made to one graph, based on its structure instead of its lines.
//!
//! Texts are merged part by part: fields of the graph, entries of its sections, fields of nodes, and so on to the innermost part that has a
//! name. If only one side changed a part, its version is taken. A conflict arises only if both sides changed the same part in different
//! ways. If one side renamed a part, the part is first renamed in all three texts.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_graph::diff::Change;
use maquette_graph::tree::entries;
use maquette_graph::{Difference, Files, Graph, Options};
use maquette_syntax::error::{Diagnostic, Severity, Source};
use maquette_syntax::{
    LineEnding, Tree, edit_with_trailing_commas, parse, syntax_diagnostics, with_trailing_commas,
};

use super::minimal::removable_fields;
use super::rename_in;

mod align;
mod changed_expressions;
mod comments;
mod lines;
mod parts;
mod sides;
mod units;

use changed_expressions::{changed_expressions, entries_of};
use comments::{comments, has_wrong_comments, merge_gaps};
use lines::merge_lines;
use parts::{Interpretation, Value};
use sides::{Merger, RenamedTwice};
use units::plain_numbers;

/// The result of merging two edits of a graph file.
#[derive(Clone, Debug)]
pub struct Merge {
    /// The merged text. Conflicts are marked as in git.
    pub text: String,
    /// The paths of the conflicts, such as `nodes.red.select.distance`. The empty path is the whole text.
    pub conflicts: Vec<String>,
    /// If there are no conflicts: the errors of the merged text that neither side has. Also errors for expressions whose meaning the merge
    /// would change, which are marked as conflicts, and syntax errors of texts that cannot be parsed.
    pub diagnostics: Vec<Diagnostic>,
    /// True if the texts were merged by lines, as in git, because one of them cannot be parsed or because comments could not be assigned to
    /// parts.
    pub by_lines: bool,
}

/// An entry that one side has renamed, in a section such as `nodes`.
#[derive(PartialEq)]
struct Renaming {
    section: &'static str,
    old: String,
    new: String,
}

/// Merges the versions `ours` and `theirs` of the text `base`. `path` is the path of the file; paths of used graphs are relative to its
/// folder.
///
/// The names, comments and formatting of our text are kept. Parts that the other side has changed or added are copied from its text. If one
/// of the texts is not RON, the texts are merged by lines.
pub fn merge(path: &Path, [base, ours, theirs]: [&Source; 3], catalog: &Catalog) -> Merge {
    let named = MergeContext { path, catalog };
    let texts = [base, ours, theirs].map(|source| &source.text[..]);
    let ends = match LineEnding::detect(texts[0]) == LineEnding::detect(texts[1]) {
        true => LineEnding::detect(texts[2]),
        false => LineEnding::detect(texts[1]),
    };
    let texts = texts.map(|text| match ends {
        Some(_) => LineEnding::detect(text).unwrap_or(LineEnding::Windows).normalize(text),
        None => text.to_owned(),
    });
    let texts = texts.each_ref().map(|text| &text[..]);
    let behind = texts.map(with_trailing_commas);
    let behind = behind.each_ref().map(|text| &text[..]);
    let mut errors = Vec::new();
    for source in [ours, theirs] {
        errors.extend(syntax_diagnostics(&source.name, &source.text, parse(&source.text).1));
    }
    let mut merged = match named.merge_by_structure(behind) {
        Ok(merged) if errors.is_empty() => merged,
        Err(diagnostics) if errors.is_empty() => merge_lines(texts, diagnostics),
        _ => merge_lines(texts, errors),
    };
    if !merged.by_lines && merged.conflicts.is_empty() {
        let text = edit_with_trailing_commas(texts[1], |_| Ok::<_, Infallible>(merged.text));
        merged.text = text.unwrap_or_else(|never| match never {});
    }
    if let Some(ends) = ends {
        merged.text = ends.apply(merged.text);
    }
    if merged.conflicts.is_empty() && merged.diagnostics.is_empty() {
        merged.diagnostics = named.new_errors(&merged.text, [ours, theirs].map(|it| &it.text[..]));
    }
    merged
}

/// The three texts of a merge (base, ours, theirs), after each renamed part has been given the same name in all of them.
struct UnifiedNames {
    texts: [String; 3],
    renamed_twice: Vec<RenamedTwice>,
    /// Names, such as `nodes.red`, that one side has given to a renamed entry and the other side to a new entry.
    taken: BTreeSet<String>,
}

/// Returns the names that one side has given to a renamed entry, and the other side to a new entry.
fn taken_names(
    [base, ours, theirs]: [&str; 3],
    by_us: &[Renaming],
    by_them: &[Renaming],
) -> BTreeSet<String> {
    fn has(text: &str, section: &str, name: &str) -> bool {
        let (tree, _) = parse(text);
        let fields = tree.fields().unwrap_or_default();
        // Nodes and inputs share one namespace, so search both sections.
        let sections: &[_] = if section == "params" { &["params"] } else { &["nodes", "inputs"] };
        sections.iter().any(|section| entries(fields, section).any(|(known, _)| known == name))
    }
    let mut taken = BTreeSet::new();
    for (renamed, others, other) in [(by_us, by_them, theirs), (by_them, by_us, ours)] {
        for it @ Renaming { section, new, .. } in renamed {
            if !others.contains(it) && !has(base, section, new) && has(other, section, new) {
                taken.insert(format!("{section}.{new}"));
            }
        }
    }
    taken
}

/// The context of a merge: the path of the file, and the catalog of node types.
#[derive(Clone, Copy)]
struct MergeContext<'a> {
    path: &'a Path,
    catalog: &'a Catalog,
}

impl MergeContext<'_> {
    /// Merges the texts by structure. The result has not been checked.
    ///
    /// # Errors
    /// One of the texts cannot be parsed, or comments cannot be assigned to parts. The error contains the diagnostics found so far.
    fn merge_by_structure(self, texts: [&str; 3]) -> Result<Merge, Vec<Diagnostic>> {
        if texts.iter().any(|text| !parse(text).1.is_empty()) {
            return Err(Vec::new());
        }
        let UnifiedNames { texts: same, renamed_twice: twice, taken } =
            self.unify_names(texts).map_err(|_| Vec::new())?;
        let texts = same.each_ref().map(|text| &text[..]);
        let (mut text, mut conflicts) = self.merge_texts(texts, &twice, &taken);
        let mut diagnostics = Vec::new();
        if conflicts.is_empty() {
            let trees = texts.map(|text| parse(text).0);
            let turned = changed_expressions(trees.each_ref(), &parse(&text).0);
            if !turned.is_empty() {
                (text, conflicts) = self.merge_texts(texts, &twice, &entries_of(&turned));
                diagnostics = turned.iter().map(|it| it.diagnostic(self.path, &text)).collect();
            }
        }
        if has_wrong_comments(texts, &text, !conflicts.is_empty()) {
            return Err(diagnostics);
        }
        Ok(Merge { text, conflicts, diagnostics, by_lines: false })
    }

    /// Merges texts after renamed parts have been given the same names. Returns the merged text and the conflicts. Entries in
    /// `kept_separate` are always conflicts.
    fn merge_texts(
        self,
        texts: [&str; 3],
        renamed_twice: &[RenamedTwice],
        kept_separate: &BTreeSet<String>,
    ) -> (String, Vec<String>) {
        let trees = texts.map(|text| parse(text).0);
        let means = [0, 1, 2].map(|k| Interpretation {
            defaults: self.default_offsets(texts[k]),
            numbers: plain_numbers(self.path, texts[k], &trees[k], self.catalog),
        });
        let [before, left, right] =
            [0, 1, 2].map(|k| Value { text: texts[k], tree: &trees[k], interpretation: &means[k] });
        let known = BTreeSet::from_iter(comments(texts[0]));
        let mut merger = Merger { renamed_twice, kept_separate, known, conflicts: Vec::new() };
        let whole = merger.merge_root(before, left, right);
        fn merge_outside(
            part: fn(&str, &Tree) -> String,
            texts: &[&str; 3],
            trees: &[Tree; 3],
        ) -> String {
            let [base, ours, theirs] = [0, 1, 2].map(|k| part(texts[k], &trees[k]));
            merge_gaps(&base, &ours, &theirs)
        }
        let above = merge_outside(|text, tree| text[..tree.span.start].to_owned(), &texts, &trees);
        let below = merge_outside(|text, tree| text[tree.span.end..].to_owned(), &texts, &trees);
        let mut conflicts = merger.conflicts;
        conflicts.dedup();
        (format!("{above}{whole}{below}"), conflicts)
    }

    /// Returns the byte offsets of the fields whose values equal their defaults.
    fn default_offsets(self, text: &str) -> BTreeSet<usize> {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let cuts = removable_fields(self.path, text, self.catalog, &options);
        cuts.into_iter().map(|cut| cut.start).collect()
    }

    /// Applies the renames of each side to all three texts.
    fn unify_names(self, texts: [&str; 3]) -> Result<UnifiedNames, Vec<Diagnostic>> {
        let [mut base, mut ours, mut theirs] = texts.map(str::to_owned);
        let (mut by_us, mut by_them) =
            (self.find_renames(&base, &ours)?, self.find_renames(&base, &theirs)?);
        let mut twice = Vec::new();
        let taken = taken_names(texts, &by_us, &by_them);
        for renames in [&mut by_us, &mut by_them] {
            renames.retain(|it| !taken.contains(&format!("{}.{}", it.section, it.new)));
        }
        for Renaming { section, old, new } in &by_them {
            let other = by_us.iter().find(|other| other.section == *section && other.old == *old);
            let known = other.map_or(old, |other| &other.new);
            if known != new {
                ours = self.rename_entry(ours, section, known, new);
            }
            base = self.rename_entry(base, section, old, new);
            if other.is_some() && known != new {
                let (old, theirs, ours) = (old.clone(), new.clone(), known.clone());
                twice.push(RenamedTwice { section, old, theirs, ours });
            }
        }
        for Renaming { section, old, new } in &by_us {
            if by_them.iter().all(|other| other.section != *section || other.old != *old) {
                base = self.rename_entry(base, section, old, new);
                theirs = self.rename_entry(theirs, section, old, new);
            }
        }
        Ok(UnifiedNames { texts: [base, ours, theirs], renamed_twice: twice, taken })
    }

    /// Returns the entries that were renamed between an old and a new text.
    fn find_renames(self, old: &str, new: &str) -> Result<Vec<Renaming>, Vec<Diagnostic>> {
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
                is_renamed.then_some(Renaming { section, old: found.before?, new: found.after? })
            })
            .collect())
    }

    /// Renames an entry in a text. Returns the text unchanged if it has no such entry, or if the new name is already in use.
    fn rename_entry(self, text: String, section: &str, old: &str, new: &str) -> String {
        let (tree, _) = parse(&text);
        let mut known = entries(tree.fields().unwrap_or_default(), section);
        if known.any(|(name, _)| name == new) {
            return text;
        }
        let from = format!("{section}.{old}");
        rename_in(self.path, &text, &from, new, self.catalog).unwrap_or(text)
    }

    fn diagnostics(self, text: &str) -> Vec<Diagnostic> {
        let options = Options { files: Files::Ignored, ..Options::default() };
        Graph::load_text(self.path, text.to_owned(), self.catalog, &options).diagnostics
    }

    /// Returns the errors of a text that do not occur in the two other texts.
    fn new_errors(self, text: &str, others: [&str; 2]) -> Vec<Diagnostic> {
        let known: Vec<_> = others.into_iter().flat_map(|other| self.diagnostics(other)).collect();
        let mut found = self.diagnostics(text);
        found.retain(|diagnostic| {
            diagnostic.severity == Severity::Error
                && known
                    .iter()
                    .all(|it| (it.code, &it.message) != (diagnostic.code, &diagnostic.message))
        });
        found
    }
}
