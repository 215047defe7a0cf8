//! Graphs that use other graphs: their results and their errors.

use std::path::Path;

use expect_test::expect;
use maquette::{CheckedGraph, Position, State};

use super::folder::{DOLL, Folder, MOVED, evaluator, graph};

#[test]
fn a_graph_is_used_like_a_node() {
    let folder = Folder::with_nodes(
        r#""a": Moved(mesh: "doll"), "b": Moved(mesh: "a", step: Param("far")), "out": Moved(mesh: "b.mesh", step: Expr("far - 1"))"#,
    );
    assert_eq!(folder.x_of(&[], "a"), 1.0);
    assert_eq!(folder.x_of(&[], "out"), 6.0);
    assert_eq!(folder.x_of(&[], "out.mesh"), 6.0);
    assert_eq!(folder.x_of(&[], "out/it.mesh"), 6.0);
    assert_eq!(folder.x_of(&[("far", "5")], "out"), 10.0);
    assert_eq!(folder.x_of(&[("b.step", "0.5")], "out"), 3.5);
    assert_eq!(folder.x_of(&[("a.step", "0.5")], "out"), 5.5);
}

#[test]
fn nodes_are_named_by_the_way_to_them_and_come_after_what_they_hang_on() {
    let twice = r#"Graph(format: 1, use: { "Moved": "moved.ron" }, inputs: { "it": Mesh() }, params: { "far": Number(default: 2.0) },
        nodes: { "b": Moved(mesh: "a", step: Param("far")), "a": Moved(mesh: "it") }, outputs: { "out": "b" })"#;
    let text = graph(r#""out": Moved(mesh: "t.out"), "t": Twice(it: "doll", far: 4.0)"#)
        .replace("use: {", "use: { \"Twice\": \"lib/twice.ron\",");
    let folder = Folder::new(&[("graph.ron", &text), ("lib/twice.ron", twice)]);
    let graph = folder.graph();
    assert_eq!(Vec::from_iter(graph.node_names()), ["doll", "t/a/it", "t/b/it", "out/it"]);
    assert_eq!(folder.x_of(&[], "out"), 6.0);
}

#[test]
fn two_uses_with_equal_inputs_are_computed_once() {
    let folder = Folder::with_nodes(
        r#""a": Moved(mesh: "doll", step: 2.0), "b": Moved(mesh: "doll", step: Expr("far - 1")), "out": Merge(meshes: ["a", "b"])"#,
    );
    let trace = evaluator().evaluate_all(&folder.graph()).trace();
    fn state(name: &str, trace_0: &[maquette::NodeTrace]) -> State {
        trace_0.iter().find(|node| node.name == name).unwrap().state
    }
    let both = [state("a/it", &trace.0), state("b/it", &trace.0)];
    assert!(both.contains(&State::Computed) && both != [State::Computed; 2], "{trace}");
}

#[test]
fn a_path_is_relative_to_the_file_where_it_stands() {
    let read = r#"Graph(format: 1, inputs: {}, params: { "file": Text(default: "own.obj", doc: "Which.") },
nodes: { "it": ReadMesh(path: Param("file")) }, outputs: { "mesh": "it" })"#;
    let through = r#"Graph(format: 1, use: { "Read": "../lib/read.ron" }, inputs: {}, params: { "which": Text(default: "mid.obj") },
nodes: { "r": Read(file: Param("which")), "own": Read() }, outputs: { "mesh": "r", "own": "own" })"#;
    let text = graph(r#""a": Through(), "b": Through(which: "doll.obj"), "out": Merge(meshes: ["a", "b", "a.own"])"#)
        .replace("use: {", "use: { \"Through\": \"mid/through.ron\",");
    let files = [
        ("graph.ron", &text[..]),
        ("lib/read.ron", read),
        ("lib/own.obj", &DOLL.replace("v 0 0 0", "v 7 0 0")),
        ("mid/through.ron", through),
        ("mid/mid.obj", &DOLL.replace("v 0 0 0", "v 5 0 0")),
    ];
    let folder = Folder::new(&files);
    assert_eq!([folder.x_of(&[], "a"), folder.x_of(&[], "b")], [5.0, 0.0]);
    assert_eq!(folder.x_of(&[], "b.own"), 7.0);
    assert_eq!(folder.x_of(&[("a.which", "lib/own.obj")], "a"), 7.0);
    std::fs::remove_file(folder.path("doll.obj")).unwrap();
    std::fs::remove_file(folder.path("lib/own.obj")).unwrap();
    folder.check(expect![[r#"
        graph.ron:2:24-34 G013 there is no file `doll.obj`
        lib/read.ron:1:62-71 G013 there is no file `own.obj` <- a at graph.ron:3:1 <- own at mid/through.ron:2:43
        graph.ron:3:37-47 G013 there is no file `doll.obj`
    "#]]);
}

#[test]
fn parameters_of_every_type_go_through() {
    let all = r##"Graph(format: 1, inputs: { "mesh": Mesh() }, params: {
"number": Number(default: 0.5), "integer": Integer(default: 1), "toggle": Toggle(default: false), "color": Color(default: "#ffffff"),
"text": Text(default: "doll.obj"), "choice": Choice(default: EdgeOnly, of: [EdgeOnly, EdgeAndCorner]), "vector": Vector(default: (0, 0, 0), min: -9) },
nodes: {
"read": ReadMesh(path: Param("text")),
"fine": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("integer"), limit: Param("toggle"), boundary: Param("choice")),
"it": Transform(mesh: "fine", translate: Param("vector"), scale: (Param("number"), 1, 1)),
"both": Merge(meshes: ["it", "read"]),
"photo": ReadImage(path: "photo.png"),
"red": Threshold(image: "photo", select: Near(color: Param("color"))),
}, outputs: { "mesh": "both" })"##;
    let nodes = r##""out": All(mesh: "doll", number: 2.0, integer: 2, toggle: true, color: "#c33923", text: "doll.obj", choice: EdgeAndCorner, vector: (1, Expr("far"), 3))"##;
    fn with_all(nodes: &str) -> String {
        graph(nodes).replace("use: {", "use: { \"All\": \"all.ron\",")
    }
    fn files(text: &str, all: &str) -> String {
        let folder = Folder::new(&[("graph.ron", text), ("all.ron", all), ("photo.png", "")]);
        folder.problems(&[])
    }
    assert_eq!(files(&with_all(nodes), all), "");
    let wrong = r##""out": All(mesh: "doll", number: "2", integer: 2.5, toggle: yes, color: "red", text: Word, choice: Edge, vector: (1, -20, 3)),
"two": All(mesh: "doll", vector: (1, 2))"##;
    expect![[r##"
        graph.ron:3:34-37 G009 field `number` of All: expected a number, found the text "2" (parameters take values; for a parameter of the graph write Param("2"))
        graph.ron:3:48-51 G009 field `integer` of All: expected a number without fraction, found the number 2.5
        graph.ron:3:61-64 G009 field `toggle` of All: expected true or false, found `yes`
        graph.ron:3:73-78 G009 field `color` of All: `red` is not a color; write six hexadecimal digits, as in "#c33923"
        graph.ron:3:86-90 G009 field `text` of All: expected a text in double quotes, found `Word`
        graph.ron:3:100-104 G009 field `choice` of All has no choice `Edge` (did you mean `EdgeOnly`?)
        graph.ron:3:118-121 G010 field `vector` of All is -20, but must be at least -9
        graph.ron:4:34-40 G009 field `vector` of All: expected 3 values, found 2
    "##]].assert_eq(&files(&with_all(wrong), all));
}

#[test]
fn a_trap_of_uses_that_double_each_time_is_refused() {
    fn lib(inner: &str) -> String {
        let nodes = (0..10).map(|k| format!("\"n{k}\": {inner},"));
        format!(
            "Graph(format: 1, use: {{ {} }}, inputs: {{}}, nodes: {{ {} }}, outputs: {{}})",
            if inner == "I()" { "\"I\": \"INNER\"" } else { "" },
            String::from_iter(nodes)
        )
    }
    let mut files = vec![(
        "l0.ron".to_owned(),
        lib("PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]])"),
    )];
    for k in 1..9 {
        files.push((format!("l{k}.ron"), lib("I()").replace("INNER", &format!("l{}.ron", k - 1))));
    }
    let top = lib("I()").replace("INNER", "l8.ron").replace("inputs: {}, ", "");
    files.push(("graph.ron".to_owned(), top));
    let files: Vec<_> = files.iter().map(|(name, text)| (&name[..], &text[..])).collect();
    let folder = Folder::new(&files);
    assert!(folder.problems(&[]).contains("more than 1000000 nodes"), "{}", folder.problems(&[]));
}

#[test]
fn a_graph_with_inputs_is_checked_by_itself_and_cannot_be_computed_without_values() {
    let folder = Folder::new(&[]);
    let checked = folder.load_with("lib/moved.ron", &[]);
    let graph = checked.graph.unwrap();
    let evaluation = evaluator().evaluate_nodes(&graph, &["it"]);
    let problems = evaluation.diagnostics();
    assert_eq!(problems.len(), 1);
    assert_eq!(
        problems[0].message,
        "`mesh` cannot be computed: it is an input without a value: `maquette run --input mesh=FILE` gives it one, as does a graph \
            that uses this one"
    );
}

#[test]
fn a_node_that_fails_inside_says_where() {
    let moved = MOVED.replace(
        "Transform(mesh: \"mesh\", translate: (Param(\"step\"), 0, 0))",
        "ReadMesh(path: \"bad.obj\")",
    );
    let text = graph(r#""out": Moved(mesh: "doll")"#);
    let folder = Folder::new(&[
        ("graph.ron", &text),
        ("lib/moved.ron", &moved),
        ("lib/bad.obj", "v 1 x 2\n"),
    ]);
    let graph = folder.graph();
    let problems = evaluator().evaluate_all(&graph).diagnostics();
    assert_eq!(problems.len(), 1, "{problems:?}");
    let problem = &problems[0];
    assert!(problem.source.name.ends_with(Path::new("lib/moved.ron")));
    assert_eq!(Position::from_offset(&problem.source.text, problem.span.start).line, 7);
    assert_eq!(problem.uses.iter().map(|at| &at.name[..]).collect::<Vec<_>>(), ["out"]);
}

#[test]
fn every_file_of_a_graph_is_known_even_if_it_is_not_there() {
    let text =
        graph(r#""out": Moved(mesh: "doll")"#).replace("use: {", "use: { \"Gone\": \"gone.ron\",");
    let folder = Folder::new(&[("graph.ron", &text)]);
    fn names(checked: &CheckedGraph) -> Vec<String> {
        checked
            .subgraphs
            .iter()
            .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
            .collect()
    }
    assert_eq!(names(&folder.load_with("graph.ron", &[])), ["gone.ron", "moved.ron"]);
}

#[test]
fn graphs_may_be_nested_deeply_and_circles_end() {
    let mut files = vec![("g0.ron".to_owned(), MOVED.to_owned())];
    for k in 1..250 {
        let inner = format!("g{}.ron", k - 1);
        let text =
            MOVED.replace("Graph(", &format!("Graph(use: {{ \"Moved\": \"{inner}\" }},")).replace(
                "Transform(mesh: \"mesh\", translate: (Param(\"step\"), 0, 0))",
                "Moved(mesh: \"mesh\", step: Param(\"step\"))",
            );
        files.push((format!("g{k}.ron"), text));
    }
    let text = graph(r#""out": Moved(mesh: "doll", step: 4.0)"#).replace("lib/moved", "g249");
    files.push(("graph.ron".to_owned(), text));
    let files: Vec<_> = files.iter().map(|(name, text)| (&name[..], &text[..])).collect();
    let folder = Folder::new(&files);
    assert_eq!(folder.x_of(&[], "out"), 4.0);
}
