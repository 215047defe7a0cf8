//! Differences between the graphs that two compared graphs use as nodes. Used graphs are compared if they are in different files, as in two
//! checkouts of a project.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maquette_syntax::error::{Diagnostic, Source};
use maquette_syntax::{Tree, parse};
use maquette_value::fs;

use super::{Change, Difference, Graph};
use crate::catalog::Catalog;
use crate::options::folder_of;
use crate::tree::entries;

impl Graph {
    /// Returns the differences between two graphs. Continues recursively with used graphs that have the same name in both graphs and are in
    /// different files. Each pair of files is compared once.
    ///
    /// # Errors
    /// The errors of [`differences`](Self::differences) for the two graphs themselves. Used graphs that cannot be read are not compared.
    pub fn differences_with_uses(
        old: &Source,
        new: &Source,
        catalog: &Catalog,
    ) -> Result<Vec<Difference>, Vec<Diagnostic>> {
        let mut found = Self::differences(old, new, catalog)?;
        let mut walk = Uses { catalog, seen: BTreeSet::new(), found: &mut found };
        walk.follow(old, new, &[]);
        Ok(found)
    }
}

struct Uses<'a> {
    catalog: &'a Catalog,
    /// The pairs of files that have already been compared.
    seen: BTreeSet<(PathBuf, PathBuf)>,
    found: &'a mut Vec<Difference>,
}

impl Uses<'_> {
    fn follow(&mut self, old: &Source, new: &Source, inside: &[String]) {
        let (before, after) = (used_graphs(old), used_graphs(new));
        for (name, from) in &before {
            let Some((_, to)) = after.iter().find(|(other, _)| other == name) else { continue };
            if from == to || !self.seen.insert((from.clone(), to.clone())) {
                continue;
            }
            let (from, to) = match (source(from), source(to)) {
                (Some(from), Some(to)) => (from, to),
                (None, None) => continue,
                (from, to) => {
                    self.found.push(missing(name, inside, [from.is_some(), to.is_some()]));
                    continue;
                }
            };
            let inside = [inside, std::slice::from_ref(name)].concat();
            let found = Graph::differences(&from, &to, self.catalog).unwrap_or_default();
            let found = found.into_iter();
            self.found.extend(found.map(|it| Difference { inside: inside.clone(), ..it }));
            self.follow(&from, &to, &inside);
        }
    }
}

/// Returns the difference for a used graph whose file is missing for one of the two compared graphs.
fn missing(name: &str, inside: &[String], is_there: [bool; 2]) -> Difference {
    let [before, after] = is_there.map(|is_there| {
        let word = if is_there { "found" } else { "missing" };
        Some(word.to_owned())
    });
    let (name, field, inside) = (name.to_owned(), "file".to_owned(), inside.to_owned());
    Difference { what: "use", name, change: Change::Changed, field, before, after, inside }
}

fn source(path: &Path) -> Option<Source> {
    Some(Source { name: path.to_owned(), text: fs::read_text(path).ok()? })
}

/// Returns the names and files of the graphs that `source` uses. If `source` is a patch, returns the graphs that the patched graph uses.
/// The values in the patch itself are compared as part of the patch.
fn used_graphs(source: &Source) -> Vec<(String, PathBuf)> {
    used_graphs_within(source, MAX_PATCHES)
}

/// Maximum length of a chain of patches of patches. A limit is necessary, because cycles have not been detected at this point.
const MAX_PATCHES: usize = 64;

fn used_graphs_within(source: &Source, most: usize) -> Vec<(String, PathBuf)> {
    let (tree, _) = parse(&source.text);
    let fields = tree.fields().unwrap_or_default();
    fn path(tree: &Tree, source_name: &Path) -> Option<PathBuf> {
        let value = tree.call_of("Graph").unwrap_or(tree);
        let given = value.text().or_else(|| {
            value.fields()?.iter().find(|field| field.name.text == "path")?.value.text()
        })?;
        let path = folder_of(source_name).join(given);
        Some(std::fs::canonicalize(&path).unwrap_or(path))
    }
    if let Some(of) = fields.iter().find(|field| field.name.text == "of").filter(|_| 0 < most) {
        let patched = path(&of.value, &source.name).and_then(|path| self::source(&path));
        return patched.map(|patched| used_graphs_within(&patched, most - 1)).unwrap_or_default();
    }
    entries(fields, "use")
        .filter_map(|(name, value)| Some((name.to_owned(), path(value, &source.name)?)))
        .collect()
}
