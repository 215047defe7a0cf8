//! Law 8: a node whose numbers are at the ends of their ranges finishes, fails, or stops soon after cancellation.

use std::sync::mpsc;
use std::time::Duration;

use maquette_graph::Graph;
use maquette_graph::catalog::Entry;
use maquette_node::{CancelToken, Progress};
use maquette_value::AnyValue;
use maquette_value::rng::Random;
use serde_json::Value as Json;

use super::evaluation::{EdgeCases, Values, inputs, run_node};
use super::scalars::Scalars;

/// A node in its example graph, with the input values that it has in the example.
pub(super) struct Case<'a> {
    pub(super) entry: &'a Entry,
    pub graph: &'a Graph,
    pub(super) index: usize,
    pub(super) values: &'a Values,
    pub(super) edge_cases: &'a EdgeCases,
}

/// The time after which a running node is cancelled.
const RUN_TIME: Duration = Duration::from_millis(200);

/// The time that a node gets to stop after it was cancelled. It is much longer than the 50 ms between two checks for cancellation, because
/// the machine may be busy.
const STOP_TIMEOUT: Duration = Duration::from_secs(60);

/// The number of tests that combine random extreme numbers and edge cases.
const RANDOM_COMBINATIONS: usize = 12;

/// A number among a node's parameters: its path, and the values at the ends of its range, as RON.
type Ends = (String, Vec<String>);

/// Checks law 8 for a node. `load` loads the example of the node with the given parameters.
pub(super) fn check(
    case: &Case<'_>,
    load: &dyn Fn(Vec<(String, String)>) -> Option<Graph>,
    broken: &mut Vec<String>,
) {
    let node = &case.graph.nodes()[case.index];
    let Some(good) = inputs(node, case.values) else { return };
    let numbers = numbers(&node.recipe.parameters, case.entry.schema());
    let mut run_with = |set: &[(String, String)], inputs: Vec<AnyValue>| {
        let paths = set.iter().map(|(path, to)| (format!("{}.{path}", node.name), to.clone()));
        let Some(graph) = load(paths.collect()) else { return };
        if let Err(why) = run(graph, &node.name, inputs) {
            let set: Vec<_> = set.iter().map(|(path, to)| format!("{path}: {to}")).collect();
            broken.push(format!("{} with {}: {why}", case.entry.name, set.join(", ")));
        }
    };
    for (path, ends) in &numbers {
        ends.iter().for_each(|to| run_with(&[(path.clone(), to.clone())], good.clone()));
    }
    let ports = case.entry.ports();
    let mut dice = Random(0);
    for _ in 0..RANDOM_COMBINATIONS {
        let mut set = Vec::new();
        for (path, ends) in &numbers {
            if let Some(to) = ends.get(dice.next_below(ends.len() + 1)) {
                set.push((path.clone(), to.clone()));
            }
        }
        let mut inputs = good.clone();
        for (input, link) in inputs.iter_mut().zip(&node.links) {
            let port = ports.iter().find(|port| port.name == link.port);
            let kinds = port.iter().flat_map(|port| &port.types);
            let mut hostile: Vec<_> = kinds.flat_map(|kind| case.edge_cases.values(kind)).collect();
            let chosen = dice.next_below(2 * hostile.len() + 1);
            if chosen < hostile.len() {
                *input = hostile.swap_remove(chosen);
            }
        }
        run_with(&set, inputs);
    }
}

/// Runs a node on a separate thread, and cancels it after [`RUN_TIME`]. Returns an error if the node panics or does not stop.
fn run(graph: Graph, name: &str, inputs: Vec<AnyValue>) -> Result<(), String> {
    let (send, receive) = mpsc::channel();
    let cancel = CancelToken::default();
    let (token, name) = (cancel.clone(), name.to_owned());
    std::thread::spawn(move || {
        let Some(index) = graph.find(&name) else { return };
        let progress = Progress { report: None, cancel: Some(&token) };
        // Give the node its own thread pool. In a shared pool its loops would have to wait while other nodes keep all threads busy.
        let own = rayon::ThreadPoolBuilder::new().build().map_err(|error| error.to_string());
        // Ignore an error: sending fails if the receiver has stopped waiting.
        let _ =
            send.send(own.and_then(|own| {
                own.install(|| run_node(&graph.nodes()[index], &inputs, progress))
            }));
    });
    let ended = receive.recv_timeout(RUN_TIME).or_else(|_| {
        cancel.cancel();
        receive.recv_timeout(STOP_TIMEOUT)
    });
    ended.unwrap_or_else(|_| Err(format!("{STOP_TIMEOUT:?} after cancellation it still runs")))
}

/// Returns all numbers among the parameters. Each has the values at the ends of its range.
fn numbers(parameters: &Json, schema: &Json) -> Vec<Ends> {
    let mut numbers = Vec::new();
    let scalars = Scalars { schema, max_items: usize::MAX };
    scalars.visit(parameters, &mut |path, value, schema| {
        if value.is_number() {
            numbers.push((path.to_owned(), ends(schema)));
        }
    });
    numbers
}

/// Returns the smallest and the largest number that a JSON schema allows, or a very large one where there is no limit. For real numbers,
/// also returns a very small one.
fn ends(schema: &Json) -> Vec<String> {
    let is_whole = schema.get("type").and_then(Json::as_str) == Some("integer");
    fn limit(name: &str, schema: &Json) -> Option<f64> {
        schema.get(name).and_then(Json::as_f64)
    }
    let (least, most) = (limit("minimum", schema), limit("maximum", schema));
    let ends = match is_whole {
        true => vec![least.unwrap_or(0.0), most.unwrap_or(f64::from(u32::MAX))],
        false => vec![least.unwrap_or(-1e300), 1e-9, most.unwrap_or(1e300)],
    };
    fn is_allowed(x: &f64, least: &Option<f64>) -> bool {
        least.is_none_or(|least| least <= *x)
    }
    ends.into_iter()
        .filter(|x| is_allowed(x, &least) && most.is_none_or(|most| *x <= most))
        .map(|x| if is_whole { x.to_string() } else { format!("{x:e}") })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_at_the_ends_of_their_range_or_very_large() {
        let whole = serde_json::json!({ "type": "integer", "minimum": 3, "maximum": 9 });
        assert_eq!(ends(&whole), ["3", "9"]);
        let real = serde_json::json!({ "type": "number", "minimum": 0.5 });
        assert_eq!(ends(&real), ["5e-1", "1e300"]);
        let any = serde_json::json!({ "type": "number" });
        assert_eq!(ends(&any), ["-1e300", "1e-9", "1e300"]);
    }
}
