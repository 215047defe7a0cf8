//! The exact texts of messages that were once misleading.

use crate::project::Project;

/// Runs a command for a graph and returns its output (stdout and stderr).
fn check_text(text: &str, arguments: &[&str]) -> String {
    let project = Project::new(text);
    let used =
        "Graph(format: 1, nodes: { \"n\": PointNet(points: []) }, outputs: { \"n.ply\": \"n\" })";
    std::fs::write(project.folder().join("files.ron"), used).unwrap();
    let output = project.maquette(arguments);
    String::from_utf8([output.stdout, output.stderr].concat()).unwrap()
}

/// Returns a graph of a net, with these additional nodes and outputs.
fn graph(nodes: &str, outputs: &str) -> String {
    let net = "\"net\": PointNet(points: [[(0, 0, 0), (1, 0, 1)], [(0, 1, 1), (1, 1, 2)]]), \"s\": Nurbs(net: \"net\"), \"m\": Tessellate(surface: \"s\")";
    format!("Graph(format: 1, nodes: {{ {net}, {nodes} }}, outputs: {{ {outputs} }})")
}

#[test]
fn elements_are_set_in_their_list_or_all_at_once() {
    let list = graph(
        "\"c\": ForEach(graph: \"Transform\", over: [(), ()], with: (mesh: \"m\"))",
        "\"1.ply\": \"c/1\"",
    );
    let told = check_text(&list, &["edit", "doll.ron", "set", "c/1.scale=(2, 2, 2)"]);
    assert_eq!(told, "c.over.0.scale: left out -> (2, 2, 2)\n");
    let told = check_text(&list, &["edit", "doll.ron", "set", "c.over.0.scale=(2, 2, 2)"]);
    assert!(!told.contains("error"), "{told}");
    let told = check_text(&list, &["edit", "doll.ron", "set", "c/3.scale=(2, 2, 2)"]);
    assert!(told.contains("`c/1` to `c/2`"), "{told}");
    let parts =
        graph("\"c\": ForEach(graph: \"Transform\", over: Parts(\"m\"))", "\"1.ply\": \"c/1\"");
    let told = check_text(&parts, &["check", "doll.ron", "--set", "c/1.scale=(2, 2, 2)"]);
    assert!(told.contains("--set c.with.field=VALUE"), "{told}");
    let told = check_text(&parts, &["check", "doll.ron", "--set", "c.with.scale=(2, 2, 2)"]);
    assert!(told.ends_with("0 errors\n"), "{told}");
    let told = check_text(&parts, &["edit", "doll.ron", "set", "c/1.scale=(2, 2, 2)"]);
    assert!(told.contains("c.with.scale=VALUE"), "{told}");
    // An invalid path to an element of a `ForEach` causes only one error.
    let told = check_text(&list, &["check", "doll.ron", "--set", "c.1.scale=(2, 2, 2)"]);
    assert_eq!(told.matches("error[").count(), 1, "{told}");
}

#[test]
fn a_wrong_parameter_is_not_to_be_written_as_one() {
    let text = "Graph(format: 1, params: { \"x\": Text(default: \"hi\") }, nodes: { \"n\": PointNet(points: [[(Param(\"x\"), 0, 0)]]) }, outputs: { \"n.ply\": \"n\" })";
    let told = check_text(text, &["check", "doll.ron"]);
    assert!(told.contains("found the text \"hi\"") && !told.contains("write Param"), "{told}");
    let told = check_text(&text.replace("Param(\"x\")", "\"x\""), &["check", "doll.ron"]);
    assert!(told.contains("write Param(\"x\")"), "{told}");
}

#[test]
fn a_port_for_several_types_names_them() {
    let told = check_text(&graph("\"b\": Transform()", "\"b.ply\": \"b\""), &["check", "doll.ron"]);
    assert!(told.contains("a node that gives a Mesh or ") && !told.contains("Movable"), "{told}");
}

#[test]
fn numbers_are_told_with_units_and_in_few_digits() {
    let text = "Graph(format: 1, params: { \"s\": Number(default: inch(1), max: cm(2), unit: \"mm\") }, nodes: {}, outputs: {})";
    let told = check_text(text, &["check", "doll.ron"]);
    assert!(told.contains("`s` is 25.4 mm, but must be at most 20 mm"), "{told}");
    let far =
        graph("\"b\": Transform(mesh: \"m\", translate: (m(1e307), 0, 0))", "\"b.ply\": \"b\"");
    let told = check_text(&far, &["check", "doll.ron"]);
    assert!(told.contains("`m(1e307)` is too large for a number of mm"), "{told}");
}

#[test]
fn an_output_that_lies_outside_is_refused_once() {
    let told = check_text(
        &graph("\"b\": Transform(mesh: \"m\")", "\"b.ply\": \"b\""),
        &["edit", "doll.ron", "output", "../m.ply", "b"],
    );
    assert_eq!(told.matches("error[").count(), 1, "{told}");
}

#[test]
fn a_choice_without_values_takes_no_parentheses() {
    let told = check_text(
        &graph("\"b\": Subdivide(mesh: \"m\", scheme: CatmullClark())", "\"b.ply\": \"b\""),
        &["check", "doll.ron"],
    );
    assert!(
        told.contains("field `scheme` of Subdivide: expected `CatmullClark` without parentheses"),
        "{told}"
    );
    assert_eq!(told.matches("error[").count(), 1, "{told}");
}

#[test]
fn a_number_of_elements_that_no_machine_counts_is_told_as_it_is() {
    let nodes = "\"c\": ForEach(graph: \"Transform\", over: 1e23, links: (mesh: \"m\"))";
    let told = check_text(&graph(nodes, "\"1.ply\": \"c/1\""), &["check", "doll.ron"]);
    let words = "field `over` of ForEach: expected a number of elements, found as many as 1e23";
    assert!(told.contains(words) && !told.contains("18446744073709551615"), "{told}");
}
