//! Which file of the sources names which, read from their `use` lines and paths: no file depends on itself round others, and
//! the file of a node is named by the root of its pack alone.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

mod sources;

use sources::{Arrow, Sources};

#[test]
fn no_file_of_the_nodes_depends_on_itself_round_others() {
    let mut count = 0;
    for pack in packs() {
        let arrows = between(Sources::read(&pack).arrows(), |file| file.to_owned());
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

/// The rooms of the engine, and which others each may name. Arrows lead downwards: to what knows less.
const ROOMS: [(&str, &[&str]); 36] = [
    ("base64", &[]),
    (
        "batch",
        &[
            "base64", "catalog", "error", "eval", "files", "graph", "node", "paths", "plain",
            "render", "session", "stamp", "telling", "text", "value", "writing",
        ],
    ),
    ("catalog", &["error", "format", "node", "pack", "plain", "reading", "text", "value"]),
    (
        "cli",
        &[
            "batch",
            "catalog",
            "draw",
            "error",
            "eval",
            "files",
            "format",
            "golden",
            "graph",
            "language",
            "lsp",
            "memory",
            "node",
            "pack",
            "page",
            "paths",
            "plain",
            "probe",
            "provenance",
            "render",
            "session",
            "suite",
            "telling",
            "text",
            "value",
            "watch",
            "writing",
        ],
    ),
    (
        "conformance",
        &[
            "catalog", "error", "eval", "graph", "node", "pack", "random", "reading", "text",
            "value",
        ],
    ),
    ("draw", &["catalog", "error", "graph"]),
    ("error", &[]),
    (
        "eval",
        &[
            "base64",
            "catalog",
            "error",
            "files",
            "graph",
            "limit",
            "memory",
            "node",
            "pack",
            "parallel",
            "paths",
            "plain",
            "provenance",
            "reading",
            "stamp",
            "text",
            "value",
            "writing",
        ],
    ),
    ("files", &["error", "node", "plain", "reading", "stamp", "value"]),
    (
        "format",
        &[
            "base64",
            "error",
            "memory",
            "pack",
            "parallel",
            "provenance",
            "reading",
            "render",
            "text",
            "value",
        ],
    ),
    (
        "golden",
        &[
            "catalog", "error", "format", "graph", "pack", "parallel", "paths", "plain", "random",
            "render", "text", "value",
        ],
    ),
    (
        "graph",
        &[
            "catalog", "error", "files", "node", "pack", "paths", "plain", "reading", "stamp",
            "text", "value",
        ],
    ),
    ("language", &[]),
    ("limit", &[]),
    (
        "lsp",
        &[
            "batch", "catalog", "error", "eval", "golden", "graph", "language", "paths", "plain",
            "session", "suite", "text", "value",
        ],
    ),
    ("memory", &[]),
    (
        "page",
        &["catalog", "draw", "format", "graph", "plain", "probe", "render", "value", "writing"],
    ),
    ("parallel", &["memory"]),
    ("node", &["error", "limit", "plain", "reading", "text", "value"]),
    ("pack", &["error", "memory", "node", "parallel", "plain", "provenance", "reading", "value"]),
    ("paths", &["text"]),
    ("plain", &[]),
    ("probe", &["render", "text", "value"]),
    ("provenance", &[]),
    ("random", &[]),
    ("reading", &["error", "paths", "plain", "value"]),
    ("render", &["parallel", "simd", "value"]),
    (
        "session",
        &[
            "catalog",
            "error",
            "eval",
            "files",
            "golden",
            "graph",
            "node",
            "pack",
            "parallel",
            "plain",
            "stamp",
            "text",
            "value",
            "writing",
            "paths",
            "provenance",
        ],
    ),
    ("simd", &[]),
    ("stamp", &[]),
    (
        "suite",
        &[
            "base64", "batch", "catalog", "error", "eval", "format", "golden", "graph", "pack",
            "plain", "render", "session", "telling", "text", "value", "writing",
        ],
    ),
    ("telling", &["error"]),
    ("text", &["error", "plain", "value"]),
    ("value", &["memory", "parallel", "simd"]),
    ("watch", &[]),
    ("writing", &["graph", "paths", "plain", "stamp"]),
];

#[test]
fn no_room_of_the_engine_names_another_than_it_may() {
    let sources = Sources::read(&folder().join("src"));
    let room = |file: &str| file.split(['/', '.']).next().unwrap_or_default().to_owned();
    let arrows = between(sources.arrows(), room);
    assert!(arrows.len() > 500, "only {} arrows were found", arrows.len());
    let may = |arrow: &Arrow| {
        let allowed = ROOMS.iter().find(|(name, _)| *name == arrow.from);
        allowed.is_some_and(|(_, rooms)| rooms.contains(&&arrow.to[..]))
    };
    let wrong =
        arrows.iter().filter(|arrow| arrow.from != "lib" && arrow.to != "lib" && !may(arrow));
    let told = |arrow: &Arrow| format!("{}: {} (line {})", arrow.from, arrow.path, arrow.line);
    let wrong = Vec::from_iter(wrong.map(told));
    assert!(wrong.is_empty(), "the table in this test does not allow:\n{}", wrong.join("\n"));
    let allowed = ROOMS.iter().flat_map(|(from, rooms)| {
        let arrow = |to: &&str| Arrow {
            from: (*from).to_owned(),
            to: (*to).to_owned(),
            path: String::new(),
            line: 0,
        };
        rooms.iter().map(arrow)
    });
    assert_eq!(circles(&Vec::from_iter(allowed)), [""; 0], "the table itself has a circle");
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
        let arrows = between(sources.arrows(), |file| file.to_owned());
        assert_eq!(circles(&arrows), ["pack/a.rs -> pack/b.rs -> pack/a.rs"], "{back}");
        // In one room there is none.
        let rooms = between(sources.arrows(), |file| file[..4].to_owned());
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
        let arrows = between(sources.arrows(), |file| file.to_owned());
        assert_eq!(circles(&arrows), [""; 0], "{harmless}");
    }
}

#[test]
fn who_names_a_node_is_found_however_it_is_written() {
    let node = "pub struct Left; impl Node for Left {}";
    let named = |other: &str| {
        let root = "mod a; mod b; pub use {a::Left, b::Right as Other};";
        let right = format!("pub struct Right; {other}");
        let files = [("lib.rs", root), ("a.rs", node), ("b.rs", &right)];
        named_nodes(&sources(&files))
    };
    for bad in ["use super::Left;", "pub use super::a::Left;", "fn f(_: crate::Left) {}"] {
        assert_eq!(named(bad).len(), 1, "{bad}");
    }
    assert_eq!(named("#[cfg(test)] mod tests { use super::super::Left; }"), [""; 0]);
}

/// A crate with two files in a pack, which hands on both.
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
    Sources::of(&|name| files.iter().find(|file| file.0 == name).map(|file| file.1.to_owned()))
}

/// The folders of the packs, and of what they stand on.
fn packs() -> Vec<PathBuf> {
    let inside = std::fs::read_dir(folder().join("nodes")).unwrap();
    let mut packs = Vec::from_iter(inside.map(|entry| entry.unwrap().path()));
    packs.retain(|path| path.is_dir());
    packs.sort();
    packs
}

/// What the file of a node has.
const NODE: [&str; 3] = ["impl", "Node", "for"];

/// Who names the file of a node and is not the root of its pack.
fn named_nodes(sources: &Sources) -> Vec<String> {
    let nodes = Vec::from_iter(sources.files_with(&NODE));
    let mut named = Vec::from_iter(sources.arrows_with_reexports());
    named.retain(|arrow| nodes.contains(&arrow.to) && arrow.from != "lib.rs");
    let tell = |Arrow { from, to, path, line }| {
        format!("{from}:{line} names {path}, which stands in a node's file, {to}")
    };
    named.into_iter().map(tell).collect()
}

/// The arrows that lead from one room to another, where `room` says in which room a file stands.
fn between(arrows: impl Iterator<Item = Arrow>, room: impl Fn(&str) -> String) -> Vec<Arrow> {
    arrows
        .map(|arrow| Arrow { from: room(&arrow.from), to: room(&arrow.to), ..arrow })
        .filter(|arrow| arrow.from != arrow.to)
        .collect()
}

/// The shortest way round from each room that lies on one, each circle once.
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
                    let names = Vec::from_iter(way.iter().chain([&start]).map(|name| &***name));
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

/// The workspace's folder.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}
