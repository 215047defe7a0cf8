//! Edits and patches can set an item of a `ForEach` list, with a target such as `copies/1.scale`. If the value must be set elsewhere, the
//! error says where.

use std::path::Path;

use maquette::{Catalog, Edit, Graph, Options};
use maquette_nodes::PACKS;

const GRAPH: &str = r#"Graph(format: 1, use: { "Lib": "lib.ron" }, nodes: {
    "net": PointNet(points: [[(0, 0, 0), (1, 0, 1)], [(0, 1, 1), (1, 1, 2)]]), "s": Nurbs(net: "net"), "m": Tessellate(surface: "s"),
    "c": ForEach(graph: "Transform", over: [(translate: (1, 0, 0)), ()], with: (mesh: "m", rotate: (0, 9, 0))),
    "parts": ForEach(graph: "Transform", over: Parts("m")),
    "libs": ForEach(graph: "Lib", over: [(mesh: "m")]), "lib": Lib(mesh: "m"),
}, outputs: { "1.ply": "c/1", "2.ply": "c/2", "3.ply": "parts/1", "4.ply": "lib", "5.ply": "libs/1" })"#;

const LIB: &str = r#"Graph(format: 1, inputs: { "mesh": Mesh(doc: "It.") }, params: { "x": Number(default: 1, unit: "mm") },
    nodes: { "moved": Transform(mesh: "mesh", translate: (Param("x"), 0, 0)) }, outputs: { "moved": "moved" })"#;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("graph.ron"), GRAPH).unwrap();
    std::fs::write(folder.path().join("lib.ron"), LIB).unwrap();
    folder
}

/// Sets a value. Returns the new text and the name of the target in it, or the error.
fn set(path: &Path, target: &str, value: &str) -> Result<(String, String), String> {
    let edit = Edit::Set { target: target.to_owned(), value: value.to_owned() };
    let text = std::fs::read_to_string(path).unwrap();
    let edited =
        maquette::edit::edit(path, &text, &[edit], &Catalog::new(PACKS), &Options::default());
    edited.map(|it| (it.text, it.changes[0].target.clone())).map_err(
        |problems: Vec<maquette::Diagnostic>| {
            assert_eq!(problems.len(), 1, "{problems:?}");
            format!("{} ({})", problems[0].message, problems[0].help)
        },
    )
}

#[test]
fn an_element_of_a_list_is_set_where_it_stands() {
    let folder = folder();
    let path = folder.path().join("graph.ron");
    let now = GRAPH.replace("translate: (1, 0, 0)", "translate: (2, 0, 0)");
    assert_eq!(set(&path, "c/1.translate", "(2, 0, 0)"), Ok((now, "c.over.0.translate".into())));
    let now = GRAPH.replace("translate: (1, 0, 0)", "translate: (1, 7, 0)");
    assert_eq!(set(&path, "c/1.translate.1", "7"), Ok((now, "c.over.0.translate.1".into())));
    let now = GRAPH.replace(", ()]", ", (scale: (2, 2, 2))]");
    assert_eq!(set(&path, "c/2.scale", "(2, 2, 2)"), Ok((now, "c.over.1.scale".into())));
}

#[test]
fn what_has_no_place_in_the_file_says_where_it_is_set() {
    let folder = folder();
    let path = folder.path().join("graph.ron");
    let refused = [
        ("c/3.scale", "the graph has no node `c/3` (the elements of `c` are `c/1` to `c/2`)"),
        (
            "c/2.rotate.1",
            "`c/2` has no `rotate` of its own, but that of all elements (set the whole field: c/2.rotate=VALUE; or set that of all elements: c.with.rotate.1=VALUE)",
        ),
        (
            "parts/1.scale",
            "the graph has no node `parts/1` (elements have no names in the file; set all of them: parts.with.scale=VALUE)",
        ),
        (
            "lib/moved.scale",
            "`lib/moved` is inside the graph that `lib` uses (change it in lib.ron, or set a parameter of it: lib.NAME=VALUE)",
        ),
        (
            "libs/1/moved.scale",
            "`libs/1/moved` is inside the graph that `libs` repeats (change it in lib.ron, or set a parameter of it: libs/1.NAME=VALUE)",
        ),
    ];
    for (target, said) in refused {
        let told = set(&path, target, "(2, 2, 2)").unwrap_err();
        assert_eq!(told, format!("{target}=(2, 2, 2): {said}"));
    }
}

#[test]
fn a_patch_knows_the_elements_of_a_list() {
    let folder = folder();
    let path = folder.path().join("patch.ron");
    fn text(entry: &str) -> String {
        format!(r#"Patch(format: 1, of: "graph.ron", nodes: {{ {entry} }})"#)
    }
    fn load(entry: &str, path: &Path) -> maquette::CheckedGraph {
        std::fs::write(path, text(entry)).unwrap();
        Graph::load(path, &Catalog::new(PACKS), &Options::default())
    }
    let by_name = load(r#""c/1": (scale: (2, 2, 2))"#, &path);
    assert!(by_name.graph.is_some(), "{:?}", by_name.diagnostics);
    let wrong = load(r#""parts/1": (scale: (2, 2, 2))"#, &path).diagnostics;
    assert_eq!(wrong.len(), 1, "{wrong:?}");
    assert!(wrong[0].help.contains("parts.with.scale=VALUE"), "{wrong:?}");
    assert_eq!(&wrong[0].source.text[wrong[0].span.start..][..9], "\"parts/1\"");
    load("", &path);
    let (now, target) = set(&path, "c/1.scale", "(2, 2, 2)").unwrap();
    assert_eq!(target, "c.over.0.scale");
    assert_eq!(now, text(r#""c.over.0": (scale: (2, 2, 2))"#));
}
