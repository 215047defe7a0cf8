//! Test files: `check` reports their errors, and `test` reports them before it accepts any result.

use std::process::Output;

use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "far": Number(default: 1.0) },
    nodes: {
        "net": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, Param("far"))]]),
        "flat": Nurbs(net: "net"),
    },
    outputs: { "flat.ply": "flat" },
)"#;

/// Makes a project with the graph and these test files.
fn project(tests: &[(&str, &str)]) -> Project {
    let project = Project::new(GRAPH);
    for (name, text) in tests {
        std::fs::write(project.folder().join(name), text).unwrap();
    }
    project
}

fn errors(output: &Output) -> Vec<String> {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    let lines = text.lines().map(str::trim_start);
    let told = lines.filter(|line| line.starts_with("error[") || line.starts_with("--> "));
    let told: Vec<_> = told.map(str::to_owned).collect();
    // Some commands write `./name` for files of the current folder.
    told.chunks(2).map(|lines| lines.join(" ").replace("./", "")).collect()
}

/// Returns the errors that `check` reports for a file. Also checks that `test --bless` reports the same errors and accepts nothing.
fn check_and_bless(project: &Project, file: &str) -> Vec<String> {
    let told = errors(&project.maquette(&["check", file]));
    let mut bless = project.command(&["test", file, "--bless"]);
    let blessed = bless.env_remove("CI").output().unwrap();
    assert_eq!((errors(&blessed), blessed.status.code()), (told.clone(), Some(2)));
    assert!(!project.folder().join("goldens").exists());
    told
}

#[test]
fn two_files_with_a_case_of_one_name_would_share_its_goldens() {
    fn test_text(value: i32) -> String {
        format!("Test(graph: \"doll.ron\", cases: {{ \"x\": (set: {{ \"far\": {value} }}) }})")
    }
    let project = project(&[("one.test.ron", &test_text(1)), ("two.test.ron", &test_text(2))]);
    let told = check_and_bless(&project, ".");
    assert!(told[0].starts_with("error[G006]: case `x` of"), "{told:?}");
    assert!(told[0].contains("one.test.ron and in") && told[0].contains("two.test.ron --> "));
    assert_eq!(told.len(), 1);
    // If only one of the two files is checked, the conflict is also reported.
    assert_eq!(
        check_and_bless(&project, "one.test.ron"),
        [
            "error[G006]: case `x` of doll.ron is in two.test.ron and in one.test.ron --> one.test.ron:1:34"
        ]
    );
    // A case without a name is named `default`, and the pattern `*.ron` includes this graph.
    let unnamed =
        [("one.test.ron", "Test(graph: \"doll.ron\")"), ("two.test.ron", "Test(graph: \"*.ron\")")];
    let project = self::project(&unnamed);
    assert_eq!(
        check_and_bless(&project, "two.test.ron"),
        [
            "error[G006]: case `default` of doll.ron is in one.test.ron and in two.test.ron --> two.test.ron:1:1"
        ]
    );
}

#[test]
fn a_name_that_stands_twice_in_a_test_is_told_at_the_second_one() {
    let text = r#"Test(
    graph: "doll.ron",
    cases: {
        "a": (set: { "far": 1, "far": 2 }),
        "a": (inputs: { "m": "a.ply", "m": "b.ply" }),
    },
    compare: { "flat.ply": Surface(max: 1), "flat.ply": Surface(max: 2) },
    budget: (seconds: 1), budget: (seconds: 2),
)"#;
    let project = project(&[("doll.test.ron", text)]);
    assert_eq!(
        check_and_bless(&project, "doll.test.ron"),
        [
            "error[G006]: value `far` is given twice --> doll.test.ron:4:32",
            "error[G006]: case `a` is given twice --> doll.test.ron:5:9",
            "error[G006]: input `m` is given twice --> doll.test.ron:5:39",
            "error[G006]: output `flat.ply` is given twice --> doll.test.ron:7:45",
            "error[G006]: field `budget` is given twice --> doll.test.ron:8:27",
        ]
    );
}

#[test]
fn what_a_case_sets_wrongly_is_told_in_the_test() {
    let text = r#"Test(
    graph: "doll.ron",
    cases: {
        "a": (set: { "far": 2, "fra": 1, "net.point": 3, "net.points.7": 3 }),
        "b": (inputs: { "m": "nope.obj" }),
    },
)"#;
    let project = project(&[("doll.test.ron", text)]);
    let told = errors(&project.maquette(&["check", "doll.test.ron"]));
    assert_eq!(
        told,
        [
            "error[G013]: input `m`: there is no file `nope.obj` --> doll.test.ron:5:30",
            "error[G004]: there is no item `7` --> doll.test.ron:4:58",
            "error[G007]: the graph has no parameter `fra` --> doll.test.ron:4:32",
            "error[G004]: PointNet has no field `point` --> doll.test.ron:4:42",
            "error[G004]: the graph has no input `m` --> doll.test.ron:5:25",
        ]
    );
    let text = text.replace("nope.obj", "doll.ron");
    std::fs::write(project.folder().join("doll.test.ron"), text).unwrap();
    let told = check_and_bless(&project, "doll.test.ron");
    assert_eq!(
        told,
        [
            "error[G004]: there is no item `7` --> doll.test.ron:4:58",
            "error[G007]: the graph has no parameter `fra` --> doll.test.ron:4:32",
            "error[G004]: PointNet has no field `point` --> doll.test.ron:4:42",
            "error[G004]: the graph has no input `m` --> doll.test.ron:5:25",
        ]
    );
}

#[test]
fn what_a_test_wants_of_values_is_judged_by_their_types() {
    let text = r#"Test(
    graph: "doll.ron",
    compare: { "flat.pyl": Surface(max: 1), "flat.ply": Image(level: 2) },
    expect: [
        Closed("nope"),
        Near(of: "flat.ply", to: "nope", max: 1),
        Count(of: "flat", what: "feces", min: 1),
        Bounds(of: "flat", low: (0, 0, 1), high: (1, 1, 0)),
    ],
)"#;
    let project = project(&[("doll.test.ron", text)]);
    assert_eq!(
        check_and_bless(&project, "doll.test.ron"),
        [
            "error[G007]: the graph has no output `flat.pyl` --> doll.test.ron:3:16",
            "error[G012]: `flat.ply` is a Surface, not an Image --> doll.test.ron:3:57",
            "error[G007]: there is no output or node `nope` --> doll.test.ron:5:16",
            "error[G007]: there is no output or node `nope` --> doll.test.ron:6:34",
            "error[G009]: a Surface has no count of `feces` --> doll.test.ron:7:33",
            "error[G009]: along z, `low`, 1, is above `high`, 0 --> doll.test.ron:8:33",
        ]
    );
}

#[test]
fn a_name_inside_of_a_use_is_compared_with_those_beside_it() {
    let graph = r#"Graph(
    format: 1,
    use: { "Two": "two.ron" },
    nodes: {
        "mesh": ReadMesh(path: "coarse.obj"),
        "one": Two(mesh: "mesh"),
        "many": ForEach(graph: "Two", over: [(), ()], with: (mesh: "mesh")),
        "all": Merge(meshes: ["one", "many"]),
    },
    outputs: { "all.ply": "all" },
)"#;
    let used = r#"Graph(format: 1, inputs: { "mesh": Mesh() }, nodes: {
        "first": Transform(mesh: "mesh"), "last": Transform(mesh: "first") }, outputs: { "mesh": "last" })"#;
    let test = r#"Test(graph: "doll.ron", expect: [Closed("many/2/last"), Closed("many/3/last"), Closed("one/frst")])"#;
    let project = project(&[("two.ron", used), ("doll.test.ron", test)]);
    project.copy_asset("coarse.obj", "coarse.obj");
    project.save(graph);
    let told = String::from_utf8(project.maquette(&["check", "doll.test.ron"]).stderr).unwrap();
    let helps = told.lines().filter_map(|line| line.trim().strip_prefix("= help: "));
    assert_eq!(Vec::from_iter(helps), ["`many` has 2 elements", "did you mean `one/first`?"]);
}

#[test]
fn a_test_file_with_two_mistakes_is_one_that_failed() {
    let project = project(&[
        ("doll.test.ron", "Test(graph: \"doll.ron\", bugdet: (), caes: {})"),
        ("empty.test.ron", ""),
    ]);
    let told = errors(&project.maquette(&["check", "empty.test.ron"]));
    assert_eq!(told, ["error[G001]: the file is empty --> empty.test.ron"]);
    let output = project.maquette(&["test", "doll.test.ron"]);
    assert_eq!(errors(&output).len(), 2);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("0 passed, 1 failed"), "{text}");
    let help = String::from_utf8(project.maquette(&["check", "empty.test.ron"]).stderr).unwrap();
    assert!(help.contains("begin with `Test(graph:"), "{help}");
}

#[test]
fn a_node_that_is_renamed_keeps_its_golden() {
    let project = project(&[("doll.test.ron", "Test(graph: \"doll.ron\")")]);
    fn test(more: &[&str], project: &Project) -> (Option<i32>, String) {
        let arguments = [&["test", "doll.test.ron"], more].concat();
        let output = project.command(&arguments).env_remove("CI").output().unwrap();
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    }
    assert_eq!(test(&["--bless"], &project).0, Some(0));
    let golden = project.folder().join("goldens/doll/default/flat.txt");
    let before = std::fs::read_to_string(&golden).unwrap();
    assert!(project.maquette(&["edit", "doll.ron", "rename", "flat", "smooth"]).status.success());
    let (code, told) = test(&[], &project);
    assert!(code == Some(0) && told.starts_with("passed"), "{told}");
    // A result that is accepted after the renaming is written to the existing golden file.
    assert!(project.maquette(&["edit", "doll.ron", "set", "far=2"]).status.success());
    let (code, told) = test(&[], &project);
    assert!(code == Some(1) && told.contains("flat: `point` differs"), "{told}");
    assert_eq!(test(&["--bless"], &project).0, Some(0));
    assert_ne!(std::fs::read_to_string(&golden).unwrap(), before);
    assert!(!golden.with_file_name("smooth.txt").exists());
    assert_eq!(test(&[], &project).0, Some(0));
}

#[test]
fn a_node_that_is_renamed_takes_its_warning_along() {
    let project = project(&[("doll.test.ron", "Test(graph: \"doll.ron\")")]);
    fn graph(nodes: &str) -> String {
        format!("Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{ \"all.ply\": \"all\" }})")
    }
    project.save(&graph("\"none\": Merge(meshes: []), \"all\": Merge(meshes: [\"none\"])"));
    fn test(more: &[&str], project: &Project) -> (Option<i32>, String) {
        let arguments = [&["test", "doll.test.ron"], more].concat();
        let output = project.command(&arguments).env_remove("CI").output().unwrap();
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    }
    assert_eq!(test(&["--bless"], &project).0, Some(0));
    assert!(project.maquette(&["edit", "doll.ron", "rename", "none", "empty"]).status.success());
    let (code, told) = test(&[], &project);
    assert!(code == Some(0) && told.starts_with("passed"), "{told}");
    // The warning of the added node counts as new, although another node already had an equal one.
    project.save(&graph(
        "\"empty\": Merge(meshes: []), \"more\": Merge(meshes: []), \"all\": Merge(meshes: [\"empty\", \"more\"])",
    ));
    let (code, told) = test(&[], &project);
    assert!(code == Some(1) && told.contains("new warning `more`"), "{told}");
    assert!(!told.contains("no longer"), "{told}");
}

#[test]
fn a_mistake_of_one_kind_hides_none_of_another() {
    let text = r#"Test(
    graph: "doll.ron",
    cases: {
        "a": (set: { "far": "x", "fra": 1 }, inputs: { "m": "x.ply" }),
    },
    compare: { "flat.ply": Mesh(max: -1), "flot.ply": Mesh(maxx: 1) },
    expect: [Closed("flot"), Closd("flat"), Count(of: "flat", what: "faces")],
    budget: (seconds: -1),
)"#;
    let project = project(&[("doll.test.ron", text)]);
    let told = errors(&project.maquette(&["check", "doll.test.ron"]));
    let places = told.iter().map(|told| told.rsplit_once("test.ron:").unwrap().1);
    let mut places = Vec::from_iter(places);
    places.sort_unstable();
    assert_eq!(
        places,
        [
            "4:22", "4:34", "4:56", "4:61", "6:28", "6:38", "6:43", "6:60", "7:21", "7:30", "7:45",
            "8:23"
        ],
        "{told:#?}"
    );
    assert!(told.contains(
        &"error[G013]: input `m`: there is no file `x.ply` --> doll.test.ron:4:61".to_owned()
    ));
}
