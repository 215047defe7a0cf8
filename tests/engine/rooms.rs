//! Checks the dependencies between source files, which are found from `use` lines and paths. They must have no cycles in packs, and only
//! the root file of a pack may name the file of a node.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

mod sources;

use sources::{Arrow, Sources};

#[test]
fn no_file_of_the_nodes_depends_on_itself_round_others() {
    let mut count = 0;
    for pack in packs() {
        let arrows = arrows_between(Sources::read(&pack).arrows(), |file| file.to_owned());
        let circles = circles(&arrows);
        assert!(circles.is_empty(), "{}:\n{}", pack.display(), circles.join("\n"));
        count += arrows.len();
    }
    assert!(count > 300, "only {count} arrows were found");
}

#[test]
fn nobody_but_the_root_of_its_pack_names_the_file_of_a_node() {
    let mut count = 0;
    for pack in packs() {
        let sources = Sources::read(&pack);
        let named = named_nodes(&sources);
        assert!(named.is_empty(), "{}:\n{}", pack.display(), named.join("\n"));
        count += sources.files_with(&NODE).count();
    }
    assert!(count > 40, "only {count} nodes were found");
}

/// For each crate of the engine, the crates on which it may depend.
const CRATES: [(&str, &[&str]); 16] = [
    ("value", &[]),
    ("syntax", &["value"]),
    ("node", &["syntax", "value"]),
    ("format", &["node", "syntax", "value"]),
    ("render", &["format", "node", "syntax", "value"]),
    ("graph", &["node", "syntax", "value"]),
    ("edit", &["graph", "node", "syntax", "value"]),
    ("remote", &[]),
    ("engine", &["graph", "node", "remote", "syntax", "value"]),
    ("diagram", &["edit", "graph", "node", "syntax", "value"]),
    ("golden", &["engine", "format", "graph", "node", "render", "syntax", "value"]),
    ("lsp", &["edit", "engine", "golden", "graph", "node", "syntax", "value"]),
    (
        "preview",
        &["diagram", "edit", "engine", "format", "graph", "node", "render", "syntax", "value"],
    ),
    (
        "cli",
        &[
            "diagram", "edit", "engine", "format", "golden", "graph", "lsp", "node", "preview",
            "render", "syntax", "value",
        ],
    ),
    (
        "maquette",
        &[
            "diagram", "edit", "engine", "format", "golden", "graph", "node", "render", "syntax",
            "value",
        ],
    ),
    ("program", &["cli", "engine", "nodes"]),
];

/// For each crate, the maximum number of files (without the root) that depend on each other in a cycle. These numbers must not increase.
const KNOTS: [(&str, usize); 16] = [
    ("value", 24),
    ("syntax", 7),
    ("node", 2),
    ("format", 15),
    ("render", 2),
    ("graph", 4),
    ("edit", 3),
    ("remote", 2),
    ("engine", 18),
    ("diagram", 0),
    ("golden", 7),
    ("lsp", 4),
    ("preview", 4),
    ("cli", 4),
    ("maquette", 0),
    ("program", 0),
];

#[test]
fn no_crate_of_the_engine_stands_on_another_than_it_may() {
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir(folder().join("src")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let manifest = folder().join("src").join(&name).join("Cargo.toml");
        let manifest = std::fs::read_to_string(manifest).unwrap();
        let needed = manifest.split("[dev-dependencies]").next().unwrap_or_default();
        let needed = needed.lines().filter_map(|line| line.strip_prefix("maquette-"));
        let needed = needed.filter_map(|rest| rest.split('.').next());
        let (_, allowed) = CRATES.iter().find(|(known, _)| *known == name).expect(&name);
        let wrong: Vec<_> = needed.filter(|other| !allowed.contains(other)).collect();
        assert!(wrong.is_empty(), "{name} may not stand on {wrong:?}");
        found.insert(name);
    }
    assert_eq!(found.len(), CRATES.len(), "{found:?}");
}

#[test]
fn few_files_of_a_crate_depend_on_each_other_in_circles() {
    let mut wrong = Vec::new();
    for (name, most) in KNOTS {
        let root = if name == "program" { "main.rs" } else { "lib.rs" };
        let sources = Sources::read_from(&folder().join("src").join(name), root);
        let arrows = arrows_between(sources.arrows(), |file| file.to_owned());
        let arrows = arrows.into_iter().filter(|arrow| arrow.from != root && arrow.to != root);
        let arrows = Vec::from_iter(arrows);
        let knot = largest_knot(&arrows);
        if knot.len() > most {
            wrong.push(format!("{name}: {} files, {knot:?}", knot.len()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Returns the largest set of files that all depend on each other, directly or through other files. Returns an empty set if there are none.
fn largest_knot(arrows: &[Arrow]) -> BTreeSet<&str> {
    let reached = |from: &str| {
        let (mut seen, mut next) = (BTreeSet::new(), vec![from.to_owned()]);
        while let Some(file) = next.pop() {
            for arrow in arrows.iter().filter(|arrow| arrow.from == file) {
                if seen.insert(&*arrow.to) {
                    next.push(arrow.to.clone());
                }
            }
        }
        seen
    };
    let files = BTreeSet::from_iter(arrows.iter().map(|arrow| &*arrow.from));
    let all = BTreeMap::from_iter(files.iter().map(|file| (*file, reached(file))));
    files
        .iter()
        .map(|file| {
            let both = all[file]
                .iter()
                .filter(|other| all.get(*other).is_some_and(|back| back.contains(file)));
            BTreeSet::from_iter(both.copied())
        })
        .max_by_key(BTreeSet::len)
        .unwrap_or_default()
}

#[test]
fn a_circle_is_found_however_it_is_written() {
    let left = "pub struct Left; fn f(_: super::Other) {}";
    for back in [
        "use super::a::Left;",
        "use crate::pack::{self, Left};",
        "use crate::{pack::{a::{Left, self}}};",
        "use super::{super::pack::Left as L};",
        "use super::a::*;",
        "use super::a; fn f() -> a::Left {}",
        "use crate::pack; fn f(x: &'static str) { let '\"' = \"\\\"//\" else { pack::Left } }",
        "fn f() { let x = crate::pack::a::Left; }",
        "#[cfg(test)] mod tests { use super::*; } pub fn x() { super::Left::new() }",
    ] {
        let sources = pack(left, &format!("pub struct Right; {back}"));
        let arrows = arrows_between(sources.arrows(), |file| file.to_owned());
        assert_eq!(circles(&arrows), ["pack/a.rs -> pack/b.rs -> pack/a.rs"], "{back}");
        // The two files are in the same folder. If only dependencies between folders are compared, there is no cycle.
        let rooms = arrows_between(sources.arrows(), |file| file[..4].to_owned());
        assert_eq!(circles(&rooms), [""; 0], "{back}");
    }
    for harmless in [
        "#[cfg(test)] use super::Left;",
        "#[cfg(test)] #[expect(x)] mod tests { fn f() { super::super::Left } }",
        "#[cfg(test)] mod tests;",
        "// use super::Left;\n/* use super::a; /* and */ super::Left */",
        "const TEXT: &str = r#\"use \"super::Left\"#; const BYTES: &[u8] = b\"super::Left\";",
        "pub(in crate::pack) fn x() {}",
        "use std::collections::BTreeMap; use pack::Left;",
    ] {
        let sources = pack(left, &format!("pub struct Right; {harmless}"));
        let arrows = arrows_between(sources.arrows(), |file| file.to_owned());
        assert_eq!(circles(&arrows), [""; 0], "{harmless}");
    }
}

#[test]
fn who_names_a_node_is_found_however_it_is_written() {
    let node = "pub struct Left; impl Node for Left {}";
    fn arrows_of(other: &str, node: &str) -> Vec<String> {
        let root = "mod a; mod b; pub use {a::Left, b::Right as Other};";
        let right = format!("pub struct Right; {other}");
        let files = [("lib.rs", root), ("a.rs", node), ("b.rs", &right)];
        named_nodes(&sources(&files))
    }
    for bad in ["use super::Left;", "pub use super::a::Left;", "fn f(_: crate::Left) {}"] {
        assert_eq!(arrows_of(bad, node).len(), 1, "{bad}");
    }
    assert_eq!(arrows_of("#[cfg(test)] mod tests { use super::super::Left; }", node), [""; 0]);
}

/// Creates a crate with a module `pack`, which re-exports the items of its two files.
fn pack(left: &str, right: &str) -> Sources {
    let files = [
        ("lib.rs", "pub mod pack; const A: char = '{';"),
        ("pack.rs", "mod a; mod b; pub use {a::Left, b::Right as Other};"),
        ("pack/a.rs", left),
        ("pack/b.rs", right),
    ];
    sources(&files)
}

fn sources(files: &[(&str, &str)]) -> Sources {
    Sources::parse(&|name| files.iter().find(|file| file.0 == name).map(|file| file.1.to_owned()))
}

/// Returns the folders of the packs, and of the libraries that they use.
fn packs() -> Vec<PathBuf> {
    let inside = std::fs::read_dir(folder().join("nodes")).unwrap();
    let mut packs: Vec<_> = inside.map(|entry| entry.unwrap().path()).collect();
    packs.retain(|path| path.is_dir());
    packs.sort();
    packs
}

/// The tokens by which a file that defines a node is recognized.
const NODE: [&str; 3] = ["impl", "Node", "for"];

/// Lists the paths to items of nodes' files that are written anywhere except in the root file of the pack.
fn named_nodes(sources: &Sources) -> Vec<String> {
    let nodes = Vec::from_iter(sources.files_with(&NODE));
    let mut named = Vec::from_iter(sources.arrows_with_reexports());
    named.retain(|arrow| nodes.contains(&arrow.to) && arrow.from != "lib.rs");
    named
        .into_iter()
        .map(|Arrow { from, to, path, line }| {
            format!("{from}:{line} names {path}, which stands in a node's file, {to}")
        })
        .collect()
}

/// Returns the dependencies between different groups of files. `room` returns the name of the group of a file.
fn arrows_between(
    arrows: impl Iterator<Item = Arrow>,
    room: impl Fn(&str) -> String,
) -> Vec<Arrow> {
    arrows
        .map(|arrow| Arrow { from: room(&arrow.from), to: room(&arrow.to), ..arrow })
        .filter(|arrow| arrow.from != arrow.to)
        .collect()
}

/// For each file that is part of a cycle, finds the shortest cycle through it. Returns each cycle once.
fn circles(arrows: &[Arrow]) -> Vec<String> {
    let mut found = Vec::new();
    let mut told = BTreeSet::new();
    let rooms = BTreeSet::from_iter(arrows.iter().map(|arrow| &arrow.from));
    for start in rooms {
        let mut ways = vec![vec![start]];
        let mut seen = BTreeSet::new();
        let mut next = 0;
        while next < ways.len() && !told.contains(start) {
            let way = ways[next].clone();
            next += 1;
            let last = way[way.len() - 1];
            for to in arrows.iter().filter(|arrow| arrow.from == *last).map(|arrow| &arrow.to) {
                if to == start {
                    told.extend(way.iter().copied());
                    let names: Vec<_> = way.iter().chain([&start]).map(|name| &***name).collect();
                    found.push(names.join(" -> "));
                    next = ways.len();
                    break;
                }
                if seen.insert(to) {
                    ways.push(way.iter().copied().chain([to]).collect());
                }
            }
        }
    }
    found
}

/// Returns the root folder of the workspace.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}
