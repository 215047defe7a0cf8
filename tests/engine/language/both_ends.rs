//! A type error shows both ends of the link: the port that is linked, and the output from which the value comes.

use std::path::Path;

use maquette::{Catalog, Diagnostic, Graph, Options, Position};
use maquette_nodes::PACKS;

fn problems(path: &Path) -> Vec<Diagnostic> {
    Graph::load(path, &Catalog::new(PACKS), &Options::default()).diagnostics
}

fn bad() -> Vec<Diagnostic> {
    problems(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/bad/both-ends.ron"))
}

#[test]
fn each_misfit_names_the_place_of_what_gives_the_value() {
    let found = bad().into_iter().map(|problem| {
        fn line(at: usize, problem_source: &std::sync::Arc<maquette::Source>) -> usize {
            Position::from_offset(&problem_source.text, at).line
        }
        let (span, words) = problem.note.clone().unwrap_or_else(|| panic!("{}", problem.message));
        let there = problem.source.text[span.start..span.end].to_owned();
        (line(problem.span.start, &problem.source), line(span.start, &problem.source), there, words)
    });
    fn entry(a: usize, b: usize, name: &str, words: &str) -> (usize, usize, String, String) {
        (a, b, format!("\"{name}\""), words.to_owned())
    }
    assert_eq!(
        Vec::from_iter(found),
        [
            entry(9, 5, "ball", "this gives a Mesh"),
            entry(10, 6, "points", "this gives a Points"),
            entry(11, 6, "points", "this gives a Points"),
            entry(12, 7, "copies", "this gives a Mesh"),
            entry(13, 7, "copies", "this gives the list"),
            entry(14, 8, "none", "this gives the list"),
        ]
    );
}

#[test]
fn the_text_marks_both_and_json_has_a_place_of_its_own() {
    let problem = &bad()[0];
    let text = problem.to_text(false);
    assert!(text.contains("5 |         \"ball\": ReadMesh"), "{text}");
    assert!(text.contains("------ this gives a Mesh"), "{text}");
    assert!(text.contains("9 |         \"label\": Label(mask: \"ball\")"), "{text}");
    let note = &problem.to_json()["note"];
    assert_eq!(note["message"], "this gives a Mesh");
    assert_eq!([&note["line"], &note["column"], &note["end_column"]], [5, 9, 15]);
    assert_eq!(note["file"], problem.to_json()["file"]);
}

#[test]
fn what_is_far_away_is_shown_in_a_part_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(folder.path().join("ball.obj"), "").unwrap();
    let between = "        // Far away.\n".repeat(400);
    let text = format!(
        "Graph(\n    format: 1,\n    nodes: {{\n        \"ball\": ReadMesh(path: \"ball.obj\"),\n{between}        \"label\": Label(mask: \"ball\"),\n    }},\n    outputs: {{}},\n)\n"
    );
    std::fs::write(&path, text).unwrap();
    let text = problems(&path)[0].to_text(false);
    assert!(text.contains("\"label\": Label(mask: \"ball\")") && text.contains("^^^^^^"), "{text}");
    assert!(text.contains("this gives a Mesh") && text.contains("\"ball\": ReadMesh"), "{text}");
}

#[test]
fn an_end_in_another_file_is_told_in_words() {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write("ball.obj", "", &folder);
    write(
        "whole.ron",
        "Graph(format: 1, nodes: {\n\"ball\": ReadMesh(path: \"ball.obj\"), \"out\": Transform(mesh: \"ball\")}, outputs: {\"a.ply\": \"out\"})",
        &folder,
    );
    write(
        "patch.ron",
        "Patch(format: 1, of: \"whole.ron\", nodes: {\"out\": (mesh: \"ball.mesh\")})",
        &folder,
    );
    assert_eq!(problems(&folder.path().join("patch.ron")), []);
    write("points.xyz", "0 0 0\n", &folder);
    let whole = std::fs::read_to_string(folder.path().join("whole.ron")).unwrap();
    write(
        "whole.ron",
        &whole.replace("\"out\"", "\"mask\": Foreground(range: \"out\"), \"out\""),
        &folder,
    );
    write(
        "whole.ron",
        "Graph(format: 1, nodes: {\n\"ball\": ReadMesh(path: \"ball.obj\"), \"dots\": ReadPoints(path: \"points.xyz\"), \"out\": Subdivide(mesh: \"ball\", scheme: Loop)}, outputs: {\"a.ply\": \"out\", \"b.ply\": \"dots\"})",
        &folder,
    );
    write(
        "patch.ron",
        "Patch(format: 1, of: \"whole.ron\", nodes: {\"out\": (mesh: \"dots\")})",
        &folder,
    );
    let found = problems(&folder.path().join("patch.ron"));
    assert_eq!(found[0].code, "G012", "{found:?}");
    assert!(found[0].source.name.ends_with("patch.ron"), "{found:?}");
    assert!(
        found[0].help.contains("this gives a Points: ") && found[0].help.contains("whole.ron:2:"),
        "{}",
        found[0].help
    );
}
