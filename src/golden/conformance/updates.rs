//! Law 13: the result of [`Node::update`](maquette_node::Node::update) equals the result computed from the inputs alone.

use std::iter;

use maquette_graph::{Graph, GraphNode};
use maquette_node::{Previous, Progress};
use maquette_value::rng::Random;
use maquette_value::{AnyValue, Attribute, Hash, Items, Mesh};

use super::evaluation::{call_with_context, inputs};
use super::extremes::Case;

/// The number of random changes that are tested for each value.
const CHANGES: usize = 12;

/// Checks the updates of a node: with the values of its example, with edge cases, with meshes that have normals, and with the other
/// parameters in `others`. If a node does not update even for unchanged inputs, it is assumed to have no updates.
pub(super) fn check(
    case: &Case<'_>,
    others: impl Iterator<Item = Graph>,
    broken: &mut Vec<String>,
) {
    let node = &case.graph.nodes()[case.index];
    let Some(good) = inputs(node, case.values) else { return };
    let mut report = |why: String| broken.push(format!("{}: `update` {why}", case.entry.name));
    let ports = case.entry.ports();
    let edge_cases = |slot: usize| {
        let port = ports.iter().find(|port| port.name == node.links[slot].port);
        let kinds = port.into_iter().flat_map(|port| &port.types);
        kinds.flat_map(|kind| case.edge_cases.values(kind)).collect()
    };
    match check_updates(node, &good, &edge_cases, &mut report) {
        None => return,
        Some(0) => report("gives something for what has not changed, and for nothing else".into()),
        Some(_) => {}
    }
    let normals: Vec<_> = good.iter().map(with_normals).collect();
    for graph in others {
        for good in [&good, &normals] {
            check_updates(&graph.nodes()[case.index], good, &|_| Vec::new(), &mut report);
        }
    }
}

/// Returns a mesh with normals computed from its shape. Returns any other value unchanged.
fn with_normals(value: &AnyValue) -> AnyValue {
    let Some(mesh) = value.get::<Mesh>() else { return value.clone() };
    let normals = mesh.vertex_normals().into_iter().map(Into::into).collect();
    let mesh = mesh.clone().with_vertex("normal", Attribute::Vector(normals));
    mesh.map_or_else(|_| value.clone(), AnyValue::new)
}

/// Checks the updates of a node after changes of its inputs. The inputs are `good`, and variants in which `others` replaces one input.
/// Returns the number of updates, or `None` if the node does not update even for unchanged inputs.
fn check_updates(
    node: &GraphNode,
    good: &[AnyValue],
    others: &dyn Fn(usize) -> Vec<AnyValue>,
    report: &mut dyn FnMut(String),
) -> Option<usize> {
    let outputs = evaluate(node, good)?.0.ok()?;
    let unchanged = Previous { inputs: good, outputs: &outputs };
    match update(node, good, &unchanged) {
        Ok(None) => return None,
        Ok(Some(_)) => {}
        Err(panic) => report(format!("panics: {panic}")),
    }
    let mut dice = Random(0);
    let mut followed = 0;
    for (slot, link) in node.links.iter().enumerate() {
        for value in iter::once(good[slot].clone()).chain(others(slot)) {
            let mut given = good.to_vec();
            given[slot] = value;
            let Some((Ok(outputs), _)) = evaluate(node, &given) else { continue };
            let previous = Previous { inputs: &given, outputs: &outputs };
            for _ in 0..CHANGES {
                let mut now = given.clone();
                let Some(changed) = change_numbers(&given[slot], &mut dice) else { continue };
                now[slot] = changed;
                match update_agrees(node, &now, &previous) {
                    Ok(is_followed) => followed += usize::from(is_followed),
                    Err(why) => report(format!(
                        "{why}, where {:?} at `{}` becomes {:?}, with {}",
                        given[slot], link.port, now[slot], node.recipe.parameters
                    )),
                }
            }
        }
    }
    Some(followed)
}

/// The result of a node (its outputs or its error), and its warnings.
type NodeOutcome = (Result<Vec<AnyValue>, String>, Vec<String>);

/// Evaluates a node. Returns `None` if it panics, because another law checks for panics.
fn evaluate(node: &GraphNode, inputs: &[AnyValue]) -> Option<NodeOutcome> {
    let (made, warnings) =
        call_with_context(inputs, Progress::silent(), |cx| node.node.eval(cx)).ok()?;
    Some((made.map_err(|error| error.to_string()), warnings))
}

/// Updates the previous result of a node. Returns `None` if the node cannot do that. The error is the message of a panic.
fn update(
    node: &GraphNode,
    inputs: &[AnyValue],
    previous: &Previous<'_>,
) -> Result<Option<NodeOutcome>, String> {
    let update =
        call_with_context(inputs, Progress::silent(), |cx| node.node.update(cx, previous))?;
    let (made, warnings) = update;
    let made = made.map_err(|error| error.to_string()).transpose();
    Ok(made.map(|made| (made, warnings)))
}

/// Updates the previous result of a node, and checks that the new result is right. Returns true if the node could update.
fn update_agrees(
    node: &GraphNode,
    now: &[AnyValue],
    previous: &Previous<'_>,
) -> Result<bool, String> {
    let updated = update(node, now, previous).map_err(|panic| format!("panics: {panic}"))?;
    let (Some((made, warnings)), Some((expected, expected_warnings))) =
        (updated, evaluate(node, now))
    else {
        return Ok(false);
    };
    fn hashes(values: Vec<AnyValue>) -> Vec<Hash> {
        Vec::<Hash>::from_iter(values.iter().map(AnyValue::hash))
    }
    let (made, expected) = (made.map(hashes), expected.map(hashes));
    if made != expected {
        return Err(format!("gives {made:?} instead of {expected:?}"));
    }
    match warnings == expected_warnings {
        true => Ok(true),
        false => Err(format!("warns of {warnings:?} instead of {expected_warnings:?}")),
    }
}

/// Returns a copy of the value in which some consecutive numbers are changed at random. Returns `None` if the value type rejects the
/// changed numbers.
pub(super) fn change_numbers(value: &AnyValue, dice: &mut Random) -> Option<AnyValue> {
    let mut parts = value.parts();
    let count = parts.columns.len();
    let items = &mut parts.columns.get_mut(dice.next_below(count.max(1)))?.items;
    let len = items.len();
    let first = dice.next_below(len.max(1));
    let row = first..len.min(first + 1 + dice.next_below(len / 8 + 1));
    match items {
        Items::F64(numbers) => {
            numbers.to_mut()[row]
                .iter_mut()
                .for_each(|x| *x += (x.abs() + 1.0) * 0.01 * dice.even());
        }
        Items::F32(numbers) => {
            numbers.to_mut()[row].iter_mut().for_each(|x| *x += (x.abs() + 1.0) * 0.01);
        }
        // Whole numbers may be indices that must refer to existing elements. So replace them by numbers of other elements.
        Items::U32(numbers) => {
            row.for_each(|place| numbers.to_mut()[place] = numbers[dice.next_below(len)]);
        }
        Items::U8(numbers) => {
            row.for_each(|place| numbers.to_mut()[place] = numbers[dice.next_below(len)]);
        }
    }
    value.kind().from_parts(&parts).ok()
}
