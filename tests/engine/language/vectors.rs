//! A name before a vector must be a unit: `cm(1, 2, 3)` is (10, 20, 30) in a field in millimeters. Any other name is an error.

use std::path::Path;

use maquette::value::Points;
use maquette::{Catalog, Edit, Graph, Options, Run, Session, Settings, Targets};
use maquette_nodes::PACKS;

/// Returns a graph that moves a point by the vector `by`.
fn graph(by: &str, rest: &str) -> String {
    format!(
        r#"Graph(
    format: 1,
    params: {{ "by": Vector(default: cm(4, 5, 6), min: -500.0, max: 500.0, unit: "mm") }},
    nodes: {{
        "point": ReadPoints(path: "point.xyz"),
        "moved": Transform(mesh: "point", translate: {by}),
        {rest}
    }},
    outputs: {{ "moved.xyz": "moved" }},
)"#
    )
}

/// Returns the point that a node computes, or the errors of the graph.
fn evaluate_point(text: &str, node: &str, set: &[(&str, &str)]) -> Result<[f64; 3], Vec<String>> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("point.xyz"), "1 0 0\n").unwrap();
    let set = set.iter().map(|&(name, value)| (name.to_owned(), value.to_owned())).collect();
    let options = Options { set, ..Options::default() };
    let path = folder.path().join("graph.ron");
    let checked = Graph::load_text(&path, text.to_owned(), &Catalog::new(PACKS), &options);
    fn message(problem: &maquette::Diagnostic) -> String {
        problem.message.clone()
    }
    let graph =
        checked.graph.ok_or_else(|| checked.diagnostics.iter().map(message).collect::<Vec<_>>())?;
    let mut session = Session::new(PACKS, &Settings::in_memory()).unwrap();
    let run = session.run(&graph, &Run { targets: Targets::Everything, ..Run::default() });
    let run = run.unwrap_or_else(|problems| panic!("{problems:?}"));
    let wrong = run.diagnostics();
    if !wrong.is_empty() {
        return Err(wrong.iter().map(message).collect::<Vec<_>>());
    }
    let point = run.get::<Points>(node).unwrap().positions()[0];
    Ok([point.x, point.y, point.z])
}

#[test]
fn the_unit_before_a_vector_is_that_of_each_of_its_numbers() {
    assert_eq!(evaluate_point(&graph("cm(1, 2, 3)", ""), "moved", &[]), Ok([11.0, 20.0, 30.0]));
    assert_eq!(evaluate_point(&graph("Param(\"by\")", ""), "moved", &[]), Ok([41.0, 50.0, 60.0]));
    let set = [("by", "inch(1, 0, 0)")];
    assert_eq!(evaluate_point(&graph("Param(\"by\")", ""), "moved", &set), Ok([26.4, 0.0, 0.0]));
    let set = [("moved.translate", "cm(4, 5, 6)")];
    assert_eq!(evaluate_point(&graph("(0, 0, 0)", ""), "moved", &set), Ok([41.0, 50.0, 60.0]));
    // A plain number for one component is in the unit of the field, whatever the unit of the whole vector is.
    for (value, moved) in [("4", 4.0), ("mm(4)", 4.0), ("cm(4)", 40.0), ("inch(1)", 25.4)] {
        let set = [("moved.translate.1", value)];
        assert_eq!(
            evaluate_point(&graph("cm(1, 0, 2)", ""), "moved", &set),
            Ok([11.0, moved, 20.0]),
            "{value}"
        );
        let edits = [Edit::Set { target: "moved.translate.1".into(), value: value.into() }];
        let (path, options) = (Path::new("graph.ron"), Options::default());
        let text = graph("cm(1, 0, 2)", "");
        let edited =
            maquette::edit::edit(path, &text, &edits, &Catalog::new(PACKS), &options).unwrap().text;
        assert_eq!(evaluate_point(&edited, "moved", &[]), Ok([11.0, moved, 20.0]), "{edited}");
    }
    let each = r#""each": ForEach(graph: "Transform", over: [(translate: m(1, 0, 0))], links: (mesh: "point")),"#;
    assert_eq!(evaluate_point(&graph("(0, 0, 0)", each), "each/1", &[]), Ok([1001.0, 0.0, 0.0]));
    let both = "Draft(final: cm(1, 0, 0), draft: cm(2, 0, 0))";
    assert_eq!(evaluate_point(&graph(both, ""), "moved", &[]), Ok([11.0, 0.0, 0.0]));
}

#[test]
fn a_box_that_is_expected_may_have_a_unit() {
    fn evaluate_expecting(high: &str) -> Result<[f64; 3], Vec<String>> {
        let expect = format!("expect: [Bounds(of: \"moved\", low: cm(0, 0, 0), high: {high})],");
        evaluate_point(
            &graph("(0, 0, 0)", "").replace("outputs:", &format!("{expect}\n    outputs:")),
            "moved",
            &[],
        )
    }
    assert_eq!(evaluate_expecting("cm(0.2, 1, 1)"), Ok([1.0, 0.0, 0.0]));
    assert!(evaluate_expecting("cm(0.05, 1, 1)").is_err());
}

#[test]
fn set_keeps_the_unit_as_it_is_given() {
    let text = graph("(0, 0, 0)", "");
    let (target, value) = ("moved.translate".to_owned(), "cm(1, 2, 3)".to_owned());
    let edits = [Edit::Set { target, value }];
    let options = Options::default();
    let edited =
        maquette::edit::edit(Path::new("graph.ron"), &text, &edits, &Catalog::new(PACKS), &options);
    assert_eq!(edited.unwrap().text, graph("cm(1, 2, 3)", ""));
}
