//! Two meshes: face by face if they have the same faces, else by the distance of their surfaces.

use rayon::prelude::*;

use super::columns::{difference, in_words, judge, measure, worst};
use super::nearest::{Hit, Tree};
use super::{Comparison, Measure, Tolerance, Verdict, allowed, compare_parts, order};
use crate::golden::parts::{Class, Part, Parts};
use crate::golden::topology::Topology;
use crate::value::{AnyValue, Mesh};

pub(crate) fn compare_meshes(old: &Mesh, new: &Mesh, tolerance: &Tolerance) -> Comparison {
    let same_faces = old.faces() == new.faces() && old.positions().len() == new.positions().len();
    if same_faces {
        let parts = |mesh: &Mesh| Parts::of(&AnyValue::new(mesh.clone())).unwrap_or_default();
        let (old_parts, new_parts) = rayon::join(|| parts(old), || parts(new));
        let comparison = compare_parts(&old_parts, &new_parts, tolerance);
        if comparison.measures.iter().any(|measure| measure.max > 0.0)
            || !comparison.reasons.is_empty()
        {
            return comparison;
        }
    }
    let (a, b) = rayon::join(|| order::of_mesh(old), || order::of_mesh(new));
    if a == b && !same_faces {
        return Comparison::alike(Verdict::Reordered);
    }
    let mut reasons = Vec::new();
    if !tolerance.remeshed {
        let (before, now) = rayon::join(|| Topology::of(old), || Topology::of(new));
        let pairs = before.facts().into_iter().zip(now.facts());
        let changed = pairs.filter(|((_, before), (_, now))| before != now);
        reasons
            .extend(changed.map(|((name, before), (_, now))| format!("{name}: {before} -> {now}")));
    }
    let (hits, more) = surfaces(old, new, tolerance);
    let mut measures = more;
    let (mut attributes, lost) = attributes(old, new, &hits, tolerance);
    reasons.extend(lost);
    measures.append(&mut attributes);
    Comparison::new(reasons, measures)
}

/// How far each vertex of one mesh is from the surface of another one, in mm.
pub(crate) fn distances(from: &Mesh, to: &Mesh) -> Vec<f64> {
    let hits = Tree::new(to).nearest_to_all(from.positions());
    hits.iter().map(|hit| hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt())).collect()
}

/// The distances of both surfaces, both ways, and where the new one is nearest to the vertices of the old one.
fn surfaces(old: &Mesh, new: &Mesh, tolerance: &Tolerance) -> (Vec<Option<Hit>>, Vec<Measure>) {
    let (of_old, of_new) = rayon::join(|| Tree::new(old), || Tree::new(new));
    let hits = of_new.nearest_to_all(old.positions());
    let back = of_old.nearest_to_all(new.positions());
    let part =
        Part::new("position", Class::Place, 3, bytemuck::cast_slice(old.positions()).to_vec());
    let limit = allowed(&part, tolerance);
    let one_way = |name: &str, mesh: &Mesh, hits: &[Option<Hit>]| {
        let distance = |hit: &Option<Hit>| hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt());
        let distances: Vec<f64> = hits.iter().map(distance).collect();
        let mut measure = measure(name, &distances, "mm", limit);
        if let Some(vertex) = worst(&distances) {
            let at = in_words(mesh.positions()[vertex].coords.as_slice());
            let face =
                hits[vertex].map_or(String::new(), |hit| format!(", nearest face {}", hit.face));
            measure.worst = format!("vertex {vertex} {at}{face}");
        }
        judge(&mut measure, Class::Place, tolerance);
        measure
    };
    let measures = vec![
        one_way("surface, old to new", old, &hits),
        one_way("surface, new to old", new, &back),
    ];
    (hits, measures)
}

/// Compares the attributes of each vertex of `old` with those of `new` at the nearest place; says, too, which are gone or new.
fn attributes(
    old: &Mesh,
    new: &Mesh,
    hits: &[Option<Hit>],
    tolerance: &Tolerance,
) -> (Vec<Measure>, Vec<String>) {
    let [before, now] = [old, new].map(|mesh| {
        let [vertex, corner] = [mesh.vertex(), mesh.corner()].map(Parts::of_attributes);
        (vertex, corner)
    });
    let mut reasons = Vec::new();
    let mut measures = Vec::new();
    for (part, of_corner) in
        before.0.iter().map(|p| (p, false)).chain(before.1.iter().map(|p| (p, true)))
    {
        let theirs = if of_corner { &now.1 } else { &now.0 };
        match theirs.iter().find(|other| other.name == part.name && other.width == part.width) {
            None => reasons.push(format!("`{}` is gone", part.name)),
            Some(_) if of_corner => {}
            Some(other) => measures.push(at_nearest(part, other, new, hits, tolerance)),
        }
    }
    let known = |name: &str| before.0.iter().chain(&before.1).any(|part| part.name == name);
    let unknown = now.0.iter().chain(&now.1).filter(|part| !known(&part.name));
    reasons.extend(unknown.map(|part| format!("`{}` is new", part.name)));
    let rest = |mesh: &Mesh| (mesh.creases().len(), mesh.texture().map(crate::value::hash_of));
    if rest(old).0 != rest(new).0 {
        reasons.push(format!("creases: {} -> {}", rest(old).0, rest(new).0));
    }
    if rest(old).1 != rest(new).1 {
        reasons.push("the texture is another one".into());
    }
    (measures, reasons)
}

fn at_nearest(
    part: &Part,
    other: &Part,
    new: &Mesh,
    hits: &[Option<Hit>],
    tolerance: &Tolerance,
) -> Measure {
    let of = |(vertex, hit): (usize, &Option<Hit>)| {
        let Some(hit) = hit else { return f64::INFINITY };
        let face = new.faces().face(hit.face as usize);
        let corners = [face[0], face[hit.fan as usize + 1], face[hit.fan as usize + 2]];
        let most = (0..3).max_by(|&a, &b| hit.shares[a].total_cmp(&hit.shares[b])).unwrap_or(0);
        let there = match part.class {
            // What is equal or not has no mean.
            Class::Exact | Class::Level => other.element(corners[most] as usize).to_vec(),
            _ => (0..part.width)
                .map(|k| {
                    (0..3).map(|c| hit.shares[c] * other.element(corners[c] as usize)[k]).sum()
                })
                .collect(),
        };
        difference(part.class, part.element(vertex), &there)
    };
    let differences: Vec<f64> = hits.par_iter().enumerate().map(of).collect();
    let mut measure =
        measure(&part.name, &differences, super::unit(part.class), allowed(part, tolerance));
    if let Some(vertex) = worst(&differences) {
        measure.worst = format!("vertex {vertex}");
    }
    judge(&mut measure, part.class, tolerance);
    measure
}
