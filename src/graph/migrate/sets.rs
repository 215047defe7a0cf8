//! Migration of outdated names in the values that tests set.

use std::path::PathBuf;

use maquette_syntax::{Kind, Tree, parse, quote};
use maquette_value::fs::read_text;

use super::migrated_values::migrate_target;
use super::{Splice, apply, rewrite_value};
use crate::catalog::Catalog;
use crate::patch::patched_tree;
use crate::tree::entries;
use crate::{Files, Graph, Options};

impl Graph {
    /// Migrates the fields that a test sets in the given graphs to their current names. Returns the text of the test.
    pub fn migrate_test(text: &str, graphs: &[PathBuf], catalog: &Catalog) -> String {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let graphs: Vec<_> = graphs
            .iter()
            .filter_map(|path| {
                let text = read_text(path).ok()?;
                Some(patched_tree(path, text, catalog, &options))
            })
            .collect();
        apply(text, test_splices(&parse(text).0, &graphs, text, catalog))
    }
}

/// Returns the edits that migrate all maps `set` in a test. `graphs` are the tested graphs.
fn test_splices(test: &Tree, graphs: &[Tree], text: &str, catalog: &Catalog) -> Vec<Splice> {
    let mut splices = Vec::new();
    for (_, case) in entries(test.fields().unwrap_or_default(), "cases") {
        for field in case.fields().unwrap_or_default() {
            let ("set", Kind::Map(set)) = (&field.name.text[..], &field.value.kind) else {
                continue;
            };
            for (key, value) in set {
                let Some(target) = key.text() else { continue };
                let Some((now, renewed)) =
                    graphs.iter().find_map(|graph| migrate_target(graph, target, value, catalog))
                else {
                    continue;
                };
                if now != target {
                    splices.push((key.span, quote(&now)));
                }
                rewrite_value(value, &renewed.value, text, &mut splices);
            }
        }
    }
    splices
}
