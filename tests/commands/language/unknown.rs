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
    std::fs::write(project.folder().join("ball.obj"), BALL).unwrap();
    project
}

#[test]
fn what_does_not_need_the_unknown_node_is_written_and_the_error_is_told_once() {
    let project = project();
    let run = project.maquette(&["run", "doll.ron", "--out", "out"]);
    assert_eq!(run.status.code(), Some(1), "{run:?}");
    assert_eq!(project.outputs().into_keys().collect::<Vec<_>>(), ["big.ply"]);
    let told = String::from_utf8(run.stderr).unwrap();
    assert_eq!(told.matches("error").count(), 1, "{told}");
    assert!(told.contains("the pack `hair` 0.3, which this program does not have"), "{told}");
    let states = String::from_utf8(run.stdout).unwrap();
    assert!(states.contains("skipped   combed"), "{states}");
    let check = project.maquette(&["check", "doll.ron"]);
    assert_eq!(check.status.code(), Some(1));
    // The tools keep the text of the unknown node.
    let fmt = project.maquette(&["fmt", "--check", "doll.ron"]);
    assert!(fmt.status.success(), "{fmt:?}");
    let set = project.maquette(&["edit", "doll.ron", "set", "big.scale=(3.0, 3.0, 3.0)"]);
    assert!(set.status.success(), "{set:?}");
    let text = std::fs::read_to_string(project.graph()).unwrap();
    assert_eq!(
        text,
        GRAPH.replace("\"ball\", scale: (2.0, 2.0, 2.0)", "\"ball\", scale: (3.0, 3.0, 3.0)")
    );
}

#[test]
fn what_is_asked_for_and_does_not_need_it_is_given_with_a_warning() {
    let project = project();
    for words in [
        &["draw", "doll.ron", "--out", "graph.svg"][..],
        &["why", "doll.ron", "big"],
        &["inspect", "doll.ron", "big", "--out", "big.png"],
        &["render", "doll.ron", "big", "render.png"],
        &["render", "sheet", "doll.ron", "--size", "30x20"],
    ] {
        let done = project.maquette(words);
        let told = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{words:?}: {told}");
        assert!(!told.contains("error"), "{words:?}: {told}");
        let warned = told.matches("there is no node type `HairStrands`").count();
        // `inspect` reports only errors that concern the inspected node.
        assert_eq!(warned, usize::from(words[0] != "inspect"), "{words:?}: {told}");
    }
    for file in ["graph.svg", "big.png", "render.png", "doll.png"] {
        assert!(project.folder().join(file).metadata().unwrap().len() > 0, "{file}");
    }
    for words in
        [&["inspect", "doll.ron", "combed"][..], &["render", "doll.ron", "hair.obj", "a.png"]]
    {
        let done = project.maquette(words);
        let told = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(1), "{words:?}: {told}");
        assert!(told.contains("error[G003]") && told.contains("the pack `hair` 0.3"), "{told}");
    }
}

#[test]
fn what_does_not_hang_on_it_is_pinned_and_locked() {
    let project = project();
    fn run_text(words: &[&str], project: &Project) -> (String, Option<i32>) {
        let done = project.maquette(words);
        let text = String::from_utf8_lossy(&done.stdout) + String::from_utf8_lossy(&done.stderr);
        (text.into_owned(), done.status.code())
    }
    let (text, code) = run_text(&["pin", "doll.ron", "big"], &project);
    assert!(code == Some(0) && text.contains("pinned big"), "{text}");
    let (text, code) = run_text(&["pin", "doll.ron", "--list"], &project);
    assert!(code == Some(0) && text.contains("big  Mesh"), "{text}");
    let (text, code) = run_text(&["pin", "doll.ron", "combed"], &project);
    assert!(code == Some(1) && text.contains("error[G003]"), "{text}");
    let library = r#"Graph(format: 1, inputs: { "mesh": Mesh() }, nodes: { "up": Transform(mesh: "mesh") }, outputs: { "mesh": "up" })"#;
    std::fs::write(project.folder().join("up.ron"), library).unwrap();
    project.save(&GRAPH.replace("packs:", "use: { \"Up\": \"up.ron\" },\n    packs:"));
    let (text, code) = run_text(&["lock", "doll.ron"], &project);
    assert!(code == Some(0) && text.contains("1 graph"), "{text}");
    let (text, code) =
        run_text(&["edit", "doll.ron", "extract", "big", "--to", "big.ron"], &project);
    assert!(code != Some(0) && text.contains("HairStrands"), "{text}");
}

#[test]
fn why_says_what_cannot_run_and_what_is_skipped_for_it() {
    let project = project();
    let why =
        |node| String::from_utf8(project.maquette(&["why", "doll.ron", node]).stdout).unwrap();
    let reason = "there is no node type `HairStrands`: it may be of the pack `hair` 0.3, which this program does not have\n";
    assert_eq!(why("strands"), format!("`strands` cannot run: {reason}"));
    let skipped = "`combed` is skipped: it depends on `strands`, which cannot run: ";
    assert_eq!(why("combed"), format!("{skipped}{reason}"));
    assert_eq!(why("big"), "`big` runs: not computed before\n");
}

#[test]
fn a_watch_makes_the_rest_too_also_of_a_graph_that_was_whole() {
    let project = project();
    let mut watch = project.start(&[]);
    let run = watch.run();
    assert_eq!((run.state("big"), run.state("combed")), ("computed", "skipped"), "{run:?}");
    assert_eq!(run.done["ok"], false);
    assert_eq!(project.outputs().into_keys().collect::<Vec<_>>(), ["big.ply"]);
    // The node gets a known type and later an unknown type again, with other changes at the same time.
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
