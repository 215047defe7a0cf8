//! Tests the example of a merge: two people's versions of one graph.

use std::path::Path;

use maquette::{Catalog, Source};
use maquette_nodes::PACKS;

#[test]
fn the_sample_is_what_comes_of_both_sides() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/language/merge");
    let [base, ours, theirs, merged] =
        ["base.ron", "ours.ron", "theirs.ron", "merged.ron"].map(|name| {
            let name = folder.join(name);
            let text = std::fs::read_to_string(&name).unwrap();
            Source { name, text }
        });
    for [ours, theirs] in [[&ours, &theirs], [&theirs, &ours]] {
        let found =
            maquette::edit::merge(&merged.name, [&base, ours, theirs], &Catalog::new(PACKS));
        assert_eq!((found.conflicts.len(), found.diagnostics.len()), (0, 0), "{found:?}");
    }
    let found = maquette::edit::merge(&merged.name, [&base, &ours, &theirs], &Catalog::new(PACKS));
    assert_eq!(found.text, merged.text);
}
