//! Checks that a mesh is manifold at the rims of its holes after these are filled. Elsewhere it is manifold if the input mesh was.

use std::collections::BTreeMap;

use super::rim::OneRings;
use super::rims::{NotManifold, has_closed_fan_beside_others};
use crate::triangles::filling::Filling;

/// Checks the edges and the face fans at the vertices of the hole boundaries `holes`.
///
/// # Errors
/// Returns the edges that have more than two faces or two faces of opposite orientation. Also returns the vertices that have several face
/// fans, one of them closed.
pub(crate) fn check_rims(
    filling: &Filling,
    one_rings: &OneRings,
    holes: &[Vec<u32>],
) -> Result<(), NotManifold> {
    let mut spokes: BTreeMap<u32, Vec<[u32; 2]>> = BTreeMap::new();
    fn spoke(face: [u32; 3], vertex: u32) -> [u32; 2] {
        let k = (0..3).find(|&k| face[k] == vertex).unwrap_or(0);
        [face[(k + 1) % 3], face[(k + 2) % 3]]
    }
    for &vertex in holes.iter().flatten() {
        let one_ring = one_rings.triangles_around(vertex).iter();
        spokes.insert(vertex, one_ring.map(|&face| spoke(face, vertex)).collect());
    }
    for &face in &filling.faces[filling.n_data_faces..] {
        // Skip the vertices of the fill: none of them is on a rim.
        for vertex in face.into_iter().filter(|&vertex| (vertex as usize) < filling.n_data_vertices)
        {
            if let Some(spokes) = spokes.get_mut(&vertex) {
                spokes.push(spoke(face, vertex));
            }
        }
    }
    let mut found = NotManifold { edges: Vec::new(), vertices: Vec::new() };
    for (&vertex, spokes) in &mut spokes {
        spokes.sort_unstable();
        let twice = spokes.windows(2).filter(|pair| pair[0][0] == pair[1][0]);
        found.edges.extend(twice.map(|pair| [vertex.min(pair[0][0]), vertex.max(pair[0][0])]));
        if has_closed_fan_beside_others(spokes) {
            found.vertices.push(vertex);
        }
    }
    if found.edges.is_empty() && found.vertices.is_empty() {
        return Ok(());
    }
    found.edges.sort_unstable();
    found.edges.dedup();
    found.edges.truncate(8);
    found.vertices.truncate(8);
    Err(found)
}
