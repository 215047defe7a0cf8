//! Control characters and markup in texts from files do not reach the terminal or the browser.

use super::project::Project;
use crate::output::text_of;

#[test]
fn nothing_that_is_printed_talks_to_the_terminal() {
    let project = Project::new();
    project.write(
        "mesh.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float \u{1b}[31mred\u{9b}2J\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n",
    );
    project.write(
        "part.ron",
        "Graph(format: 1, doc: \"A \u{1b}]0;title\u{7}part.\", inputs: {\"mesh\": Mesh}, nodes: {\"moved\": Transform(mesh: \"mesh\")}, outputs: {\"moved\": \"moved\"})",
    );
    project.write(
        "bad.ron",
        "Graph(format: 1, use: {\"Part\": \"part.ron\"}, nodes: {\"m\": ReadMesh(path: \"mesh.ply\"), \"p\": Part(mesh: \"m\")}, outputs: {\"a\u{1b}[2J.ply\": \"p\", \"\u{1b}[2J\": \"\u{1b}[31m\", \"b.ply\": \"m\"})",
    );
    project.write(
        "good.ron",
        &project
            .read("bad.ron")
            .replace("\"a\u{1b}[2J.ply\": \"p\", \"\u{1b}[2J\": \"\u{1b}[31m\", ", ""),
    );
    project.write(
        "bad.test.ron",
        "Test(graph: \"good.ron\", cases: {\"\u{1b}[2J\": ()}, expect: [Closed(\"\u{1b}[2J\")])",
    );
    project.write(
        "skip.test.ron",
        "Test(graph: \"good.ron\", cases: {\"a\": (skip: \"\u{1b}[2Jlater\")})",
    );
    for arguments in [
        &["run", "bad.ron"][..],
        &["run", "good.ron"],
        &["inspect", "good.ron", "m"],
        &["nodes", "good.ron"],
        &["test"],
        &["inspect", "good.ron", "m", "--json"],
        &["test", "--json"],
        &["run", "bad.ron", "--json"],
        &["run", "bad.ron", "--events"],
        &["why", "good.ron", "\u{1b}[2J"],
        &["run", "\u{1b}[2J.ron"],
        &["check", "bad.ron"],
        &["render", "gallery", "\u{1b}[2J"],
        &["diff", "good.ron", "bad.ron"],
    ] {
        let output = project.maquette(arguments);
        let found = text_of(&output).chars().find(|c| c.is_control() && *c != '\n');
        assert_eq!(found, None, "{arguments:?}: {:?}", text_of(&output));
    }
    let inspected = project.maquette(&["inspect", "good.ron", "m"]);
    assert!(text_of(&inspected).contains("␛[31mred"), "{}", text_of(&inspected));
}

#[test]
fn texts_go_out_as_they_are() {
    let project = Project::new();
    let text = "// \u{1b}[1m\tbold\nGraph(format: 1, nodes: {}, outputs: {})\n";
    project.write("bold.ron", text);
    let output = project.maquette(&["edit", "bold.ron", "set", "--dry-run", "a=1"]);
    assert_ne!(output.status.code(), Some(0));
    project.write(
        "bold.ron",
        &text.replace("format: 1,", "format: 1, params: {\"a\": Number(default: 2.0)},"),
    );
    let output = project.maquette(&["edit", "bold.ron", "set", "--dry-run", "a=1"]);
    assert!(text_of(&output).starts_with("// \u{1b}[1m\tbold\n"), "{}", text_of(&output));
}

#[test]
fn a_gallery_takes_no_markup_from_a_graph() {
    let project = Project::new();
    let doc = "doc: \"It <script>alert(1)</script> shines.\", params: {\"a\": Number(default: 1.0, doc: \"<img src=x>\")},";
    project.write("net.ron", &super::GRAPH.replace("format: 1,", &format!("format: 1, {doc}")));
    let output = project.maquette(&["render", "gallery", "."]);
    assert!(output.status.success(), "{}", text_of(&output));
    let page = project.read("README.md");
    assert!(
        page.contains("It &lt;script>alert(1)&lt;/script> shines.") && page.contains("&lt;img"),
        "{page}"
    );
    assert!(!page.contains("<script") && !page.contains("<img"), "{page}");
}
