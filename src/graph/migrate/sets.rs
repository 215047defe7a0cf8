//! Old names in what tests set.

use std::path::PathBuf;

use maquette_syntax::{Kind, Tree, parse, quoted};
use maquette_value::plain::read_text;

use super::puts::renewed_target;
use super::{Splice, apply, written};
use crate::catalog::Catalog;
use crate::patch::patched_tree;
use crate::tree::entries;
use crate::{Files, Graph, Options};

impl Graph {
    /// The text of a test of some graphs with the new names of all fields that it sets.
    pub fn migrated_test(text: &str, graphs: &[PathBuf], catalog: &Catalog) -> String {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let graphs: Vec<_> = graphs
            .iter()
            .filter_map(|path| {
                let text = read_text(path).ok()?;
                Some(patched_tree(path, text, catalog, &options))
            })
            .collect();
        apply(text, of_test(&parse(text).0, &graphs, text, catalog))
    }
}

/// The edits of the map that a test `set`s, of which each graph that it is about is given.
fn of_test(test: &Tree, graphs: &[Tree], text: &str, catalog: &Catalog) -> Vec<Splice> {
    let mut splices = Vec::new();
    for (_, case) in entries(test.fields().unwrap_or_default(), "cases") {
        for field in case.fields().unwrap_or_default() {
            let ("set", Kind::Map(set)) = (&field.name.text[..], &field.value.kind) else {
                continue;
            };
            for (key, value) in set {
                let Some(target) = key.text() else { continue };
                let Some((now, renewed)) =
                    graphs.iter().find_map(|graph| renewed_target(graph, target, value, catalog))
                else {
                    continue;
                };
                if now != target {
                    splices.push((key.span, quoted(&now)));
                }
                written(value, &renewed.value, text, &mut splices);
            }
        }
    }
    splices
}
