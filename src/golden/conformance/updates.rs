//! Law 13: what a node makes of what it gave before ([`Node::update`](maquette_node::Node::update)) is what it makes of its inputs alone.

use std::iter;

use maquette_graph::{Graph, GraphNode};
use maquette_node::{Previous, Progress};
use maquette_value::random::Random;
use maquette_value::{AnyValue, Attribute, Hash, Items, Mesh};

use super::extremes::Case;
use super::{inputs, within};

/// So many changes are made to each value.
const CHANGES: usize = 12;

/// Checks the node of an example: on the example's values, on hostile ones, where meshes have normals, and, in `others`, with other
/// parameters. One that gives nothing for what has not changed has nothing to keep.
pub(super) fn check(
    case: &Case<'_>,
    others: impl Iterator<Item = Graph>,
    broken: &mut Vec<String>,
) {
    let node = &case.graph.nodes()[case.index];
    let Some(good) = inputs(node, case.values) else { return };
    let mut tell = |why: String| broken.push(format!("{}: `update` {why}", case.entry.name));
    let ports = case.entry.ports();
    let hostile = |slot: usize| {
        let port = ports.iter().find(|port| port.name == node.links[slot].port);
        let kinds = port.into_iter().flat_map(|port| &port.types);
        kinds.flat_map(|kind| case.hostile.values(kind)).collect()
    };
    match follows(node, &good, &hostile, &mut tell) {
        None => return,
        Some(0) => tell("gives something for what has not changed, and for nothing else".into()),
        Some(_) => {}
    }
    let normals: Vec<_> = good.iter().map(with_normals).collect();
    for graph in others {
        for good in [&good, &normals] {
            follows(&graph.nodes()[case.index], good, &|_| Vec::new(), &mut tell);
        }
    }
}

/// A mesh with normals, which move along with its vertices; any other value as it is.
fn with_normals(value: &AnyValue) -> AnyValue {
    let Some(mesh) = value.get::<Mesh>() else { return value.clone() };
    let normals = mesh.vertex_normals().into_iter().map(Into::into).collect();
    let mesh = mesh.clone().with_vertex("normal", Attribute::Vector(normals));
    mesh.map_or_else(|_| value.clone(), AnyValue::new)
}

/// Changes what comes to a node, and other values at each port, and compares. How often it made something of what it gave before; none if
/// it does not even where nothing has changed.
fn follows(
    node: &GraphNode,
    good: &[AnyValue],
    others: &dyn Fn(usize) -> Vec<AnyValue>,
    tell: &mut dyn FnMut(String),
) -> Option<usize> {
    let outputs = evaluated(node, good)?.0.ok()?;
    let unchanged = Previous { inputs: good, outputs: &outputs };
    match updated(node, good, &unchanged) {
        Ok(None) => return None,
        Ok(Some(_)) => {}
        Err(panic) => tell(format!("panics: {panic}")),
    }
    let mut dice = Random(0);
    let mut followed = 0;
    for (slot, link) in node.links.iter().enumerate() {
        for value in iter::once(good[slot].clone()).chain(others(slot)) {
            let mut given = good.to_vec();
            given[slot] = value;
            let Some((Ok(outputs), _)) = evaluated(node, &given) else { continue };
            let previous = Previous { inputs: &given, outputs: &outputs };
            for _ in 0..CHANGES {
                let mut now = given.clone();
                let Some(changed) = changed(&given[slot], &mut dice) else { continue };
                now[slot] = changed;
                match agrees(node, &now, &previous) {
                    Ok(is_followed) => followed += usize::from(is_followed),
                    Err(why) => tell(format!(
                        "{why}, where {:?} at `{}` becomes {:?}, with {}",
                        given[slot], link.port, now[slot], node.recipe.parameters
                    )),
                }
            }
        }
    }
    Some(followed)
}

/// What a node gives, or why it fails, and its warnings.
type Made = (Result<Vec<AnyValue>, String>, Vec<String>);

/// What a node makes of its inputs alone; none if it panics, which another law finds.
fn evaluated(node: &GraphNode, inputs: &[AnyValue]) -> Option<Made> {
    let (made, warnings) = within(inputs, Progress::none(), |cx| node.node.eval(cx)).ok()?;
    Some((made.map_err(|error| error.to_string()), warnings))
}

/// What it makes of what it gave before, if it does; an error is what a panic said.
fn updated(
    node: &GraphNode,
    inputs: &[AnyValue],
    previous: &Previous<'_>,
) -> Result<Option<Made>, String> {
    let update = within(inputs, Progress::none(), |cx| node.node.update(cx, previous))?;
    let (made, warnings) = update;
    let made = made.map_err(|error| error.to_string()).transpose();
    Ok(made.map(|made| (made, warnings)))
}

/// Whether it makes something of what it gave before, which then is the right thing.
fn agrees(node: &GraphNode, now: &[AnyValue], previous: &Previous<'_>) -> Result<bool, String> {
    let updated = updated(node, now, previous).map_err(|panic| format!("panics: {panic}"))?;
    let (Some((made, warnings)), Some((expected, doubts))) = (updated, evaluated(node, now)) else {
        return Ok(false);
    };
    fn hashes(values: Vec<AnyValue>) -> Vec<Hash> {
        Vec::<Hash>::from_iter(values.iter().map(AnyValue::hash))
    }
    let (made, expected) = (made.map(hashes), expected.map(hashes));
    if made != expected {
        return Err(format!("gives {made:?} instead of {expected:?}"));
    }
    match warnings == doubts {
        true => Ok(true),
        false => Err(format!("warns of {warnings:?} instead of {doubts:?}")),
    }
}

/// The value with some numbers in a row of one of its parts changed; none if its type takes no such parts.
pub(super) fn changed(value: &AnyValue, dice: &mut Random) -> Option<AnyValue> {
    let mut parts = value.parts();
    let count = parts.columns.len();
    let items = &mut parts.columns.get_mut(dice.below(count.max(1)))?.items;
    let len = items.len();
    let first = dice.below(len.max(1));
    let row = first..len.min(first + 1 + dice.below(len / 8 + 1));
    match items {
        Items::F64(numbers) => {
            numbers.to_mut()[row]
                .iter_mut()
                .for_each(|x| *x += (x.abs() + 1.0) * 0.01 * dice.even());
        }
        Items::F32(numbers) => {
            numbers.to_mut()[row].iter_mut().for_each(|x| *x += (x.abs() + 1.0) * 0.01);
        }
        // Those of other elements: what they count or name is there.
        Items::U32(numbers) => {
            row.for_each(|place| numbers.to_mut()[place] = numbers[dice.below(len)]);
        }
        Items::U8(numbers) => {
            row.for_each(|place| numbers.to_mut()[place] = numbers[dice.below(len)]);
        }
    }
    value.kind().from_parts(&parts).ok()
}
