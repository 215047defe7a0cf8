//! Block decomposition of the interpolation equations: it determines the order in which control points are solved for.
//!
//! The blocks are derived from the limit masks, for every scheme. Around the end of a crease the equations do not decompose into blocks; in
//! this case the normal equations are solved.

use maquette_value::Faces;
use maquette_value::parallel::*;

use super::limit_matrix::LimitMatrix;
use crate::Scheme;
use crate::limit::limit_rows::LimitPositions;

/// The maximum number of entries in a mask of a corner or of a vertex on a border or crease. Masks of smooth vertices have more entries.
const MAX_CURVE_ENTRIES: usize = 3;

/// Builds the equations for the control points from the masks in `limit`. The equations are grouped into blocks, those that depend on no
/// other block first. Control points marked in `fixed`, which may be empty, are in no block.
pub(crate) fn limit_matrix(limit: &LimitPositions, faces: &Faces, fixed: &[bool]) -> LimitMatrix {
    let rows = &limit.positions;
    let mut degrees = vec![0u32; rows.len()];
    faces.corners().iter().for_each(|&vertex| degrees[vertex as usize] += 1);
    let all = (0..rows.len()).into_par_iter().with_min_len(1024);
    let scale = all.map(|vertex| {
        let (indices, weights) = rows.row(vertex);
        let others = indices.iter().zip(weights).filter(|(k, _)| **k as usize != vertex);
        let beside = others.map(|(_, &weight)| weight).fold(0.0, f64::max);
        let n = f64::from(degrees[vertex]);
        match limit.topology.rules.scheme {
            _ if beside == 0.0 => 1.0,
            _ if indices.len() <= MAX_CURVE_ENTRIES => 1.0 / beside,
            Scheme::Loop | Scheme::Butterfly => 1.0 / beside,
            Scheme::CatmullClark => n * (n + 5.0),
            Scheme::DooSabin => n,
        }
    });
    let (levels, is_symmetric) = levels(limit);
    let last = levels.iter().copied().max().unwrap_or(0);
    let blocks = (0..=last).map(|level| {
        let members = (0..).zip(&levels).filter(|(_, own)| **own == level);
        members
            .map(|(vertex, _)| vertex)
            .filter(|vertex| !fixed.get(*vertex as usize).is_some_and(|&fixed| fixed))
            .collect::<Vec<_>>()
    });
    let blocks = blocks.filter(|block| !block.is_empty()).collect();
    let scale = is_symmetric.then(|| scale.collect());
    LimitMatrix { scale, blocks, rows: rows.clone() }
}

/// Computes the level of each vertex: the number of vertices in the longest chain that must be solved before it. Also returns whether the
/// dependence between vertices of one level is symmetric.
///
/// Two vertices that depend on each other are solved together. If only one depends on the other, it gets a higher level, unless other
/// vertices force both to be solved together, as around the end of a crease.
fn levels(limit: &LimitPositions) -> (Vec<u32>, bool) {
    let rows = &limit.positions;
    let count = rows.len();
    let mut levels = vec![0; count];
    // Without borders and creases all vertices depend on each other.
    if (0..count).all(|vertex| rows.row(vertex).0.len() > MAX_CURVE_ENTRIES) {
        return (levels, true);
    }
    fn reaches(from: usize, to: u32, rows: &maquette_base::linear::stencils::Stencils) -> bool {
        rows.row(from).0.contains(&to)
    }
    let mut leaders: Vec<u32> = (0..count as u32).collect();
    let mut after = Vec::new();
    for vertex in 0..count {
        for &other in rows.row(vertex).0.iter().filter(|&&other| other as usize != vertex) {
            if reaches(other as usize, vertex as u32, rows) {
                let [a, b] = [vertex as u32, other].map(|v| leader(&mut leaders, v));
                leaders[a.max(b) as usize] = a.min(b);
            } else {
                after.push([vertex as u32, other]);
            }
        }
    }
    if after.iter().any(|[a, b]| leader(&mut leaders, *a) == leader(&mut leaders, *b)) {
        return (levels, false);
    }
    // Chains are short: corners, then curves, then smooth vertices.
    loop {
        let mut changed = false;
        for &[vertex, before] in &after {
            let [vertex, before] = [vertex, before].map(|v| leader(&mut leaders, v) as usize);
            if levels[vertex] <= levels[before] {
                levels[vertex] = levels[before] + 1;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    ((0..count as u32).map(|vertex| levels[leader(&mut leaders, vertex) as usize]).collect(), true)
}

/// Returns the lowest vertex index among those that are solved together with `vertex`.
fn leader(leaders: &mut [u32], vertex: u32) -> u32 {
    let mut at = vertex;
    while leaders[at as usize] != at {
        leaders[at as usize] = leaders[leaders[at as usize] as usize];
        at = leaders[at as usize];
    }
    at
}
