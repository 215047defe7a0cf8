//! `maquette merge` as a command and as git's merge driver.

use std::process::{Command, Output};

use crate::project::Project;

const BASE: &str = r#"// A ball.
Graph(
    format: 1,
    params: { "size": Number(default: 1.0, min: 0.1, max: 9.0, doc: "How large.") },
    nodes: {
        "ball": ReadMesh(path: "ball.obj"),
        // Scaled.
        "big": Transform(mesh: "ball", scale: (1.0, 1.0, 1.0)),
    },
    outputs: { "big.ply": "big" },
)
"#;

/// Makes a git repository that uses the program as its merge driver.
fn repository() -> Project {
    let project = Project::new(BASE);
    let driver = format!("\"{}\" merge %O %A %B --path %P", env!("CARGO_BIN_EXE_maquette"));
    std::fs::write(project.folder().join(".gitattributes"), "*.ron merge=maquette\n").unwrap();
    for arguments in [
        &["init", "-q", "-b", "main"][..],
        &["config", "user.name", "A"],
        &["config", "user.email", "a@example.com"],
        &["config", "commit.gpgsign", "false"],
        &["config", "merge.maquette.driver", &driver],
    ] {
        assert!(git(&project, arguments).status.success(), "{arguments:?}");
    }
    commit(&project, BASE);
    project
}

fn git(project: &Project, arguments: &[&str]) -> Output {
    let mut git = Command::new("git");
    git.args(arguments).current_dir(project.folder());
    git.env("GIT_CONFIG_GLOBAL", "/dev/null").env("GIT_CONFIG_NOSYSTEM", "1");
    git.output().unwrap()
}

fn commit(project: &Project, text: &str) {
    project.save(text);
    git(project, &["add", "-A"]);
    let done = git(project, &["commit", "-q", "-m", "x"]);
    assert!(done.status.success(), "{done:?}");
}

/// Lets git merge two texts; returns the result, and true if there was no conflict.
fn merge(ours: &str, theirs: &str) -> (String, bool) {
    let project = repository();
    git(&project, &["checkout", "-q", "-b", "theirs"]);
    commit(&project, theirs);
    git(&project, &["checkout", "-q", "main"]);
    commit(&project, ours);
    let done = git(&project, &["merge", "-q", "--no-edit", "theirs"]);
    (std::fs::read_to_string(project.graph()).unwrap(), done.status.success())
}

#[test]
fn git_merges_edits_of_one_line_and_of_neighbors() {
    let ours = BASE.replace("default: 1.0", "default: 2.0");
    let theirs = BASE.replace("max: 9.0", "max: 20.0");
    let both = BASE.replace("default: 1.0", "default: 2.0").replace("max: 9.0", "max: 20.0");
    assert_eq!(merge(&ours, &theirs), (both, true));
}

#[test]
fn git_merges_a_new_name_with_a_new_link_to_the_old_one() {
    let ours = BASE.replace("\"big\"", "\"large\"");
    let last = "scale: (1.0, 1.0, 1.0)),\n";
    let other = "        \"more\": Transform(mesh: \"big\", translate: (1.0, 0.0, 0.0)),\n";
    let theirs = BASE.replace(last, &format!("{last}{other}"));
    let both = ours.replace(last, &format!("{last}{}", other.replace("big", "large")));
    assert_eq!(merge(&ours, &theirs), (both, true));
}

#[test]
fn git_keeps_a_real_conflict_with_its_marks() {
    let ours = BASE.replace("(1.0, 1.0, 1.0)", "(2.0, 2.0, 2.0)");
    let theirs = BASE.replace("(1.0, 1.0, 1.0)", "(3.0, 3.0, 3.0)");
    let (text, is_content) = merge(&ours, &theirs);
    assert!(!is_content);
    fn line(scale: &str) -> String {
        format!("        \"big\": Transform(mesh: \"ball\", scale: {scale}),\n")
    }
    let marked = format!(
        "<<<<<<< ours\n{}=======\n{}>>>>>>> theirs\n",
        line("(2.0, 2.0, 2.0)"),
        line("(3.0, 3.0, 3.0)")
    );
    assert_eq!(text, BASE.replace(&line("(1.0, 1.0, 1.0)"), &marked));
}

#[test]
fn the_result_is_written_into_ours_or_printed_and_the_exit_code_says_how_it_went() {
    let project = Project::new(BASE);
    fn put(name: &str, text: &str, project: &Project) {
        std::fs::write(project.folder().join(name), text).unwrap();
    }
    put("ours.ron", &BASE.replace("default: 1.0", "default: 2.0"), &project);
    put("theirs.ron", &BASE.replace("max: 9.0", "max: 20.0"), &project);
    let both = BASE.replace("default: 1.0", "default: 2.0").replace("max: 9.0", "max: 20.0");
    let words = ["merge", "doll.ron", "ours.ron", "theirs.ron"];
    let printed = project.maquette(&[&words[..], &["--print"]].concat());
    assert_eq!(String::from_utf8(printed.stdout).unwrap(), both);
    let written = project.maquette(&words);
    assert_eq!(written.status.code(), Some(0), "{written:?}");
    assert_eq!(std::fs::read_to_string(project.folder().join("ours.ron")).unwrap(), both);
    put("theirs.ron", &BASE.replace("default: 1.0", "default: 3.0"), &project);
    let conflict = project.maquette(&words);
    assert_eq!(conflict.status.code(), Some(1));
    let told = String::from_utf8(conflict.stderr).unwrap();
    assert_eq!(told, "ours.ron: conflict: both sides changed params.size.default\n");
    put("theirs.ron", "Graph(", &project);
    let broken = project.maquette(&words);
    assert_eq!(broken.status.code(), Some(1));
    let told = String::from_utf8(broken.stderr).unwrap();
    assert!(told.contains("--> theirs.ron:1:6") && told.contains("merged line by line"), "{told}");
}

#[test]
fn git_keeps_both_sides_where_what_they_say_cannot_be_merged() {
    let broken = BASE.replace("(1.0, 1.0, 1.0)", "(3.0");
    let (text, is_content) = merge(&BASE.replace("(1.0, 1.0, 1.0)", "(2.0, 2.0, 2.0)"), &broken);
    assert!(!is_content && text.contains("<<<<<<< ours\n"), "{text}");
    assert!(text.contains("scale: (2.0, 2.0, 2.0)") && text.contains("scale: (3.0"), "{text}");
    // The other side's text has a syntax error in a part that this side did not change. The result has no conflict markers, but git still
    // reports a conflict.
    let (text, is_content) = merge(&BASE.replace("default: 1.0", "default: 2.0"), &broken);
    assert!(!is_content && text.contains("default: 2.0") && text.contains("scale: (3.0"), "{text}");

    let project = repository();
    fn add(text: &str, project: &Project) {
        std::fs::write(project.folder().join("new.ron"), text).unwrap();
        git(project, &["add", "-A"]);
        assert!(git(project, &["commit", "-q", "-m", "x"]).status.success());
    }
    git(&project, &["checkout", "-q", "-b", "theirs"]);
    add(&BASE.replace("A ball", "Their ball"), &project);
    git(&project, &["checkout", "-q", "main"]);
    add(&BASE.replace("A ball", "Our ball"), &project);
    let done = git(&project, &["merge", "--no-edit", "theirs"]);
    let told = format!("{done:?}");
    assert!(!done.status.success() && told.contains("CONFLICT (add/add)"), "{told}");
    let text = std::fs::read_to_string(project.folder().join("new.ron")).unwrap();
    assert!(text.contains("<<<<<<< ours\n") && text.contains("Our ball"), "{text}");
    assert!(text.contains("Their ball") && !told.contains("the file is empty"), "{text}{told}");
}
