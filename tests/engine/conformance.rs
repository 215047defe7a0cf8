//! Checks that all packs, the built-in ones and a third-party one, satisfy the conformance laws.

use std::path::Path;
use std::sync::Mutex;
use std::thread;

use maquette::conformance::check;
use maquette::{Catalog, Graph, Options, Pack};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs/nodes");

fn holds(pack: &Pack, others: &[&Pack], examples: &str) {
    if let Err(broken) = check(pack, others, Path::new(examples)) {
        panic!("pack {} breaks {} laws:\n{}", pack.name, broken.len(), broken.join("\n"));
    }
}

#[test]
fn the_built_in_packs_keep_the_laws() {
    let (packs, broken) = (Mutex::new(maquette_nodes::PACKS.iter()), Mutex::new(Vec::new()));
    let next = || packs.lock().unwrap().next();
    let check_some = || {
        while let Some(pack) = next() {
            if let Err(laws) = check(pack, maquette_nodes::PACKS, Path::new(EXAMPLES)) {
                broken.lock().unwrap().push(format!("pack {}:\n{}", pack.name, laws.join("\n")));
            }
        }
    };
    // Check packs on two threads, because much of each check runs on a single thread.
    thread::scope(|scope| {
        scope.spawn(check_some);
        check_some();
    });
    let broken = broken.into_inner().unwrap();
    assert!(broken.is_empty(), "laws are broken:\n{}", broken.join("\n"));
}

#[test]
fn an_outsiders_pack_keeps_the_laws() {
    let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/third_party/graphs");
    holds(&maquette_third_party::PACK, maquette_nodes::PACKS, examples);
}

#[test]
fn a_pack_that_breaks_laws_is_found() {
    // This pack breaks two laws: its nodes exist in another pack, too, and it has no examples.
    let broken = Pack { name: "twin", ..maquette_third_party::PACK };
    let laws = check(&broken, &[&maquette_third_party::PACK], Path::new("nowhere")).unwrap_err();
    assert!(laws.contains(&"there are two nodes `ExtractPalette`".to_owned()), "{laws:?}");
    assert!(laws.contains(&"there are two values `Palette`".to_owned()), "{laws:?}");
    assert!(laws.iter().any(|law| law.contains("Posterize.ron does not check")), "{laws:?}");
}

#[test]
fn every_example_shows_a_node_and_every_node_has_one() {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    for path in crate::examples::examples() {
        let checked = Graph::load(&path, &catalog, &Options::default());
        let messages: Vec<_> = checked.diagnostics.iter().map(|problem| &problem.message).collect();
        assert!(messages.is_empty(), "{}: {messages:?}", path.display());
        let graph = checked.graph.unwrap();
        assert!(!graph.doc().is_empty(), "{} has no doc", path.display());
    }
}
