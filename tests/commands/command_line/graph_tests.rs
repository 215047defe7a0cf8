//! `maquette test`: compares results, accepts them, and compares them again.

use std::path::Path;
use std::process::{Command, Output};

use super::{names, stderr, stdout};

/// Makes a folder with the subdivided doll and its test, without goldens.
pub(super) fn tested_graph() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write(
        "net.ron",
        r#"Graph(
            format: 1,
            nodes: {
                "net": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 0)]]),
                "surface": Nurbs(net: "net"),
                "mesh": Tessellate(surface: "surface", u: 8, v: 8),
            },
            outputs: { "mesh.ply": "mesh" },
        )"#,
        &folder,
    );
    write(
        "net.test.ron",
        "Test(graph: \"net.ron\", compare: {\"mesh.ply\": Mesh(max: 0.01)})",
        &folder,
    );
    folder
}

fn test_in(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_maquette"))
        .arg("test")
        .args(arguments)
        .env("MAQUETTE_CACHE", folder.join("cache"))
        .env_remove("CI")
        .current_dir(folder)
        .output()
        .unwrap()
}

#[test]
fn a_graph_is_tested_blessed_and_tested_again() {
    let folder = tested_graph();
    fn test(arguments: &[&str], folder: &tempfile::TempDir) -> Output {
        test_in(folder.path(), arguments)
    }
    let first = test(&[], &folder);
    assert_eq!(first.status.code(), Some(1));
    assert!(stdout(&first).contains("mesh: there is no golden"), "{}", stdout(&first));
    assert!(!folder.path().join("goldens").exists(), "a test never makes a golden");
    assert!(test(&["--bless"], &folder).status.success());
    assert_eq!(
        names(&folder.path().join("goldens/net/default")),
        ["mesh.bin", "mesh.txt", "nodes.txt"]
    );
    let second = test(&["--cold"], &folder);
    assert!(second.status.success(), "{}{}", stdout(&second), stderr(&second));
    assert!(stdout(&second).contains("identical; 3 of 3 nodes computed"), "{}", stdout(&second));

    let graph = folder.path().join("net.ron");
    let text = std::fs::read_to_string(&graph).unwrap();
    std::fs::write(&graph, text.replace("(1, 1, 2)", "(1, 1, 2.01)")).unwrap();
    let near = test(&[], &folder);
    assert!(near.status.success(), "{}", stdout(&near));
    assert!(stdout(&near).contains("within tolerance"), "{}", stdout(&near));
    std::fs::write(&graph, text.replace("(1, 1, 2)", "(1, 1, 2.5)")).unwrap();
    let far = test(&["--report", "report.html", "--junit", "junit.xml"], &folder);
    assert_eq!(far.status.code(), Some(1));
    assert!(stdout(&far).contains("mm, allowed is 0.01 mm; worst at"), "{}", stdout(&far));
    assert!(
        stdout(&far).contains("node `net`: parameter `points[1][1][2]` 2 -> 2.5"),
        "{}",
        stdout(&far)
    );
    let report = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(report.contains("distance to the old one, from the front"));
    assert!(!report.contains("http"), "the page needs nothing else");
    let junit = std::fs::read_to_string(folder.path().join("junit.xml")).unwrap();
    assert!(junit.contains("tests=\"1\" failures=\"1\" errors=\"0\""), "{junit}");
    let blessed = test(&["--bless"], &folder);
    assert!(
        stdout(&blessed).contains("because node `net`: parameter `points[1][1][2]` 2 -> 2.5"),
        "{}",
        stdout(&blessed)
    );
    assert!(test(&[], &folder).status.success());
}

#[test]
fn a_test_that_cannot_run_is_not_a_test_that_fails() {
    let folder = tested_graph();
    let path = folder.path().join("net.test.ron");
    std::fs::write(&path, "Test(graph: \"net.ron\", compare: {\"mesh.plx\": Mesh(max: 0.01)})")
        .unwrap();
    let output = test_in(folder.path(), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("net.test.ron:1:34"), "{}", stderr(&output));
    assert!(stderr(&output).contains("did you mean `mesh.ply`?"), "{}", stderr(&output));
    std::fs::write(&path, "Test(graf: \"net.ron\")").unwrap();
    assert_eq!(test_in(folder.path(), &[]).status.code(), Some(2));
    assert_eq!(test_in(folder.path(), &["nowhere"]).status.code(), Some(2));
}

#[test]
fn blessing_is_refused_on_ci() {
    let folder = tested_graph();
    let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
    let output = command
        .args(["test", "--bless"])
        .env("CI", "true")
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(!folder.path().join("goldens").exists());
}
