//! How the graphs differ that two graphs use: where these lie in different places, as in two checkouts.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maquette_syntax::error::{Problem, Source};
use maquette_syntax::{Tree, parse};
use maquette_value::plain;

use super::{Change, Difference, Graph};
use crate::catalog::Catalog;
use crate::options::folder_of;
use crate::tree::entries;

impl Graph {
    /// How two graphs differ, and those that they use, in them and so on, where both have one under the same name in different files. A
    /// file that is used in several places is told of once.
    ///
    /// # Errors
    /// Those of [`differences`](Self::differences) for the graphs themselves; what cannot be read of others is not compared.
    pub fn differences_with_uses(
        old: &Source,
        new: &Source,
        catalog: &Catalog,
    ) -> Result<Vec<Difference>, Vec<Problem>> {
        let mut found = Self::differences(old, new, catalog)?;
        let mut walk = Uses { catalog, seen: BTreeSet::new(), found: &mut found };
        walk.follow(old, new, &[]);
        Ok(found)
    }
}

struct Uses<'a> {
    catalog: &'a Catalog,
    /// Pairs of files that have been compared.
    seen: BTreeSet<(PathBuf, PathBuf)>,
    found: &'a mut Vec<Difference>,
}

impl Uses<'_> {
    fn follow(&mut self, old: &Source, new: &Source, inside: &[String]) {
        let (before, after) = (used(old), used(new));
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

/// A used graph whose file only one side has.
fn missing(name: &str, inside: &[String], is_there: [bool; 2]) -> Difference {
    let [before, after] = is_there.map(|is_there| {
        let word = if is_there { "found" } else { "missing" };
        Some(word.to_owned())
    });
    let (name, field, inside) = (name.to_owned(), "file".to_owned(), inside.to_owned());
    Difference { what: "use", name, change: Change::Changed, field, before, after, inside }
}

fn source(path: &Path) -> Option<Source> {
    Some(Source { name: path.to_owned(), text: plain::read_text(path).ok()? })
}

/// The graphs that a text uses, by name. A patch uses those of the graph that it is of: all that
/// this one says itself is compared with the patch in it.
fn used(source: &Source) -> Vec<(String, PathBuf)> {
    used_through(source, MOST_PATCHES)
}

/// So many patches may be of each other: they are read before anybody knows whether they go round in a circle.
const MOST_PATCHES: usize = 64;

fn used_through(source: &Source, most: usize) -> Vec<(String, PathBuf)> {
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
        return patched.map(|patched| used_through(&patched, most - 1)).unwrap_or_default();
    }
    entries(fields, "use")
        .filter_map(|(name, value)| Some((name.to_owned(), path(value, &source.name)?)))
        .collect()
}
