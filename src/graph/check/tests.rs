//! Tests that checking a file with many errors takes time proportional to the size of the file.

use std::path::Path;

use maquette_syntax::COMPARISONS;

use crate::Options;
use crate::catalog::Catalog;
use crate::load::load_text;

/// Checks a text without built-in nodes. Returns the number of diagnostics, and the number of names that were compared to find suggestions.
fn diagnostics(text: String) -> (usize, usize) {
    let catalog = Catalog::new(&[]);
    COMPARISONS.set(0);
    let checked = load_text(Path::new("graph.ron"), text, &catalog, &Options::default());
    (checked.diagnostics.len(), COMPARISONS.get())
}

fn graph(params: &str, nodes: &str, outputs: &str) -> String {
    format!("Graph(format: 1, params: {{{params}}}, nodes: {{{nodes}}}, outputs: {{{outputs}}})")
}

/// Checks that a text with four times as many errors and names takes at most four times as many comparisons.
fn check_growth(text: impl Fn(usize) -> String) {
    let [(few, little), (many, much)] = [300, 1200].map(|count| diagnostics(text(count)));
    assert!(few >= 300 && many >= 1200, "{few} and {many} problems");
    assert!(0 < little && much <= 4 * little + 1000, "{little} and {much} comparisons");
}

#[test]
fn ten_times_as_many_broken_links_take_ten_times_as_long() {
    fn switch(k: usize, link: String) -> String {
        format!("\"n{k}\": Switch(cases: {{\"a\": \"{link}\"}}, choose: a),")
    }
    check_growth(|count| {
        let broken = (0..count).map(|k| switch(k, format!("nn{k}")));
        graph("", &String::from_iter(broken), "")
    });
    check_growth(|count| {
        let links = (0..count).map(|k| format!("\"f{k}.ply\": \"nn{k}\","));
        let good = (0..count).map(|k| switch(k, format!("n{}", k + 1)));
        graph("", &String::from_iter(good), &String::from_iter(links))
    });
}

#[test]
fn ten_times_as_many_unknown_parameters_take_ten_times_as_long() {
    for wrong in ["Param(\"pp", "Expr(\"1 + pp"] {
        check_growth(|count| {
            let params = (0..count).map(|k| format!("\"p{k}\": Number(default: 1.0),"));
            let nodes = (0..count).map(|k| {
                format!("\"n{k}\": Switch(cases: {{\"1\": \"n\"}}, choose: {wrong}{k}\")),")
            });
            graph(&String::from_iter(params), &String::from_iter(nodes), "")
        });
    }
}

#[test]
fn the_first_errors_of_many_get_a_guess() {
    let nodes = "\"scan\": Switch(cases: {\"a\": \"scn\"}, choose: a),";
    let catalog = Catalog::new(&[]);
    let text = graph("", nodes, "");
    let checked = load_text(Path::new("graph.ron"), text, &catalog, &Options::default());
    assert_eq!(checked.diagnostics[0].help, "did you mean `scan`?");
}
