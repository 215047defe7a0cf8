//! Checks that a filled mesh is a surface at the rims of its holes. Elsewhere it is one if the mesh was.

use std::collections::BTreeMap;

use super::border::NotManifold;
use super::filling::Filling;
use super::rim::Surroundings;

/// Looks at the edges and the fans of faces at the vertices of `holes`.
///
/// # Errors
/// Edges with more than two faces, or two that disagree about their side; vertices with several fans of faces one of which goes all around.
pub(super) fn check_rims(
    filling: &Filling,
    surroundings: &Surroundings,
    holes: &[Vec<u32>],
) -> Result<(), NotManifold> {
    let mut spokes: BTreeMap<u32, Vec<[u32; 2]>> = BTreeMap::new();
    let spoke = |face: [u32; 3], vertex: u32| {
        let k = (0..3).find(|&k| face[k] == vertex).unwrap_or(0);
        [face[(k + 1) % 3], face[(k + 2) % 3]]
    };
    for &vertex in holes.iter().flatten() {
        let around = surroundings.around(vertex).iter();
        spokes.insert(vertex, around.map(|&face| spoke(face, vertex)).collect());
    }
    for &face in &filling.faces[filling.kept..] {
        for vertex in face {
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
        if is_torn(spokes) {
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

/// Whether faces make several fans, one of which goes all around. Each face is given by the vertices after and before the one in the middle,
/// sorted.
fn is_torn(spokes: &[[u32; 2]]) -> bool {
    let mut met = vec![false; spokes.len()];
    let mut walk = |start: usize| {
        let mut at = start;
        loop {
            met[at] = true;
            // The face beyond the edge to the vertex before.
            match spokes.binary_search_by_key(&spokes[at][1], |spoke| spoke[0]) {
                Ok(next) if met[next] => return,
                Ok(next) => at = next,
                Err(_) => return,
            }
        }
    };
    let begins = |spoke: &[u32; 2]| !spokes.iter().any(|other| other[1] == spoke[0]);
    let open: Vec<usize> = (0..spokes.len()).filter(|&k| begins(&spokes[k])).collect();
    open.iter().for_each(|&start| walk(start));
    let mut fans = open.len();
    let mut closed = 0;
    while let Some(start) = met.iter().position(|met| !met) {
        fans += 1;
        closed += 1;
        let mut at = start;
        while !std::mem::replace(&mut met[at], true) {
            match spokes.binary_search_by_key(&spokes[at][1], |spoke| spoke[0]) {
                Ok(next) => at = next,
                Err(_) => break,
            }
        }
    }
    closed > 0 && fans > 1
}
