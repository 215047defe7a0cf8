//! Law 11: of attributes becomes what a node declares. Meshes and points with marks on all domains go through its example.

use std::collections::BTreeSet;

use super::extremes::Case;
use super::{inputs, made};
use crate::node::{Carry, DOMAINS, Fate, Progress};
use crate::value::{AnyValue, Attribute, Attributes, Mesh, Points};

/// The name of the marks.
const MARK: &str = "mark-of-the-law";

/// Of an edge that is marked, by a sharpness that stays.
const SHARP: f64 = 10.0;

/// Checks what the node of an example declares, and that it declares something for each way that attributes may go.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let (entry, node) = (case.entry, &case.graph.nodes[case.index]);
    let declared = entry.carries();
    let carries = |kind: &str| kind == "Mesh" || kind == "Points";
    let ports = entry.ports();
    let ports = ports.iter().filter(|port| port.types.iter().any(|kind| carries(kind)));
    let outputs = entry.outputs().iter();
    let outputs =
        Vec::from_iter(outputs.filter(|it| it.types.iter().any(|kind| carries(kind.name))));
    for port in ports {
        for output in &outputs {
            let is_it = |it: &&Carry| (it.port, it.output) == (&port.name[..], output.name);
            if declared.iter().filter(is_it).count() != 1 {
                let (name, port, output) = (&entry.name, &port.name, output.name);
                broken.push(format!("{name} does not say once what becomes of attributes from `{port}` to `{output}`"));
            }
        }
    }
    let Some(good) = inputs(node, case.values) else { return };
    // What reads files cannot be run by itself.
    if !matches!(made(node, &good, Progress::none()), Ok(Some(_))) {
        return;
    }
    for carry in declared {
        let mut given = good.clone();
        let mut marks: [BTreeSet<u64>; 4] = Default::default();
        for (slot, _) in node.links.iter().enumerate().filter(|(_, link)| link.port == carry.port) {
            if let Some(marked) = marked(&given[slot], &mut marks) {
                given[slot] = marked;
            }
        }
        if marks.iter().all(BTreeSet::is_empty) {
            continue;
        }
        let made = made(node, &given, Progress::none());
        let at = node.outputs.iter().position(|name| *name == carry.output);
        let (Ok(Some(made)), Some(at)) = (made, at) else {
            broken.push(format!("{} fails on marked values at `{}`", entry.name, carry.port));
            continue;
        };
        let found = found(&made[at]);
        for domain in 0..DOMAINS.len() {
            if !marks[domain].is_empty()
                && !is_so(
                    carry.fates[domain],
                    DOMAINS[domain] == "edge",
                    &marks[domain],
                    found[domain].as_deref(),
                )
            {
                let (name, word, fate) = (&entry.name, DOMAINS[domain], carry.fates[domain].word());
                let (port, output) = (carry.port, carry.output);
                broken.push(format!(
                    "{name}: attributes of each {word} from `{port}` to `{output}` are not {fate}"
                ));
            }
        }
    }
}

/// Whether marks that were given became what is said of them, by what was found.
fn is_so(fate: Fate, is_edge: bool, given: &BTreeSet<u64>, found: Option<&[f64]>) -> bool {
    let Some(found) = found else { return fate == Fate::Dropped };
    let (least, most) = (given.first(), given.last());
    let is_between = |x: &f64| {
        // What is rounded may be a bit beside.
        let slack = 1e-9 * most.map_or(0.0, |most| *most as f64);
        least.is_some_and(|least| *least as f64 - slack <= *x)
            && most.is_some_and(|most| *x <= *most as f64 + slack)
    };
    match fate {
        // Others may come beside it.
        Fate::Kept if is_edge => given.iter().all(|mark| found.contains(&(*mark as f64))),
        Fate::Kept => found.iter().all(|x| x.fract() == 0.0 && given.contains(&(*x as u64))),
        Fate::Interpolated => found.iter().all(is_between),
        Fate::Dropped => false,
    }
}

/// A value with a number of its own at each element, which are added to the marks; none if it has no attributes.
fn marked(value: &AnyValue, marks: &mut [BTreeSet<u64>; 4]) -> Option<AnyValue> {
    let mut numbers = |domain: usize, count: usize| {
        // Each port's links have numbers of their own.
        let first = marks[domain].last().map_or(1, |last| last + 1);
        let new = first..first + count as u64;
        marks[domain].extend(new.clone());
        Attribute::Number(new.map(|number| number as f64).collect())
    };
    if let Some(points) = value.get::<Points>() {
        let all = numbers(0, points.positions().len());
        return Some(AnyValue::new(points.clone().with_attribute(MARK, all).ok()?));
    }
    let mesh = value.get::<Mesh>()?;
    let counts = [mesh.positions().len(), mesh.faces().corners().len(), mesh.faces().len()];
    let mut marked = mesh.clone().with_vertex(MARK, numbers(0, counts[0])).ok()?;
    marked = marked.with_corner(MARK, numbers(1, counts[1])).ok()?;
    marked = marked.with_face(MARK, numbers(3, counts[2])).ok()?;
    let edges = mesh.edges();
    let inner = edges.faces.iter().position(|faces| *faces == 2);
    if let (Some(inner), 0) = (inner, mesh.creases().len()) {
        marks[2].insert(SHARP as u64);
        marked = marked.with_creases([(edges.vertices[inner], SHARP)]).ok()?;
    }
    Some(AnyValue::new(marked))
}

/// The marks that a value has; none where a domain has none.
fn found(value: &AnyValue) -> [Option<Vec<f64>>; 4] {
    let of = |attributes: &Attributes| match attributes.get(MARK) {
        Some(Attribute::Number(numbers)) => Some(numbers.to_vec()),
        _ => None,
    };
    if let Some(points) = value.get::<Points>() {
        return [of(points.attributes()), None, None, None];
    }
    let Some(mesh) = value.get::<Mesh>() else { return Default::default() };
    let creases = Vec::from_iter(mesh.creases().map(|(_, sharpness)| sharpness));
    let creases = Some(creases).filter(|creases| !creases.is_empty());
    [of(mesh.vertex()), of(mesh.corner()), creases, of(mesh.face())]
}
