//! Parameters whose defaults are computed from other parameters.

use std::path::Path;

use expect_test::{Expect, expect};
use maquette::{Catalog, Diagnostic, Edit, Extraction, Files, Graph, Options};

use crate::graph_files;

fn catalog() -> Catalog {
    Catalog::new(maquette_nodes::PACKS)
}

fn graph(params: &str, moved: &str) -> String {
    format!(
        "Graph(\n    format: 1,\n    params: {{\n{params}    }},\n    nodes: {{\n        \"mesh\": ReadMesh(path: \"doll.obj\"),\n        \"moved\": Transform(mesh: \"mesh\", translate: ({moved}, 0, 0)),\n    }},\n    outputs: {{ \"a.ply\": \"moved\" }},\n)\n"
    )
}

const WIDE: &str = r#"        "half": Number(default: Expr("width / 2 + 1"), max: 9.0, unit: "mm", doc: "h"),
        "width": Number(default: cm(1), unit: "mm", doc: "w"),
"#;

/// Loads a graph that moves a mesh. Returns the translation along x, or the diagnostics.
fn relocate(text: &str, options: &Options) -> Result<String, Vec<Diagnostic>> {
    let options = Options { files: Files::Ignored, ..options.clone() };
    let checked =
        Graph::load_text(Path::new("nowhere/graph.ron"), text.to_owned(), &catalog(), &options);
    let graph = checked.graph.ok_or(checked.diagnostics)?;
    let nodes = graph.nodes().iter();
    let found = nodes.map(|node| node.node.parameters().unwrap()["translate"][0].to_string());
    Ok(found.filter(|it| it != "null").collect::<Vec<_>>().join(" "))
}

fn set(values: &[(&str, &str)]) -> Options {
    let set = values.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
    Options { set: set.collect(), ..Options::default() }
}

#[test]
fn a_default_follows_what_it_is_computed_from() {
    let text = graph(WIDE, "Param(\"half\")");
    fn check(values: &[(&str, &str)], expected: &str, text: &str) {
        assert_eq!(relocate(text, &set(values)).unwrap(), expected, "{values:?}");
    }
    check(&[], "6.0", &text);
    check(&[("width", "4")], "3.0", &text);
    check(&[("width", "cm(0.4)")], "3.0", &text);
    check(&[("half", "2")], "2.0", &text);
    check(&[("half", "2"), ("width", "99")], "2.0", &text);
    let wrong = relocate(&text, &set(&[("width", "99")])).unwrap_err();
    assert_eq!(wrong[0].message, "parameter `half` is 50.5 mm, but must be at most 9 mm");
}

#[test]
fn long_chains_vectors_and_drafts_are_computed() {
    let chain =
        (0..5000).map(|k| format!("\"a-{k}\": Number(default: Expr(\"a-{} + 1\")),\n", k + 1));
    let chain = String::from_iter(chain) + "\"a-5000\": Number(default: 1.0),\n";
    assert_eq!(relocate(&graph(&chain, "Param(\"a-0\")"), &set(&[])).unwrap(), "5001.0");
    let both = "\"b\": Number(default: Draft(final: 4.0, draft: 1.0)), \"a\": Number(default: Expr(\"b * 2\")),\n";
    let text = graph(both, "Param(\"a\")");
    assert_eq!(relocate(&text, &set(&[])).unwrap(), "8.0");
    assert_eq!(relocate(&text, &Options { draft: true, ..Options::default() }).unwrap(), "2.0");
    let vector = "\"b\": Number(default: 4.0), \"v\": Vector(default: (Expr(\"b + 1\"), 0, Param(\"b\"))),\n";
    let text = graph(vector, "0").replace("(0, 0, 0)", "Param(\"v\")");
    assert_eq!(relocate(&text, &set(&[("b", "2")])).unwrap(), "3.0");
}

#[track_caller]
fn check(params: &str, expected: Expect) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, graph(params, "Param(\"a\")")).unwrap();
    std::fs::write(folder.path().join("doll.obj"), "").unwrap();
    let told = graph_files::problems(&path);
    expected.assert_eq(&told.replace(path.to_str().unwrap(), "graph.ron"));
}

#[test]
fn what_cannot_be_computed_is_told_at_its_place() {
    check(
        "\"a\": Number(default: Expr(\"b + 1\")),\n\"b\": Number(default: Expr(\"c * 2\")),\n\"c\": Number(default: Param(\"a\")),\n",
        expect![[r#"
            4:22-35 G008 cycle: a -> b -> c -> a (give one of them a number: `a` needs `b` at graph.ron:4:22, `b` needs `c` at graph.ron:5:22, `c` needs `a` at graph.ron:6:22)
        "#]],
    );
    check(
        "\"a\": Number(default: Expr(\"a + 1\")),\n",
        expect![[r#"
        4:22-35 G008 cycle: a -> a (give one of them a number: `a` needs `a` at graph.ron:4:22)
    "#]],
    );
    check(
        "\"a\": Number(default: Expr(\"b + 1\")), \"c\": Number(default: 1),\n",
        expect![[r#"
            4:27-34 G011 the graph has no parameter `b`
        "#]],
    );
    check(
        "\"a\": Number(default: Expr(\"b + 1\"), unit: \"mm\"), \"b\": Number(default: 1, unit: \"px\"),\n",
        expect![[r#"
            4:22-35 G009 parameter `a` is in mm, but `Expr("b + 1")` is in px (a plain number is in mm; other units of the same kind are converted)
        "#]],
    );
    check(
        "\"a\": Integer(default: Expr(\"b / 2\")), \"b\": Number(default: 1),\n",
        expect![[r#"
            4:23-36 G009 parameter `a`: expected a number without fraction, found the number 0.5
        "#]],
    );
    check(
        "\"a\": Number(default: Expr(\"max(b / b, 3)\")), \"b\": Number(default: 0),\n",
        expect![[r#"
            4:32-37 G011 `b / b` gives NaN, from 0 and 0 (give another value where it is 0: if(b == 0, 0, a / b))
        "#]],
    );
}

const INNER: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "m") },
    params: {
        "half": Number(default: Expr("width / 2"), max: 9.0, doc: "h"),
        "width": Number(default: 10.0, doc: "w"),
    },
    nodes: { "moved": Transform(mesh: "mesh", translate: (Param("half"), 0, 0)) },
    outputs: { "mesh": "moved" },
)
"#;

fn outer(fields: &str) -> String {
    format!(
        "Graph(\n    format: 1,\n    use: {{ \"Lift\": \"lift.ron\" }},\n    nodes: {{\n        \"mesh\": ReadMesh(path: \"doll.obj\"),\n        \"up\": Lift(mesh: \"mesh\"{fields}),\n    }},\n    outputs: {{ \"a.ply\": \"up\" }},\n)\n"
    )
}

#[test]
fn each_use_has_its_own_values() {
    let options = Options::default().with_text("nowhere/lift.ron", INNER.to_owned());
    fn check(fields: &str, expected: &str, options: &Options) {
        assert_eq!(relocate(&outer(fields), options).unwrap(), expected, "{fields}");
    }
    check("", "5.0", &options);
    check(", width: 6", "3.0", &options);
    check(", width: 6, half: 5.0", "5.0", &options);
    let wrong = relocate(&outer(", width: 60"), &options).unwrap_err();
    assert_eq!(wrong[0].message, "parameter `half` is 30, but must be at most 9");
    assert_eq!(wrong[0].uses[0].name, "up");
    // `half: 5.0` equals the default of `half` if `width` is omitted. But with `width: 6` the default is 3, so `half: 5.0` must not be
    // removed.
    let text = outer(", width: 6, half: 5.0");
    let options = Options { files: Files::Ignored, ..options };
    let short =
        maquette::edit::minimal(Path::new("nowhere/graph.ron"), &text, &catalog(), &options);
    assert!(short.unwrap().contains("half: 5.0"));
    let inlined = maquette::edit::inline(
        Path::new("nowhere/graph.ron"),
        &outer(", width: 6"),
        "up",
        &catalog(),
        &options,
    );
    assert!(inlined.unwrap().text.contains("translate: (Expr(\"6 / 2\"), 0, 0)"));
}

#[test]
fn names_in_defaults_are_names() {
    let text = graph(WIDE, "Param(\"half\")");
    let path = Path::new("graph.ron");
    let options = Options { files: Files::Ignored, ..Options::default() };
    fn edit(
        edit: Edit,
        path: &Path,
        text: &str,
        options: &Options,
    ) -> Result<maquette::EditedText, Vec<Diagnostic>> {
        maquette::edit::edit(path, text, &[edit], &catalog(), options)
    }
    let renamed =
        edit(Edit::Rename { from: "width".into(), to: "wide".into() }, path, &text, &options)
            .unwrap()
            .text;
    assert!(renamed.contains("Expr(\"wide / 2 + 1\")"), "{renamed}");
    let refused =
        edit(Edit::Remove { name: "width".into(), and_links: false }, path, &text, &options)
            .unwrap_err();
    assert_eq!(refused[0].message, "`width` cannot be removed: `half` needs it");
    let nodes = vec!["moved".to_owned()];
    let wish = Extraction { nodes, to: Some("part.ron".into()), ..Extraction::default() };
    let done = maquette::edit::extract(path, &text, &wish, &catalog(), &options).unwrap();
    assert!(done.text.contains("\"width\": Number(default: cm(1)"), "{}", done.text);
    assert!(done.edited.text.contains("width: Param(\"width\")"), "{}", done.edited.text);
}
