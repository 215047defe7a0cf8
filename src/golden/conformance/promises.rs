//! Law 10: the outputs of a node have the properties that it promises.

use maquette_graph::catalog::{Catalog, Entry};
use maquette_node::{Progress, Source};
use maquette_value::AnyValue;

use super::evaluation::{evaluate_node, inputs};
use super::extremes::Case;

/// Checks that all ports, outputs and properties exist that the promises of a node name.
pub(super) fn check_names(entry: &Entry, catalog: &Catalog, broken: &mut Vec<String>) {
    let ports = entry.ports();
    let types_of = |port: &str| {
        let types = ports.iter().find(|known| known.name == port)?.types.iter();
        Some(types.filter_map(|kind| catalog.value_type(kind)).collect::<Vec<_>>())
    };
    for term in entry.terms() {
        let output = entry.outputs().iter().find(|output| output.name == term.at);
        let types = match term.source {
            None => types_of(term.at),
            Some(Source::From(port)) => types_of(port).and(output.map(|it| it.types.clone())),
            Some(_) => output.map(|it| it.types.clone()),
        };
        if !types.is_some_and(|types: Vec<&maquette_value::ValueType>| {
            types.iter().any(|kind| kind.property(term.property).is_some())
        }) {
            let (name, at, words) = (&entry.name, term.at, term.describe());
            broken.push(format!("{name} says `{words}` of `{at}`, but a port, an output or the property is not there"));
        }
    }
}

/// Checks the promises of a node with the inputs of its example, and with edge cases in place of each input.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let node = &case.graph.nodes()[case.index];
    let Some(good) = inputs(node, case.values) else { return };
    judge(case, &good, "its example", broken);
    let ports = case.entry.ports();
    for (slot, link) in node.links.iter().enumerate() {
        let Some(port) = ports.iter().find(|port| port.name == link.port) else { continue };
        for value in port.types.iter().flat_map(|kind| case.edge_cases.values(kind)) {
            let mut given = good.clone();
            let what = format!("{value:?} at `{}`", link.port);
            given[slot] = value;
            judge(case, &given, &what, broken);
        }
    }
}

/// Checks the promises of a node with the inputs `given`, unless the node rejects them.
fn judge(case: &Case<'_>, given: &[AnyValue], what: &str, broken: &mut Vec<String>) {
    let node = &case.graph.nodes()[case.index];
    let promises = node.node.promises();
    fn has(
        port: &str,
        property: &str,
        given: &[AnyValue],
        node_links: &[maquette_graph::Link],
    ) -> bool {
        let values = node_links.iter().zip(given).filter(|(link, _)| link.port == port);
        values.map(|(_, value)| value).all(|value| value.violation(property).is_none())
    }
    let wants = node.node.wants();
    if promises.is_empty()
        || !wants.iter().all(|(port, property)| has(port, property, given, &node.links))
    {
        return;
    }
    let Ok(Some(made)) = evaluate_node(node, given, Progress::silent()) else { return };
    for (output, property, source) in promises {
        let Some(at) = node.outputs.iter().position(|name| *name == output) else { continue };
        let violation = made[at].violation(property);
        let is_kept = match source {
            Source::From(port) => violation.is_none() || !has(port, property, given, &node.links),
            Source::Always => violation.is_none(),
            Source::Never => violation.is_some() || made[at].violation("NonEmpty").is_some(),
        };
        if !is_kept {
            let why = violation.map_or("is so".to_owned(), |violation| violation.what);
            let name = &case.entry.name;
            broken.push(format!(
                "{name} breaks its promise of {property} with {what}: `{output}` {why}"
            ));
        }
    }
}
