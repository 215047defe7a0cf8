//! Which limit points depend on which control points alone: the order in which they are solved for.
//!
//! The blocks are found from the limit masks alone, for every scheme. Around the end of a crease the equations do not decompose; there the
//! normal equations are solved.

use maquette_value::Faces;
use maquette_value::parallel::*;

use super::limit_matrix::LimitMatrix;
use crate::Scheme;
use crate::limit::limit_rows::LimitPlaces;

/// The masks of corners and of vertices on borders and creases have at most so many entries: fewer than those of smooth vertices
/// with three neighbors.
const CURVE: usize = 3;

/// The equations of the control points of `limit`, in blocks: what reaches nobody else first. Control points that `fixed` marks are
/// in no block; it may be empty.
pub(crate) fn limit_matrix(limit: &LimitPlaces, faces: &Faces, fixed: &[bool]) -> LimitMatrix {
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
            _ if indices.len() <= CURVE => 1.0 / beside,
            Scheme::Loop => 1.0 / beside,
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

/// For each vertex how many others must be solved for one after the other before it, and whether vertices of one such level always
/// reach each other both ways or not at all.
///
/// Where two vertices reach each other, they are solved for together. Where only one reaches the other, it comes after it; unless they
/// are solved for together because of others, as around the end of a crease.
fn levels(limit: &LimitPlaces) -> (Vec<u32>, bool) {
    let rows = &limit.positions;
    let count = rows.len();
    let mut levels = vec![0; count];
    // Without borders and creases all reach each other.
    if (0..count).all(|vertex| rows.row(vertex).0.len() > CURVE) {
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
    // Corners, curves, smooth vertices: chains are short.
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

/// The lowest vertex that is solved for together with one.
fn leader(leaders: &mut [u32], vertex: u32) -> u32 {
    let mut at = vertex;
    while leaders[at as usize] != at {
        leaders[at as usize] = leaders[leaders[at as usize] as usize];
        at = leaders[at as usize];
    }
    at
}
