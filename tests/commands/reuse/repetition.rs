//! Tests of `ForEach` and `Switch`.

use maquette::{RunTrace, State};

use super::folder::{Folder, evaluator, graph};

#[test]
fn what_is_carried_goes_from_element_to_element() {
    let folder = Folder::with_nodes(
        r#""many": ForEach(graph: "Moved", over: [(step: 1.0), (step: Param("far")), ()], with: (step: 0.5), carry: (mesh: "doll")),
"out": Moved(mesh: "many", step: 0.25)"#,
    );
    assert_eq!(
        Vec::from_iter(folder.graph().node_names()),
        ["doll", "many/1/it", "many/2/it", "many/3/it", "out/it"]
    );
    assert_eq!(folder.x_of(&[], "many"), 4.5);
    assert_eq!(folder.x_of(&[], "many.mesh"), 4.5);
    assert_eq!(folder.x_of(&[], "many/2"), 4.0);
    assert_eq!(folder.x_of(&[("far", "2")], "out"), 3.75);
    assert_eq!(folder.x_of(&[("many.with.step", "1")], "out"), 5.25);
    assert_eq!(folder.x_of(&[("many/1.step", "2")], "out"), 5.75);
    assert_eq!(folder.x_of(&[("many.over.0.step", "2")], "out"), 5.75);
}

#[test]
fn without_elements_what_is_carried_stays_as_it_was() {
    let folder = Folder::with_nodes(
        r#""none": ForEach(graph: "Moved", over: [], carry: (mesh: "doll")), "out": Moved(mesh: "none")"#,
    );
    assert_eq!(folder.x_of(&[], "out"), 1.0);
}

#[test]
fn what_is_not_carried_is_a_list_for_ports_that_take_many() {
    let nodes = r#""each": ForEach(graph: "Moved", over: [(step: 1.0), (step: 2.0)], links: (mesh: "doll")),
"files": ForEach(graph: "ReadMesh", over: [(path: "doll.obj"), (path: "doll.obj"), (path: "doll.obj")]),
"none": ForEach(graph: "Moved", over: [], links: (mesh: "doll")),
"some": Merge(meshes: "each.mesh"),
"more": Merge(meshes: ["doll", "each", "files.mesh", "none"]),
"out": Merge(meshes: ["some", "more"])"#;
    let folder = Folder::with_nodes(nodes);
    let graph = folder.graph();
    let evaluation = evaluator().evaluate_all(&graph);
    assert_eq!(evaluation.diagnostics(), []);
    fn count(node: &str, graph: &maquette::Graph) -> usize {
        let evaluation = evaluator().evaluate_nodes(graph, &[node]);
        let mesh = evaluation.find(graph, node, "").unwrap();
        mesh.get::<maquette::value::Mesh>().unwrap().positions().len() / 4
    }
    assert_eq!([count("some", &graph), count("more", &graph), count("out", &graph)], [2, 6, 8]);
    assert_eq!(folder.x_of(&[], "some"), 1.0);
}

/// Returns the names of the nodes that were not cached.
fn busy(trace: &RunTrace) -> Vec<&str> {
    let busy = trace.0.iter().filter(|node| node.state != State::Cached);
    busy.map(|node| &node.name[..]).collect()
}

#[test]
fn one_of_twenty_elements_runs_what_depends_on_it_alone() {
    fn step(k: usize) -> String {
        match k {
            11 => "Param(\"far\")".to_owned(),
            _ => format!("{:?}", 0.25 + k as f64 / 8.0),
        }
    }
    let elements = (0..20).map(|k| format!("(step: {})", step(k)));
    let elements = Vec::from_iter(elements).join(", ");
    let nodes = format!(
        "\"each\": ForEach(graph: \"Moved\", over: [{elements}], links: (mesh: \"doll\")), \"out\": Merge(meshes: \"each\")"
    );
    let folder = Folder::with_nodes(&nodes);
    let mut evaluator = evaluator();
    fn run(set: &[(&str, &str)], folder: &Folder, evaluator: &mut maquette::Evaluator) -> RunTrace {
        let graph = folder.load_with("graph.ron", set).graph.unwrap();
        evaluator.evaluate_all(&graph).trace()
    }
    assert_eq!(run(&[], &folder, &mut evaluator).0.len(), 22);
    assert_eq!(busy(&run(&[("far", "4")], &folder, &mut evaluator)), ["each/12/it", "out"]);
    assert_eq!(
        busy(&run(&[("far", "4"), ("each/3.step", "9")], &folder, &mut evaluator)),
        ["each/3/it", "out"]
    );
}

#[test]
fn a_change_runs_the_elements_behind_it_where_something_is_carried() {
    let elements = (0..20).map(|_| "(step: 1.0)").collect::<Vec<_>>().join(", ");
    let nodes = format!(
        "\"each\": ForEach(graph: \"Moved\", over: [{elements}], carry: (mesh: \"doll\")), \"out\": Moved(mesh: \"each\")"
    );
    let folder = Folder::with_nodes(&nodes);
    let mut evaluator = evaluator();
    fn run(set: &[(&str, &str)], folder: &Folder, evaluator: &mut maquette::Evaluator) -> RunTrace {
        let graph = folder.load_with("graph.ron", set).graph.unwrap();
        evaluator.evaluate_all(&graph).trace()
    }
    run(&[], &folder, &mut evaluator);
    assert_eq!(
        busy(&run(&[("each/18.step", "2")], &folder, &mut evaluator)),
        ["each/18/it", "each/19/it", "each/20/it", "out/it"]
    );
}

const SWITCH: &str = r#"Graph(format: 1, params: { "quality": Choice(default: low, of: [low, high, none]) }, nodes: {
"doll": ReadMesh(path: "doll.obj"),
"a": Subdivide(mesh: "doll", scheme: Loop, levels: 1),
"b": Subdivide(mesh: "doll", scheme: Loop, levels: 3),
"it": Switch(cases: { "low": "a", "high": "b.mesh" }, choose: Param("quality")),
"out": Transform(mesh: "it", scale: (2, 2, 2)),
}, outputs: { "out.ply": "out", "it.ply": "it" })"#;

#[test]
fn only_the_chosen_branch_is_evaluated() {
    let folder = Folder::new(&[("graph.ron", SWITCH)]);
    fn names(set: &[(&str, &str)], folder: &Folder) -> Vec<String> {
        let graph = folder.load_with("graph.ron", set).graph.unwrap();
        let trace = evaluator().evaluate_all(&graph).trace();
        trace.0.iter().map(|node| node.name.clone()).collect()
    }
    assert_eq!(names(&[], &folder), ["doll", "a", "out"]);
    assert_eq!(names(&[("quality", "high")], &folder), ["doll", "b", "out"]);
    assert_eq!(names(&[("it.choose", "high")], &folder), ["doll", "b", "out"]);
    assert_eq!(
        folder.problems(&[("quality", "none")]),
        "graph.ron:5:63-79 G009 Switch has no case `none` (its cases: low, high)\n"
    );
}

#[test]
fn each_use_chooses_for_itself() {
    let lib = SWITCH
        .replace(
            "Graph(format: 1, params: {",
            "Graph(format: 1, inputs: { \"doll\": Mesh() }, params: {",
        )
        .replace("\"doll\": ReadMesh(path: \"doll.obj\"),", "")
        .replace(
            "outputs: { \"out.ply\": \"out\", \"it.ply\": \"it\" }",
            "outputs: { \"mesh\": \"it\" }",
        );
    let text = graph(r#""low": Both(doll: "doll"), "high": Both(doll: "doll", quality: high), "out": Merge(meshes: ["low", "high"])"#)
        .replace("use: {", "use: { \"Both\": \"both.ron\",");
    let folder = Folder::new(&[("graph.ron", &text), ("both.ron", &lib)]);
    let graph = folder.graph();
    let trace = evaluator().evaluate_all(&graph).trace();
    let names: Vec<_> = trace.0.iter().map(|node| &node.name[..]).collect();
    assert_eq!(names, ["doll", "low/a", "high/b", "out"]);
}
