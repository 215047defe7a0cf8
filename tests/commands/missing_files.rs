//! A watch of a graph that reads a missing file.

use crate::project::{Project, TETRAHEDRON};

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "which": Choice(default: Good, of: [Good, Bad], doc: "Which.") },
    nodes: {
        "good": ReadMesh(path: "tet.obj"),
        "bad": ReadMesh(path: "tte.obj"),
        "moved": Transform(mesh: "bad"),
        "chosen": Switch(choose: Param("which"), cases: { "Good": "good", "Bad": "moved" }),
    },
    outputs: { "good.obj": "good", "bad.obj": "moved", "chosen.obj": "chosen" },
)
"#;

pub(crate) fn project() -> Project {
    Project::with_tetrahedron(GRAPH)
}

#[test]
fn a_watch_goes_on_and_takes_the_file_as_soon_as_it_is_there() {
    let project = project();
    let mut watch = project.start(&[]);
    let run = watch.run();
    assert_eq!((run.state("good"), run.state("bad")), ("computed", "failed"), "{run:?}");
    assert_eq!(run.problems[0]["message"], "there is no file `tte.obj`");
    // Write other content than that of `good`'s file. For equal content the result would already be cached.
    let other = TETRAHEDRON.replace('9', "8");
    project.write("tte.obj", &other);
    assert_eq!(watch.run_until_ok().state("bad"), "computed");
    watch.end();
    project.assert_outputs_are_right();
}
