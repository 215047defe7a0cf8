//! The messages of the program: diagnostics of any file, the reference of nodes, and values of graphs.

use std::io::Write;
use std::path::Path;
use std::process::{Output, Stdio};

use expect_test::expect;

use crate::output::{stderr_of, stdout_of};
use crate::program::command;
use crate::project::Project;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

fn maquette(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

/// Runs `inspect` on the example graph `doll.ron`, with a cache folder that lasts as long as the command.
fn inspect(arguments: &[&str]) -> Output {
    let cache = tempfile::tempdir().unwrap();
    let arguments = [&["inspect", "doll.ron"], arguments].concat();
    command(Path::new(GRAPHS), &arguments).env("MAQUETTE_CACHE", cache.path()).output().unwrap()
}

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// Returns a graph that reads a mesh and has these other nodes.
fn graph(nodes: &str) -> String {
    format!(
        "Graph(format: 1, nodes: {{\"m\": ReadMesh(path: \"m.obj\"), {nodes}}}, outputs: {{\"m.ply\": \"m\"}})"
    )
}

#[test]
fn check_takes_folders_tests_handles_patches_and_stdin() {
    let files = [
        ("m.obj", MESH),
        ("a.ron", &graph("")),
        ("b.ron", "Patch(of: \"a.ron\")"),
        ("a.test.ron", "Test(graph: \"a.ron\", cases: {\"x\": (set: {\"m.pth\": \"m.obj\"})})"),
        ("handles.ron", "[(at: (0, 0, 0), to: (0, 0))]"),
        ("c.test.ron", "Test(grph: \"a.ron\")"),
    ];
    let folder = folder(&files);
    let output = maquette(folder.path(), &["check", "."]);
    assert_eq!(output.status.code(), Some(1));
    let problems = stderr_of(&output);
    for wrong in
        ["ReadMesh has no field `pth`", "Test has no field `grph`", "./handles.ron", "line 1"]
    {
        assert!(problems.contains(wrong), "{wrong} is missing:\n{problems}");
    }
    let end = "checked 2 graphs, 2 tests, 1 handle file: 3 errors\n";
    assert_eq!(stdout_of(&output), end, "{problems}");
    let output = maquette(folder.path(), &["check", "a.ron", "b.ron"]);
    assert_eq!(stdout_of(&output), "checked 2 graphs: 0 errors\n", "{}", stderr_of(&output));
    for (text, status) in [(graph(""), 0), (graph("\"n\": Nothing()"), 1)] {
        let mut child = command(folder.path(), &["check", "-"]);
        let mut child = child
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(status));
    }
    let output = maquette(folder.path(), &["check", "nowhere.ron", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stdout_of(&output).contains("cannot read the file"), "{}", stdout_of(&output));
}

#[test]
fn the_graphs_that_come_with_the_program_have_no_problem_and_no_warning() {
    let output = maquette(Path::new(GRAPHS), &["check", "."]);
    assert!(
        stdout_of(&output).ends_with(": 0 errors\n"),
        "{}{}",
        stdout_of(&output),
        stderr_of(&output)
    );
}

#[test]
fn a_node_that_nothing_needs_is_a_warning() {
    let folder =
        folder(&[("m.obj", MESH), ("a.ron", &graph("\"turned\": Transform(mesh: \"m\")"))]);
    let output = maquette(folder.path(), &["check", "a.ron"]);
    assert!(output.status.success());
    assert_eq!(stdout_of(&output), "checked 1 graph: 0 errors, 1 warning\n");
    assert!(stderr_of(&output).starts_with("warning[G021]: nothing needs `turned`\n"));
}

#[test]
fn at_most_a_hundred_problems_are_told_and_the_others_counted() {
    let nodes = (0..10_000).map(|k| format!("\"n{k}\": Transform(mesh: \"mm{k}\"),"));
    let folder = folder(&[("m.obj", MESH), ("a.ron", &graph(&String::from_iter(nodes)))]);
    let output = maquette(folder.path(), &["check", "a.ron"]);
    assert_eq!(stdout_of(&output), "checked 1 graph: 10 000 errors\n");
    let problems = stderr_of(&output);
    assert_eq!(problems.matches("error[G007]").count(), 100);
    assert!(
        problems.ends_with("\nand 9 900 more diagnostics\n\n"),
        "{}",
        &problems[problems.len() - 99..]
    );
    let output = maquette(folder.path(), &["check", "a.ron", "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["problems"].as_array().unwrap().len(), 100);
    assert_eq!(document["more_problems"], 9900);
}

#[test]
fn deep_nesting_is_told_wherever_a_value_is_read() {
    let deep = format!("{}1{}", "A(".repeat(9500), ")".repeat(9500));
    let folder = folder(&[
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
        let output = maquette(folder.path(), arguments);
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
            let output = maquette(folder.path(), arguments);
            assert!(matches!(output.status.code(), Some(1)), "{:?}", output.status);
            assert!(!output.stderr.is_empty());
        }
    }
    for open in ["(", "min(", "-", "not "] {
        let wrong = format!(
            "\"n\": Transform(mesh: \"m\", scale: (1, 1, Expr(\"{}\")))",
            open.repeat(9500)
        );
        std::fs::write(folder.path().join("e.ron"), graph(&wrong)).unwrap();
        let output = maquette(folder.path(), &["check", "e.ron"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(
            stderr_of(&output).contains("the expression is nested too deeply"),
            "{}",
            stderr_of(&output)
        );
    }
}

#[test]
fn a_camera_file_that_is_nested_too_deep_is_an_error_of_its_node() {
    let files = ["color.png", "range.pcd"];
    let folder = folder(&[
        ("camera.json", &format!("{}{}", "[".repeat(99_999), "]".repeat(99_999))),
        (
            "a.ron",
            "Graph(format: 1, nodes: {\"c\": ReadCapture(color: \"color.png\", range: \"range.pcd\")}, outputs: {\"c.png\": \"c\"})",
        ),
    ]);
    for file in files {
        std::fs::copy(Path::new(GRAPHS).join("doll").join(file), folder.path().join(file)).unwrap();
    }
    let output = maquette(folder.path(), &["run", "a.ron", "--no-cache"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(stderr_of(&output).contains("error[G016]"), "{}", stderr_of(&output));
}

#[test]
fn unknown_names_get_a_guess_or_a_list_and_no_loose_end() {
    let folder = folder(&[("m.obj", MESH), ("a.ron", &graph(""))]);
    for (arguments, expected) in [
        (
            &["nodes", "Tresh"][..],
            "error: there is no node type `Tresh`; did you mean `Threshold`?\n",
        ),
        (
            &["nodes", "decimate"],
            "error: there is no node type `decimate`; `Simplify` is described with this word\n",
        ),
        (&["why", "a.ron", "foo"], "error: the graph has no node `foo`; its nodes: m\n"),
        (
            &["run", "a.ron", "--only", "nope"],
            "error: the graph has no output `nope`; its outputs: m.ply\n",
        ),
        (&["inspect", "a.ron", "foo"], "error: the graph has no node `foo`; its nodes: m\n"),
        (&["nodes", "a.ron", "Foo"], "error: a.ron uses no graph `Foo`\n"),
    ] {
        let output = maquette(folder.path(), arguments);
        assert_eq!((output.status.code(), &stderr_of(&output)[..]), (Some(2), expected));
    }
}

#[test]
fn defaults_are_printed_as_a_graph_has_them_and_nested_options_with_their_words() {
    fn nodes(name: &str) -> String {
        stdout_of(&maquette(Path::new(GRAPHS), &["nodes", name]))
    }
    let edges = nodes("Edges");
    assert!(edges.contains("\n  high: one of = Percentile(90.0)\n"), "{edges}");
    let fill = nodes("FillHoles");
    assert!(fill.contains("\n  method: one of = Exemplar()\n"), "{fill}");
    let option = "        rate: number from 0 1/mm = 0.0\n                Rate of the falloff.";
    assert!(fill.contains(option), "{fill}");
    assert!(
        fill.contains("        rotations: integer 1 to 32 = 1\n            Number of rotations"),
        "{fill}"
    );
    assert!(!stdout_of(&maquette(Path::new(GRAPHS), &["nodes", "Ffd"])).contains("null"));
}

#[test]
fn set_puts_a_new_entry_of_a_patch_on_a_line_of_its_own() {
    let base = Path::new(GRAPHS).join("pinocchio.ron");
    let text = std::fs::read_to_string(&base).unwrap();
    let output = maquette(
        Path::new(GRAPHS),
        &["edit", "pinocchio.ron", "set", "--dry-run", "red.select.distance=22"],
    );
    let grid = "        \"grid\": (smooth_border: 60),\n";
    let expected = text.replace(grid, &format!("{grid}        \"red.select\": (distance: 22),\n"));
    assert_ne!(expected, text);
    assert_eq!(stdout_of(&output), expected, "{}", stderr_of(&output));
}

#[test]
fn the_eyedropper_says_what_can_be_asked() {
    let cases = [
        (
            &["scan", "--at", "99999,3"][..],
            "there is no pixel 99999,3: `scan.color` has 400 x 400 pixels",
        ),
        (&["red", "--at", "400,0"], "`red.mask` has 400 x 400 pixels"),
        (
            &["nose", "--at", "1,1"],
            "`nose` gives a Region, which has no pixels: --at supports pictures, masks",
        ),
        (&["grid", "--at", "1,1"], "`grid` gives a Mesh, which has no pixels"),
    ];
    for (arguments, expected) in cases {
        let output = inspect(arguments);
        let told = stderr_of(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(told.contains(expected) && output.stdout.is_empty(), "{arguments:?}: {told}");
    }
}

#[test]
fn any_step_can_be_written_by_the_output_that_fits_and_seen_as_a_picture() {
    let out = tempfile::tempdir().unwrap();
    fn path(name: &str, out: &tempfile::TempDir) -> String {
        out.path().join(name).to_str().unwrap().to_owned()
    }
    let output = inspect(&["scan", "--out", &path("s.pcd", &out)]);
    assert!(output.status.success(), "{}", stderr_of(&output));
    assert!(stdout_of(&output).contains("scan.range is written to "), "{}", stdout_of(&output));
    let wrong = inspect(&["scan", "--out", &path("s.step", &out)]);
    assert_eq!(wrong.status.code(), Some(2));
    let told =
        "scan.color, an Image, can be written to: png, tiff; scan.range, a RangeImage, can be";
    assert!(stderr_of(&wrong).contains(told), "{}", stderr_of(&wrong));
    for node in ["nose", "spots", "blended", "scan.range"] {
        let file = path("seen.png", &out);
        let output = inspect(&[node, "--out", &file]);
        assert!(output.status.success(), "{node}: {}", stderr_of(&output));
        let picture = maquette::format::png::read(&std::fs::read(&file).unwrap()).unwrap();
        let brightest = picture.pixels().iter().flatten().copied().max();
        assert!(brightest > Some(150), "{node} is dark");
    }
}

#[test]
fn a_graph_without_outputs_has_nothing_to_do() {
    let folder = folder(&[("a.ron", "Graph(format: 1, nodes: {}, outputs: {})")]);
    let output = maquette(folder.path(), &["run", "a.ron", "--no-cache"]);
    assert!(output.status.success());
    expect![["nothing to do: the graph has no outputs\n"]].assert_eq(&stdout_of(&output));
}

#[test]
fn a_graph_with_an_empty_section_of_inputs_writes_its_outputs() {
    let text = r#"Graph(
        format: 1,
        inputs: {},
        nodes: { "box": Primitive(shape: Box(size: (1, 1, 1))) },
        outputs: { "solid": "box" },
    )"#;
    let folder = folder(&[("a.ron", text)]);
    let output = maquette(folder.path(), &["run", "a.ron", "--no-cache"]);
    assert!(
        output.status.success() && folder.path().join("out/a/solid.glb").exists(),
        "{output:?}"
    );
}

/// Tests the warnings for an open mesh in a file for 3D printers, and for a mesh that is too far from the origin for single precision.
#[test]
fn what_files_cannot_tell_is_told_by_each_run_also_if_they_are_there() {
    let graph = r#"Graph(
        format: 1,
        nodes: {
            "net": PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]),
            "surface": Nurbs(net: "net", order: (2, 2)),
            "sheet": Tessellate(surface: "surface", u: 2, v: 2),
            "survey": Transform(mesh: "sheet", translate: (50000, 0, 0)),
        },
        outputs: { "sheet.stl": "sheet", "survey.obj": "survey" },
    )"#;
    let project = Project::new(graph);
    for _ in 0..2 {
        let output = project.command(&["run", "doll.ron"]).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{told}");
        assert!(told.contains("`sheet.stl`: the mesh is not closed: 8 edges"), "{told}");
        assert!(
            told.contains("`survey.obj`: this format has single-precision coordinates"),
            "{told}"
        );
        assert!(
            told.contains("`sheet.stl`: this format does not store `uv` of vertices"),
            "{told}"
        );
        assert_eq!(told.matches("warning").count(), 3, "{told}");
    }
}

#[test]
fn a_name_wider_than_any_column_is_told_whole() {
    let name = "a".repeat(70_000);
    let nodes = format!("\"{name}\": Primitive(shape: Box(size: (1, 1, 1)))");
    let outputs = format!("\"a.ply\": \"{name}\"");
    let text = format!("Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{ {outputs} }})");
    let folder = folder(&[("long.ron", &text)]);
    for options in [&[][..], &["-n"], &["--profile"]] {
        let mut command = command(folder.path(), &[&["run", "long.ron"], options].concat());
        let output = command.env("MAQUETTE_CACHE", folder.path().join("cache")).output().unwrap();
        assert!(output.status.success(), "{}", stderr_of(&output));
        assert!(stdout_of(&output).contains(&name));
    }
}
