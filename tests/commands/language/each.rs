//! A watch of a `ForEach` over data that change.

use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    nodes: {
        "cloud": ReadPoints(path: "cloud.xyz"),
        "moved": ForEach(graph: "Transform", over: "cloud", with: (translate: (1.0, 0.0, 0.0))),
        "second": Transform(mesh: "moved/2", scale: (2.0, 2.0, 2.0)),
    },
    outputs: { "second.xyz": "second" },
)
"#;

/// Makes a project whose graph iterates over this number of points.
fn project(points: usize) -> Project {
    let project = Project::new(GRAPH);
    put(&project, points);
    project
}

fn put(project: &Project, points: usize) {
    let lines = (0..points).map(|k| format!("{k} 0 0\n"));
    project.write("cloud.xyz", lines.collect::<String>());
}

#[test]
fn a_watch_runs_what_is_new_when_the_data_change() {
    let project = project(3);
    let everything = GRAPH.replace("over: \"cloud\"", "over: \"cloud\", most: 4");
    project.save(&everything);
    let mut watch = project.watch(&[]);
    put(&project, 4);
    let more = watch.run();
    assert_eq!(more.done["ok"], true);
    assert_eq!((more.state("moved/mesh"), more.state("moved/2")), ("computed", "cached"));
    put(&project, 5);
    let many = watch.run();
    assert!(many.problems.to_string().contains("has 5 elements"), "{many:?}");
    put(&project, 2);
    assert_eq!(watch.run().done["ok"], true);
    project.assert_outputs_are_right();
}
