//! `fmt`, `set` and `diff` as their users see them.

use std::io::Write;
use std::path::Path;
use std::process::{Output, Stdio};

use expect_test::expect;

use crate::output::{stderr_of, stdout_of};
use crate::program::command;

const DOLL: &str = include_str!("../../graphs/doll.ron");

fn maquette(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

/// Makes a folder with these files. The files that the graphs read do not exist.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    folder
}

fn read(folder: &tempfile::TempDir, name: &str) -> String {
    std::fs::read_to_string(folder.path().join(name)).unwrap()
}

const LOOSE: &str = "Graph(format:1,nodes:{\"a\":ReadMesh(path:\"a.obj\")/* mine */},outputs:{})";
const NEAT: &str = "Graph(\n    format: 1,\n    nodes: {\n        \"a\": ReadMesh(path: \"a.obj\") /* mine */,\n    },\n    outputs: {},\n)\n";

#[test]
fn fmt_check_lists_what_would_change_and_writes_nothing() {
    let files = [
        ("doll.ron", DOLL),
        ("sub/loose.ron", LOOSE),
        ("sub/notes.txt", "x"),
        (".git/x.ron", LOOSE),
    ];
    let folder = folder(&files);
    let output = maquette(folder.path(), &["fmt", "--check", "."]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(stdout_of(&output), "./sub/loose.ron\n");
    assert_eq!(read(&folder, "sub/loose.ron"), LOOSE);
    assert!(maquette(folder.path(), &["fmt", "--check", "doll.ron"]).status.success());
}

#[test]
fn fmt_writes_what_can_be_read_and_leaves_the_rest() {
    let folder = folder(&[("a.ron", LOOSE), ("b.ron", "Graph(format: 1,"), ("c.ron", LOOSE)]);
    let output = maquette(folder.path(), &["fmt", "a.ron", "b.ron", "c.ron"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr_of(&output).contains("error[G001]: this `(` is never closed\n --> b.ron:1:6"));
    assert_eq!((&read(&folder, "a.ron")[..], &read(&folder, "c.ron")[..]), (NEAT, NEAT));
    assert_eq!(read(&folder, "b.ron"), "Graph(format: 1,");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "nothing is left behind");
}

#[test]
fn fmt_without_a_file_goes_from_stdin_to_stdout() {
    let folder = folder(&[]);
    let mut child = command(folder.path(), &["fmt", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(LOOSE.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert_eq!(stdout_of(&output), NEAT);
}

#[cfg(unix)]
#[test]
fn fmt_keeps_a_file_s_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder(&[("a.ron", LOOSE)]);
    let path = folder.path().join("a.ron");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).unwrap();
    assert!(maquette(folder.path(), &["fmt", "a.ron"]).status.success());
    assert_eq!(std::fs::metadata(path).unwrap().permissions().mode() & 0o777, 0o640);
}

#[test]
fn set_changes_the_file_and_says_what() {
    let folder = folder(&[("doll.ron", DOLL)]);
    let values =
        ["edit", "doll.ron", "set", "growth=20", "red.select.distance=25.0", "red.invert=true"];
    let output = maquette(folder.path(), &values);
    assert!(output.status.success(), "{}", stderr_of(&output));
    expect![[r#"
        growth: 12.0 -> 20
        red.select.distance: 30.0 -> 25.0
        red.invert: left out -> true
    "#]]
    .assert_eq(&stdout_of(&output));
    let expected = DOLL
        .replace("default: 12.0", "default: 20")
        .replace("distance: 30.0)", "distance: 25.0), invert: true");
    assert_eq!(read(&folder, "doll.ron"), expected);
}

#[test]
fn set_prints_the_text_in_a_dry_run_and_touches_nothing_in_vain() {
    let folder = folder(&[("doll.ron", DOLL)]);
    let output = maquette(folder.path(), &["edit", "doll.ron", "set", "--dry-run", "growth=20"]);
    assert_eq!(stdout_of(&output), DOLL.replace("default: 12.0", "default: 20"));
    let output =
        maquette(folder.path(), &["edit", "doll.ron", "set", "red.invert=true", "growth=99"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr_of(&output).contains("parameter `growth` is 99 mm, but must be at least 0"));
    let output = maquette(folder.path(), &["edit", "doll.ron", "set", "skin.levels=3"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr_of(&output).contains("= help: set the parameter: levels=3"),
        "{}",
        stderr_of(&output)
    );
    assert_eq!(
        maquette(folder.path(), &["edit", "doll.ron", "set", "levels"]).status.code(),
        Some(2)
    );
    assert_eq!(maquette(folder.path(), &["edit", "doll.ron", "set"]).status.code(), Some(2));
    assert_eq!(read(&folder, "doll.ron"), DOLL);
}

#[test]
fn edit_changes_the_file_and_says_what() {
    let folder = folder(&[("doll.ron", DOLL)]);
    fn edit(arguments: &[&str], folder: &tempfile::TempDir) -> (Option<i32>, String) {
        let output = maquette(folder.path(), &[&["edit", "doll.ron"], arguments].concat());
        (output.status.code(), stdout_of(&output) + &stderr_of(&output))
    }
    let select = "select=Near(color: \"#236cba\")";
    let mut told = String::new();
    for arguments in [
        &["add", "blue", "Threshold", "image=scan.color", select, "--after", "red"][..],
        &["rename", "blue", "eyes"],
        &["link", "spots.mask", "eyes"],
        &["unlink", "surface.u"],
        &["remove", "knots-u"],
        &["output", "eyes.png", "eyes"],
        &["output", "surface.ply"],
        &["rename", "params.growth", "far"],
    ] {
        let (code, words) = edit(arguments, &folder);
        assert_eq!(code, Some(0), "{arguments:?}: {words}");
        told += &words;
    }
    expect![[r##"
        node blue: added: Threshold(image: "scan", select: Near(color: "#236cba"))
        node eyes: renamed, was blue
        node spots: rewired mask: "red" -> "eyes"
        node surface: rewired u: "knots-u" -> left out
        node knots-u: removed: Knots(along: U, net: "raised")
        output eyes.png: added: "eyes"
        output surface.ply: removed: "surface"
        parameter far: renamed, was growth
    "##]]
    .assert_eq(&told);
    let expected = DOLL
        .replace(
            "30.0)),\n",
            "30.0)),\n        \"eyes\": Threshold(image: \"scan.color\", select: Near(color: \"#236cba\")),\n",
        )
        .replace("mask: \"red\"", "mask: \"eyes\"")
        .replace(", u: \"knots-u\"", "")
        .replace("        \"knots-u\": Knots(net: \"raised\", along: U, order: 3),\n", "")
        .replace("\": \"red\",\n", "\": \"red\",\n        \"eyes.png\": \"eyes\",\n")
        .replace("        \"surface.ply\": \"surface\",\n", "")
        .replace("\"growth\"", "\"far\"");
    assert_eq!(read(&folder, "doll.ron"), expected);
}

#[test]
fn edit_prints_the_lines_in_a_dry_run_and_refuses_what_would_be_wrong() {
    let folder = folder(&[("doll.ron", DOLL)]);
    fn edit(arguments: &[&str], folder: &tempfile::TempDir) -> (Option<i32>, String) {
        let output = maquette(folder.path(), &[&["edit", "doll.ron"], arguments].concat());
        (output.status.code(), stdout_of(&output) + &stderr_of(&output))
    }
    let (code, lines) = edit(&["remove", "knots-u", "--and-links", "--dry-run"], &folder);
    assert_eq!(code, Some(0));
    expect![[r#"
        @@ -23 +22,0 @@
        -        "knots-u": Knots(net: "raised", along: U, order: 3),
        @@ -25 +24 @@
        -        "surface": Nurbs(net: "raised", u: "knots-u", v: "knots-v"),
        +        "surface": Nurbs(net: "raised", v: "knots-v"),
    "#]]
    .assert_eq(&lines);
    let (code, words) = edit(&["remove", "knots-u"], &folder);
    assert_eq!(code, Some(1));
    expect![[r#"
        error[G007]: `knots-u` cannot be removed: port `u` of `surface` needs it
          --> doll.ron:25:44
           |
        25 |         "surface": Nurbs(net: "raised", u: "knots-u", v: "knots-v"),
           |                                            ^^^^^^^^^
           |
           = help: link it to something else, or remove optional links, too (--and-links)

    "#]]
    .assert_eq(&words);
    for wrong in [&["add", "x"][..], &["link", "surface.u"], &["turn", "surface"], &[]] {
        assert_eq!(edit(wrong, &folder).0, Some(2), "{wrong:?}");
    }
    assert_eq!(read(&folder, "doll.ron"), DOLL);
}

#[test]
fn diff_says_by_its_exit_code_whether_two_graphs_mean_the_same() {
    let changed = DOLL.replace("distance: 30.0", "distance: 31");
    let folder = folder(&[("a.ron", DOLL), ("b.ron", &changed), ("c.ron", "Graph(")]);
    std::fs::write(folder.path().join("same.ron"), DOLL.replace("    ", "\t")).unwrap();
    fn diff(arguments: &[&str], folder: &tempfile::TempDir) -> Output {
        maquette(folder.path(), &[&["diff"], arguments].concat())
    }
    let output = diff(&["a.ron", "same.ron"], &folder);
    assert_eq!((output.status.code(), stdout_of(&output)), (Some(0), String::new()));
    let output = diff(&["a.ron", "b.ron"], &folder);
    let expected = "node red: changed select.distance: 30 -> 31\n".to_owned();
    assert_eq!((output.status.code(), stdout_of(&output)), (Some(1), expected));
    for wrong in [&["a.ron", "c.ron"][..], &["a.ron", "nowhere.ron"], &["a.ron"], &["a.ron"; 3]] {
        assert_eq!(diff(wrong, &folder).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn diff_json_is_one_document() {
    let folder = folder(&[("a.ron", DOLL), ("b.ron", &DOLL.replace("\"net\"", "\"points\""))]);
    let output = maquette(folder.path(), &["diff", "--json", "a.ron", "b.ron"]);
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        document,
        serde_json::json!({
            "old": "a.ron",
            "new": "b.ron",
            "equal": false,
            "differences": [{
                "what": "node",
                "name": "points",
                "change": "renamed",
                "field": "",
                "before": "net",
                "after": "points",
            }],
        })
    );
}

#[test]
fn diff_takes_the_arguments_of_git() {
    let folder = folder(&[("old", DOLL), ("new", &DOLL.replace("default: 12.0", "default: 13"))]);
    let output = maquette(
        folder.path(),
        &["diff", "graphs/doll.ron", "old", "c0ffee", "100644", "new", "c0ffef", "100644"],
    );
    assert!(output.status.success(), "git takes anything else for a crash");
    assert_eq!(
        stdout_of(&output),
        "graphs/doll.ron\n    parameter growth: changed default: 12 -> 13\n"
    );
    let new = ["diff", "doll.ron", "/dev/null", ".", ".", "old", "c0ffee", "100644"];
    assert!(stdout_of(&maquette(folder.path(), &new)).contains("node scan: added: ReadCapture("));
}
