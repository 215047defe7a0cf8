//! The expectations of a graph with inputs are checked wherever that graph is used. Failures are reported at the node that uses it.

use std::path::{Path, PathBuf};

use maquette::value::Mesh;
use maquette::{Diagnostic, Graph, Options, Position, Run, Session, Settings, Targets};
use maquette_nodes::PACKS;

/// A tetrahedron without its last face.
const OPEN: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n";

/// A graph that expects properties of its input, of a node and of its output.
const CAP: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh() },
    params: { "wide": Number(default: 2.0) },
    nodes: { "it": Transform(mesh: "mesh", scale: (Param("wide"), 1, 1)), "other": Merge(meshes: ["it"]) },
    outputs: { "skin": "it", "rest": "other" },
    expect: [
        Closed("mesh"),
        Bounds(of: "it", low: (0, 0, 0), high: (3, 1, 1)),
        Count(of: "skin", what: "faces", min: 4),
    ],
)"#;

struct Project {
    folder: tempfile::TempDir,
    session: Session,
}

impl Project {
    fn new(graph: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let closed = format!("{OPEN}f 1 4 3\n");
        let files =
            [("open.obj", OPEN), ("closed.obj", &closed), ("cap.ron", CAP), ("graph.ron", graph)];
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let settings = Settings { threads: 2, ..Settings::in_memory() };
        Self { folder, session: Session::new(PACKS, &settings).unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn load(&self, name: &str) -> Graph {
        let checked = self.session.load(&self.path(name), &Options::default());
        checked.graph.unwrap_or_else(|| panic!("{:#?}", checked.diagnostics))
    }

    /// Runs `graph.ron` for these targets. Returns the messages.
    fn run_messages(&mut self, wanted: Targets) -> Vec<String> {
        let graph = self.load("graph.ron");
        let finished =
            self.session.run(&graph, &Run { targets: wanted, ..Run::default() }).unwrap();
        let problems = finished.diagnostics();
        problems.iter().map(|problem| line(problem, self.folder.path())).collect()
    }
}

/// Formats a diagnostic as `file:line code message (help) <- uses`.
fn line(problem: &Diagnostic, folder: &Path) -> String {
    let place = Position::from_offset(&problem.source.text, problem.span.start).line;
    let file = problem.source.name.file_name().unwrap().to_string_lossy().into_owned();
    let uses = problem.uses.iter().map(|at| format!(" <- {} at {}", at.name, at.location()));
    let (code, message, help) = (problem.code, &problem.message, &problem.help);
    let text = format!("{file}:{place} {code} {message} ({help}){}", String::from_iter(uses));
    text.replace(&format!("{}/", folder.display()), "")
}

fn graph(nodes: &str, outputs: &str) -> String {
    format!(
        "Graph(format: 1, use: {{ \"Cap\": \"cap.ron\" }}, nodes: {{\n\"open\": ReadMesh(path: \"open.obj\"),\n\
         \"closed\": ReadMesh(path: \"closed.obj\"),\n{nodes}\n}}, outputs: {{ {outputs} }})"
    )
}

const OF_THE_INPUT: &str = "expected Closed, but `a.mesh` has 3 edges with one face (vertices 0-2, 0-3, 2-3; the first is at (0, 0.5, 0))";
const OF_THE_OUTPUT: &str = "expected Count, but `a.skin` has 3 faces, expected at least 4";

#[test]
fn what_does_not_hold_is_told_at_the_use_with_the_place_inside() {
    let text = graph(
        r#""a": Cap(mesh: "open"), "b": Cap(mesh: "closed", wide: 4.0)"#,
        r#""a.ply": "a", "b.ply": "b""#,
    );
    let mut project = Project::new(&text);
    let told = project.run_messages(Targets::Outputs);
    let box_of_b = "expected Bounds, but `b/it` has 1 vertices outside of the box; the first is 1 at (4, 0, 0)";
    let expected = [
        format!("graph.ron:4 G020 {OF_THE_INPUT} (this is expected at cap.ron:8:9)"),
        format!("graph.ron:4 G020 {OF_THE_OUTPUT} (this is expected at cap.ron:10:9)"),
        format!("graph.ron:4 G020 {box_of_b} (this is expected at cap.ron:9:9)"),
    ];
    assert_eq!(told, expected);
}

#[test]
fn a_nested_use_and_an_element_tell_the_way_to_them() {
    let outer = r#"Graph(format: 1, use: { "Cap": "cap.ron" }, inputs: { "mesh": Mesh() },
nodes: { "inner": Cap(mesh: "mesh") }, outputs: { "skin": "inner" })"#;
    let text = graph(
        r#""both": ForEach(graph: "Outer", over: [(mesh: "closed"), (mesh: "open")]), "out": Merge(meshes: "both")"#,
        r#""out.ply": "out""#,
    );
    let mut project = Project::new(&text.replace("use: {", r#"use: { "Outer": "outer.ron","#));
    std::fs::write(project.path("outer.ron"), outer).unwrap();
    let told = project.run_messages(Targets::Outputs);
    assert_eq!(told.len(), 2, "{told:#?}");
    let input = OF_THE_INPUT.replace("`a.mesh`", "`both/2/inner.mesh`");
    let way = " <- inner at outer.ron:2:10";
    assert_eq!(told[0], format!("graph.ron:4 G020 {input} (this is expected at cap.ron:8:9){way}"));
}

#[test]
fn each_element_of_data_is_judged_and_its_example_is_not() {
    let text = graph(
        r#""all": Merge(meshes: ["closed", "open"]), "caps": ForEach(graph: "Cap", over: Parts("all")), "out": Merge(meshes: "caps.skin")"#,
        r#""out.ply": "out""#,
    );
    let mut project = Project::new(&text);
    let told = project.run_messages(Targets::Outputs);
    let expected = [
        format!("{OF_THE_INPUT} (this is expected at cap.ron:8:9)"),
        format!("{OF_THE_OUTPUT} (this is expected at cap.ron:10:9)"),
    ];
    let of_the_second =
        expected.map(|it| format!("graph.ron:4 G020 {}", it.replace("`a.", "`caps/2.")));
    assert_eq!(told, of_the_second);
    // A `ForEach` without elements checks no expectations, not even those of the example element that represents its elements.
    std::fs::write(project.path("closed.obj"), "").unwrap();
    std::fs::write(project.path("open.obj"), "").unwrap();
    assert!(!project.run_messages(Targets::Outputs).iter().any(|told| told.contains("G020")));
}

#[test]
fn what_a_graph_wants_is_tested_before_each_element_runs() {
    let lib = r#"Graph(format: 1, inputs: { "mesh": Mesh(wants: [Closed]) },
nodes: { "it": Transform(mesh: "mesh", translate: (1, 0, 0)) }, outputs: { "moved": "it" })"#;
    let text = graph(
        r#""all": Merge(meshes: ["closed", "open"]), "caps": ForEach(graph: "Cap", over: Parts("all")), "out": Merge(meshes: "caps")"#,
        r#""out.ply": "out""#,
    );
    let mut project = Project::new(&text);
    std::fs::write(project.path("cap.ron"), lib).unwrap();
    let told = project.run_messages(Targets::Outputs);
    let [told] = &told[..] else { panic!("{told:#?}") };
    let expected = "graph.ron:4 G016 input `mesh` of `caps/2` wants Mesh[Closed], but `caps/2/mesh` has 3 edges with one face";
    assert!(told.contains(expected), "{told}");
}

#[test]
fn an_input_that_is_left_out_is_so_for_each_element() {
    let lib = r#"Graph(format: 1, inputs: { "mesh": Mesh(), "more": Optional(Mesh()) },
nodes: { "it": Merge(meshes: ["mesh", "more"]) }, outputs: { "both": "it" })"#;
    for (with, faces) in [("", 7), (r#", links: (more: "open")"#, 13)] {
        let nodes = format!(
            r#""all": Merge(meshes: ["closed", "open"]), "caps": ForEach(graph: "Cap", over: Parts("all"){with}), "out": Merge(meshes: "caps")"#
        );
        let mut project = Project::new(&graph(&nodes, r#""out.ply": "out""#));
        std::fs::write(project.path("cap.ron"), lib).unwrap();
        let graph = project.load("graph.ron");
        let finished = project.session.run(&graph, &Run::default()).unwrap();
        assert_eq!(finished.diagnostics().len(), 0, "{:#?}", finished.diagnostics());
        assert_eq!(finished.get::<Mesh>("out").unwrap().faces().len(), faces);
    }
}

#[test]
fn a_use_that_nothing_needs_expects_nothing() {
    let nodes = r#""a": Cap(mesh: "open"), "b": Cap(mesh: "closed"), "out": Switch(cases: { "a": "a", "b": "b" }, choose: b)"#;
    let mut project = Project::new(&graph(nodes, r#""out.ply": "out""#));
    assert_eq!(project.run_messages(Targets::Outputs), [""; 0]);
    // If outputs are requested by name, the expectations of the used graphs are still checked. Nothing else is computed for that.
    assert_eq!(project.run_messages(Targets::Named(vec!["a.skin".into()])).len(), 2);
    assert_eq!(project.run_messages(Targets::Nodes(vec!["a".into()])), [""; 0]);
}

#[test]
fn alone_as_a_function_it_expects_the_same() {
    let mut project = Project::new(&graph("", ""));
    let cap = project.load("cap.ron");
    for (file, expected) in [("open.obj", 2), ("closed.obj", 0)] {
        let files = [("mesh".to_owned(), project.path(file))];
        let (inputs, _) = project.session.read_inputs(&cap, &files).unwrap();
        let run = project.session.run(&cap, &Run { inputs, ..Run::default() }).unwrap();
        let told: Vec<_> =
            run.diagnostics().iter().map(|it| line(it, project.folder.path())).collect();
        assert_eq!(told.len(), expected, "{told:#?}");
        assert!(told.iter().all(|it| it.starts_with("cap.ron:")), "{told:#?}");
        assert!(run.get::<Mesh>("skin").is_ok());
    }
}

#[test]
fn what_is_expected_names_values_that_are_there() {
    let mut project = Project::new(&graph(r#""a": Cap(mesh: "open")"#, r#""a.ply": "a""#));
    let text = CAP.replace("Closed(\"mesh\")", "Closed(\"msh\"), Closd(\"it\")");
    std::fs::write(project.path("cap.ron"), &text).unwrap();
    let checked = project.session.load(&project.path("graph.ron"), &Options::default());
    let told = checked.diagnostics.iter().map(|problem| line(problem, project.folder.path()));
    let told = String::from_iter(told);
    assert!(told.contains("cap.ron:8 G009") && told.contains("Closd"), "{told}");
    std::fs::write(project.path("cap.ron"), CAP).unwrap();
    assert_eq!(project.run_messages(Targets::Outputs).len(), 2);
}
