//! Tests of `ForEach` and `Switch`.

use expect_test::{Expect, expect};
use maquette::{RunTrace, State};

use super::folder::{Folder, evaluator, graph};

fn check_nodes(nodes: &str, expected: Expect) {
    Folder::with_nodes(nodes).check(expected);
}

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

#[test]
fn mistakes_of_repetition_are_explained() {
    check_nodes(
        r#""a": ForEach(graph: "Movd", over: [(step: 1.0), (step: 2.0)], links: (mesh: "doll")),
"b": ForEach(graph: "Moved", over: [(step: 1.0), (stp: 2.0)], with: (step: 99.0), links: (mesh: "doll")),
"c": ForEach(graph: "Moved", over: [(step: 1.0), (step: 2.0), (step: 3.0)]),
"d": ForEach(over: Param("far"), wth: ()),
"e": ForEach(graph: "Moved", over: [1, (step: 1.0)], with: 5),
"f": ForEach(graph: "Moved", over: [(), ()], links: (mesh: "doll")),
"g": Moved(mesh: "f"),
"h": Moved(mesh: "f.nothing"),
"i": ForEach(graph: "Moved", over: [(), ()], carry: (mesh: "i")),
"out": Merge(meshes: "f")"#,
        expect![[r#"
            graph.ron:3:21-27 G003 there is no node type `Movd` (did you mean `Moved`?)
            graph.ron:4:51-54 G004 Moved has no field `stp` (did you mean `step`?)
            graph.ron:4:76-80 G010 field `step` of Moved is 99 mm, but must be at least 0 and at most 10 mm
            graph.ron:5:37-48 G005 Moved needs a link at its port `mesh` (write `mesh: "node"` with a node that gives a Mesh)
            graph.ron:6:6-42 G005 ForEach needs a field `graph` (write `graph: ..`)
            graph.ron:6:34-37 G004 ForEach has no field `wth` (did you mean `with`?)
            graph.ron:7:37-38 G009 an element of ForEach is a group of fields, not the number 1 (write `(field: value, ..)`)
            graph.ron:7:60-61 G009 field `with` of ForEach: expected a group of fields: `(field: value, ..)`, found the number 5
            graph.ron:9:18-21 G012 port `mesh` of Moved takes one link, but `f` is a list of 2 (link it to a port that takes many links; `f/1` is the first)
            graph.ron:10:18-29 G007 `f` is a Moved, which has no output `nothing` (its outputs: mesh)
            graph.ron:11:1-4 G008 cycle: i/1 <- i/2 <- i/1 (a node cannot need its own result: break one of these links)
        "#]],
    );
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

#[test]
fn mistakes_of_a_switch_are_explained() {
    check_nodes(
        r#""net": PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]),
"a": Switch(cases: { "x": "doll", "y": "net", "x": "dol" }, choose: x),
"b": Switch(cases: { "x": "doll", "y": "net", "z": "dol" }, choose: x),
"c": Switch(cases: {}, choose: x),
"d": Switch(choose: x, chose: 1),
"e": Switch(cases: { "x": "e" }, choose: x),
"out": Moved(mesh: "b")"#,
        expect![[r#"
            graph.ron:4:47-50 G006 there is already a case `x` (keep one of them)
            graph.ron:5:40-45 G012 case `y` of Switch is a ControlNet, but the first one is a Mesh (use cases of one type)
            graph.ron:5:52-57 G007 there is no node `dol` (did you mean `doll`?)
            graph.ron:6:20-22 G005 Switch has no cases (write `{"name": "node", ..}`)
            graph.ron:7:6-33 G005 Switch needs a field `cases` (write `cases: ..`)
            graph.ron:7:24-29 G004 Switch has no field `chose` (did you mean `choose`?)
            graph.ron:8:1-4 G008 cycle: e <- e (a node cannot need its own result: break one of these links)
        "#]],
    );
}
