//! A graph with a node type of a pack that the program does not have.

use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    packs: { "hair": "0.3" },
    nodes: {
        "ball": ReadMesh(path: "ball.obj"),
        "strands": HairStrands(on: "ball"),
        "combed": Transform(mesh: "strands", scale: (2.0, 2.0, 2.0)),
        "big": Transform(mesh: "ball", scale: (2.0, 2.0, 2.0)),
    },
    outputs: { "hair.obj": "combed", "big.ply": "big" },
)
"#;

const BALL: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

fn project() -> Project {
    let project = Project::new(GRAPH);
    project.write("ball.obj", BALL);
    project
}

#[test]
fn a_watch_makes_the_rest_too_also_of_a_graph_that_was_whole() {
    let project = project();
    let mut watch = project.start(&[]);
    let run = watch.run();
    assert_eq!((run.state("big"), run.state("combed")), ("computed", "skipped"), "{run:?}");
    assert_eq!(run.done["ok"], false);
    assert_eq!(project.outputs().into_keys().collect::<Vec<_>>(), ["big.ply"]);
    // Give the node a known type and later an unknown type again, each time together with other changes of the graph.
    let whole = GRAPH
        .replace("HairStrands(on: \"ball\")", "Transform(mesh: \"ball\", scale: (1.0, 2.0, 1.0))");
    project.save(&whole);
    let run = watch.run_until_ok();
    assert_eq!(run.state("combed"), "computed", "{run:?}");
    let before = project.outputs();
    let other = "\"ball\", scale: (3.0, 2.0, 2.0)";
    project.save(&GRAPH.replace("\"ball\", scale: (2.0, 2.0, 2.0)", other));
    let run = watch.run();
    assert_eq!((run.state("big"), run.state("combed")), ("computed", "skipped"), "{run:?}");
    assert!(run.problems.to_string().contains("the pack `hair` 0.3"), "{run:?}");
    let outputs = project.outputs();
    // The output that depends on the unknown node cannot be computed, so its old file stays unchanged.
    assert_eq!(outputs["hair.obj"], before["hair.obj"]);
    assert_ne!(outputs["big.ply"], before["big.ply"]);
}
