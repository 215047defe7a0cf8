//! Replaces nodes that use a graph by the nodes of that graph. Checks parameter values, names, expectations, and the reasons for refusals.

use std::path::Path;

use expect_test::{Expect, expect};
use maquette::{Evaluator, Files, Graph, Options, State};

use super::moves::diagnostics_text;
use super::sketch::Sketch;
use super::{catalog, law};

const HERE: &str = "nowhere/graph.ron";

/// Returns a graph that uses another graph, with these parameters, nodes and other fields.
fn outer(params: &str, nodes: &str, rest: &str) -> String {
    format!(
        "Graph(\n    format: 1,\n    use: {{ \"Lift\": \"lib/lift.ron\" }},\n{params}    nodes: {{\n        \"mesh\": ReadMesh(path: \"a.obj\"),\n{nodes}    }},\n{rest})\n"
    )
}

const LIFT: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "m"), "plate": Optional(Mesh(doc: "p")) },
    params: {
        "height": Number(default: 2.5, unit: "cm", doc: "h"),
        "levels": Integer(default: 1, min: 0, max: 4, doc: "l"),
        "file": Text(default: "../b.obj", doc: "f"),
    },
    nodes: {
        // Another one.
        "other": ReadMesh(path: Param("file")),
        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("levels")), // smooth
        "lifted": Transform(mesh: "smooth", translate: (0, Param("height"), Expr("-height * 2 + mm(1)"))),

        "all": Merge(meshes: ["lifted", "other", "plate"]),
        // The end.
    },
    outputs: { "mesh": "all", "same": "mesh", "smooth": "smooth" },
    expect: [Closed("smooth"), Near(of: "lifted", to: "mesh", max: 900.0)],
)
"#;

fn options(lift: &str) -> Options {
    Options { files: Files::Ignored, ..Options::default() }.with_text("nowhere/lib/lift.ron", lift)
}

fn inline_text(text: &str, lift: &str, node: &str) -> Result<String, String> {
    let done = maquette::edit::inline(Path::new(HERE), text, node, catalog(), &options(lift));
    done.map(|edited| edited.text).map_err(|problems| diagnostics_text(&problems))
}

#[track_caller]
fn check(text: &str, lift: &str, expected: Expect) {
    expected.assert_eq(&inline_text(text, lift, "up").unwrap_or_else(|why| why));
}

const OUTPUTS: &str =
    "    outputs: { \"a.ply\": \"up\", \"b.ply\": \"up.smooth\", \"c.ply\": \"up.same\" },\n";

#[test]
fn defaults_and_literals_take_the_place_of_parameters() {
    let use_it =
        "        // Above.\n        \"up\": Lift(mesh: \"mesh\", levels: /* few */ 2), // behind\n";
    check(
        &outer("", use_it, OUTPUTS),
        LIFT,
        expect![[r#"
        Graph(
            format: 1,
            nodes: {
                "mesh": ReadMesh(path: "a.obj"),
                // Above.
                /* few */
                // behind
                // Another one.
                "other": ReadMesh(path: "b.obj"),
                "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 2), // smooth
                "lifted": Transform(mesh: "smooth", translate: (0, cm(2.5), Expr("-cm(2.5) * 2 + mm(1)"))),

                "all": Merge(meshes: ["lifted", "other"]),
                // The end.
            },
            outputs: { "a.ply": "all", "b.ply": "smooth", "c.ply": "mesh" },
            expect: [Closed("smooth"), Near(of: "lifted", to: "all", max: 900.0)],
        )
    "#]],
    );
}

#[test]
fn parameters_and_expressions_take_the_place_of_parameters() {
    let params = "    params: { \"a\": Number(default: 1.0, unit: \"mm\"), \"a-b\": Number(default: 2.0, unit: \"mm\"), \"n\": Integer(default: 2) },\n";
    let use_it = "        \"up\": Lift(mesh: \"mesh\", plate: \"mesh\", height: Expr(\"a + 2 * a-b\"), levels: Param(\"n\"), file: \"c.obj\"),\n";
    check(
        &outer(params, use_it, OUTPUTS),
        LIFT,
        expect![[r#"
        Graph(
            format: 1,
            params: { "a": Number(default: 1.0, unit: "mm"), "a-b": Number(default: 2.0, unit: "mm"), "n": Integer(default: 2) },
            nodes: {
                "mesh": ReadMesh(path: "a.obj"),
                // Another one.
                "other": ReadMesh(path: "c.obj"),
                "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("n")), // smooth
                "lifted": Transform(mesh: "smooth", translate: (0, Expr("a + 2 * a-b"), Expr("-(a + 2 * a-b) * 2 + mm(1)"))),

                "all": Merge(meshes: ["lifted", "other", "mesh"]),
                // The end.
            },
            outputs: { "a.ply": "all", "b.ply": "smooth", "c.ply": "mesh" },
            expect: [Closed("smooth"), Near(of: "lifted", to: "all", max: 900.0)],
        )
    "#]],
    );
}

#[test]
fn a_name_beside_a_hyphen_stands_apart() {
    let params = "    params: { \"a\": Number(default: 5.0), \"a-1\": Number(default: 9.0) },\n";
    let lift = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh() },
    params: { "x": Number(default: 2.0) },
    nodes: { "up": Transform(mesh: "mesh", scale: (Expr("x-1"), Expr("2 * x"), Param("x"))) },
    outputs: { "mesh": "up" },
)
"#;
    let outputs = "    outputs: { \"a.ply\": \"up\" },\n";
    let all =
        ["Param(\"a\")", "Expr(\"a - 1\")", "-3", "Draft(final: 4, draft: 3)", "Param(\"a-1\")"];
    let all = all
        .map(|value| {
            let use_it = format!("        \"up\": Lift(mesh: \"mesh\", x: {value}),\n");
            let text =
                inline_text(&outer(params, &use_it, outputs), lift, "up").unwrap_or_else(|why| why);
            let line = text.lines().find(|line| line.contains("\"up\":") || line.starts_with("G0"));
            line.unwrap_or(&text).trim().to_owned()
        })
        .join("\n");
    expect![[r#"
        "up": Transform(mesh: "mesh", scale: (Expr("(a)-1"), Expr("2 * a"), Param("a"))),
        "up": Transform(mesh: "mesh", scale: (Expr("(a - 1)-1"), Expr("2 * (a - 1)"), Expr("a - 1"))),
        "up": Transform(mesh: "mesh", scale: (Expr("(-3)-1"), Expr("2 * (-3)"), -3)),
        G011 lift.ron:5:52 Expr("x-1") cannot contain the value of `x`: Draft(final: 4, draft: 3) (give `x` a number, a Param or an Expr)
        "up": Transform(mesh: "mesh", scale: (Expr("a-1-1"), Expr("2 * a-1"), Param("a-1"))),"#]].assert_eq(&all);
}

#[test]
fn names_that_are_taken_get_the_name_of_the_use() {
    let nodes = "        \"smooth\": Subdivide(mesh: \"mesh\", scheme: Loop),\n        \"up-other\": Subdivide(mesh: \"mesh\", scheme: Loop),\n        \"other\": Merge(meshes: [\"smooth\", \"up-other\"]),\n        \"up\": Lift(mesh: \"other\"),\n";
    let rest = "    outputs: { \"a.ply\": \"up.smooth\", \"b.ply\": \"up.same\" },\n    expect: [Closed(\"up\")],\n";
    check(
        &outer("", nodes, rest),
        LIFT,
        expect![[r#"
        Graph(
            format: 1,
            nodes: {
                "mesh": ReadMesh(path: "a.obj"),
                "smooth": Subdivide(mesh: "mesh", scheme: Loop),
                "up-other": Subdivide(mesh: "mesh", scheme: Loop),
                "other": Merge(meshes: ["smooth", "up-other"]),
                // Another one.
                "up-other-2": ReadMesh(path: "b.obj"),
                "up-smooth": Subdivide(mesh: "other", scheme: Loop, levels: 1), // smooth
                "lifted": Transform(mesh: "up-smooth", translate: (0, cm(2.5), Expr("-cm(2.5) * 2 + mm(1)"))),

                "all": Merge(meshes: ["lifted", "up-other-2"]),
                // The end.
            },
            outputs: { "a.ply": "up-smooth", "b.ply": "other" },
            expect: [Closed("all"), Closed("up-smooth"), Near(of: "lifted", to: "all", max: 900.0)],
        )
    "#]],
    );
}

#[test]
fn types_of_the_used_graph_come_along() {
    let inner = LIFT.replace(
        "    inputs:",
        "    use: { \"Lift\": \"low.ron\", \"Skin\": Graph(\"../skin.ron\", version: \"1.0\") },\n    inputs:",
    );
    let inner = inner.replace("\"all\": Merge(meshes: [\"lifted\", \"other\", \"plate\"])", "\"low\": ForEach(graph: \"Lift\", over: [()], links: (mesh: \"lifted\")),\n        \"skin\": Skin(mesh: \"other\"),\n        \"all\": Merge(meshes: [\"low/1\", \"skin\"])");
    let low = "Graph(format: 1, version: \"1.2.0\", inputs: { \"mesh\": Mesh() }, nodes: { \"m\": Transform(mesh: \"mesh\") }, outputs: { \"m\": \"m\" })";
    let options =
        options(&inner).with_text("nowhere/lib/low.ron", low).with_text("nowhere/skin.ron", low);
    let twice = "        \"up\": Lift(mesh: \"mesh\"),\n        \"down\": Lift(mesh: \"up\"),\n";
    let text = outer("", twice, "    outputs: { \"a.ply\": \"down\" },\n");
    let first = maquette::edit::inline(Path::new(HERE), &text, "down", catalog(), &options);
    let first = first.map(|it| it.text).unwrap_or_else(|why| diagnostics_text(&why));
    expect![[r#"
        Graph(
            format: 1,
            use: { "Lift": "lib/lift.ron", "Lift2": "lib/low.ron", "Skin": Graph("skin.ron", version: "1.0") },
            nodes: {
                "mesh": ReadMesh(path: "a.obj"),
                "up": Lift(mesh: "mesh"),
                // Another one.
                "other": ReadMesh(path: "b.obj"),
                "smooth": Subdivide(mesh: "up", scheme: Loop, levels: 1), // smooth
                "lifted": Transform(mesh: "smooth", translate: (0, cm(2.5), Expr("-cm(2.5) * 2 + mm(1)"))),

                "low": ForEach(graph: "Lift2", over: [()], links: (mesh: "lifted")),
                "skin": Skin(mesh: "other"),
                "all": Merge(meshes: ["low/1", "skin"]),
                // The end.
            },
            outputs: { "a.ply": "all" },
            expect: [Closed("smooth"), Near(of: "lifted", to: "all", max: 900.0)],
        )
    "#]].assert_eq(&first);
    let both = maquette::edit::inline(Path::new(HERE), &first, "up", catalog(), &options);
    expect![[r#"
        Graph(
            format: 1,
            use: { "Lift2": "lib/low.ron", "Skin": Graph("skin.ron", version: "1.0") },
            nodes: {
                "mesh": ReadMesh(path: "a.obj"),
                // Another one.
                "up-other": ReadMesh(path: "b.obj"),
                "up-smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1), // smooth
                "up-lifted": Transform(mesh: "up-smooth", translate: (0, cm(2.5), Expr("-cm(2.5) * 2 + mm(1)"))),

                "up-low": ForEach(graph: "Lift2", over: [()], links: (mesh: "up-lifted")),
                "up-skin": Skin(mesh: "up-other"),
                "up-all": Merge(meshes: ["up-low/1", "up-skin"]),
                // The end.
                // Another one.
                "other": ReadMesh(path: "b.obj"),
                "smooth": Subdivide(mesh: "up-all", scheme: Loop, levels: 1), // smooth
                "lifted": Transform(mesh: "smooth", translate: (0, cm(2.5), Expr("-cm(2.5) * 2 + mm(1)"))),

                "low": ForEach(graph: "Lift2", over: [()], links: (mesh: "lifted")),
                "skin": Skin(mesh: "other"),
                "all": Merge(meshes: ["low/1", "skin"]),
                // The end.
            },
            outputs: { "a.ply": "all" },
            expect: [Closed("smooth"), Near(of: "lifted", to: "all", max: 900.0), Closed("up-smooth"), Near(of: "up-lifted", to: "up-all", max: 900.0)],
        )
    "#]].assert_eq(&both.map(|it| it.text).unwrap_or_else(|why| diagnostics_text(&why)));
}

#[test]
fn what_nodes_alone_cannot_say_is_refused() {
    let use_it = "        \"up\": Lift(mesh: \"mesh\"),\n";
    let text = outer("", use_it, OUTPUTS);
    fn inline_error(text: &str, lift: &str, node: &str) -> String {
        inline_text(text, lift, node).unwrap_err()
    }
    let mut all = vec![inline_error(&text, LIFT, "uup"), inline_error(&text, LIFT, "mesh")];
    let each = "        \"up\": ForEach(graph: \"Lift\", over: [()], links: (mesh: \"mesh\")),\n";
    let rest = "    outputs: { \"a.ply\": \"up/1\" },\n";
    all.push(inline_error(&outer("", each, rest), LIFT, "up"));
    let wants = LIFT.replace("Mesh(doc: \"m\")", "Mesh(doc: \"m\", wants: [Closed])");
    all.push(inline_error(&text, &wants, "up"));
    let promises =
        LIFT.replace("    expect:", "    promises: { \"mesh\": [Closed] },\n    expect:");
    all.push(inline_error(&text, &promises, "up"));
    // These uses cannot be inlined. For example, the plain number 7 means centimeters as a value of `height`, but would mean millimeters in
    // the node of the used graph.
    let params = "    params: { \"far\": Number(default: 7.0) },\n";
    let far = "        \"up\": Lift(mesh: \"mesh\", height: Param(\"far\")),\n";
    all.push(inline_error(&outer(params, far, OUTPUTS), LIFT, "up"));
    let draft = "        \"up\": Lift(mesh: \"mesh\", height: Draft(final: 2, draft: 1)),\n";
    all.push(inline_error(&outer("", draft, OUTPUTS), LIFT, "up"));
    let broken = text.replace("ReadMesh(", "ReadMehs(");
    all.push(inline_error(&broken, LIFT, "up"));
    all.push(inline_error("Patch(format: 1, of: \"doll.ron\")", LIFT, "up"));
    let patch = "Patch(format: 1, of: \"other.ron\")";
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("lib")).unwrap();
    std::fs::write(folder.path().join("lib/lift.ron"), patch).unwrap();
    std::fs::write(folder.path().join("lib/other.ron"), LIFT).unwrap();
    let options = Options { files: Files::Ignored, ..Options::default() };
    let done =
        maquette::edit::inline(&folder.path().join("graph.ron"), &text, "up", catalog(), &options);
    let folder = folder.path().display().to_string();
    all.push(diagnostics_text(&done.unwrap_err()).replace(&folder, ""));
    expect![[r#"
        G007 graph.ron:1:1 the graph has no node `uup` (did you mean `up`?)
        G012 graph.ron:5:9 `mesh` is a ReadMesh, not a use of a graph (only nodes whose types are declared under `use` can be inlined)
        G012 graph.ron:6:9 `up` is a ForEach, whose elements are not written one by one (use the graph once for each element, and inline these uses)
        G011 graph.ron:6:9 input `mesh` of `up` wants Closed, which its nodes do not require (remove the requirement from the graph's file, or keep the use)
        G011 graph.ron:6:9 the graph of `up` promises properties that do not follow from its nodes (remove the promise from its file, or keep the use)
        G011 graph.ron:7:9 without `up` some results would change, such as a number in another unit (keep the use, or give its parameters values of their own units)
        G011 lift.ron:13:77 Expr("-height * 2 + mm(1)") cannot contain the value of `height`: Draft(final: 2, draft: 1) (give `height` a number, a Param or an Expr)
        G003 graph.ron:5:17 there is no node type `ReadMehs` (did you mean `ReadMesh`?)
        G001 graph.ron:1:1 a patch has values of nodes, but no nodes of its own (do it in the graph that it is `of`)
        G012 graph.ron:6:9 `/lib/lift.ron` is a patch, which has no nodes of its own (use the graph that it is `of`, with its values)"#]].assert_eq(&all.join("\n"));
}

/// Inlines each use of a graph, in all graphs of the project. Only known reasons for a refusal are accepted.
#[test]
fn uses_of_all_graphs_give_way_to_their_nodes() {
    let options = Options { files: Files::Ignored, ..Options::default() };
    let (mut done, mut refused) = (0, Vec::new());
    for (path, text) in law::graphs() {
        let path = path.canonicalize().unwrap();
        fn uses(kind: &str, text: &str) -> bool {
            text.contains(&format!("\"{kind}\":"))
        }
        if Graph::load_text(&path, text.clone(), catalog(), &options).graph.is_none() {
            continue;
        }
        for node in Sketch::parse(&text).nodes.iter().filter(|node| uses(&node.kind, &text)) {
            match maquette::edit::inline(&path, &text, &node.name, catalog(), &options) {
                Ok(edited) => {
                    done += 1;
                    fn count(text: &str) -> usize {
                        Sketch::parse(text).nodes.len()
                    }
                    assert!(count(&edited.text) >= count(&text), "{}", edited.text);
                }
                Err(problems) => {
                    let file = path.file_name().unwrap().to_string_lossy().into_owned();
                    refused.push(format!("{file} {}: {}", node.name, diagnostics_text(&problems)));
                }
            }
        }
    }
    assert!(done > 12 && done > 5 * refused.len(), "{done} done, refused:\n{}", refused.join("\n"));
    // The known reasons are that the used graph has `wants` or `promises`. The message then names them.
    let has_reason = |why: &String| why.contains(" wants ") || why.contains(" promises ");
    assert!(refused.iter().all(has_reason), "{}", refused.join("\n"));
}

#[test]
fn a_use_that_shares_its_line_gives_way_in_it() {
    let text = "Graph(format: 1, use: { \"Lift\": \"lib/lift.ron\" }, nodes: { \"mesh\": ReadMesh(path: \"a.obj\"), \"up\": Lift(mesh: \"mesh\"), \"z\": Merge(meshes: [\"up\"]) }, outputs: { \"z.ply\": \"z\" })";
    check(
        text,
        LIFT,
        expect![[r#"
        Graph(format: 1, nodes: { "mesh": ReadMesh(path: "a.obj"), 
        // Another one.
        "other": ReadMesh(path: "b.obj"),
        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1), // smooth
        "lifted": Transform(mesh: "smooth", translate: (0, cm(2.5), Expr("-cm(2.5) * 2 + mm(1)"))),

        "all": Merge(meshes: ["lifted", "other"])
        // The end.
        , "z": Merge(meshes: ["all"]) }, outputs: { "z.ply": "z" }, expect: [Closed("smooth"), Near(of: "lifted", to: "all", max: 900.0)])"#]],
    );
    let through = "Graph(format: 1, inputs: { \"mesh\": Mesh() }, nodes: {}, outputs: { \"mesh\": \"mesh\" })";
    check(
        text,
        through,
        expect![[
            r#"Graph(format: 1, nodes: { "mesh": ReadMesh(path: "a.obj"), "z": Merge(meshes: ["mesh"]) }, outputs: { "z.ply": "z" })"#
        ]],
    );
}

#[test]
fn nothing_is_computed_anew() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/face.ron");
    let path = path.canonicalize().unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let mut evaluator = Evaluator::new(2, 1 << 30).unwrap();
    fn count_computed(text: &str, path: &Path, evaluator: &mut Evaluator) -> (usize, usize) {
        let checked = Graph::load_text(path, text.to_owned(), catalog(), &Options::default());
        let done = evaluator.evaluate_all(&checked.graph.unwrap());
        assert_eq!(done.trace().count(State::Failed), 0);
        (done.trace().count(State::Computed), done.trace().0.len())
    }
    let (first, all) = count_computed(&text, &path, &mut evaluator);
    assert!(first > 10);
    let once =
        maquette::edit::inline(&path, &text, "nose", catalog(), &Options::default()).unwrap();
    assert_eq!(count_computed(&once.text, &path, &mut evaluator), (0, all));
    let twice =
        maquette::edit::inline(&path, &once.text, "model", catalog(), &Options::default()).unwrap();
    assert_eq!(count_computed(&twice.text, &path, &mut evaluator), (0, all));
}
