//! A graph with a node of a pack that is not there.

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

#[test]
fn what_does_not_need_the_unknown_node_is_written_and_the_error_is_told_once() {
    let project = Project::new(GRAPH);
    std::fs::write(project.folder().join("ball.obj"), BALL).unwrap();
    let run = project.maquette(&["run", "doll.ron", "--out", "out"]);
    assert_eq!(run.status.code(), Some(1), "{run:?}");
    assert_eq!(Vec::from_iter(project.outputs().into_keys()), ["big.ply"]);
    let told = String::from_utf8(run.stderr).unwrap();
    assert_eq!(told.matches("error").count(), 1, "{told}");
    assert!(told.contains("the pack `hair` 0.3, which this program does not have"), "{told}");
    let states = String::from_utf8(run.stdout).unwrap();
    assert!(states.contains("skipped   combed"), "{states}");
    let check = project.maquette(&["check", "doll.ron"]);
    assert_eq!(check.status.code(), Some(1));
    for words in
        [&["draw", "doll.ron"][..], &["inspect", "doll.ron", "big"], &["why", "doll.ron", "big"]]
    {
        let done = project.maquette(words);
        assert!(!done.stdout.is_empty(), "{words:?}: {done:?}");
    }
    // Nothing of it is lost.
    let fmt = project.maquette(&["fmt", "--check", "doll.ron"]);
    assert!(fmt.status.success(), "{fmt:?}");
    let set = project.maquette(&["set", "doll.ron", "big.scale=(3.0, 3.0, 3.0)"]);
    assert!(set.status.success(), "{set:?}");
    let text = std::fs::read_to_string(project.graph()).unwrap();
    assert_eq!(
        text,
        GRAPH.replace("\"ball\", scale: (2.0, 2.0, 2.0)", "\"ball\", scale: (3.0, 3.0, 3.0)")
    );
}

#[test]
fn a_watch_makes_the_rest_too() {
    let project = Project::new(GRAPH);
    std::fs::write(project.folder().join("ball.obj"), BALL).unwrap();
    let mut watch = project.start(&[]);
    let run = watch.run();
    assert_eq!((run.state("big"), run.state("combed")), ("computed", "skipped"), "{run:?}");
    assert_eq!(run.done["ok"], false);
    assert_eq!(Vec::from_iter(project.outputs().into_keys()), ["big.ply"]);
}
