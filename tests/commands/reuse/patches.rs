//! Patches: graphs that are other graphs with some values changed.

use expect_test::expect;
use maquette::{Catalog, Graph, Options, Source};

use super::folder::{DOLL, Folder, graph};

fn with_patch(patch: &str) -> Folder {
    let text = graph(
        r#""a": Moved(mesh: "doll", step: Param("far")), "out": Moved(mesh: "a", step: 2.0)"#,
    );
    let far = DOLL.replace("v 0 0 0", "v 100 0 0");
    Folder::new(&[
        ("base/graph.ron", &text.replace("lib/", "../lib/")),
        ("base/doll.obj", DOLL),
        ("doll.obj", &far),
        ("graph.ron", patch),
    ])
}

#[test]
fn a_patch_is_a_graph() {
    let folder = with_patch(
        r#"Patch(of: "base/graph.ron", params: { "far": 5.0 }, nodes: { "out": (step: 4.0) })"#,
    );
    assert_eq!(folder.x_of(&[], "out"), 9.0);
    assert_eq!(folder.x_of(&[("far", "1.0"), ("out.step", "0.5")], "out"), 1.5);
    assert_eq!(Vec::from_iter(folder.graph().output_names()), ["out.ply"]);
    let patch =
        r#"Patch(format: 1, doc: "Twice.", of: "base/graph.ron", nodes: { "a": (step: 3.5) })"#;
    let folder = with_patch(patch);
    assert_eq!(folder.x_of(&[], "out"), 5.5);
    assert_eq!(folder.graph().doc(), "Twice.");
}

#[test]
fn a_patch_of_a_patch_and_a_patch_that_is_used() {
    let folder = with_patch(r#"Patch(of: "first.ron", params: { "far": 7.0 })"#);
    let first =
        r#"Patch(of: "base/graph.ron", params: { "far": 5.0 }, nodes: { "out": (step: 4.0) })"#;
    std::fs::write(folder.path("first.ron"), first).unwrap();
    assert_eq!(folder.x_of(&[], "out"), 11.0);
    let moved = r#"Patch(of: "moved.ron", params: { "step": 9.0 })"#;
    std::fs::write(folder.path("lib/far.ron"), moved).unwrap();
    let text = graph(r#""out": Moved(mesh: "doll")"#).replace("lib/moved", "lib/far");
    std::fs::write(folder.path("graph.ron"), text).unwrap();
    assert_eq!(folder.x_of(&[], "out"), 109.0);
}

#[test]
fn a_path_in_a_patch_is_relative_to_the_patch() {
    let patch = r#"Patch(of: "base/graph.ron", nodes: { "doll": (path: "doll.obj") })"#;
    assert_eq!(with_patch(patch).x_of(&[], "doll"), 100.0);
    assert_eq!(
        with_patch(&patch.replace("\"doll.obj\"", "\"base/doll.obj\"")).x_of(&[], "doll"),
        0.0
    );
}

#[test]
fn a_patch_is_set_and_compared_like_a_graph() {
    let folder = with_patch(
        "Patch(\n    of: \"base/graph.ron\", // here\n    params: { \"far\": 5.0 },\n)\n",
    );
    let path = folder.path("graph.ron");
    let catalog = Catalog::new(maquette_nodes::PACKS);
    fn load_edited(
        text: &str,
        set: &[(&str, &str)],
        path: &std::path::Path,
        catalog: &Catalog,
    ) -> Result<maquette::EditedText, Vec<maquette::Diagnostic>> {
        let set: Vec<_> = set.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        maquette::edit::set_values(path, text, &set, catalog, &Options::default())
    }
    let text = std::fs::read_to_string(&path).unwrap();
    let new = load_edited(
        &text,
        &[("far", "6"), ("out.step", "1.5"), ("out.mesh", "doll")],
        &path,
        &catalog,
    )
    .unwrap()
    .text;
    expect![[r#"
        Patch(
            of: "base/graph.ron", // here
            params: { "far": 6 },
            nodes: { "out": (step: 1.5, mesh: "doll") },
        )
    "#]]
    .assert_eq(&new);
    assert!(load_edited(&text, &[("out.step", "99")], &path, &catalog).is_err());
    assert!(load_edited(&text, &[("ot.step", "1")], &path, &catalog).is_err());
    fn source(path: std::path::PathBuf, text: &str) -> Source {
        Source { name: path, text: text.to_owned() }
    }
    let base = std::fs::read_to_string(folder.path("base/graph.ron")).unwrap();
    let base = source(folder.path("base/graph.ron"), &base);
    let found = Graph::differences(&base, &source(path.clone(), &new), &catalog).unwrap();
    let lines: Vec<_> = found.iter().map(|found| format!("{found}\n")).collect();
    expect![[r#"
        parameter far: changed default: 3 -> 6
        node out: rewired mesh: "a" -> "doll"
        node out: changed step: 2 -> 1.5
    "#]]
    .assert_eq(&String::from_iter(lines));
}
