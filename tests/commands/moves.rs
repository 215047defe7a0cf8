//! `extract` and `inline` as their users see them: either both files are written or none.

use expect_test::expect;

use crate::project::Project;

const TWO: &str = r#"// Two.
Graph(
    format: 1,
    params: { "far": Number(default: 9.0, unit: "mm", doc: "How far.") },
    nodes: {
        "mesh": ReadMesh(path: "doll/coarse.obj"),
        // Made smooth.
        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
        "moved": Transform(mesh: "smooth", translate: (0, Param("far"), 0)),
        "both": Merge(meshes: ["mesh", "moved"]),
    },
    outputs: { "both.ply": "both" },
)
"#;

fn project() -> Project {
    let project = Project::new(TWO);
    std::fs::create_dir(project.folder().join("doll")).unwrap();
    project.copy_asset("coarse.obj", "doll/coarse.obj");
    std::fs::write(project.folder().join("maquette.toml"), "").unwrap();
    project
}

fn read(project: &Project, name: &str) -> String {
    std::fs::read_to_string(project.folder().join(name)).unwrap()
}

/// Runs a command; returns its exit code and its output (stdout and stderr).
fn run_text(project: &Project, arguments: &[&str]) -> (Option<i32>, String) {
    let output = project.maquette(arguments);
    let words = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(words).unwrap())
}

const EXTRACT: [&str; 10] = [
    "edit",
    "doll.ron",
    "extract",
    "smooth",
    "moved",
    "--to",
    "lib/high.ron",
    "--name",
    "High",
    "--as",
];

#[test]
fn nodes_become_a_graph_and_come_back_and_the_outputs_stay() {
    let project = project();
    fn run(project: &Project) -> Vec<u8> {
        let (code, words) = run_text(project, &["run", "doll.ron", "--no-provenance"]);
        assert_eq!(code, Some(0), "{words}");
        std::fs::read(project.folder().join("out/doll/both.ply")).unwrap()
    }
    let before = run(&project);
    let (code, words) = run_text(&project, &[&EXTRACT[..], &["up"]].concat());
    assert_eq!(code, Some(0), "{words}");
    expect![[r#"
        lib/high.ron: High, used by `up`
        use High: added: "lib/high.ron"
        node smooth: removed: Subdivide(levels: 1, mesh: "mesh", scheme: Loop)
        node moved: removed: Transform(mesh: "smooth", translate: (0, Param("far"), 0))
        node both: rewired meshes.1: "moved" -> "up"
        node up: added: High(far: Param("far"), mesh: "mesh")
    "#]]
    .assert_eq(&words);
    expect![[r#"
        // Two.
        Graph(
            format: 1,
            use: { "High": "lib/high.ron" },
            params: { "far": Number(default: 9.0, unit: "mm", doc: "How far.") },
            nodes: {
                "mesh": ReadMesh(path: "doll/coarse.obj"),
                "up": High(mesh: "mesh", far: Param("far")),
                "both": Merge(meshes: ["mesh", "up.moved"]),
            },
            outputs: { "both.ply": "both" },
        )
        ---
        Graph(
            format: 1,
            doc: "A part of doll.ron.",
            inputs: { "mesh": Mesh(doc: "The value of `mesh`.") },
            params: { "far": Number(default: 9.0, unit: "mm", doc: "How far.") },
            nodes: {
                // Made smooth.
                "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
                "moved": Transform(mesh: "smooth", translate: (0, Param("far"), 0)),
            },
            outputs: { "moved": "moved" },
        )
    "#]]
    .assert_eq(&format!("{}---\n{}", read(&project, "doll.ron"), read(&project, "lib/high.ron")));
    assert!(before == run(&project));
    let (code, words) = run_text(&project, &["edit", "doll.ron", "inline", "up"]);
    assert_eq!(code, Some(0), "{words}");
    expect![[r#"
        use High: removed: "lib/high.ron"
        node up: removed: High(far: Param("far"), mesh: "mesh")
        node both: rewired meshes.1: "up" -> "moved"
        node smooth: added: Subdivide(levels: 1, mesh: "mesh", scheme: Loop)
        node moved: added: Transform(mesh: "smooth", translate: (0, Param("far"), 0))
    "#]]
    .assert_eq(&words);
    assert_eq!(read(&project, "doll.ron"), TWO);
    assert!(project.folder().join("lib/high.ron").is_file());
    assert!(before == run(&project));
}

#[test]
fn a_dry_run_prints_what_would_change_and_writes_nothing() {
    let project = project();
    let (code, words) = run_text(&project, &[&EXTRACT[..], &["up", "--dry-run"]].concat());
    assert_eq!(code, Some(0), "{words}");
    expect![[r#"
        lib/high.ron: High, used by `up`
        +Graph(
        +    format: 1,
        +    doc: "A part of doll.ron.",
        +    inputs: { "mesh": Mesh(doc: "The value of `mesh`.") },
        +    params: { "far": Number(default: 9.0, unit: "mm", doc: "How far.") },
        +    nodes: {
        +        // Made smooth.
        +        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
        +        "moved": Transform(mesh: "smooth", translate: (0, Param("far"), 0)),
        +    },
        +    outputs: { "moved": "moved" },
        +)
        @@ -3,0 +4 @@
        +    use: { "High": "lib/high.ron" },
        @@ -7,4 +8,2 @@
        -        // Made smooth.
        -        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
        -        "moved": Transform(mesh: "smooth", translate: (0, Param("far"), 0)),
        -        "both": Merge(meshes: ["mesh", "moved"]),
        +        "up": High(mesh: "mesh", far: Param("far")),
        +        "both": Merge(meshes: ["mesh", "up.moved"]),
    "#]]
    .assert_eq(&words);
    assert_eq!(read(&project, "doll.ron"), TWO);
    assert!(!project.folder().join("lib").exists());
    assert_eq!(run_text(&project, &EXTRACT[..9]).0, Some(0));
    let extracted = read(&project, "doll.ron");
    let (code, words) = run_text(&project, &["edit", "doll.ron", "inline", "high", "--dry-run"]);
    assert_eq!(code, Some(0), "{words}");
    expect![[r#"
        @@ -4 +3,0 @@
        -    use: { "High": "lib/high.ron" },
        @@ -8,2 +7,4 @@
        -        "high": High(mesh: "mesh", far: Param("far")),
        -        "both": Merge(meshes: ["mesh", "high.moved"]),
        +        // Made smooth.
        +        "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
        +        "moved": Transform(mesh: "smooth", translate: (0, Param("far"), 0)),
        +        "both": Merge(meshes: ["mesh", "moved"]),
    "#]]
    .assert_eq(&words);
    assert_eq!(read(&project, "doll.ron"), extracted);
}

#[test]
fn what_is_refused_writes_nothing() {
    let project = project();
    let (code, words) = run_text(&project, &["edit", "doll.ron", "extract", "mesh", "moved"]);
    assert_eq!(code, Some(1));
    expect![[r#"
        error[G008]: `smooth` is between the nodes: it needs `mesh`, and `moved` needs it
         --> doll.ron:8:9
          |
        8 |         "smooth": Subdivide(mesh: "mesh", scheme: Loop, levels: 1),
          |         ^^^^^^^^
          |
          = help: extract `smooth`, too, or leave one of them where it is

    "#]]
    .assert_eq(&words);
    let (code, words) = run_text(&project, &["edit", "doll.ron", "inline", "mesh"]);
    assert_eq!(code, Some(1));
    expect![[r#"
        error[G012]: `mesh` is a ReadMesh, not a use of a graph
         --> doll.ron:6:9
          |
        6 |         "mesh": ReadMesh(path: "doll/coarse.obj"),
          |         ^^^^^^
          |
          = help: only nodes whose types are declared under `use` can be inlined

    "#]]
    .assert_eq(&words);
    for wrong in [
        &["edit", "doll.ron", "extract"][..],
        &["edit", "doll.ron", "inline"],
        &["edit", "doll.ron"],
    ] {
        assert_eq!(run_text(&project, wrong).0, Some(2), "{wrong:?}");
    }
    let (code, words) = run_text(&project, &["edit", "nowhere.ron", "extract", "mesh"]);
    assert_eq!(code, Some(1));
    assert!(words.starts_with("error: cannot read nowhere.ron"), "{words}");
    std::fs::write(project.folder().join("smooth.ron"), "mine").unwrap();
    let to = ["edit", "doll.ron", "extract", "smooth", "--to", "smooth.ron"];
    let (code, words) = run_text(&project, &to);
    assert_eq!(code, Some(1));
    assert!(words.contains("`smooth.ron` is there already"), "{words}");
    assert_eq!((&read(&project, "smooth.ron")[..], &read(&project, "doll.ron")[..]), ("mine", TWO));
}

#[test]
fn a_graph_that_cannot_be_written_leaves_no_new_file() {
    let project = project();
    let graph = project.folder().join("doll.ron");
    let mut permissions = std::fs::metadata(&graph).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(&graph, permissions).unwrap();
    let (code, words) = run_text(&project, &["edit", "doll.ron", "extract", "smooth"]);
    assert_eq!(code, Some(1));
    assert!(words.starts_with("error: cannot write doll.ron"), "{words}");
    assert!(!project.folder().join("smooth.ron").exists());
    // If the new file cannot be written, the graph stays unchanged.
    let project = self::project();
    std::fs::write(project.folder().join("lib"), "a file").unwrap();
    let (code, words) = run_text(&project, &[&EXTRACT[..], &["up"]].concat());
    assert_eq!(code, Some(1));
    assert!(words.starts_with("error: cannot write lib/high.ron"), "{words}");
    assert_eq!(read(&project, "doll.ron"), TWO);
}
