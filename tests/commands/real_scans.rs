//! Runs graphs on scans of real objects, from files to files. The graphs are in `tests/scans`.

use std::path::Path;
use std::process::Output;

use crate::beside::shared_folder;
use crate::output::{stderr_of, stdout_of};
use crate::project::{self, Project};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/scans");

/// Makes a project with a graph, whose path is relative to `GRAPHS`, and the scans that it reads, each in its own folder.
fn project(graph: &str, scans: &[(&str, &Path)]) -> Project {
    let project = Project::with_files(&[("maquette.toml", "")]);
    let graph = Path::new(GRAPHS).join(graph);
    std::fs::copy(&graph, project.folder().join(graph.file_name().unwrap())).unwrap();
    for (name, from) in scans {
        let folder = project.folder().join(name);
        std::fs::create_dir(&folder).unwrap();
        let files = std::fs::read_dir(from).unwrap().map(|file| file.unwrap());
        for file in files.filter(|file| file.path().is_file()) {
            std::fs::copy(file.path(), folder.join(file.file_name())).unwrap();
        }
    }
    project
}

fn maquette(project: &Project, words: &[&str]) -> Output {
    let output = project.maquette(words);
    assert!(output.status.success(), "{}", stderr_of(&output));
    output
}

/// The expectations in the graph are the test: they state the position of the second scan, and that the solid can be printed.
#[test]
fn two_scans_of_a_bunny_become_a_solid() {
    let Some(scans) = shared_folder("data/real/stanford_bunny") else { return };
    let project = project("bunny.ron", &[("bunny", &scans)]);
    maquette(&project, &["run", "bunny.ron"]);
    assert!(project.folder().join("out/bunny/solid.3mf").is_file());
}

/// The expectations in the graphs are the test.
#[test]
fn captures_of_the_documentation_become_solids() {
    for (name, data) in
        [("pitcher", "ycb_pitcher"), ("bowl", "ycb_bowl"), ("bottles", "pcl_bottles")]
    {
        let Some(scan) = shared_folder(&format!("data/real/{data}")) else { return };
        let project = project(&format!("../../docs/captures/{name}.ron"), &[(name, &scan)]);
        maquette(&project, &["run", &format!("{name}.ron")]);
        assert!(project.folder().join(format!("out/{name}/model.glb")).is_file());
    }
}

/// One graph handles three scans of objects on tables, although the sensors and the files differ. Most of the cells with a depth show the
/// table and the wall, so few vertices may remain.
#[test]
fn what_stands_on_a_table_is_isolated() {
    let tables = ["ycb_pitcher", "ycb_bowl", "pcl_bottles"];
    let found = tables.map(|name| shared_folder(&format!("data/real/{name}")));
    let [Some(pitcher), Some(bowl), Some(bottles)] = found else { return };
    let scans: [(&str, &Path); 3] = [("pitcher", &pitcher), ("bowl", &bowl), ("bottles", &bottles)];
    let project = project("tabletop.ron", &scans);
    for (name, cells) in [("pitcher", 31_845.0), ("bowl", 36_786.0), ("bottles", 38_657.0)] {
        let files = [("color", "colour.png"), ("range", "range.pcd")]
            .map(|(of, file)| format!("capture.{of}=\"{name}/{file}\""));
        let [color, range] = &files;
        let words = ["run", "tabletop.ron", "--out", name, "--set", color, "--set", range];
        maquette(&project, &words);
        let told = maquette(&project, &["inspect", &format!("{name}/model.glb"), "--json"]);
        let told: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
        let vertices = told["outputs"][0]["facts"]["vertices"].as_f64().unwrap();
        assert!(0.1 * cells < vertices && vertices < 0.45 * cells, "{name}: {vertices}");
    }
}

/// The expectations in the graph are the test: the scanned points are on the solid, and it can be printed. The written files have textures.
#[test]
fn two_captures_of_a_doll_become_a_textured_solid() {
    let Some(doll) = shared_folder("data/doll") else { return };
    let [front, left] = ["front", "left"].map(|side| doll.join(side));
    let scans: [(&str, &Path); 3] = [("front", &front), ("left", &left), ("doll", &doll)];
    let project = project("two_captures.ron", &scans);
    maquette(&project, &["run", "two_captures.ron"]);
    let told = maquette(&project, &["inspect", "out/two_captures/model.glb", "--json"]);
    assert!(stdout_of(&told).contains("1024 x 1024"));
    assert!(project.folder().join("out/two_captures/model.3mf").is_file());
}

#[test]
fn a_shell_of_a_cropped_scan_is_closed_on_both_sides() {
    let project = Project::empty();
    let doll = Path::new(project::GRAPHS).join("doll/coarse.obj");
    std::fs::copy(doll, project.folder().join("doll.obj")).unwrap();
    let graph = r#"Graph(format: 1, params: { "side": Choice(default: Inside, of: [Inside, Outside], doc: "") }, nodes: {
        "doll": ReadMesh(path: "doll.obj"),
        "part": Crop(mesh: "doll", within: Plane(through: (0, 44, 0), normal: (0, -1, 0.2))),
        "shell": Shell(mesh: "part", thickness: 8.0, side: Param("side")),
    }, outputs: { "shell.glb": "shell" }, expect: [Closed("shell"), NoSelfIntersection("shell")])"#;
    project.write("shell.ron", graph);
    for side in ["Inside", "Outside"] {
        maquette(&project, &["run", "shell.ron", "--set", &format!("side={side}")]);
    }
}
