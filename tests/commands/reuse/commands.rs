//! The program's commands for graphs that use other graphs.

use std::path::Path;

use expect_test::expect;

use super::folder::{Folder, MOVED, graph};
use crate::program::maquette;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

fn stdout(folder: &Folder, arguments: &[&str]) -> String {
    let output = maquette(&folder.path(""), arguments);
    String::from_utf8(output.stdout).unwrap()
}

fn stderr(folder: &Folder, arguments: &[&str]) -> String {
    let output = maquette(&folder.path(""), arguments);
    String::from_utf8(output.stderr).unwrap()
}

fn twice() -> Folder {
    Folder::with_nodes(
        r#""a": Moved(mesh: "doll"), "b": ForEach(graph: "Moved", over: [(), (step: 2.0)], links: (mesh: "a")), "out": Merge(meshes: "b")"#,
    )
}

#[test]
fn check_prints_the_path_of_uses() {
    let text = graph(r#""out": Moved(mesh: "doll")"#);
    let moved = MOVED.replace("translate:", "translat:");
    let folder = Folder::new(&[("graph.ron", &text), ("lib/moved.ron", &moved)]);
    let json = stdout(&folder, &["check", "graph.ron", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let problem = &json["problems"][0];
    assert_eq!(json["problems"].as_array().unwrap().len(), 1);
    assert_eq!(
        (problem["file"].as_str(), problem["line"].as_u64()),
        (Some("lib/moved.ron"), Some(7))
    );
    let wanted =
        serde_json::json!([{ "name": "out", "file": "graph.ron", "line": 3, "column": 1 }]);
    assert_eq!(problem["uses"], wanted);
    expect![[r#"
        error[G004]: Transform has no field `translat`
         --> lib/moved.ron:7:44
          |
        7 |     nodes: { "it": Transform(mesh: "mesh", translat: (Param("step"), 0, 0)) },
          |                                            ^^^^^^^^
          |
          = help: did you mean `translate`?
          = note: used by `out` at graph.ron:3:1

    "#]]
    .assert_eq(&stderr(&folder, &["check", "graph.ron"]));
}

#[test]
fn the_reference_of_a_graph_is_that_of_the_graphs_that_it_uses() {
    let folder = twice();
    let moved = stdout(&folder, &["nodes", "graph.ron"]);
    expect![[r#"
        Moved (lib/moved.ron)

        Moves a mesh to the right.

        Inputs
          mesh: Mesh
              What is moved.

        Parameters
          step: number 0 to 10 mm = 1.0
              How far.

        Outputs
          mesh: Mesh

        Exactness
          exact: the same bytes on every machine and build
    "#]]
    .assert_eq(&moved);
    assert_eq!(stdout(&folder, &["nodes", "graph.ron", "Moved"]), moved);
    let json = stdout(&folder, &["nodes", "graph.ron", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let node = &json["nodes"][0];
    assert_eq!(node["name"], "Moved");
    assert_eq!(node["inputs"][0]["types"], serde_json::json!(["Mesh"]));
    assert_eq!(node["outputs"], serde_json::json!([{ "name": "mesh", "types": ["Mesh"] }]));
    assert_eq!(node["parameters"]["properties"]["step"]["maximum"], 10.0);
    assert!(stdout(&folder, &["nodes", "lib/moved.ron"]).starts_with("moved (lib/moved.ron)"));
    assert!(stderr(&folder, &["nodes", "graph.ron", "Movd"]).contains("did you mean `Moved`?"));
}

#[test]
fn what_is_inside_of_a_use_can_be_looked_at() {
    let folder = twice();
    for node in ["a", "a.mesh", "a/it", "b", "b/2", "b/2.mesh", "b/2/it"] {
        let output = maquette(&folder.path(""), &["inspect", "graph.ron", node]);
        assert!(output.status.success(), "{node}: {}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(stderr(&folder, &["inspect", "graph.ron", "a.msh"]).contains("its outputs: mesh"));
    assert!(stdout(&folder, &["run", "graph.ron", "--only", "out.ply"]).contains("a/it"));
    let why = stdout(&folder, &["why", "graph.ron", "a", "--set", "a.step=3"]);
    expect![[r#"
        `a/it` runs: parameter `translate[0]` 1 -> 3, `--set a.step=3`
    "#]]
    .assert_eq(&why);
    let list = stdout(&folder, &["watch", "--list", "graph.ron"]);
    assert!(list.contains("lib/moved.ron  a graph that it uses"), "{list}");
    let drawn = stdout(&folder, &["draw", "graph.ron", "--dot"]);
    assert!(drawn.contains("| a\\nMoved |") && !drawn.contains("Transform"), "{drawn}");
    let set = stdout(&folder, &["edit", "graph.ron", "set", "a.step=2.5", "--dry-run"]);
    assert!(set.contains("\"a\": Moved(mesh: \"doll\", step: 2.5)"), "{set}");
    assert!(stderr(&folder, &["edit", "graph.ron", "set", "a.step=99"]).contains("at most 10"));
}

#[test]
fn a_default_of_a_used_graph_that_is_written_out_is_no_difference() {
    let folder = twice();
    let text = std::fs::read_to_string(folder.path("graph.ron")).unwrap();
    let text = text.replace("Moved(mesh: \"doll\")", "Moved(step: 1, mesh: \"doll.mesh\")");
    std::fs::write(folder.path("other.ron"), text).unwrap();
    let output = maquette(&folder.path(""), &["diff", "graph.ron", "other.ron"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn graphs_may_be_nested_deeply_and_circles_end() {
    let mut files = vec![("g0.ron".to_owned(), MOVED.to_owned())];
    for k in 1..250 {
        let inner = format!("g{}.ron", k - 1);
        let text =
            MOVED.replace("Graph(", &format!("Graph(use: {{ \"Moved\": \"{inner}\" }},")).replace(
                "Transform(mesh: \"mesh\", translate: (Param(\"step\"), 0, 0))",
                "Moved(mesh: \"mesh\", step: Param(\"step\"))",
            );
        files.push((format!("g{k}.ron"), text));
    }
    let text = graph(r#""out": Moved(mesh: "doll", step: 4.0)"#).replace("lib/moved", "g249");
    files.push(("graph.ron".to_owned(), text));
    let files: Vec<_> = files.iter().map(|(name, text)| (&name[..], &text[..])).collect();
    let folder = Folder::new(&files);
    assert_eq!(folder.x_of(&[], "out"), 4.0);
}

#[test]
fn the_gallery_is_up_to_date() {
    let output =
        maquette(Path::new(GRAPHS).parent().unwrap(), &["render", "gallery", "graphs", "--check"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_gallery_passes_over_lock_files_and_pins_and_names_its_own_graphs() {
    let folder = Folder::new(&[("graph.ron", &graph(r#""out": Moved(mesh: "doll", step: 4.0)"#))]);
    fn run(words: &[&str], folder: &Folder) -> String {
        let output = maquette(&folder.path(""), words);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
    run(&["lock", "graph.ron"], &folder);
    run(&["pin", "graph.ron", "doll"], &folder);
    assert!(run(&["render", "gallery", "."], &folder).contains("README.md: 1 graph\n"));
    let page = std::fs::read_to_string(folder.path("README.md")).unwrap();
    assert!(page.contains("This page is made by `maquette render gallery .`."), "{page}");
    assert!(page.contains("## [graph]") && !page.contains("face.ron"), "{page}");
}

#[test]
fn a_lock_says_nothing_of_a_graph_that_cannot_be_read() {
    let text = graph(r#""out": Moved(mesh: "doll", step: 4.0)"#);
    let folder = Folder::new(&[("graph.ron", &text)]);
    assert!(maquette(&folder.path(""), &["lock", "graph.ron"]).status.success());
    std::fs::write(folder.path("graph.ron"), text + "broken").unwrap();
    let output = maquette(&folder.path(""), &["check", "graph.ron"]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && !told.contains("nothing uses it any more"), "{told}");
}

#[test]
fn a_patch_that_changes_nothing_is_no_difference() {
    let text = graph(r#""out": Moved(mesh: "doll", step: 4.0)"#);
    let text = text.replace("format: 1,", "format: 1, params: { \"up\": Number(default: 1.0) },");
    let folder = Folder::new(&[
        ("graph.ron", &text),
        ("a.ron", "Patch(format: 1, of: \"graph.ron\", params: { \"up\": 9.0 })"),
        ("c.ron", "Patch(format: 1, of: \"a.ron\")"),
    ]);
    let output = maquette(&folder.path(""), &["diff", "a.ron", "c.ron"]);
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && told.is_empty(), "{told}");
}
