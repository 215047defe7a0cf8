//! `fmt --minimal` removes values that equal their defaults, but keeps all comments.

use std::path::{Path, PathBuf};

use expect_test::{Expect, expect};
use maquette::{Catalog, Files, Graph, Options, Run, Session, Settings, Source, State, Targets};
use maquette_nodes::PACKS;

use crate::ron_files::ron_files;

fn graphs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs")
}

fn minimal(path: &Path, text: &str, catalog: &Catalog) -> String {
    maquette::edit::minimal(path, text, catalog, &Options::default())
        .unwrap_or_else(|problems| panic!("{}: {problems:?}", path.display()))
}

/// Returns the words of all comments in order.
fn comments(text: &str) -> Vec<&str> {
    let mut words: Vec<_> =
        text.lines().filter_map(|line| Some(line.split_once("// ")?.1)).collect();
    words.sort_unstable();
    words
}

#[test]
fn every_graph_says_the_same_without_its_defaults_and_again() {
    let catalog = Catalog::new(PACKS);
    let paths = ron_files(&graphs());
    let mut shorter = 0;
    for path in &paths {
        let text = std::fs::read_to_string(path).unwrap();
        let form = maquette::edit::format_text(path, &text).unwrap();
        let short = minimal(path, &text, &catalog);
        assert_eq!(minimal(path, &short, &catalog), short, "{}", path.display());
        assert_eq!(comments(&form), comments(&short), "{}", path.display());
        shorter += usize::from(short.len() < form.len());
        let options = Options { files: Files::Ignored, ..Options::default() };
        fn load(
            text: &str,
            catalog: &Catalog,
            options: &Options,
            path: &Path,
        ) -> maquette::CheckedGraph {
            Graph::load_text(path, text.to_owned(), catalog, options)
        }
        let (before, after) =
            (load(&form, &catalog, &options, path), load(&short, &catalog, &options, path));
        assert_eq!(before.graph.is_some(), after.graph.is_some(), "{}", path.display());
    }
    assert!(paths.len() > 100 && shorter > 5, "{shorter} of {}", paths.len());
}

#[test]
fn nothing_is_computed_again_without_the_defaults() {
    let mut session =
        Session::new(PACKS, &Settings { threads: 2, ..Settings::in_memory() }).unwrap();
    let path = graphs().join("nodes/whole.ron");
    let text = format!(
        "Graph(format: 1, doc: \"\", use: {{}}, params: {{}}, {WHOLE}, outputs: {{ \"out.ply\": \"out\" }})"
    );
    let short = minimal(&path, &text, session.catalog());
    assert!(short.len() + 100 < text.len(), "{short}");
    for (index, text) in [text, short].iter().enumerate() {
        let graph = session.load(&path, &Options::default().with_text(&path, text)).graph.unwrap();
        let run = session.run(&graph, &Run { targets: Targets::Everything, ..Run::default() });
        let trace = run.unwrap().trace();
        let computed = trace.0.iter().filter(|node| node.state == State::Computed).count();
        assert_eq!(computed == 0, index == 1, "{trace:?}");
    }
}

const WHOLE: &str = r#"nodes: {
    "mug": ReadMesh(path: "../doll/mug.obj", unit: Mm),
    "fine": Subdivide(mesh: "mug", scheme: CatmullClark, levels: 1, limit: false),
    "moved": Transform(mesh: "fine", translate: (0, 0.0, 0), rotate: (0, 0, deg(0)), scale: (1, 1, 1), sensor_axes: false),
    "all": ForEach(graph: "Transform", over: [(scale: (1, 1, 1)), (translate: (cm(0), 0, 0))], with: (mesh: "moved", rotate: (0, 0, 0)), links: ()),
    "out": Merge(meshes: "all"),
}"#;

fn check(nodes: &str, expected: Expect) {
    let path = graphs().join("nodes/graph.ron");
    let text = format!("Graph(format: 1, nodes: {{{nodes}}}, outputs: {{}})");
    expected.assert_eq(&minimal(&path, &text, &Catalog::new(PACKS)));
}

#[test]
fn comments_stay_and_what_all_others_have_is_said_by_the_one_that_has_not() {
    check(
        r#"
        "ball": ReadMesh(path: "../doll/mug.obj"),
        "all": ForEach(graph: "Transform", over: [
            (rotate: (0, 0, 0)), // as it stands
            (scale: (1, 1, 1), /* no turn */ translate: (0, 0, 0) /* none */, rotate: (1, 0, 0)),
        ], with: (mesh: "ball", rotate: (0, 0, 90))),
        // Much is said here.
        "soft": Transform(
            mesh: "ball", // the ball
            // no move
            translate: (0, 0, 0), // at all
            rotate: (0,
                // none
                0, 0),
        ),"#,
        expect![[r#"
            Graph(
                format: 1,
                nodes: {
                    "ball": ReadMesh(path: "../doll/mug.obj"),
                    "all": ForEach(
                        graph: "Transform",
                        over: [
                            (rotate: (0, 0, 0)), // as it stands
                            (
                                /* no turn */
                                /* none */ rotate: (1, 0, 0),
                            ),
                        ],
                        with: (mesh: "ball", rotate: (0, 0, 90)),
                    ),
                    // Much is said here.
                    "soft": Transform(
                        mesh: "ball", // the ball
                        // no move
                        // at all
                        // none
                    ),
                },
                outputs: {},
            )
        "#]],
    );
}

#[test]
fn no_difference_is_told_and_no_gap_is_left_where_defaults_were() {
    const TEXT: &str = r#"Graph(
    format: 1,
    packs: {},
    doc: "",
    params: { "size": Number(default: 1, doc: "") },
    nodes: {
        "a": ReadMesh(path: "../doll/mug.obj"),
        "b": Transform(
            mesh: "a",
            // as it is
            scale: (1, 1, 1),
            rotate: (0, 0, 90),
        ),
        "c": ForEach(graph: "Transform", over: [(scale: (1, 1, 1)), (rotate: (0, 0, 0))], with: (translate: (0, 0, 0)), links: (mesh: "b"), carry: (), most: 10000),
        "m": Merge(meshes: "c"),
    },
    outputs: { "m.ply": "m" },
)
"#;
    let catalog = Catalog::new(PACKS);
    let path = graphs().join("nodes/graph.ron");
    let short = minimal(&path, TEXT, &catalog);
    expect![[r#"
        Graph(
            format: 1,
            params: { "size": Number(default: 1) },
            nodes: {
                "a": ReadMesh(path: "../doll/mug.obj"),
                "b": Transform(
                    mesh: "a",
                    // as it is
                    rotate: (0, 0, 90),
                ),
                "c": ForEach(graph: "Transform", over: [(), ()], links: (mesh: "b")),
                "m": Merge(meshes: "c"),
            },
            outputs: { "m.ply": "m" },
        )
    "#]]
    .assert_eq(&short);
    fn differences(
        old: &str,
        new: &str,
        path: &Path,
        catalog: &Catalog,
    ) -> Vec<maquette::Difference> {
        fn source(text: &str, path: &Path) -> Source {
            Source { name: path.to_owned(), text: text.to_owned() }
        }
        Graph::differences(&source(old, path), &source(new, path), catalog).unwrap()
    }
    assert_eq!(differences(TEXT, &short, &path, &catalog), []);
    // A default value in an element must stay if it overrides a value that `with` sets for all elements.
    let with = TEXT.replace("with: (translate: (0, 0, 0))", "with: (rotate: (0, 0, 9))");
    let told = differences(&with, &minimal(&path, &with, &catalog), &path, &catalog);
    assert_eq!(told, []);
    let told = differences(&with, &with.replace("(rotate: (0, 0, 0))", "()"), &path, &catalog);
    assert_eq!(told.len(), 1, "{told:?}");
}

#[test]
fn a_graph_without_its_defaults_is_no_other_graph() {
    let catalog = Catalog::new(PACKS);
    let paths = ron_files(&graphs());
    for path in &paths {
        let text = std::fs::read_to_string(path).unwrap();
        let short = minimal(path, &text, &catalog);
        fn source(text: String, path: &Path) -> Source {
            Source { name: path.to_owned(), text }
        }
        let told = Graph::differences(&source(text, path), &source(short, path), &catalog);
        assert_eq!(told, Ok(vec![]), "{}", path.display());
    }
}

#[test]
fn a_plain_value_is_not_what_a_draft_has_by_default() {
    let library = r#"Graph(
    format: 1,
    inputs: { "m": Mesh(doc: "") },
    params: { "levels": Integer(default: Draft(final: 2, draft: 0), min: 0, max: 5) },
    nodes: { "fine": Subdivide(mesh: "m", scheme: CatmullClark, levels: Param("levels")) },
    outputs: { "m": "fine" },
)"#;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("lib.ron"), library).unwrap();
    let path = folder.path().join("a.ron");
    fn using(levels: &str) -> String {
        let node = format!("\"u\": Fine(m: \"c\"{levels})");
        format!(
            "Graph(format: 1, use: {{ \"Fine\": \"lib.ron\" }}, nodes: {{ \"c\": ReadMesh(path: \"c.obj\"), {node} }}, outputs: {{ \"m.ply\": \"u\" }})"
        )
    }
    let catalog = Catalog::new(PACKS);
    assert!(minimal(&path, &using(", levels: 2"), &catalog).contains("levels: 2"));
    assert!(
        !minimal(&path, &using(", levels: Draft(draft: 0, final: 2)"), &catalog).contains("levels")
    );
    fn source(levels: &str, path: &Path) -> Source {
        Source { name: path.to_owned(), text: using(levels) }
    }
    fn differences(levels: &str, path: &Path, catalog: &Catalog) -> usize {
        Graph::differences(&source("", path), &source(levels, path), catalog).unwrap().len()
    }
    let same = differences(", levels: Draft(final: 2, draft: 0)", &path, &catalog);
    assert_eq!((differences(", levels: 2", &path, &catalog), same), (1, 0));
}
