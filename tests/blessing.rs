//! Results become goldens when a person says so, and a reader of the change sees why.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const GRAPH: &str = r#"Graph(
    format: 1,
    nodes: {
        "net": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 0)]]),
        "surface": Nurbs(net: "net"),
    },
    outputs: { "net.ply": "net", "surface.ply": "surface" },
)"#;

/// A folder with a graph, its test and its goldens, all committed.
fn blessed() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("net.ron"), GRAPH).unwrap();
    std::fs::write(path.join("net.test.ron"), "Test(graph: \"net.ron\")").unwrap();
    std::fs::write(path.join(".gitignore"), "cache\n").unwrap();
    git(path, &["init", "--quiet"]);
    assert!(maquette(path, &["--bless"], "", None).status.success());
    commit(path);
    folder
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
    // A program that is refused may end before it reads.
    let _ = child.stdin.take().unwrap().write_all(typed.as_bytes());
    child.wait_with_output().unwrap()
}

/// Moves the middle point of the net.
fn change(folder: &Path, to: &str) {
    std::fs::write(folder.join("net.ron"), GRAPH.replace("(1, 1, 2)", to)).unwrap();
}

fn golden(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join("goldens/net/default").join(name)).unwrap()
}

fn said(output: &Output) -> String {
    [&output.stdout[..], &output.stderr[..]].map(String::from_utf8_lossy).concat()
}

#[test]
fn a_golden_is_accepted_with_the_reason_and_another_refused() {
    let folder = blessed();
    let path = folder.path();
    change(path, "(1, 1, 2.5)");
    let before = [golden(path, "surface.txt"), golden(path, "nodes.txt")];
    let output = maquette(path, &["--review"], "what?\na\nr\n", None);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("because node `net`: 2.0 -> 2.5"), "{text}");
    assert!(text.contains("blessed   net.ron default net:"), "{text}");
    assert!(text.contains("1 golden blessed"), "{text}");
    let accepted = golden(path, "net.txt");
    assert!(
        accepted.contains("accepted because              node `net`: 2.0 -> 2.5"),
        "{accepted}"
    );
    // What was refused stays, and so does why it is different.
    assert_eq!([golden(path, "surface.txt"), golden(path, "nodes.txt")], before);
    let again = maquette(path, &[], "", None);
    assert!(said(&again).contains("node `net`: 2.0 -> 2.5"), "{}", said(&again));
    assert!(!said(&again).contains("net: `point`"), "{}", said(&again));
}

#[test]
fn who_quits_accepts_nothing_more() {
    let folder = blessed();
    change(folder.path(), "(1, 1, 2.5)");
    let before = ["net.txt", "surface.txt"].map(|name| golden(folder.path(), name));
    for typed in ["q\n", ""] {
        let output = maquette(folder.path(), &["--review"], typed, None);
        assert_eq!(output.status.code(), Some(1));
        assert!(said(&output).contains("0 goldens blessed"), "{}", said(&output));
    }
    assert_eq!(["net.txt", "surface.txt"].map(|name| golden(folder.path(), name)), before);
}

#[test]
fn nothing_is_blessed_where_ci_is_set() {
    let folder = blessed();
    change(folder.path(), "(1, 1, 2.5)");
    let before = golden(folder.path(), "net.txt");
    for arguments in ["--bless", "--review"] {
        let output = maquette(folder.path(), &[arguments], "a\na\n", Some("true"));
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    }
    assert_eq!(golden(folder.path(), "net.txt"), before);
}

#[test]
fn nothing_is_blessed_over_goldens_that_are_not_committed() {
    let folder = blessed();
    let path = folder.path();
    change(path, "(1, 1, 2.5)");
    assert!(maquette(path, &["--bless"], "", None).status.success());
    change(path, "(1, 1, 3)");
    let before = golden(path, "net.txt");
    for arguments in ["--bless", "--review"] {
        let output = maquette(path, &[arguments], "a\na\n", None);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains("changes that are not committed"), "{}", said(&output));
    }
    assert_eq!(golden(path, "net.txt"), before);
    commit(path);
    assert!(maquette(path, &["--bless"], "", None).status.success());
}

#[test]
fn a_much_too_wide_tolerance_is_told() {
    let folder = blessed();
    let path = folder.path();
    for (max, wide) in [("0.1", true), ("0.02", false)] {
        let text = format!(
            "Test(graph: \"net.ron\", compare: {{\"net.ply\": ControlNet(max: {max}), \"surface.ply\": Surface(max: {max})}})"
        );
        std::fs::write(path.join("net.test.ron"), text).unwrap();
        change(path, "(1, 1, 2.004)");
        let output = maquette(path, &[], "", None);
        assert!(output.status.success(), "{}", said(&output));
        let text = said(&output);
        assert_eq!(text.contains("ten times wider than ever needed (0.004)"), wide, "{text}");
    }
}
