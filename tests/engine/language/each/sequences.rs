//! Random sequences of data with changing numbers of elements. A session that keeps earlier results must give the same results as a new
//! session.

use maquette::value::Points;
use maquette::{AnyValue, Graph, Run, Session, Settings, State};
use proptest::prelude::*;

use super::{Folder, PACK, messages, session, spots};

/// A graph with several `ForEach` loops: over labels, over the result of another loop, and inside of another loop. One loop passes a value
/// from element to element, and one passes the number of the element to its graph.
const GRAPH: &str = r#"use: { "Grow": "grow.ron" }, inputs: { "labels": Labels() },
    nodes: {
        "spots": ForEach(graph: "Center", over: "labels", number: "rank"),
        "cloud": Collect(points: "spots"),
        "start": Along(at: 7),
        "sum": ForEach(graph: "Add", over: "cloud", each: "point", carry: (sum: "start")),
        "grown": ForEach(graph: "Grow", over: "cloud", each: "point", links: (others: "sum"), most: 5),
        "all": Collect(points: "grown"),
        "second": Collect(points: "spots/2"),
    },
    outputs: { "sum": "sum", "all": "all", "second": "second" }"#;

const GROW: &str = r#"inputs: { "point": Points(), "others": Points() },
    nodes: {
        "inner": ForEach(graph: "Collect", over: "others", each: "points"),
        "all": Collect(points: ["point", "inner"]),
    },
    outputs: { "points": "all" }"#;

/// Runs a graph. Returns the values of its outputs, and the messages.
fn run_with_labels(
    session: &mut Session,
    graph: &Graph,
    labels: AnyValue,
) -> (Vec<Option<Points>>, Vec<String>) {
    let inputs = [("labels".to_owned(), labels)].into();
    let found = session.run(graph, &Run { inputs, ..Run::default() }).unwrap();
    let values = ["sum", "all", "second"].map(|name| found.get::<Points>(name).ok().cloned());
    let skipped = found.trace().0.iter().filter(|node| node.state == State::Skipped).count();
    assert!(skipped == 0 || !messages(&found).is_empty(), "something is skipped for no reason");
    (values.into(), messages(&found))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn loops_over_data_that_come_and_go_are_remembered_truly(
        steps in prop::collection::vec((prop::collection::vec(1u32..4, 0..8), 0u8..8), 1..8)
    ) {
        let folder = Folder::new();
        folder.put("grow.ron", GROW);
        folder.put("graph.ron", GRAPH);
        let cache = folder.0.path().join("cache");
        let kept = || {
            let cache = maquette::CacheFolder::At(cache.clone());
            Session::new(&[&maquette::format::PACK, &PACK], &Settings { threads: 2, cache, ..Settings::in_memory() }).unwrap()
        };
        let mut remembering = session();
        let graph = folder.load();
        for (widths, event) in steps {
            match event {
                0 => remembering = kept(),
                1 => remembering.forget(),
                2 => drop(remembering.explain(&graph, "all")),
                _ => {}
            }
            let now = run_with_labels(&mut remembering, &graph, spots(&widths));
            let truth = run_with_labels(&mut session(), &graph, spots(&widths));
            prop_assert_eq!(now, truth);
            remembering.finish();
        }
    }
}
