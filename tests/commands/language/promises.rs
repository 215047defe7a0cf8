//! Values may lack properties that a port requires (`wants`). These properties are listed, and the violating elements are marked in
//! pictures.

use maquette::format::png;
use maquette::value::Image;
use serde_json::{Value as Json, json};

use crate::output::{stderr_of, stdout_of};
use crate::project::Project;

/// Returns the number of pixels that have the red color of the marks.
fn red(picture: &Image) -> usize {
    picture.pixels().iter().filter(|[r, g, b]| 120 < *r && *g < r / 3 && *b < r / 3).count()
}

#[test]
fn inspect_lists_and_marks_the_elements() {
    let project = Project::with_a_hole();
    fn picture(project: &Project) -> Image {
        png::read(&std::fs::read(project.folder().join("open.png")).unwrap()).unwrap()
    }
    let done = project.maquette(&["inspect", "doll.ron", "open", "--out", "open.png"]);
    let text = stdout_of(&done);
    let expected = "  is not Closed, as required by input `skin` of `whole`: it has 3 edges with one face (edge 0-2, edge 0-3, edge 2-3; \
                    the first is at (0, 0.5, 0))\n    edge 0-2  (0, 0.5, 0)\n    edge 0-3  (0, 0, 0.5)\n    edge 2-3  (0, 0.5, 0.5)\n";
    assert!(text.ends_with(expected), "{text}");
    assert!(1000 < red(&picture(&project)), "{}", red(&picture(&project)));
    let json = project.maquette(&["inspect", "doll.ron", "open", "--json"]).stdout;
    let json: Json = serde_json::from_slice(&json).unwrap();
    let broken = &json["outputs"][0]["broken"][0];
    assert_eq!((&broken["property"], &broken["count"]), (&"Closed".into(), &3.into()));
    assert_eq!(broken["elements"][2]["name"], "edge 2-3");
    // `run --json` also reports the violating elements as data.
    let json = project.maquette(&["run", "doll.ron", "--json"]).stdout;
    let json: Json = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["problems"][0]["elements"][1]["at"], json!([0.0, 0.0, 0.5]));
    // If no port requires the property, nothing is marked in the picture.
    project.save(
        &std::fs::read_to_string(project.graph()).unwrap().replace("Lib(skin", "Transform(mesh"),
    );
    project.maquette(&["inspect", "doll.ron", "open", "--view", "0,0", "--out", "open.png"]);
    assert_eq!(red(&picture(&project)), 0);
}

#[test]
fn the_command_that_shows_the_elements_has_the_values_of_the_run() {
    let project = Project::with_a_hole();
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let text = text
        .replace("    nodes:", "    params: { \"file\": Text(default: \"a b.obj\") },\n    nodes:");
    project.save(&text.replace("path: \"open.obj\"", "path: Param(\"file\")"));
    let folder = project.folder();
    std::fs::copy(folder.join("open.obj"), folder.join("an open one.obj")).unwrap();
    let run = project.maquette(&["run", "doll.ron", "--set", "file=an open one.obj"]);
    let told = stderr_of(&run);
    let command = "`maquette inspect doll.ron open --set 'file=an open one.obj' --out look.png`";
    assert!(told.contains(command), "{told}");
}
