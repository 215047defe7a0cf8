//! Extracts nodes into a new graph file. Checks both resulting texts, the moved parts, and the reasons for refusals.

use std::path::{Path, PathBuf};

use expect_test::{Expect, expect};
use maquette::{Evaluator, ExtractedGraph, Extraction, Files, Graph, Options, State};

use super::moves::diagnostics_text;
use super::{DOLL, apply_edits, catalog, rename};

const HERE: &str = "nowhere/graph.ron";

fn wish(nodes: &[&str], to: &str) -> Extraction {
    let nodes = nodes.iter().map(|&node| node.to_owned()).collect();
    Extraction { nodes, to: Some(PathBuf::from(to)), ..Extraction::default() }
}

fn extract(text: &str, extraction: &Extraction) -> Result<ExtractedGraph, String> {
    extract_with(text, extraction, &Options::default())
}

fn extract_with(
    text: &str,
    extraction: &Extraction,
    options: &Options,
) -> Result<ExtractedGraph, String> {
    let done = maquette::edit::extract(Path::new(HERE), text, extraction, catalog(), options);
    done.map_err(|problems| diagnostics_text(&problems))
}

#[track_caller]
fn check(text: &str, extraction: &Extraction, expected: Expect) {
    let done = extract(text, extraction).unwrap();
    let (new, path) = (&done.edited.text, done.path.display());
    expected.assert_eq(&format!("{new}--- {path}\n{}", done.text));
}

#[track_caller]
fn check_refused(text: &str, extraction: &Extraction, expected: Expect) {
    expected.assert_eq(&extract(text, extraction).unwrap_err());
}

const SCAN: &str = r##"// A scan.
Graph(
    format: 1,
    doc: "Spots.",
    use: { "Skin": "lib/skin.ron", "Bump": "lib/bump.ron" },
    params: {
        // How far.
        "eye-step": Number(default: 12.0, min: 0.0, unit: "mm", doc: "How far."), // far
        "file": Text(default: "doll/color.png", doc: "The picture."),
    },
    nodes: {
        // The capture.
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "picture": ReadImage(path: Param("file")),

        // What is red,
        // and its spots.
        "red": Threshold(image: "scan.color", select: Near(color: "#c33923", distance: 30.0)), // red
        "spots": Label(mask: "red"),
        "spot": ExtractRegion(labels: "spots", range: "scan.range"),

        "net": ControlNet(region: "spot", range: "scan.range"),
        "raised": OffsetNet(net: "net", steps: [(distance: Expr("eye-step / 2 - 1"))]),
        "skin": Skin(color: "scan.color", range: "scan.range"),
    },
    outputs: { "red.png": "red", "raised.ply": "raised", "skin.glb": "skin", "picture.png": "picture" },
    expect: [Count(of: "red", what: "pixels", min: 4), Closed("skin.mesh")],
)
"##;

/// Returns the graph `SCAN` with used graphs that read no files.
fn scan() -> String {
    let text = SCAN.replace("lib/skin.ron", "skin.ron").replace(", \"Bump\": \"lib/bump.ron\"", "");
    assert_ne!(text, SCAN);
    text
}

const SKIN: &str = r#"Graph(
    format: 1,
    inputs: { "color": Image(), "range": RangeImage() },
    nodes: { "mesh": Triangulate(range: "range"), "model": Texture(mesh: "mesh", image: "color") },
    outputs: { "mesh": "model" },
)
"#;

fn with_skin() -> Options {
    Options { files: Files::Ignored, ..Options::default() }.with_text("nowhere/skin.ron", SKIN)
}

#[test]
fn nodes_go_with_their_comments_and_what_they_need() {
    let of =
        |nodes: &[&str]| extract_with(&scan(), &wish(nodes, "nowhere/lib/mark.ron"), &with_skin());
    expect!["G008 graph.ron:20:9 `spot` is between the nodes: it needs `red`, and `raised` needs it (extract `spot`, too, or leave one of them where it is)"].assert_eq(&of(&["red", "spots", "raised"]).unwrap_err());
    let done = of(&["raised", "red", "spots", "spot", "net", "picture"]).unwrap();
    assert_eq!((&done.kind[..], &done.name[..]), ("Mark", "mark"));
    assert_eq!(done.edited.before, scan());
    expect![[r##"
        // A scan.
        Graph(
            format: 1,
            doc: "Spots.",
            use: { "Skin": "skin.ron", "Mark": "lib/mark.ron" },
            params: {
                // How far.
                "eye-step": Number(default: 12.0, min: 0.0, unit: "mm", doc: "How far."), // far
                "file": Text(default: "doll/color.png", doc: "The picture."),
            },
            nodes: {
                // The capture.
                "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
                "mark": Mark(color: "scan.color", range: "scan.range", eye_step: Param("eye-step"), file: Param("file")),
                "skin": Skin(color: "scan.color", range: "scan.range"),
            },
            outputs: { "red.png": "mark.red", "raised.ply": "mark.raised", "skin.glb": "skin", "picture.png": "mark.picture" },
            expect: [Count(of: "mark.red", what: "pixels", min: 4), Closed("skin.mesh")],
        )
        --- nowhere/lib/mark.ron
        Graph(
            format: 1,
            doc: "A part of graph.ron.",
            inputs: {
                "color": Image(doc: "The value of `scan.color`."),
                "range": RangeImage(doc: "The value of `scan.range`."),
            },
            params: {
                "eye-step": Number(default: 12.0, min: 0.0, unit: "mm", doc: "How far."),
                "file": Text(default: "../doll/color.png", doc: "The picture."),
            },
            nodes: {
                "picture": ReadImage(path: Param("file")),

                // What is red,
                // and its spots.
                "red": Threshold(image: "color", select: Near(color: "#c33923", distance: 30.0)), // red
                "spots": Label(mask: "red"),
                "spot": ExtractRegion(labels: "spots", range: "range"),

                "net": ControlNet(region: "spot", range: "range"),
                "raised": OffsetNet(net: "net", steps: [(distance: Expr("eye-step / 2 - 1"))]),
            },
            outputs: { "picture": "picture", "red": "red", "raised": "raised" },
        )
    "##]].assert_eq(&format!("{}--- {}\n{}", done.edited.text, done.path.display(), done.text));
}

#[test]
fn a_use_goes_along_with_its_type_and_comes_back() {
    let mut wanted = wish(&["skin"], "nowhere/lib/all.ron");
    wanted.name = Some("whole".into());
    let done = extract_with(&scan(), &wanted, &with_skin()).unwrap();
    expect![[r#"
        Graph(
            format: 1,
            doc: "A part of graph.ron.",
            use: { "Skin": "../skin.ron" },
            inputs: {
                "color": Image(doc: "The value of `scan.color`."),
                "range": RangeImage(doc: "The value of `scan.range`."),
            },
            nodes: {
                "skin": Skin(color: "color", range: "range"),
            },
            outputs: { "skin": "skin" },
        )
    "#]]
    .assert_eq(&done.text);
    assert!(done.edited.text.contains("use: { \"All\": \"lib/all.ron\" }"));
    assert!(done.edited.text.contains("Closed(\"whole.skin\")"), "{}", done.edited.text);
    let options = with_skin().with_text("nowhere/lib/all.ron", &done.text[..]);
    let back =
        maquette::edit::inline(Path::new(HERE), &done.edited.text, "whole", catalog(), &options);
    // Extraction has written the name of the node's first output (`skin.mesh`). Inlining shortens it to `skin`.
    let was = scan().replace("Closed(\"skin.mesh\")", "Closed(\"skin\")");
    assert_eq!(back.map(|back| back.text).map_err(|it| diagnostics_text(&it)), Ok(was));
}

#[test]
fn a_use_goes_into_a_folder_that_is_not_there_yet() {
    let folder = tempfile::tempdir().unwrap();
    fn put(name: &str, text: &str, folder: &tempfile::TempDir) -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }
    put("maquette.toml", "", &folder);
    put("part.obj", "v 0 0 0\nv 5 0 0\nv 5 5 0\nf 1 2 3\n", &folder);
    put(
        "moved.ron",
        r#"Graph(format: 1, inputs: {"mesh": Mesh(doc: "")}, nodes: {"t": Transform(mesh: "mesh", translate: (1, 0, 0))}, outputs: {"mesh": "t"})"#,
        &folder,
    );
    let text = r#"Graph(format: 1, use: {"Moved": "moved.ron"}, nodes: {"a": ReadMesh(path: "part.obj"), "b": Moved(mesh: "a")}, outputs: {"b.ply": "b"})"#;
    let path = put("graph.ron", text, &folder);
    let to = Some(folder.path().join("new/deep/part.ron"));
    let wanted = Extraction { nodes: vec!["b".into()], to, ..Extraction::default() };
    let done = maquette::edit::extract(&path, text, &wanted, catalog(), &Options::default());
    let done = done.unwrap_or_else(|problems| panic!("{}", diagnostics_text(&problems)));
    assert!(done.text.contains(r#"use: { "Moved": "../../moved.ron" }"#), "{}", done.text);
}

#[test]
fn lines_end_and_begin_as_they_do_in_the_graph() {
    let wanted = wish(&["red", "spots"], "nowhere/mark.ron");
    fn extract_texts(text: &str, wanted: &Extraction) -> (String, String) {
        let done = extract_with(text, wanted, &with_skin()).unwrap();
        let options = with_skin().with_text("nowhere/mark.ron", &done.text[..]);
        let new = &done.edited.text;
        let back =
            maquette::edit::inline(Path::new(HERE), new, "mark", catalog(), &options).unwrap();
        assert_eq!(back.text, text);
        (done.edited.text, done.text)
    }
    let (graph, new) = extract_texts(&scan(), &wanted);
    fn windows(text: &str) -> String {
        text.replace('\n', "\r\n")
    }
    assert_eq!(extract_texts(&windows(&scan()), &wanted), (windows(&graph), windows(&new)));
    fn tabs(text: &str) -> String {
        text.replace("    ", "\t")
    }
    assert_eq!(extract_texts(&tabs(&scan()), &wanted), (tabs(&graph), new));
}

#[test]
fn paths_lead_to_the_same_files_whatever_they_go_through() {
    let through = r#"Graph(
    format: 1,
    inputs: {},
    params: { "from": Text(default: "c.obj"), "word": Text(default: "d.obj") },
    nodes: { "in": Read(file: Param("from")), "two": Switch(cases: { "d.obj": "in", "e.obj": "in" }, choose: Param("word")) },
    use: { "Read": "read.ron" },
    outputs: { "mesh": "two" },
)
"#;
    let read = r#"Graph(
    format: 1,
    inputs: {},
    params: { "file": Text(default: Draft(final: "a.obj", draft: "b.obj")) },
    nodes: { "mesh": ReadMesh(path: Param("file")) },
    outputs: { "mesh": "mesh" },
)
"#;
    let text = r#"Graph(
    format: 1,
    use: { "Through": "through.ron" },
    params: { "last": Text(default: Draft(final: "f.obj", draft: "sub/../g.obj")) },
    nodes: {
        "each": ForEach(graph: "ReadMesh", over: [(path: "a.obj"), (path: "sub/b.obj")]),
        "used": Through(from: "c.obj", word: "e.obj"),
        "own": ReadMesh(path: Draft(final: "d.obj", draft: "e.obj")),
        "given": Through(from: Param("last")),
        "all": Merge(meshes: ["each/1", "each/2", "used", "own", "given"]),
    },
    outputs: { "all.ply": "all" },
)
"#;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().canonicalize().unwrap();
    let path = folder.join("graph.ron");
    let options = Options { files: Files::Ignored, ..Options::default() }
        .with_text(folder.join("through.ron"), through)
        .with_text(folder.join("read.ron"), read);
    let nodes = ["each", "used", "own", "given", "all"];
    let wanted = wish(&nodes, folder.join("sub/new.ron").to_str().unwrap());
    let done = maquette::edit::extract(&path, text, &wanted, catalog(), &options);
    let done = done.unwrap_or_else(|problems| panic!("{}", diagnostics_text(&problems)));
    expect![[r#"
        Graph(
            format: 1,
            doc: "A part of graph.ron.",
            use: { "Through": "../through.ron" },
            inputs: {},
            params: { "last": Text(default: Draft(final: "../f.obj", draft: "../g.obj")) },
            nodes: {
                "each": ForEach(graph: "ReadMesh", over: [(path: "../a.obj"), (path: "b.obj")]),
                "used": Through(from: "../c.obj", word: "e.obj"),
                "own": ReadMesh(path: Draft(final: "../d.obj", draft: "../e.obj")),
                "given": Through(from: Param("last")),
                "all": Merge(meshes: ["each/1", "each/2", "used", "own", "given"]),
            },
            outputs: { "all": "all" },
        )
    "#]]
    .assert_eq(&done.text);
    let options = options.with_text(&done.path, &done.text[..]);
    let back = maquette::edit::inline(&path, &done.edited.text, "new", catalog(), &options);
    assert_eq!(
        back.map(|back| back.text).map_err(|problems| diagnostics_text(&problems)),
        Ok(text.to_owned())
    );
    // The parameter `last` of the new graph may get another value, or may be left out.
    let other = done.edited.text.replace("Param(\"last\")", "\"other/x.obj\"");
    fn inline_text(text: &str, path: &Path, options: &Options) -> String {
        let done = maquette::edit::inline(path, text, "new", catalog(), options);
        let text =
            done.map(|edited| edited.text).unwrap_or_else(|problems| diagnostics_text(&problems));
        text.lines().find(|line| line.contains("given\": ")).unwrap_or(&text).trim().to_owned()
    }
    let none = done.edited.text.replace("last: Param(\"last\")", "");
    expect![[r#"
        "given": Through(from: "other/x.obj"),
        "given": Through(from: Draft(final: "f.obj", draft: "g.obj")),"#]]
    .assert_eq(&format!(
        "{}\n{}",
        inline_text(&other, &path, &options),
        inline_text(&none, &path, &options)
    ));
}

#[test]
fn inputs_that_may_be_left_out_may_be_left_out_of_the_new_graph() {
    check(
        include_str!("../../../graphs/language/lib/raised.ron"),
        &wish(&["all"], "nowhere/both.ron"),
        expect![[r#"
            // A copy of a mesh above it, on a plate if there is one.
            Graph(
                format: 1,
                version: "1.2.0",
                doc: "Puts a copy of a mesh above it, and both on a plate if one is given.",
                use: { "Both": "both.ron" },
                inputs: {
                    "mesh": Mesh(doc: "What is copied."),
                    "plate": Optional(Mesh(doc: "What it stands on; it may be left out.")),
                },
                params: { "height": Number(default: 107.0, min: 100.0, max: 200.0, unit: "mm", doc: "How far above it the copy is.") },
                nodes: {
                    "copy": Transform(mesh: "mesh", translate: (0, Param("height"), 0)),
                    "both": Both(mesh: "mesh", copy: "copy", plate: "plate"),
                },
                outputs: { "mesh": "both.all" },
            )
            --- nowhere/both.ron
            Graph(
                format: 1,
                doc: "A part of graph.ron.",
                inputs: {
                    "mesh": Mesh(doc: "What is copied."),
                    "copy": Mesh(doc: "The value of `copy`."),
                    "plate": Optional(Mesh(doc: "What it stands on; it may be left out.")),
                },
                nodes: {
                    // Without a plate there are two meshes in this list.
                    "all": Merge(meshes: ["mesh", "copy", "plate"]),
                },
                outputs: { "all": "all" },
            )
        "#]],
    );
}

#[test]
fn entries_that_share_a_line_are_taken_out_of_it() {
    check(
        "Graph(format: 1, nodes: { \"a\": ReadMesh(path: \"a.obj\"), \"b\": Subdivide(mesh: \"a\", scheme: Loop), \"c\": Merge(meshes: [\"a\", \"b\"]) }, outputs: { \"c.ply\": \"c\" })",
        &wish(&["a", "b"], "nowhere/new.ron"),
        expect![[r#"
            Graph(format: 1, use: { "New": "new.ron" }, nodes: { "new": New(), "c": Merge(meshes: ["new.a", "new.b"]) }, outputs: { "c.ply": "c" })--- nowhere/new.ron
            Graph(
                format: 1,
                doc: "A part of graph.ron.",
                inputs: {},
                nodes: {
                    "a": ReadMesh(path: "a.obj"),
                    "b": Subdivide(mesh: "a", scheme: Loop),
                },
                outputs: { "a": "a", "b": "b" },
            )
        "#]],
    );
}

#[test]
fn names_are_made_of_the_file_or_of_each_other() {
    fn names(extraction: Extraction) -> String {
        let ExtractedGraph { path, kind, name, .. } = extract(DOLL, &extraction).unwrap();
        format!("{} {kind} {name}", path.display())
    }
    fn extraction(kind: Option<&str>, name: Option<&str>, to: Option<&str>) -> Extraction {
        Extraction {
            nodes: vec!["grid".into()],
            kind: kind.map(str::to_owned),
            name: name.map(str::to_owned),
            to: to.map(PathBuf::from),
        }
    }
    assert_eq!(names(extraction(None, None, None)), "nowhere/grid.ron Grid grid");
    assert_eq!(
        names(extraction(Some("BigNose"), None, None)),
        "nowhere/big-nose.ron BigNose big-nose"
    );
    assert_eq!(names(extraction(None, Some("far"), None)), "nowhere/far.ron Far far");
    assert_eq!(names(extraction(None, None, Some("nowhere/x/y_2.ron"))), "nowhere/x/y_2.ron Y2 y2");
    // If the type or name of the new graph is taken, a number is appended: `Label` is a built-in node type, and the graph has a node
    // `skin`.
    assert_eq!(
        names(extraction(None, None, Some("nowhere/label.ron"))),
        "nowhere/label.ron Label2 label2"
    );
    assert_eq!(
        names(extraction(None, None, Some("nowhere/skin.ron"))),
        "nowhere/skin.ron Skin skin-2"
    );
}

#[test]
fn what_cannot_be_extracted_is_refused() {
    let to = "nowhere/new.ron";
    check_refused(
        DOLL,
        &wish(&[], to),
        expect!["G007 graph.ron:1:1 no nodes to extract (name the nodes to extract)"],
    );
    check_refused(
        DOLL,
        &wish(&["grdi"], to),
        expect!["G007 graph.ron:1:1 the graph has no node `grdi` (did you mean `grid`?)"],
    );
    check_refused(
        DOLL,
        &wish(&["red", "nose"], to),
        expect![
            "G008 graph.ron:16:9 `spots` is between the nodes: it needs `red`, and `nose` needs it (extract `spots`, too, or leave one of them where it is)"
        ],
    );
    check_refused(
        DOLL,
        &wish(&["red"], HERE),
        expect![
            "G006 graph.ron:1:1 `nowhere/graph.ron` is there already (name a file that does not exist yet)"
        ],
    );
    check_refused(
        DOLL,
        &wish(&["red"], "nowhere/new.txt"),
        expect![
            "G006 graph.ron:1:1 `nowhere/new.txt` cannot be the file of a graph (use the extension .ron)"
        ],
    );
    check_refused(
        DOLL,
        &wish(&["red"], "../new.ron"),
        expect![
            "G014 graph.ron:5:19 `../../new.ron` lies outside of the project (move the file into nowhere, put a maquette.toml into a folder above both, or allow its folder with --root)"
        ],
    );
    fn extraction_named(kind: &str, name: &str, to: &str) -> Extraction {
        Extraction {
            kind: (!kind.is_empty()).then(|| kind.to_owned()),
            name: (!name.is_empty()).then(|| name.to_owned()),
            ..wish(&["red"], to)
        }
    }
    check_refused(
        DOLL,
        &extraction_named("Label", "", to),
        expect!["G006 graph.ron:1:1 there is already a node type `Label` (give it another name)"],
    );
    check_refused(
        DOLL,
        &extraction_named("red", "", to),
        expect![
            "G006 graph.ron:1:1 `red` cannot be the name of a node type (use a capital letter followed by letters and digits)"
        ],
    );
    check_refused(
        DOLL,
        &extraction_named("", "skin", to),
        expect![
            "G006 graph.ron:1:1 there is already a node `skin` (give the new node another name)"
        ],
    );
    check_refused(
        DOLL,
        &extraction_named("", "Skin", to),
        expect![
            "G006 graph.ron:1:1 `Skin` cannot name a node (use a lower-case letter followed by lower-case letters, digits and hyphens)"
        ],
    );
    let lib = include_str!("../../../graphs/lib/feature.ron");
    check_refused(
        lib,
        &wish(&["color"], to),
        expect![
            "G007 graph.ron:1:1 `color` is an input, not a node (leave it out: inputs of the new graph are created from links)"
        ],
    );
    let patch = "Patch(format: 1, of: \"doll.ron\", params: { \"growth\": 3.0 })";
    check_refused(
        patch,
        &wish(&["red"], to),
        expect![
            "G001 graph.ron:1:1 a patch has values of nodes, but no nodes of its own (do it in the graph that it is `of`)"
        ],
    );
    check_refused(
        &DOLL.replace("Label(", "Lable("),
        &wish(&["red"], to),
        expect!["G003 graph.ron:16:18 there is no node type `Lable` (did you mean `Label`?)"],
    );
    check_refused(
        "Graph(",
        &wish(&["red"], to),
        expect!["G001 graph.ron:1:6 this `(` is never closed (add the missing `)`)"],
    );
    let each = r#"Graph(
    format: 1,
    nodes: {
        "mesh": ReadMesh(path: "a.obj"),
        "copies": ForEach(graph: "Transform", over: [(translate: (1, 0, 0)), ()], links: (mesh: "mesh")),
        "row": Merge(meshes: "copies"),
    },
    outputs: { "row.ply": "row", "second.ply": "copies/2" },
)
"#;
    check_refused(
        each,
        &wish(&["copies"], to),
        expect![
            "G012 graph.ron:6:30 port `meshes` of `row` takes all of `copies`, but the outputs of a graph are single values (extract the nodes that need them, too)"
        ],
    );
    check_refused(
        each,
        &wish(&["row"], to),
        expect![
            "G012 graph.ron:6:30 port `meshes` of `row` takes all of `copies`, but the inputs of a graph are single values (extract `copies`, too)"
        ],
    );
    assert!(extract(each, &wish(&["copies", "row"], to)).is_ok());
}

#[test]
fn a_file_that_is_there_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("doll.ron");
    std::fs::write(folder.path().join("new.ron"), "mine").unwrap();
    let wanted = Extraction { to: Some(folder.path().join("new.ron")), ..wish(&["red"], "") };
    let refused = maquette::edit::extract(&path, DOLL, &wanted, catalog(), &Options::default());
    assert!(diagnostics_text(&refused.unwrap_err()).contains("new.ron` is there already"));
    // A file that exists only as unsaved text in an editor also counts as existing.
    let other = Extraction { to: Some(folder.path().join("other.ron")), ..wish(&["red"], "") };
    let options = Options::default().with_text(folder.path().join("other.ron"), "mine");
    let refused = maquette::edit::extract(&path, DOLL, &other, catalog(), &options);
    assert!(diagnostics_text(&refused.unwrap_err()).contains("other.ron` is there already"));
}

#[test]
fn nothing_is_computed_anew() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/doll.ron");
    let path = path.canonicalize().unwrap();
    fn load(text: &str, options: &Options, path: &Path) -> Graph {
        Graph::load_text(path, text.to_owned(), catalog(), options).graph.unwrap()
    }
    let mut evaluator = Evaluator::new(2, 1 << 30).unwrap();
    let first = evaluator.evaluate_all(&load(DOLL, &Options::default(), &path));
    assert_eq!(first.trace().count(State::Failed), 0);
    let nodes = ["red", "spots", "nose", "normal", "net", "raised"];
    let wanted = wish(&nodes, path.with_file_name("zz/nose.ron").to_str().unwrap());
    let done =
        maquette::edit::extract(&path, DOLL, &wanted, catalog(), &Options::default()).unwrap();
    let options = Options::default().with_text(&done.path, &done.text[..]);
    fn count(
        text: &str,
        evaluator: &mut Evaluator,
        options: &Options,
        path: &Path,
    ) -> (usize, usize) {
        let graph = load(text, options, path);
        let done = evaluator.evaluate_all(&graph);
        (done.trace().count(State::Computed), done.trace().0.len())
    }
    let (computed, all) = count(&done.edited.text, &mut evaluator, &options, &path);
    assert_eq!((computed, all), (0, first.trace().0.len()));
    let inlined =
        maquette::edit::inline(&path, &done.edited.text, "nose", catalog(), &options).unwrap();
    assert_eq!(inlined.text, DOLL);
    assert_eq!(count(&inlined.text, &mut evaluator, &options, &path).0, 0);
    // Renaming a node of the graph causes no node to run again, but changing a value does.
    let other = apply_edits(DOLL, &[rename("red", "blue")]).unwrap();
    assert_eq!(count(&other, &mut evaluator, &options, &path).0, 0);
    let other = done.edited.text.replace("default: 12.0", "default: 13.0");
    assert!(count(&other, &mut evaluator, &options, &path).0 > 0);
}
