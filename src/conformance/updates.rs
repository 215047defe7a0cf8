//! Law 13: what a node makes of what it gave before ([`Node::update`](crate::Node::update)) is what it makes of its inputs alone.

use super::extremes::Case;
use super::{inputs, within};
use crate::graph::GraphNode;
use crate::node::{Previous, Progress};
use crate::random::Random;
use crate::value::{AnyValue, Hash, Items};

/// So many changes are made to each value.
const CHANGES: usize = 12;

/// Checks the node of an example, on the example's values and on hostile ones. One that gives nothing for what has not changed has
/// nothing to keep.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let node = &case.graph.nodes[case.index];
    let Some(good) = inputs(node, case.values) else { return };
    let Some(Ok(outputs)) = evaluated(node, &good).map(|(made, _)| made) else { return };
    let unchanged = Previous { inputs: &good, outputs: &outputs };
    match updated(node, &good, &unchanged) {
        Ok(None) => return,
        Ok(Some(_)) => {}
        Err(panic) => broken.push(format!("{}: `update` panics: {panic}", case.entry.name)),
    }
    let ports = case.entry.ports();
    let mut dice = Random(0);
    for (slot, link) in node.links.iter().enumerate() {
        let port = ports.iter().find(|port| port.name == link.port);
        let kinds = port.iter().flat_map(|port| &port.types);
        let hostile = kinds.flat_map(|kind| case.hostile.values(kind));
        for value in [good[slot].clone()].into_iter().chain(hostile) {
            let mut given = good.clone();
            given[slot] = value;
            let Some((Ok(outputs), _)) = evaluated(node, &given) else { continue };
            let previous = Previous { inputs: &given, outputs: &outputs };
            for _ in 0..CHANGES {
                let mut now = given.clone();
                let Some(changed) = changed(&given[slot], &mut dice) else { continue };
                now[slot] = changed;
                if let Err(why) = agrees(node, &now, &previous) {
                    let what =
                        format!("{:?} at `{}` becomes {:?}", given[slot], link.port, now[slot]);
                    broken.push(format!("{}: `update` {why}, where {what}", case.entry.name));
                }
            }
        }
    }
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

fn agrees(node: &GraphNode, now: &[AnyValue], previous: &Previous<'_>) -> Result<(), String> {
    let updated = updated(node, now, previous).map_err(|panic| format!("panics: {panic}"))?;
    let (Some((made, warnings)), Some((expected, doubts))) = (updated, evaluated(node, now)) else {
        return Ok(());
    };
    let hashes = |values: Vec<AnyValue>| Vec::<Hash>::from_iter(values.iter().map(AnyValue::hash));
    let (made, expected) = (made.map(hashes), expected.map(hashes));
    if made != expected {
        return Err(format!("gives {made:?} instead of {expected:?}"));
    }
    match warnings == doubts {
        true => Ok(()),
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
