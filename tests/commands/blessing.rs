//! Results become goldens only on request, and a golden states the reason of its change.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::output::text_of;

const GRAPH: &str = r#"Graph(
    format: 1,
    nodes: {
        "net": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 0)]]),
        "surface": Nurbs(net: "net"),
    },
    outputs: { "net.ply": "net", "surface.ply": "surface" },
)"#;

/// Makes a git repository with a graph, its test and its goldens, all committed.
fn bless_in_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    bless(folder.path(), GRAPH);
    folder
}

fn bless(path: &Path, graph: &str) {
    std::fs::write(path.join("net.ron"), graph).unwrap();
    std::fs::write(path.join("net.test.ron"), "Test(graph: \"net.ron\")").unwrap();
    std::fs::write(path.join(".gitignore"), "cache\n").unwrap();
    git(path, &["init", "--quiet"]);
    assert!(maquette(path, &["--bless"], "", None).status.success());
    commit(path);
}

fn git(folder: &Path, arguments: &[&str]) {
    let who = ["-c", "user.name=a", "-c", "user.email=a@b"];
    let done = Command::new("git").args(who).args(arguments).current_dir(folder).status().unwrap();
    assert!(done.success());
}

fn commit(folder: &Path) {
    git(folder, &["add", "--all"]);
    git(folder, &["commit", "--quiet", "--message", "as they are"]);
}

fn maquette(folder: &Path, arguments: &[&str], typed: &str, ci: Option<&str>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
    command.arg("test").args(arguments).current_dir(folder).env_remove("CI");
    command.env("MAQUETTE_CACHE", folder.join("cache"));
    ci.map(|ci| command.env("CI", ci));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    // A program that refuses its arguments may end before it reads its input.
    let _ = child.stdin.take().unwrap().write_all(typed.as_bytes());
    child.wait_with_output().unwrap()
}

/// Changes the point in the middle of the net to `to`.
fn change(folder: &Path, to: &str) {
    std::fs::write(folder.join("net.ron"), GRAPH.replace("(1, 1, 2)", to)).unwrap();
}

fn golden(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join("goldens/net/default").join(name)).unwrap()
}

#[test]
fn a_golden_is_accepted_with_the_reason_and_another_refused() {
    let folder = bless_in_folder();
    let path = folder.path();
    change(path, "(1, 1, 2.5)");
    let before = [golden(path, "surface.txt"), golden(path, "nodes.txt")];
    let output = maquette(path, &["--review"], "what?\na\nr\n", None);
    let text = text_of(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("because node `net`: parameter `points[1][1][2]` 2 -> 2.5"), "{text}");
    assert!(text.contains("blessed   net.ron default net:"), "{text}");
    assert!(text.contains("1 golden blessed"), "{text}");
    let accepted = golden(path, "net.txt");
    assert!(
        accepted.contains(
            "accepted because              node `net`: parameter `points[1][1][2]` 2 -> 2.5"
        ),
        "{accepted}"
    );
    // If the user refuses a result, its golden stays unchanged, and the next test reports the reason of the difference again.
    assert_eq!([golden(path, "surface.txt"), golden(path, "nodes.txt")], before);
    let again = maquette(path, &[], "", None);
    assert!(
        text_of(&again).contains("node `net`: parameter `points[1][1][2]` 2 -> 2.5"),
        "{}",
        text_of(&again)
    );
    assert!(!text_of(&again).contains("net: `point`"), "{}", text_of(&again));
}

#[test]
fn who_quits_accepts_nothing_more() {
    let folder = bless_in_folder();
    change(folder.path(), "(1, 1, 2.5)");
    let before = ["net.txt", "surface.txt"].map(|name| golden(folder.path(), name));
    for typed in ["q\n", ""] {
        let output = maquette(folder.path(), &["--review"], typed, None);
        assert_eq!(output.status.code(), Some(1));
        assert!(text_of(&output).contains("0 goldens blessed"), "{}", text_of(&output));
    }
    assert_eq!(["net.txt", "surface.txt"].map(|name| golden(folder.path(), name)), before);
}

#[test]
fn nothing_is_blessed_where_ci_is_set() {
    let folder = bless_in_folder();
    change(folder.path(), "(1, 1, 2.5)");
    let before = golden(folder.path(), "net.txt");
    for arguments in ["--bless", "--review"] {
        let output = maquette(folder.path(), &[arguments], "a\na\n", Some("true"));
        assert_eq!(output.status.code(), Some(2), "{}", text_of(&output));
    }
    assert_eq!(golden(folder.path(), "net.txt"), before);
}

#[test]
fn nothing_is_blessed_over_goldens_that_are_not_committed() {
    let folder = bless_in_folder();
    let path = folder.path();
    change(path, "(1, 1, 2.5)");
    assert!(maquette(path, &["--bless"], "", None).status.success());
    change(path, "(1, 1, 3)");
    let before = golden(path, "net.txt");
    for arguments in ["--bless", "--review"] {
        let output = maquette(path, &[arguments], "a\na\n", None);
        assert_eq!(output.status.code(), Some(2), "{}", text_of(&output));
        assert!(text_of(&output).contains("uncommitted changes"), "{}", text_of(&output));
    }
    assert_eq!(golden(path, "net.txt"), before);
    commit(path);
    assert!(maquette(path, &["--bless"], "", None).status.success());
}

#[test]
fn a_much_too_wide_tolerance_is_told() {
    let folder = bless_in_folder();
    let path = folder.path();
    for (max, wide) in [("0.1", true), ("0.02", false)] {
        let text = format!(
            "Test(graph: \"net.ron\", compare: {{\"net.ply\": ControlNet(max: {max}), \"surface.ply\": Surface(max: {max})}})"
        );
        std::fs::write(path.join("net.test.ron"), text).unwrap();
        change(path, "(1, 1, 2.004)");
        let output = maquette(path, &[], "", None);
        assert!(output.status.success(), "{}", text_of(&output));
        let text = text_of(&output);
        assert_eq!(
            text.contains("ten times the largest difference so far (0.004)"),
            wide,
            "{text}"
        );
    }
}

#[test]
fn a_graph_is_tested_by_the_test_file_beside_it() {
    let folder = bless_in_folder();
    let output = maquette(folder.path(), &["net.ron"], "", None);
    assert!(
        output.status.success() && text_of(&output).contains("1 passed"),
        "{}",
        text_of(&output)
    );
    std::fs::write(folder.path().join("other.ron"), GRAPH).unwrap();
    let output = maquette(folder.path(), &["other.ron"], "", None);
    assert_eq!(output.status.code(), Some(2));
    let help = "write `Test(graph: \"other.ron\")` to other.test.ron";
    assert!(text_of(&output).contains(help), "{}", text_of(&output));
}

#[test]
fn a_filter_that_no_case_holds_fails_with_guesses() {
    let folder = bless_in_folder();
    let output = maquette(folder.path(), &["--filter", "defualt"], "", None);
    assert_eq!(output.status.code(), Some(2), "{}", text_of(&output));
    assert!(text_of(&output).contains("did you mean `default`?"), "{}", text_of(&output));
}

/// Makes the graph invalid, and its test a test of two cases.
fn break_graph(folder: &Path) {
    std::fs::write(folder.join("net.ron"), GRAPH.replace("Nurbs(", "Nurb(")).unwrap();
    let test = "Test(graph: \"net.ron\", cases: {\"default\": (), \"second\": ()})";
    std::fs::write(folder.join("net.test.ron"), test).unwrap();
}

#[test]
fn a_broken_graph_cannot_be_blessed_and_its_problem_is_told_once() {
    let folder = bless_in_folder();
    break_graph(folder.path());
    for arguments in [&[][..], &["--bless"]] {
        let output = maquette(folder.path(), arguments, "", None);
        let text = text_of(&output);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert_eq!(text.matches("there is no node type `Nurb`").count(), 1, "{text}");
        assert!(text.contains("1 error (unchanged)"), "{text}");
        // The graph cannot be read, which does not mean that its nodes were removed.
        assert!(!text.contains("is gone"), "{text}");
    }
    assert!(golden(folder.path(), "nodes.txt").contains("net  PointNet"));
}

#[test]
fn an_output_is_expected_by_its_name_in_graphs_as_in_tests() {
    let folder = bless_in_folder();
    let path = folder.path();
    let expecting =
        |text: &str| GRAPH.replace("    outputs:", &format!("    expect: [{text}],\n    outputs:"));
    std::fs::write(
        path.join("net.ron"),
        expecting("Manifold(\"surface.ply\"), Manifold(\"surface\")"),
    )
    .unwrap();
    let output = maquette(path, &[], "", None);
    assert!(output.status.success(), "{}", text_of(&output));
    std::fs::write(path.join("net.ron"), expecting("Closed(\"surface.ply\")")).unwrap();
    let output = maquette(path, &[], "", None);
    assert!(
        text_of(&output).contains("expected Closed, but `surface.ply` has"),
        "{}",
        text_of(&output)
    );
    std::fs::write(path.join("net.ron"), GRAPH).unwrap();
    let test = "Test(graph: \"net.ron\", expect: [Closed(\"surfce\")])";
    std::fs::write(path.join("net.test.ron"), test).unwrap();
    let output = maquette(path, &[], "", None);
    assert!(text_of(&output).contains("did you mean `surface`?"), "{}", text_of(&output));
}

/// Writes a graph of a mesh with this number of subdivision levels, and a test with this tolerance.
fn write_subdivided(folder: &Path, levels: usize, tolerance: &str) {
    let graph = format!(
        "Graph(format: 1, nodes: {{ \"net\": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 0)]]), \"surface\": Nurbs(net: \"net\"), \"coarse\": Tessellate(surface: \"surface\", u: 20, v: 20), \"smooth\": Subdivide(mesh: \"coarse\", scheme: CatmullClark, levels: {levels}) }}, outputs: {{ \"m.ply\": \"smooth\" }})"
    );
    std::fs::write(folder.join("net.ron"), graph).unwrap();
    let test = format!("Test(graph: \"net.ron\", compare: {{\"m.ply\": Mesh({tolerance})}})");
    std::fs::write(folder.join("net.test.ron"), test).unwrap();
}

#[test]
fn after_a_change_of_topology_the_distance_leads_and_its_unit_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_subdivided(path, 1, "");
    assert!(maquette(path, &["--bless"], "", None).status.success());
    write_subdivided(path, 0, "");
    let output = maquette(path, &["--junit", "j.xml", "--report", "r.html"], "", None);
    let text = text_of(&output);
    let first = text.lines().find(|line| line.contains("smooth: ")).unwrap_or_default();
    assert!(first.contains("smooth: `surface, ") && first.contains(" mm, allowed is"), "{text}");
    assert!(text.contains("faces: "), "{text}");
    fn read(name: &str, path: &Path) -> String {
        std::fs::read_to_string(path.join(name)).unwrap()
    }
    let (junit, page) = (read("j.xml", path), read("r.html", path));
    assert!(
        junit.contains("differs by 0.") && junit.contains(" mm; 100 % of the entries seen"),
        "{junit}"
    );
    assert!(!junit.contains("corners") || !junit.contains("; max "), "{junit}");
    assert!(page.contains("<th>compared") && !page.contains("<td>corners"), "{page}");
}

#[test]
fn a_surface_of_other_faces_passes_by_its_distance_and_what_was_sampled_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_subdivided(path, 2, "max: 0.05, remeshed: true, attributes: {\"uv\": 0.01}");
    assert!(maquette(path, &["--bless"], "", None).status.success());
    write_subdivided(path, 1, "max: 0.05, remeshed: true, attributes: {\"uv\": 0.01}");
    let output = maquette(path, &[], "", None);
    assert!(output.status.success(), "{}", text_of(&output));
    assert!(text_of(&output).contains("within tolerance: `surface, "), "{}", text_of(&output));
    write_subdivided(path, 1, "max: 0.0001, remeshed: true, attributes: {\"uv\": 0.01}");
    assert_eq!(maquette(path, &[], "", None).status.code(), Some(1));
    write_subdivided(path, 2, "max: 0.05, remeshed: true, keep: Sampled(every: 4)");
    let refused = maquette(path, &[], "", None);
    assert!(text_of(&refused).contains("remove `remeshed` or `keep`"), "{}", text_of(&refused));
    write_subdivided(path, 2, "max: 0.05, keep: Sampled(every: 4)");
    let output = maquette(path, &[], "", None);
    assert!(
        text_of(&output).contains("does not store what `keep` in the test file says"),
        "{}",
        text_of(&output)
    );
}

#[test]
fn goldens_of_nodes_that_fail_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fn mesh(last: &str, path: &Path) {
        let mesh = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {last}\n");
        std::fs::write(path.join("mesh.obj"), mesh).unwrap();
    }
    mesh("3", path);
    let graph = r#"Graph(format: 1, nodes: { "m": ReadMesh(path: "mesh.obj"), "b": Primitive(shape: Sphere(radius: 1.0)) },
        outputs: { "m.ply": "m", "b.ply": "b" })"#;
    bless(path, graph);
    let before = golden(path, "m.txt");
    mesh("9", path);
    for arguments in [&["--bless"][..], &[]] {
        let output = maquette(path, arguments, "", None);
        let text = text_of(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.contains("mesh.obj: line 4"), "{text}");
        assert!(!text.contains("belongs to no output"), "{text}");
        assert_eq!(golden(path, "m.txt"), before);
        assert!(path.join("goldens/net/default/m.bin").exists());
    }
}
