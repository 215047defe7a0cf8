//! Tables of the elements of values, which can be selected and sorted, for people and for other programs.

use serde_json::Value as Json;

use crate::project::Project;

const GRAPH: &str = r##"Graph(
    format: 1,
    nodes: {
        "mesh": ReadMesh(path: "quad.obj"),
        "curved": Curvature(mesh: "mesh", method: Mesh),
        "color": ReadImage(path: "doll/color.png"),
        "red": Threshold(image: "color", select: Near(color: "#c33923", distance: 30.0)),
    },
    outputs: { "mesh.ply": "mesh", "curved.ply": "curved", "red.png": "red" },
)"##;

/// Three triangles in a row, with areas of 2, 8 and 1 mm^2.
const MESH: &str = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 10 0 0\nv 14 0 0\nv 10 4 0\nv 20 0 0\nv 22 0 0\nv 20 1 0\n\
                    f 1 2 3\nf 4 5 6\nf 7 8 9\n";

fn project() -> Project {
    let project = Project::doll();
    project.save(GRAPH);
    std::fs::write(project.folder().join("quad.obj"), MESH).unwrap();
    project
}

fn inspect(project: &Project, node: &str, more: &[&str]) -> (String, bool) {
    let output = project.maquette(&[&["inspect", "doll.ron", node], more].concat());
    let words = [output.stdout, output.stderr].concat();
    (String::from_utf8(words).unwrap(), output.status.success())
}

fn rows(document: &Json) -> Vec<f64> {
    let rows = document["rows"].as_array().unwrap().iter();
    rows.flat_map(|row| row.as_array().unwrap()).map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn faces_are_chosen_sorted_and_summed_up() {
    let project = project();
    let asked = ["--table", "faces", "--where", "area > 1.5", "--sort", "-area", "--columns"];
    let (text, is_known) =
        inspect(&project, "mesh.mesh", &[&asked[..], &["index,area,x"]].concat());
    assert!(is_known, "{text}");
    let lines =
        text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>()).collect::<Vec<_>>();
    assert_eq!(
        lines[1..4],
        [vec!["index", "area", "x"], vec!["1", "8", "11.3333"], vec!["0", "2", "0.666667"]]
    );
    assert_eq!(
        lines[4..7],
        [
            ["least", "0", "2", "0.666667"],
            ["greatest", "1", "8", "11.3333"],
            ["mean", "0.5", "5", "6"]
        ]
    );
    assert_eq!(text.lines().last(), Some("  2 of 3 faces"));
    let (limited, _) = inspect(&project, "mesh", &["--table", "faces", "--limit", "1"]);
    assert!(
        limited.ends_with("3 of 3 faces, 2 of them not shown; use --limit 0 to show all\n"),
        "{limited}"
    );
}

#[test]
fn csv_and_json_have_every_row_and_digit() {
    let project = project();
    let edges = ["--table", "edges", "--where", "length == 4", "--columns", "from,to,length"];
    let (csv, _) = inspect(&project, "mesh", &[&edges[..], &["--csv", "-"]].concat());
    assert_eq!(csv, "from,to,length\n3,4,4\n3,5,4\n");
    let (nothing, is_known) =
        inspect(&project, "mesh", &[&edges[..], &["--csv", "edges.csv"]].concat());
    assert!(is_known, "{nothing}");
    assert_eq!(std::fs::read_to_string(project.folder().join("edges.csv")).unwrap(), csv);
    let asked =
        ["--table", "vertices", "--where", "x >= 10 and x < 14", "--columns", "x,y", "--json"];
    let (json, _) = inspect(&project, "mesh", &asked);
    let document: Json = serde_json::from_str(&json).unwrap();
    assert_eq!((&document["on"], &document["found"]), (&"vertex".into(), &2.into()), "{json}");
    assert_eq!(rows(&document), [10.0, 0.0, 10.0, 4.0]);
    assert_eq!(document["columns"][1]["greatest"], 4.0);
    let (refused, is_known) = inspect(&project, "mesh", &["--table", "faces", "--csv", "quad.obj"]);
    assert!(!is_known && refused.contains("quad.obj"), "what the graph reads is kept: {refused}");
}

#[test]
fn any_value_has_rows() {
    let project = project();
    let asked = ["--table", "cells", "--where", "inside == 1", "--columns", "column,row", "--json"];
    let document: Json = serde_json::from_str(&inspect(&project, "red", &asked).0).unwrap();
    assert_eq!((&document["found"], &document["count"]), (&2427.into(), &160_000.into()));
    let asked = ["--table", "vertices", "--sort", "gaussian", "--limit", "2"];
    assert!(inspect(&project, "curved", &asked).0.contains("direction1_x"));
    assert!(inspect(&project, "mesh", &["--table", "corners"]).0.contains("9 of 9 corners"));
}

#[test]
fn unknown_names_get_guesses() {
    let project = project();
    fn wrong(more: &[&str], project: &Project) -> String {
        let (text, is_known) = inspect(project, "mesh", more);
        assert!(!is_known, "{text}");
        text
    }
    assert_eq!(
        wrong(&["--table", "fcaes"], &project),
        "error: the value has no fcaes; did you mean `faces`?\n"
    );
    assert_eq!(
        wrong(&["--table", "pixels"], &project),
        "error: the value has no pixels; there are: vertices, faces, edges, corners\n"
    );
    let none = "error: there is no column `aera` of faces; did you mean `area`?\n";
    assert_eq!(wrong(&["--table", "faces", "--sort", "-aera"], &project), none);
    assert_eq!(wrong(&["--table", "faces", "--columns", "aera"], &project), none);
    assert_eq!(wrong(&["--table", "faces", "--where", "aera > 1"], &project), none);
    assert_eq!(
        wrong(&["--table", "faces", "--where", "area"], &project),
        "error: `area` is a number, not a condition\n"
    );
    assert!(
        wrong(&["--table", "--sort", "area"], &project)
            .contains("expected a kind of elements: --table vertices")
    );
}
