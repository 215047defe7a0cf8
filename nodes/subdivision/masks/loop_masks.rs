//! The masks of Loop's scheme for triangles.
//!
//! Loop, "Smooth subdivision surfaces based on triangles" (1987), with the weights beta of this publication; limit points and tangents are
//! derived from the eigenvectors of the masks. Notation as in `vertex_rings.rs`.

use std::f64::consts::PI;

use super::roots_of_unity::root_of_unity;
use super::vertex_rings::{Masks, Weights};
use crate::refine::half_edges::HalfEdges;

/// The masks of Loop's scheme.
#[derive(Clone, Copy, Default)]
pub(crate) struct LoopMasks;

impl Masks for LoopMasks {
    /// A step moves a vertex `v` with `n` neighbors `e_j` to `(1 - n beta) v + beta sum e_j`.
    fn vertex(&self, n: usize) -> [f64; 3] {
        let beta = beta(n);
        [1.0 - n as f64 * beta, beta, 0.0]
    }

    /// The limit point of a vertex `v` with `n` neighbors `e_j` is `(w v + sum e_j) / (w + n)` with `w = 3 / (8 beta)`.
    fn limit(&self, n: usize) -> [f64; 3] {
        let w = 0.375 / beta(n);
        let neighbor = 1.0 / (w + n as f64);
        [w * neighbor, neighbor, 0.0]
    }

    /// The new vertex on an edge is `3/8 (a + b) + 1/8 (c + d)` for the ends `a` and `b` and the opposite vertices `c` and `d`.
    const EDGE: [f64; 2] = [0.375, 0.125];

    fn opposite(&self, mesh: &impl HalfEdges, half: u32) -> u32 {
        mesh.corners()[mesh.previous(half) as usize]
    }

    fn tangents(&self, [first, second]: [&mut Weights; 2]) {
        let n = first.neighbors.len();
        for j in 0..n {
            [first.neighbors[j], second.neighbors[j]] = root_of_unity(j, n);
        }
    }

    /// Uses the masks of Hoppe et al. (1994), table 2, for the tangent across a crease. The sign of the row for four and more faces is
    /// changed, so that all tangents point into the surface.
    fn across(&self, to: &mut Weights) {
        let q = to.neighbors.len() - 1;
        let angle = PI / q as f64;
        let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
        for (j, weight) in to.neighbors.iter_mut().enumerate() {
            let is_end = j == 0 || j == q;
            *weight = match q {
                1 => 1.0,
                2 => f64::from(u8::from(!is_end)),
                3 if is_end => -1.0,
                3 => 2.0,
                _ if is_end => -sine,
                _ => (2.0 - 2.0 * cosine) * libm::sin(j as f64 * angle),
            };
        }
        to.own = match q {
            1 | 3 => -2.0,
            2 => -1.0,
            _ => 0.0,
        };
    }
}

/// The weight beta that Loop gives to each neighbor of a vertex with `n` neighbors.
fn beta(n: usize) -> f64 {
    let [cosine, _] = root_of_unity(1, n);
    let center = 0.375 + cosine / 4.0;
    (0.625 - center * center) / n as f64
}
