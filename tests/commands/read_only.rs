//! Read-only folders: commands that need not write succeed, and others report what the user can do.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "lift": Number(default: 5.0, min: 0.0, max: 40.0, doc: "Lift.") },
    nodes: { "it": Primitive(shape: Box(size: (5, 5, 5))), "lifted": Transform(mesh: "it", translate: (0, Param("lift"), 0)) },
    outputs: { "out.obj": "lifted" },
)
"#;

/// Returns a folder and all folders below it.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let mut all = vec![folder.to_owned()];
    let mut next = 0;
    while let Some(folder) = all.get(next).cloned() {
        let inner = fs::read_dir(folder).unwrap().map(|it| it.unwrap().path());
        all.extend(inner.filter(|it| it.is_dir()));
        next += 1;
    }
    all
}

/// Runs a command while the project's folders are read-only.
fn run_read_only(project: &Project, words: &[&str]) -> (Option<i32>, String) {
    let all = folders(project.folder());
    fn set(mode: u32, all: &[PathBuf]) {
        for folder in all {
            fs::set_permissions(folder, fs::Permissions::from_mode(mode)).unwrap();
        }
    }
    let plain = project.command(words);
    let mut command = if rustix::process::geteuid().is_root() {
        // Root may write to any folder unless it drops this capability.
        let mut command = Command::new("setpriv");
        command.args(["--bounding-set=-dac_override,-dac_read_search"]).arg(plain.get_program());
        command.args(words).current_dir(project.folder());
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command
    } else {
        plain
    };
    set(0o555, &all);
    let output: Output = command.output().unwrap();
    set(0o755, &all);
    let told = [&output.stdout[..], &output.stderr].concat();
    (output.status.code(), String::from_utf8_lossy(&told).into_owned())
}

#[test]
fn a_batch_says_where_else_its_results_could_go() {
    let project = Project::new(GRAPH);
    project.write("maquette.toml", "");
    let batch = ["batch", "doll.ron", "--sweep", "lift=1,2"];
    let help = "= help: make the folder writable, or choose another one with --out";
    let (code, told) = run_read_only(&project, &batch);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("error: cannot write out") && told.contains(help), "{told}");
    let (code, told) = run_read_only(&project, &[&batch[..], &["--emit", "lines"]].concat());
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("error: cannot write out") && told.contains(help), "{told}");

    let elsewhere = tempfile::tempdir().unwrap();
    let out = elsewhere.path().join("all");
    let (code, told) =
        run_read_only(&project, &[&batch[..], &["--out", out.to_str().unwrap()]].concat());
    assert_eq!(code, Some(0), "{told}");
    // If all tasks of the batch have been run before, nothing is written.
    assert!(project.maquette(&batch).status.success());
    let (code, told) = run_read_only(&project, &batch);
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("2 done; 0 run now"), "{told}");
    let (code, told) = run_read_only(&project, &["batch", "doll.ron", "--sweep", "lift=1,2,3"]);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("tasks/3") && told.contains(help), "{told}");
}

#[test]
fn a_run_whose_outputs_are_there_needs_to_write_nothing() {
    let project = Project::new(GRAPH);
    project.write("maquette.toml", "");
    assert!(project.maquette(&["run", "doll.ron"]).status.success());
    let (code, told) = run_read_only(&project, &["run", "doll.ron"]);
    assert_eq!(code, Some(0), "{told}");
    let (code, told) = run_read_only(&project, &["run", "doll.ron", "--set", "lift=6"]);
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("--out chooses another folder"), "{told}");
    let out = project.read("out/doll/out.obj");
    assert!(!out.is_empty());
}
