//! For each kind of file, one run reports all of its errors.

use std::fs;

use serde_json::Value as Json;

use crate::project::{LIFTED, Project};

fn project() -> Project {
    Project::with_tetrahedron(LIFTED)
}

/// Returns the line, code and message of each error that `check` reports for a file with this text.
fn problems(project: &Project, file: &str, text: &str) -> Vec<String> {
    fs::write(project.folder().join(file), text).unwrap();
    let output = project.maquette(&["check", file, "--json"]);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let told: Json = serde_json::from_slice(&output.stdout).unwrap();
    let all = told["problems"].as_array().unwrap().iter();
    all.map(|it| {
        fn text(name: &str, it: &Json) -> String {
            it[name].as_str().unwrap().to_owned()
        }
        format!("{} {} {}", it["line"], text("code", it), text("message", it))
    })
    .collect()
}

#[track_caller]
fn check(project: &Project, file: &str, text: &str, expected: &[&str]) {
    assert_eq!(problems(project, file, text), expected, "{text}");
}

#[test]
fn a_patch_goes_on_behind_syntax_errors() {
    let project = project();
    let patch = r#"Patch(
    of: "doll.ron",
    params: { "lfit": 6.0 "lift": 50.0 },
    nodes: {
        "mesh": (path: "tte.obj"],
        "lifted": (trnslate: (0, 1, 0), translate: (0 1, 0)),
        "lftied": (rotate: (0, 0, 9)),
    },
    node: {},
)
"#;
    check(
        &project,
        "other.ron",
        patch,
        &[
            "3 G010 parameter `lift` is 50, but must be at least 0 and at most 40",
            "5 G013 there is no file `tte.obj`",
            "6 G004 Transform has no field `trnslate`",
            "3 G007 `lfit`: the graph has no parameter `lfit`",
            "3 G001 missing comma before `\"lift\"`",
            "5 G001 expected `)`, which closes the `(` at 5:17, found `]`",
            "6 G001 missing comma before `1`",
            "7 G007 `lftied.rotate`: the graph has no node `lftied`",
            "9 G004 Patch has no field `node`",
        ],
    );
    // Fields that may be inside of the unclosed bracket are not reported as missing.
    check(
        &project,
        "other.ron",
        "Patch(\n    nodes: { \"lifted\": (translate: (0, 1, 0) },\n    of: \"doll.ron\",\n    docs: \"\",\n)\n",
        &[
            "2 G001 this `(` is not closed before the `}` at 2:46",
            "4 G004 Patch has no field `docs`",
        ],
    );
    // The parameters of the patched graph are known although the graph has errors.
    fs::write(
        project.graph(),
        LIFTED.replace("0)),", "0]),").replace("mesh: \"mesh\"", "mesh: \"hsem\""),
    )
    .unwrap();
    check(
        &project,
        "other.ron",
        "Patch(of: \"doll.ron\", params: { \"lift\": 50.0 }, doc 1)\n",
        &[
            "1 G010 parameter `lift` is 50, but must be at least 0 and at most 40",
            "6 G007 there is no node `hsem`",
            "6 G001 expected `)`, which closes the `(` at 6:54, found `]`",
            "1 G001 expected a comma or a colon before this",
        ],
    );
}

#[test]
fn a_test_goes_on_behind_syntax_errors() {
    let project = project();
    let test = r#"Test(
    graph: "doll.ron",
    cases: {
        "a": (set: { "lift": 50.0, "lfit": 1.0 }
        "b": (set: { "lift": (1 2) }, skip: ""),
    },
    compare: { "out.obj": Mesh(mx: 1.0], "tuo.obj": Mesh(max: 1.0) },
    expect: [Closed("out.obj"), Closed("oot.obj")],
    budgt: (),
)
"#;
    check(
        &project,
        "doll.test.ron",
        test,
        &[
            "4 G001 this `(` is not closed before the `}` at 6:5",
            "5 G001 missing comma before `\"b\"`",
            "5 G001 missing comma before `2`",
            "5 G009 expected a reason for skipping the case, found an empty text",
            "7 G004 Mesh has no tolerance `mx`",
            "7 G001 expected `)`, which closes the `(` at 7:31, found `]`",
            "9 G004 Test has no field `budgt`",
            "7 G007 the graph has no output `tuo.obj`",
            "8 G007 there is no output or node `oot.obj`",
        ],
    );
}

#[test]
fn a_sweep_goes_on_behind_syntax_errors() {
    let project = project();
    check(
        &project,
        "all.sweep.ron",
        "Sweep(\n    graph: \"doll.ron\"\n    over: Values(\"lift\", [1, 50]],\n    set: { \"mesh.path\": \"tte.obj\" },\n)\n",
        &[
            "3 G001 missing comma before `over`",
            "3 G010 parameter `lift` is 50, but must be at least 0 and at most 40",
            "3 G001 expected `)`, which closes the `(` at 3:17, found `]`",
            "4 G013 doll.ron:5:32: there is no file `tte.obj`",
        ],
    );
    check(
        &project,
        "all.sweep.ron",
        "Sweep(\n    graph: \"doll.ron\"\n    over: Values(\"lift\", [1, 2]),\n    otu: \"a\",\n    picture: (zoom: -1],\n)\n",
        &[
            "3 G001 missing comma before `over`",
            "4 G004 Sweep has no field `otu`",
            "5 G010 field `zoom` of Sweep is -1, but must be at least 0.01 and at most 100",
            "5 G001 expected `)`, which closes the `(` at 5:14, found `]`",
        ],
    );
}

#[test]
fn what_can_only_fail_is_refused_by_the_check() {
    let project = project();
    let square = "[[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]";
    for (node, message) in [
        ("Loft()", "Loft: there are no sections: both `curves` and `sections` are empty"),
        ("Loft(sections: [[(0, 0, 0), (1, 0, 0)], []])", "Loft: section 1 has no point"),
        (
            "Loft(sections: [[(0, 0, 0)], [(1, 0, 0)]])",
            "Loft: a loft has at least 2 columns; the sections have 1",
        ),
        ("Loft(end: (0, 0, 1))", "Loft: expected at least 2 sections, found 1"),
        (
            "Loft(sections: [[(0, 0, 0), (1, 0, 0)], [(1, 0, 1)]], columns: 1)",
            "Loft: a loft has at least 2 columns; the sections have 1",
        ),
        ("PointNet(points: [[(0, 0, 0), (1, 0, 0)]])", ""),
        ("PointNet(points: [])", ""),
        ("PointNet(points: [[(0, 0, 0)], [(1, 0, 0)]])", ""),
        ("PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0)]])", ""),
        ("Revolve()", "Revolve: a profile is either linked at `curve` or written in `profile`"),
        (
            "Revolve(curve: \"curve\", profile: [(1, 0), (1, 5)])",
            "Revolve: a profile is either linked at `curve` or written in `profile`",
        ),
        (
            "Revolve(profile: [(1, 0), (-1, 5)])",
            "Revolve: point 1 of the profile is -1 from the axis; the distance must be 0 or more",
        ),
        ("Revolve(profile: [(1, 0)])", ""),
        (
            "Tessellate(surface: \"surface\", u: 4, tolerance: 0.1)",
            "Tessellate: `tolerance` chooses the quads itself: leave `u` and `v` out",
        ),
        (
            "OffsetNet(net: \"net\", steps: [(distance: 1)], profile: Picture)",
            "OffsetNet: the profile `Picture` needs a field at the port `picture`",
        ),
        ("Knots(net: \"net\", along: U, kind: Values([0, 1, 0]))", ""),
        (
            "Knots(net: \"net\", along: U, order: 4, kind: Cylinder)",
            "Knots: `Cylinder` is for order 3, not 4",
        ),
        (
            "Hollow(mesh: \"mesh\", thickness: 1, spacing: 0.6)",
            "Hollow: `spacing` is 0.6, but must be at least 0, and at most 0.5, half of `thickness`",
        ),
        ("Interpolate(mesh: \"mesh\", scheme: CatmullClark, solver: Pcg, foot: Closest)", ""),
        (
            "Foreground(by: KeyColor(color: \"#00ff00\"))",
            "Foreground: `by: KeyColor` requires the port `image`, which is not linked",
        ),
        (
            "KeepCells(range: \"range\", within: Attribute(name: \"a\"))",
            "KeepCells: the cells of a range image have no attributes",
        ),
        (
            "Unwrap(mesh: \"mesh\", size: 16, padding: 16)",
            "Unwrap: `padding` is 16 px, which leaves no room in 16 x 16 px",
        ),
        ("Ffd(mesh: \"mesh\", mode: Absolute, background: 0.1)", "Ffd: `background` is 0.1"),
        (
            "Ffd(mesh: \"mesh\", targets: [(handle: 0, to: (0, 0, 0))])",
            "Ffd: there is no handle 0 for a target",
        ),
        ("Foreground()", "Foreground: `by: Valid` requires the port `range`, which is not linked"),
    ] {
        let text = format!(
            "Graph(\n    format: 1,\n    nodes: {{\n        \"mesh\": ReadMesh(path: \"tet.obj\"),\n        \"curve\": ReadCurve(path: \"tet.obj\"),\n        \"range\": ReadRange(path: \"a.pcd\"),\n        \"net\": PointNet(points: {square}),\n        \"surface\": Nurbs(net: \"net\"),\n        \"it\": {node},\n    }},\n    outputs: {{ \"a.json\": \"it\" }},\n)\n"
        );
        fs::write(project.graph(), text).unwrap();
        let output = project.maquette(&["check", "doll.ron", "--json"]);
        let told: Json = serde_json::from_slice(&output.stdout).unwrap();
        let found: Vec<_> =
            told["problems"].as_array().unwrap().iter().filter(|it| it["line"] == 9).collect();
        assert_eq!((output.status.code(), found.len()), (Some(1), 1), "{node}: {told}");
        assert_eq!(found[0]["code"], "G009", "{node}: {told}");
        assert!(found[0]["message"].as_str().unwrap().starts_with(message), "{node}: {told}");
        assert!(!found[0]["help"].as_str().unwrap().is_empty(), "{node}: {told}");
    }
}

#[test]
fn a_conflict_of_a_merge_in_the_marker_of_the_project_is_told_everywhere() {
    let project = project();
    fs::write(project.folder().join("doll.test.ron"), "Test(graph: \"doll.ron\")\n").unwrap();
    let marker = project.folder().join("maquette.toml");
    let conflict = "# ours\n<<<<<<< HEAD\n# a\n=======\n# b\n>>>>>>> theirs\n";
    fs::write(&marker, conflict).unwrap();
    for words in [
        &["check", "doll.ron"][..],
        &["check", "."],
        &["run", "doll.ron"],
        &["run", "-n", "doll.ron"],
        &["why", "doll.ron", "lifted"],
        &["inspect", "doll.ron", "lifted"],
        &["batch", "doll.ron", "--sweep", "lift=1,2"],
        &["test"],
    ] {
        let output = project.maquette(words);
        let told = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
        assert!(!output.status.success(), "{words:?}: {told}");
        let message = "this file contains merge conflict markers";
        assert_eq!(told.matches(message).count(), 1, "{words:?}: {told}");
        assert!(told.contains("maquette.toml:2:1"), "{words:?}: {told}");
    }
    fs::write(&marker, "# <<<<<<< no conflict\n").unwrap();
    assert!(project.maquette(&["run", "doll.ron"]).status.success());
}
