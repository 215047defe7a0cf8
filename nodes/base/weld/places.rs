//! Groups vertices by place.

use maquette_value::{DistinctPositions, Mesh};

use super::join::NO_PLACE;
use crate::topology::lists::Lists;
use crate::tree::Tree;

/// Returns the number of the place of each vertex that can be joined: one on a border, or without faces. [`NO_PLACE`] for all others.
///
/// A place is that of the lowest vertex that has none yet, together with those within `within` mm of it that have none, the nearest first.
/// Of a face, only one vertex is at a place, unless its vertices have equal positions.
pub(super) fn places(mesh: &Mesh, within: f64) -> Vec<u32> {
    let mut is_candidate = mesh.border_vertices();
    let mut has_face = vec![false; is_candidate.len()];
    mesh.faces().corners().iter().for_each(|&vertex| has_face[vertex as usize] = true);
    is_candidate.iter_mut().zip(has_face).for_each(|(it, has_face)| *it |= !has_face);
    let candidates: Vec<u32> =
        (0..is_candidate.len() as u32).filter(|&vertex| is_candidate[vertex as usize]).collect();
    let mut places = vec![NO_PLACE; is_candidate.len()];
    if within > 0.0 {
        surroundings(mesh, &candidates, within, &mut places);
        return places;
    }
    let mut distinct = DistinctPositions::default();
    for vertex in candidates {
        places[vertex as usize] = distinct.insert(mesh.positions()[vertex as usize]);
    }
    places
}

fn surroundings(mesh: &Mesh, candidates: &[u32], within: f64, places: &mut [u32]) {
    let points: Vec<_> =
        candidates.iter().map(|&vertex| mesh.positions()[vertex as usize]).collect();
    let tree = Tree::new(&points);
    let faces = Lists::group(places.len(), || {
        (0..)
            .zip(mesh.faces().iter())
            .flat_map(|(face, corners)| corners.iter().map(move |&vertex| (vertex, face)))
    });
    // For each face, the last place that has one of its vertices.
    let mut taken = vec![NO_PLACE; mesh.faces().len()];
    let mut place = 0;
    for (&leader, point) in candidates.iter().zip(&points) {
        if places[leader as usize] != NO_PLACE {
            continue;
        }
        let mut near: Vec<(f64, u32)> = tree
            .points_within(point, within.next_up())
            .into_iter()
            .map(|k| ((points[k as usize] - point).norm(), candidates[k as usize]))
            .filter(|&(_, vertex)| places[vertex as usize] == NO_PLACE)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // The leader comes first, even if another vertex has its position.
        near.retain(|&(_, vertex)| vertex != leader);
        for vertex in std::iter::once(leader).chain(near.into_iter().map(|(_, vertex)| vertex)) {
            let faces = faces.list(vertex as usize);
            if faces.iter().all(|&face| taken[face as usize] != place) {
                faces.iter().for_each(|&face| taken[face as usize] = place);
                places[vertex as usize] = place;
            }
        }
        place += 1;
    }
}
