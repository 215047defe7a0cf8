//! Drafts: any parameter can have the value `Draft(final: .., draft: ..)`. A final run must never use a result of a draft run.

use std::path::{Path, PathBuf};

use maquette::value::Mesh;
use maquette::{Catalog, Edit, Graph, Options, Run, Session, Settings, Source, State, test_graphs};
use maquette_nodes::PACKS;

const TEXT: &str = r#"Graph(
    format: 1,
    params: { "levels": Integer(default: Draft(final: 3, draft: 1), min: 0, max: 5), "far": Number(default: 2.0) },
    nodes: {
        "doll": ReadMesh(path: "doll/coarse.obj"),
        "skin": Subdivide(mesh: "doll", scheme: Loop, levels: Param("levels")),
        "moved": Transform(mesh: "skin", translate: (Draft(final: Param("far"), draft: Expr("far * 10")), 0, 0), scale: Draft(final: (1, 1, 1), draft: (2, 2, 2))),
        "many": ForEach(graph: "Transform", over: Draft(final: [(scale: (1, 1, 1)), (scale: (1, 2, 1))], draft: [(scale: (1, 1, 1))]), with: (mesh: "doll")),
        "plain": Transform(mesh: "doll", translate: (1, 0, 0)),
    },
    outputs: { "moved.ply": "moved", "plain.ply": "plain" },
)"#;

fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/drafted.ron")
}

fn options(draft: bool) -> Options {
    Options { draft, ..Options::default() }.with_text(path(), TEXT)
}

fn load(options: &Options) -> Graph {
    let checked = Graph::load(&path(), &Catalog::new(PACKS), options);
    checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
}

/// Runs a graph. Returns the number of faces, the position of the first moved vertex, and the state of each node.
fn run(session: &mut Session, options: &Options) -> (usize, f64, Vec<(String, State)>) {
    let done = session.run(&load(options), &Run::default()).unwrap();
    assert!(done.diagnostics().is_empty(), "{:?}", done.diagnostics());
    let moved = done.get::<Mesh>("moved.ply").unwrap();
    let trace = done.trace();
    let states = trace.0.into_iter().map(|node| (node.name, node.state)).collect();
    (moved.faces().len(), moved.positions()[0].x, states)
}

#[test]
fn a_final_run_never_reads_what_a_draft_gave() {
    let folder = tempfile::tempdir().unwrap();
    let cache = maquette::CacheFolder::At(folder.path().to_owned());
    let settings = Settings { threads: 2, cache, ..Settings::default() };
    let mut session = Session::new(PACKS, &settings).unwrap();
    let draft = run(&mut session, &options(true));
    let last = run(&mut session, &options(false));
    assert_eq!(last.0, 16 * draft.0);
    assert_ne!(draft.1, last.1);
    fn is_computed(states: &[(String, State)], name: &str) -> bool {
        states.iter().any(|(known, state)| known == name && *state == State::Computed)
    }
    // `plain` is the only node that no draft value affects. It runs in the first run and is cached in the second one. All other nodes run
    // again.
    assert!(is_computed(&draft.2, "plain") && !is_computed(&last.2, "plain"));
    assert!(is_computed(&last.2, "skin") && is_computed(&last.2, "moved"));
    // Drafts and final runs have separate cached results. A session that never ran a draft gives the same final result.
    assert_eq!(
        (run(&mut session, &options(true)).0, run(&mut session, &options(false)).0),
        (draft.0, last.0)
    );
    let mut other = Session::new(PACKS, &Settings::in_memory()).unwrap();
    let alone = run(&mut other, &options(false));
    assert_eq!((alone.0, alone.1), (last.0, last.1));
}

#[test]
fn a_draft_stands_in_lists_structs_defaults_and_elements() {
    let (draft, last) = (load(&options(true)), load(&options(false)));
    let elements =
        |graph: &Graph| graph.node_names().filter(|name| name.starts_with("many/")).count();
    assert_eq!((elements(&draft), elements(&last)), (1, 2));
    fn default(graph: &Graph) -> serde_json::Value {
        graph.schema()["properties"]["levels"]["default"].clone()
    }
    assert_eq!((default(&draft), default(&last)), (1.into(), 3.into()));
}

#[test]
fn what_is_set_for_one_run_counts_for_drafts_and_final_results() {
    for draft in [false, true] {
        let set = vec![("levels".to_owned(), "2".to_owned())];
        let graph = load(&Options { set, ..options(draft) });
        assert_eq!(graph.schema()["properties"]["levels"]["default"], 2, "{draft}");
    }
}

fn set(target: &str, value: &str, draft: bool) -> String {
    let edit = Edit::Set { target: target.into(), value: value.into() };
    let options = Options { draft, ..Options::default() };
    let edited = maquette::edit::edit(&path(), TEXT, &[edit], &Catalog::new(PACKS), &options);
    edited.unwrap_or_else(|problems| panic!("{problems:?}")).text
}

#[test]
fn set_changes_the_final_value_or_that_of_drafts_or_the_whole() {
    let cases = [
        ("levels", "4", false, "Draft(final: 4, draft: 1)"),
        ("levels", "0", true, "Draft(final: 3, draft: 0)"),
        ("moved.scale.1", "7", false, "Draft(final: (1, 7, 1), draft: (2, 2, 2))"),
        ("moved.scale.draft.1", "7", false, "Draft(final: (1, 1, 1), draft: (2, 7, 2))"),
        ("moved.scale", "Draft(final: (1, 1, 1), draft: (3, 3, 3))", false, "draft: (3, 3, 3))"),
    ];
    for (target, value, draft, expected) in cases {
        let text = set(target, value, draft);
        assert!(text.contains(expected), "{target}={value}: {text}");
    }
}

#[test]
fn a_draft_that_is_set_leaves_the_final_value_as_it_is() {
    let text = TEXT.replace("Draft(final: 3, draft: 1)", "3");
    assert_ne!(text, TEXT);
    fn edit(
        target: &str,
        value: &str,
        text: &str,
    ) -> Result<maquette::EditedText, Vec<maquette::Diagnostic>> {
        let edit = Edit::Set { target: target.into(), value: value.into() };
        let options = Options { draft: true, ..Options::default() };
        maquette::edit::edit(&path(), text, &[edit], &Catalog::new(PACKS), &options)
    }
    let edited = edit("levels", "0", &text).unwrap();
    assert!(edited.text.contains("default: Draft(final: 3, draft: 0)"), "{}", edited.text);
    assert_eq!(edited.changes[0].before.as_deref(), Some("3"));
    assert_eq!(edited.changes[0].after, "Draft(final: 3, draft: 0)");
}

#[test]
fn a_draft_of_what_is_left_out_keeps_the_default_as_the_final_value() {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) -> PathBuf {
        std::fs::write(folder.path().join(name), text).unwrap();
        folder.path().join(name)
    }
    write(
        "lib.ron",
        r#"Graph(format: 1, inputs: { "mesh": Mesh() },
            params: { "steps": Integer(default: Draft(final: 3, draft: 1)), "file": Text(default: "a.obj") },
            nodes: { "a": ReadMesh(path: Param("file")), "s": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("steps")) },
            outputs: { "s": "s", "a": "a" })"#,
        &folder,
    );
    let text = r##"Graph(format: 1, use: { "Fine": "lib.ron" }, nodes: {
        "picture": ReadImage(path: "a.png"),
        "red": Threshold(image: "picture", select: Near(color: "#ff0000")),
        "doll": ReadMesh(path: "a.obj"),
        "moved": Transform(mesh: "doll"),
        "fine": Fine(mesh: "doll"),
        "all": ForEach(graph: "Fine", over: [(), (steps: 2)], with: (mesh: "doll")),
        "some": ForEach(graph: "Transform", over: [()], with: (mesh: "doll", scale: (2, 2, 2))),
    })"##;
    let graph = write("graph.ron", text, &folder);
    let patch = write("patch.ron", "Patch(format: 1, of: \"graph.ron\")", &folder);
    fn edit(
        path: &Path,
        target: &str,
        value: &str,
    ) -> Result<maquette::EditedText, Vec<maquette::Diagnostic>> {
        let edit = Edit::Set { target: target.into(), value: value.into() };
        let options = Options { draft: true, ..Options::default() };
        let text = std::fs::read_to_string(path).unwrap();
        maquette::edit::edit(path, &text, &[edit], &Catalog::new(PACKS), &options)
    }
    for (target, value, put) in [
        ("moved.rotate", "(0, 0, 90)", "rotate: Draft(final: (0.0, 0.0, 0.0), draft: (0, 0, 90))"),
        ("red.invert", "true", "invert: Draft(final: false, draft: true)"),
        ("red.select.distance", "5", "distance: Draft(final: 15.0, draft: 5)"),
        // If a draft value is set in a node that uses a graph, the final value is the default of that graph's parameter.
        ("fine.steps", "0", "steps: Draft(final: 3, draft: 0)"),
        ("all.with.steps", "0", "steps: Draft(final: 3, draft: 0)"),
        ("all/1.steps", "0", "[(steps: Draft(final: 3, draft: 0)), (steps: 2)]"),
        ("some/1.scale", "(1, 1, 1)", "[(scale: Draft(final: (2, 2, 2), draft: (1, 1, 1)))]"),
    ] {
        let edited = edit(&graph, target, value).unwrap_or_else(|it| panic!("{target}: {it:?}"));
        assert!(edited.text.contains(put), "{target}: {}", edited.text);
        assert!(put.contains(&edited.changes[0].after), "{target}: {:?}", edited.changes);
        assert_eq!(edited.changes[0].before, None);
    }
    let edited = edit(&patch, "moved.rotate", "(0, 0, 90)").unwrap();
    let put = r#""moved": (rotate: Draft(final: (0.0, 0.0, 0.0), draft: (0, 0, 90)))"#;
    assert!(edited.text.contains(put), "{}", edited.text);
    // A draft value cannot be set for a file path: it has no default, or the default is relative to another file.
    for target in ["fine.file", "all.with.file"] {
        let refused = edit(&graph, target, "b.obj").unwrap_err();
        assert!(
            refused[0].message.ends_with("`file` is omitted, so it has no final value to keep"),
            "{refused:?}"
        );
        assert_eq!(refused[0].help, "give both: Draft(final: .., draft: \"b.obj\")");
    }
}

#[test]
fn the_draft_of_a_patch_keeps_the_final_value_of_the_graph_that_is_patched() {
    let folder = tempfile::tempdir().unwrap();
    let text = TEXT.replace("Draft(final: 3, draft: 1)", "3").replace("../doll", "doll");
    std::fs::write(folder.path().join("base.ron"), text).unwrap();
    fn patch(rest: &str) -> String {
        format!("Patch(format: 1, of: \"base.ron\"{rest})")
    }
    let edit = Edit::Set { target: "levels".into(), value: "0".into() };
    let options = Options { draft: true, ..Options::default() };
    let path = folder.path().join("patch.ron");
    fn apply_edit(text: &str, path: &Path, edit: &Edit, options: &Options) -> String {
        let edited = maquette::edit::edit(
            path,
            text,
            std::slice::from_ref(edit),
            &Catalog::new(PACKS),
            options,
        );
        edited.unwrap_or_else(|problems| panic!("{problems:?}")).text
    }
    let own = apply_edit(&patch(", params: { \"levels\": 2 }"), &path, &edit, &options);
    assert!(own.contains("\"levels\": Draft(final: 2, draft: 0)"), "{own}");
    let base = apply_edit(&patch(""), &path, &edit, &options);
    assert!(base.contains("\"levels\": Draft(final: 3, draft: 0)"), "{base}");
}

#[test]
fn fmt_and_diff_keep_a_draft_and_tell_what_changed_in_it() {
    let text = set("moved.scale.draft.1", "7", false);
    fn source(text: &str) -> Source {
        Source { name: path(), text: text.to_owned() }
    }
    let differences = Graph::differences(&source(TEXT), &source(&text), &Catalog::new(PACKS));
    let told = format!("{:?}", differences.unwrap());
    assert!(told.contains("scale") && told.contains('7'), "{told}");
}

#[test]
fn goldens_are_of_final_results() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/language");
    let report = test_graphs(&folder, &Catalog::new(PACKS), 2).unwrap();
    assert!(report.failures.is_empty(), "{:?}", report.failures);
    assert!(report.graphs.iter().any(|graph| graph.ends_with("drafts.ron")));
}
