//! `maquette replay` finds the graph relative to the folder in which `run` was started.

use std::fs;

use crate::project::{Project, TETRAHEDRON};

const GRAPH: &str = r#"Graph(
    format: 1,
    nodes: { "mesh": ReadMesh(path: "tet.obj"), "moved": Transform(mesh: "mesh", translate: (1, 0, 0)) },
    outputs: { "out.ply": "moved" },
)
"#;

/// Makes a folder without a project marker, with a graph in each of these subfolders.
fn project(graphs: &[&str]) -> Project {
    let project = Project::new(GRAPH);
    fs::remove_file(project.graph()).unwrap();
    for folder in graphs {
        let folder = project.folder().join(folder);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("g.ron"), GRAPH).unwrap();
        fs::write(folder.join("tet.obj"), TETRAHEDRON).unwrap();
    }
    project
}

fn check(project: &Project, words: &[&str], code: i32, expected: &str) {
    let output = project.maquette(words);
    let told = [output.stdout, output.stderr].concat();
    let told = String::from_utf8_lossy(&told);
    assert_eq!(output.status.code(), Some(code), "{words:?}: {told}");
    assert!(told.contains(expected), "{words:?}: {told}");
}

const SAME: &str = "is reproduced with the same bytes";

#[test]
fn behind_a_run_from_above_the_project_it_needs_no_words() {
    for has_marker in [true, false] {
        let project = project(&["graphs"]);
        if has_marker {
            fs::write(project.folder().join("graphs/maquette.toml"), "").unwrap();
        }
        check(&project, &["run", "graphs/g.ron", "--no-cache"], 0, "");
        check(&project, &["replay", "out/g/out.ply", "--no-cache"], 0, SAME);
    }
}

#[test]
fn graphs_elsewhere_are_known_from_the_run() {
    let project = project(&["here", "there"]);
    let here = project.folder().join("here");
    fn in_here(words: &[&str], project: &Project, here: &std::path::Path) -> std::process::Output {
        project.command(words).current_dir(here).output().unwrap()
    }
    assert!(in_here(&["run", "../there/g.ron"], &project, &here).status.success());
    fs::remove_file(here.join("g.ron")).unwrap();
    let output = in_here(&["replay", "out/g/out.ply"], &project, &here);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && told.contains(SAME), "{told}");
    // Without a cache, which remembers the run, the error explains what to do.
    let output = in_here(&["replay", "out/g/out.ply", "--no-cache"], &project, &here);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("cannot find the graph `g.ron`") && told.contains("--graph"), "{told}");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn several_graphs_of_the_name_are_told() {
    let project = project(&["a", "b"]);
    check(&project, &["run", "a/g.ron", "--no-cache"], 0, "");
    let told = "several graphs match: `./a/g.ron`, `./b/g.ron`; choose one with --graph";
    check(&project, &["replay", "out/g/out.ply", "--no-cache"], 2, told);
    check(&project, &["replay", "out/g/out.ply", "--no-cache", "--graph", "a/g.ron"], 0, SAME);
}
