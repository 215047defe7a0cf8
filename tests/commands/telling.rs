//! The messages of the program about very many errors, deep nesting, very long names, and values as pictures.

use maquette::format::png;

use crate::output::{stderr_of, stdout_of};
use crate::project::{GRAPHS, Project};

const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// Returns a graph that reads a mesh and has these other nodes.
fn graph(nodes: &str) -> String {
    format!(
        "Graph(format: 1, nodes: {{\"m\": ReadMesh(path: \"m.obj\"), {nodes}}}, outputs: {{\"m.ply\": \"m\"}})"
    )
}

#[test]
fn at_most_a_hundred_problems_are_told_and_the_others_counted() {
    let nodes = (0..10_000).map(|k| format!("\"n{k}\": Transform(mesh: \"mm{k}\"),"));
    let project =
        Project::with_files(&[("m.obj", MESH), ("a.ron", &graph(&String::from_iter(nodes)))]);
    let output = project.maquette(&["check", "a.ron"]);
    assert_eq!(stdout_of(&output), "checked 1 graph: 10 000 errors\n");
    let problems = stderr_of(&output);
    assert_eq!(problems.matches("error[G007]").count(), 100);
    assert!(
        problems.ends_with("\nand 9 900 more diagnostics\n\n"),
        "{}",
        &problems[problems.len() - 99..]
    );
    let output = project.maquette(&["check", "a.ron", "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["problems"].as_array().unwrap().len(), 100);
    assert_eq!(document["more_problems"], 9900);
}

#[test]
fn deep_nesting_is_told_wherever_a_value_is_read() {
    let deep = format!("{}1{}", "A(".repeat(9500), ")".repeat(9500));
    let project = Project::with_files(&[
        ("m.obj", MESH),
        ("a.ron", &graph("")),
        ("deep.ron", &graph(&format!("\"n\": Transform(mesh: {deep})"))),
        ("deep.test.ron", &format!("Test(graph: \"a.ron\", expect: [{deep}])")),
        ("patch.ron", &format!("Patch(of: \"a.ron\", nodes: {{\"m\": (path: {deep})}})")),
        ("handles.ron", &format!("[(at: {deep})]")),
        (
            "h.ron",
            "Graph(format: 1, nodes: {\"h\": ReadHandles(path: \"handles.ron\")}, outputs: {\"h.json\": \"h\"})",
        ),
    ]);
    for arguments in [
        &["check", "deep.ron"][..],
        &["check", "deep.test.ron"],
        &["check", "patch.ron"],
        &["check", "handles.ron"],
        &["run", "h.ron", "--no-cache"],
        &["fmt", "deep.ron"],
        &["diff", "a.ron", "deep.ron"],
        &["edit", "deep.ron", "set", "m.path=a.obj"],
    ] {
        let output = project.maquette(arguments);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}: {output:?}");
        let told = stderr_of(&output);
        assert!(
            told.contains("values are nested more than 128 deep here"),
            "{arguments:?}: {told}"
        );
    }
    let path = ["m", &"a.".repeat(9500), "b=1"].concat();
    let paths = ["m.".to_owned() + &path[1..], format!("m.path={deep}")];
    for set in &paths {
        for arguments in [&["run", "a.ron", "--set", set][..], &["edit", "a.ron", "set", set]] {
            let output = project.maquette(arguments);
            assert!(matches!(output.status.code(), Some(1)), "{:?}", output.status);
            assert!(!output.stderr.is_empty());
        }
    }
    for open in ["(", "min(", "-", "not "] {
        let wrong = format!(
            "\"n\": Transform(mesh: \"m\", scale: (1, 1, Expr(\"{}\")))",
            open.repeat(9500)
        );
        project.write("e.ron", graph(&wrong));
        let output = project.maquette(&["check", "e.ron"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(
            stderr_of(&output).contains("the expression is nested too deeply"),
            "{}",
            stderr_of(&output)
        );
    }
}

#[test]
fn any_step_is_seen_as_a_picture() {
    let project = Project::empty();
    let file = project.folder().join("seen.png");
    for node in ["nose", "spots", "blended", "scan.range"] {
        let arguments = ["inspect", "doll.ron", node, "--out", file.to_str().unwrap()];
        let output = project.command(&arguments).current_dir(GRAPHS).output().unwrap();
        assert!(output.status.success(), "{node}: {}", stderr_of(&output));
        let picture = png::read(&std::fs::read(&file).unwrap()).unwrap();
        let brightest = picture.pixels().iter().flatten().copied().max();
        assert!(brightest > Some(150), "{node} is dark");
    }
}

#[test]
fn a_name_wider_than_any_column_is_told_whole() {
    let name = "a".repeat(70_000);
    let nodes = format!("\"{name}\": Primitive(shape: Box(size: (1, 1, 1)))");
    let outputs = format!("\"a.ply\": \"{name}\"");
    let text = format!("Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{ {outputs} }})");
    let project = Project::with_files(&[("long.ron", &text)]);
    for options in [&[][..], &["-n"], &["--profile"]] {
        let output = project.maquette(&[&["run", "long.ron"], options].concat());
        assert!(output.status.success(), "{}", stderr_of(&output));
        assert!(stdout_of(&output).contains(&name));
    }
}
