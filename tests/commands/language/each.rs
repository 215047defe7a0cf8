//! `ForEach` over data on the command line: the forecast before a run, the result, and a watch while the data change.

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
    std::fs::write(project.folder().join("cloud.xyz"), lines.collect::<String>()).unwrap();
}

/// Runs a command that must succeed and returns its output.
fn run_text(project: &Project, arguments: &[&str]) -> String {
    let told = project.maquette(arguments);
    assert!(told.status.success(), "{told:?}");
    String::from_utf8(told.stdout).unwrap()
}

#[test]
fn before_it_is_run_its_number_is_said_to_be_unknown() {
    let project = project(3);
    run_text(&project, &["check", "doll.ron"]);
    run_text(&project, &["draw", "doll.ron", "--out", "graph.svg"]);
    let drawn = std::fs::read_to_string(project.folder().join("graph.svg")).unwrap();
    assert!(drawn.contains("ForEach(Transform) of ? elements"), "{drawn}");
    let why = run_text(&project, &["why", "doll.ron", "moved/3"]);
    assert_eq!(why, "how many elements `moved` has is known when the graph has been run\n");
}

#[test]
fn an_output_of_elements_is_replayed() {
    let project = Project::new(&GRAPH.replace("second.xyz", "second.ply"));
    put(&project, 3);
    run_text(&project, &["run", "doll.ron", "--out", "out"]);
    let again = run_text(&project, &["replay", "out/second.ply"]);
    assert!(again.contains("reproduced with the same bytes"), "{again}");
}

#[test]
fn elements_are_run_inspected_and_explained_by_their_names() {
    let project = project(3);
    let ran = run_text(&project, &["run", "doll.ron", "--out", "out"]);
    assert!(ran.contains("moved/2") && !ran.contains("moved/1"), "{ran}");
    let looked = run_text(&project, &["inspect", "doll.ron", "moved/3"]);
    assert!(looked.contains("(3, 0, 0)"), "{looked}");
    let data = run_text(&project, &["inspect", "doll.ron", "moved/3/mesh"]);
    assert!(data.contains("(2, 0, 0)"), "{data}");
    let all = run_text(&project, &["inspect", "doll.ron", "moved"]);
    assert_eq!(all.matches("Points").count(), 3, "{all}");
    let why = run_text(&project, &["why", "doll.ron", "moved/2"]);
    assert_eq!(why, "`moved/2` does not run: nothing that it depends on changed\n");
    let plan = run_text(&project, &["run", "-n", "doll.ron"]);
    assert!(plan.contains("cached") && !plan.contains("runs"), "{plan}");
    let none = project.maquette(&["inspect", "doll.ron", "moved/4"]);
    assert!(String::from_utf8(none.stderr).unwrap().contains("no node `moved/4`"));
}

#[test]
fn its_text_is_formatted_edited_and_compared_as_any_other() {
    let project = project(3);
    assert_eq!(run_text(&project, &["fmt", "--check", "doll.ron"]), "");
    run_text(&project, &["edit", "doll.ron", "set", "moved.most=20"]);
    run_text(&project, &["edit", "doll.ron", "rename", "cloud", "dots"]);
    run_text(&project, &["edit", "doll.ron", "rename", "moved", "shifted"]);
    let text = std::fs::read_to_string(project.graph()).unwrap();
    assert!(text.contains("over: \"dots\"") && text.contains("most: 20"), "{text}");
    assert!(text.contains("mesh: \"shifted/2\""), "{text}");
    std::fs::write(project.folder().join("before.ron"), GRAPH).unwrap();
    let told = project.maquette(&["diff", "before.ron", "doll.ron"]);
    let told = String::from_utf8(told.stdout).unwrap();
    assert!(told.contains("node shifted: ") && told.contains("node dots: renamed"), "{told}");
}

#[test]
fn goldens_hold_for_its_elements() {
    let project = project(3);
    let test = "Test(graph: \"doll.ron\")";
    std::fs::write(project.folder().join("doll.test.ron"), test).unwrap();
    let bless = &["test", "doll.test.ron", "--bless"];
    let blessed = project.command(bless).env_remove("CI").output().unwrap();
    assert!(blessed.status.success(), "{blessed:?}");
    run_text(&project, &["test", "doll.test.ron"]);
    put(&project, 1);
    let told = project.maquette(&["test", "doll.test.ron"]);
    assert!(!told.status.success());
    let told = [told.stdout, told.stderr].concat();
    let told = String::from_utf8(told).unwrap();
    assert!(told.contains("`moved` has 1 element"), "{told}");
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

#[test]
fn an_output_is_inspected_by_its_name_and_no_elements_are_a_list_of_0() {
    let project = project(3);
    let told = run_text(&project, &["inspect", "doll.ron", "second.xyz"]);
    assert!(told.starts_with("second.") && told.contains(": Points"), "{told}");
    let each =
        "\"none\": ForEach(graph: \"Transform\", over: Param(\"n\"), links: (mesh: \"cloud\")),";
    let none = format!("params: {{ \"n\": Integer(default: 0) }}, nodes: {{ {each}");
    project.save(&GRAPH.replace("nodes: {", &none));
    assert_eq!(run_text(&project, &["inspect", "doll.ron", "none"]), "none: empty list\n");
}

#[test]
fn data_that_fail_have_no_elements_of_a_run_before() {
    let graph = GRAPH.replace("moved/2", "moved/1").replace("scale: (2.0, 2.0, 2.0)", "");
    let graph = graph.replace("Transform(mesh: \"moved/1\", )", "Merge(meshes: \"moved\")");
    let graph = graph.replace("ReadPoints(path: \"cloud.xyz\")", "ReadMesh(path: \"part.obj\")");
    let graph = graph.replace("over: \"cloud\"", "over: Parts(\"cloud\")");
    let project = Project::new(&graph.replace("second.xyz", "second.obj"));
    let file = project.folder().join("part.obj");
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n";
    std::fs::write(&file, triangle.repeat(3)).unwrap();
    assert!(run_text(&project, &["run", "doll.ron"]).contains("moved/3"));
    std::fs::write(&file, "").unwrap();
    fn run_errors(more: &[&str], project: &Project) -> Vec<String> {
        let output = project.maquette(&[&["run", "doll.ron"], more].concat());
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let told = String::from_utf8(output.stdout).unwrap();
        told.lines().filter(|it| it.contains("Transform")).map(str::to_owned).collect::<Vec<_>>()
    }
    let fresh = run_errors(&["--no-cache"], &project);
    assert_eq!(fresh.len(), 1, "{fresh:?}");
    assert_eq!(run_errors(&[], &project), fresh);
}
